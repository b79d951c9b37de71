"""Which effects a recording asks for, one after the other, where the model's own error has a colour.

`diagnosis.select` takes what is left after a refit for sensor noise with a colour, and whitens it. On a bench whose
sensors are far better than any model (0.2 mN m against 3) what is left is model error, slow over seconds: an
autoregression of it would throw away the slow parts, which are what a model is to explain. Here every channel counts by
its residual's size and by its number of independent stretches, and the records that no refit has seen judge:

forward    | score all hypotheses (`screen`), refit the best, take the one that improves the held-out records most
accept     | if that gain is above `MARGIN`, comes from most held-out records, no size ends on a bound
backward   | whatever the held-out records do not miss any more, once others are in, goes
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from diagnosis.hypotheses import Hypothesis
from diagnosis.likelihood import Judged, raw_residuals
from diagnosis.model import Model, Whitener
from diagnosis.noise import Noise
from diagnosis.refit import Fit, Start, refit
from diagnosis.screen import screen

MARGIN = 6.0
"""Held-out sum of squares, in independent stretches, that an effect must buy: about e^3 to 1."""
MISSED = 2.0
"""Held-out gain below which an effect that is in goes again."""
SHARE = 0.6
"""Of the held-out records that must gain."""
RIVALS = 8
"""Best-scored hypotheses that are refitted."""
ROUNDS = 2


@dataclass(frozen=True)
class Rung:
    """A step of the ladder: the effect that was added, its refit, and what it bought.

    gain        | fall of the held-out sum of squares, in independent stretches, at the noise of the step before
    confidence  | exp(gain / 2) of it over that of all rivals, those of its class counted with it
    rivals      | held-out gain of every refitted hypothesis
    alike       | rivals within `MARGIN` of it: on these records not told from it
    dropped     | effects that were in, and are not missed any more
    rmse        | (fit, held-out) by channel, SI
    """

    name: str
    fit: Fit
    gain: float
    confidence: float
    rivals: dict[str, float]
    alike: tuple[str, ...]
    rmse: tuple[dict[str, float], dict[str, float]]
    dropped: tuple[str, ...] = ()
    refused: dict[str, str] = field(default_factory=dict)


def weigh(blocks, series: Sequence[np.ndarray]) -> Whitener:
    """Every channel by its RMS times the root of the samples that hang together: (1 + 2 sum of autocorrelations).

    The sum goes to the first negative autocorrelation of the channel that is slower, and holds for both: else a channel
    that is wrong by a constant would count for nothing. No sample is coloured.
    """
    sizes, slowest = {}, 1.0
    for channel in dict.fromkeys(b.channel for b in blocks):
        parts = [np.where(b.good, s, 0.0) for b, s in zip(blocks, series, strict=True) if b.channel == channel]
        count = sum(int(b.good.sum()) for b in blocks if b.channel == channel)
        sizes[channel] = max(float(np.sqrt(sum(float(p @ p) for p in parts) / max(count, 1))), 1e-12)
        slowest = max(slowest, _together(parts))
    return Whitener({channel: Noise(np.empty(0), size * float(np.sqrt(slowest))) for channel, size in sizes.items()})


def _together(parts: Sequence[np.ndarray]) -> float:
    longest = max(len(p) for p in parts)
    total = np.zeros(longest)
    for part in parts:
        spectrum = np.abs(np.fft.rfft(part, 2 * longest)) ** 2
        total += np.fft.irfft(spectrum)[:longest]
    if not total[0] > 0.0:
        return 1.0
    negative = np.flatnonzero(total < 0.0)
    end = int(negative[0]) if len(negative) else longest
    return float(1.0 + 2.0 * np.sum(total[1:end]) / total[0])


def rmse(model: Model, fit: Fit) -> dict[str, float]:
    """Root mean square of measured less predicted by channel, SI."""
    return rms_by_channel(model, raw_residuals(model, fit))


def rms_by_channel(model: Model, series: Sequence[np.ndarray]) -> dict[str, float]:
    """Root mean square of the good samples of series [T] of every block, by channel."""
    squares: dict[str, list[np.ndarray]] = {}
    for block, left in zip(model.blocks, series, strict=True):
        squares.setdefault(block.channel, []).append(left[block.good] ** 2)
    return {channel: float(np.sqrt(np.mean(np.concatenate(parts)))) for channel, parts in squares.items()}


def settle(model: Model, start: Start, rounds: int = ROUNDS) -> tuple[Fit, Whitener]:
    """A refit, with the channels weighed by what it leaves; the two in turns."""
    values = np.array([[start.values.get(p.name, p.start)] for p in model.parameters])
    left = [b.measured - p[:, 0] for b, p in zip(model.blocks, model.predict(values), strict=True)]
    whitener = weigh(model.blocks, left)
    for _ in range(rounds):
        fit = _converged(model, whitener, start)
        start = Start(fit.label, fit.free, fit.values)
        whitener = weigh(model.blocks, raw_residuals(model, fit))
    return fit, whitener


def _converged(model: Model, whitener: Whitener, start: Start) -> Fit:
    """Refits from where the last one ended, until one gains nothing: friction's kinks stop a single one early."""
    fit = refit(model, whitener, [start])[0]
    for _ in range(4):
        again = refit(model, whitener, [Start(fit.label, fit.free, fit.values)])[0]
        gain, fit = fit.cost - again.cost, again
        if gain < 1e-2:
            break
    return fit


