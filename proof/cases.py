"""Cases: a seed makes a recording folder, as an engineer would hand it over, and the key that says what is in it."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cable_envs.proof import effects as library
from cable_envs.proof.effects import AMBIENT, LIBRARY, STRANGE, SYSTEMS, Missing, find
from cable_envs.proof.excitation import DESIGNS, reference
from cable_envs.proof.refit import Refit
from cable_envs.proof.rigs import CLOCK, TrueRig, observe, random_rig
from cable_envs.proof.sensors import Colour, flat, quantise, random_colour, stamps
from cable_envs.proof.writing import concealment, profile, write_recording

KEY_SCHEMA = "cable-proof-key/1"
KINDS = ("single", "pair", "nothing", "decoy", "strange")
BANDS: Mapping[str, tuple[float, float]] = {"1-3": (0.01, 0.03), "3-10": (0.03, 0.10), ">10": (0.10, 0.6)}
"""Growth of the RMS over the noise after the refit."""
PERIOD = 0.01
AT_REST = 120.0
"""s of a record in which nothing moves, that comes with coloured noise; white noise is stated as a number."""


@dataclass(frozen=True)
class Case:
    """What is to be made.

    Parameters
    ----------
    name : str
        Of its folder; tells nothing.
    seed : int
        Of all that is drawn for it.
    system : str
        One of `cable_envs.proof.effects.SYSTEMS`.
    kind : str
        One of `KINDS`.
    effects : tuple of str
        Names of what is missing from the simulator.
    band : str
        One of `BANDS`: what the effect adds to the RMS; empty without effects.
    noise : str
        One of `cable_envs.proof.sensors.NOISES`.
    """

    name: str
    seed: int
    system: str
    kind: str
    effects: tuple[str, ...] = ()
    band: str = ""
    noise: str = "white"


def plan(systems: Sequence[str] = SYSTEMS, per_effect: int = 20, nothing: int = 100, seed: int = 5) -> list[Case]:
    """All cases of a proof, in an order that tells nothing.

    Parameters
    ----------
    systems : sequence of str
        On which.
    per_effect : int
        Recordings of each effect and system, over the bands; pairs and strange effects in proportion.
    nothing : int
        Recordings with nothing wrong in white noise, as many in coloured noise, and as many decoys.
    seed : int
        Of the plan.

    Returns
    -------
    list of Case
        With names, and seeds of their own.
    """
    rng = np.random.default_rng([seed, 1])
    wanted: list[dict[str, Any]] = []
    bands = tuple(BANDS)
    for system in systems:
        names = [e.name for e in LIBRARY[system]]
        for name in names:
            wanted += [
                {"system": system, "kind": "single", "effects": (name,), "band": bands[(k + len(name)) % 3]}
                for k in range(per_effect)
            ]
        for _ in range(max(per_effect, 1) if per_effect else 0):
            first, second = rng.choice(names, 2, replace=False)
            while library.share_class(first, second) or second in _bars(system, first):
                first, second = rng.choice(names, 2, replace=False)
            wanted.append({"system": system, "kind": "pair", "effects": (str(first), str(second)), "band": ">10"})
        for k, strange in enumerate(STRANGE[system]):
            count = max(per_effect // 3, 1) if per_effect else 0
            wanted += [
                {"system": system, "kind": "strange", "effects": (strange.name,), "band": bands[1 + (j + k) % 2]}
                for j in range(count)
            ]
    for k in range(nothing):
        system = systems[k % len(systems)]
        wanted.append({"system": system, "kind": "nothing", "noise": "white"})
        wanted.append({"system": system, "kind": "nothing", "noise": ("ar1", "flicker")[k % 2]})
        wanted.append({"system": system, "kind": "decoy"})
    seeds = rng.integers(2**31, size=len(wanted))
    for entry, own in zip(wanted, seeds, strict=True):
        if "noise" not in entry:
            entry["noise"] = ("white", "white", "ar1", "flicker")[int(own) % 4]
    order = rng.permutation(len(wanted))
    return [Case(f"case-{n:04d}", int(seeds[i]), **wanted[i]) for n, i in enumerate(order, 1)]


def _bars(system: str, first: str) -> tuple[str, ...]:
    """Effects that leave no room for another: the second would act on what the first has taken out."""
    pairs = {
        "coulomb_friction": ("friction_drift", "presliding_hysteresis"),
        "cable_elongation": ("backlash", "stiffness_hardening", "viscoelastic_creep"),
    }
    return pairs.get(first, ()) + tuple(a for a, others in pairs.items() if first in others)


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
        The key, schema "cable-proof-key/1": effects with their true parameters, what they add, where they act.
    """
    rng = np.random.default_rng([case.seed, 7])
    missing = tuple(find(case.system, name) for name in case.effects)
    rig = random_rig(case.system, rng, missing)
    lengths = rng.uniform(22.0, 32.0, 3)
    designs = rng.permutation(DESIGNS)[:3]
    references, at, first = [], [], 0.0
    offsets = []
    for seconds, design in zip(lengths, designs, strict=True):
        motion = reference(str(design), rng, seconds, rig.amplitude, CLOCK)
        references.append(rig.centre + motion)
        at.append(stamps(rng, 0.0, seconds, PERIOD, 0.02))
        offsets.append(first)
        first += float(np.ceil(seconds)) + 60.0  # the rig rests, and the logger's clock runs on
    refit = Refit(rig, references[:2], at[:2])
    changes, entries = sizes(case, missing, refit, rng)
    found = refit.excess(changes) if changes else None
    claimed = claims(case, rig, rng)
    colours = {channel: random_colour(case.noise, rng) for channel in rig.noise}

    def seen(channel: int, series: np.ndarray) -> np.ndarray:
        return flat(colours[rig.scored[channel]], series)

    clean = [observe(rig, changes, motion, times) for motion, times in zip(references, at, strict=True)]
    tables = [
        _sensed(rig, colours, c, times + offset, rng) for c, times, offset in zip(clean, at, offsets, strict=True)
    ]
    floor = {c: float(np.sqrt(np.mean((tables[-1][c] - clean[-1][c]) ** 2))) for c in rig.noise}
    if case.noise != "white":
        tables.append(_at_rest(rig, colours, references[0][0], first, rng))
    write_recording(folder, rig, claimed, tables, case.noise == "white")
    key = {
        "schema": KEY_SCHEMA,
        "case": asdict(case),
        "effects": entries,
        "ambient": list(AMBIENT[case.system]),
        "added": found.added if found else 0.0,
        "absorbed": found.absorbed if found else 0.0,
        "stands_out": refit.gain(found.left, seen) if found else 0.0,
        "excess_by_channel": dict(found.channels) if found else {},
        "true_nominal": {t.name: t.value for t in rig.told if t.refitted},
        "noise_std": dict(rig.noise),
        "noise_floor": floor,
        "mismatch": profile(found.left, at[:2], offsets[:2]) if found else [],
    }
    return key | {"concealment": concealment(key, found)}


