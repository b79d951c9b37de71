"""A drive hauls an elastic cable through one or more holes in series; a load hangs, or is held by a spring.

Gu et al. 2024 (equations G), with the reading of docs/physics.md: friction is directional, rho = R / r.

    drive      accelerates within its limits towards a commanded speed, or towards the speed of the inner tension
               loop  v = kp (F - T1) + kd (F' - T1')                                                            G35
    cable      T1 = max(0, k (x - y) + c (x' - y')): the span between drive and hole; slack carries nothing
    hole       T2 = T1 / n sliding up, T1 n sliding down, in between at rest;  n = lambda(rho0 (1 + delta),
               mu + K |v|^omega, theta_e)                                                          G1, G9, G17, G28
    load       m y'' = T2 - m g - k_l y - c_l y' + disturbance, rigidly behind the last hole (v = y')          G28

Holes in series (the paper's future work): between two holes the cable is a spring again and its slip through the
earlier hole is a state of its own, with the lumped mass of the cable there (``guide_mass``). Every hole is the same
contact, every slip the same `stick_slip_step`.

Signs: x > 0 hauls in, y > 0 lifts. SI units throughout.
"""

import math
from functools import cache

import numpy as np

from cable_envs.contact import extrusion_coefficient, tension_ratio_and_slope, wrap_in_contact
from cable_envs.errors import ConfigurationError
from cable_envs.friction import stick_slip_step
from cable_envs.kernels import LANES, clip, inline, jit, load, maximum, select, sign, store, tile
from cable_envs.params import Parameter, ParameterTable
from cable_envs.plants.base import COMMAND, COMMAND_RATE, DISTURBANCE, INPUTS, MODE, ActionMode, Plant, Signal

MAX_HOLES = 4

_TABLE_1 = "Table 2 / A1, Gu 2024"
_LUMPED = "chosen: 1000 rad/s, above every motion of interest"

PARAMETERS = ParameterTable(
    Parameter("load_mass", "kg", 5.0, 1e-3, 1e4, "mass of the load", "inferred from the tension ranges of 5.3"),
    Parameter("gravity", "m/s^2", 9.81, 0.0, 30.0, "gravitational acceleration"),
    Parameter("load_gravity", "1", 1.0, 0.0, 1.0, "share of gravity along the cable: 1 hanging, 0 horizontal"),
    Parameter("load_stiffness", "N/m", 0.0, 0.0, 1e7, "spring between load and ground, relaxed at y = 0"),
    Parameter("load_damping", "N s/m", 0.0, 0.0, 1e5, "viscous damping of the load"),
    Parameter("cable_stiffness", "N/m", 60e3, 1.0, 1e9, "EA / L of the span between drive and hole"),
    Parameter("cable_damping", "N s/m", 100.0, 0.0, 1e6, "viscous damping of that span"),
    Parameter("wrap_angle", "rad", math.pi / 3, 0.0, 4 * math.pi, "wrap of the cable in the hole", "5.3, Gu 2024"),
    Parameter("radius_ratio", "1", 1.5, 1e-3, 1e6, "rho0 = hole radius / cable radius", "inferred, docs/physics.md"),
    Parameter("cable_radius", "m", 1e-3, 1e-6, 0.1, "cable radius r"),
    Parameter("bending_rigidity", "N m^2", 0.0, 0.0, 10.0, "flexural rigidity B of the cable, G1"),
    Parameter("friction_coefficient", "1", 0.43, 0.0, 5.0, "Coulomb coefficient mu", _TABLE_1),
    Parameter("extrusion_delta", "1", 0.02, -0.5, 1.0, "change of the radius ratio by extrusion, delta", _TABLE_1),
    Parameter("extrusion_gain", "SI", 6574.0, 0.0, 1e7, "K in C = K v^omega", _TABLE_1),
    Parameter("extrusion_exponent", "1", 2.03, 0.2, 10.0, "omega in C = K v^omega", _TABLE_1),
    Parameter("drive_speed_limit", "m/s", 0.1, 1e-6, 10.0, "largest drive speed"),
    Parameter("drive_acceleration_limit", "m/s^2", 2.0, 1e-6, 1e3, "largest drive acceleration"),
    Parameter("inner_kp", "m/(s N)", 0.1, 0.0, 100.0, "proportional gain of the inner tension loop", "Table 3, Gu 2024"),
    Parameter("inner_kd", "m/N", 0.005, 0.0, 100.0, "derivative gain of the inner tension loop", "Table 3, Gu 2024"),
    Parameter("tension_command_limit", "N", 120.0, 1e-3, 1e5, "largest driving tension that can be commanded"),
    Parameter("tension_limit", "N", 100.0, 1e-3, 1e6, "safety limit", "range of the tension sensor, 5.1, Gu 2024"),
    Parameter("breaking_tension", "N", 1000.0, 1e-3, 1e7, "the cable tears above this tension"),
)

