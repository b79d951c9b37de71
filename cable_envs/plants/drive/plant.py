"""A one-axis drive: a motor pushes a carriage, rigidly or through a belt; the rig of drive benchmarks.

    rigid    (m + m_m) x'' = F - viscous x' - F_c sign(x') - m g share + disturbance
    belt     m_m x_m'' = F - b,  m x'' = b - viscous x' - F_c sign(x') - m g share + disturbance,
             b = k (x_m - x) + c (x_m' - x'),  a push as well as a pull; with a gap only what is left beyond it
    force    F = command, within force_limit; as voltage: F / force_per_volt
    servo    F = (m + m_m) (w^2 (command - x_m) + 2 z w (command_rate - x_m')), within force_limit

symbol | meaning | unit
------ | ------- | ----
x, x_m | position of the carriage and of the motor, at the carriage's scale | m
m, m_m | mass of the carriage; inertia of the motor, at the carriage's scale | kg
F, b   | force of the motor; force of the belt on the carriage | N

Linearly implicit trapezoidal steps with the forces at the predicted middle of the step, carriage and motor together:
order 2. Where the belt is rigid the motor is the carriage. One kernel: it has the effects always.
"""

import numpy as np

from cable_envs.core.errors import ConfigurationError
from cable_envs.core.kernels import LANES, clip, inline, jit, load, maximum, select, sign, store, tile
from cable_envs.core.params import Parameter, ParameterTable
from cable_envs.effects import Layout
from cable_envs.effects.actuator_lag import lagged
from cable_envs.effects.backlash import dead_zone
from cable_envs.effects.own import own_actuate, own_cable, own_load
from cable_envs.effects.position_ripple import wave
from cable_envs.effects.presliding_hysteresis import share
from cable_envs.effects.rows import (
    CREEP,
    CREEP_T,
    GAP,
    HARDENING,
    LAG,
    NEUTRAL,
    PERIOD,
    PHASE_ANGLE,
    PLAY,
    PLAYED,
    PRE_0,
    PRESLIDING,
    RIPPLE,
    ROWS_E,
    ROWS_S,
    SPRING,
    STARTED,
)  # fmt: skip
from cable_envs.effects.seams import (
    CREEP_LEFT,
    DOWN,
    FOLLOWS,
    IMPOSES,
    LAG_LEFT,
    ROWS_G,
    STEEP,
    TARGET,
    TARGET_V,
    UP,
    actuate,
    begin,
    dry_friction,
    end,
    presliding_step,
)  # fmt: skip
from cable_envs.effects.stiffness_hardening import hardened
from cable_envs.effects.viscoelastic_creep import crept
from cable_envs.physics.friction import crossing_step
from cable_envs.plants.base import (
    COMMAND,
    COMMAND_RATE,
    DISTURBANCE,
    INPUTS,
    MODE,
    OBSERVED,
    ActionMode,
    Plant,
    Signal,
)

_TYPICAL = "chosen: a small belt axis"

PARAMETERS = ParameterTable(
    Parameter("mass", "kg", 10.0, 1e-6, 1e5, "mass of the carriage with what it carries", _TYPICAL),
    Parameter("motor_mass", "kg", 1.0, 0.0, 1e5, "inertia of the motor at the carriage's scale", _TYPICAL),
    Parameter("belt_stiffness", "N/m", 0.0, 0.0, 1e9, "spring between motor and carriage; 0: rigid", "null"),
    Parameter("belt_damping", "N s/m", 50.0, 0.0, 1e6, "damping of that spring", _TYPICAL),
    Parameter("viscous", "N s/m", 20.0, 0.0, 1e5, "viscous friction of the carriage", _TYPICAL),
    Parameter("coulomb", "N", 5.0, 0.0, 1e4, "Coulomb friction of the carriage", _TYPICAL),
    Parameter("gravity", "m/s^2", 9.81, 0.0, 30.0, "gravitational acceleration"),
    Parameter("gravity_share", "1", 0.0, -1.0, 1.0, "share of gravity along the axis: 1 upright, 0 level", "null"),
    Parameter("force_limit", "N", 200.0, 1e-6, 1e6, "largest force of the motor", _TYPICAL),
    Parameter("force_per_volt", "N", 20.0, 1e-9, 1e6, "force of the motor for one volt", _TYPICAL),
    Parameter("position_limit", "m", 1.0, 1e-6, 1e3, "range of positions that a command may ask for", _TYPICAL),
    Parameter("servo_frequency", "rad/s", 40.0, 0.1, 1e3, "natural frequency of the position servo", _TYPICAL),
    Parameter("servo_damping_ratio", "1", 0.8, 0.0, 5.0, "damping ratio of the position servo", _TYPICAL),
    Parameter("tension_limit", "N", 500.0, 1e-3, 1e7, "force of the belt at which a run counts as unsafe", _TYPICAL),
    Parameter("breaking_tension", "N", 2000.0, 1e-3, 1e8, "force at which the belt tears", _TYPICAL),
)

