"""Generator B's circuit of two cables over four idlers a side: a cable without mass, every idler in two pieces.

Each piece of rope at an idler rests or slides so that the tensions on its two sides keep

    T_before <= e^(L/2) T_behind,   T_behind <= e^(L/2) T_before      (L = ln lambda of the idler, Zou 2022, Eq. (30))

with both pieces of an idler at its whole lambda, and half of the rope that slides there between them as a spring of its
own. After every motion of the two ends the pieces find their places by active sets: rate-independent friction without
mass, speed or bristle. The output pulley moves by a leapfrog
with set-valued friction of its own. Geometry: Table 2 of Zou 2022.
"""

from collections.abc import Mapping

import numpy as np

from cable_envs.proof.family_b.simulators.laws import bristle, drifted, falling, over, rested, wavy
from cable_envs.proof.simulators.numerics import Table, jit
from cable_envs.proof.simulators.pulley_circuit import (
    CABLE_DAMPING,
    R0,
    R5,
    RADII,
    SPANS,
    contact_logs,
)  # fmt: skip

STEP = 1e-4
CLOCK = 1e-3
GRAVITY = 9.81
SLACKEST = 1e-11
"""m: pieces of rope that move by less in a turn rest."""
TIGHT = 1.0 + 1e-9
"""A piece that rests is let go where its limit is exceeded by more than this factor."""
TURNS, ALONE = 20, 400
"""Turns in which all pieces change their ways at once, and further ones in which the first alone does (Murty 1974)."""

TABLE = Table(__name__, {
    "tensile_stiffness": 1.684e4, "pretension_top": 50.0, "pretension_bottom": 50.0, "shaft_friction": 0.157,
    "cable_friction": 0.54, "output_inertia": 2e-5, "output_damping": 2e-4, "contact_stiffness": 0.2,
    "contact_angle": 0.0, "contact_damping": 2e-3, "servo_frequency": 60.0, "servo_damping_ratio": 0.9, "step": STEP,
    "coulomb_friction.torque": 0.0, "viscous_friction.coefficient": 0.0,
    "stribeck_friction.excess": 0.0, "stribeck_friction.speed": 0.1, "stribeck_friction.form": 0.0,
    "asymmetric_friction.difference": 0.0, "presliding_hysteresis.distance": 0.0,
    "load_dependent_friction.coefficient": 0.0, "cable_elongation.compliance": 0.0,
    "stiffness_hardening.coefficient": 0.0, "stiffness_hardening.form": 0.0,
    "viscoelastic_creep.share": 0.0, "viscoelastic_creep.time": 3.0, "viscoelastic_creep.second": 0.0,
    "friction_drift.change": 0.0, "friction_drift.time": 30.0, "friction_drift.form": 0.0, "backlash.gap": 0.0,
    "position_ripple.amplitude": 0.0, "position_ripple.number": 8.0, "position_ripple.phase": 0.0,
    "position_ripple.second": 0.0,
    "position_dependent_load.stiffness": 0.0, "position_dependent_load.cubic": 0.0,
    "actuator_lag.time": 0.0, "actuator_lag.second": 0.0,
    "swinging_tip.inertia": 0.0, "swinging_tip.frequency": 8.0, "worn_place.torque": 0.0, "worn_place.place": 0.0,
    "draught.torque": 0.0, "draught.time": 2.0, "loose_clamp.step": 0.0,
    "loose_clamp.torque": 0.05,
})  # fmt: skip
Parameters = TABLE.kind

OUTPUTS = ("drive_angle", "drive_torque", "output_angle", "output_torque", "tension_top", "tension_bottom")
_COUPLING, _PULLEY = 1500.0, 2e-5
"""N m/rad and kg m^2 of the driving pulley behind a coupling with play."""


@jit
def _level(p, omega, both, way, t):
    """Level of the output's dry friction towards ``way``, N m; ``both``: sum of the tensions at the driven pulley."""
    level = (
        p.coulomb_friction_torque * (1.0 + p.asymmetric_friction_difference * way)
        + p.load_dependent_friction_coefficient * R5 * both
    )
    if p.stribeck_friction_excess != 0.0:
        level += p.stribeck_friction_excess * falling(p.stribeck_friction_form, omega, p.stribeck_friction_speed)
    if p.friction_drift_change != 0.0:
        level *= 1.0 + p.friction_drift_change * drifted(p.friction_drift_form, t, p.friction_drift_time)
    return max(level, 0.0)


