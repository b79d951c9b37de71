"""Limit cycles: oscillations that keep themselves going. Nobody can predict their phase; their spectrum can be.

A controlled drive with a gap oscillates between its edges. No simulation has the machine's phase for long, so that a
gap that makes it oscillate as the machine does makes the sum of squares of what is left larger, not smaller, and no
refit finds it. Here hypotheses are compared by the spectrum that they expect of what is left (`evidence.bands`,
Whittle's likelihood): all are looked at at many sizes; of those that oscillate and gain, the size, and the nominal
parameters that the refit leaves unsure, are looked for by differential evolution (Storn, Price, J. Global Optimization
11 (1997) 341).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from scipy.linalg import block_diag
from scipy.optimize import differential_evolution

from cable_envs.diagnosis.evidence.bands import Averaged, Bands, Spectra
from cable_envs.diagnosis.evidence.shared import bayes_bound
from cable_envs.diagnosis.fit.likelihood import Judged, raw_residuals, refit_nominals
from cable_envs.diagnosis.fit.refit import Fit
from cable_envs.diagnosis.model.hypotheses import Hypothesis
from cable_envs.diagnosis.model.leftover import Left
from cable_envs.diagnosis.model.model import Free, Whitener
from cable_envs.diagnosis.model.verdict import EffectGain
from cable_envs.diagnosis.search.selection import Selection, confidence

BENT = 0.1
"""Share of what nudged runs are apart by, out of proportion to the nudge, from which they oscillate."""
GAIN = 40.0
"""Fall of the cost that a limit cycle must bring: odds of e^20 before its parameters' price."""
SIGNIFICANCE, HIDDEN = 1e-3, 1e-6
"""p-values below which a spectrum is not as expected: before a limit cycle is looked for, and after it is found."""
LEFT, LEFT_BY_ITSELF = 0.22, 0.35
"""Shares of the gain that may be left: of a limit cycle that was looked for, and of a simulator that oscillates by
itself, which nothing has adapted to the recording's cycle."""
OVER = 1.18
"""RMS over what is expected up to which a model may be right: impacts in a gap are no two times the same."""
MARGIN = 10.0
"""Fall of the cost by which one must beat another to be told from it."""
RUNS, LOOKS = 6, 2
"""Runs that are nudged apart: of a model, and of each of many that are only looked at."""
SCALES = tuple(np.geomspace(1e-3, 1.0, 13).tolist())
"""Sizes that are looked at, over the largest at which a hypothesis is probed."""
COARSE = 8
"""Bands that are one for it: the frequency is not right yet."""
RIVALS = 3
"""Hypotheses whose size is looked for."""
SOFT = 0.5
"""Share of a parameter's standard deviation beforehand that the refit may leave for it to be looked for again: what
sets an oscillation's frequency, a belt's stiffness say, may show in nothing else."""
WIDE, FACTOR = 2.0, 4.0
"""Where they are looked for: such a parameter about its claim, in standard deviations; a size about a look."""
POPULATION, GENERATIONS = 32, 10
ALLOWED = 3.84
"""Rise of the cost, over its dispersion, within a 95 % interval."""
AGAINST = 0.1
"""Share of its gain that an effect may cost on held-out records: at the edge of oscillating it comes and goes."""
FORM = 0.08
"""Share of its size by which an effect that is found so is off, one standard deviation: gaps of six drives that proofs
had missed came out 0.1 to 6 % off, 15 to 30 % where a search ended early. How impacts are damped sets the amplitude."""


@dataclass(frozen=True, kw_only=True)
class LimitCycle(EffectGain):
    """A hypothesis that makes the simulation oscillate as the recording does.

    ``gain``: fall of the cost (Whittle's likelihood, priors included) from a model that does not oscillate;
    ``heldout_gain``: the same of the held-out records.

    Parameters
    ----------
    values : Mapping of str to float
        All parameters, SI.
    bands : Bands
        Its spectrum.
    errors : Mapping of str to float
        Standard error of every parameter that was looked for.
    """

    values: Mapping[str, float]
    bands: Bands
    errors: Mapping[str, float]