_EXTRA_HOLE = ("wrap_angle", "radius_ratio", "friction_coefficient")


def _series_parameters(holes: int) -> ParameterTable:
    extra = [
        Parameter(f"{q.name}_{h}", q.unit, q.default, q.low, q.high, f"{q.meaning}, hole {h} (from the drive)", q.source)
        for h in range(2, holes + 1)
        for q in (PARAMETERS[name] for name in _EXTRA_HOLE)
    ]
    if holes > 1:
        extra.append(Parameter("span_stiffness", "N/m", 120e3, 1.0, 1e9, "EA / L of a span between two holes"))
        extra.append(Parameter("guide_mass", "kg", 0.02, 1e-6, 1e3, "lumped cable mass at an inner hole", _LUMPED))
    return ParameterTable(*PARAMETERS, *extra)


_SIGNALS = (
    Signal("drive_position", "m", "position of the drive, positive hauls in"),
    Signal("drive_velocity", "m/s", "speed of the drive"),
    Signal("drive_tension", "N", "cable tension on the drive side, T1"),
    Signal("load_position", "m", "position of the load, positive lifted"),
    Signal("load_velocity", "m/s", "speed of the load"),
    Signal("load_tension", "N", "cable tension on the load side, T2"),
    Signal("sliding", "1", "direction in which the cable slides at the load: -1, 0 (stuck), 1"),
    Signal("slack_fraction", "1", "share of the last control step in which the drive span was slack"),
    Signal("peak_tension", "N", "largest drive-side tension within the last control step"),
)

_p = PARAMETERS.index
MASS, GRAVITY, GRAVITY_SHARE, LOAD_K, LOAD_C = (
    _p(n) for n in ("load_mass", "gravity", "load_gravity", "load_stiffness", "load_damping")
)
K_CABLE, C_CABLE, WRAP, RHO0, RADIUS, BENDING = (
    _p(n) for n in ("cable_stiffness", "cable_damping", "wrap_angle", "radius_ratio", "cable_radius", "bending_rigidity")
)
MU, DELTA, GAIN, OMEGA = (
    _p(n) for n in ("friction_coefficient", "extrusion_delta", "extrusion_gain", "extrusion_exponent")
)
V_MAX, A_MAX, KP, KD = (_p(n) for n in ("drive_speed_limit", "drive_acceleration_limit", "inner_kp", "inner_kd"))
BASE_P = len(PARAMETERS)
X, VX, T1, Y, VY, T2, SLIDING, SLACK, PEAK = range(len(_SIGNALS))
BASE_X = len(_SIGNALS)
MAX_P, MAX_X, N_INPUTS = BASE_P + 3 * (MAX_HOLES - 1) + 2, BASE_X + 3 * (MAX_HOLES - 1), len(INPUTS)


@inline
def _ratio(speed, p, i, wrap, rho, mu, tension_a, tension_b):
    """(n, dn/d|v|) of one hole at sliding speed |v|.  G17 with the exact solution of section 1."""
    radius = p[RHO0, i] * p[RADIUS, i]
    contact = wrap_in_contact(wrap, p[BENDING, i], radius, tension_a, tension_b)
    c = extrusion_coefficient(p[GAIN, i], p[OMEGA, i], speed)
    n, slope = tension_ratio_and_slope(rho * (1.0 + p[DELTA, i]), mu + c, contact)
    return n, slope * p[OMEGA, i] * c / maximum(speed, 1e-12)


@inline
def _span(stiffness, damping, stretch, rate):
    """Tension of an elastic span; nothing when slack."""
    return select(stretch > 0.0, maximum(stiffness * stretch + damping * rate, 0.0), 0.0)


@inline
def _drive(x, p, u, i, v_cable, dt):
    """Drive speed after dt, within its speed and acceleration limits.  G35 in tension mode.

    The loop is closed on the tension half a step ahead and its derivative is the span's own, so that the algebraic
    loop through the cable's stiffness is solved and not sampled.
    """
    k = select(x[T1, i] > 0.0, p[K_CABLE, i], 0.0)
    closed = 1.0 + (p[KD, i] + 0.5 * dt * p[KP, i]) * k
    wanted = p[KP, i] * (u[COMMAND, i] - x[T1, i]) + p[KD, i] * u[COMMAND_RATE, i]
    loop = (wanted + (p[KD, i] + 0.5 * dt * p[KP, i]) * k * v_cable) / closed
    target = select(u[MODE, i] > 0.5, u[COMMAND, i], loop)
    target = clip(target, -p[V_MAX, i], p[V_MAX, i])
    change = p[A_MAX, i] * dt
    return x[VX, i] + clip(target - x[VX, i], -change, change)


