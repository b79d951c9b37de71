"""Suite v1: levels, draws of an episode, sensors of a rig, rules, prices; what they must and must not give away."""

import math

import gymnasium as gym
import numpy as np
import pytest
from scipy import signal as filters

import cable_envs
from cable_envs.baselines import make_controller
from cable_envs.baselines.base import command_range
from cable_envs.core.config import config_names, config_path, read_yaml
from cable_envs.core.errors import ConfigurationError
from cable_envs.sim.references import FIELDS, KINDS
from cable_envs.sim.registered import setup_of
from cable_envs.sim.suite.drawing import DrawnSignal
from cable_envs.sim.suite.judging import CUTOFF, PAUSE, WINDOW, high_pass
from cable_envs.sim.tasks import SUITE, load_task

EASY, MEDIUM, HARD = (f"cable_envs/CableHole-Track-{level}-v1" for level in ("Easy", "Medium", "Hard"))
STEPS = "cable_envs/CableHole-Step-Classic-v1"
STILL = {"kind": "constant"}


def place(env, name):
    return [c.name for c in env.unwrapped.channels].index(name)


def held(env):
    """The action that keeps the mechanism where a reset has left it."""
    return env.unwrapped.simulation.buffers.named.action.copy()


def run(env, act, seed=1, options=None):
    """Whole episode under act(k, observation, info): first observation and info, and every step's five values."""
    seen = [env.reset(seed=seed, options=options)]
    observation, info = seen[0]
    while True:
        action = np.clip(act(len(seen) - 1, observation, info), -1.0, 1.0)
        seen.append(env.step(np.array([action], np.float64)))
        observation, _, terminated, truncated, info = seen[-1]
        if terminated or truncated:
            return seen


# declarations


@pytest.mark.parametrize("env_id", cable_envs.SUITE_IDS)
@pytest.mark.parametrize("split", ["train", "test"])
def test_every_level_makes_a_setup(env_id, split):
    setup = setup_of(env_id, {"split": split})
    assert (setup.conditions.level, setup.conditions.split) == (env_id.split("-")[2], split)
    assert setup.task.homing > 0.0 and setup.conditions.rules and setup.conditions.activity > 0.0
    for choice in setup.reference.get("one_of", [setup.reference]):
        assert choice["start"] >= setup.task.homing  # the drive may find itself before anything is asked for
    assert np.any(setup.noise > 0.0)
    assert {"overload", "runaway"} <= {rule.name for rule in setup.conditions.rules}


def test_ids_are_tasks_times_levels():
    declared = {f"cable_envs/{name}-{level}-v1" for name in SUITE for level in load_task(name).levels}
    assert set(cable_envs.SUITE_IDS) == declared
    assert not set(cable_envs.SUITE_IDS) & {*cable_envs.ENV_IDS, *cable_envs.V1_IDS}


@pytest.mark.parametrize("env_id", [i for i in cable_envs.SUITE_IDS if "CableHole" in i])
def test_agents_and_controllers_command_the_same_range(env_id):
    setup = setup_of(env_id, {})
    assert (setup.low, setup.high) == (0.0, 100.0)
    assert (setup.low, setup.high) == command_range(setup.plant.name, setup.action_mode.name, setup.rig.values)
    assert (
        setup_of(env_id, {"rig": {"load_mass": 4.0}}).high == 100.0
    )  # a change of the rig keeps the rest of the level


@pytest.mark.parametrize("env_id", [i for i in cable_envs.SUITE_IDS if i.endswith("Hard-v1")])
def test_rigs_of_the_test_are_others(env_id):
    train, test = (setup_of(env_id, {"split": split}) for split in ("train", "test"))
    ranges = [{name: (low, high) for name, low, high in setup.randomize} for setup in (train, test)]
    changed = [name for name in ranges[1] if ranges[0].get(name) != ranges[1][name]]
    assert len(changed) >= 3 or test.conditions.cable_rows


