"""Generator B's one-axis drive: Moreau's time stepping, a sampled controller on encoder counts.

    motor      m_m v_m' = u_lagged - b
    carriage   m v'     = b - c v - loads(x, t) - friction,       friction in F_c(v, t) Sgn(v), solved in the step
    link       b = k over(x_m - x) (1 + chi over') or rigid;      over: what is beyond the play
    control    every `CLOCK`, held in between: PD  kp e + kv r' - kd v,  or a cascade  kv (kp/kv e + r' - v) + integral

Positions move by the mean of the speeds before and behind a step, forces act at the predicted middle: second order
where the motion is smooth, exact rest where it sticks.
"""

from collections.abc import Mapping

import numpy as np

from cable_envs.proof.family_b.simulators.laws import bristle, drifted, falling, over, rested, wavy
from cable_envs.proof.simulators.numerics import Table, jit

STEP = 5e-5
CLOCK = 1e-3
GRAVITY = 9.81

TABLE = Table(__name__, {
    "mass": 5.0, "motor_share": 0.3, "viscous": 0.0, "coulomb": 0.0,
    "kp": 4e3, "kv": 150.0, "kd": 150.0, "ki": 0.0, "count": 0.0, "step": STEP,
    "coulomb_friction.force": 0.0, "viscous_friction.coefficient": 0.0,
    "stribeck_friction.excess": 0.0, "stribeck_friction.speed": 0.01, "stribeck_friction.form": 0.0,
    "asymmetric_friction.difference": 0.0, "presliding_hysteresis.distance": 0.0,
    "cable_elongation.compliance": 0.0, "backlash.gap": 0.0,
    "friction_drift.change": 0.0, "friction_drift.time": 30.0, "friction_drift.form": 0.0,
    "position_ripple.amplitude": 0.0, "position_ripple.period": 0.02, "position_ripple.phase": 0.0,
    "position_ripple.second": 0.0,
    "position_dependent_load.stiffness": 0.0, "position_dependent_load.cubic": 0.0,
    "actuator_lag.time": 0.0, "actuator_lag.second": 0.0, "sensor_delay.time": 0.0,
    "slosh.mass": 0.0, "slosh.frequency": 6.0, "quadratic_drag.coefficient": 0.0,
    "supply_sag.share": 0.0, "supply_sag.time": 1.0, "belt_tooth.force": 0.0, "belt_tooth.place": 0.0,
    "draught.force": 0.0, "draught.time": 2.0,
})  # fmt: skip
Parameters = TABLE.kind

OUTPUTS = ("position", "velocity", "force", "motor_position")


@jit
def _level(p, v, t):
    """Level of the dry friction, N."""
    level = p.coulomb + p.coulomb_friction_force
    if p.stribeck_friction_excess != 0.0:
        level += p.stribeck_friction_excess * falling(p.stribeck_friction_form, v, p.stribeck_friction_speed)
    if p.friction_drift_change != 0.0:
        level *= 1.0 + p.friction_drift_change * drifted(p.friction_drift_form, t, p.friction_drift_time)
    return max(level, 0.0)


@jit
def _loads(p, x, v, t):
    """Forces on the carriage beside friction, belt and viscous damping, N."""
    force = -(p.position_dependent_load_stiffness + p.position_dependent_load_cubic * x * x) * x
    if p.position_ripple_amplitude != 0.0:
        angle = 2.0 * np.pi * x / p.position_ripple_period + p.position_ripple_phase
        force -= p.position_ripple_amplitude * wavy(p.position_ripple_second, angle)
    if p.quadratic_drag_coefficient != 0.0:
        force -= p.quadratic_drag_coefficient * abs(v) * v
    if p.belt_tooth_force != 0.0:  # one damaged place: a bump that is felt one way more than the other
        force -= (
            p.belt_tooth_force * np.exp(-(((x - p.belt_tooth_place) / 0.003) ** 2)) * (0.7 + 0.3 * np.tanh(v / 0.01))
        )
    if p.draught_force != 0.0:
        force += p.draught_force * np.sin(2.0 * np.pi * t / p.draught_time + 2.0 * np.sin(0.31 * t))
    return force


