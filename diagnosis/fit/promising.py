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
BEST = 2
"""Places that are probed, of all those that it has."""
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
    most = WAVES if hypothesis.wave else BEST
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


def _alike(hypothesis: Hypothesis) -> list[float]:
    """What each probe looks like along the position: its number of waves over the travel, or its place; empty: nothing.

    What is met above a place and what is met below it differ by a spring or friction that is everywhere.
    """
    probes = hypothesis.probes
    if hypothesis.wave:
        period, _ = hypothesis.wave
        if not all(len(p) == 2 and period in p[0] for p in probes):
            return []
        longest = max(p[0][period] for p in probes)
        return [ALL_WAVES[0] * longest / p[0][period] for p in probes]
    return [p[0][hypothesis.place] for p in probes] if hypothesis.place else []


def _wave(block: Block, place: np.ndarray, waves: float) -> np.ndarray:
    """Sine and cosine [T, 2] of a number of waves over the travel."""
    way = (place - np.min(place[block.good])) / np.ptp(place[block.good])
    return np.column_stack([np.sin(2.0 * np.pi * waves * way), np.cos(2.0 * np.pi * waves * way)])


def _everywhere(place: np.ndarray) -> np.ndarray:
    """What a constant and a spring, viscous and dry friction, even or growing, are along all of the position [T, 6]."""
    speed = np.gradient(place)
    terms = (np.ones_like(place), speed, np.sign(speed))
    return np.column_stack([*terms, *(place * one for one in terms)])


def _beyond(place: np.ndarray, at: float) -> np.ndarray:
    """Depth beyond a place, the same with the direction of motion, and with the speed [T, 3]."""
    depth, speed = np.maximum(place - at, 0.0), np.gradient(place)
    return np.column_stack([depth, depth * np.sign(speed), depth * speed])
