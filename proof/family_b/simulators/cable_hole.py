"""Generator B's load on a cable through a hole: the tension ratio as a set-valued law on the velocity level.

    m v' = T2 - m g - k_l y - c_l v - F_c Sgn(v) + ...
    T2 in [T1 / n, T1 n]:  T1 / n where v > 0,  T1 n where v < 0,  what keeps the load at rest in between
    n = lambda(rho, M, theta),  M = mu + K |v|^omega                      (docs/physics.md, "The hole")

The speed of the load behind a step is solved exactly from its two sides (Moreau's time stepping), so that it rests
where it rests. Positions move by the mean of the speeds, forces act at the predicted middle of the step. The drive is
told a speed, and either goes from tick to tick in straight lines or holds each command for a number of ticks.
"""

from collections.abc import Mapping

import numpy as np

from cable_envs.proof.family_b.simulators.laws import bristle, drifted, falling, wavy
from cable_envs.proof.simulators.numerics import Table, jit, tension_ratio

STEP = 5e-5
CLOCK = 1e-3
GRAVITY = 9.81

TABLE = Table(__name__, {
    "load_mass": 5.0, "load_stiffness": 0.0, "cable_stiffness": 6e4, "cable_damping": 100.0, "wrap_angle": 1.047,
    "radius_ratio": 1.5, "cable_radius": 1e-3, "friction_coefficient": 0.43, "extrusion_exponent": 2.03, "kp": 0.0,
    "acceleration_limit": 2.0, "held": 0.0, "step": STEP,
    "coulomb_friction.force": 0.0, "viscous_friction.coefficient": 0.0,
    "stribeck_friction.excess": 0.0, "stribeck_friction.speed": 0.003, "stribeck_friction.form": 0.0,
    "asymmetric_friction.difference": 0.0, "presliding_hysteresis.distance": 0.0,
    "load_dependent_friction.exponent": 0.0, "lateral_extrusion.gain": 0.0, "bending_stiffness.rigidity": 0.0,
    "cable_elongation.compliance": 0.0, "stiffness_hardening.coefficient": 0.0, "stiffness_hardening.form": 0.0,
    "viscoelastic_creep.share": 0.0, "viscoelastic_creep.time": 3.0, "viscoelastic_creep.second": 0.0,
    "friction_drift.change": 0.0, "friction_drift.time": 30.0, "friction_drift.form": 0.0,
    "position_ripple.amplitude": 0.0, "position_ripple.period": 0.004, "position_ripple.phase": 0.0,
    "position_ripple.second": 0.0, "backlash.gap": 0.0,
    "position_dependent_load.stiffness": 0.0, "position_dependent_load.cubic": 0.0,
    "actuator_lag.time": 0.0, "actuator_lag.second": 0.0,
    "wet_hole.depth": 0.0, "wet_hole.place": 0.0, "swinging_load.mass": 0.0, "swinging_load.frequency": 5.0,
    "rolling_support.amplitude": 0.0, "rolling_support.period": 11.0, "draining_load.rate": 0.0,
    "draught.force": 0.0, "draught.time": 2.0,
})  # fmt: skip
Parameters = TABLE.kind

OUTPUTS = (
    "drive_position", "drive_velocity", "drive_tension", "load_position", "load_tension", "drive_velocity_command"
)  # fmt: skip


@jit
def _friction(p, y, v, way, tension, t):
    """M for a load that moves (or would move) ``way`` = +-1."""
    m = p.friction_coefficient
    if p.stribeck_friction_excess != 0.0:
        m *= 1.0 + p.stribeck_friction_excess * falling(p.stribeck_friction_form, v, p.stribeck_friction_speed)
    m *= 1.0 + p.asymmetric_friction_difference * way
    if p.load_dependent_friction_exponent != 0.0:
        m *= (max(tension, 0.1) / (p.load_mass * GRAVITY)) ** p.load_dependent_friction_exponent
    if p.friction_drift_change != 0.0:
        m *= 1.0 + p.friction_drift_change * drifted(p.friction_drift_form, t, p.friction_drift_time)
    if p.wet_hole_depth != 0.0:  # where the cable has been greased
        m *= 1.0 - min(p.wet_hole_depth, 0.9) * np.exp(-(((y - p.wet_hole_place) / 0.003) ** 2))
    if p.lateral_extrusion_gain != 0.0:
        m += p.lateral_extrusion_gain * abs(v) ** p.extrusion_exponent
    return max(m, 1e-6)


