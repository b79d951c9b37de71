"""Cases of generator B: a seed makes a recording folder, as a logger wrote it, and the key that says what is in it."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from cable_envs.proof.cases import AT_REST, KEY_SCHEMA, Case, sizes
from cable_envs.proof.effects import AMBIENT, SYSTEMS, share_class
from cable_envs.proof.family_b.effects import LIBRARY, STRANGE, find
from cable_envs.proof.family_b.excitation import DESIGNS, reference
from cable_envs.proof.family_b.logger import KINDS, STATED, Logger, random_logger, table_of
from cable_envs.proof.family_b.odds import Spectrum, against_rivals
from cable_envs.proof.family_b.rigs import DIFFERENCES, random_rig
from cable_envs.proof.refit import Excess, Refit
from cable_envs.proof.rigs import CLOCK, TrueRig, observe
from cable_envs.proof.sensors import flat
from cable_envs.proof.writing import concealment, profile, write_recording

FAMILY = "B"
DIGITS = 10
"""Of the numbers in the tables: a clock of minutes in microseconds."""
PER_EFFECT = 8
"""Recordings of each effect on a system in a whole proof, half of them logs of users."""
PACE = {"linear_drive": 2.0, "cable_hole": 1.0, "pulley_circuit": 1.0}
"""How quick motions are; a belt shows where it is accelerated."""
ALONE = tuple(kind for kind in KINDS if kind not in ("white", "rest", "user"))
"""Kinds of logs with one fault each."""


def plan(systems: Sequence[str] = SYSTEMS, scale: float = 1.0, seed: int = 1) -> list[Case]:
    """All cases of a proof by generator B, in an order that tells nothing.

    Parameters
    ----------
    systems : sequence of str
        On which.
    scale : float
        1 gives about a thousand cases on all three systems, smaller numbers a sample in proportion.
    seed : int
        Of the plan.

    Returns
    -------
    list of Case
        With names, and seeds of their own. ``noise`` is the kind of the log.
    """
    rng = np.random.default_rng([seed, 2])
    wanted: list[dict[str, Any]] = []

    for system in systems:
        wanted += _singles(rng, system, scale) + _others(rng, system, scale)
    seeds, order = rng.integers(2**31, size=len(wanted)), rng.permutation(len(wanted))
    return [Case(f"case-{n:04d}", int(seeds[i]), **wanted[i]) for n, i in enumerate(order, 1)]


def _times(rng: np.random.Generator, count: float, **entry: Any) -> list[dict[str, Any]]:
    """The entry ``count`` times, a fraction by chance."""
    whole = int(count)
    return [dict(entry) for _ in range(whole + int(rng.random() < count - whole))]


def _singles(rng: np.random.Generator, system: str, scale: float) -> list[dict[str, Any]]:
    """Every effect of a system: four times in perfect logs, four times in logs of users; some in each single fault."""
    found = []
    names = [effect.name for effect in LIBRARY[system]]
    for name in names:
        for noise, share in (("white", 1.0), ("rest", 1.0), ("user", 2.0)):
            for band, count in ((">10", 1.0), ("3-10", 0.5), ("1-3", 0.5)):
                entry = {"system": system, "kind": "single", "effects": (name,), "band": band, "noise": noise}
                found += _times(rng, share * count * scale, **entry)
    for noise in _faults(system):
        name = str(rng.choice(names))
        found += _times(rng, scale, system=system, kind="single", effects=(name,), band=">10", noise=noise)
    return found


_COUNTS = (("white", 7.0, 1.5, 14.0), ("rest", 7.0, 1.5, 14.0), ("user", 13.0, 3.0, 20.0))
"""Kind of the log, pairs, cases of each physics of no library, and cases with nothing wrong, on a system."""


def _others(rng: np.random.Generator, system: str, scale: float) -> list[dict[str, Any]]:
    """Pairs, physics of no library, nothing wrong in every kind of log, and parameters that are far off."""
    found = []
    for noise, pairs, strange, nothing in _COUNTS:
        same = _times(rng, pairs * scale, system=system, kind="pair", band=">10", noise=noise)
        found += [{**entry, "effects": _pair(rng, system)} for entry in same]
        for effect in STRANGE[system]:
            entry = {"system": system, "kind": "strange", "effects": (effect.name,), "band": ">10", "noise": noise}
            found += _times(rng, strange * scale, **entry)
        found += _times(rng, nothing * scale, system=system, kind="nothing", noise=noise)
        found += _times(rng, 4.0 * scale, system=system, kind="decoy", noise=noise)
    for noise in _faults(system):
        found += _times(rng, 4.0 * scale, system=system, kind="nothing", noise=noise)
    return found


def _faults(system: str) -> tuple[str, ...]:
    """Kinds of logs with a single fault that a system can have."""
    return tuple(kind for kind in ALONE if kind != "filtered" or DIFFERENCES[system])


_NO_ROOM = {
    "coulomb_friction": ("friction_drift", "presliding_hysteresis"),
    "cable_elongation": ("backlash", "stiffness_hardening", "viscoelastic_creep"),
}
"""Effects that leave no room for another: the second would act on what the first has taken out."""


def _pair(rng: np.random.Generator, system: str) -> tuple[str, str]:
    names = [effect.name for effect in LIBRARY[system]]
    while True:
        first, second = (str(name) for name in rng.choice(names, 2, replace=False))
        barred = second in _NO_ROOM.get(first, ()) or first in _NO_ROOM.get(second, ())
        if not share_class(first, second) and not barred:
            return first, second


@dataclass(frozen=True)
class _Drawn:
    """Everything that a case's seed decides but the noise."""

    rig: TrueRig
    logger: Logger
    references: list[np.ndarray]
    at: list[np.ndarray]
    offsets: np.ndarray
    refit: Refit
    changes: dict[str, float]
    entries: list[dict[str, Any]]
    found: Excess | None
    rng: np.random.Generator

    def seen(self, channel: int, series: np.ndarray) -> np.ndarray:
        """Series of a channel, whitened by its noise."""
        noise = self.logger.noise[self.rig.scored[channel]]
        return flat(Spectrum(noise, self.logger.period), series)


