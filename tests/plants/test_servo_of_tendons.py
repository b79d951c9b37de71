"""Drives with motors where several things are solved together: contacts of a sheath, the joint, the wrist.

References are explicit integrations in steps of 10 and 20 us (`tests.reference.motor_reference`).
"""

import gymnasium as gym
import numpy as np
import pytest

from benchmarks.properties.energy import MECHANISMS
from cable_envs import load_rig
from cable_envs.core.errors import ConfigurationError
from cable_envs.core.inputs import INPUTS
from cable_envs.sim.replay import replay
from tests.reference.motor_reference import ContactsWithMotor, JointWithMotors, WristWithMotors

SHEATH, JOINT, WRIST = "bowden-1m-20-motor", "finger-joint-motor", "wrist-8mm-motor"
RIGS = (SHEATH, JOINT, WRIST)
MODES = {SHEATH: "position", JOINT: "position", WRIST: "position_and_pitch"}
ENVS = {SHEATH: "TendonSheath", JOINT: "AntagonistJoint", WRIST: "Wrist"}
PERIOD = 0.01
LIMIT = {SHEATH: "tension_command_limit", JOINT: "drive_force_limit", WRIST: "drive_force_limit"}
DRIVES = {
    SHEATH: (("{}_{}", "drive_position", ""),),
    JOINT: (("{}_a_{}", "drive_a_position", ""), ("{}_b_{}", "drive_b_position", "")),
    WRIST: (("{}_{}", "drive_angle", "yaw_radius"), ("pitch_{}_{}", "pitch_drive_angle", "pitch_radius")),
}
"""Of every drive: how its signals are called, where it is, and the radius that makes an angle a way of the cable."""
SMOOTH = {"encoder_counts": 0.0}
LOSSLESS = {"drive_friction": 0.0, "gear_efficiency": 1.0, "friction_coefficient": 0.0} | SMOOTH
STRONG = {"supply_voltage": 1e4, "motor_current_limit": 1e4}


class Run:
    """A rig that follows commands (and second commands), [T] each, held over control periods."""

    def __init__(self, rig, changes, mode, command, second=None, substeps=20, period=PERIOD, start=0.0):
        made = load_rig(rig).replace(changes)
        plant = made.simulated_by()
        column = made.column(plant)
        p = plant.prepare(column if made.effects else column[: len(plant.parameters)])
        x, u = plant.rest(p, np.full(1, start)), INPUTS.zeros(1)
        names = [s.name for s in plant.signals]
        self.values, self.first = made.values, dict(zip(names, x[: len(names), 0].copy(), strict=True))
        chosen = next(m for m in plant.action_modes if m.name == mode)
        u.mode[:] = plant.number_of(chosen)
        held = self.first[chosen.second.rest_signal] if chosen.second is not None else 0.0
        self.command = np.asarray(command, float)
        self.second = np.full(len(self.command), held) if second is None else np.asarray(second, float)
        self.rates = [np.diff(np.r_[told[0], told]) / period for told in (self.command, self.second)]
        seen = []
        for told, other, rate, other_rate in zip(self.command, self.second, *self.rates, strict=True):
            u.command[:], u.second[:], u.command_rate[:], u.second_rate[:] = told, other, rate, other_rate
            plant.advance(x, p, u.rows, 0, 1, substeps, period / substeps)
            seen.append(x[: len(names), 0].copy())
        self.seen = dict(zip(names, np.array(seen).T, strict=True))

    def from_rest(self, name):
        """A signal with its value at rest before it [T + 1]."""
        return np.r_[self.first[name], self.seen[name]]


def waves(rig, mode, steps=60, size=1.0):
    """(command, second command) of a motion to and fro, with reversals of both."""
    t = PERIOD * np.arange(1, steps + 1)
    turn = np.sin(2 * np.pi * 1.2 * t)
    if rig == SHEATH:
        return (2e-3 + 0.015 * size * turn**2 if mode == "position" else 25.0 + 20.0 * size * turn), None
    quick, slow = np.sin(2 * np.pi * 2.3 * t), np.sin(2 * np.pi * 1.1 * t)
    if rig == JOINT:
        return (0.4 if mode == "position" else 0.3) * size * quick, 15.0 * (1.0 + 0.5 * size * slow)
    return 0.5 * size * quick, 0.4 * size * slow