@jit
def _run(p, reference, rate, start, out):
    """Fill ``out`` [ticks, 4] (`OUTPUTS`)."""
    h = p.step
    substeps = round(CLOCK / h)
    two = p.cable_elongation_compliance > 0.0 or p.backlash_gap > 0.0
    motor = p.motor_share * p.mass
    load = p.mass - motor if two else p.mass
    belt = 1.0 / p.cable_elongation_compliance if p.cable_elongation_compliance > 0.0 else 2e5
    damping, half = 0.2 * np.sqrt(belt * motor * load / p.mass), 0.5 * p.backlash_gap
    first = p.actuator_lag_time * (0.5 if p.actuator_lag_second > 0.5 else 1.0)
    follow = 1.0 - np.exp(-h / first) if first > 0.0 else 1.0
    late, soft = p.sensor_delay_time / CLOCK, p.presliding_hysteresis_distance
    whole = int(np.floor(late))
    part = late - whole
    counted = np.empty(len(reference))
    x, v, xm, vm, t = reference[0], 0.0, reference[0], 0.0, start
    z, lag, lag2, total, heat = 0.0, 0.0, 0.0, 0.0, 0.0
    slosh, sway = 0.0, 0.0
    for k in range(len(reference)):
        out[k, 0], out[k, 1], out[k, 3] = x, v, xm if two else x
        counted[k] = np.round(x / p.count) * p.count if p.count > 0.0 else x
        a, b = max(k - whole, 0), max(k - whole - 1, 0)
        error = reference[k] - (counted[a] + part * (counted[b] - counted[a]))
        if p.ki > 0.0:
            slower = p.kp / p.kv * error + rate[k] - v
            total += p.ki * CLOCK * slower
            u = p.kv * slower + total
        else:
            u = p.kp * error + p.kv * rate[k] - p.kd * v
        out[k, 2] = u
        for _ in range(substeps):
            lag += follow * (u - lag)
            if p.actuator_lag_second > 0.5:
                lag2 += follow * (lag - lag2)
            drive = lag2 if p.actuator_lag_second > 0.5 else lag
            if p.supply_sag_share != 0.0:
                heat += h / p.supply_sag_time * (abs(drive * v) - heat)
                drive *= 1.0 - min(p.supply_sag_share * heat, 0.9)
            middle = x + 0.5 * h * v
            pull = drive
            if two:
                beyond = over(xm + 0.5 * h * vm - middle, half)
                pull = belt * beyond + (damping * (vm - v) if beyond != 0.0 else 0.0)
                new_vm = vm + h * (drive - pull) / motor
                xm += 0.5 * h * (vm + new_vm)
                vm = new_vm
            net, back = pull + _loads(p, middle, v, t + 0.5 * h), 0.0
            if p.slosh_mass > 0.0:  # a spring-mass that rides along
                back = p.slosh_mass * (p.slosh_frequency**2 * slosh + 0.08 * p.slosh_frequency * sway)
                net += back
            viscous = p.viscous + p.viscous_friction_coefficient
            level = _level(p, v, t)
            if soft > 0.0:
                net -= level * z + 0.3 * np.sqrt(level / soft * load) * (1.0 - z * z) * v
                new = (v * (1.0 - 0.5 * h * viscous / load) + h * net / load) / (1.0 + 0.5 * h * viscous / load)
                z = bristle(z, 0.5 * h * (v + new) / soft)
            else:
                free = v * (1.0 - 0.5 * h * viscous / load) + h * net / load
                skew = 0.5 * p.asymmetric_friction_difference
                up, down = max(level + skew, 0.0), max(level - skew, 0.0)
                new = rested(free, h * up / load, h * down / load) / (1.0 + 0.5 * h * viscous / load)
            if p.slosh_mass > 0.0:
                sway -= h * back / p.slosh_mass + (new - v)
                slosh += h * sway
            x += 0.5 * h * (v + new)
            v = new
            t += h


def simulate(values: Mapping[str, float], reference: np.ndarray, start: float = 0.0) -> dict[str, np.ndarray]:
    """Signals at every `CLOCK` by name, SI.

    Parameters
    ----------
    values : Mapping of str to float
        Parameters by the names of `TABLE`; others are null.
    reference : ndarray, shape (ticks,)
        Position that the controller wants, m.
    start : float
        Time of the first tick since the rig was switched on, s.

    Returns
    -------
    dict of str to ndarray
        time, `OUTPUTS` and position_reference, each of shape (ticks,).
    """
    p = TABLE.pack(values)
    reference = np.ascontiguousarray(reference, dtype=np.float64)
    out = np.empty((len(reference), len(OUTPUTS)))
    _run(p, reference, np.gradient(reference, CLOCK), start, out)
    signals = dict(zip(OUTPUTS, out.T, strict=True))
    return {"time": start + CLOCK * np.arange(len(reference)), **signals, "position_reference": reference}
