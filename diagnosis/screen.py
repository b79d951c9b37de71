"""Scores of all hypotheses against one refitted model, without refitting each: where to look, and how sure to be.

Everything is whitened. What the nominal parameters can still absorb is projected out of the residual and of every
probe, so a score is the improvement beyond the refit. p-values are familywise: the distribution of the best score of
all probes under noise alone, drawn from the Gram matrix of the probes.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from diagnosis.hypotheses import Hypothesis
from diagnosis.likelihood import Judged
from diagnosis.model import Block, Model, Whitener, learn_whitener
from diagnosis.refit import STEP

DRAWS = 2000


@dataclass(frozen=True)
class Score:
    """One probe of one hypothesis.

    gain          | fall of the whitened sum of squares, to first order
    amount        | best multiple of the probe's directions
    absorbability | degrees between the probe and what the nominal parameters can do: 0 is absorbed wholly
    """

    hypothesis: Hypothesis
    probe: int
    gain: float
    amount: tuple[float, ...]
    absorbability: float
    visible: float
    """multiple of the probe at which it would stand out by 3.6 standard deviations"""
    as_is: float = 0.0
    """gain of the probe at the size that was probed, its directions together"""


@dataclass(frozen=True)
class Screening:
    """All scores, the best of each hypothesis, and how surprising the best is among noise."""

    scores: tuple[Score, ...]
    best: dict[str, Score]
    p_value: float
    threshold: float
    """gain that noise alone exceeds in 5 % of recordings"""
    cosines: np.ndarray
    """between the best probes of all hypotheses, in the order of ``best`` [hypotheses, hypotheses]"""
    whitener: Whitener
    """the noise under which all this holds"""
    cost: float
    """whitened sum of squares of the residual under it"""

    def class_of(self, name: str, cosine: float = 0.97) -> tuple[str, ...]:
        """Other hypotheses whose best probe cannot be told from this one's."""
        names = list(self.best)
        row = self.cosines[names.index(name)]
        return tuple(n for n, c in zip(names, row, strict=True) if n != name and c >= cosine)


def screen(
    model: Model,
    base: Judged,
    hypotheses: Sequence[Hypothesis],
    rng: np.random.Generator,
    whitener: Whitener | None = None,
) -> Screening:
    """Score every probe around the refit ``base``. ``hypotheses`` must not be empty.

    whitener: the noise, where it is known; else it is learnt from what all probes together cannot explain.
    """
    values = np.array([base.fit.values[p.name] for p in model.parameters])
    names = [p.name for p in model.parameters]
    columns, owners = [values], []
    for index, hypothesis in enumerate(hypotheses):
        for k, probe in enumerate(hypothesis.probes):
            for direction in probe:
                column = values.copy()
                for name, value in direction.items():
                    column[names.index(name)] = value
                columns.append(column)
                owners.append((index, k))
    for name in base.fit.free:
        row = names.index(name)
        column = values.copy()
        column[row] = model.parameters[row].clip(
            values[row] + STEP * max(abs(values[row]), model.parameters[row].scale)
        )
        columns.append(column)
    changes = [p[:, 1:] - p[:, :1] for p in model.predict(np.stack(columns, axis=1))]
    whitener = whitener or _without_the_explained(model.blocks, base.raw, changes)
    change = whitener.flat(model.blocks, changes)
    change[:, ~np.isfinite(change).all(axis=0)] = 0.0
    span = basis(change[:, len(owners) :])
    white = whitener.flat(model.blocks, base.raw)
    residual = white - span @ (span.T @ white)
    change = change[:, : len(owners)]
    left = change - span @ (span.T @ change)
    scores, units = [], []
    for index, k in dict.fromkeys(owners):
        mine = [j for j, owner in enumerate(owners) if owner == (index, k)]
        score, unit = _score(hypotheses[index], k, residual, change[:, mine], left[:, mine])
        scores.append(score)
        units.append(unit)
    best: dict[str, Score] = {}
    for score in scores:
        if score.hypothesis.name not in best or score.gain > best[score.hypothesis.name].gain:
            best[score.hypothesis.name] = score
    places = {(score.hypothesis.name, score.probe): k for k, score in enumerate(scores)}
    first = [units[places[score.hypothesis.name, score.probe]][:, 0] for score in best.values()]
    cosines = np.abs(np.stack(first, axis=1).T @ np.stack(first, axis=1))
    draws = _largest(units, rng)
    top = max(score.gain for score in scores)
    return Screening(
        tuple(scores), best, _tail(draws, top), float(np.quantile(draws, 0.95)), cosines, whitener, float(white @ white)
    )  # fmt: skip