def _drawn(case: Case) -> _Drawn:
    rng = np.random.default_rng([case.seed, 11])
    missing = tuple(find(case.system, name) for name in case.effects)
    period = float(rng.integers(4, 17)) * CLOCK if case.noise in ("white", "rest") else 0.0
    rig = random_rig(case.system, rng, missing, case.noise, period)
    references, lengths = [], rng.uniform(22.0, 34.0, 3)
    for seconds, design in zip(lengths, rng.permutation(list(DESIGNS))[:3], strict=True):
        references.append(rig.centre + reference(str(design), rng, seconds, rig.amplitude, CLOCK, PACE[case.system]))
    logger = random_logger(case.noise, rng, rig.noise)
    logger = replace(logger, period=period) if period else logger
    at = [logger.instants(rng, seconds) for seconds in lengths]
    offsets = np.concatenate([[0.0], np.cumsum(np.ceil(lengths) + 60.0)])
    refit = Refit(rig, references[:2], at[:2])
    changes, entries = sizes(case, missing, refit, rng)
    found = refit.excess(changes) if changes else None
    return _Drawn(rig, logger, references, at, offsets, refit, changes, entries, found, rng)


def make(case: Case, folder: Path) -> dict[str, Any]:
    """Write the recording of a case, and say what is in it.

    Parameters
    ----------
    case : Case
        The same case gives the same files and key.
    folder : Path
        Is made; recording.yaml and one table for each record.

    Returns
    -------
    dict
        The key, schema "cable-proof-key/1", as generator A's, with the logger.
    """
    made = _drawn(case)
    rig, logger, found, offsets, rng = made.rig, made.logger, made.found, made.offsets, made.rng
    clean = [observe(rig, made.changes, motion, times) for motion, times in zip(made.references, made.at, strict=True)]
    logged = [
        table_of(logger, rng, times, signals, rig.given, DIFFERENCES[case.system], offset)
        for signals, times, offset in zip(clean, made.at, offsets, strict=False)
    ]
    tables, rows = [columns for columns, _ in logged], logged[-1][1]
    floor = {c: float(np.sqrt(np.mean((tables[-1][c] - clean[-1][c][rows]) ** 2))) for c in rig.noise}
    claimed = _claims(case, rig, rng)
    if case.noise == "rest":
        tables.append(_at_rest(rig, logger, made.references[0][0], float(offsets[-1]), rng))
    more = {"drive_velocity_command": {"hold": "step"}} if rig.values.get("held", 0.0) > 1.5 else {}
    write_recording(folder, rig, claimed, tables, case.noise in STATED, DIGITS, more)
    key = {
        "schema": KEY_SCHEMA,
        "family": FAMILY,
        "case": asdict(case),
        "effects": made.entries,
        "ambient": list(AMBIENT[case.system]),
        "added": found.added if found else 0.0,
        "absorbed": found.absorbed if found else 0.0,
        "stands_out": made.refit.gain(found.left, made.seen) if found else 0.0,
        "excess_by_channel": dict(found.channels) if found else {},
        "true_nominal": {t.name: t.value for t in rig.told if t.refitted},
        "noise_std": dict(rig.noise),
        "noise_floor": floor,
        "logger": _told(logger),
        "mismatch": profile(found.left, made.at[:2], list(offsets[:2])) if found else [],
    }
    return key | {"concealment": concealment(key, found)}


