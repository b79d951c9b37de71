"""How long a step of integration may be for a mode of motion: a mass on a spring and a damper."""

import numpy as np

TURN = 0.25
"""Most that a vibration may turn in a step, rad. A cable that becomes taut within a step is noticed late and pushes too
hard, by up to the square of this over four of the energy; trapezoidal steps are then 1 % late in a turn."""

COUPLED = 0.35
"""Share of such a step for mechanisms whose ends feel each other's change of speed at the end of the step only: their
vibrations are in time to order 2, not 4."""

DECAY = 1.0
"""Most decay times that a step may last."""


def longest_step(mass, damping, stiffness):
    """Longest step that follows the faster root of m s^2 + c s + k = 0.

    Parameters
    ----------
    mass : ndarray, shape (n,)
        Inertia, kg or kg m^2, above 0.
    damping : ndarray, shape (n,)
        Damping, N s/m or N m s.
    stiffness : ndarray, shape (n,)
        Stiffness, N/m or N m.

    Returns
    -------
    ndarray, shape (n,)
        Seconds; infinite where nothing moves by itself. In a step the mode turns by `TURN` and decays `DECAY` times at
        most.

    Examples
    --------
    5 kg on a cable of 60 kN/m turn at 109.5 rad/s.

    >>> round(float(longest_step(5.0, 0.0, 60e3)), 6)
    0.002282
    """
    half, square = np.asarray(damping / (2.0 * mass), float), np.asarray(stiffness / mass, float)
    turning = np.sqrt(np.maximum(square - half**2, 0.0))
    size = half + np.sqrt(np.maximum(half**2 - square, 0.0))
    size = np.where(turning > 0.0, np.sqrt(square), size)
    with np.errstate(divide="ignore"):
        return np.minimum(DECAY / size, TURN / turning)