def apart(seen, path):
    """Root mean square of a difference over how much the signal moves."""
    return np.sqrt(np.mean((np.array(path) - seen) ** 2)) / np.ptp(seen)


# -- against explicit steps -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("mode", ["position", "tension"])
def test_the_sheath_with_contacts_moves_as_its_equations_in_short_explicit_steps(mode):
    changes = {"cogging_torque": 1e-3, "tendon_damping": 0.0} | SMOOTH
    run = Run(SHEATH, changes, mode, waves(SHEATH, mode)[0])
    other = ContactsWithMotor(run.values, 20, 0.0, 2e-5)
    path = [
        (*other.advance(mode, told, rate, PERIOD), other.motor.current)
        for told, rate in zip(run.command, run.rates[0], strict=True)
    ]
    names = ("drive_tension", "load_tension", "drive_position", "load_position", "motor_current")
    for name, expected in zip(names, np.array(path).T, strict=True):
        assert apart(run.seen[name], expected) < 0.01, name


@pytest.mark.parametrize("mode", ["position", pytest.param("torque", marks=pytest.mark.slow)])
def test_the_joint_moves_as_its_equations_in_short_explicit_steps(mode):
    run = Run(JOINT, {"cogging_torque": 1e-3} | SMOOTH, mode, *waves(JOINT, mode))
    other, path = JointWithMotors(run.values, run.first, 1e-5), []
    for told in zip(run.command, run.second, *run.rates, strict=True):
        other.advance(mode, *told, PERIOD)
        path.append((other.q, *other.x, other.tensions[0][0], other.tensions[1][1], other.motors[0].current))
    names = ("joint_angle", "drive_a_position", "drive_b_position", "tension_drive_a", "tension_joint_b",
             "motor_a_current")  # fmt: skip
    for name, expected in zip(names, np.array(path).T, strict=True):
        assert apart(run.seen[name], expected) < 0.01, name


def test_the_wrist_moves_as_its_equations_in_short_explicit_steps():
    mode = MODES[WRIST]
    run = Run(WRIST, {"cogging_torque": 1e-3} | SMOOTH, mode, *waves(WRIST, mode), substeps=30)
    other, path = WristWithMotors(run.values, run.first, 1e-5), []
    for told in zip(run.command, run.second, *run.rates, strict=True):
        other.advance(*told, PERIOD)
        (a, b), (pitch_a, _) = other.tensions
        path.append((other.y, other.p, other.d, other.dp, a[0], b[1], pitch_a[1], other.motors[1].current))
    names = ("yaw_angle", "pitch_angle", "drive_angle", "pitch_drive_angle", "tension_drive_a", "tension_end_b",
             "pitch_tension_end_a", "pitch_motor_current")  # fmt: skip
    for name, expected in zip(names, np.array(path).T, strict=True):
        assert apart(run.seen[name], expected) < 0.01, name


# -- limits -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("ampere", [0.3, None])
@pytest.mark.parametrize("rig", RIGS)
def test_no_command_takes_more_force_or_current_than_the_drives_have(rig, ampere):
    """The output is held fast by a stiff spring; once the saturator comes first, once the amplifier's current."""
    stiff = {SHEATH: {"load_stiffness": 1e5}, JOINT: {"spring_stiffness": 50.0}, WRIST: {"yaw_stiffness": 5.0}}[rig]
    stiff |= {"breaking_tension": 1e6} | ({"motor_current_limit": ampere} if ampere else {})
    far = {SHEATH: 0.05, JOINT: 1.5, WRIST: 2.5}[rig]
    run = Run(rig, stiff, MODES[rig], np.full(80, far), substeps=40)
    limit, v = run.values[LIMIT[rig]], run.values
    reached = []
    for names, place, _ in DRIVES[rig]:
        asked, current, force = (
            run.seen[names.format(*of)] for of in (("servo", "force"), ("motor", "current"), ("motor", "force"))
        )
        speed = run.seen[place.replace("position", "velocity").replace("angle", "velocity")]
        most = min(limit, v["motor_current_limit"] * v["motor_constant"] * v["gear_ratio"] / v["spool_radius"])
        assert np.abs(asked).max() <= limit and np.abs(current).max() <= v["motor_current_limit"]
        driving = force * speed > 0.0
        assert np.abs(force[driving]).max(initial=0.0) <= v["gear_efficiency"] * most * (1.0 + 1e-12)
        reached.append(np.abs(current).max() / v["motor_current_limit"] if ampere else np.abs(asked).max() / limit)
    assert max(reached) == pytest.approx(1.0, rel=1e-12)