@jit
def _hauled(p, angle):
    if p.position_ripple_amplitude == 0.0:
        return angle
    wave = wavy(p.position_ripple_second, p.position_ripple_number * angle + p.position_ripple_phase)
    return angle + p.position_ripple_amplitude * wave


@jit
def _law(p, ea, pre, strain):
    """Tension of a span that the pretension has not strained, but this, N; without damping and creep."""
    pull = pre + ea * strain
    if p.stiffness_hardening_coefficient != 0.0:
        if p.stiffness_hardening_form < 0.5:
            pull += ea * p.stiffness_hardening_coefficient * strain * strain
        else:
            c = 2.0 * p.stiffness_hardening_coefficient
            pull += ea * (np.expm1(c * strain) / c - strain)
    return pull


@jit
def _pull(p, ea, pre, strain, crept, crept2, rate):
    """Tension of a span, N."""
    pull = _law(p, ea, pre, strain) + CABLE_DAMPING * rate
    if p.viscoelastic_creep_share != 0.0:
        slow = p.viscoelastic_creep_second
        pull += p.viscoelastic_creep_share * ea * ((1.0 - slow) * (strain - crept) + slow * (strain - crept2))
    return max(pull, 0.0)


@jit
def _spans(p, ea, pre, front, back, s, lengths, crept, crept2, tension):
    """Fill ``tension`` [9] for pieces at ``s`` [8] between the two ends."""
    last = len(s)
    for j in range(last + 1):
        before = front if j == 0 else s[j - 1]
        behind = back if j == last else s[j]
        tension[j] = _pull(p, ea, pre, (before - behind) / lengths[j], crept[j], crept2[j], 0.0)


@jit
def _relaxed(p, ea, pre, front, back, s, ways, lengths, limits, crept, crept2, tension):
    """Let the pieces ``s`` [8] of a side come to rest between its ends; fills ``tension`` [9].

    ways [8]: which way each slides, first as it did in the step before. Those that slide keep their limits, those that
    rest stay: one tridiagonal system; then pieces whose limit is exceeded are let go and those that would slide against
    their friction are stopped, until the sets stay as they are.
    """
    last = len(s)
    start, upper, known, step = s.copy(), np.empty(last), np.empty(last), np.empty(last)
    for turn in range(TURNS + ALONE):
        _spans(p, ea, pre, front, back, s, lengths, crept, crept2, tension)
        for i in range(last):
            n, low, high, own = limits[i], 0.0, 0.0, 1.0
            miss = 0.0
            if ways[i] != 0:
                left = n if ways[i] < 0 else 1.0
                right = 1.0 if ways[i] < 0 else n
                miss = left * tension[i] - right * tension[i + 1]
                low, high = left * ea / lengths[i], right * ea / lengths[i + 1]
                own = -(low + high)
            pivot = own - (low * upper[i - 1] if i > 0 else 0.0)
            upper[i] = high / pivot
            known[i] = (-miss - (low * known[i - 1] if i > 0 else 0.0)) / pivot
        most, changed = 0.0, False
        for k in range(last):
            i = last - 1 - k
            step[i] = known[i] - (upper[i] * step[i + 1] if i < last - 1 else 0.0)
            most = max(most, abs(step[i]))
        for i in range(last):
            s[i] += step[i]
        _spans(p, ea, pre, front, back, s, lengths, crept, crept2, tension)
        for i in range(last):
            if changed and turn >= TURNS:
                break
            if ways[i] == 0:
                if tension[i] > limits[i] * tension[i + 1] * TIGHT:
                    ways[i], changed = 1, True
                elif tension[i + 1] > limits[i] * tension[i] * TIGHT:
                    ways[i], changed = -1, True
            elif (s[i] - start[i]) * ways[i] < -SLACKEST:
                ways[i], s[i], changed = 0, start[i], True
        if not changed and most < SLACKEST:
            break


