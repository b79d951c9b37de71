"""The coupled wrist: coupling of the joints, contact law, energy, an independent solution, posture and two actions."""

import gymnasium as gym
import numpy as np
import pytest

from cable_envs.core.errors import ConfigurationError
from cable_envs.plants import plant_for
from cable_envs.sim.replay import replay
from cable_envs.sim.rigs import load_rig
from tests.reference.joint_reference import ratio_of
from tests.reference.wrist_reference import Wrist

PLANT = plant_for("wrist")
RIG = load_rig("wrist-8mm")
PERIOD, START, MODE = 0.01, 0.1, "position_and_pitch"
NAMES = tuple(s.name for s in PLANT.signals)
ENV = "cable_envs/Wrist-Position-Sine-v1"
COUPLING = 0.8306 / 1.0186
"""Of the dVRK's matrix."""


def at_rest(values, start=START):
    return dict(zip(NAMES, PLANT.rest(PLANT.prepare(values), np.array([start]))[:, 0], strict=False))


def run(values, command, pitch=None, substeps=20, mode=MODE, **options):
    options = {"hold": "step", "start": START, "second": pitch, **options}
    out = replay(PLANT, values, command, PERIOD, drive=mode, signals=NAMES, substeps=substeps, **options)
    return {name: out[:, k, 0] for k, name in enumerate(NAMES)}


def swinging(state, steps, yaw=0.5, pitch=0.4):
    t = PERIOD * np.arange(1, steps + 1)
    return state["drive_angle"] + yaw * np.sin(2 * np.pi * 2.3 * t), pitch * np.sin(2 * np.pi * 1.4 * t)


# -- coupling -------------------------------------------------------------------------------------------------------


def test_the_rig_has_the_coupling_of_the_published_matrix():
    assert RIG.values["coupling_radius"] / RIG.values["yaw_radius"] == pytest.approx(COUPLING, rel=2e-4)
    assert RIG.values["pitch_radius"] / RIG.values["yaw_radius"] == pytest.approx(2 * 0.6089 / 1.0186, rel=2e-4)


SLOW = np.concatenate([np.linspace(0.0, 0.6, 150), np.full(50, 0.6), np.linspace(0.6, -0.6, 300), np.full(50, -0.6)])


def test_pitch_drives_yaw_by_the_coupling_ratio_and_a_yaw_drive_that_follows_decouples_it():
    """Without friction: the yaw drive at rest, and one that follows by the ratio.

    While it moves, the pitch joint lags by its damping over its cables' stiffness, and swings where the ramp bends.
    """
    rig = RIG.replace({"friction_coefficient": 0.0, "yaw_stiffness": 0.0, "bearing_arm": 0.0})
    values, ratio = rig.column(PLANT), rig.values["coupling_radius"] / rig.values["yaw_radius"]
    held = run(values, np.full(len(SLOW), START), SLOW, hold="ramp")
    assert held["yaw_angle"] - START == pytest.approx(-ratio * held["pitch_angle"], abs=5e-3)
    assert np.ptp(held["yaw_angle"]) > 0.9
    followed = run(values, START + ratio * SLOW, SLOW, hold="ramp")
    assert followed["yaw_angle"] == pytest.approx(np.full(len(SLOW), START), abs=4e-3)
    assert followed["yaw_angle"][[199, -1]] == pytest.approx(START, abs=1e-5)  # where the pitch stands again
    assert np.ptp(followed["pitch_angle"]) > 1.1


def test_with_friction_decoupling_leaves_what_the_cables_stretch():
    """The same with the rig as it is: a residue of the order of the friction over the cables' stiffness."""
    rig = RIG.values
    followed = run(RIG.column(PLANT), START + rig["coupling_radius"] / rig["yaw_radius"] * SLOW, SLOW, hold="ramp")
    n = ratio_of({**rig, "wrap_angle": rig["yaw_wrap"] + 0.6})
    widest = (n - 1.0) * rig["yaw_pretension"] * 2.0 / rig["yaw_cable_stiffness"] / rig["yaw_radius"]
    moved = np.abs(followed["yaw_angle"] - START).max()
    assert 1e-3 < moved < widest < 0.3