def oscillates(spectra: Spectra) -> bool:
    """Whether a model oscillates by itself as it is claimed to be, so that `GAIN` could be gained by it.

    Runs that are apart in proportion to a parameter are no oscillation: of a long way, measured well, a ten-thousandth
    is more than the noise.
    """
    return bool(spectra) and spectra.at({}, RUNS).expected_gain >= GAIN and spectra.bent({}, RUNS) > BENT


def refitted(spectra: Spectra, nominals: tuple[str, ...], rng: np.random.Generator) -> tuple[Judged, Bands]:
    """A model that oscillates by itself, refitted, and its bands.

    It is refitted by what can be predicted of it; then, where its spectrum is not that of the recording, what is
    claimed in doubt is refitted by the spectrum.
    """
    null = refit_nominals(Averaged(spectra.model, RUNS), nominals)
    bands = spectra.at(null.fit.values, RUNS)
    doubted = [p.name for p in spectra.model.parameters if p.name in nominals and _doubt(p)]
    if bands.p_value > SIGNIFICANCE or not doubted:
        return null, bands
    search = _Search(spectra, null.fit, doubted)
    found, cost = search.best(rng)
    if cost < bands.cost + search.prior_of(null.fit.values):
        null = replace(null, fit=replace(null.fit, values=found))
        bands = spectra.at(found, RUNS)
    return null, bands


def search(
    spectra: Spectra, heldout: Spectra, fit: Fit, hypotheses: Sequence[Hypothesis], rng: np.random.Generator
) -> list[LimitCycle]:
    """Hypotheses that make a refitted model oscillate and gain `GAIN` by it; the best first.

    None of them is at the held-out records' cost (`AGAINST`).
    """
    null = spectra.at(fit.values, RUNS) if spectra else None
    if null is None or null.excess < GAIN or null.p_value > SIGNIFICANCE:
        return []
    found = [
        _sought(spectra, heldout, fit, null, h, look, rng) for h, look in _promising(spectra, fit, null, hypotheses)
    ]
    enough = [c for c in found if c.gain >= GAIN and c.bands.expected_gain >= GAIN]
    return sorted((c for c in enough if c.heldout_gain > -AGAINST * c.gain), key=lambda c: -c.gain)


def _promising(
    spectra: Spectra, fit: Fit, null: Bands, hypotheses: Sequence[Hypothesis]
) -> list[tuple[Hypothesis, Mapping[str, float]]]:
    """The best look of each of the `RIVALS` best hypotheses."""
    looks = [(h, values) for h in hypotheses for values in _looks(h)]
    if not looks:
        return []
    columns = np.concatenate([spectra.column({**fit.values, **values}) for _, values in looks], axis=1)
    best: dict[str, tuple[float, Hypothesis, Mapping[str, float]]] = {}
    before = null.coarse(COARSE).cost
    for (h, values), bands in zip(looks, spectra.of(columns, LOOKS), strict=True):
        gain = before - bands.coarse(COARSE).cost
        if bands.expected_gain >= GAIN and gain > best.get(h.name, (0.0,))[0]:
            best[h.name] = (gain, h, values)
    leading = sorted(best.values(), key=lambda one: -one[0])[:RIVALS]
    return [(h, values) for _, h, values in leading]


def _looks(hypothesis: Hypothesis) -> list[dict[str, float]]:
    """Sizes, each with all shapes, at which a hypothesis is looked at, on either side of its null."""
    found = []
    for row, side in product(hypothesis.nulls, (1.0, -1.0)):
        null = hypothesis.nulls[row]
        probes = [p[0] for p in hypothesis.probes if len(p) == 1 and side * (p[0].get(row, null) - null) > 0.0]
        if not probes:
            continue
        bounds = next(p for p in hypothesis.free if p.name == row)
        shapes = sorted({tuple(sorted((n, v) for n, v in p.items() if n != row)) for p in probes})
        largest, least = max(abs(p[row] - null) for p in probes), min(p[row] for p in probes)
        for scale, shape in product(SCALES, shapes):
            value = least / scale if row in hypothesis.inverse else null + side * scale * largest
            found.append({row: bounds.clip(value), **dict(shape)})
    return found