def test_voltage_and_back_emf_set_the_speed_that_is_left():
    """Full force asked for: at a tenth of the voltage the motor gets no faster than that drives it."""
    slow = {"supply_voltage": 2.4, "drive_speed_limit": 10.0, "load_stiffness": 0.0, "load_preload": 5.0}
    run = Run(SHEATH, slow, "tension", np.full(150, 60.0))
    v, speed = run.values, run.seen["drive_velocity"]
    emf = v["motor_constant"] * v["gear_ratio"] / v["spool_radius"] * speed
    left = (v["supply_voltage"] - emf) / (v["motor_resistance"] + v["supply_resistance"])
    np.testing.assert_allclose(run.seen["motor_current"][100:], left[100:], rtol=1e-2, atol=1e-3)
    assert 0.7 * v["supply_voltage"] < emf[-1] < v["supply_voltage"]


@pytest.mark.parametrize("rig", RIGS)
def test_with_a_weak_supply_no_motor_is_faster_than_its_voltage(rig):
    weak = {SHEATH: 2.4, JOINT: 3.0, WRIST: 1.0}[rig]  # the joint's tendons turn idle motors back
    told = {SHEATH: 0.03, JOINT: 1.4, WRIST: 2.0}[rig]
    run = Run(rig, {"supply_voltage": weak, "drive_speed_limit": 10.0}, MODES[rig], np.full(40, told), substeps=40)
    v, fastest = run.values, 0.0
    for _, place, radius in DRIVES[rig]:
        speed = run.seen[place.replace("position", "velocity").replace("angle", "velocity")] * v.get(radius, 1.0)
        fastest = max(fastest, np.abs(v["motor_constant"] * v["gear_ratio"] / v["spool_radius"] * speed).max())
    assert 0.2 * weak < fastest < weak  # friction, and what the tendons pull, take the rest


# -- energy -----------------------------------------------------------------------------------------------------------


def stored(rig, v, x):
    """Energy in springs, weights and moving masses without the drives."""
    if rig == SHEATH:
        return MECHANISMS["tendon_sheath"][0](v, x)
    if rig == JOINT:
        held = 0.5 * v["joint_inertia"] * x["joint_velocity"] ** 2 - v["weight_torque"] * np.cos(x["joint_angle"])
        hard, share, k = v["tendon_hardening"], v["drive_share"], v["tendon_stiffness"]
        for name, part in (("tension_drive", share), ("tension_joint", 1.0 - share)):
            for side in "ab":
                t = x[f"{name}_{side}"]
                line = 2.0 * t / (1.0 + np.sqrt(1.0 + 2.0 * hard * t))
                held = held + (0.5 * line**2 + hard * line**3 / 6.0) * part / k
        return held
    held = 0.5 * v["yaw_inertia"] * x["yaw_velocity"] ** 2 + 0.5 * v["pitch_inertia"] * x["pitch_velocity"] ** 2
    held = held + 0.5 * v["yaw_stiffness"] * x["yaw_angle"] ** 2
    for which, k in (("", v["yaw_cable_stiffness"]), ("pitch_", v["pitch_cable_stiffness"])):
        for end, share in (("drive", v["drive_share"]), ("end", 1.0 - v["drive_share"])):
            for side in "ab":
                held = held + 0.5 * x[f"{which}tension_{end}_{side}"] ** 2 * share / k
    return held


