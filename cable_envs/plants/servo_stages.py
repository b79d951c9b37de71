"""Scalar pieces of a drive with a motor: encoder, servo, motor, and its motion against what the cables pull.

`cable_envs.plants.servo` has the equations and the parameters. A drive turns (rad, N m), or moves along the cable (m,
N): in what follows *angle*, *torque* and *inertia* are those of its own coordinate. ``gear_ratio`` is the motor's
turning, rad, for one unit of that: N of a gear, N / r with a spool of radius r, 2 pi N / lead with a screw.
"""

from collections import namedtuple

from cable_envs.core.kernels import clip, inline, maximum, minimum, select, sine_cosine
from cable_envs.physics.friction import ringing_step
from cable_envs.physics.motor import behind_gear, current_range, shown

Shown = namedtuple(
    "Shown",
    [
        "encoder_angle",
        "encoder_velocity",
        "motor_current",
        "motor_torque",
        "servo_torque",
        "servo_integral",
        "servo_age",
    ],
)
"""Rows of one drive with a motor, whatever its coordinate is called."""

SHOWN = Shown._fields


@inline
def drive_of(x, k):
    """Rows of drive k of a plant that has several, as what follows knows those of a plant with one."""
    return Shown(
        x.encoder_angle[k], x.encoder_velocity[k], x.motor_current[k], x.motor_torque[k], x.servo_torque[k],
        x.servo_integral[k], x.servo_age[k],
    )  # fmt: skip


@inline
def servo_reads(x, p, i, at, speed, by_torque, target, target_rate, dt):
    """The encoder's next reading if it is due, and what the servo then asks for.

    ``target`` is the angle that it is to hold, or the torque where ``by_torque``. A reading shows the angle at the
    instant at which it was due; what lies between that and the present step is less than a step.
    """
    age, period, limit = x.servo_age[i], p.encoder_period[i], p.servo_limit[i]
    due = age >= period * (1.0 - 1e-9)
    late = select(due, clip(age - period, 0.0, period), 0.0)
    angle = shown(at - late * speed, p.encoder_steps[i])
    share = period / (period + p.servo_filter[i])
    rate = x.encoder_velocity[i] + share * ((angle - x.encoder_angle[i]) / period - x.encoder_velocity[i])
    error = target - angle
    apart = p.servo_kp[i] * error + p.servo_kd[i] * (target_rate - rate)
    grown = x.servo_integral[i] + period * p.servo_ki[i] * error
    old, passes = x.servo_integral[i], clip(apart + grown, -limit, limit) - apart
    integral = clip(passes, minimum(old, grown), maximum(old, grown))
    asked = clip(select(by_torque, target, apart + integral), -limit, limit)
    x.servo_torque[i] = select(due | by_torque, asked, x.servo_torque[i])
    x.servo_integral[i] = select(due & (not by_torque), clip(integral, -limit, limit), x.servo_integral[i])
    x.encoder_angle[i] = select(due, angle, x.encoder_angle[i])
    x.encoder_velocity[i] = select(due, rate, x.encoder_velocity[i])
    x.servo_age[i] = select(due, late, age) + dt


@inline
def motor_torques(x, p, i, at, speed, dt):
    """(torque driving forward, backward, cogging, damping) of the drive at the middle of the step.

    What the gear takes of the power is a friction too: at rest it holds anything between the first two.
    """
    ratio, constant = p.gear_ratio[i], p.torque_constant[i]
    least, most = current_range(constant * ratio * speed, p.resistance[i], p.supply_voltage[i], p.current_limit[i])
    current = clip(x.servo_torque[i] / (constant * ratio), least, most)
    x.motor_current[i] = current
    # a voltage that is used up brakes like a damper
    braked = select((current <= least) | (current >= most), constant * ratio * constant * ratio / p.resistance[i], 0.0)
    braked = select(abs(current) < p.current_limit[i], braked, 0.0)
    cogging = p.cogging_torque[i] * sine_cosine(p.cogging_turns[i] * (at + 0.5 * dt * speed))[0]
    return geared(x, p, i, 1.0), geared(x, p, i, -1.0), cogging, p.moved_damping[i] + braked