@inline
def _slip(v, mass, upstream, resist, n, slope, k_up, k_down, c_up, c_down, dt):
    """One slip through a hole: upstream tension against what the cable or load behind it resists with."""
    inv_n = 1.0 / n
    up, down = upstream * inv_n - resist, upstream * n - resist
    stiffness = k_down + k_up * select(select(v == 0.0, up, v) > 0.0, inv_n, n)
    damping_up = c_down + (c_up + upstream * slope * inv_n) * inv_n
    damping_down = c_down + c_up * n + upstream * slope
    return stick_slip_step(v, mass, up, down, stiffness, damping_up, damping_down, dt)


@inline
def _transmitted(v, upstream, n, resist):
    """Tension behind a hole: on the friction limit when sliding, what keeps the balance when stuck."""
    low, high = upstream / n, upstream * n
    return select(v > 0.0, low, select(v < 0.0, high, clip(resist, low, high)))


@inline
def _load_resistance(p, u, i, y, v):
    weight = p[MASS, i] * p[GRAVITY, i] * p[GRAVITY_SHARE, i]
    return weight + p[LOAD_K, i] * y + p[LOAD_C, i] * v - u[DISTURBANCE, i]


@inline
def _record(x, i, tension, share):
    x[SLACK, i] += select(tension <= 0.0, share, 0.0)
    x[PEAK, i] = maximum(x[PEAK, i], tension)


@inline
def _substep(x, p, u, i, dt, share):
    """One hole."""
    y, v = x[Y, i], x[VY, i]
    vx = _drive(x, p, u, i, v, dt)
    dx = 0.5 * dt * (x[VX, i] + vx)
    k, c = p[K_CABLE, i], p[C_CABLE, i]
    middle = _span(k, c, x[X, i] + 0.5 * dx - y, 0.5 * (x[VX, i] + vx) - v)
    taut = select(middle > 0.0, 1.0, 0.0)
    n, slope = _ratio(abs(v), p, i, p[WRAP, i], p[RHO0, i], p[MU, i], middle, x[T2, i])
    resist = _load_resistance(p, u, i, y, v)
    v_new = _slip(
        v, p[MASS, i], middle, resist, n, slope, taut * k, p[LOAD_K, i], taut * c, p[LOAD_C, i], dt
    )
    y_new = y + 0.5 * dt * (v + v_new)
    tension = _span(k, c, x[X, i] + dx - y_new, vx - v_new)
    x[X, i] += dx
    x[VX, i] = vx
    x[Y, i] = y_new
    x[VY, i] = v_new
    x[T1, i] = tension
    x[T2, i] = _transmitted(v_new, tension, n, _load_resistance(p, u, i, y_new, v_new))
    x[SLIDING, i] = sign(v_new)
    _record(x, i, tension, share)


@inline
def _substep_series(x, p, u, i, dt, share, holes):
    """Several holes: slips are solved from the drive to the load, each with the newest state upstream."""
    spans, mass = BASE_P + 3 * (holes - 1), p[BASE_P + 3 * (holes - 1) + 1, i]
    vx = _drive(x, p, u, i, x[BASE_X + 1, i], dt)
    dx = 0.5 * dt * (x[VX, i] + vx)
    k, c = p[K_CABLE, i], p[C_CABLE, i]
    up_old, up_new, vup = x[X, i], x[X, i] + dx, 0.5 * (x[VX, i] + vx)
    x[X, i], x[VX, i] = up_new, vx
    for h in range(holes):
        last = h == holes - 1
        row = Y if last else BASE_X + 3 * h
        s, v = x[row, i], x[row + 1, i]
        middle = _span(k, c, 0.5 * (up_old + up_new) - s, vup - v)
        taut = select(middle > 0.0, 1.0, 0.0)
        wrap = p[WRAP, i] if h == 0 else p[BASE_P + 3 * (h - 1), i]
        rho = p[RHO0, i] if h == 0 else p[BASE_P + 3 * (h - 1) + 1, i]
        mu = p[MU, i] if h == 0 else p[BASE_P + 3 * (h - 1) + 2, i]
        n, slope = _ratio(abs(v), p, i, wrap, rho, mu, middle, x[row + 2, i])
        if last:
            resist = _load_resistance(p, u, i, s, v)
            behind_k, behind_c, inertia = p[LOAD_K, i], p[LOAD_C, i], p[MASS, i]
        else:
            following = Y if h == holes - 2 else BASE_X + 3 * (h + 1)
            resist = _span(p[spans, i], 0.0, s - x[following, i], 0.0)
            behind_k, behind_c, inertia = select(resist > 0.0, p[spans, i], 0.0), 0.0, mass
        v_new = _slip(v, inertia, middle, resist, n, slope, taut * k, behind_k, taut * c, behind_c, dt)
        s_new = s + 0.5 * dt * (v + v_new)
        tension = _span(k, c, up_new - s_new, 2.0 * vup - x[row + 1, i] - v_new if h else vx - v_new)
        x[row, i], x[row + 1, i] = s_new, v_new
        if h == 0:
            x[T1, i] = tension
            _record(x, i, tension, share)
        after = _load_resistance(p, u, i, s_new, v_new) if last else resist
        x[row + 2, i] = _transmitted(v_new, tension, n, after)
        up_old, up_new, vup = s, s_new, 0.5 * (v + v_new)
        k, c = p[spans, i], 0.0
    x[SLIDING, i] = sign(x[VY, i])