def test_tension_of_the_yaw_cables_holds_the_pitch_joint_back():
    """Torque of the yaw cables on pitch is r_c / r_y of theirs on yaw, and at rest the pitch cables hold it."""
    x = at_rest(RIG.replace({"yaw_stiffness": 0.1}).column(PLANT), 0.5)
    assert x["yaw_torque"] == pytest.approx(0.05) and x["coupling_torque"] == pytest.approx(0.05 * 2.202 / 2.7)
    assert x["pitch_torque"] == pytest.approx(-x["coupling_torque"])


@pytest.mark.parametrize("rig", ["wrist-8mm", "wrist-8mm-motor"])
def test_at_rest_beside_the_middle_nothing_moves_without_friction(rig):
    """Where a spring pulls on the yaw joint: the pitch drive is told its place, and the joint stands beside it."""
    none = dict.fromkeys(("friction_coefficient", "yaw_friction", "pitch_friction", "bearing_arm"), 0.0)
    none.update(dict.fromkeys(("drive_friction", "encoder_counts"), 0.0) if rig.endswith("motor") else {})
    rig = load_rig(rig).replace({**none, "pitch_angle": 0.3, "yaw_stiffness": 0.1})
    plant, values = plant_for("wrist", drive=rig.drive), rig.column(plant_for("wrist", drive=rig.drive))
    names = [s.name for s in plant.signals]
    first = dict(zip(names, plant.rest(plant.prepare(values), np.array([0.5]))[:, 0], strict=False))
    assert first["pitch_drive_angle"] == first["pitch_command"] == 0.3
    told = np.full(30, first["drive_angle"]), np.full(30, 0.3)
    out = replay(plant, values, told[0], PERIOD, drive=MODE, second=told[1], hold="step", signals=names, start=0.5)
    for name in ("yaw_angle", "pitch_angle", "drive_angle", "pitch_drive_angle"):
        assert out[:, names.index(name), 0] == pytest.approx(first[name], abs=1e-9), name
    sag = first["coupling_torque"] / (2.0 * rig.values["pitch_radius"] ** 2 * rig.values["pitch_cable_stiffness"])
    assert first["pitch_angle"] - 0.3 == pytest.approx(sag, rel=1e-9) and sag > 0.01


def test_the_friction_of_pitch_grows_with_the_tension_of_the_yaw_cables():
    """Torque at which a pitch joint with a held yaw breaks away: bearing_arm times the sum of all tensions."""

    def friction(pretension):
        rig = RIG.replace({"friction_coefficient": 0.0, "bearing_arm": 3e-4, "yaw_pretension": pretension})
        seen = run(rig.column(PLANT), rig.values["coupling_radius"] / rig.values["yaw_radius"] * SLOW, SLOW,
                   hold="ramp", start=0.0)  # fmt: skip
        up, down = seen["pitch_torque"][100], seen["pitch_torque"][300]
        return 0.5 * (up - down)

    low, high = friction(10.0), friction(30.0)
    assert low == pytest.approx(3e-4 * (2 * 10.0 + 2 * 15.0), rel=0.1)
    assert high == pytest.approx(3e-4 * (2 * 30.0 + 2 * 15.0), rel=0.1)


# -- laws -----------------------------------------------------------------------------------------------------------


def test_reported_tensions_obey_the_contact_law_at_every_pitch():
    rng, rig = np.random.default_rng(4), RIG.replace({"yaw_pretension": 4.0, "friction_coefficient": 0.15})
    command, pitch = (np.repeat(rng.uniform(-0.8, 0.8, 60), 3) for _ in range(2))
    seen, v = run(rig.column(PLANT), command, pitch), rig.values
    for which, side, wrap in (
        ("", "a", v["yaw_wrap"] + seen["pitch_angle"]), ("", "b", v["yaw_wrap"] - seen["pitch_angle"]),
        ("pitch_", "a", np.full(180, v["pitch_wrap"])), ("pitch_", "b", np.full(180, v["pitch_wrap"])),
    ):  # fmt: skip
        n = np.array([ratio_of({**v, "wrap_angle": one}) for one in wrap[::15]]) * (1.0 + 1e-6)
        before, behind = (seen[f"{which}tension_{end}_{side}"][::15] for end in ("drive", "end"))
        assert min(before.min(), behind.min()) >= 0.0
        assert np.all(before <= n * behind) and np.all(behind <= n * before)
    assert seen["slack_fraction"].max() > 0.0