UNDAMPED = {
    SHEATH: {"load_damping": 0.0, "tendon_damping": 0.0}, JOINT: {"joint_damping": 0.0},
    WRIST: {"yaw_damping": 0.0, "pitch_damping": 0.0, "bearing_arm": 0.0},
}  # fmt: skip


def spent(rig, changes):
    """(what supply and resistances leave over what is stored more, after every step; energy that passed; the run)."""
    fine = 40
    command, second = waves(rig, MODES[rig], 60)
    many = None if second is None else np.repeat(second, fine)
    run = Run(rig, changes, MODES[rig], np.repeat(command, fine), many, 1, PERIOD / fine)
    v, x = run.values, {name: run.from_rest(name) for name in run.seen}
    held, put_in, heat = stored(rig, v, x), 0.0, 0.0
    turns, ohm = v["gear_ratio"] / v["spool_radius"], v["motor_resistance"] + v["supply_resistance"]
    inertia = v["drive_mass"] + (v["spool_inertia"] + v["motor_inertia"] * v["gear_ratio"] ** 2) / (
        v["spool_radius"] ** 2
    )
    for names, place, radius in DRIVES[rig]:
        scale, current = v.get(radius, 1.0), run.seen[names.format("motor", "current")]
        speed = scale * x[place.replace("position", "velocity").replace("angle", "velocity")]
        held = held + 0.5 * inertia * speed**2
        joule = ohm * current**2 * PERIOD / fine
        put_in = put_in + joule + v["motor_constant"] * turns * current * scale * np.diff(x[place])
        heat = heat + joule
    return np.cumsum(put_in - heat) - (held[1:] - held[0]), np.cumsum(np.abs(put_in - heat))[-1], run


@pytest.mark.parametrize("changes", [LOSSLESS, {}], ids=["lossless", "as it is"])
@pytest.mark.parametrize("rig", RIGS)
def test_what_the_supply_puts_in_is_heat_or_stored(rig, changes):
    """Electrical energy less that of the resistances is never less than what is stored more; lossless, it is that."""
    lost, passed, _ = spent(rig, changes | (UNDAMPED[rig] | {"drive_damping": 0.0} if changes else {}))
    assert np.diff(lost).min() > -2e-3 * passed and lost.min() > -2e-3 * passed
    if changes:
        assert np.abs(lost).max() < 0.01 * passed
    else:
        assert lost[-1] > 0.05 * passed


def test_a_drive_gains_nothing_while_it_crosses_its_gap():
    """Lossless, against a spring at the yaw joint: at no time is more there than the supply has put in.

    A drive that felt its cables within the gap would have the torque times the gap from nowhere at every reversal.
    """
    lossless = LOSSLESS | UNDAMPED[WRIST] | {"drive_damping": 0.0, "yaw_stiffness": 0.2}
    for gap in (0.0, 0.1):
        lost, _, run = spent(WRIST, lossless | {"backlash.gap": gap})
        missing = (np.maximum.accumulate(lost) - lost).max()
        torque = np.abs(run.seen["yaw_torque"]).max()
        assert torque > 0.05 and missing < 0.2 * torque * 0.1, (gap, missing, torque)


# -- what it goes over into -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("rig", "ideal", "mode"), [(SHEATH, "bowden-1m-20", "tension"), (JOINT, "finger-joint", "torque")]
)
def test_a_motor_without_losses_and_limits_that_is_told_its_force_is_the_ideal_drive(rig, ideal, mode):
    plain = load_rig(ideal).values
    as_ideal = {"drive_friction": 0.0, "gear_efficiency": 1.0, "motor_inertia": 0.0, "spool_inertia": 0.0} | STRONG
    as_ideal |= {name: plain[name] for name in ("drive_mass", "drive_damping")}
    command, second = waves(rig, mode)
    motor, other = Run(rig, as_ideal, mode, command, second), Run(ideal, {}, mode, command, second)
    moving = [name for name in other.seen if name.endswith(("_position", "_angle")) or name.startswith("tension_drive")]
    for name in moving:  # a motor has dry friction, if only of no size: it stops in the step in which it turns round
        assert apart(motor.seen[name], other.seen[name]) < 2e-3, name
    before = np.flatnonzero(np.diff(np.sign(other.seen[DRIVES[rig][0][1].replace("position", "velocity")])))[0]
    for name in moving:  # one scheme for both
        path = other.seen[name][:before]
        assert motor.seen[name][:before] == pytest.approx(path, abs=1e-9 * np.ptp(path)), name


