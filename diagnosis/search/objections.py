"""What speaks against a refitted hypothesis, whatever it gains: one question each, for `diagnosis.search.select`."""

import numpy as np
from scipy.stats import chi2

from cable_envs.diagnosis.fit.likelihood import Judged, raw_residuals
from cable_envs.diagnosis.fit.refit import Fit
from cable_envs.diagnosis.model.hypotheses import Hypothesis
from cable_envs.diagnosis.model.model import Model, Whitener

BEYOND_DOUBT = 60.0
"""Fall of the deviance from which an effect's size is not its null, whatever the interval of its slope says."""
OUTLYING = 5.0
"""Standard deviations beyond which a held-out sample is no noise, whatever the model."""
AGAINST, AGAINST_SHARE = 4.0, 0.02
"""Rise of the held-out sum of squares that speaks against an effect: at least, and as a share of its gain."""
MOMENT = 0.5
"""Share of a gain that one sample may bring. Of 96 effects that were there none had more than 0.22 from one; where a
load sticks and slips, a spike in one sample gained 567 as friction (recordings that are spent for proofs)."""


def held_cost(model: Model, whitener: Whitener, fit: Fit) -> float:
    """Whitened sum of squares on another model's records; no sample counts for more than `OUTLYING` deviations.

    Where a load sticks and slips, a model is a sample early or late at times, and spikes of twice that are compared.
    """
    white = whitener.flat(model.blocks, raw_residuals(model, fit))
    return float(np.sum(np.minimum(white**2, OUTLYING**2)))


def bounded(hypothesis: Hypothesis, fit: Fit) -> list[str]:
    """Parameters of the hypothesis that ended on a bound; a size at its null is on none, nor one that is complete."""
    shape = [name for name in fit.at_bounds if name in hypothesis.names and name not in hypothesis.nulls]
    sizes = [] if hypothesis.complete else [n for n in fit.at_bounds if n in hypothesis.nulls]
    return shape + [n for n in sizes if fit.values[n] != hypothesis.nulls[n]]


def objection(hypothesis: Hypothesis, fit: Fit, heldout_gain: float, gain: float = 0.0) -> str:
    """Why a refitted hypothesis is not accepted; empty if nothing speaks against it.

    gain: fall of the deviance that it brings. Beyond `BEYOND_DOUBT` the null is out by the likelihood ratio, and an
    interval that holds it is a slope's that means little: of a lag of a fraction of a control step, say.
    """
    if heldout_gain < -max(AGAINST, AGAINST_SHARE * gain):
        return f"it does not improve the held-out records (change of the sum of squares {-heldout_gain:+.1f})"
    stuck = bounded(hypothesis, fit)
    if stuck:
        return f"{', '.join(stuck)} ended on a bound"
    sizes = [fit.free.index(name) for name in hypothesis.nulls]
    off = np.array([fit.values[name] - null for name, null in hypothesis.nulls.items()])
    inside = float(off @ np.linalg.pinv(fit.covariance[np.ix_(sizes, sizes)], hermitian=True) @ off)
    # of all sizes together: two that do nearly the same are each unsure
    if gain > BEYOND_DOUBT or inside > chi2.ppf(0.95, len(sizes)):
        return ""
    return "its 95 % interval holds the null"


def unstable(fit: Fit, hypothesis: Hypothesis) -> str:
    """Block resampling to first order: parts of the record that show the effect may not give it another sign.

    The samples are cut into eight; a part's own estimate of the leading size counts where the part shows it at all.
    """
    sizes = [fit.free.index(n) for n in hypothesis.nulls]
    nulls, now = list(hypothesis.nulls.values()), [fit.values[fit.free[k]] for k in sizes]
    errors = [max(float(np.sqrt(fit.covariance[k, k])), 1e-300) for k in sizes]
    lead = int(np.argmax([abs(v - n) / e for v, n, e in zip(now, nulls, errors, strict=True)]))
    column, against = fit.jacobian[:, sizes[lead]], 0.0
    total = float(column @ column)
    for rows in np.array_split(np.arange(len(fit.residual)), 8):
        weight = float(column[rows] @ column[rows])
        if weight < 0.02 * total:
            continue
        own = now[lead] + float(column[rows] @ fit.residual[rows]) / weight
        if (own - nulls[lead]) * (now[lead] - nulls[lead]) < 0.0:
            against += weight / total
    return "" if against <= 0.25 else "single parts of the record do not agree on its size"


def momentary(model: Model, base: Judged, judged: Judged) -> str:
    """Whether a single sample brings the gain: events that a simulator has a moment too late, by chance repaired."""
    before, after = (judged.whitener.flat(model.blocks, j.raw) ** 2 for j in (base, judged))
    gains = before - after
    largest, total = float(np.max(gains)), float(np.sum(gains))
    return "a single sample brings most of its gain" if largest > MOMENT * max(total, 0.0) else ""