@pytest.mark.parametrize("env_id", cable_envs.SUITE_IDS)
def test_rigs_are_the_same_without_their_effects(env_id):
    """Effects are drawn last, so that an oracle without them gets the same rigs."""
    names = [name for name, _, _ in setup_of(env_id, {"split": "test"}).randomize]
    assert names == sorted(names, key=lambda name: "." in name)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"level": "Hards"}, "did you mean 'Hard'"),
        ({"level": None}, "task CableHole-Track needs a level; one of Easy, Medium, Hard"),
        ({"level": "Hard", "split": "tests"}, "unknown split 'tests'"),
        ({"level": "Hard", "observe": "full"}, "has sensors of 'output' only; observe='full' needs sensors='ideal'"),
        ({"level": "Hard", "sensors": "ideals"}, "did you mean 'ideal'"),
        ({"level": "Hard", "reference": {"kind": "sine", "amplitude": [2, 1], "frequency": 1}}, "a range .low, high."),
        ({"level": "Hard", "reference": {"one_of": []}}, "expected a list of signals"),
        ({"level": "Hard", "reference": {"kind": "step", "amplitude": 1.0, "fastest": 0.0}}, "a number above 0"),
    ],
)
def test_mistakes_say_what_would_be_right(options, message):
    with pytest.raises(ConfigurationError, match=message):
        gym.make(HARD, **options)
    with pytest.raises(ConfigurationError, match="CableHole-Position has no levels"):
        gym.make("cable_envs/CableHole-Position-Sine-v1", level="Hard")


# draws


KEYS = np.arange(1.0, 400.0)


def numbers(columns):
    return [dict(zip(FIELDS.names, column, strict=True)) for column in columns.T.tolist()]


def test_draws_stay_in_their_ranges_and_below_the_fastest():
    spec = {"kind": "sine", "start": 3.0, "amplitude": [0.001, 0.015], "frequency": [0.05, 1.0], "fastest": 0.01}
    drawn = numbers(DrawnSignal.of("reference", spec).draw(KEYS, 0))
    speed = [2 * math.pi * one["frequency"] * one["amplitude"] for one in drawn]
    assert all(0.001 <= one["amplitude"] <= 0.015 and one["start"] == 3.0 for one in drawn)
    assert max(speed) <= 0.01 * (1 + 1e-12) and sum(s > 0.0099999 for s in speed) > 100  # many at the drive's limit
    assert min(one["frequency"] for one in drawn) < 0.06
    spec["fastest"] = 100.0
    logs = np.log([one["frequency"] for one in numbers(DrawnSignal.of("reference", spec).draw(KEYS, 0))])
    # even in the logarithm: the mean of 399 draws is within four standard deviations of the middle
    assert abs(logs.mean() - 0.5 * math.log(0.05)) < 4 * math.log(20) / math.sqrt(12 * 399)


def test_a_draw_is_of_its_key_and_its_number_alone():
    one = DrawnSignal.of("reference", load_task("CableHole-Track").levels["Easy"]["reference"])
    drawn = one.draw(KEYS, 0)
    assert np.array_equal(drawn[:, 76:77], one.draw(KEYS[76:77], 0))
    assert not np.array_equal(drawn[:, 76], drawn[:, 77])
    assert not np.array_equal(drawn[:, 76:77], one.draw(KEYS[76:77], 1))
    kinds = {KINDS[int(kind)] for kind in drawn[0, :39]}
    assert kinds == {"multisine", "trapezoids"}


def test_a_fixed_signal_is_as_it_is():
    spec = {"kind": "sine", "amplitude": 0.01, "frequency": 0.2}
    assert [one["amplitude"] for one in numbers(DrawnSignal.of("reference", spec).draw(KEYS[:2], 0))] == [0.01, 0.01]


def test_every_episode_has_another_reference_and_a_seed_has_one():
    env = gym.make(EASY)

    def reference(seed):
        env.reset(seed=seed)
        still = held(env)
        return [env.step(still)[4]["reference"] for _ in range(700)]

    first, other, again = reference(1), reference(2), reference(1)
    assert first == again and first != other
    later = gym.make(EASY)
    later.reset(seed=1)
    later.reset()
    assert [later.step(held(later))[4]["reference"] for _ in range(700)] != first


