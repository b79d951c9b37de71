"""A load drawn through a hole by an elastic cable: directional capstan friction, carried by a state of its own.

    T2 = T1 n^(-Z),   n = lambda(rho, M, theta_e),   M = mu + K |v|^omega            (physics.md, sections 1 to 4)
    m y'' = T2 - m g - k_l y - c_l y' + ...

Z in [-1, 1] is a state that the slip y drives: 1 sliding up, -1 sliding down, in between at rest, so that
the exponent itself carries the hysteresis. The drive follows a speed, that goes in straight lines from tick to tick, so
that the recorded command is what it follows and not late by half a tick; kick-drift-kick as in `linear_drive`.
"""

from collections.abc import Mapping

import numpy as np

from proof.simulators.numerics import Table, indices, jit, slipped, tension_ratio

STEP = 1e-4
CLOCK = 1e-3
_SUBSTEPS = round(CLOCK / STEP)
STIFF = 8e-8
"""m; twice it, times a stiff cable's 2e5 N/m, is the tension by which sticking gives way: within its noise. Of 1.5e-7
what is left was found as a pre-sliding of 0.36 um beside other effects (gains of 76 and 141)."""
GUIDE = 8e-8
GRAVITY = 9.81

TABLE = Table({
    "load_mass": 5.0, "load_stiffness": 0.0, "cable_stiffness": 6e4, "cable_damping": 100.0, "wrap_angle": 1.047,
    "radius_ratio": 1.5, "cable_radius": 1e-3, "friction_coefficient": 0.43, "extrusion_exponent": 2.03, "kp": 0.0,
    "acceleration_limit": 2.0,
    "coulomb_friction.force": 0.0, "viscous_friction.coefficient": 0.0,
    "stribeck_friction.excess": 0.0, "stribeck_friction.speed": 0.003,
    "asymmetric_friction.difference": 0.0, "presliding_hysteresis.distance": 0.0,
    "load_dependent_friction.exponent": 0.0, "lateral_extrusion.gain": 0.0, "bending_stiffness.rigidity": 0.0,
    "cable_elongation.compliance": 0.0, "stiffness_hardening.coefficient": 0.0,
    "viscoelastic_creep.share": 0.0, "viscoelastic_creep.time": 3.0,
    "friction_drift.change": 0.0, "friction_drift.time": 30.0,
    "position_ripple.amplitude": 0.0, "position_ripple.period": 0.004, "position_ripple.phase": 0.0,
    "backlash.gap": 0.0,
    "position_dependent_load.stiffness": 0.0, "position_dependent_load.cubic": 0.0,
    "actuator_lag.time": 0.0,
    "sheath_rubbing.curvature": 0.0, "thermal_length.amplitude": 0.0, "thermal_length.period": 40.0,
    "leaking_load.rate": 0.0, "floor_vibration.amplitude": 0.0, "floor_vibration.frequency": 3.0,
    "strand_slips.step": 0.0, "strand_slips.interval": 17.0,
    "ratchet.force": 0.0, "ratchet.place": 0.0, "ratchet.width": 0.002,
})  # fmt: skip
(MASS, SPRING, CABLE, CABLE_C, WRAP, RHO, RADIUS, MU, OMEGA, KP, A_MAX, GUIDE_F, GUIDE_C, STR_F, STR_V, ASYM, SOFT,
 LOAD_EXP, GAIN, RIGIDITY, COMPLIANCE, HARD, CREEP, CREEP_T, DRIFT, DRIFT_T, RIP_A, RIP_P, RIP_PH, GAP, EXTRA_K, CUBIC,
 LAG, SHEATH, THERMAL, THERMAL_T, LEAK, FLOOR_A, FLOOR_F, STRAND, STRAND_T, RAT_F, RAT_X, RAT_W) = indices(
    TABLE.names, *TABLE.names)  # fmt: skip

OUTPUTS = (
    "drive_position", "drive_velocity", "drive_tension", "load_position", "load_tension", "drive_velocity_command"
)  # fmt: skip


@jit
def _friction(p, y, v, z, tension, t):
    """M: what multiplies the pressure in the hole."""
    m = p[MU]
    if p[STR_F] != 0.0:
        m *= 1.0 + p[STR_F] * np.exp(-((v / p[STR_V]) ** 2))
    if p[ASYM] != 0.0:
        m *= 1.0 + p[ASYM] * z
    if p[LOAD_EXP] != 0.0:
        m *= (max(tension, 0.1) / (p[MASS] * GRAVITY)) ** p[LOAD_EXP]
    if p[DRIFT] != 0.0:
        m *= 1.0 + p[DRIFT] * (1.0 - np.exp(-t / p[DRIFT_T]))
    if p[SHEATH] != 0.0:
        m *= 1.0 + p[SHEATH] * y * y
    if p[GAIN] != 0.0:
        m += p[GAIN] * abs(v) ** p[OMEGA]
    return max(m, 1e-6)


@jit
def _log_ratio(p, y, v, z, t1, t2, t):
    wrap = p[WRAP]
    if p[RIGIDITY] != 0.0:
        roots = 1.0 / np.sqrt(max(t1, 1e-3)) + 1.0 / np.sqrt(max(t2, 1e-3))
        wrap = max(wrap - np.sqrt(p[RIGIDITY]) * roots / (2.0 * p[RHO] * p[RADIUS]), 0.0)
    return np.log(tension_ratio(p[RHO], _friction(p, y, v, z, t1, t), wrap))