@dataclass(frozen=True)
class Judge:
    """Sums of squares of held-out records by (record, channel), and how many samples make an independent stretch."""

    squares: dict[tuple[str, str], float]
    counts: dict[str, int]
    together: float

    def gain(self, other: "Judge") -> float:
        """Log likelihood ratio, doubled, of ``other`` over this: stretches times the log of the sums' quotient."""
        return sum(
            count / self.together * float(np.log(self._total(channel) / other._total(channel)))
            for channel, count in self.counts.items()
        )

    def records(self, other: "Judge") -> tuple[int, int]:
        """(held-out records that ``other`` predicts better, of how many), channels by what ``other`` leaves in them."""
        gains: dict[str, float] = {}
        for (record, channel), mine in self.squares.items():
            gained = (mine - other.squares[record, channel]) / other._total(channel)
            gains[record] = gains.get(record, 0.0) + gained
        return sum(g > 0.0 for g in gains.values()), len(gains)

    def _total(self, channel: str) -> float:
        return max(sum(v for (_, c), v in self.squares.items() if c == channel), 1e-300)


def judge(model: Model, fit: Fit) -> Judge:
    """How a fit does on the records of ``model``."""
    left = raw_residuals(model, fit)
    squares, counts = {}, {}
    for block, values in zip(model.blocks, left, strict=True):
        squares[block.record, block.channel] = float(np.sum(values[block.good] ** 2))
        counts[block.channel] = counts.get(block.channel, 0) + int(block.good.sum())
    parts = {
        c: [np.where(b.good, v, 0.0) for b, v in zip(model.blocks, left, strict=True) if b.channel == c] for c in counts
    }
    return Judge(squares, counts, max(_together(p) for p in parts.values()))


def ladder(
    fit: Model, heldout: Model, nominals: tuple[str, ...], hypotheses: Sequence[Hypothesis], *,
    start: Start | None = None, most: int = 10, tell: Callable[[str], None] = lambda text: None,
) -> list[Rung]:  # fmt: skip
    """The steps from the refit of ``nominals`` (or from ``start``) up; the first rung is that refit, named "".

    ``hypotheses``: those that may still be missing. Ends where none is accepted, or with ``most`` effects.
    """
    rng = np.random.default_rng(0)
    best, whitener = settle(fit, start or Start("", nominals, {}))
    rungs = [Rung("", best, 0.0, 1.0, {}, (), (rmse(fit, best), rmse(heldout, best)))]
    inside: list[Hypothesis] = []
    left = list(hypotheses)
    while left and len(inside) < most:
        rung = _climb(fit, heldout, best, whitener, left, rng)
        if not rung.name:
            rungs[-1] = replace(rungs[-1], refused=rung.refused)
            break
        found = next(h for h in left if h.name == rung.name)
        inside.append(found)
        left.remove(found)
        settled, whitener = settle(fit, Start("", rung.fit.free, rung.fit.values))
        settled, whitener, gone = _drop(fit, heldout, settled, whitener, inside)
        inside = [h for h in inside if h.name not in gone]
        best = settled
        rungs.append(replace(rung, fit=best, rmse=(rmse(fit, best), rmse(heldout, best)), dropped=gone))
        tell(f"{rung.name} ({rung.gain:.0f}); {_said(rungs[-1])}; without {', '.join(gone) or 'nothing'}")
    return rungs