def _doubt(parameter: Free) -> float:
    """Standard deviation before a recording is seen: of its claim, or of bounds that are as close; 0: it has none."""
    width = parameter.high - parameter.low
    return parameter.std or (width / np.sqrt(12.0) if width <= 2.0 * parameter.scale else 0.0)


def _about(parameter: Free) -> tuple[float, float]:
    """Where it is looked for."""
    if not parameter.std:
        return parameter.low, parameter.high
    return parameter.start - WIDE * parameter.std, parameter.start + WIDE * parameter.std


class _Search:
    """The least cost over what a look has, by the logarithm of its distance to the null, and over nominals."""

    def __init__(
        self, spectra: Spectra, fit: Fit, nominals: Sequence[str], look: Mapping[str, float] | None = None,
        nulls: Mapping[str, float] | None = None,
    ):  # fmt: skip
        look, nulls = look or {}, nulls or {}
        known = {p.name: p for p in spectra.model.parameters}
        self.spectra, self.values = spectra, dict(fit.values)
        self.names = [*look, *nominals]
        self.nulls = np.array([nulls.get(n, 0.0) for n in look])
        self.tried: list[tuple[np.ndarray, float]] = []
        """values and costs with priors"""
        self._free = [known[n] for n in self.names]
        self._rows = [list(known).index(n) for n in self.names]
        off = np.array(list(look.values())) - self.nulls
        sizes, reach = np.log(np.maximum(np.abs(off), 1e-300)), np.log(FACTOR)
        self._signs = np.where(off < 0.0, -1.0, 1.0)
        self._ends = [(float(s - reach), float(s + reach)) for s in sizes]
        self._ends += [_about(p) for p in self._free[len(look) :]]
        begin = [*sizes, *(fit.values[n] for n in nominals)]
        self._begin = [float(np.clip(b, *end)) for b, end in zip(begin, self._ends, strict=True)]

    def best(self, rng: np.random.Generator) -> tuple[dict[str, float], float]:
        """(all parameters by name, cost with priors)."""
        differential_evolution(
            self._costs, self._ends, x0=self._begin, popsize=max(1, POPULATION // len(self.names)),
            maxiter=GENERATIONS, init="sobol", polish=False, vectorized=True, updating="deferred", rng=rng, tol=0.0,
        )  # fmt: skip
        at, cost = min(self.tried, key=lambda one: one[1])
        return {**self.values, **dict(zip(self.names, at.tolist(), strict=True))}, cost

    def errors(self, best: Mapping[str, float], cost: float, dispersion: float) -> dict[str, float]:
        """Standard errors, from all that was tried and costs little more; a size's formulation besides."""
        at = np.array([best[n] for n in self.names])
        near = np.array([where for where, c in self.tried if c <= cost + ALLOWED * dispersion])
        reach = np.abs(near - at).max(axis=0) / np.sqrt(ALLOWED)
        form = np.zeros(len(at))
        form[: len(self.nulls)] = FORM * (at[: len(self.nulls)] - self.nulls)
        return dict(zip(self.names, np.hypot(reach, form).tolist(), strict=True))

    def prior_of(self, values: Mapping[str, float]) -> float:
        """Squared distance from the claims, in standard deviations."""
        return float(self._prior(np.array([[values[n]] for n in self.names]))[0])

    def _prior(self, values: np.ndarray) -> np.ndarray:
        first = len(self.nulls)
        claims = zip(values[first:], self._free[first:], strict=True)
        return sum((((row - p.start) / p.std) ** 2 for row, p in claims if p.std), np.zeros(values.shape[1]))

    def _costs(self, at: np.ndarray) -> np.ndarray:
        at = at.reshape(len(self.names), -1)
        first = len(self.nulls)
        sizes = self.nulls[:, None] + self._signs[:, None] * np.exp(at[:first])
        wanted = np.concatenate([sizes, at[first:]])
        values = np.array([np.clip(row, p.low, p.high) for row, p in zip(wanted, self._free, strict=True)])
        columns = np.repeat(self.spectra.column(self.values), at.shape[1], axis=1)
        columns[self._rows] = values
        costs = np.array([bands.cost for bands in self.spectra.of(columns, RUNS)]) + self._prior(values)
        self.tried += list(zip(values.T, costs.tolist(), strict=True))
        return costs


def _sought(spectra, heldout, fit, null, hypothesis, look, rng) -> LimitCycle:
    known = {p.name: p for p in spectra.model.parameters}
    errors = {n: float(np.sqrt(fit.covariance[k, k])) for k, n in enumerate(fit.free)}
    unsure = [n for n, error in errors.items() if error > SOFT * _doubt(known[n]) > 0.0]
    search = _Search(spectra, fit, unsure, look, hypothesis.nulls)
    values, cost = search.best(rng)
    bands = spectra.at(values, RUNS)
    gain = null.cost + search.prior_of(fit.values) - cost
    held = heldout.at(fit.values, RUNS).cost - heldout.at(values, RUNS).cost if heldout else 0.0
    errors = search.errors(values, cost, bands.dispersion)
    return LimitCycle(hypothesis, gain, held, values=values, bands=bands, errors=errors)


def left_by(bands: Bands, explained: float) -> Left:
    """Whether what is left has the power that is expected, and its share of what the spread of the runs explains."""
    return Left(bayes_bound(bands.p_value), bands.excess / max(explained, 1e-300), bands.leftovers())


def _adequate(bands: Bands, explained: float, share: float) -> bool:
    """Whether what is left may stay: noise, or no more than a ``share`` of what was explained."""
    if bands.over_noise > OVER:
        return False
    return bands.p_value >= HIDDEN or bands.excess < share * explained


def judged(spectra: Spectra, null: Judged, found: LimitCycle) -> Judged:
    """The model of a limit cycle, on top of the refit it was found on; residuals are those of the mean of its runs."""
    new = tuple(n for n in found.hypothesis.names if n not in null.fit.free)
    covariance = block_diag(null.fit.covariance, np.zeros((len(new), len(new))))
    free = (*null.fit.free, *new)
    for name, error in found.errors.items():
        k = free.index(name)
        covariance[k], covariance[:, k] = 0.0, 0.0
        covariance[k, k] = error**2
    wide = np.concatenate([null.fit.jacobian, np.zeros((len(null.fit.jacobian), len(new)))], axis=1)
    fit = replace(
        null.fit, label=found.hypothesis.name, free=free, values=dict(found.values), jacobian=wide,
        covariance=covariance, cost=null.fit.cost - found.gain, at_bounds=(),
    )  # fmt: skip
    raw = raw_residuals(Averaged(spectra.model, RUNS), fit)
    noise = {**null.whitener.noise, **spectra.whitener.noise}
    return Judged(fit, tuple(raw), Whitener(noise), null.deviance - found.gain)


def as_it_is(null: Judged, bands: Bands) -> Selection | None:
    """The answer where the simulator has a limit cycle without any effect, and the recording has the same."""
    explained = bands.without_spread.cost - bands.cost
    if explained <= 0.0 or not _adequate(bands, explained, LEFT_BY_ITSELF):
        return None
    left = replace(left_by(bands, explained), log_odds=0.0)
    return Selection(null, null, (), (), left, left, bands=bands)


def explaining(spectra: Spectra, null: Judged, found: Sequence[LimitCycle]) -> Selection | None:
    """The answer of the best of what gives the simulator the recording's limit cycle, if that explains it."""
    best = next(iter(found), None)
    if best is None or not _adequate(best.bands, best.gain, LEFT):
        return None
    apart = best.bands.dispersion
    behind = {o.hypothesis.name: (best.gain - o.gain) / apart for o in found[1:]}
    equal = tuple(name for name, by in behind.items() if by < MARGIN)
    margin = min((by for by in behind.values() if by >= MARGIN), default=best.gain / apart)
    odds = [0.5 * margin, 0.5 * best.gain / apart]
    accepted = EffectGain(
        best.hypothesis, 0.5 * best.gain / apart, 0.5 * best.heldout_gain, 0.5 * margin, equal,
        confidence=confidence(odds),
    )  # fmt: skip
    left = left_by(best.bands, best.gain)
    return Selection(null, judged(spectra, null, best), (accepted,), (), left, left, bands=best.bands)