SIGNALS = (
    Signal("position", "m", "position of the carriage"),
    Signal("velocity", "m/s", "speed of the carriage"),
    Signal("force", "N", "force of the motor"),
    Signal("voltage", "V", "force of the motor over force_per_volt"),
    Signal("motor_position", "m", "position of the motor, at the carriage's scale"),
    Signal("motor_velocity", "m/s", "speed of the motor"),
    Signal("belt_force", "N", "force of the belt on the carriage; where it is rigid, what it would be"),
    Signal("sliding", "1", "direction in which the carriage moves: -1, 0 (stuck), 1"),
    Signal("slack_fraction", "1", "0: a belt pushes and pulls"),
    Signal("peak_tension", "N", "largest size of the belt's force within the last control step"),
)
Y, V, F, VOLT, XM, VM, B, SLIDING, SLACK, PEAK = range(len(SIGNALS))

COEFFICIENTS = (
    "mass", "motor_mass", "belt_stiffness", "belt_damping", "viscous", "coulomb", "weight", "force_limit",
    "force_per_volt", "servo_stiffness", "servo_damping",
)  # fmt: skip
(MASS, MOTOR, BELT_K, BELT_C, VISCOUS, COULOMB, WEIGHT, LIMIT, PER_VOLT, SERVO_K, SERVO_D) = range(len(COEFFICIENTS))
ROWS_X, ROWS_P, ROWS_U = len(SIGNALS), len(COEFFICIENTS), len(INPUTS)
LAYOUT = Layout("linear_drive", PARAMETERS)
FORCE, RISE, ELASTIC, FORCE_LEFT, FORCE_LATE = range(ROWS_G, ROWS_G + 5)
ALL_G = ROWS_G + 5
LAGGED, BEFORE = PLAY, PLAYED
"""Of an observed drive: the force behind its lag and the speed a step before, in rows that a drive does not use."""
STEP_Y, STEP_V = 1e-7, 1e-6
"""Steps of the differences that give the slopes of a user's own load, m and m/s."""


@inline
def _motor_force(p, u, i, x, v):
    """(force, stiffness, damping) of the motor at a position and speed; none of the latter two at its limit."""
    servo, observed = u[MODE, i] > 0.5, u[MODE, i] > OBSERVED - 0.5
    wanted = p[SERVO_K, i] * (u[COMMAND, i] - x) + p[SERVO_D, i] * (u[COMMAND_RATE, i] - v)
    wanted = select(observed, wanted + u[DISTURBANCE, i], wanted)
    force = clip(select(servo, wanted, u[COMMAND, i]), -p[LIMIT, i], p[LIMIT, i])
    free = servo & (abs(wanted) < p[LIMIT, i])
    return force, select(free, p[SERVO_K, i], 0.0), select(free, p[SERVO_D, i], 0.0)


@inline
def _observed_force(p, u, s, g, i, y, v, half):
    """Force of an observed drive in the middle of a step, behind the amplifier's lag; moves the lag on.

    The speed there goes on as it did in the step before: the servo is soft enough for that.
    """
    going = s[STARTED, i] > 0.5
    ahead = select(going, 0.5 * (v - s[BEFORE, i]), 0.0)
    s[BEFORE, i] = v
    wanted, _, _ = _motor_force(p, u, i, y + half * (v + 0.5 * ahead), v + ahead)
    late = select(going, s[LAGGED, i], wanted)
    s[LAGGED, i] = lagged(late, wanted, g[FORCE_LEFT, i])
    return select(g[FORCE_LEFT, i] > 0.0, wanted + (late - wanted) * g[FORCE_LATE, i], wanted)


