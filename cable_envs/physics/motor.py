"""A DC motor behind a gear: what current it can take, what torque comes out, and what its encoder shows.

symbol | meaning | unit
------ | ------- | ----
i      | current of the motor | A
k_t    | torque constant, which is that of the back-EMF too | N m/A
R, R_s | resistance of the winding, and of the supply with its leads | ohm
U      | voltage of the supply without load | V
N, eta | ratio and efficiency of the gear | 1
w      | speed behind the gear | rad/s

The current follows its command at once: the winding's time constant L / R, below a millisecond, is shorter than every
motion of a cable. At full duty the bridge puts the supply's voltage on the motor, U - R_s i = R i + k_t N w.
"""

from cable_envs.core.kernels import inline, maximum, minimum, select

_ROUND = 6755399441055744.0
"""1.5 * 2**52: the sum of this and a number below 2**51 is rounded to a whole number."""


@inline
def current_range(emf, resistance, voltage, limit):
    """(least, most) current, A: what the voltage drives through the resistances, within the limit of the amplifier.

    emf in V; resistance is R + R_s in ohm; voltage U in V; limit in A.

    Examples
    --------
    12 V across 4 ohm would drive 3 A; the back-EMF of 8 V leaves 1 A.

    >>> current_range(8.0, 4.0, 12.0, 2.0)
    (-2.0, 1.0)
    """
    least, most = (-voltage - emf) / resistance, (voltage - emf) / resistance
    return minimum(maximum(least, -limit), limit), maximum(minimum(most, limit), -limit)


@inline
def driven_current(duty, emf, resistance, supply, voltage, limit):
    """Current, A, that a bridge drives with a ``duty`` in [-1, 1]; R of the winding and R_s of the supply in ohm.

    The supply is in the circuit for the share |duty| of each period, and else the current runs on through the winding:
    duty U - k_t N w = i (R + R_s |duty|). The winding's time constant is taken as long against the bridge's period.

    Examples
    --------
    Half of 12 V less the back-EMF of 2 V, across 3 ohm and half of 2 ohm.

    >>> driven_current(0.5, 2.0, 3.0, 2.0, 12.0, 10.0)
    1.0
    """
    return minimum(maximum((duty * voltage - emf) / (resistance + supply * abs(duty)), -limit), limit)


@inline
def behind_gear(torque, speed, ratio, efficiency):
    """Torque behind the gear, N m: it loses a share of the power, whichever way that flows.

    Examples
    --------
    >>> behind_gear(0.1, 2.0, 10.0, 0.8), behind_gear(-0.1, 2.0, 10.0, 0.8)
    (0.8, -1.25)
    """
    return ratio * torque * select(torque * speed < 0.0, 1.0 / efficiency, efficiency)


@inline
def shown(angle, steps):
    """The angle that an encoder of so many steps in a radian shows, rad; ``angle`` where it has none (0).

    Examples
    --------
    >>> shown(0.26, 10.0), shown(0.24, 10.0), shown(0.26, 0.0)
    (0.3, 0.2, 0.26)
    """
    some = select(steps > 0.0, steps, 1.0)
    return select(steps > 0.0, ((angle * some + _ROUND) - _ROUND) / some, angle)
