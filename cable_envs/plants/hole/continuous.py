"""The cable through one hole in continuous time.

    x'    = v_d   speed mode: the command;   tension mode: G35 with the tension's rate from the span itself, solved:
                  v_d (1 + kp c + kd k) = kp (F - k (x - y) + c y') + kd (F' + k y');   slack: v_d = kp F + kd F'
    m y'' = T2 - m g - k_l y - c_l y' + disturbance,   T2 = T1 / n sliding up, T1 n sliding down, in between at rest

With a motor the drive is that of `cable_envs.plants.servo_rates`: told its force in tension mode; in speed mode the
servo's reference moves on with the command, no further ahead than the saturator's force over the servo's gain.

Several holes have the slips of `cable_envs.plants.hole.series_continuous` among their states. The ideal drive's loop is
solved with the first of them; a motor has its speed among the states, so that nothing else is implicit.

The drive keeps its speed limit. Its acceleration limit is not in the equations: the drive is as fast as its command.
"""

from dataclasses import replace

from cable_envs.core.kernels import clip, maximum, select
from cable_envs.physics.contact import extrusion_coefficient, tension_ratio, wrap_in_contact
from cable_envs.plants.base import ActionMode, Plant, Signal
from cable_envs.plants.continuous import Equations, Rows, Values, along, confined, driven, engaged, rubbed
from cable_envs.plants.hole.series_continuous import slid, slips, taut
from cable_envs.plants.hole.stages import span, transmitted
from cable_envs.plants.servo_rates import hauled, served, with_motors

PASSES = 8
"""Of the wrap in contact, which depends on the tension behind the hole (G1): each leaves a few percent of the error."""


def _hauled(p, u, x, y, v):
    """Speed of the drive in the closed loop of G35."""
    k, c, kp, kd = p.cable_stiffness[0], p.cable_damping[0], p.inner_kp[0], p.inner_kd[0]
    wanted = kp * u.command[0] + kd * u.command_rate[0]
    loop = (wanted - kp * k * (x - y) + (kp * c + kd * k) * v) / (1.0 + kp * c + kd * k)
    return engaged(k * (x - y) + c * (loop - v), loop, wanted)


def _behind(p, v, way, above, resist, hole=0):
    """Tension behind the last hole.  G1, G9, G17, G28."""
    extruded = extrusion_coefficient(p.extrusion_gain[0], p.extrusion_exponent[0], along(v, way))
    friction, whole, rho = p.friction_coefficient[hole, 0] + extruded, p.wrap_angle[hole, 0], p.radius_ratio[hole, 0]
    rigidity, edge = p.bending_rigidity[0], p.edge_radius[hole, 0]
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
    above, behind, faster = _carried(rows, x, v_d, y, v, way)
    hauls, rates, motor = _driven(rows, x, v_d, above, drive_way, servo)
    return (v_d, hauls, v, faster, *rates), (x, v_d, above, y, v, behind, *motor)


def _driven(rows: Rows, x, v_d, above, drive_way, servo):
    """(acceleration of a drive with a motor, rates of its servo, what the motor shows)."""
    p, d, asked, rates = rows.p, rows.x, rows.u.command[0], ()
    if servo:
        target, *servo = servo
        pace, leash = clip(asked, -p.speed_limit[0], p.speed_limit[0]), p.servo_limit[0] / maximum(p.servo_kp[0], 1e-9)
        onward = confined(pace, target, x - leash, x + leash, v_d, v_d)
        asked, others = served(p, x, v_d, target, pace, servo)
        rates = (onward, *others)
    hauls = hauled(d, p, x, v_d, drive_way, asked, above)
    return hauls, rates, (d.motor_current[0], d.motor_torque[0])


def _first(p, stretch, drive):
    """Tension of the span above the first hole while the drive moves and nothing slips."""
    return select(stretch > 0.0, p.cable_stiffness[0] * stretch + p.cable_damping[0] * drive, 0.0)


