"""The cable through one hole in continuous time.

    x'    = v_d   speed mode: the command;   tension mode: G35 with the tension's rate from the span itself, solved:
                  v_d (1 + kp c + kd k) = kp (F - k (x - y) + c y') + kd (F' + k y');   slack: v_d = kp F + kd F'
    m y'' = T2 - m g - k_l y - c_l y' + disturbance,   T2 = T1 / n sliding up, T1 n sliding down, in between at rest

With a motor the drive is that of `cable_envs.plants.servo_rates`: told its force in tension mode; in speed mode the
servo's reference moves on with the command, no further ahead than the saturator's force over the servo's gain.

The drive keeps its speed limit. Its acceleration limit is not in the equations: the drive is as fast as its command.
"""

from dataclasses import replace

from cable_envs.core.errors import ConfigurationError
from cable_envs.core.kernels import clip, maximum, select
from cable_envs.physics.contact import extrusion_coefficient, tension_ratio, wrap_in_contact
from cable_envs.plants.base import ActionMode, Plant, Signal
from cable_envs.plants.continuous import Equations, Rows, Values, along, confined, driven, engaged, rubbed
from cable_envs.plants.hole.stages import span, transmitted
from cable_envs.plants.servo_rates import hauled, served, with_motor

PASSES = 8
"""Of the wrap in contact, which depends on the tension behind the hole (G1): each leaves a few percent of the error."""


def _hauled(p, u, x, y, v):
    """Speed of the drive in the closed loop of G35."""
    k, c, kp, kd = p.cable_stiffness[0], p.cable_damping[0], p.inner_kp[0], p.inner_kd[0]
    wanted = kp * u.command[0] + kd * u.command_rate[0]
    loop = (wanted - kp * k * (x - y) + (kp * c + kd * k) * v) / (1.0 + kp * c + kd * k)
    return engaged(k * (x - y) + c * (loop - v), loop, wanted)


def _behind(p, v, way, above, resist):
    """Tension behind the hole.  G1, G9, G17, G28."""
    extruded = extrusion_coefficient(p.extrusion_gain[0], p.extrusion_exponent[0], along(v, way))
    friction, whole, rho = p.friction_coefficient[0, 0] + extruded, p.wrap_angle[0, 0], p.radius_ratio[0, 0]
    rigidity, edge = p.bending_rigidity[0], p.edge_radius[0, 0]
    behind = resist
    for _ in range(PASSES if rigidity > 0.0 else 1):
        wrap = wrap_in_contact(whole, rigidity, edge, above, behind) if rigidity > 0.0 else whole
        n = tension_ratio(rho, friction, wrap)
        behind = transmitted(way, above, n, 1.0 / n, resist)
    return behind


def _carried(rows: Rows, x, drive, y, v, way):
    """(tension above the hole, behind it, acceleration of the load)."""
    p, u = rows.p, rows.u
    above = span(p.cable_stiffness[0], p.cable_damping[0], x - y, drive - v)
    resist = p.load_weight[0] + p.load_stiffness[0] * y + p.load_damping[0] * v - u.disturbance[0]
    behind = _behind(p, v, way, above, resist)
    return above, behind, rubbed(behind - resist, 0.0, 0.0, way) / p.load_mass[0]


def _law(state, rows: Rows, way):
    x, y, v = state
    p, u = rows.p, rows.u
    asked = select(u.mode[0] > 0.5, u.command[0], _hauled(p, u, x, y, v))
    drive = clip(asked, -p.speed_limit[0], p.speed_limit[0])
    above, behind, faster = _carried(rows, x, drive, y, v, way)
    return (drive, v, faster), (x, drive, above, y, v, behind)


def _motor_law(state, rows: Rows, way, drive_way):
    x, v_d, y, v, *servo = state
    p, d, asked = rows.p, rows.x, rows.u.command[0]
    above, behind, faster = _carried(rows, x, v_d, y, v, way)
    rates = ()
    if servo:
        target, *servo = servo
        pace, leash = clip(asked, -p.speed_limit[0], p.speed_limit[0]), p.servo_limit[0] / maximum(p.servo_kp[0], 1e-9)
        onward = confined(pace, target, x - leash, x + leash, v_d, v_d)
        asked, others = served(p, x, v_d, target, pace, servo)
        rates = (onward, *others)
    hauled_on = hauled(d, p, x, v_d, drive_way, asked, above)
    shown = (x, v_d, above, y, v, behind, d.motor_current[0], d.motor_torque[0])
    return (v_d, hauled_on, v, faster, *rates), shown


def equations(plant: Plant, mode: ActionMode, value: Values) -> Equations:
    """The equations of one hole; ConfigurationError for several in series."""
    if "wrap_angle_2" in plant.parameters:
        raise ConfigurationError("holes in series have no equations in continuous time; a single hole has")
    ideal = Equations(
        states=("drive_position", "load_position", "load_velocity"),
        inputs=driven(
            mode,
            mode.name == "tension" and plant.drive == "ideal",
            Signal("disturbance", "N", "force that lifts the load"),
        ),
        outputs=(
            "drive_position", "drive_velocity", "drive_tension", "load_position", "load_velocity", "load_tension",
        ),
        law=_law,
        place="load_position",
        slides=("load_velocity",),
        slack={span: ""},
    )  # fmt: skip
    if plant.drive == "ideal":
        return ideal
    moving = replace(ideal, states=("drive_position", "drive_velocity", "load_position", "load_velocity"))
    motor = with_motor(moving, _motor_law, value, mode.name == "speed")
    if mode.name == "tension":
        return motor
    return replace(motor, states=(*moving.states, "servo_target", *motor.states[len(moving.states) :]))
