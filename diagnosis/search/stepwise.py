"""Which effects the held-out records ask for, one after the other: the steps of the criterion "unseen".

`search.select` takes what is left after a refit for sensor noise with a colour, and whitens it. On a bench whose
sensors are far better than any model (0.2 mN m against 3) what is left is model error, slow over seconds: an
autoregression of it would throw away the slow parts, which are what a model is to explain. Here every channel counts by
its residual's size and by its number of independent stretches (`fit.weights`), and the records that no refit has
seen judge. Scores, starts and refits are those of `diagnosis.fit.score_tests` and `diagnosis.search.comparison`.

forward    | score all hypotheses (`screen`), refit the best, take the one that improves the held-out records most
accept     | if that gain is above `MARGIN`, comes from most held-out records, no size ends on a bound
backward   | whatever the held-out records do not miss any more, once others are in, goes
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from diagnosis.fit.likelihood import Judged, raw_residuals
from diagnosis.fit.refit import Fit, Start, refit
from diagnosis.fit.score_tests import Screening, screen
from diagnosis.fit.weights import about, rmse, settle, together
from diagnosis.model.hypotheses import Hypothesis
from diagnosis.model.model import Model, Whitener
from diagnosis.model.verdict import Step
from diagnosis.search.comparison import refits
from diagnosis.search.objections import bounded

MARGIN = 6.0
"""Held-out sum of squares, in independent stretches, that an effect must buy: about e^3 to 1."""
MISSED = 2.0
"""Held-out gain below which an effect that is in goes again."""
SHARE = 0.6
"""Of the held-out records that must gain."""
EQUAL = 1.0
"""Difference of worth that says nothing."""
NEAR, RIVALS = 0.4, 3
"""Share of the best gain from which a hypothesis is refitted from more starts, and how many of them at the most."""
MOST = 10
"""Effects at the most."""
Keep = Callable[[str, Callable[[], Any]], Any]


@dataclass(frozen=True)
class Rung:
    """A step of the ladder: the effect that was added, its refit, and what it bought.

    gain        | fall of the held-out sum of squares, in independent stretches (`Held.gain`)
    rivals      | the same of every refitted hypothesis, for all in stretches of what the step before leaves; at a refit
                | on which nothing stands, of those refused
    margin      | gain over the best rival that is not ``alike``
    alike       | rivals over which it gains less than `MARGIN`: on these records not told from it
    rmse        | (fit, held-out) by channel, SI
    dropped     | effects that were in, and are not missed any more
    refused     | hypothesis -> why it was not taken at this step; at the last rung, at the step that found none
    screening   | the scores from which it was chosen
    """

    name: str
    fit: Fit
    gain: float
    margin: float
    rivals: Mapping[str, float]
    alike: tuple[str, ...]
    rmse: tuple[dict[str, float], dict[str, float]]
    dropped: tuple[str, ...] = ()
    refused: Mapping[str, str] = field(default_factory=dict)
    screening: Screening | None = None


@dataclass(frozen=True)
class Held:
    """Sums of squares of records by (record, channel), and how many samples make an independent stretch."""

    squares: Mapping[tuple[str, str], float]
    counts: Mapping[str, int]
    together: float

    def gain(self, other: "Held", stretch: float | None = None) -> float:
        """Log likelihood ratio, doubled, of ``other`` over this: stretches times the log of the sums' quotient.

        stretch: samples of one; None: the shorter of what both leave. A change in coloured errors is as sure as the
        product of both autocorrelations is short (Bartlett): a slow mismatch may not hide what removes it, nor a slow
        rest what removed quick errors.
        """
        stretch = stretch or min(self.together, other.together)
        return sum(
            count / stretch * float(np.log(self._total(channel) / other._total(channel)))
            for channel, count in self.counts.items()
        )

    def records(self, other: "Held") -> tuple[int, int]:
        """(records that ``other`` predicts better, of how many), channels by what ``other`` leaves in them."""
        gains: dict[str, float] = {}
        for (record, channel), mine in self.squares.items():
            gained = (mine - other.squares[record, channel]) / other._total(channel)
            gains[record] = gains.get(record, 0.0) + gained
        return sum(g > 0.0 for g in gains.values()), len(gains)

    @property
    def stretches(self) -> float:
        """Independent stretches of all channels together."""
        return sum(self.counts.values()) / self.together

    def _total(self, channel: str) -> float:
        return max(sum(v for (_, c), v in self.squares.items() if c == channel), 1e-300)


def held(model: Model, fit: Fit) -> Held:
    """How a fit does on the records of ``model``."""
    left = raw_residuals(model, fit)
    squares: dict[tuple[str, str], float] = {}
    counts: dict[str, int] = {}
    parts: dict[str, list[np.ndarray]] = {}
    for block, values in zip(model.blocks, left, strict=True):
        squares[block.record, block.channel] = float(np.sum(values[block.good] ** 2))
        counts[block.channel] = counts.get(block.channel, 0) + int(block.good.sum())
        parts.setdefault(block.channel, []).append(np.where(block.good, values, 0.0))
    return Held(squares, counts, max(together(p) for p in parts.values()))


def ladder(
    fit: Model, heldout: Model, nominals: tuple[str, ...], hypotheses: Sequence[Hypothesis], *,
    start: Start | None = None, most: int = MOST, tell: Callable[[str], None] = lambda text: None,
    keep: Keep = lambda name, make: make(),
) -> list[Rung]:  # fmt: skip
    """The steps from the refit of ``nominals`` (or from ``start``) up; the first rung is that refit, named "".

    ``hypotheses``: those that may still be missing. Ends where none is accepted, or with ``most`` effects.
    ``keep``: as in `diagnosis.search.select.select`.
    """
    rng = np.random.default_rng(0)
    best, whitener = keep("null", partial(settle, fit, start or Start("", nominals, {})))
    rungs = [Rung("", best, 0.0, 0.0, {}, (), (rmse(fit, best), rmse(heldout, best)))]
    inside: list[Hypothesis] = []
    left = list(hypotheses)
    while left and len(inside) < most:
        tell(f"scoring {len(left)} hypotheses, refitting the best of them")
        rung = keep("climb", partial(_climb, fit, heldout, best, whitener, left, rng))
        if not rung.name:
            last = rungs[-1]
            rungs[-1] = replace(
                last, refused=rung.refused, rivals=last.rivals or rung.rivals,
                screening=last.screening or rung.screening,
            )  # fmt: skip
            break
        found = next(h for h in left if h.name == rung.name)
        inside.append(found)
        left.remove(found)
        settled, whitener = keep("rung", partial(settle, fit, Start("", rung.fit.free, rung.fit.values)))
        best, whitener, gone = keep("drop", partial(_drop, fit, heldout, settled, whitener, inside))
        inside = [h for h in inside if h.name not in gone]
        rungs.append(replace(rung, fit=best, rmse=(rmse(fit, best), rmse(heldout, best)), dropped=gone))
        tell(f"{rung.name} ({rung.gain:.0f}); {_said(rungs[-1])}; without {', '.join(gone) or 'nothing'}")
    return rungs


def inside(rungs: Sequence[Rung | Step]) -> tuple[str, ...]:
    """Effects that are in at the top of a ladder, in the order in which they came."""
    found: list[str] = []
    for rung in rungs[1:]:
        found = [name for name in (*found, rung.name) if name not in rung.dropped]
    return tuple(found)


def _said(rung: Rung) -> str:
    return ", ".join(f"{channel} {value:.4g}" for channel, value in rung.rmse[1].items())


def _climb(fit, heldout, best, whitener: Whitener, left, rng) -> Rung:
    """The best of the hypotheses left; its name is empty where none is accepted."""
    known = Judged(best, tuple(raw_residuals(fit, best)), whitener, 0.0)
    screening = screen(fit, known, left, rng, whitener)
    fits = refits(fit, best, screening)
    base = held(heldout, best)
    near = _nearest(base, {name: held(heldout, one) for name, one in fits.items()})
    fits |= _polished(fit, fits, near, whitener, rng)
    judged = {name: held(heldout, one) for name, one in fits.items()}
    sums = {name: base.gain(one, base.together) for name, one in judged.items()}  # one scale for all rivals
    refused = {}
    for name in fits:
        h = next(h for h in left if h.name == name)
        reason = _against(h, fits[name], base.gain(judged[name]), *base.records(judged[name]))
        if reason:
            refused[name] = reason
    open_to = {name: gain for name, gain in sums.items() if name not in refused}
    if not open_to:
        return Rung("", best, 0.0, 0.0, sums, (), ({}, {}), (), refused, screening)
    top = judged[max(open_to, key=open_to.get)]
    behind = {name: judged[name].gain(top) for name in fits}  # by what those two leave, not by what both have removed
    near = [h for h in left if h.name in open_to and behind[h.name] < MARGIN]
    worth = {h.name: -behind[h.name] - 2.0 * len(h.free) for h in near}  # Akaike's price of a parameter
    # two springs in series are one until friction lies between them: of equals, the library's first
    name = next(h.name for h in near if worth[h.name] > max(worth.values()) - EQUAL)
    alike = tuple(h.name for h in near if h.name != name)
    gain = base.gain(judged[name])
    margin = min([judged[n].gain(judged[name]) for n in fits if n not in (name, *alike)], default=gain)
    return Rung(name, fits[name], gain, min(margin, gain), sums, alike, ({}, {}), (), refused, screening)


def _nearest(base: Held, judged: Mapping[str, Held]) -> list[str]:
    """Hypotheses that may still lead, the best first."""
    gains = {name: base.gain(one, base.together) for name, one in judged.items()}
    top = max(gains.values(), default=0.0)
    near = [name for name, gain in gains.items() if gain > NEAR * top]
    return sorted(near, key=lambda name: -gains[name])[:RIVALS]


def _polished(model: Model, fits: Mapping[str, Fit], near: Sequence[str], whitener: Whitener, rng) -> dict[str, Fit]:
    """Those that lead, each refitted from where it is, from where the leader is, and from about there."""
    if not near:
        return {}
    leader, found = fits[near[0]], {}
    for name in near:
        own = fits[name]
        there = {n: (leader if n in leader.free else own).values[n] for n in own.free}
        starts = [Start(name, own.free, {**own.values, **values}) for values in ({}, there)]
        best = about(model, whitener, starts, rng)
        found[name] = settle(model, Start(name, best.free, best.values))[0]
    return found


def _against(hypothesis: Hypothesis, fit: Fit, gain: float, better: int, records: int) -> str:
    """Why a refitted hypothesis is not taken; empty if nothing speaks against it."""
    if gain < MARGIN:
        return f"it buys {gain:.1f} on the held-out records, less than {MARGIN:g}"
    if better < SHARE * records:
        return f"only {better} of {records} held-out records gain"
    stuck = bounded(hypothesis, fit)
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
        losses = [held(heldout, one).gain(held(heldout, best)) for one in fits]
        least = fits[int(np.argmin(losses))]
        if min(losses) >= MARGIN:
            break
        settled, weights = settle(fit, Start("", least.free, least.values))
        if held(heldout, settled).gain(held(heldout, best)) >= MISSED:
            break
        gone.append(least.label)
        best, whitener = settled, weights
    return best, whitener, tuple(gone)