@jit
def _ratio(p, y, v, way, t1, t):
    """n for a load that moves ``way``."""
    wrap, m = p.wrap_angle, _friction(p, y, v, way, t1, t)
    if p.bending_stiffness_rigidity != 0.0:
        t2 = t1 * np.exp(-way * m * wrap)  # about: the wrap that a stiff cable loses depends on it by its root only
        roots = 1.0 / np.sqrt(max(t1, 1e-3)) + 1.0 / np.sqrt(max(t2, 1e-3))
        wrap = max(wrap - np.sqrt(p.bending_stiffness_rigidity) * roots / (2.0 * p.radius_ratio * p.cable_radius), 0.0)
    return tension_ratio(p.radius_ratio, m, wrap)


@jit
def _loads(p, y, v, t):
    force = (
        -(p.load_mass - p.draining_load_rate * t) * GRAVITY
        - (p.load_stiffness + p.position_dependent_load_stiffness + p.position_dependent_load_cubic * y * y) * y
        - p.viscous_friction_coefficient * v
    )
    if p.draught_force != 0.0:
        force += p.draught_force * np.sin(2.0 * np.pi * t / p.draught_time + 2.0 * np.sin(0.31 * t))
    return force


@jit
def _tension(p, k, stretch, rate, crept, crept2, weight):
    """T1 of a cable that is stretched by so much, N."""
    if stretch <= 0.0:
        return 0.0
    pull = k * stretch + p.cable_damping * rate
    if p.stiffness_hardening_coefficient != 0.0:
        if p.stiffness_hardening_form < 0.5:
            pull += k * p.stiffness_hardening_coefficient * stretch * (stretch - weight / k)
        else:  # the same slope about the weight, from an exponential law of the strain
            c = 2.0 * p.stiffness_hardening_coefficient
            pull += k * (np.expm1(c * (stretch - weight / k)) / c - (stretch - weight / k))
    if p.viscoelastic_creep_share != 0.0:
        slow = p.viscoelastic_creep_second
        pull += p.viscoelastic_creep_share * k * ((1.0 - slow) * (stretch - crept) + slow * (stretch - crept2))
    return max(pull, 0.0)


@jit
def _hauled(p, x):
    if p.position_ripple_amplitude == 0.0:
        return x
    angle = 2.0 * np.pi * x / p.position_ripple_period + p.position_ripple_phase
    return x + p.position_ripple_amplitude * wavy(p.position_ripple_second, angle)