@jit
def _loads(p, y, v, t, armed):
    force = -(p[MASS] - p[LEAK] * t) * GRAVITY - (p[SPRING] + p[EXTRA_K] + p[CUBIC] * y * y) * y - p[GUIDE_C] * v
    if p[FLOOR_A] != 0.0:
        force += p[FLOOR_A] * np.sin(2.0 * np.pi * p[FLOOR_F] * t)
    if p[RAT_F] != 0.0:
        force -= armed * p[RAT_F] * np.exp(-(((y - p[RAT_X]) / p[RAT_W]) ** 2))
    return force


@jit
def _lengthened(p, t):
    """Length that the cable has gained, m."""
    gained = 0.0
    if p[THERMAL] != 0.0:
        gained += 0.5 * p[THERMAL] * (1.0 - np.cos(2.0 * np.pi * t / p[THERMAL_T]))
    if p[STRAND] != 0.0:
        gained += p[STRAND] * np.floor(t / p[STRAND_T])
    return gained


@jit
def _run(p, reference, rate, start, out):
    """Fill ``out`` [ticks, 6] (`OUTPUTS`)."""
    h, mass = STEP, p[MASS]
    k = 1.0 / (1.0 / p[CABLE] + p[COMPLIANCE])
    weight = mass * GRAVITY
    follow = 1.0 - np.exp(-h / p[LAG]) if p[LAG] > 0.0 else 1.0
    relax = 1.0 - np.exp(-h / p[CREEP_T])
    y, v, t, mean, held, rub, armed = reference[0], 0.0, start, 0.0, 0.0, 0.0, 1.0
    pulled = -_loads(p, y, 0.0, start, 0.0)  # at rest friction has nothing to hold
    x, vx, wanted = y + pulled / k, 0.0, 0.0
    if p[RIP_A] != 0.0:
        x -= p[RIP_A] * np.sin(2.0 * np.pi * x / p[RIP_P] + p[RIP_PH])
    nut, bristle = x, max(STIFF, p[SOFT])
    stretch, crept, t1, t2 = pulled / k, pulled / k, pulled, pulled
    gained = _lengthened(p, start)
    for tick in range(len(reference)):
        ahead, out[tick, 0], out[tick, 1], out[tick, 2] = min(tick + 1, len(reference) - 1), x, vx, t1
        out[tick, 3], out[tick, 4] = y, t2
        out[tick, 5] = rate[tick] + p[KP] * (reference[tick] - y)
        for n in range(_SUBSTEPS):
            late = 0.5 if p[LAG] > 0.0 else 1.0  # a lag takes the command's mean over the step
            part = (n + late) / _SUBSTEPS
            feed = rate[tick] + part * (rate[ahead] - rate[tick])
            asked = reference[tick] + part * (reference[ahead] - reference[tick])
            wanted += follow * (feed + p[KP] * (asked - y - late * h * v) - wanted)
            before_v = vx
            vx += min(max(wanted - vx, -p[A_MAX] * h), p[A_MAX] * h)
            for stage in range(2):
                if stage == 1:
                    dy, before = h * v, mean
                    x, y, t = x + 0.5 * h * (before_v + vx), y + dy, t + h
                    mean = slipped(mean, dy, STIFF, p[SOFT])
                    held = slipped(held, dy, GUIDE, 0.0)
                    fade = 1.0 - mean * mean if p[SOFT] > 0.0 else min(50.0 * (1.0 - abs(mean)), 1.0)
                    rub = 0.0
                    if abs(mean) < 1.0 and mean != before:
                        rub = 0.7 * np.sqrt(0.3 * weight * mass / bristle) * fade * v
                    nut = min(max(nut, x - 0.5 * p[GAP]), x + 0.5 * p[GAP])
                    hauled = nut
                    if p[RIP_A] != 0.0:
                        hauled += p[RIP_A] * np.sin(2.0 * np.pi * nut / p[RIP_P] + p[RIP_PH])
                    stretch = hauled - y + gained - _lengthened(p, t)
                    crept += relax * (stretch - crept)
                t1 = k * stretch + p[CABLE_C] * (vx - v)
                if p[HARD] != 0.0:
                    t1 += k * p[HARD] * stretch * (stretch - weight / k)
                if p[CREEP] != 0.0:
                    t1 += p[CREEP] * k * (stretch - crept)
                t1 = max(t1, 0.0) if stretch > 0.0 else 0.0
                t2 = t1 * np.exp(-mean * _log_ratio(p, y, v, mean, t1, t2, t)) - rub
                v += 0.5 * h * (t2 - p[GUIDE_F] * held + _loads(p, y, v, t, armed)) / mass
            if p[RAT_F] != 0.0:
                if y > p[RAT_X] + 2.5 * p[RAT_W]:
                    armed = 0.0
                elif y < p[RAT_X] - 2.5 * p[RAT_W]:
                    armed = 1.0


def simulate(values: Mapping[str, float], reference: np.ndarray, start: float = 0.0) -> dict[str, np.ndarray]:
    """Signals at every `CLOCK` by name, SI  [ticks].

    values: parameters by the names of `TABLE`; reference: load position wanted, m, at every tick. With gain kp = 0 its
    rate is the drive's speed, else kp times the position error is added. start: time of the first tick, s.
    """
    p = TABLE.pack(values)
    reference = np.ascontiguousarray(reference, dtype=np.float64)
    out = np.empty((len(reference), len(OUTPUTS)))
    _run(p, reference, np.gradient(reference, CLOCK), start, out)
    signals = dict(zip(OUTPUTS, out.T, strict=True))
    return {"time": start + CLOCK * np.arange(len(reference)), **signals, "position_reference": reference}
