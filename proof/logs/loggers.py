"""What loggers do to the channels of a rig, kind by kind."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from cable_envs.proof.cases import PERIOD
from cable_envs.proof.rigs import TrueRig, observe
from cable_envs.proof.sensors import Colour, quantise

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


def logged(
    rig: TrueRig, log: Log, changes: Mapping[str, float], motion: np.ndarray, times: np.ndarray, offset: float,
    rng: np.random.Generator,
) -> dict[str, np.ndarray]:  # fmt: skip
    """Columns of one file as a logger writes it, SI.

    Parameters
    ----------
    rig : TrueRig
        The rig.
    log : Log
        What its logger does.
    changes : mapping of str to float
        Of the simulator's parameters, and faults of sensors (`cable_envs.proof.rigs.observe`).
    motion : ndarray
        What the drive is told, at every tick of the simulator's clock.
    times : ndarray, shape (T,)
        When the logger means to take its samples, s since the record's start.
    offset : float
        Of its clock, s.
    rng : numpy.random.Generator
        Of its noise.

    Returns
    -------
    dict of str to ndarray
        "time" and the channels.
    """
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