@jit
def _run(p, logs, worn, lengths, reference, rate, start, out):
    """Fill ``out`` [ticks, 6] (`OUTPUTS`).

    logs, worn [2, 4]: ln lambda at first and when friction has drifted wholly; lengths [2, 9]: of spans and of the rope
    that slides, m.
    """
    h = p.step
    substeps = round(CLOCK / h)
    ea = 1.0 / (1.0 / p.tensile_stiffness + p.cable_elongation_compliance)
    pre = np.array([p.pretension_top, p.pretension_bottom])
    first = p.actuator_lag_time * (0.5 if p.actuator_lag_second > 0.5 else 1.0)
    follow = 1.0 - np.exp(-h / first) if first > 0.0 else 1.0
    relax = 1.0 - np.exp(-h / p.viscoelastic_creep_time)
    relax2 = 1.0 - np.exp(-h / (6.0 * p.viscoelastic_creep_time))
    soft = p.presliding_hysteresis_distance
    s, crept, crept2 = np.zeros((2, 8)), np.zeros((2, 9)), np.zeros((2, 9))
    tension, limits, ways = np.zeros((2, 9)), np.ones((2, 8)), np.zeros((2, 8), dtype=np.int64)
    whole = np.zeros(2)
    for a in range(2):
        for j in range(9):
            whole[a] += lengths[a, j]
    angle, speed = reference[0], 0.0
    lag, lag2, feed, feed2 = angle, angle, 0.0, 0.0
    pulley, turning = angle, 0.0
    theta, omega = _hauled(p, angle) * R0 / R5, 0.0
    for a in range(2):
        for i in range(8):
            s[a, i] = (1.0 - 2.0 * a) * R0 * _hauled(p, angle)
    z, swing, sway, t, torque, slipped_by = 0.0, 0.0, 0.0, start, 0.0, 0.0
    settle = round(0.3 / h)
    for tick in range(-1, len(reference)):
        now = max(tick, 0)
        ahead = min(now + 1, len(reference) - 1) if tick >= 0 else now
        for n in range(settle if tick < 0 else substeps):
            done = 0.0
            if p.friction_drift_change != 0.0:
                done = drifted(p.friction_drift_form, t, p.friction_drift_time)
            for a in range(2):
                for i in range(4):
                    level = logs[a, i] + done * (worn[a, i] - logs[a, i])
                    limits[a, 2 * i] = limits[a, 2 * i + 1] = np.exp(0.5 * level)
                side = 1.0 - 2.0 * a
                front = side * R0 * _hauled(p, pulley if p.backlash_gap > 0.0 else angle)
                back = side * R5 * theta
                if a == 0:
                    back += slipped_by
                _relaxed(
                    p, ea, pre[a], front, back, s[a], ways[a], lengths[a], limits[a], crept[a], crept2[a], tension[a]
                )
                for j in range(9):
                    before = front if j == 0 else s[a, j - 1]
                    behind = back if j == 8 else s[a, j]
                    strain = (before - behind) / lengths[a, j]
                    crept[a, j] += relax * (strain - crept[a, j])
                    crept2[a, j] += relax2 * (strain - crept2[a, j])
            wheel = turning if p.backlash_gap > 0.0 else speed
            damped = CABLE_DAMPING * (R0 * wheel - R5 * omega) / whole[0]
            top, bottom = max(tension[0, 8] + damped, 0.0), max(tension[1, 8] - damped, 0.0)
            torque = R0 * (max(tension[0, 0] + damped, 0.0) - max(tension[1, 0] - damped, 0.0))
            driven = R5 * (top - bottom)
            if tick >= 0 and n == 0:
                out[tick, 0], out[tick, 1], out[tick, 2], out[tick, 3] = angle, torque, theta, driven
                out[tick, 4], out[tick, 5] = tension[0, 0] + damped, tension[1, 0] - damped
            if p.loose_clamp_step != 0.0 and driven > p.loose_clamp_torque:  # the rope creeps through its clamp
                slipped_by += h * p.loose_clamp_step * (driven / p.loose_clamp_torque - 1.0)
            part = (n + 0.5) / substeps if tick >= 0 else 0.0
            lag += follow * (reference[now] + part * (reference[ahead] - reference[now]) - lag)
            feed += follow * (rate[now] + part * (rate[ahead] - rate[now]) - feed)
            told, told_rate = lag, feed
            if p.actuator_lag_second > 0.5:
                lag2 += follow * (lag - lag2)
                feed2 += follow * (feed - feed2)
                told, told_rate = lag2, feed2
            w, d = p.servo_frequency, 2.0 * p.servo_damping_ratio * p.servo_frequency
            middle = angle + 0.5 * h * speed
            before = speed
            speed += h * (w * w * (told - middle) + d * (told_rate - speed)) / (1.0 + 0.5 * h * d)
            if p.backlash_gap > 0.0:
                beyond = over(angle - pulley, 0.5 * p.backlash_gap)
                push = _COUPLING * beyond + (0.02 * (before - turning) if beyond != 0.0 else 0.0)
                turning += h * (push - torque - 1e-4 * turning) / _PULLEY
                pulley += h * turning
            load = (p.position_dependent_load_stiffness + p.position_dependent_load_cubic * theta * theta) * theta
            depth = theta - p.contact_angle
            if depth > 0.0:
                load += max(p.contact_stiffness * depth + p.contact_damping * omega, 0.0)
            if p.worn_place_torque != 0.0:
                load += (
                    p.worn_place_torque * np.exp(-(((theta - p.worn_place_place) / 0.05) ** 2)) * np.tanh(omega / 0.2)
                )
            if p.draught_torque != 0.0:
                load += p.draught_torque * np.sin(2.0 * np.pi * t / p.draught_time + 2.0 * np.sin(0.31 * t))
            back = 0.0
            if p.swinging_tip_inertia > 0.0:
                back = p.swinging_tip_inertia * (
                    p.swinging_tip_frequency**2 * swing + 0.06 * p.swinging_tip_frequency * sway
                )
            inertia, viscous = p.output_inertia, p.output_damping + p.viscous_friction_coefficient
            both = top + bottom
            up, down = _level(p, omega, both, 1.0, t), _level(p, omega, both, -1.0, t)
            old, keeps = omega, 1.0 + h * viscous / inertia
            net = driven - load + back
            if soft > 0.0:
                level = up if z > 0.0 else down
                rub = 0.3 * np.sqrt(level / soft * inertia) * (1.0 - z * z)
                omega = (omega + h * (net - level * z) / inertia) / (keeps + h * rub / inertia)
                z = bristle(z, h * omega / soft)
            else:
                omega = rested(omega + h * net / inertia, h * up / inertia, h * down / inertia) / keeps
            if p.swinging_tip_inertia > 0.0:
                sway -= h * back / p.swinging_tip_inertia + (omega - old)
                swing += h * sway
            theta += h * omega
            angle += 0.5 * h * (before + speed)
            if tick >= 0:
                t += h


