"""A one-axis drive under PD control: masses, belt and friction, by a splitting of second order with exact hysteresis.

    m x'' = f - c x' - F_c(.) Z - loads(x) + disturbances,     Z: state of the friction, driven by x

kick-drift-kick: forces act for half a step, the displacement of a whole step moves the hysteresis, forces act again.
The force on the moving mass is recorded as the controller commands it; position and velocity are those of the carriage.
A second mass (the motor, ahead of the belt) exists only where the belt stretches or has play.
"""

from collections.abc import Mapping

import numpy as np

from cable_envs.proof.simulators.numerics import Table, jit, slipped

STEP = 2e-4
"""s, of the integration; the controller and the log run at `CLOCK`."""

CLOCK = 1e-3
_SUBSTEPS = round(CLOCK / STEP)
STIFF = 2e-7
"""m: the bristles that stand for true sticking; far below any position noise."""

TABLE = Table(__name__, {
    "mass": 5.0, "viscous": 0.0, "coulomb": 0.0, "motor_share": 0.3, "kp": 4e3, "kv": 150.0, "kd": 150.0,
    "coulomb_friction.force": 0.0, "viscous_friction.coefficient": 0.0,
    "stribeck_friction.excess": 0.0, "stribeck_friction.speed": 0.01,
    "asymmetric_friction.difference": 0.0, "presliding_hysteresis.distance": 0.0,
    "load_dependent_friction.coefficient": 0.0, "cable_elongation.compliance": 0.0, "backlash.gap": 0.0,
    "friction_drift.change": 0.0, "friction_drift.time": 30.0,
    "position_ripple.amplitude": 0.0, "position_ripple.period": 0.02, "position_ripple.phase": 0.0,
    "position_dependent_load.stiffness": 0.0, "position_dependent_load.cubic": 0.0,
    "actuator_lag.time": 0.0, "sensor_delay.time": 0.0,
    "pendulum_sway.mass": 0.0, "pendulum_sway.length": 0.3, "gusty_drag.coefficient": 0.0, "gusty_drag.wind": 0.5,
    "supply_sag.share": 0.0, "supply_sag.time": 1.0, "floor_vibration.amplitude": 0.0, "floor_vibration.frequency": 3.0,
    "ratchet.force": 0.0, "ratchet.place": 0.0, "ratchet.width": 0.004,
})  # fmt: skip
Parameters = TABLE.kind

OUTPUTS = ("position", "velocity", "force", "motor_position")


@jit
def _limit(p, v, f, t):
    """Level of the dry friction, N."""
    level = p.coulomb + p.coulomb_friction_force + p.load_dependent_friction_coefficient * abs(f)
    if p.stribeck_friction_excess != 0.0:
        level += p.stribeck_friction_excess * np.exp(-((v / p.stribeck_friction_speed) ** 2))
    if p.friction_drift_change != 0.0:
        level *= 1.0 + p.friction_drift_change * (1.0 - np.exp(-t / p.friction_drift_time))
    return max(level, 0.0)


@jit
def _loads(p, x, v, t, armed):
    """What acts on the carriage beside friction and drive, N."""
    force = (
        -(p.viscous + p.viscous_friction_coefficient) * v
        - (p.position_dependent_load_stiffness + p.position_dependent_load_cubic * x * x) * x
    )
    if p.position_ripple_amplitude != 0.0:
        force -= p.position_ripple_amplitude * np.sin(
            2.0 * np.pi * x / p.position_ripple_period + p.position_ripple_phase
        )
    if p.gusty_drag_coefficient != 0.0:
        wind = v - p.gusty_drag_wind * np.sin(0.9 * t) * np.sin(0.37 * t + 1.0)
        force -= p.gusty_drag_coefficient * abs(wind) * wind
    if p.floor_vibration_amplitude != 0.0:
        force += p.floor_vibration_amplitude * np.sin(2.0 * np.pi * p.floor_vibration_frequency * t)
    if p.ratchet_force != 0.0:
        force -= armed * p.ratchet_force * np.exp(-(((x - p.ratchet_place) / p.ratchet_width) ** 2))
    return force


@jit
def _over(stretch, half):
    """Stretch beyond the play."""
    return stretch - half if stretch > half else (stretch + half if stretch < -half else 0.0)


