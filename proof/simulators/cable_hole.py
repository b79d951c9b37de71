"""A load drawn through a hole by an elastic cable: directional capstan friction, carried by a state of its own.

    T2 = T1 n^(-Z),   n = lambda(rho, M, theta_e),   M = mu + K |v|^omega            (physics.md, sections 1 to 4)
    m y'' = T2 - m g - k_l y - c_l y' + ...

Z in [-1, 1] is a state that the slip y drives: 1 sliding up, -1 sliding down, in between at rest, so that
the exponent itself carries the hysteresis. The drive follows a speed, that goes in straight lines from tick to tick, so
that the recorded command is what it follows and not late by half a tick; kick-drift-kick as in `linear_drive`.
"""

from collections.abc import Mapping

import numpy as np

from cable_envs.proof.simulators.numerics import Table, jit, slipped, tension_ratio

STEP = 1e-4
CLOCK = 1e-3
_SUBSTEPS = round(CLOCK / STEP)
STIFF = 8e-8
"""m; twice it, times a stiff cable's 2e5 N/m, is the tension by which sticking gives way: within its noise. Of 1.5e-7
what is left was found as a pre-sliding of 0.36 um beside other effects (gains of 76 and 141)."""
GUIDE = 8e-8
GRAVITY = 9.81

