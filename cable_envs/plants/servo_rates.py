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
from itertools import chain
from typing import Any

from cable_envs.core.kernels import clip
from cable_envs.plants.continuous import Equations, Values, along, limited, rubbed
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


def with_motors(
    ideal: Equations, value: Values, closed: bool, drives: tuple[str, ...] = ("{}_{}",), force: str = "force"
) -> Equations:
    """The equations of a plant with motors in the place of its ideal drives.

    Parameters
    ----------
    ideal : Equations
        With the ideal drives, and the law of those with motors: (state, rows, *ways) -> (rates, outputs), where the
        states of the servos, currents and torques of the motors and the directions of the drives come last.
    value : mapping of str to float
        Every parameter of the rig.
    closed : bool
        Whether the commands go to servos; else they are the torques.
    drives : tuple of str
        Pattern of the names of each drive's signals, as of `cable_envs.plants.servo.servo_signals`.
    force : str
        What their torque is called.

    Returns
    -------
    Equations
        Of the plant with the motors.

    Examples
    --------
    >>> from cable_envs.plants.continuous import Equations
    >>> ideal = Equations(("drive_velocity",), (), (), lambda state, rows, *ways: ((), ()), "drive_velocity")
    >>> motor = with_motors(ideal, {"servo_filter": 0.0}, True, ("{}_{}",), "torque")
    >>> motor.states, motor.outputs, motor.slides
    (('drive_velocity', 'servo_integral'), ('motor_current', 'motor_torque'), ('drive_velocity',))
    """
    servos = [
        servo_states(value, of.format("servo", "integral"), of.format("encoder", "velocity")) for of in drives if closed
    ]
    shown = [(of.format("motor", "current"), of.format("motor", force)) for of in drives]
    return replace(
        ideal, states=(*ideal.states, *chain.from_iterable(servos)),
        outputs=(*ideal.outputs, *chain.from_iterable(shown)),
        slides=(*ideal.slides, *(of.format("drive", "velocity") for of in drives)),
    )  # fmt: skip