@jit
def _run(p, reference, rate, hum, start, out):
    """Fill ``out`` [ticks, 4] (`OUTPUTS`) at every tick of the controller.

    hum: what the controller's position sensor adds, m [ticks].
    """
    h = STEP
    two = p.cable_elongation_compliance > 0.0 or p.backlash_gap > 0.0
    motor = p.motor_share * p.mass
    load = p.mass - motor if two else p.mass
    belt = 1.0 / p.cable_elongation_compliance if p.cable_elongation_compliance > 0.0 else 2e5
    damping, half = 2.0 * 0.1 * np.sqrt(belt * motor * load / p.mass), 0.5 * p.backlash_gap
    bristle = max(STIFF, p.presliding_hysteresis_distance)
    follow = 1.0 - np.exp(-h / p.actuator_lag_time) if p.actuator_lag_time > 0.0 else 1.0
    late = int(np.floor(p.sensor_delay_time / CLOCK))
    mix = p.sensor_delay_time / CLOCK - late
    x, v, t, mean, rub = reference[0], 0.0, start, 0.0, 0.0
    xm, vm = x, 0.0
    f, heat, swing, turn, armed = 0.0, 0.0, 0.0, 0.0, 1.0
    for k in range(len(reference)):
        out[k, 0], out[k, 1], out[k, 3] = x, v, xm
        a, b = max(k - late, 0), max(k - late - 1, 0)  # the delayed position, linearly between ticks
        seen = out[a, 0] + mix * (out[b, 0] - out[a, 0]) + hum[k]
        u = p.kp * (reference[k] - seen) + p.kv * rate[k] - p.kd * v
        out[k, 2] = u
        for _ in range(_SUBSTEPS):
            f += follow * (u - f)
            drive = f
            if p.supply_sag_share != 0.0:
                heat += h / p.supply_sag_time * (abs(f * v) - heat)
                drive *= 1.0 - min(p.supply_sag_share * heat, 0.9)
            for stage in range(2):
                if stage == 1:  # the displacement of the whole step, between two half kicks
                    dx, before = h * v, mean
                    x += dx
                    xm += h * vm
                    t += h
                    mean = slipped(mean, dx, STIFF, p.presliding_hysteresis_distance)
                    # keeps a stuck mass from ringing on its bristles; vanishes where it slides
                    rub = 0.0
                    if abs(mean) < 1.0 and mean != before:
                        rub = 0.7 * np.sqrt(_limit(p, v, f, t) * load / bristle) * (1.0 - mean * mean) * v
                pull = drive
                if two:
                    over = _over(xm - x, half)
                    pull = belt * over + (damping * (vm - v) if over != 0.0 else 0.0)
                    vm += 0.5 * h * (drive - pull) / motor
                net = (
                    pull
                    - _limit(p, v, f, t) * mean
                    - p.asymmetric_friction_difference * abs(mean)
                    - rub
                    + _loads(p, x, v, t, armed)
                )
                v += 0.5 * h * (net + p.pendulum_sway_mass * 9.81 * swing) / load
            if p.ratchet_force != 0.0:  # a pawl: acts on the way up, is set again below
                if x > p.ratchet_place + 2.5 * p.ratchet_width:
                    armed = 0.0
                elif x < p.ratchet_place - 2.5 * p.ratchet_width:
                    armed = 1.0
            if p.pendulum_sway_mass > 0.0:
                turn += h * (-(9.81 * swing + net / load) / p.pendulum_sway_length - 0.4 * turn)
                swing += h * turn


def simulate(
    values: Mapping[str, float], reference: np.ndarray, hum: np.ndarray | None = None, start: float = 0.0
) -> dict[str, np.ndarray]:
    """Signals at every `CLOCK` by name: time, `OUTPUTS` and position_reference, SI  [ticks].

    values: parameters by the names of `TABLE` (others are null); reference: position, m, at every tick; hum: error of
    the controller's position sensor, m; start: time of the first tick since the drive was switched on, s.
    """
    p = TABLE.pack(values)
    reference = np.ascontiguousarray(reference, dtype=np.float64)
    rate = np.gradient(reference, CLOCK)
    out = np.empty((len(reference), len(OUTPUTS)))
    _run(p, reference, rate, np.zeros(len(reference)) if hum is None else hum, start, out)
    signals = dict(zip(OUTPUTS, out.T, strict=True))
    return {"time": start + CLOCK * np.arange(len(reference)), **signals, "position_reference": reference}