@pytest.mark.parametrize(("rig", "ideal"), [(SHEATH, "bowden-1m-20"), (JOINT, "finger-joint"), (WRIST, "wrist-8mm")])
def test_a_servo_of_the_same_frequency_tends_to_the_ideal_drive_as_no_cable_can_push_it(rig, ideal):
    """Gains in proportion to the inertia: what the cables do to the drive falls with it, and the delay is left."""
    v = load_rig(ideal).values
    command, second = waves(rig, MODES[rig], 60, 0.3)
    other = Run(ideal, {}, MODES[rig], command, second, substeps=80)

    def error(mass):
        square, twice = v["servo_frequency"] ** 2, 2.0 * v["servo_damping_ratio"] * v["servo_frequency"]
        heavy = {
            "drive_mass": mass, "motor_inertia": 0.0, "spool_inertia": 0.0, "drive_friction": 0.0,
            "gear_efficiency": 1.0, "drive_damping": 0.0, "servo_kp": mass * square, "servo_kd": mass * twice,
            "servo_ki": 0.0, "servo_filter": 0.0, "encoder_period": PERIOD / 80, LIMIT[rig]: 9e4,
        } | STRONG | SMOOTH  # fmt: skip
        run = Run(rig, heavy, MODES[rig], command, second, substeps=80)
        return max(apart(other.seen[place], run.seen[place]) for _, place, _ in DRIVES[rig])

    light, heavy = error(2.0), error(1000.0)
    assert heavy < 0.01 and light > 3.0 * heavy


@pytest.mark.parametrize("rig", RIGS)
def test_without_friction_and_within_its_limits_everything_is_linear(rig):
    """Twice the command is twice the motion, as far as differences of 1e-7 rad give slopes."""
    linear = LOSSLESS | {
        SHEATH: {}, JOINT: {"weight_torque": 0.0, "tendon_hardening": 0.0},
        WRIST: {"bearing_arm": 0.0},
    }[rig]  # fmt: skip
    turn = np.sin(2 * np.pi * 1.5 * PERIOD * np.arange(1, 41))
    start, size = {SHEATH: (0.01, 1e-3), JOINT: (0.0, 0.05), WRIST: (0.0, 0.05)}[rig]
    rest = Run(rig, linear, MODES[rig], [0.0], start=start).first
    held = rest["drive_position" if rig == SHEATH else "drive_angle"]
    once, twice = (Run(rig, linear, MODES[rig], held + k * size * turn, start=start) for k in (1.0, 2.0))
    for name in (*(place for _, place, _ in DRIVES[rig]), *(n.format("motor", "current") for n, _, _ in DRIVES[rig])):
        moved = once.seen[name] - rest[name]
        assert twice.seen[name] - rest[name] == pytest.approx(2.0 * moved, abs=1e-6 * max(np.ptp(moved), 1e-9)), name


# -- encoder, rest, batch, replay, step -------------------------------------------------------------------------------