@pytest.mark.parametrize("changes", [
    {}, {"friction_coefficient": 0.0, "bearing_arm": 0.0}, {"yaw_pretension": 1.0}, {"friction_coefficient": 0.3},
], ids=str)  # fmt: skip
def test_no_energy_comes_from_nowhere(changes):
    """What both drives have put in is at no time less than what joints, spring and cables hold."""
    rng, rig = np.random.default_rng(3), RIG.replace({**changes, "yaw_damping": 0.0, "pitch_damping": 0.0})
    values, v, k = rig.column(PLANT), rig.values, 40
    command, pitch = (np.repeat(rng.uniform(-0.4, 0.4, 25), 6 * k) for _ in range(2))
    first, state = at_rest(values), PLANT.rest(PLANT.prepare(values), np.full(1, START))
    out = replay(
        PLANT, values, command, PERIOD / k, drive=MODE, second=pitch, hold="step", signals=NAMES, state=state,
        substeps=1,
    )[:, :, 0]  # fmt: skip
    seen = {name: np.r_[first[name], out[:, j]] for j, name in enumerate(NAMES)}
    work, held = 0.0, 0.5 * v["yaw_inertia"] * seen["yaw_velocity"] ** 2
    held = held + 0.5 * v["pitch_inertia"] * seen["pitch_velocity"] ** 2
    held = held + 0.5 * v["yaw_stiffness"] * seen["yaw_angle"] ** 2
    cables = (
        ("", "drive_angle", v["yaw_radius"], v["yaw_cable_stiffness"]),
        ("pitch_", "pitch_drive_angle", v["pitch_radius"], v["pitch_cable_stiffness"]),
    )
    for which, drive, radius, stiffness in cables:
        torque = radius * (seen[f"{which}tension_drive_a"] - seen[f"{which}tension_drive_b"])
        work = work + np.cumsum(0.5 * (torque[1:] + torque[:-1]) * np.diff(seen[drive]))
        for end, share in (("drive", v["drive_share"]), ("end", 1.0 - v["drive_share"])):
            for side in "ab":
                held = held + 0.5 * seen[f"{which}tension_{end}_{side}"] ** 2 * share / stiffness
    lost = work - (held[1:] - held[0])
    size = np.abs(work).max()
    assert np.diff(lost).min() > -3e-3 * size and lost.min() > -3e-3 * size
    if changes.get("friction_coefficient") == 0.0:
        assert np.abs(lost).max() < 0.02 * size
    else:
        assert lost[-1] > 0.05 * size


# -- against an independent solution ----------------------------------------------------------------------------------

SEEN = ("yaw_angle", "pitch_angle", "drive_angle", "tension_drive_a", "tension_end_a", "tension_drive_b",
        "tension_end_b", "pitch_tension_end_a", "pitch_tension_end_b")  # fmt: skip
CASES = {
    "needle driver": {},
    "slack at times": {"yaw_pretension": 2.0},
    "dry joints": {"pitch_friction": 0.01, "yaw_friction": 0.005},
}


@pytest.mark.parametrize("case", CASES)
def test_plant_against_tiny_explicit_steps(case):
    """20 us of a first-order scheme: at 200 substeps within 1e-3 of the motion, at the task's 20 within 6e-3."""
    rig = RIG.replace(CASES[case])
    values = rig.column(PLANT)
    state = at_rest(values)
    command, pitch = swinging(state, 25)
    rate, pitch_rate = (np.diff(np.r_[y[0], y]) / PERIOD for y in (command, pitch))
    other, expected = Wrist(rig.values, state, 2e-5), []
    for told in zip(command, pitch, rate, pitch_rate, strict=True):
        other.advance(*told, PERIOD)
        yaw, turned = other.tensions
        expected.append((other.y, other.p, other.d, *yaw[0], *yaw[1], turned[0][1], turned[1][1]))
    expected = np.array(expected)
    size = np.r_[np.ptp(expected[:, :3], axis=0), np.full(6, np.ptp(expected[:, 3:]))]
    for substeps, most in ((200, 1e-3), (20, 6e-3)):
        seen = run(values, command, pitch, substeps, rate=rate, second_rate=pitch_rate)
        found = np.column_stack([seen[name] for name in SEEN])
        assert (np.abs(found - expected) / size).max() < most