@inline
def _belt(p, e, s, g, i, stretch, rate):
    """(force, stiffness, damping) of the belt."""
    taken = dead_zone(stretch, e[GAP, i]) - s[CREEP_T, i]
    pull, rise = hardened(p[BELT_K, i] * abs(taken), e[HARDENING, i])
    pull = own_cable(pull, e, i)
    g[ELASTIC, i] = taken
    touching = (e[GAP, i] <= 0.0) | (abs(stretch) > 0.5 * e[GAP, i])
    c = select(touching, p[BELT_C, i], 0.0)
    return select(taken < 0.0, -pull, pull) + c * rate, select(touching, p[BELT_K, i] * rise, 0.0), c


@inline
def _load(p, u, e, i, y, v):
    """(force that resists besides dry friction, its stiffness, its damping)."""
    ripple, steep = wave(y, e[RIPPLE, i], e[PERIOD, i], e[PHASE_ANGLE, i])
    at = own_load(y, v, 0.0, e, i)
    k = (own_load(y + STEP_Y, v, 0.0, e, i) - at) / STEP_Y
    c = (own_load(y, v + STEP_V, 0.0, e, i) - at) / STEP_V
    push = select(u[MODE, i] > OBSERVED - 0.5, 0.0, u[DISTURBANCE, i])
    resist = p[WEIGHT, i] + p[VISCOUS, i] * v + e[SPRING, i] * (y - e[NEUTRAL, i]) - ripple + at - push
    return resist, e[SPRING, i] + maximum(-steep, 0.0) + maximum(k, 0.0), p[VISCOUS, i] + maximum(c, 0.0)


@inline
def _slide(p, e, s, g, i, v, mass, drive, resist, stiffness, damping, dt):
    """Speed of the carriage after dt under the net of drive and resistance and its dry friction."""
    dry_friction(e, g, i, v, p[COULOMB, i], 0.0)
    up, down = drive - resist - g[UP, i], drive - resist + g[DOWN, i]
    falling = maximum(damping + g[STEEP, i], -mass / dt)
    sliding = crossing_step(v, mass, up, down, stiffness, falling, dt)
    bent = presliding_step(e, s, i, v, mass, up, down, stiffness, 0.0, falling, falling, dt)
    return select(e[PRESLIDING, i] > 0.0, bent, sliding)


@inline
def _step(x, p, u, e, s, g, i, dt):
    y, v, xm, vm = x[Y, i], x[V, i], x[XM, i], x[VM, i]
    rigid = p[BELT_K, i] <= 0.0
    follows, half = g[FOLLOWS, i] > 0.5, 0.5 * dt
    # behind a belt both are solved together: its force in the middle of the step is pull + grip (change of vm - of v)
    observed = u[MODE, i] > OBSERVED - 0.5
    pushed = _observed_force(p, u, s, g, i, y, v, half)
    force, k, c = _motor_force(p, u, i, xm + half * vm, vm)
    force, k, c = select(observed, pushed, force), select(observed, 0.0, k), select(observed, 0.0, c)
    pull, belt_k, belt_c = _belt(p, e, s, g, i, xm + half * vm - (y + half * v), vm - v)
    grip = half * (belt_c + half * belt_k)
    inertia = maximum(p[MOTOR, i], 1e-9) + dt * grip + half * (c + half * k)
    alone = select(follows, g[TARGET_V, i] - vm, dt * (force - pull) / inertia)
    along = select(follows, 0.0, dt * grip / inertia)
    # one body, or the carriage
    direct, k, c = _motor_force(p, u, i, y + half * v, v)
    direct, k, c = select(observed, pushed, direct), select(observed, 0.0, k), select(observed, 0.0, c)
    resist, load_k, load_c = _load(p, u, e, i, y + half * v, v)
    elastic = g[ELASTIC, i]
    drive = select(rigid, direct, pull + grip * alone)
    stiff = load_k + select(rigid, k, 0.0)
    damp = load_c + select(rigid, c, 2.0 * grip * (1.0 - along))
    mass = select(rigid, p[MASS, i] + p[MOTOR, i], p[MASS, i])
    ahead = half * stiff * v  # these forces are those of the middle already
    v_new = _slide(p, e, s, g, i, v, mass, drive + ahead, resist, stiff, damp, dt)
    v_new = select(rigid & follows, g[TARGET_V, i], v_new)
    vm_new = vm + alone + along * (v_new - v)
    xm_new = select(follows, g[TARGET, i], xm + half * (vm + vm_new))
    y_new = select(rigid & follows, g[TARGET, i], y + half * (v + v_new))
    s[CREEP_T, i] = select(rigid, 0.0, crept(s[CREEP_T, i], e[CREEP, i], elastic, g[CREEP_LEFT, i]))
    x[Y, i], x[V, i], x[SLIDING, i] = y_new, v_new, sign(v_new)
    x[XM, i], x[VM, i] = select(rigid, y_new, xm_new), select(rigid, v_new, vm_new)
    _report(x, p, u, e, s, g, i, v, v_new, dt)


