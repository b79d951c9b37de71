"""The closed circuit of two cables over four idlers a side: spans, and rope masses that rub on the idlers.

Every span is a spring from one pulley to the next with half of what is wrapped on both. At every idler a lump of rope
moves under

    m s'' = T_before - T_behind - (T_before + T_behind) tanh(Z ln(lambda) / 2)

which balances exactly where T_before / T_behind = lambda^Z, so that sliding (Z = 1 or -1) gives the law of Zou 2022. In
between Z is what keeps the rope at rest: friction bounds the impulse of a step (Moreau's time stepping), nothing is
solved or switched. Delay, transition and working phases follow; no equilibrium is solved for. The output's own dry
friction is a level times a state in [-1, 1] that its motion drives. Leapfrog at `STEP`. Geometry: Table 2 of Zou 2022.
"""

from collections.abc import Mapping

import numpy as np

from cable_envs.proof.simulators.numerics import Table, jit, slipped, tension_ratio

STEP = 5e-5
CLOCK = 1e-3
_SUBSTEPS = round(CLOCK / STEP)
STIFF = 1e-5
"""rad, of the output's sticking."""
ROPE = 0.02
"""kg at an idler: far more than the rope's own, so that its vibration is resolved, and too little to be measured."""
GRAVITY = 9.81
CABLE_DAMPING = 8.0
"""N s: force per strain rate"""

WRAPS = np.array([[0.279, 1.571, 3.141, 3.217], [0.279, 1.571, 3.141, 3.390]])
RADII = np.array([[4e-3, 8e-3, 5e-3, 8e-3], [4e-3, 5e-3, 8e-3, 5e-3]])
SPANS = np.array([[38.5e-3, 185e-3, 85e-3, 85e-3, 39.9e-3], [38.5e-3, 185e-3, 85e-3, 85e-3, 38.7e-3]])
R0, R5, ROPE_RADIUS, SHAFT_RADIUS = 7e-3, 5e-3, 0.56e-3, 2.5e-3

TABLE = Table(__name__, {
    "tensile_stiffness": 1.684e4, "pretension_top": 50.0, "pretension_bottom": 50.0, "shaft_friction": 0.157,
    "cable_friction": 0.54, "output_inertia": 2e-5, "output_damping": 2e-4, "contact_stiffness": 0.2,
    "contact_angle": 0.0, "contact_damping": 2e-3, "payload_mass": 0.0, "payload_arm": 15e-3,
    "servo_frequency": 60.0, "servo_damping_ratio": 0.9,
    "coulomb_friction.torque": 0.0, "viscous_friction.coefficient": 0.0,
    "stribeck_friction.excess": 0.0, "stribeck_friction.speed": 0.1,
    "asymmetric_friction.difference": 0.0, "presliding_hysteresis.distance": 0.0,
    "load_dependent_friction.coefficient": 0.0, "cable_elongation.compliance": 0.0,
    "stiffness_hardening.coefficient": 0.0, "viscoelastic_creep.share": 0.0, "viscoelastic_creep.time": 3.0,
    "friction_drift.change": 0.0, "friction_drift.time": 30.0, "backlash.gap": 0.0,
    "position_ripple.amplitude": 0.0, "position_ripple.number": 8.0, "position_ripple.phase": 0.0,
    "position_dependent_load.stiffness": 0.0, "position_dependent_load.cubic": 0.0, "actuator_lag.time": 0.0,
    "thermal_length.strain": 0.0, "thermal_length.period": 40.0, "pendulum_sway.inertia": 0.0,
    "pendulum_sway.frequency": 1.5, "floor_vibration.amplitude": 0.0, "floor_vibration.frequency": 3.0,
    "ratchet.torque": 0.0, "ratchet.place": 0.0, "ratchet.width": 0.06, "sheath_rubbing.curvature": 0.0,
})  # fmt: skip
Parameters = TABLE.kind

OUTPUTS = ("drive_angle", "drive_torque", "output_angle", "output_torque", "tension_top", "tension_bottom")
_COUPLING, _PULLEY = 1500.0, 2e-5
"""N m/rad and kg m^2 of the driving pulley behind a coupling with play: 0.1 N m twists it by a twentieth of a small
gap, so that the gap is what is lost."""


def contact_logs(mu_cable: float, mu_shaft: float) -> tuple[np.ndarray, np.ndarray]:
    """(ln lambda, slip angle in rad) of every idler [2, 4].  Zou 2022, Eqs. (12), (30): physics.md, section 5."""
    g = (SHAFT_RADIUS * mu_shaft / RADII) ** 2
    w = np.cos(WRAPS)
    low = ((1 - g * w) - np.sqrt((1 - g * w) ** 2 - (1 - g) ** 2)) / (1 - g)
    slip = np.minimum(-np.log(low) / mu_cable, WRAPS)
    rho = (RADII - ROPE_RADIUS) / ROPE_RADIUS
    logs = [[np.log(tension_ratio(rho[a, i], mu_cable, slip[a, i])) for i in range(4)] for a in range(2)]
    return np.array(logs), slip