def _without_the_explained(
    blocks: Sequence[Block], raw: Sequence[np.ndarray], changes: Sequence[np.ndarray]
) -> Whitener:
    """The noise of what all probes together cannot explain.

    Learnt from the residual itself it would have the mismatch as its colour: a constant bias as an endless memory.
    """
    plain = learn_whitener(blocks, raw, 0)
    columns = plain.flat(blocks, changes)
    size = np.linalg.norm(columns, axis=0)
    use = np.isfinite(size) & (size > 0.0)
    found = np.zeros(len(size))
    if np.any(use):
        scaled = columns[:, use] / size[use]
        found[use] = np.linalg.lstsq(scaled, plain.flat(blocks, raw), rcond=1e-8)[0] / size[use]
    return learn_whitener(blocks, [r - c[:, use] @ found[use] for r, c in zip(raw, changes, strict=True)])


def basis(jacobian: np.ndarray) -> np.ndarray:
    """Orthonormal basis [samples, rank] of the columns that are not zero."""
    size = np.linalg.norm(jacobian, axis=0)
    scaled = jacobian[:, size > 0.0] / size[size > 0.0]
    u, s, _ = np.linalg.svd(scaled, full_matrices=False)
    return u[:, s > 1e-8 * max(float(s.max(initial=0.0)), 1e-300)]


def _score(hypothesis, k, residual, change, left) -> tuple[Score, np.ndarray]:
    size, rest = np.linalg.norm(change), np.linalg.norm(left)
    angle = float(np.degrees(np.arcsin(min(rest / size, 1.0)))) if size > 0.0 else 0.0
    if size == 0.0 or rest < 1e-6 * size:
        return Score(hypothesis, k, 0.0, (0.0,) * change.shape[1], angle, np.inf), np.zeros_like(left)
    u, s, vt = np.linalg.svd(left, full_matrices=False)
    sound = s > 1e-6 * s[0]
    parts = np.where(sound, u.T @ residual, 0.0)
    amount = vt.T @ np.where(sound, parts / np.where(sound, s, 1.0), 0.0)
    whole = left.sum(axis=1)
    as_is = float(2.0 * (whole @ residual) - whole @ whole)
    return Score(hypothesis, k, float(parts @ parts), tuple(amount), angle, 3.6 / float(s[0]), as_is), u * sound


def _largest(units: Sequence[np.ndarray], rng: np.random.Generator) -> np.ndarray:
    """Best gain of all probes in each of `DRAWS` recordings of noise alone."""
    stacked = np.concatenate(units, axis=1)
    values, vectors = np.linalg.eigh(stacked.T @ stacked)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    parts = (root @ rng.standard_normal((root.shape[1], DRAWS))) ** 2
    edges = np.cumsum([0, *(unit.shape[1] for unit in units)])
    return np.max([parts[a:b].sum(axis=0) for a, b in pairwise(edges)], axis=0)


def _tail(draws: np.ndarray, value: float) -> float:
    """Share of draws at ``value`` or above; beyond them the tail goes on as that of a chi-square does, exp(-x / 2)."""
    count = int(np.sum(draws >= value))
    if count >= 10:
        return (count + 1.0) / (len(draws) + 1.0)
    tenth = float(np.sort(draws)[-10])
    return float(10.0 / len(draws) * np.exp(-0.5 * (value - tenth)))