@inline
def _report(x, p, u, e, s, g, i, v, v_new, dt):
    """Forces of the new state. A path that is followed: the force that it takes."""
    rigid = p[BELT_K, i] <= 0.0
    observed = u[MODE, i] > OBSERVED - 0.5
    force, _, _ = _motor_force(p, u, i, select(observed, x[Y, i], x[XM, i]), select(observed, x[V, i], x[VM, i]))
    pull, _, _ = _belt(p, e, s, g, i, x[XM, i] - x[Y, i], x[VM, i] - x[V, i])
    resist, _, _ = _load(p, u, e, i, x[Y, i], x[V, i])
    friction = select(v_new > 0.0, g[UP, i], select(v_new < 0.0, -g[DOWN, i], 0.0))
    turned = share(s, PRE_0, i)
    friction = select(e[PRESLIDING, i] > 0.0, turned * (g[UP, i] + g[DOWN, i]) - g[DOWN, i], friction)
    faster = (v_new - v) / dt
    needed = resist + friction + p[MASS, i] * faster
    pull = select(rigid, select(g[FOLLOWS, i] > 0.5, needed, force - p[MOTOR, i] * faster), pull)
    behind = select(rigid, needed + p[MOTOR, i] * faster, pull + p[MOTOR, i] * (x[VM, i] - g[FORCE, i]) / dt)
    force = select(g[FOLLOWS, i] > 0.5, behind, force)
    x[F, i], x[VOLT, i], x[B, i] = force, force / p[PER_VOLT, i], pull
    x[PEAK, i] = maximum(x[PEAK, i], abs(pull))


@inline
def _substeps(x, p, u, e, s, g, lanes, substeps, dt):
    for i in range(lanes):
        begin(e, s, g, u, i, x[XM, i], x[VM, i], x[Y, i], x[V, i], substeps * dt, dt)
        u[MODE, i] = select(g[IMPOSES, i] > 0.5, 0.0, u[MODE, i])
        observed = u[MODE, i] > OBSERVED - 0.5  # the amplifier is behind its servo, not before it
        g[FORCE_LEFT, i] = g[LAG_LEFT, i]
        g[FORCE_LATE, i] = (1.0 - g[LAG_LEFT, i]) * e[LAG, i] / dt  # mean share of the old force over a step
        g[LAG_LEFT, i] = select(observed, 0.0, g[LAG_LEFT, i])
        x[SLACK, i], x[PEAK, i] = 0.0, 0.0
    for n in range(substeps):
        for i in range(lanes):
            actuate(e, s, g, u, i, n, substeps, dt)
            u[COMMAND, i] = own_actuate(u[COMMAND, i], e, i)
        for i in range(lanes):
            g[FORCE, i] = x[VM, i]  # the motor's speed before the step
            _step(x, p, u, e, s, g, i, dt)
            s[STARTED, i] = 1.0
    for i in range(lanes):
        end(e, s, g, i, x[Y, i], substeps * dt)


