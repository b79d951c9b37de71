"""How sure an answer is, in one place: the calibration's numbers are here and nowhere else.

A named effect is wrong where another hypothesis would have fitted better but for the noise. The deviance of the best
rival less its own, ``margin``, is twice the logarithm of the likelihood ratio, so exp(-margin / 2) is the odds of the
rival (Burnham, Anderson, Model Selection and Multimodel Inference, 2002, ch. 2: Akaike weights of two models). The same
of the gain over no effect at all. What is left beyond noise says that no hypothesis is quite right.
"""

import numpy as np

from cable_envs.core.intervals import NORMAL_95, normal_interval
from cable_envs.diagnosis.fit.refit import Fit

MOST = 0.88
"""No answer that unseen records judge is surer: 56 of 63 effects were right on the recordings that first calibrated."""
STATED, COLOURED, FAINT, SECOND = 0.95, 0.9, 0.85, 0.85
"""The same where noise judges: its size is stated; it is learnt, colour and all; learnt, and the gain is below `CLEAR`;
of two effects at once. Of effects named on the recordings of two proofs (seeds 41 and 43 of its generator, each with
the tool of its time) 132 of 137, 72 of 78, 46 of 54 and 32 of 38 were right. A larger margin over the rivals does not
make an answer surer: what goes wrong is the formulation, not the noise. The next proof needs another seed."""
CLEAR = 100.0
RIVAL, NOISE, LEFT = 2.0, 2.0, 3.0
"""Scales: of the margin, of the gain beyond what was asked for, and of the share that is left."""


def highest(stated: bool, effects: int, gain: float) -> float:
    """The most that is claimed of one of ``effects`` that gained so much; stated: the noise's size is."""
    if effects > 1:
        return SECOND
    if stated:
        return STATED
    return COLOURED if gain >= CLEAR else FAINT


def confidence(margin: float, gain: float, asked: float, left: float, most: float = MOST) -> float:
    """Probability, ``most`` at the most, that an effect, or one of its declared alternatives, is there.

    margin, gain: falls of the deviance against the best rival that is no alternative, and against no effect; asked:
    the least gain that is accepted; left: excess of what is left over that gain, 0 where it is noise.
    """
    rival = 1.0 - 0.5 * np.exp(-max(margin, 0.0) / RIVAL)
    noise = 1.0 - 0.5 * np.exp(-max(gain - asked, 0.0) / NOISE)
    return float(min(most, rival * noise * np.exp(-LEFT * max(left, 0.0))))


WIDER, FORM = 1.4, 0.04
"""Of the standard error, and of the size: what another integrator and another formulation of the same physics change,
as found on recordings that no proof uses."""


def interval(fit: Fit, name: str, null: float = 0.0, gain: float = 0.0) -> tuple[float, float]:
    """95 % interval of a parameter: its standard error under the noise, with what the formulation may be off.

    null: the value from which its size is counted. gain: fall of the deviance that its size brings, beside which a
    standard error that reaches to the null means nothing: the size over the root of the gain stands for it then
    (the signed root of the likelihood ratio; Barndorff-Nielsen, Cox, Inference and Asymptotics, 1994, ch. 4).
    """
    value = fit.values[name]
    low, high = fit.interval(name, 1.0)
    error = 0.5 * (high - low)
    if gain > 0.0 and NORMAL_95 * WIDER * error > abs(value - null):
        error = min(error, abs(value - null) / float(np.sqrt(gain)))
    return normal_interval(value, float(np.hypot(WIDER * error, FORM * (value - null)))).ends
