"""Which probes of an effect that lies along the position are worth a replay: those that the residual has most of.

A wave, and what begins at a place, are seen in the residual along the recorded position itself, more or less turned
and damped. Looking there costs no replay. What begins at a place is what a spring and friction everywhere are not.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from cable_envs.diagnosis.fit.likelihood import Judged
from cable_envs.diagnosis.model.hypotheses import WAVES as ALL_WAVES
from cable_envs.diagnosis.model.hypotheses import Hypothesis
from cable_envs.diagnosis.model.model import Block, Model

WAVES = 10
"""Periods of a wave along the position that are probed, of all those that `diagnosis.model.hypotheses` has."""
SIDES = 3
"""Sides of places that are probed, of all those that it has."""
Probe = tuple[Mapping[str, float], ...]


def promising(model: Model, base: Judged, hypothesis: Hypothesis) -> Sequence[Probe]:
    """The probes of a hypothesis that are worth a replay.

    Parameters
    ----------
    model : Model
        The records to fit.
    base : Judged
        The refit around which effects are looked for.
    hypothesis : Hypothesis
        Any.

    Returns
    -------
    sequence of tuple of Mapping
        All of its probes, in their order; of many along the position those of which the residual has most.
    """
    probes = hypothesis.probes
    alike = _alike(hypothesis)
    most = WAVES if hypothesis.wave else SIDES
    if not alike or len(set(alike)) <= most:
        return probes
    powers = dict.fromkeys(alike, 0.0)
    for block, left in zip(model.blocks, base.raw, strict=True):
        place = next((c.values for c in block.along if c.name == "position"), None)
        if place is None or np.ptp(place[block.good]) == 0.0:
            return probes
        white = base.whitener.flat([block], [left])
        even = np.empty((len(white), 0)) if hypothesis.wave else base.whitener.flat([block], [_everywhere(place)])
        for key in powers:
            columns = _wave(block, place, key) if hypothesis.wave else _beyond(place, key)
            basis, _ = np.linalg.qr(np.column_stack([even, base.whitener.flat([block], [columns])]))
            powers[key] += float(np.sum((basis[:, even.shape[1] :].T @ white) ** 2))
    kept = sorted(powers, key=lambda key: -powers[key])[:most]
    return [probe for probe, key in zip(probes, alike, strict=True) if key in kept]


def _alike(hypothesis: Hypothesis) -> list[tuple[float, ...]]:
    """What each probe looks like along the position: (waves over the travel,), or (place, side); empty: nothing."""
    probes = hypothesis.probes
    if hypothesis.wave:
        period, _ = hypothesis.wave
        if not all(len(p) == 2 and period in p[0] for p in probes):
            return []
        longest = max(p[0][period] for p in probes)
        return [(ALL_WAVES[0] * longest / p[0][period],) for p in probes]
    if hypothesis.place:
        sides = [sum(p[0][n] - null for n, null in hypothesis.nulls.items() if n in p[0]) for p in probes]
        return [(p[0][hypothesis.place], float(np.sign(side))) for p, side in zip(probes, sides, strict=True)]
    return []


def _wave(block: Block, place: np.ndarray, key: tuple[float, ...]) -> np.ndarray:
    """Sine and cosine [T, 2] of a number of waves over the travel."""
    (waves,) = key
    way = (place - np.min(place[block.good])) / np.ptp(place[block.good])
    return np.column_stack([np.sin(2.0 * np.pi * waves * way), np.cos(2.0 * np.pi * waves * way)])


def _everywhere(place: np.ndarray) -> np.ndarray:
    """What a constant, a spring, viscous and dry friction are along all of the position [T, 4]."""
    speed = np.gradient(place)
    return np.column_stack([np.ones_like(place), place, speed, np.sign(speed)])


def _beyond(place: np.ndarray, key: tuple[float, ...]) -> np.ndarray:
    """Depth beyond a place on one side, the same with the direction of motion, and with the speed [T, 3]."""
    at, side = key
    depth = np.maximum(side * (place - at), 0.0)
    speed = np.gradient(place)
    return np.column_stack([depth, depth * np.sign(speed), depth * speed])