# what the first frame says


def test_the_first_frame_gives_neither_the_reference_nor_the_weight_away():
    env = gym.make(MEDIUM, split="test")
    away, weight = [], []
    for seed in range(40):
        observation, info = env.reset(seed=seed)
        seen = observation * np.array([c.scale for c in env.unwrapped.channels])
        away.append(seen[place(env, "load_position")] - info["reference"])
        rig = env.unwrapped.true_rig
        weight.append(seen[place(env, "drive_tension")] / (rig["load_mass"] * rig["gravity"]) - 1.0)
    assert np.std(away) > 0.004 and abs(np.mean(away)) < 0.004  # 10 mm either way
    assert np.std(weight) > 0.01  # a load cell with a zero and a gain of its own; 0.2 % in the tasks before


@pytest.mark.slow
def test_an_encoder_without_a_zero_shifts_what_is_seen_and_what_is_told():
    """Command and reading agree, so that their difference says nothing; the jaw is elsewhere."""
    env = gym.make("cable_envs/PulleyCircuit-Track-Medium-v1", sensor_noise=False)
    zeros, offsets = [], []
    for seed in range(30):
        observation, info = env.reset(seed=seed)
        seen = observation * np.array([c.scale for c in env.unwrapped.channels])
        zero = float(env.unwrapped.simulation.buffers.named.zero[0])
        # half a step of the quantiser
        assert seen[place(env, "drive_angle")] == pytest.approx(info["drive_angle"] + zero, abs=1.6e-4)
        assert info["command"] == pytest.approx(info["drive_angle"] + zero, abs=1e-9)
        zeros.append(zero)
        offsets.append(seen[place(env, "drive_angle")] - info["drive_angle"])
    assert np.ptp(zeros) > 0.3 and np.allclose(zeros, offsets, atol=1.6e-4)


# sensors