@pytest.mark.parametrize("case", CASES)
def test_the_default_step_is_within_one_per_cent_of_a_hundred_times_finer_ones(case):
    values = RIG.replace(CASES[case]).column(PLANT)
    command, pitch = swinging(at_rest(values), 60)
    coarse, fine = (run(values, command, pitch, substeps) for substeps in (20, 2000))
    for name in SEEN:
        assert np.abs(coarse[name] - fine[name]).max() < 0.01 * np.ptp(fine[name]), name


# -- commands, posture, steps -----------------------------------------------------------------------------------------


def test_the_posture_moves_the_pitch_in_the_mode_with_one_action():
    sine = {"kind": "sine", "amplitude": 0.5, "frequency": 0.5}
    env = gym.make(ENV, posture=sine, duration=2.0, reference={"kind": "constant"})
    _, first = env.reset(seed=0)
    held = np.array([2 * first["command"] / (2 * env.unwrapped.setup.high)])
    infos = [env.step(held)[4] for _ in range(60)]
    assert first["pitch_command"] == 0.0 and max(i["pitch_angle"] for i in infos) > 0.4
    assert infos[49]["pitch_command"] == pytest.approx(0.5 * np.sin(np.pi * 0.49))
    assert infos[-1]["yaw_angle"] == pytest.approx(-COUPLING * infos[-1]["pitch_angle"], abs=0.05)


def test_both_commands_are_the_agents():
    env = gym.make(ENV, action_mode=MODE, duration=2.0)
    env.reset(seed=0)
    for _ in range(50):
        *_, info = env.step(np.array([0.0, 0.5], np.float32))
    assert info["pitch_command"] == pytest.approx(0.5 * np.radians(80.0))
    assert info["pitch_angle"] == pytest.approx(info["pitch_command"], abs=0.12)  # friction over the cables' stiffness


def test_the_rig_holds_the_pitch_where_it_says():
    env = gym.make(ENV, rig={"pitch_angle": 0.5}, duration=1.0, reference={"kind": "constant"})
    _, first = env.reset(seed=0)
    held = np.array([first["command"] / env.unwrapped.setup.high])
    info = [env.step(held)[4] for _ in range(20)][-1]
    assert first["command"] == pytest.approx(2.202 / 2.7 * 0.5)
    assert (info["pitch_angle"], info["yaw_angle"]) == (pytest.approx(0.5, abs=1e-6), pytest.approx(0.0, abs=1e-6))
    with pytest.raises(ConfigurationError, match="within pitch_limit"):
        gym.make(ENV, rig={"pitch_angle": 1.5})


def test_out_of_range_is_that_of_the_published_file():
    env = gym.make(ENV, action_mode=MODE, duration=3.0)
    env.reset(seed=0)
    seen = [env.step(np.array([0.9, -0.9], np.float32))[4] for _ in range(150)]
    assert seen[0]["out_of_range"] == 0.0 and seen[-1]["out_of_range"] == 1.0
    assert abs(seen[-1]["yaw_angle"]) > np.radians(80.0)


def test_the_step_fits_light_jaws_or_the_rig_is_refused():
    # both joints on the spans behind their contacts turn at most this fast, and 0.0875 rad in a step
    yaw = (2.0 * 0.0027**2 * 1e4 / 0.2 + 0.02) / 2.5e-6
    pitch = 2.0 * (0.003228**2 + 0.002202**2) * 1e4 / 0.2 / 1e-5
    turns = np.sqrt(yaw + pitch - (0.5 * 2e-4 / 2.5e-6) ** 2)
    assert gym.make(ENV).unwrapped.setup.substeps == np.ceil(0.01 * turns / 0.0875) == 77
    light = gym.make(ENV, rig={"yaw_inertia": 1e-7}).unwrapped.setup.substeps
    assert 120 < light < 400
    with pytest.raises(ConfigurationError, match=f"substeps={light} or more"):
        gym.make(ENV, rig={"yaw_inertia": 1e-7}, substeps=20)