def rivals(case: Case) -> dict[str, float]:
    """Logarithm of the odds for a single concealed effect against every other one (`odds`).

    A minute or two; nothing of a proof needs it but the rows of what a recording can separate.

    Parameters
    ----------
    case : Case
        Of kind "single".

    Returns
    -------
    dict of str to float
        Name of the other effect -> natural logarithm of the odds for the true one, an upper limit.
    """
    made = _drawn(case)
    if case.kind != "single" or made.found is None:
        raise ValueError(f"{case.name} conceals no single effect")
    rng = np.random.default_rng([case.seed, 13])
    return against_rivals(made.refit, case.effects[0], made.found, made.seen, rng)


def _told(logger: Logger) -> dict[str, Any]:
    """A logger for the key: JSON types only."""
    content = asdict(logger)
    content["noise"] = {
        name: {**part, "lines": [list(line) for line in part["lines"]]} for name, part in content["noise"].items()
    }
    return content


def _claims(case: Case, rig: TrueRig, rng: np.random.Generator) -> dict[str, tuple[float, float | None, str]]:
    """name -> (value, std or None for known ones, unit): as wrong as a user's, and more in a decoy."""
    claimed: dict[str, tuple[float, float | None, str]] = {}
    for told in rig.told:
        if not told.refitted:
            claimed[told.name] = (told.value, None, told.unit)
            continue
        off = rng.uniform(0.15, 0.25) * rng.choice([-1.0, 1.0]) if case.kind == "decoy" else 0.08 * rng.normal()
        claimed[told.name] = (told.value * float(1.0 + np.clip(off, -0.25, 0.25)), 0.15 * told.value, told.unit)
    return claimed


def _at_rest(
    rig: TrueRig, logger: Logger, place: float, offset: float, rng: np.random.Generator
) -> dict[str, np.ndarray]:  # fmt: skip
    """Columns of a file of the rig that stands at ``place``, with nothing missing, and nothing about it moves."""
    at = logger.instants(rng, AT_REST)
    still = observe(rig, {}, np.full(round(1.0 / CLOCK), place), np.array([0.5]))
    clean = {channel: np.full(len(at), value[0]) for channel, value in still.items()}
    return table_of(logger, rng, at, clean, rig.given, {}, offset)[0]