def sizes(
    case: Case, missing: Sequence[Missing], refit: Refit, rng: np.random.Generator
) -> tuple[dict[str, float], list[dict[str, Any]]]:
    """(changes of the simulator, entries of the key)."""
    changes: dict[str, float] = {}
    entries = []
    for effect in missing:
        shape, sign = effect.draw(rng)
        low, high = BANDS[case.band]
        wanted = float(np.exp(rng.uniform(np.log(low * 1.1), np.log(high * 0.9))))

        def change(size: float, effect=effect, shape=shape, sign=sign) -> dict[str, float]:
            return {**shape, **{name: sign * size * unit for name, unit in effect.sized.items()}}

        size, left = refit.sized(change, wanted, effect.largest)
        own = change(size)
        changes.update(own)
        parameters = {
            name: {"value": sum(there) + _as_named(effect, source, factor * own[source]), "unit": unit}
            for name, (source, factor, unit, *there) in effect.comparable(shape).items()
        }
        entries.append({
            "name": effect.name, "parameters": parameters, "changes": own, "added": left.added, "wanted": wanted,
            "absorbed": left.absorbed, "channel": next((k.split(":")[1] for k in effect.sized if ":" in k), None),
        })  # fmt: skip
    return changes, entries


def _as_named(effect: Missing, source: str, value: float) -> float:
    """A scale is a factor in verdicts."""
    return 1.0 + value if source.startswith("scale:") else value


def claims(case: Case, rig: TrueRig, rng: np.random.Generator) -> dict[str, tuple[float, float | None, str]]:
    """name -> (value, std or None for known ones, unit) as the recording has them; a decoy's are off by more."""
    claimed: dict[str, tuple[float, float | None, str]] = {}
    for told in rig.told:
        if not told.refitted:
            claimed[told.name] = (told.value, None, told.unit)
            continue
        spread = rng.uniform(0.07, 0.12) if case.kind == "decoy" else rng.uniform(0.01, 0.06)
        wrong = 1.0 + spread * rng.choice([-1.0, 1.0])
        claimed[told.name] = (told.value * wrong, 0.12 * told.value, told.unit)
    return claimed


def _at_rest(
    rig: TrueRig, colours: Mapping[str, Colour], place: float, offset: float, rng: np.random.Generator
) -> dict[str, np.ndarray]:  # fmt: skip
    """Columns of a file of the rig that stands at ``place``, with nothing missing, and nothing about it moves."""
    at = stamps(rng, 0.0, AT_REST, PERIOD, 0.02)
    still = observe(rig, {}, np.full(round(1.0 / CLOCK), place), np.array([0.5]))
    return _sensed(rig, colours, {c: np.full(len(at), v[0]) for c, v in still.items()}, at + offset, rng)


def _sensed(
    rig: TrueRig, colours: Mapping[str, Colour], clean: Mapping[str, np.ndarray], time: np.ndarray,
    rng: np.random.Generator,
) -> dict[str, np.ndarray]:  # fmt: skip
    """Columns of one file, SI: quantised and noisy, commands as they were given."""
    table = {"time": np.round(time, 6)}
    for name, values in clean.items():
        if name in rig.noise:
            std = rig.noise[name]
            values = quantise(values + colours[name].draw(rng, len(values), std), 0.5 * std)
        table[name] = values
    return table
