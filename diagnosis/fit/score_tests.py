"""Score tests of all hypotheses against one refitted model, without refitting each: where to look, how sure to be.

Rao's score test (Lagrange multiplier test) asks of a model's residual alone whether a further parameter would help.
Everything is whitened. What the nominal parameters can still absorb is projected out of the residual and of every
probe, so a score is the improvement beyond the refit, and the angle between a probe and what they can do says how
identifiable its effect is. Probes are differences over finite sizes, where Rao's are slopes: a gap has no slope at 0.
p-values are familywise: the distribution of the best score of all probes under noise alone, drawn from the Gram matrix
of the probes (their information matrix).
"""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from cable_envs.diagnosis.fit.likelihood import Judged
from cable_envs.diagnosis.fit.promising import promising
from cable_envs.diagnosis.fit.refit import Fit
from cable_envs.diagnosis.model.hypotheses import Hypothesis
from cable_envs.diagnosis.model.model import Block, Model, Whitener, learn_whitener

DRAWS = 2000
STEP = 1e-3
"""Step of the slopes, from one side, over the parameter's size, or its scale where that is larger."""
ZOOMS = 3
"""Times that a hypothesis is probed nearer to the size that its score suggests."""
NEAR = 0.6
"""Share of a probe's size, or its inverse, between which it is near enough."""
HIDDEN = 30.0
"""Degrees to what the free parameters can do, below which they go along."""
SAME = 1e-6
"""Share of a gain within which another one is the same."""
FAR = 0.1
"""Least share of a probe's size at which it is probed next: beyond that a score says nothing of the size."""


@dataclass(frozen=True)
class Score:
    """The score test of one probe of one hypothesis.

    directions    | the probe: parameters that differ from the model's, one mapping for each direction
    gain          | fall of the whitened sum of squares, to first order
    amount        | best multiple of the probe's directions
    absorbability | degrees between the probe and what the nominal parameters can do: 0 is absorbed wholly, and the
                  | effect is not identifiable
    """

    hypothesis: Hypothesis
    directions: tuple[Mapping[str, float], ...]
    gain: float
    amount: tuple[float, ...]
    absorbability: float
    visible: float
    """multiple of the probe at which it would stand out by 3.6 standard deviations"""
    as_is: float = 0.0
    """gain of the probe at the size that was probed, its directions together"""
    absorbed: Mapping[str, float] = field(default_factory=dict)
    """how far the free parameters go to hide it; of probes of one direction"""


@dataclass(frozen=True)
class ScoreTests:
    """The score tests of all probes, the best of each hypothesis, and the p-value of the best under noise alone."""

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

    def without(self, names: Collection[str]) -> "ScoreTests":
        """The same without some hypotheses, by name."""
        kept = [k for k, name in enumerate(self.best) if name not in names]
        best = {name: score for name, score in self.best.items() if name not in names}
        return replace(self, best=best, cosines=self.cosines[np.ix_(kept, kept)])

    def class_of(self, name: str, cosine: float = 0.97) -> tuple[str, ...]:
        """Other hypotheses whose best probe cannot be told from this one's."""
        names = list(self.best)
        row = self.cosines[names.index(name)]
        return tuple(n for n, c in zip(names, row, strict=True) if n != name and c >= cosine)


