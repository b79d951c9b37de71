"""Where a recorded effort does not say what it did between two samples: what that may have moved of an observed drive.

A controller of 1 kHz whose reference turns a corner steps its effort at an instant that nobody recorded. The step J may
have been anywhere in the period P between two samples: the impulse is uncertain by J P / sqrt(12). Our servo forgets
what that makes of the motion, but not while friction holds the carriage. It is no stationary noise: learnt as one it
would hide what all other samples tell, and a refit would follow it (`cable_envs.diagnosis.search.known.sure_samples`).
"""

import numpy as np

from cable_envs.diagnosis.model.noise import jitter
from cable_envs.diagnosis.systems.common import Sampled


def unsure(
    effort: Sampled, channel: Sampled, moving: np.ndarray, period: float, answer: tuple[complex, complex]
) -> np.ndarray:
    """Samples [T] of a channel that steps of the effort may have moved by more than the noise of both.

    A step shows as 2 J in the third difference; what the noise of T samples makes there is below sqrt(2 ln T) standard
    deviations.

    Parameters
    ----------
    effort, channel : Sampled
        As recorded [T].
    moving : ndarray
        Whether the carriage moves [T].
    period : float
        s between two samples.
    answer : (complex, complex)
        (size a, pole p) of what an impulse of one unit of effort does to the channel: the real part of a exp(p t).
    """
    count, (size, pole) = len(effort.values), answer
    own, noise = (jitter(s.values[s.good], s.reading.as_one) for s in (effort, channel))
    third = np.diff(effort.values, 3, prepend=effort.values[[0, 0]], append=effort.values[-1])
    steps = np.where(np.abs(third) > own * np.sqrt(40.0 * np.log(count)), 0.5 * third, 0.0)
    added = abs(size) ** 2 * (steps * period) ** 2 / 12.0
    kept = np.where(moving, np.exp(2.0 * pole.real * period), 1.0)
    power, made = 0.0, np.empty(count)
    for k in range(count):
        power = kept[k] * power + added[k]
        made[k] = power
    impulse = (size * np.exp(pole * period * np.arange(1, count + 1))).real
    return made > noise**2 + (own * period) ** 2 * float(impulse @ impulse)
