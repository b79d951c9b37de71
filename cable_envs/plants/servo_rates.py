"""A drive with a motor in continuous time: its servo and its acceleration, against what the cables pull.

    servo      torque = clip(kp (target - x) + kd (target' - x_f') + I),  I' = ki (target - x), not further into a limit
               x_f'' = (x' - x_f') / servo_filter
    motor      J x'' = torque behind the gear - pull - cogging - b x' - F sign(x'),  of a current that the supply drives

`cable_envs.plants.servo` has the symbols. The servo is that of `servo_stages.servo_reads` without its clock: the
encoder neither rounds nor waits. Told its torque, a drive has no servo, and its command goes through the saturator
only. What the gear takes of the power is a friction too.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from cable_envs.core.kernels import clip
from cable_envs.plants.continuous import Equations, Law, Values, along, limited, rubbed
from cable_envs.plants.servo_stages import motor_shows, motor_torques


def servo_states(value: Values, integral: str, velocity: str) -> tuple[str, ...]:
    """Signals that are states of a servo: its integral, and the speed that its filter shows where it has one."""
    return (integral, velocity) if value["servo_filter"] > 0.0 else (integral,)


def served(p, at, v, target, target_rate, servo: Sequence[Any]):
    """(torque that a servo asks for, rates of its states).

    Parameters
    ----------
    p : namedtuple
        Coefficients.
    at, v : float
        Angle and speed of the drive.
    target, target_rate : float
        Where the servo is to go, and the speed of that.
    servo : sequence of float
        Its states, as of `servo_states`.

    Returns
    -------
    torque : float
        Behind the saturator.
    rates : tuple of float
        Rates of the states.
    """
    integral, filtered = servo[0], servo[1:]
    seen, limit = filtered[0] if filtered else v, p.servo_limit[0]
    error = target - at
    asked = p.servo_kp[0] * error + p.servo_kd[0] * (target_rate - seen) + integral
    grows = limited(integral, limited(asked, p.servo_ki[0] * error, limit), limit)
    return clip(asked, -limit, limit), (grows, *((v - one) / p.servo_filter[0] for one in filtered))


def hauled(d, p, at, v, way, torque, pull):
    """Acceleration of a drive whose motor is asked for a torque, and which the cables pull back; ``d`` are its rows."""
    d.servo_torque[0] = clip(torque, -p.servo_limit[0], p.servo_limit[0])
    forward, backward, cogging, _ = motor_torques(d, p, 0, at, v, 0.0)
    friction = p.drive_friction[0]
    net = rubbed(-pull - cogging - p.moved_damping[0] * v, friction - forward, friction + backward, way)
    motor_shows(d, p, 0, along(v, way), pull + cogging)
    return limited(v, net / p.moved_inertia[0], p.top_speed[0])


def driven_by(d, p, u, at, v, way, pull, servo: Sequence[Any]):
    """(acceleration, rates of the servo's states) of a drive whose command is a place, or a torque without a servo."""
    torque, rates = served(p, at, v, u.command[0], u.command_rate[0], servo) if servo else (u.command[0], ())
    return hauled(d, p, at, v, way, torque, pull), rates


def with_motor(ideal: Equations, law: Law, value: Values, closed: bool, force: str = "force") -> Equations:
    """The equations of a plant with one drive, with a motor in the place of the ideal one.

    Parameters
    ----------
    ideal : Equations
        With the ideal drive.
    law : callable
        (state, rows, *ways) -> (rates, outputs), where the states of the servo, the current and the torque of the motor
        and the direction of the drive come last.
    value : mapping of str to float
        Every parameter of the rig.
    closed : bool
        Whether the command goes to a servo; else it is the torque.
    force : str
        What its torque is called.

    Returns
    -------
    Equations
        Of the plant with the motor.
    """
    servo = servo_states(value, "servo_integral", "encoder_velocity") if closed else ()
    return replace(
        ideal, states=(*ideal.states, *servo), outputs=(*ideal.outputs, "motor_current", f"motor_{force}"), law=law,
        slides=(*ideal.slides, "drive_velocity"),
    )  # fmt: skip