@inline
def geared(x, p, i, way):
    """Torque of the motor behind its gear when the drive moves forward (1) or backward (-1)."""
    return behind_gear(p.torque_constant[i] * x.motor_current[i], way, p.gear_ratio[i], p.gear_efficiency[i])


@inline
def motor_shows(x, p, i, new, against):
    """The torque of the motor that goes with the new speed; at rest it holds what is against it."""
    forward, backward = geared(x, p, i, 1.0), geared(x, p, i, -1.0)
    held = clip(against, forward, backward)
    x.motor_torque[i] = select(new > 0.0, forward, select(new < 0.0, backward, held))


@inline
def balanced(p, i, speed, forward, backward, cogging, own, pull, stiffness, damping, dt):
    """(speed after dt, how far short of its mean) of a drive with those `motor_torques`, against what the cables take.

    ``pull`` is that in the middle of the step if the drive keeps its speed and the load goes on, ``stiffness`` and
    ``damping`` are its slopes.
    """
    net = 0.5 * dt * stiffness * speed - pull - cogging - p.moved_damping[i] * speed
    rest, friction = own + damping, p.drive_friction[i]
    up, down = net + forward - friction, net + backward + friction
    return ringing_step(speed, p.moved_inertia[i], up, down, stiffness, rest, rest, dt)


@inline
def felt_share(p, i, speed, forward, backward, cogging, own, lead, gap, dt):
    """Share of a step in which a drive with those `motor_torques` feels the cables behind a gap of the width ``gap``.

    It is ``lead`` ahead of the middle of its nut. A nut that is held by its friction holds the cables as well: while
    the drive crosses to an edge it feels nothing of them. How much of the step that is follows from where it would go
    without them.
    """
    free, missed = balanced(p, i, speed, forward, backward, cogging, own, 0.0, 0.0, 0.0, dt)
    way = 0.5 * dt * (speed + clip(free, -p.top_speed[i], p.top_speed[i])) - missed
    left = maximum(0.5 * gap - select(way < 0.0, -lead, lead), 0.0)
    return 1.0 - select(gap > 0.0, minimum(left / maximum(abs(way), 1e-300), 1.0), 0.0)


@inline
def motor_step(x, p, i, at, speed, pull, stiffness, damping, dt):
    """Speed of the drive after dt, and how far it falls short of its mean speed where it stops, as of `balanced`."""
    forward, backward, cogging, own = motor_torques(x, p, i, at, speed, dt)
    new, short = balanced(p, i, speed, forward, backward, cogging, own, pull, stiffness, damping, dt)
    motor_shows(x, p, i, new, pull + cogging)
    return clip(new, -p.top_speed[i], p.top_speed[i]), short


@inline
def motor_step_in_gap(x, p, i, at, speed, pull, stiffness, damping, lead, gap, dt):
    """`motor_step` of a drive that moves in a gap, as of `felt_share`."""
    forward, backward, cogging, own = motor_torques(x, p, i, at, speed, dt)
    felt = felt_share(p, i, speed, forward, backward, cogging, own, lead, gap, dt)
    pull, stiffness, damping = felt * pull, felt * stiffness, felt * damping
    new, short = balanced(p, i, speed, forward, backward, cogging, own, pull, stiffness, damping, dt)
    motor_shows(x, p, i, new, pull + cogging)
    return clip(new, -p.top_speed[i], p.top_speed[i]), short


@inline
def turned(x, p, u, g, i, torque, stiffness, damping, dt):
    """`motor_step` of a turning drive, in the place of `circuit.ends.drive_step`; the command is angle or torque."""
    at, speed = x.drive_angle[i], x.drive_velocity[i]
    servo_reads(x, p, i, at, speed, u.mode[i] > 0.5, u.command[i], u.command_rate[i], dt)
    new, short = motor_step(x, p, i, at, speed, torque, stiffness, damping, dt)
    if g is not None:
        new = select(g.follows[i] > 0.5, g.target_rate[i], new)
    return new, short