@jit
def advance(x, p, u, lo, hi, substeps, dt):
    """Move columns lo..hi by ``substeps`` steps of dt seconds, in place; x and p have the rows of the effects."""
    xt, pt, ut = tile(ROWS_X), tile(ROWS_P), tile(ROWS_U)
    et, st, gt = tile(ROWS_E), tile(ROWS_S), tile(ALL_G)
    for first in range(lo, hi, LANES):
        lanes = min(LANES, hi - first)
        load(xt, x[:ROWS_X], first, lanes)
        load(pt, p[:ROWS_P], first, lanes)
        load(ut, u, first, lanes)
        load(et, p[ROWS_P : ROWS_P + ROWS_E], first, lanes)
        load(st, x[ROWS_X:], first, lanes)
        _substeps(xt, pt, ut, et, st, gt, lanes, substeps, dt)
        store(xt, x[:ROWS_X], first, lanes)
        store(st, x[ROWS_X:], first, lanes)


advance_with_effects = advance


def prepare(values: np.ndarray) -> np.ndarray:
    """Coefficient rows, effects and all, of parameter columns [len(PARAMETERS), n] or [len(PLANT.table), n]."""
    n = values.shape[1]
    effects = values[len(PARAMETERS) :] if len(values) > len(PARAMETERS) else np.repeat(LAYOUT.null[:, None], n, axis=1)
    row = {name: values[k] for k, name in enumerate(PARAMETERS.names)}
    if np.any(row["breaking_tension"] < row["tension_limit"]):
        raise ConfigurationError("breaking_tension must not be below tension_limit")
    if np.any((row["belt_stiffness"] > 0.0) & (row["motor_mass"] <= 0.0)):
        raise ConfigurationError("a belt (belt_stiffness above 0) needs a motor with inertia: motor_mass above 0")
    e = LAYOUT.coefficients(effects)
    belt = {"backlash.gap": GAP, "viscoelastic_creep.share": CREEP, "stiffness_hardening.coefficient": HARDENING}
    for name, k in belt.items():
        if np.any((e[k] > 0.0) & (row["belt_stiffness"] <= 0.0)):
            raise ConfigurationError(f"{name} needs a belt: belt_stiffness above 0")
    total = row["mass"] + row["motor_mass"]
    own = np.array([
        row["mass"], row["motor_mass"], row["belt_stiffness"], row["belt_damping"], row["viscous"], row["coulomb"],
        row["mass"] * row["gravity"] * row["gravity_share"], row["force_limit"], row["force_per_volt"],
        total * row["servo_frequency"] ** 2, 2.0 * total * row["servo_damping_ratio"] * row["servo_frequency"],
    ])  # fmt: skip
    return np.ascontiguousarray(np.concatenate([own, e]))


def rest(p: np.ndarray, position: np.ndarray) -> np.ndarray:
    """Signals [len(SIGNALS) + ROWS_S, n] at rest with the carriage at ``position`` (m, [n]), its weight held."""
    position, e = np.asarray(position, dtype=np.float64), p[ROWS_P:]
    x = np.zeros((ROWS_X + ROWS_S, p.shape[1]))
    ripple = e[RIPPLE] * np.sin(2.0 * np.pi * position / e[PERIOD] + e[PHASE_ANGLE])
    force = p[WEIGHT] + e[SPRING] * (position - e[NEUTRAL]) - ripple
    size = 2.0 * np.abs(force) / (1.0 + np.sqrt(1.0 + 2.0 * e[HARDENING] * np.abs(force)))
    belt = p[BELT_K] > 0.0
    stretch = np.where(belt, np.sign(force) * size / np.where(belt, p[BELT_K], 1.0), 0.0)
    x[Y], x[F], x[VOLT], x[B], x[PEAK] = position, force, force / p[PER_VOLT], force, np.abs(force)
    x[ROWS_X + CREEP_T] = e[CREEP] * stretch
    x[XM] = position + stretch * (1.0 + e[CREEP]) + np.where(belt, 0.5 * e[GAP] * np.sign(force), 0.0)
    return x


PLANT = Plant(
    name="linear_drive",
    parameters=PARAMETERS,
    coefficients=COEFFICIENTS,
    signals=SIGNALS,
    action_modes=(
        ActionMode("force", "N", "force_limit", rest_signal="force"),
        ActionMode("position", "m", "position_limit", rest_signal="motor_position"),
    ),
    prepare=prepare,
    rest=rest,
    kernels=(advance, advance_with_effects),
    effects=LAYOUT,
)