@pytest.mark.parametrize("rig", RIGS)
def test_encoders_show_steps_at_their_own_rate(rig):
    coarse = {"encoder_counts": 20.0, "encoder_period": 0.02}
    command, second = waves(rig, MODES[rig])
    run = Run(rig, coarse, MODES[rig], command, second, substeps=40)
    v = run.values
    step = 2.0 * np.pi * v["spool_radius"] / (v["encoder_counts"] * v["gear_ratio"])
    for names, place, radius in DRIVES[rig]:
        shown = run.seen[names.format("encoder", "position")]
        np.testing.assert_allclose(shown / step, np.round(shown / step), atol=1e-9)
        still = np.diff(shown) == 0.0
        assert (still[::2].all() or still[1::2].all()) and np.ptp(shown) > 3.0 * step
        behind = np.abs(np.diff(v.get(radius, 1.0) * run.from_rest(place))).max()  # in a control period
        assert np.abs(shown - v.get(radius, 1.0) * run.seen[place]).max() < 0.51 * step + 2.5 * behind


@pytest.mark.parametrize("rig", RIGS)
def test_it_stays_at_rest(rig):
    run = Run(rig, {}, MODES[rig], [0.0])
    held = run.first["drive_position" if rig == SHEATH else "drive_angle"]
    run = Run(rig, {}, MODES[rig], np.full(200, held))
    for name in (place for _, place, _ in DRIVES[rig]):
        assert np.ptp(run.from_rest(name)) == 0.0


@pytest.mark.parametrize("rig", [JOINT, *(pytest.param(rig, marks=pytest.mark.slow) for rig in (SHEATH, WRIST))])
def test_lanes_are_single_environments_to_the_bit_and_a_replay_is_the_episode(rig):
    env_id, options = f"cable_envs/{ENVS[rig]}-Position-Sine-v1", {"rig": load_rig(rig)}
    many = gym.make_vec(env_id, num_envs=2, vectorization_mode="vector_entry_point", **options)
    alone = [gym.make(env_id, **options) for _ in range(2)]
    first = many.reset(seed=[3, 4])[0]
    began = [one.reset(seed=s) for one, s in zip(alone, (3, 4), strict=True)]
    np.testing.assert_array_equal(first, [b[0] for b in began])
    setup, infos, rng = alone[0].unwrapped.setup, [], np.random.default_rng(0)
    for _ in range(25):
        actions = rng.uniform(-0.3, 0.5, (2, 1)).astype(np.float32)
        together = many.step(actions)[0]
        steps = [one.step(a) for one, a in zip(alone, actions, strict=True)]
        np.testing.assert_array_equal(together, [step[0] for step in steps])
        infos.append(steps[0][4])
    names = [s.name for s in setup.plant.signals if s.name != "out_of_range"]  # of the rig, which a replay knows not
    commands = np.array([info["command"] for info in infos])
    again = replay(
        setup.plant, setup.rig.column(setup.plant), commands, setup.control_period, drive=setup.action_mode.name,
        hold="step", signals=names, substeps=setup.substeps,
        start=began[0][1]["load_position" if rig == SHEATH else "joint_angle" if rig == JOINT else "yaw_angle"],
        rate=np.diff(np.r_[began[0][1]["command"], commands]) / setup.control_period,
    )[:, :, 0]  # fmt: skip
    expected = np.array([[info[name] for name in names] for info in infos])
    assert again == pytest.approx(expected, rel=1e-9, abs=1e-11)
    shown = {SHEATH: "encoder_position", JOINT: "encoder_angle", WRIST: "encoder_angle"}[rig]
    channels = [c.name for c in alone[0].unwrapped.channels]
    place = next(name for name in ("drive_position", "drive_angle") if name in channels)
    seen = steps[0][0][channels.index(place)] * alone[0].unwrapped.channels[channels.index(place)].scale
    assert seen == pytest.approx(infos[-1][shown], rel=1e-5, abs=1e-6)