def score_tests(
    model: Model,
    base: Judged,
    hypotheses: Sequence[Hypothesis],
    rng: np.random.Generator,
    whitener: Whitener | None = None,
) -> ScoreTests:
    """Score every probe around a refit.

    Where a probe at a finite size is far from the size that its score suggests, it is probed again nearer to that
    (`ZOOMS` times): most effects do not grow in proportion.

    Parameters
    ----------
    model : Model
        The records to fit.
    base : Judged
        The refit around which effects are looked for.
    hypotheses : sequence of Hypothesis
        At least one.
    rng : numpy.random.Generator
        Draws the recordings of noise alone, for the p-value.
    whitener : Whitener, optional
        The noise, where it is known; else it is learnt from what all probes together cannot explain.

    Returns
    -------
    ScoreTests
        Scores in the order of the probes.
    """
    probing = _Probing(model, base)
    probes = [(h, probe) for h in hypotheses for probe in promising(model, base, h)]
    changes = probing.changes([d for _, probe in probes for d in probe])
    free, steps = probing.slopes()
    both = [np.concatenate(pair, axis=1) for pair in zip(changes, free, strict=True)]
    whitener = whitener or _without_the_explained(model.blocks, base.raw, both)
    slopes = _flat(whitener, model, free)
    span = basis(slopes)
    white = whitener.flat(model.blocks, base.raw)
    residual = white - span @ (span.T @ white)
    scores, units = _scores(probes, residual, _flat(whitener, model, changes), span, slopes, steps)
    for _ in range(ZOOMS):
        of = [(h, [s for s in scores if s.hypothesis is h]) for h in hypotheses]
        probes = [(h, probe) for h, own in of if (probe := _nearer(model, base.fit, own))]
        if not probes:
            break
        changes = probing.changes([d for _, probe in probes for d in probe])
        more, their = _scores(probes, residual, _flat(whitener, model, changes), span, slopes, steps)
        scores, units = scores + more, units + their
    best: dict[str, int] = {}
    for k, score in enumerate(scores):
        name = score.hypothesis.name
        if name not in best or score.gain > scores[best[name]].gain:
            best[name] = k
    first = np.stack([units[k][:, 0] for k in best.values()], axis=1)
    draws = _largest(units, rng)
    top = max(score.gain for score in scores)
    return ScoreTests(
        tuple(scores), {name: scores[k] for name, k in best.items()}, _tail(draws, top),
        float(np.quantile(draws, 0.95)), np.abs(first.T @ first), whitener, float(white @ white),
    )  # fmt: skip


class _Probing:
    """Changes of all predictions with parameters that differ from those of a refit."""

    def __init__(self, model: Model, base: Judged):
        self.model, self._base = model, base
        self._names = [p.name for p in model.parameters]
        self._values = np.array([base.fit.values[name] for name in self._names])
        self._plain = model.predict(self._values[:, None])

    def changes(self, directions: Sequence[Mapping[str, float]]) -> list[np.ndarray]:
        """By block [T, directions]."""
        columns = np.repeat(self._values[:, None], len(directions), axis=1)
        for k, direction in enumerate(directions):
            for name, value in direction.items():
                columns[self._names.index(name), k] = value
        return [p - q for p, q in zip(self.model.predict(columns), self._plain, strict=True)]

    def slopes(self) -> tuple[list[np.ndarray], dict[str, float]]:
        """(the same for a small step of each parameter of the refit, those steps)."""
        values = self._base.fit.values
        free = [p for p in self.model.parameters if p.name in self._base.fit.free]
        moved = {p.name: p.clip(values[p.name] + STEP * max(abs(values[p.name]), p.scale)) for p in free}
        return self.changes([{n: v} for n, v in moved.items()]), {n: v - values[n] for n, v in moved.items()}


def _flat(whitener: Whitener, model: Model, changes: Sequence[np.ndarray]) -> np.ndarray:
    found = whitener.flat(model.blocks, changes)
    found[:, ~np.isfinite(found).all(axis=0)] = 0.0
    return found


def _scores(probes, residual, change, span, slopes, steps) -> tuple[list[Score], list[np.ndarray]]:
    left = change - span @ (span.T @ change)
    size = np.linalg.norm(slopes, axis=0)
    size[size == 0.0] = 1.0
    hiding = -np.linalg.lstsq(slopes / size, change - left, rcond=1e-8)[0] / size[:, None]
    scores, units, first = [], [], 0
    for hypothesis, probe in probes:
        mine = slice(first, first + len(probe))
        first += len(probe)
        score, unit = _score(hypothesis, probe, residual, change[:, mine], left[:, mine])
        if len(probe) == 1:
            by = hiding[:, mine.start]
            score = replace(score, absorbed={n: float(k * h) for (n, h), k in zip(steps.items(), by, strict=True)})
        scores.append(score)
        units.append(unit)
    return scores, units