@jit
def _run(p, reference, rate, start, out):
    """Fill ``out`` [ticks, 6] (`OUTPUTS`)."""
    h, mass = p.step, p.load_mass
    substeps = round(CLOCK / h)
    k = 1.0 / (1.0 / p.cable_stiffness + p.cable_elongation_compliance)
    weight, soft = mass * GRAVITY, p.presliding_hysteresis_distance
    first = p.actuator_lag_time * (0.5 if p.actuator_lag_second > 0.5 else 1.0)
    follow = 1.0 - np.exp(-h / first) if first > 0.0 else 1.0
    relax = 1.0 - np.exp(-h / p.viscoelastic_creep_time)
    relax2 = 1.0 - np.exp(-h / (6.0 * p.viscoelastic_creep_time))
    y, v, vx, t = reference[0], 0.0, 0.0, start
    pulled = -_loads(p, y, 0.0, start)
    stretch = pulled / k
    if p.stiffness_hardening_coefficient != 0.0:
        for _ in range(50):
            gap = _tension(p, k, stretch, 0.0, stretch, stretch, weight) - pulled
            stretch -= gap / k
    x = y + stretch
    for _ in range(30):
        x += y + stretch - _hauled(p, x)
    nut, crept, crept2, z = x, stretch, stretch, 0.0
    t1, t2, lag, lag2 = pulled, pulled, 0.0, 0.0
    swing, sway, gained = 0.0, 0.0, 0.0
    for tick in range(len(reference)):
        out[tick, 0], out[tick, 1], out[tick, 2], out[tick, 3], out[tick, 4] = x, vx, t1, y, t2
        ahead = min(tick + 1, len(reference) - 1)
        out[tick, 5] = rate[tick] + p.kp * (
            reference[tick] - y
        )  # where it is held, rate is constant over so many ticks
        held, before_y = out[tick, 5], y
        for n in range(substeps):
            part = (n + 0.5) / substeps
            told = held
            if p.held < 1.5:
                feed = rate[tick] + part * (rate[ahead] - rate[tick])
                asked = reference[tick] + part * (reference[ahead] - reference[tick])
                told = feed + p.kp * (asked - y - 0.5 * h * v)
            lag += follow * (told - lag)
            if p.actuator_lag_second > 0.5:
                lag2 += follow * (lag - lag2)
            wanted = lag2 if p.actuator_lag_second > 0.5 else lag
            before_vx = vx
            vx += min(max(wanted - vx, -p.acceleration_limit * h), p.acceleration_limit * h)
            x_middle = x + 0.25 * h * (before_vx + vx)
            y_middle = y + 0.5 * h * v
            nut = min(max(nut, x_middle - 0.5 * p.backlash_gap), x_middle + 0.5 * p.backlash_gap)
            if p.rolling_support_amplitude != 0.0:
                gained = p.rolling_support_amplitude * 0.5 * (1.0 - np.cos(2.0 * np.pi * t / p.rolling_support_period))
            stretch = _hauled(p, nut) - y_middle + gained
            crept += relax * (stretch - crept)
            crept2 += relax2 * (stretch - crept2)
            t1 = _tension(p, k, stretch, vx - v, crept, crept2, weight)
            loads = _loads(p, y_middle, v, t + 0.5 * h)
            if p.swinging_load_mass > 0.0:
                back = p.swinging_load_mass * (
                    p.swinging_load_frequency**2 * swing + 0.06 * p.swinging_load_frequency * sway
                )
                loads += back
            up = t1 / _ratio(p, y_middle, v, 1.0, t1, t)
            down = t1 * _ratio(p, y_middle, v, -1.0, t1, t)
            before = v
            if soft > 0.0:
                share = 0.5 - 0.5 * z  # of the way from up (z = 1) to down (z = -1), in the logarithm
                t2 = np.exp(np.log(max(up, 1e-12)) * (1.0 - share) + np.log(max(down, 1e-12)) * share)
                rub = 0.3 * np.sqrt(0.5 * (down - up) / soft * mass) * (1.0 - z * z) * v
                v += h * (t2 - rub + loads) / mass
                z = bristle(z, 0.5 * h * (before + v) / soft)
            else:
                rise, fall = v + h * (up + loads - p.coulomb_friction_force) / mass, 0.0
                if rise > 0.0:
                    v, t2 = rise, up
                else:
                    fall = v + h * (down + loads + p.coulomb_friction_force) / mass
                    if fall < 0.0:
                        v, t2 = fall, down
                    else:
                        t2 = min(max(-loads - mass * v / h, up), down)
                        v = 0.0
            if p.swinging_load_mass > 0.0:
                sway -= h * back / p.swinging_load_mass + (v - before)
                swing += h * sway
            x += 0.5 * h * (before_vx + vx)
            y += 0.5 * h * (before + v)
            t += h
        # what sensors show is of the tick itself: half a step behind the forces that were just taken
        nut_now = min(max(nut, x - 0.5 * p.backlash_gap), x + 0.5 * p.backlash_gap)
        before_t1 = t1
        t1 = _tension(p, k, _hauled(p, nut_now) - y + gained, vx - v, crept, crept2, weight)
        t2 *= t1 / before_t1 if before_t1 > 0.0 and before_y != y else 1.0


def simulate(values: Mapping[str, float], reference: np.ndarray, start: float = 0.0) -> dict[str, np.ndarray]:
    """Signals at every `CLOCK` by name, SI.

    Parameters
    ----------
    values : Mapping of str to float
        Parameters by the names of `TABLE`; others are null.
    reference : ndarray, shape (ticks,)
        Position wanted of the load, m. Its rate is the speed that the drive is told; with a gain kp > 0 that times the
        error of the load's position is added.
    start : float
        Time of the first tick, s.

    Returns
    -------
    dict of str to ndarray
        time, `OUTPUTS` and position_reference, each of shape (ticks,).
    """
    p = TABLE.pack(values)
    reference = np.ascontiguousarray(reference, dtype=np.float64)
    out = np.empty((len(reference), len(OUTPUTS)))
    rate = np.gradient(reference, CLOCK)
    if p.held > 1.5:  # the mean speed to where the reference is when the next command comes
        ticks = int(p.held)
        edges = np.minimum(np.arange(0, len(reference) + ticks, ticks), len(reference) - 1)
        rate = np.repeat(np.diff(reference[edges]) / (ticks * CLOCK), ticks)[: len(reference)]
    _run(p, reference, rate, start, out)
    signals = dict(zip(OUTPUTS, out.T, strict=True))
    return {"time": start + CLOCK * np.arange(len(reference)), **signals, "position_reference": reference}