@pytest.mark.parametrize("rig", [pytest.param(SHEATH, marks=pytest.mark.slow), JOINT, WRIST])
def test_within_its_gap_a_drive_moves_the_same_whatever_the_tendons_pull(rig):
    """The nut is held by its friction, and with it the tendons: none moves, and none is felt."""
    pulls = {
        SHEATH: ({"load_preload": 5.0}, {"load_preload": 30.0}), JOINT: ({"co_contraction": 10.0}, {}),
        WRIST: ({"yaw_stiffness": 0.0}, {"yaw_stiffness": 0.1}),
    }[rig]  # fmt: skip
    gap, size, start = {SHEATH: (6e-3, 2e-3, 5e-3), JOINT: (0.3, 0.1, 0.0), WRIST: (0.3, 0.1, 0.5)}[rig]
    rest_of, place = "drive_position" if rig == SHEATH else "drive_angle", DRIVES[rig][0][1]
    tension = "tension_drive_a" if rig != SHEATH else "drive_tension"
    told, paths, held = size * np.sin(2 * np.pi * 1.5 * PERIOD * np.arange(1, 61)), [], []
    for pull in pulls:
        changes = SMOOTH | pull | {"backlash.gap": gap}
        first = Run(rig, changes, MODES[rig], [0.0], start=start).first
        run = Run(rig, changes, MODES[rig], first[rest_of] + told, start=start)
        assert np.ptp(run.from_rest(tension)) < 1e-9
        paths.append(run.seen[place] - first[place])
        held.append(first[tension])
    assert abs(held[1] - held[0]) > 1.0
    assert paths[1] == pytest.approx(paths[0], abs=1e-9 * gap) and np.ptp(paths[1]) > 1.5 * size * (
        load_rig(rig).values["moment_arm"] if rig == JOINT else 1.0
    )


@pytest.mark.slow
@pytest.mark.parametrize("rig", RIGS)
def test_a_gap_between_drive_and_tendon_is_run_through(rig):
    """With the effect ``backlash``: at a reversal the drive's end stays while the drive goes through the gap."""
    gap = {SHEATH: 1e-3, JOINT: 0.1, WRIST: 0.1}[rig]
    output = {SHEATH: "load_position", JOINT: "joint_angle", WRIST: "yaw_angle"}[rig]
    command, _ = waves(rig, MODES[rig], 150)

    def swing(gap):
        made = load_rig(rig).replace({"backlash.gap": gap})
        plant = made.simulated_by()
        p, u, moved = plant.prepare(made.column(plant)), INPUTS.zeros(1), []
        x, mode = plant.rest(p, np.full(1, 0.005 if rig == SHEATH else 0.0)), plant.action_modes[0]
        if mode.second is not None:
            u.second[:] = x[plant.row(mode.second.rest_signal)]
        for told in command:
            u.command[:] = told
            plant.advance(x, p, u.rows, 0, 1, 40, PERIOD / 40)
            moved.append(x[plant.row(output), 0])
        return np.ptp(moved[60:])

    assert swing(0.0) - swing(gap) == pytest.approx(gap, rel=0.15)  # the tensions at a reversal are others too


def test_integration_steps_fit_the_light_jaw_and_the_encoder_or_the_rig_is_refused():
    env = gym.make("cable_envs/TendonSheath-Position-Sine-v1", rig=load_rig("endoscope-2m-motor"))
    needed = env.unwrapped.setup.substeps
    plant, rig = env.unwrapped.setup.plant, env.unwrapped.setup.rig
    longest = plant.longest_step(plant.prepare(rig.column(plant)))[0]
    assert needed % 10 == 0 and needed > 20 and PERIOD / needed <= longest < PERIOD / (needed - 10)
    with pytest.raises(ConfigurationError, match="substeps="):
        gym.make("cable_envs/TendonSheath-Position-Sine-v1", rig=load_rig("endoscope-2m-motor"), substeps=10)


@pytest.mark.parametrize("rig", RIGS)
def test_a_hundred_times_shorter_steps_change_nothing_by_a_percent(rig):
    command, second = waves(rig, MODES[rig])
    substeps = 30 if rig == WRIST else 20
    coarse, fine = (
        Run(rig, SMOOTH, MODES[rig], command, second, substeps=n) for n in (substeps, 100 * substeps)
    )  # fmt: skip
    for name, path in fine.seen.items():
        if name.endswith(("_position", "_angle")) or "tension" in name:
            assert apart(path, coarse.seen[name]) < 0.01 or np.ptp(path) < 1e-9, name
