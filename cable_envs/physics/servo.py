"""An ideal position servo: a drive of second order that no cable pushes back."""

from cable_envs.core.kernels import clip, inline
from cable_envs.physics.friction import ringing_inertia


@inline
def placed(position, speed, target, rate, stiffness, damping, most, limit, dt):
    """Speed after a step of a drive whose servo goes to a target, within its limits.

        x'' = w^2 (target - x) + 2 z w (rate - x')

    Linearly implicit at the middle of the step: of order 2, stable for any step; its swing is in time to order 4
    (`cable_envs.physics.friction.ringing_step`).

    Parameters
    ----------
    position, speed : float
        Of the drive, m or rad, and per second.
    target, rate : float
        Where the servo is to go, and the speed of that.
    stiffness, damping : float
        w^2, 1/s^2, and 2 z w, 1/s.
    most, limit : float
        Largest acceleration and speed.
    dt : float
        Length of the step, s.

    Returns
    -------
    float
        Speed behind the step.

    Examples
    --------
    >>> round(placed(0.0, 0.0, 1.0, 0.0, 100.0, 20.0, 1e9, 1e9, 1e-6) / 1e-6, 2)  # acceleration of a step at rest
    100.0
    """
    half = 0.5 * dt
    asked = stiffness * (target - position - half * speed) + damping * (rate - speed)
    asked = asked / ringing_inertia(1.0, damping, stiffness, dt)
    return clip(speed + dt * clip(asked, -most, most), -limit, limit)


@inline
def placing(position, speed, target, rate, stiffness, damping, most):
    """Acceleration of that servo in continuous time, within its largest; arguments as of `placed`.

    Examples
    --------
    >>> placing(0.0, 0.0, 1.0, 0.0, 100.0, 20.0, 1e9), placing(0.0, 0.0, 1.0, 0.0, 100.0, 20.0, 30.0)
    (100.0, 30.0)
    """
    return clip(stiffness * (target - position) + damping * (rate - speed), -most, most)