TABLE = Table(__name__, {
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
Parameters = TABLE.kind

OUTPUTS = (
    "drive_position", "drive_velocity", "drive_tension", "load_position", "load_tension", "drive_velocity_command"
)  # fmt: skip


@jit
def _friction(p, y, v, z, tension, t):
    """M: what multiplies the pressure in the hole."""
    m = p.friction_coefficient
    if p.stribeck_friction_excess != 0.0:
        m *= 1.0 + p.stribeck_friction_excess * np.exp(-((v / p.stribeck_friction_speed) ** 2))
    if p.asymmetric_friction_difference != 0.0:
        m *= 1.0 + p.asymmetric_friction_difference * z
    if p.load_dependent_friction_exponent != 0.0:
        m *= (max(tension, 0.1) / (p.load_mass * GRAVITY)) ** p.load_dependent_friction_exponent
    if p.friction_drift_change != 0.0:
        m *= 1.0 + p.friction_drift_change * (1.0 - np.exp(-t / p.friction_drift_time))
    if p.sheath_rubbing_curvature != 0.0:
        m *= 1.0 + p.sheath_rubbing_curvature * y * y
    if p.lateral_extrusion_gain != 0.0:
        m += p.lateral_extrusion_gain * abs(v) ** p.extrusion_exponent
    return max(m, 1e-6)


@jit
def _log_ratio(p, y, v, z, t1, t2, t):
    wrap = p.wrap_angle
    if p.bending_stiffness_rigidity != 0.0:
        roots = 1.0 / np.sqrt(max(t1, 1e-3)) + 1.0 / np.sqrt(max(t2, 1e-3))
        wrap = max(wrap - np.sqrt(p.bending_stiffness_rigidity) * roots / (2.0 * p.radius_ratio * p.cable_radius), 0.0)
    return np.log(tension_ratio(p.radius_ratio, _friction(p, y, v, z, t1, t), wrap))


@jit
def _loads(p, y, v, t, armed):
    force = (
        -(p.load_mass - p.leaking_load_rate * t) * GRAVITY
        - (p.load_stiffness + p.position_dependent_load_stiffness + p.position_dependent_load_cubic * y * y) * y
        - p.viscous_friction_coefficient * v
    )
    if p.floor_vibration_amplitude != 0.0:
        force += p.floor_vibration_amplitude * np.sin(2.0 * np.pi * p.floor_vibration_frequency * t)
    if p.ratchet_force != 0.0:
        force -= armed * p.ratchet_force * np.exp(-(((y - p.ratchet_place) / p.ratchet_width) ** 2))
    return force


@jit
def _lengthened(p, t):
    """Length that the cable has gained, m."""
    gained = 0.0
    if p.thermal_length_amplitude != 0.0:
        gained += 0.5 * p.thermal_length_amplitude * (1.0 - np.cos(2.0 * np.pi * t / p.thermal_length_period))
    if p.strand_slips_step != 0.0:
        gained += p.strand_slips_step * np.floor(t / p.strand_slips_interval)
    return gained


@jit
def _run(p, reference, rate, start, out):
    """Fill ``out`` [ticks, 6] (`OUTPUTS`)."""
    h, mass = STEP, p.load_mass
    k = 1.0 / (1.0 / p.cable_stiffness + p.cable_elongation_compliance)
    weight = mass * GRAVITY
    follow = 1.0 - np.exp(-h / p.actuator_lag_time) if p.actuator_lag_time > 0.0 else 1.0
    relax = 1.0 - np.exp(-h / p.viscoelastic_creep_time)
    y, v, t, mean, held, rub, armed = reference[0], 0.0, start, 0.0, 0.0, 0.0, 1.0
    pulled = -_loads(p, y, 0.0, start, 0.0)  # at rest friction has nothing to hold
    x, vx, wanted = y + pulled / k, 0.0, 0.0
    if p.position_ripple_amplitude != 0.0:
        x -= p.position_ripple_amplitude * np.sin(2.0 * np.pi * x / p.position_ripple_period + p.position_ripple_phase)
    nut, bristle = x, max(STIFF, p.presliding_hysteresis_distance)
    stretch, crept, t1, t2 = pulled / k, pulled / k, pulled, pulled
    gained = _lengthened(p, start)
    for tick in range(len(reference)):
        ahead, out[tick, 0], out[tick, 1], out[tick, 2] = min(tick + 1, len(reference) - 1), x, vx, t1
        out[tick, 3], out[tick, 4] = y, t2
        out[tick, 5] = rate[tick] + p.kp * (reference[tick] - y)
        for n in range(_SUBSTEPS):
            late = 0.5 if p.actuator_lag_time > 0.0 else 1.0  # a lag takes the command's mean over the step
            part = (n + late) / _SUBSTEPS
            feed = rate[tick] + part * (rate[ahead] - rate[tick])
            asked = reference[tick] + part * (reference[ahead] - reference[tick])
            wanted += follow * (feed + p.kp * (asked - y - late * h * v) - wanted)
            before_v = vx
            vx += min(max(wanted - vx, -p.acceleration_limit * h), p.acceleration_limit * h)
            for stage in range(2):
                if stage == 1:
                    dy, before = h * v, mean
                    x, y, t = x + 0.5 * h * (before_v + vx), y + dy, t + h
                    mean = slipped(mean, dy, STIFF, p.presliding_hysteresis_distance)
                    held = slipped(held, dy, GUIDE, 0.0)
                    fade = (
                        1.0 - mean * mean
                        if p.presliding_hysteresis_distance > 0.0
                        else min(50.0 * (1.0 - abs(mean)), 1.0)
                    )
                    rub = 0.0
                    if abs(mean) < 1.0 and mean != before:
                        rub = 0.7 * np.sqrt(0.3 * weight * mass / bristle) * fade * v
                    nut = min(max(nut, x - 0.5 * p.backlash_gap), x + 0.5 * p.backlash_gap)
                    hauled = nut
                    if p.position_ripple_amplitude != 0.0:
                        hauled += p.position_ripple_amplitude * np.sin(
                            2.0 * np.pi * nut / p.position_ripple_period + p.position_ripple_phase
                        )
                    stretch = hauled - y + gained - _lengthened(p, t)
                    crept += relax * (stretch - crept)
                t1 = k * stretch + p.cable_damping * (vx - v)
                if p.stiffness_hardening_coefficient != 0.0:
                    t1 += k * p.stiffness_hardening_coefficient * stretch * (stretch - weight / k)
                if p.viscoelastic_creep_share != 0.0:
                    t1 += p.viscoelastic_creep_share * k * (stretch - crept)
                t1 = max(t1, 0.0) if stretch > 0.0 else 0.0
                t2 = t1 * np.exp(-mean * _log_ratio(p, y, v, mean, t1, t2, t)) - rub
                v += 0.5 * h * (t2 - p.coulomb_friction_force * held + _loads(p, y, v, t, armed)) / mass
            if p.ratchet_force != 0.0:
                if y > p.ratchet_place + 2.5 * p.ratchet_width:
                    armed = 0.0
                elif y < p.ratchet_place - 2.5 * p.ratchet_width:
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
