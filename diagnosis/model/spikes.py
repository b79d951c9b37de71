"""Single samples that no motion makes: a bit that fell over on the way, an electrical disturbance."""

import numpy as np

from cable_envs.diagnosis.model.noise import jitter

SMOOTH = 0.3
"""Share of a spike by which what is about it may change from sample to sample."""
FAR = 6.0
"""Standard deviations of the channel's white noise by which a spike stands out from both its neighbours."""


def spikes(values: np.ndarray, good: np.ndarray, step: float = 0.0) -> np.ndarray:
    """Which samples stand out from both neighbours to one side, while these agree, and those beyond them too.

    At a cusp, where a sensor turns a sign round or a friction lets go, the neighbours go on as they came.

    Parameters
    ----------
    values : ndarray, shape (T,)
        Samples on an even clock.
    good : ndarray of bool, shape (T,)
        Which of them count.
    step : float
        Of the sensor's readings; 0: that of the samples.

    Returns
    -------
    ndarray of bool, shape (T,)
        True at spikes.
    """
    found = np.zeros(len(values), dtype=bool)
    if good.sum() < 100:
        return found
    least = FAR * jitter(values[good], step)
    before, after = values[1:-1] - values[:-2], values[1:-1] - values[2:]
    out = np.minimum(np.abs(before), np.abs(after))
    alone = (before * after > 0.0) & (out > least) & (np.abs(before - after) < SMOOTH * out)
    steps = np.abs(np.diff(values))
    smooth = np.maximum(steps[:-3], steps[3:]) < SMOOTH * out[1:-1]
    found[2:-2] = alone[1:-1] & smooth & good[2:-2] & good[1:-3] & good[3:-1]
    return found
