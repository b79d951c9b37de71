"""A one-axis drive under PD control: masses, belt and friction, by a splitting of second order with exact hysteresis.

    m x'' = f - c x' - F_c(.) Z - loads(x) + disturbances,     Z: state of the friction, driven by x

kick-drift-kick: forces act for half a step, the displacement of a whole step moves the hysteresis, forces act again.
The force on the moving mass is recorded as the controller commands it; position and velocity are those of the carriage.
A second mass (the motor, ahead of the belt) exists only where the belt stretches or has play.
"""

from collections.abc import Mapping

import numpy as np

from proof.simulators.numerics import Table, indices, jit, slipped

STEP = 2e-4
"""s, of the integration; the controller and the log run at `CLOCK`."""

CLOCK = 1e-3
_SUBSTEPS = round(CLOCK / STEP)
STIFF = 2e-7
"""m: the bristles that stand for true sticking; far below any position noise."""

TABLE = Table({
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
(MASS, VISCOUS, COULOMB, SHARE, KP, KV, KD, ADD_C, ADD_V, STR_F, STR_V, ASYM, SOFT, LOAD_MU, COMPLIANCE, GAP, DRIFT,
 DRIFT_T, RIP_A, RIP_P, RIP_PH, SPRING, CUBIC, LAG, DELAY, PEN_M, PEN_L, DRAG, WIND, SAG, SAG_T, FLOOR_A, FLOOR_F,
 RAT_F, RAT_X, RAT_W) = indices(TABLE.names, *TABLE.names)  # fmt: skip

OUTPUTS = ("position", "velocity", "force", "motor_position")


@jit
def _limit(p, v, f, t):
    """Level of the dry friction, N."""
    level = p[COULOMB] + p[ADD_C] + p[LOAD_MU] * abs(f)
    if p[STR_F] != 0.0:
        level += p[STR_F] * np.exp(-((v / p[STR_V]) ** 2))
    if p[DRIFT] != 0.0:
        level *= 1.0 + p[DRIFT] * (1.0 - np.exp(-t / p[DRIFT_T]))
    return max(level, 0.0)


@jit
def _loads(p, x, v, t, armed):
    """What acts on the carriage beside friction and drive, N."""
    force = -(p[VISCOUS] + p[ADD_V]) * v - (p[SPRING] + p[CUBIC] * x * x) * x
    if p[RIP_A] != 0.0:
        force -= p[RIP_A] * np.sin(2.0 * np.pi * x / p[RIP_P] + p[RIP_PH])
    if p[DRAG] != 0.0:
        wind = v - p[WIND] * np.sin(0.9 * t) * np.sin(0.37 * t + 1.0)
        force -= p[DRAG] * abs(wind) * wind
    if p[FLOOR_A] != 0.0:
        force += p[FLOOR_A] * np.sin(2.0 * np.pi * p[FLOOR_F] * t)
    if p[RAT_F] != 0.0:
        force -= armed * p[RAT_F] * np.exp(-(((x - p[RAT_X]) / p[RAT_W]) ** 2))
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
    two = p[COMPLIANCE] > 0.0 or p[GAP] > 0.0
    motor = p[SHARE] * p[MASS]
    load = p[MASS] - motor if two else p[MASS]
    belt = 1.0 / p[COMPLIANCE] if p[COMPLIANCE] > 0.0 else 2e5
    damping, half = 2.0 * 0.1 * np.sqrt(belt * motor * load / p[MASS]), 0.5 * p[GAP]
    bristle = max(STIFF, p[SOFT])
    follow = 1.0 - np.exp(-h / p[LAG]) if p[LAG] > 0.0 else 1.0
    late = int(np.floor(p[DELAY] / CLOCK))
    mix = p[DELAY] / CLOCK - late
    x, v, t, mean, rub = reference[0], 0.0, start, 0.0, 0.0
    xm, vm = x, 0.0
    f, heat, swing, turn, armed = 0.0, 0.0, 0.0, 0.0, 1.0
    for k in range(len(reference)):
        out[k, 0], out[k, 1], out[k, 3] = x, v, xm
        a, b = max(k - late, 0), max(k - late - 1, 0)  # the delayed position, linearly between ticks
        seen = out[a, 0] + mix * (out[b, 0] - out[a, 0]) + hum[k]
        u = p[KP] * (reference[k] - seen) + p[KV] * rate[k] - p[KD] * v
        out[k, 2] = u
        for _ in range(_SUBSTEPS):
            f += follow * (u - f)
            drive = f
            if p[SAG] != 0.0:
                heat += h / p[SAG_T] * (abs(f * v) - heat)
                drive *= 1.0 - min(p[SAG] * heat, 0.9)
            for stage in range(2):
                if stage == 1:  # the displacement of the whole step, between two half kicks
                    dx, before = h * v, mean
                    x += dx
                    xm += h * vm
                    t += h
                    mean = slipped(mean, dx, STIFF, p[SOFT])
                    # keeps a stuck mass from ringing on its bristles; vanishes where it slides
                    rub = 0.0
                    if abs(mean) < 1.0 and mean != before:
                        rub = 0.7 * np.sqrt(_limit(p, v, f, t) * load / bristle) * (1.0 - mean * mean) * v
                pull = drive
                if two:
                    over = _over(xm - x, half)
                    pull = belt * over + (damping * (vm - v) if over != 0.0 else 0.0)
                    vm += 0.5 * h * (drive - pull) / motor
                net = pull - _limit(p, v, f, t) * mean - p[ASYM] * abs(mean) - rub + _loads(p, x, v, t, armed)
                v += 0.5 * h * (net + p[PEN_M] * 9.81 * swing) / load
            if p[RAT_F] != 0.0:  # a pawl: acts on the way up, is set again below
                if x > p[RAT_X] + 2.5 * p[RAT_W]:
                    armed = 0.0
                elif x < p[RAT_X] - 2.5 * p[RAT_W]:
                    armed = 1.0
            if p[PEN_M] > 0.0:
                turn += h * (-(9.81 * swing + net / load) / p[PEN_L] - 0.4 * turn)
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
