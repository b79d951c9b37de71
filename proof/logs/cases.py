"""Cases: a seed makes the recording folder of an imperfect logger, and the key that says what is in it."""

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from cable_envs.proof.cases import KEY_SCHEMA, PERIOD, Case, claims, sizes
from cable_envs.proof.effects import AMBIENT, LIBRARY, STRANGE, SYSTEMS, find
from cable_envs.proof.excitation import DESIGNS, reference
from cable_envs.proof.logs.loggers import KINDS, Log, logged
from cable_envs.proof.refit import Refit
from cable_envs.proof.rigs import CLOCK, random_rig
from cable_envs.proof.sensors import stamps
from cable_envs.proof.writing import concealment, profile, write_recording


def plan(
    kinds: Sequence[str] = tuple(KINDS), systems: Sequence[str] = SYSTEMS, nothing: int = 3, single: int = 3,
    strange: int = 1, seed: int = 5,
) -> list[Case]:  # fmt: skip
    """Cases of every kind and system, in an order that tells nothing.

    Parameters
    ----------
    kinds, systems : sequence of str
        Which ones.
    nothing, single, strange : int
        Cases of each kind and system in which nothing is missing, one effect, and physics of no library.
    seed : int
        Of the plan.

    Returns
    -------
    list of Case
        ``noise`` says the kind of log.
    """
    rng = np.random.default_rng([seed, 3])
    wanted: list[dict[str, Any]] = []
    for noise in kinds:
        for system in systems:
            wanted += [{"kind": "nothing", "noise": noise, "system": system}] * nothing
            names = rng.choice([e.name for e in LIBRARY[system]], single, replace=False)
            odd = rng.choice([e.name for e in STRANGE[system]], strange, replace=False)
            wanted += [
                {
                    "kind": kind,
                    "noise": noise,
                    "system": system,
                    "effects": (str(name),),
                    "band": (">10", "3-10")[k % 2],
                }
                for kind, drawn in (("single", names), ("strange", odd))
                for k, name in enumerate(drawn)
            ]
    seeds, order = rng.integers(2**31, size=len(wanted)), rng.permutation(len(wanted))
    return [Case(f"log-{n:04d}", int(seeds[i]), **wanted[i]) for n, i in enumerate(order, 1)]


def make(case: Case, folder: Path) -> dict[str, Any]:
    """Write the recording of a case, and say what is in it; as `cable_envs.proof.cases.make`.

    Parameters
    ----------
    case : Case
        ``noise`` is a key of `KINDS`.
    folder : Path
        Is made; recording.yaml and one table for each record.

    Returns
    -------
    dict
        The key, schema "cable-proof-key/1", with what the logger did as "log".
    """
    rng = np.random.default_rng([case.seed, 11])
    missing = tuple(find(case.system, name) for name in case.effects)
    rig = random_rig(case.system, rng, missing)
    log = Log(**KINDS[case.noise](rig, rng))
    motions, at, offsets, first = [], [], [], 0.0
    for seconds, design in zip(rng.uniform(22.0, 32.0, 3), rng.permutation(DESIGNS)[:3], strict=True):
        motions.append(rig.centre + reference(str(design), rng, seconds, rig.amplitude, CLOCK))
        begin = rng.uniform(4.0, 6.0) if log.cut else 0.0
        at.append(begin + stamps(rng, 0.0, seconds - begin, PERIOD, 0.0))
        offsets.append(first)
        first += float(np.ceil(seconds)) + 60.0
    refit = Refit(rig, motions[:2], at[:2])
    changes, entries = sizes(case, missing, refit, rng)
    found = refit.excess(changes) if changes else None
    tables = []
    for motion, times, offset in zip(motions, at, offsets, strict=True):
        tables.append(logged(rig, log, changes, motion, times, offset, rng))
    write_recording(folder, rig, claims(case, rig, rng), tables, False)
    key = {
        "schema": KEY_SCHEMA, "case": asdict(case), "effects": entries, "ambient": list(AMBIENT[case.system]),
        "added": found.added if found else 0.0, "absorbed": found.absorbed if found else 0.0,
        "excess_by_channel": dict(found.channels) if found else {},
        "true_nominal": {t.name: t.value for t in rig.told if t.refitted},
        "noise_std": dict(rig.noise), "noise_floor": dict(rig.noise), "log": asdict(log),
        "mismatch": profile(found.left, at[:2], offsets[:2]) if found else [],
    }  # fmt: skip
    return key | {"concealment": concealment(key, found)}