def _nearer(model: Model, fit: Fit, scores: Sequence[Score]) -> tuple[Mapping[str, float], ...] | None:
    """A probe of the hypothesis at the size that its best score suggests; None where it was near to that.

    The parameters that hide most of it go along: what is left is then seen at its size and not at the first step. Where
    the suggestion is negative and cannot be, or next to nothing, the smallest size was too large by far.
    """
    if scores[0].hypothesis.proportional:
        return None
    single = [s for s in scores if len(s.directions) == 1 and np.isfinite(s.visible)]
    if not single:
        return None
    best = min(_as_good(single), key=lambda s: abs(math.log(abs(s.amount[0]))) if s.amount[0] else math.inf)
    sizes = [name for name in best.directions[0] if name in best.hypothesis.nulls]
    if len(sizes) != 1 or sizes[0] in best.hypothesis.inverse:
        return None
    size, null, amount = sizes[0], best.hypothesis.nulls[sizes[0]], best.amount[0]
    row = next(p for p in model.parameters if p.name == size)
    value, one_way, from_ = best.directions[0][size], not row.low < null < row.high, best
    if NEAR < amount < 1.0 / NEAR:
        return None
    if abs(amount) < FAR or (amount < 0.0 and one_way):
        amount = -FAR if amount < 0.0 and not one_way else FAR
        from_ = min((s for s in single if size in s.directions[0]), key=lambda s: abs(s.directions[0][size] - null))
        value = from_.directions[0][size]
    nearer = row.clip(null + min(max(amount, -1.0 / FAR), 1.0 / FAR) * (value - null))
    along = from_.absorbability < HIDDEN
    done = [s for s in single if size in s.directions[0] and (not along or set(s.directions[0]) & set(fit.free))]
    if any(abs(nearer - s.directions[0][size]) <= 0.05 * abs(nearer - null) for s in done):
        return None
    found = {**from_.directions[0], size: nearer}
    if along:
        share = (nearer - null) / (value - null)
        for p in model.parameters:
            if p.name in from_.absorbed:
                now = fit.values[p.name]
                moved = found.get(p.name, now) - now + from_.absorbed[p.name]
                found[p.name] = p.clip(now + share * moved)
    return (found,)


def _as_good(scores: Sequence[Score]) -> list[Score]:
    """The best of some scores, and those that differ from it by rounding alone: probes of one shape at other sizes."""
    most = max(s.gain for s in scores)
    return [s for s in scores if s.gain >= most - SAME * abs(most)]


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


def _score(hypothesis, probe, residual, change, left) -> tuple[Score, np.ndarray]:
    size, rest = float(np.linalg.norm(change)), float(np.linalg.norm(left))
    angle = float(np.degrees(np.arcsin(min(rest / size, 1.0)))) if size > 0.0 else 0.0
    if size == 0.0 or rest < 1e-6 * size:
        return Score(hypothesis, probe, 0.0, (0.0,) * change.shape[1], angle, np.inf), np.zeros_like(left)
    u, s, vt = np.linalg.svd(left, full_matrices=False)
    sound = s > 1e-6 * s[0]
    parts = np.where(sound, u.T @ residual, 0.0)
    amount = vt.T @ np.where(sound, parts / np.where(sound, s, 1.0), 0.0)
    whole = left.sum(axis=1)
    as_is = float(2.0 * (whole @ residual) - whole @ whole)
    return Score(hypothesis, probe, float(parts @ parts), tuple(amount), angle, 3.6 / float(s[0]), as_is), u * sound


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