@jit
def advance(x, p, u, lo, hi, substeps, dt):
    """Move columns lo..hi by ``substeps`` steps of dt seconds, in place."""
    holes = 1 + (x.shape[0] - BASE_X) // 3
    share = 1.0 / substeps
    xt, pt, ut = tile(MAX_X), tile(MAX_P), tile(N_INPUTS)
    for first in range(lo, hi, LANES):
        lanes = min(LANES, hi - first)
        load(xt, x, first, lanes)
        load(pt, p, first, lanes)
        load(ut, u, first, lanes)
        for i in range(lanes):
            xt[SLACK, i] = 0.0
            xt[PEAK, i] = 0.0
        for _ in range(substeps):
            if holes == 1:
                for i in range(lanes):
                    _substep(xt, pt, ut, i, dt, share)
            else:
                for i in range(lanes):
                    _substep_series(xt, pt, ut, i, dt, share, holes)
        store(xt, x, first, lanes)


def prepare(values: np.ndarray) -> np.ndarray:
    """The kernel reads the declared parameters as they are; checks what single bounds cannot."""
    weight = values[MASS] * values[GRAVITY] * values[GRAVITY_SHARE]
    if np.any((weight == 0.0) & (values[LOAD_K] == 0.0)):
        raise ConfigurationError("the load is free: give it load_gravity > 0 or load_stiffness > 0")
    if np.any(values[_p("breaking_tension")] < values[_p("tension_limit")]):
        raise ConfigurationError("breaking_tension must not be below tension_limit")
    return np.ascontiguousarray(values, dtype=np.float64)


def rest(p: np.ndarray, position: np.ndarray) -> np.ndarray:
    """Signals [len(signals), n] of mechanisms at rest with the load at ``position`` (m, [n]); equal tensions."""
    holes = 1 + (p.shape[0] - BASE_P) // 3
    x = np.zeros((BASE_X + 3 * (holes - 1), p.shape[1]))
    tension = np.maximum(p[MASS] * p[GRAVITY] * p[GRAVITY_SHARE] + p[LOAD_K] * position, 0.0)
    x[Y] = position
    x[T1] = x[T2] = x[PEAK] = tension
    s = np.array(position, dtype=np.float64)
    for h in reversed(range(holes - 1)):
        s = s + tension / p[BASE_P + 3 * (holes - 1)]
        x[BASE_X + 3 * h], x[BASE_X + 3 * h + 2] = s, tension
    x[X] = s + tension / p[K_CABLE]
    return x


@cache
def cable_hole(holes: int = 1) -> Plant:
    """The plant with ``holes`` holes in series (1 to 4)."""
    if not 1 <= holes <= MAX_HOLES:
        raise ConfigurationError(f"holes = {holes} is outside [1, {MAX_HOLES}]")
    parameters = _series_parameters(holes)
    inner = tuple(
        Signal(f"{name}_{h}", unit, f"{meaning} hole {h}")
        for h in range(1, holes)
        for name, unit, meaning in (
            ("slip_position", "m", "cable paid through"),
            ("slip_velocity", "m/s", "sliding speed in"),
            ("span_tension", "N", "tension behind"),
        )
    )
    return Plant(
        name="cable_hole",
        parameters=parameters,
        coefficients=parameters.names,
        signals=_SIGNALS + inner,
        action_modes=(
            ActionMode("tension", "N", "tension_command_limit", one_sided=True, rest_signal="drive_tension"),
            ActionMode("speed", "m/s", "drive_speed_limit"),
        ),
        prepare=prepare,
        rest=rest,
        advance=advance,
    )


PLANT = cable_hole()