def _series_load(rows: Rows, tensions, y, v, way):
    """(tension behind the last hole, acceleration of the load)."""
    p, u = rows.p, rows.u
    resist = p.load_weight[0] + p.load_stiffness[0] * y + p.load_damping[0] * v - u.disturbance[0]
    behind = _behind(p, v, way, tensions[-1], resist, len(tensions))
    return behind, rubbed(behind - resist, 0.0, 0.0, way) / p.load_mass[0]


def _series_law(state, rows: Rows, way):
    x, y, v, *places = state
    p, u, stretch, limit = rows.p, rows.u, state[0] - places[0], rows.p.speed_limit[0]
    k, c = p.cable_stiffness[0], p.cable_damping[0]
    told = clip(u.command[0], -limit, limit)
    free = _hauled(p, u, x, places[0], 0.0)  # in the closed loop it follows the slip, but for a share of 1 - follows
    follows = select(stretch > 0.0, _hauled(p, u, x, places[0], 1.0) - free, 0.0)
    _, slid = slips(rows, places, y, _first(p, stretch, free), c * (1.0 - follows))
    asked = free + follows * slid[0]
    limited_drive = select(u.mode[0] > 0.5, told, clip(asked, -limit, limit))
    tensions, stiff = slips(rows, places, y, _first(p, stretch, limited_drive), c)
    open_loop = (u.mode[0] > 0.5) | (abs(asked) > limit)
    speeds = [select(open_loop, stiff[0], slid[0]), *stiff[1:]]
    above = span(k, c, stretch, limited_drive - speeds[0])
    behind, faster = _series_load(rows, tensions, y, v, way)
    return (limited_drive, v, faster, *speeds), (x, limited_drive, above, y, v, behind)


def _series_motor_law(state, rows: Rows, way, drive_way):
    p, holes = rows.p, len(rows.p.wrap_angle)
    (x, v_d, y, v), places, servo = state[:4], state[4 : 3 + holes], state[3 + holes :]
    k, c, stretch = p.cable_stiffness[0], p.cable_damping[0], x - places[0]
    tensions, speeds = slips(rows, places, y, _first(p, stretch, v_d), c)
    above = span(k, c, stretch, v_d - speeds[0])
    behind, faster = _series_load(rows, tensions, y, v, way)
    hauls, rates, motor = _driven(rows, x, v_d, above, drive_way, servo)
    return (v_d, hauls, v, faster, *speeds, *rates), (x, v_d, above, y, v, behind, *motor)


def _in_series(one: Equations, plant: Plant) -> Equations:
    """The equations of several holes."""
    places = tuple(s.name for s in plant.signals if s.name.startswith("slip_position"))
    x, y, begin = one.states.index("drive_position"), one.states.index("load_position"), len(one.states)
    end = begin + len(places)

    def verge(state, rows: Rows, way, *_):
        return (*state[:begin], *slid(rows.p, state[x], state[begin:end], state[y], way), *state[end:])

    return replace(
        one, states=(*one.states, *places), law=_series_law if plant.drive == "ideal" else _series_motor_law,
        slack={span: "", taut: ""}, verge=verge, stiff=True,
    )  # fmt: skip


def equations(plant: Plant, mode: ActionMode, value: Values) -> Equations:
    """The equations of one hole, or of several in series."""
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
    if plant.drive != "ideal":
        ideal = replace(
            ideal, states=("drive_position", "drive_velocity", "load_position", "load_velocity"), law=_motor_law
        )
    if "wrap_angle_2" in plant.parameters:
        ideal = _in_series(ideal, plant)
    if plant.drive == "ideal":
        return ideal
    motor, moving = with_motors(ideal, value, mode.name == "speed"), len(ideal.states)
    if mode.name == "tension":
        return motor
    return replace(motor, states=(*ideal.states, "servo_target", *motor.states[moving:]))