def _said(rung: Rung) -> str:
    return ", ".join(f"{channel} {value:.4g}" for channel, value in rung.rmse[1].items())


def _climb(fit, heldout, best, whitener, left, rng) -> Rung:
    """The best of the hypotheses left; its name is empty where none is accepted."""
    known = Judged(best, tuple(raw_residuals(fit, best)), whitener, 0.0)
    screening = screen(fit, known, left, rng, whitener)
    rivals = sorted(screening.best.values(), key=lambda s: -s.gain)[:RIVALS]
    starts = []
    for score in rivals:
        free = (*best.free, *(n for n in score.hypothesis.names if n not in best.free))
        tried = sorted((s for s in screening.scores if s.hypothesis is score.hypothesis), key=lambda s: -s.gain)[:2]
        for one in tried:
            probe = {k: v for direction in one.directions for k, v in direction.items()}
            starts.append(Start(score.hypothesis.name, free, {**best.values, **probe}))
    fits: dict[str, Fit] = {}
    for one in refit(fit, whitener, starts, iterations=12):
        if one.label not in fits or one.cost < fits[one.label].cost:
            fits[one.label] = one
    base, judged = judge(heldout, best), {name: judge(heldout, one) for name, one in fits.items()}
    sums = {name: base.gain(one) for name, one in judged.items()}
    refused = {}
    for h in (score.hypothesis for score in rivals):
        reason = _against(h, fits[h.name], sums[h.name], *base.records(judged[h.name]))
        if reason:
            refused[h.name] = reason
    open_to = {name: gain for name, gain in sums.items() if name not in refused}
    if not open_to:
        return Rung("", best, 0.0, 0.0, sums, (), ({}, {}), (), refused)
    highest = max(open_to.values())
    near = [h for h in left if highest - open_to.get(h.name, -np.inf) < MARGIN]
    name = max(near, key=lambda h: open_to[h.name] - 2.0 * len(h.free)).name  # Akaike's price of a parameter
    alike = tuple(h.name for h in near if h.name != name)
    odds = {n: np.exp(0.5 * min(gain - highest, 0.0)) for n, gain in sums.items()}
    confidence = sum(odds[n] for n in (name, *alike)) / sum(odds.values())
    return Rung(name, fits[name], open_to[name], float(confidence), sums, alike, ({}, {}), (), refused)


def _against(hypothesis: Hypothesis, fit: Fit, gain: float, better: int, records: int) -> str:
    """Why a refitted hypothesis is not taken; empty if nothing speaks against it."""
    if gain < MARGIN:
        return f"it buys {gain:.1f} on the held-out records, less than {MARGIN:g}"
    if better < SHARE * records:
        return f"only {better} of {records} held-out records gain"
    stuck = [n for n in fit.at_bounds if n in hypothesis.names and fit.values[n] != hypothesis.nulls.get(n)]
    return f"{', '.join(stuck)} ended on a bound" if stuck else ""


def _drop(fit, heldout, best, whitener, inside) -> tuple[Fit, Whitener, tuple[str, ...]]:
    """Leave out, one by one, what the held-out records do not miss; each time everything else is refitted."""
    gone: list[str] = []
    while len(inside) - len(gone) > 1:
        candidates = [h for h in inside if h.name not in gone]
        starts = []
        for h in candidates:
            free = tuple(n for n in best.free if n not in h.names)
            starts.append(Start(h.name, free, {**best.values, **{p.name: p.start for p in h.free}}))
        fits = refit(fit, whitener, starts, iterations=12)
        losses = [judge(heldout, one).gain(judge(heldout, best)) for one in fits]
        least = fits[int(np.argmin(losses))]
        if min(losses) >= MARGIN:
            break
        settled, weights = settle(fit, Start("", least.free, least.values))
        if judge(heldout, settled).gain(judge(heldout, best)) >= MISSED:
            break
        gone.append(least.label)
        best, whitener = settled, weights
    return best, whitener, tuple(gone)
