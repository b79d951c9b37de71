"""Generator A with logs as rigs make them: the same rigs and effects, recorded by loggers that are not perfect.

The recordings of `cable_envs.proof.cases` come from a laboratory: noise that is stated or recorded at rest, a clock that
is nearly even. Here each case has one kind of imperfect log, states no noise and has no record at rest. These cases are
for developing the diagnosis. Generator B judges it and has loggers of its own.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from cable_envs.proof.cases import KEY_SCHEMA, PERIOD, Case, claims, sizes
from cable_envs.proof.effects import AMBIENT, LIBRARY, STRANGE, SYSTEMS, find
from cable_envs.proof.excitation import DESIGNS, reference
from cable_envs.proof.refit import Refit
from cable_envs.proof.rigs import CLOCK, TrueRig, observe, random_rig
from cable_envs.proof.sensors import Colour, quantise, stamps
from cable_envs.proof.writing import concealment, profile, write_recording

ANGLES = ("position", "drive_position", "load_position", "drive_angle", "output_angle")
"""Channels that an encoder counts."""
SPEEDS = {"velocity": "position", "drive_velocity": "drive_position"}
"""Channel that a logger derives from an encoder, and from which."""


@dataclass(frozen=True)
class Log:
    """What a logger does to the channels of one rig; the same in all of its records.

    Parameters
    ----------
    jitter : float
        Standard deviation of the true sampling times about their stamps, as a share of the period.
    fast : float
        Relative error of the logger's clock.
    lost : float
        Share of rows that are lost one by one.
    resampled : float
        Period of the clock on which samples were taken before straight lines brought them to the logger's, s; 0: none.
    counts : mapping of str to float
        Channel -> step of its encoder, SI.
    filtered : mapping of str to float
        Channel -> time constant of the filter behind its derivative, s.
    hum : mapping of str to tuple
        Channel -> (frequency, Hz, amplitude over the noise's standard deviation) of a line and half as much of its
        third harmonic.
    colours : mapping of str to Colour
        Of each channel's noise.
    gain : float
        Share of a channel's noise that grows with the size of its signal.
    walk : mapping of str to float
        Channel -> standard deviation, over that of the noise, that its zero has walked after 27 s.
    outliers : float
        Share of samples that are wrong by 8 to 20 standard deviations of the noise.
    cut : bool
        Whether records begin in the middle of a motion.
    """

    jitter: float = 0.0
    fast: float = 0.0
    lost: float = 0.0
    resampled: float = 0.0
    counts: Mapping[str, float] = field(default_factory=dict)
    filtered: Mapping[str, float] = field(default_factory=dict)
    hum: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    colours: Mapping[str, Colour] = field(default_factory=dict)
    gain: float = 0.0
    walk: Mapping[str, float] = field(default_factory=dict)
    outliers: float = 0.0
    cut: bool = False


Maker = Callable[[TrueRig, np.random.Generator], dict[str, Any]]


def _some(rig: TrueRig, rng: np.random.Generator, share: float = 0.5) -> list[str]:
    names = [name for name in rig.noise if rng.random() < share]
    return names or [str(rng.choice(list(rig.noise)))]


def _counts(rig: TrueRig, rng: np.random.Generator) -> dict[str, Any]:
    return {"counts": {n: std * rng.uniform(2.0, 8.0) for n, std in rig.noise.items() if n in ANGLES}}


def _filtered(rig: TrueRig, rng: np.random.Generator) -> dict[str, Any]:
    return {"filtered": {n: rng.uniform(0.005, 0.03) for n in rig.noise if n in SPEEDS}} | _counts(rig, rng)


def _hum(rig: TrueRig, rng: np.random.Generator) -> dict[str, Any]:
    line = rng.uniform(3.0, 12.0)
    return {"hum": {n: (line, rng.uniform(0.3, 1.0)) for n in _some(rig, rng)}}


def _colour(rig: TrueRig, rng: np.random.Generator) -> dict[str, Any]:
    kinds = [str(rng.choice(["ar1", "flicker"])) for _ in rig.noise]
    rho = [rng.uniform(0.8, 0.97) if k == "ar1" else 0.0 for k in kinds]
    return {"colours": {n: Colour(k, float(r)) for n, k, r in zip(rig.noise, kinds, rho, strict=True)}}


def _walk(rig: TrueRig, rng: np.random.Generator) -> dict[str, Any]:
    return {"walk": {n: rng.uniform(0.3, 1.5) for n in _some(rig, rng)}}


def _everything(rig: TrueRig, rng: np.random.Generator) -> dict[str, Any]:
    return {
        "jitter": rng.uniform(0.002, 0.02), "fast": rng.normal(0.0, 2e-4), "lost": 0.003,
        **_colour(rig, rng), **_counts(rig, rng), **_hum(rig, rng),
    }  # fmt: skip


KINDS: Mapping[str, Maker] = {
    "white, unstated": lambda rig, rng: {},
    "jitter": lambda rig, rng: {"jitter": rng.uniform(0.002, 0.02)},
    "wrong clock": lambda rig, rng: {"fast": rng.choice([-1.0, 1.0]) * rng.uniform(2e-4, 2e-3)},
    "lost rows": lambda rig, rng: {"lost": rng.uniform(0.002, 0.02)},
    "resampled": lambda rig, rng: {"resampled": PERIOD * rng.uniform(0.6, 1.4)},
    "counts": _counts,
    "filtered speed": _filtered,
    "hum": _hum,
    "colour": _colour,
    "gain": lambda rig, rng: {"gain": rng.uniform(0.5, 0.9)},
    "walking zero": _walk,
    "outliers": lambda rig, rng: {"outliers": rng.uniform(0.001, 0.005)},
    "starts in motion": lambda rig, rng: {"cut": True},
    "everything": _everything,
}
"""Kind of a log -> what it draws for `Log`."""


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
                {"kind": kind, "noise": noise, "system": system, "effects": (str(name),), "band": (">10", "3-10")[k % 2]}
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
        tables.append(_logged(rig, log, changes, motion, times, offset, rng))
    write_recording(folder, rig, claims(case, rig, rng), tables, False)
    key = {
        "schema": KEY_SCHEMA, "case": asdict(case), "effects": entries, "ambient": list(AMBIENT[case.system]),
        "added": found.added if found else 0.0, "absorbed": found.absorbed if found else 0.0,
        "excess_by_channel": dict(found.channels) if found else {},
        "true_nominal": {t.name: t.value for t in rig.told if t.refitted},
        "noise_std": dict(rig.noise), "noise_floor": dict(rig.noise), "log": _said(log),
        "mismatch": profile(found.left, at[:2], offsets[:2]) if found else [],
    }  # fmt: skip
    return key | {"concealment": concealment(key, found)}


def _said(log: Log) -> dict[str, Any]:
    return asdict(log)


def _logged(
    rig: TrueRig, log: Log, changes: Mapping[str, float], motion: np.ndarray, times: np.ndarray, offset: float,
    rng: np.random.Generator,
) -> dict[str, np.ndarray]:  # fmt: skip
    """Columns of one file, SI."""
    taken = times + PERIOD * log.jitter * rng.standard_normal(len(times))
    if log.resampled:
        taken = np.arange(times[0], times[-1] + log.resampled, log.resampled)
    clean = observe(rig, changes, motion, taken)
    if log.jitter:  # a command is what is in force, whenever it is read
        clean |= {name: values for name, values in observe(rig, changes, motion, times).items() if name in rig.given}
    table = {name: _sensed(rig, log, name, clean, taken, rng) for name in clean}
    if log.resampled:
        table = {name: np.interp(times, taken, values) for name, values in table.items()}
    keep = rng.random(len(times)) >= log.lost
    keep[[0, -1]] = True
    begin = times[0]
    stamped = np.round((times - begin) * (1.0 + log.fast) + offset, 6)
    return {"time": stamped[keep], **{name: values[keep] for name, values in table.items()}}


def _sensed(
    rig: TrueRig, log: Log, name: str, clean: Mapping[str, np.ndarray], taken: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    """One channel of one record as the logger has it."""
    values = clean[name]
    if name not in rig.noise:
        return values  # a command
    if name in log.filtered:
        place = clean[SPEEDS[name]]
        place = quantise(place, log.counts[SPEEDS[name]]) if SPEEDS[name] in log.counts else place
        raw, out, share = np.gradient(place, taken), np.empty(len(place)), 0.0
        share = 1.0 - np.exp(-PERIOD / log.filtered[name])
        state = raw[0]
        for k, value in enumerate(raw):
            state += share * (value - state)
            out[k] = state
        return out
    std = rig.noise[name]
    noise = log.colours.get(name, Colour("white")).draw(rng, len(values), std)
    if log.gain:
        size = np.abs(values - np.mean(values))
        noise = noise * (1.0 - log.gain + log.gain * size / max(float(np.mean(size)), 1e-300))
    if name in log.walk:
        noise += np.cumsum(rng.standard_normal(len(values))) * std * log.walk[name] / np.sqrt(27.0 / PERIOD)
    if name in log.hum:
        line, height = log.hum[name]
        turn = 2.0 * np.pi * line * taken
        phase, third = rng.uniform(0.0, 2.0 * np.pi, 2)
        noise += np.sqrt(2.0) * height * std * (np.sin(turn + phase) + 0.5 * np.sin(3.0 * turn + third))
    if log.outliers:
        wrong = rng.random(len(values)) < log.outliers
        noise += wrong * rng.choice([-1.0, 1.0], len(values)) * std * rng.uniform(8.0, 20.0, len(values))
    return quantise(values + noise, log.counts.get(name, 0.5 * std))