def spans(slip: np.ndarray) -> np.ndarray:
    """Lengths of spans and of the rope that slides on the idlers, in turn [2, 9], m.

    Parameters
    ----------
    slip : ndarray, shape (2, 4)
        Angles over which the rope slides on the idlers, rad.
    """
    wrapped = RADII * slip
    lengths = np.empty((2, 9))
    lengths[:, 0::2], lengths[:, 1::2] = SPANS, wrapped
    # a piece sits a quarter of the wrapped rope from each end of it, so that half of it lies between the two
    lengths[:, 1::2] *= 0.5
    lengths[:, 0:8:2] += 0.25 * wrapped
    lengths[:, 2::2] += 0.25 * wrapped
    return lengths


def simulate(values: Mapping[str, float], reference: np.ndarray, start: float = 0.0) -> dict[str, np.ndarray]:
    """Signals at every `CLOCK` by name, SI.

    Parameters
    ----------
    values : Mapping of str to float
        Parameters by the names of `TABLE`; others are null.
    reference : ndarray, shape (ticks,)
        Angle that the drive is told, rad.
    start : float
        Time of the first tick, s. The circuit settles for 0.3 s before it.

    Returns
    -------
    dict of str to ndarray
        time, `OUTPUTS` and drive_angle_command, each of shape (ticks,).
    """
    p = TABLE.pack(values)
    logs, slip = contact_logs(p.cable_friction, p.shaft_friction)
    more = 1.0 + p.friction_drift_change
    worn, _ = contact_logs(p.cable_friction * more, p.shaft_friction * more)
    reference = np.ascontiguousarray(reference, dtype=np.float64)
    out = np.empty((len(reference), len(OUTPUTS)))
    _run(p, logs, worn, spans(slip), reference, np.gradient(reference, CLOCK), start, out)
    signals = dict(zip(OUTPUTS, out.T, strict=True))
    return {"time": start + CLOCK * np.arange(len(reference)), **signals, "drive_angle_command": reference}
