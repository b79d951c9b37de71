"""A measurement comes late.

A force that is seen d late looks like viscous friction at one frequency w: of a mass m that moves as sin(w t) it is
-m w^2 sin(w t - w d), which is m a cos(w d) + m w sin(w d) v. Motions of several frequencies tell the two apart.
"""

import numpy as np

from cable_envs.core.kernels import inline, maximum
from cable_envs.effects.base import Effect, EffectParameter

EFFECT = Effect(
    name="sensor_delay",
    seam="sense",
    equation="y(t) = x(t - delay), interpolated linearly between control steps",
    source="Smith, Chem. Eng. Prog. 53 (1957) 217: dead time",
    parameters=(EffectParameter("signal", "s", 0.0, 0.0, 1.0, "delay of this sensor", 0.02),),
    validity="whole and fractional control steps; until the delay has passed, the sensor shows the first value",
    experiment="Command a chirp, and a step that two sensors see. A delay shifts the step, and a lag smears it",
    confusable=("actuator_lag", "viscous_friction"),
    each_sensor=True,
)


@inline
def seen_at(step, late):
    """(last sample before, share of the way to the next one) of what is seen at a step, ``late`` steps late.

    Before the first sample, number 0, it is the first.
    """
    at = maximum(step - late, 0.0)
    before = int(at)
    return before, at - before


@inline
def between(before, after, part):
    """The value at the share ``part`` of the straight line from one sample to the next."""
    return before + part * (after - before)


def delayed(series: np.ndarray, late: np.ndarray | float) -> np.ndarray:
    """A record of samples as a sensor with this delay shows it: `seen_at` and `between` for all samples at once.

    Parameters
    ----------
    series : ndarray, shape (T,) or (T, n)
        Samples at equal distances.
    late : float or ndarray, shape (n,)
        The delay in samples, not below 0.

    Returns
    -------
    ndarray
        Of the same shape.

    Examples
    --------
    >>> delayed(np.array([1.0, 3.0, 5.0, 5.0]), 0.5)
    array([1., 2., 4., 5.])
    """
    columns = series[:, None] if series.ndim == 1 else series
    at = np.maximum(np.arange(len(columns))[:, None] - late, 0.0)
    before, k = at.astype(int), np.arange(columns.shape[1])
    after = np.minimum(before + 1, len(columns) - 1)
    found = columns[before, k] + (at - before) * (columns[after, k] - columns[before, k])
    return found.reshape(series.shape)