def test_sensors_show_steps_late_and_speeds_from_differences():
    env = gym.make(EASY, sensor_noise=False, reference=STILL)
    wave = np.random.default_rng(3).uniform(-0.05, 0.05, 2001)
    env.reset(seed=4)
    middle = float(held(env)[0])
    seen = run(env, lambda k, *_: middle + wave[k // 20], seed=4)
    shown = np.array([one[0] for one in seen], float) * np.array([c.scale for c in env.unwrapped.channels])
    true = [(seen[0][1] if k == 0 else one[4]) for k, one in enumerate(seen)]
    load = np.array([info["load_position"] for info in true])
    in_steps = 1e-5 * np.floor(load / 1e-5 + 0.5)
    late = shown[:, place(env, "load_position")]
    # float32 of 0.02: 1e-9
    assert late[1:] == pytest.approx(in_steps[:-1], abs=3e-9) and late[0] == pytest.approx(in_steps[0], abs=3e-9)
    zero = float(env.unwrapped.simulation.buffers.named.zero[0])
    drive = 2.5e-6 * np.floor((np.array([info["drive_position"] for info in true]) + zero) / 2.5e-6 + 0.5)
    speed, found = 0.0, [0.0]
    for difference in np.diff(drive) / 0.01:
        speed += 0.5 * (difference - speed)  # filter and period are both 10 ms
        found.append(speed)
    assert np.ptp(found) > 1e-3
    assert shown[:, place(env, "drive_velocity")] == pytest.approx(found, abs=1e-8)


@pytest.mark.slow
def test_the_camera_sees_five_times_a_second_and_late():
    env = gym.make("cable_envs/PulleyCircuit-Track-Easy-v1", sensor_noise=False, duration=3.0)
    env.reset(seed=4)
    middle = float(held(env)[0])
    seen = run(env, lambda k, *_: middle + 0.1 * math.sin(0.02 * k), seed=4)
    shown = np.array([one[0][place(env, "output_angle")] for one in seen]) * 2.0
    jaw = np.array([(seen[0][1] if k == 0 else one[4])["output_angle"] for k, one in enumerate(seen)])
    steps = np.arange(len(seen))
    read = np.maximum(steps - 10, 0) // 20 * 20
    assert np.ptp(jaw) > 0.05
    assert shown == pytest.approx(2e-3 * np.floor(jaw[read] / 2e-3 + 0.5), abs=1e-6)


def test_the_acceleration_of_the_reference_is_shown_with_preview_only():
    wave = {"kind": "sine", "amplitude": 0.01, "frequency": 0.2}
    for preview in (False, True):
        env = gym.make(EASY, reference=wave, preview=preview)
        env.reset(seed=0)
        observation, *_, info = env.step(held(env))
        expected = -((2 * math.pi * 0.2) ** 2) * info["reference"] if preview else 0.0
        k = place(env, "reference_acceleration")
        assert observation[k] * env.unwrapped.channels[k].scale == pytest.approx(expected, rel=1e-6)


def test_ideal_sensors_show_the_truth():
    env = gym.make(EASY, sensors="ideal", sensor_noise=False)
    env.reset(seed=0)
    observation, *_, info = env.step(held(env))
    for value, channel in zip(observation, env.unwrapped.channels, strict=True):
        if channel.measured:
            assert value * channel.scale == pytest.approx(info[channel.name], rel=1e-6, abs=1e-12)


# rules and prices


def test_what_is_broken_for_longer_than_allowed_ends_the_episode():
    """A drive that holds 101 N in place breaks the rule from the first step on; the sixth is more than 50 ms."""
    env = gym.make(EASY, rig={"load_mass": 10.3}, reference=STILL, action_mode="speed")
    assert [rule.name for rule in env.unwrapped.setup.conditions.rules] == ["overload", "dropped", "runaway"]
    env.reset(seed=0)
    still = held(env)
    steps = [env.step(still) for _ in range(6)]
    assert [one[4]["peak_tension"] > 100.0 for one in steps] == [True] * 6
    assert [one[4]["violations"] for one in steps] == [1.0] * 6
    assert [(one[2], one[4]["failure"]) for one in steps] == [(False, 0.0)] * 5 + [(True, 1.0)]
    assert steps[4][1] > 0.0 and steps[5][1] == 0.0 and not any(one[3] for one in steps)


def test_a_load_let_go_is_dropped():
    env = gym.make(EASY, reference=STILL)
    last = run(env, lambda *_: -1.0)[-1]
    assert last[2] and last[4]["failure"] in (2.0, 3.0) and last[4]["time"] < 1.0


def test_activity_is_the_rms_above_the_corner():
    """Against SciPy's Butterworth filter; a sine far above the corner has amplitude / sqrt 2 of the range."""
    b, a1, a2 = high_pass(0.01)
    expected = filters.butter(2, CUTOFF, "high", fs=100.0)
    assert np.allclose([b, -2 * b, b], expected[0]) and np.allclose([1.0, a1, a2], expected[1])
    env = gym.make(EASY, reference=STILL)
    env.reset(seed=0)
    middle = float(held(env)[0])
    actions = middle + 0.01 * np.sin(2 * math.pi * 23.0 * 0.01 * np.arange(2000))
    seen = run(env, lambda k, *_: actions[k], seed=0)
    passed = filters.lfilter(*expected, 0.5 * (np.array(actions[: len(seen) - 1]) - middle))
    power, found = 0.0, []
    for value in passed:
        power += 0.01 / (WINDOW + 0.01) * (value * value - power)
        found.append(math.sqrt(power))
    activity = np.array([one[4]["activity"] for one in seen[1:]])
    assert activity == pytest.approx(found, rel=1e-9, abs=1e-12)
    assert activity[-1] == pytest.approx(0.005 / math.sqrt(2.0), rel=0.05)
    info, task = seen[-1][4], env.unwrapped.setup.task
    assert info["priced_error"] == pytest.approx(abs(info["error"]) + task.error_scale * (info["activity"] / 0.01) ** 2)
    assert seen[-1][1] == pytest.approx(1.0 / (1.0 + info["priced_error"] / task.error_scale), rel=1e-12)


def test_a_jump_of_the_command_is_free_where_the_reference_jumps():
    env = gym.make(STEPS, sensor_noise=False)
    env.reset(seed=0)
    middle = float(held(env)[0])
    with_it = run(env, lambda k, *_: middle + (0.02 if k >= 1000 else 0.0), seed=0)
    against = run(env, lambda k, *_: middle + (0.02 if k >= 500 else 0.0), seed=0)
    assert max(one[4]["activity"] for one in with_it[1:]) < 1e-7  # what the filter has not forgotten
    assert max(one[4]["activity"] for one in against[1:]) > 5e-4
    assert PAUSE < 1.0


def pid(env):
    setup = env.unwrapped.setup
    controller = make_controller(
        "pid", setup.plant.name, setup.action_mode.name, setup.task.kind, setup.rig.values, setup.control_period
    )
    scales, names = np.array([c.scale for c in setup.channels]), [c.name for c in setup.channels]

    def act(k, observation, info):
        y = dict(zip(names, (observation * scales).tolist(), strict=True))
        u = controller.act(info["time"], y, (y["reference"], y["reference_rate"], 0.0))
        return 2.0 * (u - setup.low) / (setup.high - setup.low) - 1.0

    controller.reset()
    return act


HABITS = {
    "saturating": lambda k, u, info: 1.0 if info["error"] > 0.0 else -1.0,
    "dithering at 23 Hz": lambda k, u, info: u + 0.06 * math.sin(2 * math.pi * 23.0 * 0.01 * k),
    "cycling at Nyquist": lambda k, u, info: u + 0.06 * (-1.0) ** k,
    "cycling at 5 Hz": lambda k, u, info: u + 0.25 * math.sin(2 * math.pi * 5.0 * 0.01 * k),
}


@pytest.mark.parametrize("habit", HABITS)
@pytest.mark.parametrize("env_id", [EASY, "cable_envs/CableHole-Hold-Easy-v1"])
def test_habits_that_wear_a_rig_are_not_rewarded(env_id, habit):
    """The plain controller earns more, and has the smaller priced error, than with the habit on top."""
    env, totals = gym.make(env_id), []
    for changed in (None, HABITS[habit]):
        act = pid(env)
        seen = run(env, act if changed is None else lambda k, o, i: changed(k, act(k, o, i), i), seed=2)  # noqa: B023
        priced = math.sqrt(np.mean([one[4]["priced_error"] ** 2 for one in seen[1:]]))
        totals.append((sum(one[1] for one in seen[1:]), math.inf if seen[-1][2] else priced))
    (plain, error), (other, worse) = totals
    assert plain > 1.1 * other and worse > 1.1 * error


# batch, copies


@pytest.mark.parametrize("env_id", [HARD])
def test_a_batch_goes_on_from_a_state_to_the_bit(env_id):
    env, envs = gym.make(env_id), gym.make_vec(env_id, num_envs=3, vectorization_mode="vector_entry_point")
    env.reset(seed=5)
    for _ in range(400):
        env.step(held(env))
    envs.unwrapped.restore(env.unwrapped.state())
    for _ in range(50):
        action = held(env) + 0.01
        one, many = env.step(action), envs.step(np.repeat(action[None], 3, axis=0))
        assert all(np.array_equal(one[0], row) for row in many[0]) and set(many[1].tolist()) == {one[1]}
        assert all(set(many[4][name].tolist()) == {value} for name, value in one[4].items())


def test_the_ids_are_the_levels_of_the_files():
    """They are read from the text, as parsing all files would take half of the import's time."""
    parsed = [
        f"cable_envs/{task}-{level}-v1"
        for task in config_names("suite")
        for level in read_yaml(config_path("suite", f"{task}.yaml"))["levels"]
    ]
    assert list(cable_envs.SUITE_IDS) == parsed