@jit
def _dry(p, omega, held, both, warm):
    """Level of the output's dry friction, N m; ``both``: sum of the tensions at the driven pulley."""
    level = (
        p.coulomb_friction_torque * (1.0 + p.asymmetric_friction_difference * held)
        + p.load_dependent_friction_coefficient * R5 * both
    )
    if p.stribeck_friction_excess != 0.0:
        level += p.stribeck_friction_excess * np.exp(-((omega / p.stribeck_friction_speed) ** 2))
    return level * warm


@jit
def _hauled(p, angle):
    """Angle by which a driving pulley at ``angle`` has hauled the cables, rad: with its ripple."""
    return (
        angle + p.position_ripple_amplitude * np.sin(p.position_ripple_number * angle + p.position_ripple_phase)
        if p.position_ripple_amplitude != 0.0
        else angle
    )


@jit
def _run(p, logs, worn, length, reference, rate, start, out):
    """Fill ``out`` [ticks, 6] (`OUTPUTS`).

    logs, worn [2, 4]: ln lambda at first and when friction has drifted wholly; length [2, 5] of the spans with what is
    wrapped, m.
    """
    h = STEP
    ea = 1.0 / (1.0 / p.tensile_stiffness + p.cable_elongation_compliance)
    pre = np.array([p.pretension_top, p.pretension_bottom])
    follow = 1.0 - np.exp(-h / p.actuator_lag_time) if p.actuator_lag_time > 0.0 else 1.0
    relax = 1.0 - np.exp(-h / p.viscoelastic_creep_time)
    s, v = np.zeros((2, 4)), np.zeros((2, 4))
    crept, tension = np.zeros((2, 5)), np.zeros((2, 5))
    stiffness, damping = np.empty((2, 5)), np.empty((2, 5))
    for a in range(2):
        for j in range(5):
            stiffness[a, j] = ea / length[a, j]
            damping[a, j] = CABLE_DAMPING / length[a, j]
    dry = (
        p.coulomb_friction_torque != 0.0
        or p.load_dependent_friction_coefficient != 0.0
        or p.stribeck_friction_excess != 0.0
    )
    settle = int(0.3 / h + 0.5)
    angle, speed, lagged = reference[0], 0.0, reference[0]
    pulley, turning, feed = angle, 0.0, 0.0
    hauled = _hauled(p, angle)
    theta = hauled * R0 / R5
    for a in range(2):  # cable and pulleys lie as they were mounted: nothing is pulled but by the pretension
        for i in range(4):
            s[a, i] = (1.0 - 2.0 * a) * R0 * hauled
    omega, held, swing, sway, armed = 0.0, 0.0, 0.0, 0.0, 1.0
    t, torque = start, 0.0
    for tick in range(-1, len(reference)):
        now = max(tick, 0)
        ahead = min(now + 1, len(reference) - 1) if tick >= 0 else now
        for n in range(settle if tick < 0 else _SUBSTEPS):
            part = n / _SUBSTEPS if tick >= 0 else 0.0  # the command goes in straight lines from tick to tick
            lagged += follow * (reference[now] + part * (reference[ahead] - reference[now]) - lagged)
            feed += follow * (rate[now] + part * (rate[ahead] - rate[now]) - feed)
            speed += h * (
                p.servo_frequency**2 * (lagged - angle)
                + 2.0 * p.servo_damping_ratio * p.servo_frequency * (feed - speed)
            )
            hauled = _hauled(p, pulley if p.backlash_gap > 0.0 else angle)
            done = 1.0 - np.exp(-t / p.friction_drift_time) if p.friction_drift_change != 0.0 else 0.0
            rough = 1.0 + p.sheath_rubbing_curvature * theta * theta
            strain = 0.0
            if p.thermal_length_strain != 0.0:
                strain = p.thermal_length_strain * 0.5 * (1.0 - np.cos(2.0 * np.pi * t / p.thermal_length_period))
            wheel = turning if p.backlash_gap > 0.0 else speed
            for a in range(2):
                side = 1.0 - 2.0 * a
                for j in range(5):
                    front = side * R0 * hauled if j == 0 else s[a, j - 1]
                    front_v = side * R0 * wheel if j == 0 else v[a, j - 1]
                    back = side * R5 * theta if j == 4 else s[a, j]
                    back_v = side * R5 * omega if j == 4 else v[a, j]
                    e = front - back - strain * length[a, j]
                    pull = pre[a] + stiffness[a, j] * e + damping[a, j] * (front_v - back_v)
                    if p.stiffness_hardening_coefficient != 0.0:
                        pull += ea * p.stiffness_hardening_coefficient * (e / length[a, j]) ** 2
                    if p.viscoelastic_creep_share != 0.0:
                        crept[a, j] += relax * (e - crept[a, j])
                        pull += p.viscoelastic_creep_share * stiffness[a, j] * (e - crept[a, j])
                    tension[a, j] = max(pull, 0.0)
                for i in range(4):
                    both = tension[a, i] + tension[a, i + 1]
                    push = v[a, i] + h * (tension[a, i] - tension[a, i + 1]) / ROPE
                    level = (logs[a, i] + done * (worn[a, i] - logs[a, i])) * rough
                    grip = h * both * np.tanh(0.5 * level) / ROPE  # bounds the impulse: sticks exactly
                    v[a, i] = push - grip if push > grip else (push + grip if push < -grip else 0.0)
            torque = R0 * (tension[0, 0] - tension[1, 0])
            if tick >= 0 and n == 0:  # where nothing has moved since the forces were taken
                out[tick, 0], out[tick, 1], out[tick, 2] = angle, torque, theta
                out[tick, 3] = R5 * (tension[0, 4] - tension[1, 4])
                out[tick, 4], out[tick, 5] = tension[0, 0], tension[1, 0]
            if p.backlash_gap > 0.0:
                twist = angle - pulley
                half = 0.5 * p.backlash_gap
                over = twist - half if twist > half else (twist + half if twist < -half else 0.0)
                push = _COUPLING * over + (0.02 * (speed - turning) if over != 0.0 else 0.0)
                turning += h * (push - torque - 1e-4 * turning) / _PULLEY
                pulley += h * turning
            load = (p.output_damping + p.viscous_friction_coefficient) * omega + (
                p.position_dependent_load_stiffness + p.position_dependent_load_cubic * theta * theta
            ) * theta
            depth = theta - p.contact_angle
            if depth > 0.0:
                load += max(p.contact_stiffness * depth + p.contact_damping * omega, 0.0)
            load += p.payload_mass * p.payload_arm * GRAVITY * np.cos(theta) if p.payload_mass != 0.0 else 0.0
            if dry:
                level = _dry(p, omega, held, tension[0, 4] + tension[1, 4], 1.0 + p.friction_drift_change * done)
                load += level * held
                if abs(held) < 1.0:
                    load += (
                        0.5
                        * np.sqrt(level / max(STIFF, p.presliding_hysteresis_distance) * p.output_inertia)
                        * (1.0 - held * held)
                        * omega
                    )
            if p.floor_vibration_amplitude != 0.0:
                load += p.floor_vibration_amplitude * np.sin(2.0 * np.pi * p.floor_vibration_frequency * t)
            if p.ratchet_torque != 0.0:
                load += armed * p.ratchet_torque * np.exp(-(((theta - p.ratchet_place) / p.ratchet_width) ** 2))
                if theta > p.ratchet_place + 2.5 * p.ratchet_width:
                    armed = 0.0
                elif theta < p.ratchet_place - 2.5 * p.ratchet_width:
                    armed = 1.0
            if p.pendulum_sway_inertia != 0.0:
                back = p.pendulum_sway_inertia * p.pendulum_sway_frequency**2 * (
                    theta - swing
                ) + 0.05 * p.pendulum_sway_inertia * p.pendulum_sway_frequency * (omega - sway)
                load += back
                sway += h * back / p.pendulum_sway_inertia
                swing += h * sway
            omega += h * (R5 * (tension[0, 4] - tension[1, 4]) - load) / p.output_inertia
            theta += h * omega
            angle += h * speed  # all positions after all forces: else the drive is half a step ahead of the output
            if dry:
                held = slipped(held, h * omega, STIFF, p.presliding_hysteresis_distance)
            for a in range(2):
                for i in range(4):
                    s[a, i] += h * v[a, i]
            if tick >= 0:
                t += h


def simulate(values: Mapping[str, float], reference: np.ndarray, start: float = 0.0) -> dict[str, np.ndarray]:
    """Signals at every `CLOCK` by name, SI  [ticks].

    values: parameters by the names of `TABLE`; reference: commanded drive angle, rad, at every tick; start: time of the
    first tick, s. The circuit first settles for 0.3 s at the first reference.
    """
    p = TABLE.pack(values)
    logs, slip = contact_logs(p.cable_friction, p.shaft_friction)
    worn, _ = contact_logs(
        p.cable_friction * (1.0 + p.friction_drift_change), p.shaft_friction * (1.0 + p.friction_drift_change)
    )
    wrapped = RADII * slip
    length = SPANS + 0.5 * (np.pad(wrapped, ((0, 0), (1, 0))) + np.pad(wrapped, ((0, 0), (0, 1))))
    reference = np.ascontiguousarray(reference, dtype=np.float64)
    out = np.empty((len(reference), len(OUTPUTS)))
    _run(p, logs, worn, length, reference, np.gradient(reference, CLOCK), start, out)
    signals = dict(zip(OUTPUTS, out.T, strict=True))
    return {"time": start + CLOCK * np.arange(len(reference)), **signals, "drive_angle_command": reference}
