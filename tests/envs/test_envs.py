"""Single environments: both checkers, spaces and units, ends, delays, noise, randomisation, and errors that help."""

import math

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env as gymnasium_check

import cable_envs
from cable_envs.core.errors import ConfigurationError
from cable_envs.sim.tasks import OBSERVATION_LIMIT

HOLE, CIRCUIT = "cable_envs/CableHole-Position-Sine-v0", "cable_envs/PulleyCircuit-Position-Sine-v0"

OPTIONS = [
    (HOLE, {"observe": "drive"}),
    (HOLE, {"observe": "full", "action_mode": "speed", "sensor_noise": True, "sensor_delay": 3, "action_delay": 2}),
    (HOLE.replace("v0", "v1"), {"rig": "gu-three-holes", "randomize": {"load_mass": {"scale": [0.9, 1.1]}}}),
    (HOLE, {"reference": {"kind": "random_steps", "amplitude": 0.01, "hold": 0.3}, "randomize": True}),
    (CIRCUIT, {"observe": "output", "action_mode": "torque", "sensor_noise": 2.0, "sensor_delay": 1}),
    (CIRCUIT, {"observe": "full", "randomize": True, "disturbance": {"kind": "step", "amplitude": 0.01, "start": 0.1}}),
    (CIRCUIT, {"plant": "chain", "observe": "full", "sensor_noise": True}),
    (CIRCUIT, {"plant": "chain", "action_mode": "torque", "action_delay": 1}),
    (HOLE.replace("v0", "v1"), {"randomize": True, "sensor_noise": True}),
    ("cable_envs/PulleyCircuit-Torque-Step-v1", {"randomize": True, "sensor_noise": True}),
    ("cable_envs/TendonSheath-Tension-Sine-v1", {"randomize": True, "sensor_noise": True}),
]

QUICK = ("cable_envs/CableHole-Track-Hard-v1", "cable_envs/PulleyCircuit-Grasp-Easy-v1")
IDS = [
    *cable_envs.ENV_IDS,
    *(pytest.param(i, marks=() if i in QUICK else pytest.mark.slow) for i in cable_envs.SUITE_IDS),
]
"""The ids of boards and suite v1; most of the latter with the slow tests only, as each mechanism has its kernels."""


CASES = [
    *((i, {}) for i in cable_envs.ENV_IDS),
    *(pytest.param(i, {}, marks=() if i in QUICK else pytest.mark.slow) for i in cable_envs.SUITE_IDS),
    *OPTIONS,
]


def make(env_id, **options):
    """The environment with short episodes."""
    return gym.make(env_id, **{"duration": 0.5, **options})


def play(env, seed, actions):
    """Everything an episode shows: first observation and info, then every step's five values."""
    out = [env.reset(seed=seed)]
    for action in actions:
        out.append(env.step(np.array([action], np.float32)))
        if out[-1][2] or out[-1][3]:
            break
    return out


def random_actions(n, seed=0, low=-1.0, high=1.0):
    return np.random.default_rng(seed).uniform(low, high, n)


@pytest.mark.parametrize("env_id", IDS)
def test_both_checkers_pass(env_id):
    from stable_baselines3.common.env_checker import check_env as sb3_check

    gymnasium_check(make(env_id).unwrapped, skip_render_check=True)
    sb3_check(make(env_id), skip_render_check=True)


@pytest.mark.parametrize(("env_id", "options"), OPTIONS)
def test_checker_passes_with_options(env_id, options):
    gymnasium_check(make(env_id, **options).unwrapped, skip_render_check=True)


@pytest.mark.parametrize("env_id", IDS)
def test_info_is_fixed_floats_and_flags_are_bools(env_id):
    env = make(env_id)
    _, first = env.reset(seed=0)
    assert list(first)[:6] == ["time", "reference", "output", "error", "command", "overload"]
    assert {"slack_fraction", "peak_tension"} <= set(first)
    for action in random_actions(50):
        observation, reward, terminated, truncated, info = env.step(np.array([action], np.float32))
        assert tuple(info) == tuple(first)
        assert all(type(value) is float for value in info.values())
        assert type(reward) is float and type(terminated) is bool and type(truncated) is bool
        assert observation.dtype == np.float32 and observation in env.observation_space
        assert info["error"] == info["reference"] - info["output"]


@pytest.mark.parametrize(("env_id", "options"), CASES)
def test_same_seed_same_episode(env_id, options):
    actions = random_actions(30)
    a, b = (play(make(env_id, **options), 11, actions) for _ in range(2))
    for left, right in zip(a, b, strict=True):
        assert np.array_equal(left[0], right[0]) and left[1:] == right[1:]


def test_other_seed_other_noise_and_rig():
    env = make(HOLE, sensor_noise=True, randomize=True)
    first, rig = env.reset(seed=1)[0], env.unwrapped.true_rig
    second = env.reset(seed=2)[0]
    assert not np.array_equal(first, second) and rig != env.unwrapped.true_rig
    assert np.array_equal(first, env.reset(seed=1)[0]) and rig == env.unwrapped.true_rig


def test_only_the_environments_own_generator_is_used():
    env = make(HOLE, sensor_noise=True, randomize=True)
    np.random.seed(0)
    before = np.random.get_state()[1].copy()
    play(env, 5, random_actions(20))
    assert np.array_equal(before, np.random.get_state()[1])


@pytest.mark.parametrize("env_id", cable_envs.ENV_IDS)
def test_observation_times_scale_is_si(env_id):
    env = make(env_id, observe="full")
    env.reset(seed=0)
    for action in random_actions(20, low=-0.4, high=0.4):
        observation, *_, info = env.step(np.array([action], np.float32))
    for value, channel in zip(observation, env.unwrapped.channels, strict=True):
        si = float(value) * channel.scale
        if channel.name in info:
            # float32 keeps 24 bits: half an ulp is 6e-8 of the value
            assert si == pytest.approx(info[channel.name], rel=1e-7, abs=1e-30), channel
    names = [c.name for c in env.unwrapped.channels]
    assert {"reference", "reference_rate", "reference_acceleration"} <= set(names) and len(set(names)) == len(names)


def test_error_channel_uses_the_drive_where_the_output_is_not_observed():
    env = make(CIRCUIT)
    env.reset(seed=0)
    observation, *_, info = env.step(np.array([0.3], np.float32))
    k = [c.name for c in env.unwrapped.channels].index("error")
    rig = env.unwrapped.true_rig
    expected = info["reference"] - info["drive_angle"] * rig["drive_radius"] / rig["output_radius"]
    assert observation[k] * env.unwrapped.channels[k].scale == pytest.approx(expected, rel=1e-6)
    assert expected != pytest.approx(info["error"], rel=1e-3)  # the elastic, rubbing cable lies between them


def test_observations_stay_within_their_space():
    env = make(HOLE, reference={"kind": "ramp", "amplitude": 1e6, "hold": 0.01})
    env.reset(seed=0)
    observation = env.step(np.zeros(1, np.float32))[0]
    assert observation in env.observation_space and observation.max() == OBSERVATION_LIMIT


def test_command_is_linear_in_the_action():
    env = make(HOLE, action_mode="speed")
    limit = env.unwrapped.setup.rig.values["drive_speed_limit"]
    env.reset(seed=0)
    for action, expected in ((-1.0, -limit), (0.0, 0.0), (0.5, limit / 2), (1.0, limit), (7.0, limit)):
        assert env.step(np.array([action]))[4]["command"] == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("env_id", cable_envs.ENV_IDS)
def test_starts_at_rest_on_the_reference(env_id):
    env = make(env_id, reference={"kind": "constant", "offset": 0.06 if "Circuit" in env_id else 0.004})
    options = {"reference": {"kind": "constant", "offset": 30.0}} if "Tension" in env_id else None
    _, info = env.reset(seed=0, options=options)
    # the circuit's torque is that of a load balanced by elongation: rounding of a difference of tensions
    assert info["output"] == pytest.approx(info["reference"], rel=1e-9) and info["time"] == 0.0


def test_reset_options():
    env = make(HOLE)
    _, info = env.reset(seed=0, options={"initial_position": 0.01, "rig": {"load_mass": 6.0}})
    assert info["output"] == 0.01 and env.unwrapped.true_rig["load_mass"] == 6.0
    assert info["drive_tension"] == pytest.approx(6.0 * 9.81, rel=1e-12)
    env.reset(options={"reference": {"kind": "constant", "offset": 0.02}})
    assert env.step(np.zeros(1))[4]["reference"] == 0.02
    env.reset()  # the next episode has the environment's own options again
    assert env.unwrapped.true_rig["load_mass"] == 5.0


def test_time_limit_only_truncates():
    env = make(HOLE, duration=0.2)
    env.reset(seed=0)
    action = env.unwrapped.simulation.buffers.named.action.copy()  # what keeps the load still
    ends = [env.step(action)[2:4] for _ in range(20)]
    assert ends == [(False, False)] * 19 + [(False, True)]


def test_torn_cable_terminates_and_does_not_truncate():
    env = make(HOLE, rig={"tension_limit": 60.0, "breaking_tension": 70.0}, duration=1.0)
    env.reset(seed=0)
    for _ in range(100):
        _, _, terminated, truncated, info = env.step(np.ones(1))
        assert info["overload"] == float(info["peak_tension"] > 60.0)
        assert terminated == (info["peak_tension"] > 70.0) and not truncated
        if terminated:
            break
    assert terminated and info["time"] < 0.5


def test_a_state_that_is_not_finite_terminates():
    env = make(HOLE)
    env.reset(seed=0)
    env.unwrapped.simulation.buffers.x[3] = math.nan
    assert env.step(np.zeros(1))[2] is True


def test_reward_is_largest_without_error_and_pays_for_effort():
    env = make(HOLE)
    env.reset(seed=0)
    task = env.unwrapped.setup.task
    previous = None
    for action in (0.1, 0.1, -0.4):
        _, reward, _, _, info = env.step(np.array([action]))
        tracking = 1.0 / (1.0 + abs(info["error"]) / task.error_scale)
        if previous is not None:
            assert reward == pytest.approx(tracking - task.effort_weight * (action - previous) ** 2, rel=1e-12)
        previous = action


def test_sensor_delay_shifts_measurements_and_not_the_reference():
    actions = random_actions(40, low=-0.3, high=0.2)
    plain, late = (play(make(HOLE, sensor_delay=d), 4, actions) for d in (0, 3))
    channels = make(HOLE).unwrapped.channels
    for k, channel in enumerate(channels):
        now, then = ([step[0][k] for step in episode] for episode in (plain, late))
        if channel.measured:
            assert then == [now[max(i - 3, 0)] for i in range(len(now))], channel
        elif channel.name != "error":
            assert then == now, channel
    error, position = ([c.name for c in channels].index(n) for n in ("error", "load_position"))
    for step in late:  # what a controller that subtracts the late measurement from the present reference gets
        expected = step[0][0] * channels[0].scale - step[0][position] * channels[position].scale
        # a difference of two float32 values of 0.01
        assert step[0][error] * channels[error].scale == pytest.approx(expected, abs=2e-9)
    assert [s[1:] for s in plain[1:]] == [s[1:] for s in late[1:]]


def test_action_delay_shifts_commands():
    actions = random_actions(40, low=-0.3, high=0.2)
    plain, late = (play(make(HOLE, action_delay=d), 4, actions) for d in (0, 4))
    first = plain[0][1]["command"]
    commands = [s[4]["command"] for s in plain[1:]]
    assert [s[4]["command"] for s in late[1:]] == [first] * 4 + commands[:-4]


def test_noise_has_the_declared_deviation_and_leaves_the_truth_alone():
    actions = np.zeros(200)
    plain, noisy = (play(make(HOLE, sensor_noise=s, duration=2.0), 4, actions) for s in (False, True))
    env = make(HOLE)
    assert [s[1:] for s in plain[1:]] == [s[1:] for s in noisy[1:]]  # reward, flags, info: the true ones
    for k, channel in enumerate(env.unwrapped.channels):
        difference = np.array([a[0][k] - b[0][k] for a, b in zip(noisy, plain, strict=True)], float) * channel.scale
        std = env.unwrapped.setup.task.sensor_noise.get(channel.name, 0.0) if channel.name != "error" else 1e-5
        assert difference.std() == pytest.approx(std, rel=0.2)  # 201 samples: 5 % is one sigma


def test_randomisation_stays_in_its_range_and_reaches_the_plant():
    env = make(HOLE, randomize={"load_mass": {"low": 4.0, "high": 6.0}, "friction_coefficient": {"scale": [0.5, 1.0]}})
    masses = []
    for seed in range(30):
        _, info = env.reset(seed=seed)
        rig = env.unwrapped.true_rig
        assert 4.0 <= rig["load_mass"] <= 6.0 and 0.215 <= rig["friction_coefficient"] <= 0.43
        assert info["drive_tension"] == pytest.approx(rig["load_mass"] * 9.81, rel=1e-12)
        masses.append(rig["load_mass"])
    assert min(masses) < 4.3 and max(masses) > 5.7


@pytest.mark.parametrize(("env_id", "amplitude"), [(HOLE, 20.0), (CIRCUIT, 0.5)])
def test_disturbance_moves_the_output(env_id, amplitude):
    push = {"kind": "step", "amplitude": amplitude, "start": 0.2}
    still, pushed = (
        play(make(env_id, reference={"kind": "constant"}, action_mode=mode, disturbance=d), 0, np.zeros(50))
        for d in (None, push)
        for mode in ["speed" if env_id == HOLE else "position"]
    )
    moved = np.array([b[-1]["output"] - a[-1]["output"] for a, b in zip(still, pushed, strict=True)])
    assert np.all(moved[:20] == 0.0)  # it acts from 0.2 s on
    assert moved[-1] > 0.0  # and helps positive motion


def test_step_before_reset_is_refused():
    with pytest.raises(gym.error.ResetNeeded):
        make(HOLE).step(np.zeros(1))


@pytest.mark.parametrize("action", [np.array([np.nan]), np.array([np.inf], np.float32)])
def test_actions_that_are_no_number_are_refused(action):
    env = make(HOLE)
    env.reset(seed=0)
    with pytest.raises(ValueError, match="finite number"):
        env.step(action)


@pytest.mark.parametrize("action", [0.5, np.zeros(2), np.zeros((1, 1)), []])
def test_actions_of_wrong_shape_are_refused(action):
    env = make(HOLE)
    env.reset(seed=0)
    with pytest.raises(ValueError, match=r"shape \(1,\)"):
        env.step(action)


BAD = [
    ({"rig": "gu-infered"}, "did you mean 'gu-inferred'"),
    ({"rig": "zou-table2"}, "needs a rig of plant cable_hole"),
    ({"rig": {"load_mas": 5.0}}, "did you mean 'load_mass'"),
    ({"rig": {"load_mass": -5.0}}, r"load_mass = -5 kg is outside its physical range \[0.001, 10000\]"),
    ({"rig": {"cable_stiffness": -1.0}}, "cable_stiffness = -1 N/m is outside"),
    ({"rig": {"load_mass": {"value": 5.0, "unit": "m"}}}, "load_mass: unit 'm' does not fit; expected kg or g"),
    ({"rig": {"load_mass": math.nan}}, "load_mass = nan kg is outside"),
    ({"rig": {"load_mass": "heavy"}}, "load_mass: expected a number in kg"),
    ({"rig": {"load_gravity": 0.0}}, "the load is free"),
    ({"rig": {"breaking_tension": 10.0}}, "breaking_tension must not be below tension_limit"),
    ({"observe": "outputs"}, "did you mean 'output'"),
    ({"action_mode": "force"}, "unknown action mode 'force'; Valid: speed, tension"),
    ({"plant": "chains"}, "did you mean 'chain'"),
    ({"reference": {"kind": "sin", "amplitude": 1.0}}, "did you mean 'sine'"),
    ({"reference": {"kind": "sine", "amplitude": 1.0}}, "needs frequency"),
    ({"reference": {"kind": "step", "amplitud": 1.0}}, "did you mean 'amplitude'"),
    ({"reference": {"kind": "step", "amplitude": math.inf}}, "reference.amplitude: expected a finite number"),
    ({"reference": {"kind": "ramp", "amplitude": 1.0, "hold": 0.0}}, "reference.hold must be above 0"),
    ({"reference": 3}, "reference"),
    ({"disturbance": {"kind": "pulse", "amplitude": 1.0}}, "disturbance of kind 'pulse' needs hold"),
    ({"posture": {"kind": "constant", "offset": 0.5}}, "option 'posture': cable_hole with this rig has no posture"),
    ({"randomize": {"load_mas": {"scale": [0.5, 2.0]}}}, "did you mean 'load_mass'"),
    ({"randomize": {"load_mass": {"scale": [2.0, 0.5]}}}, "low 10 is above high 2.5"),
    ({"randomize": {"load_mass": {"scale": [-1.0, 0.5]}}}, "outside its physical range"),
    ({"randomize": {"load_mass": 0.5}}, "randomize.load_mass: expected"),
    ({"randomize": {"load_mass": {"scale": 0.5}}}, "randomize.load_mass"),
    ({"randomize": "yes"}, "randomize: expected"),
    ({"sensor_noise": {"load_positon": 1.0}}, "did you mean 'load_position'"),
    ({"sensor_noise": {"load_position": -1.0}}, "sensor_noise.load_position"),
    ({"sensor_noise": -1.0}, "sensor_noise"),
    ({"sensor_noise": "loud"}, "sensor_noise"),
    ({"sensor_delay": 0.5}, r"sensor_delay: expected a whole number of steps in \[0, 100\]"),
    ({"action_delay": -1}, "action_delay"),
    ({"substeps": 0}, "substeps"),
    ({"control_period": 0.0}, "control_period: expected seconds above 0"),
    ({"duration": 0.505}, "no multiple of the control period"),
]


@pytest.mark.parametrize(("options", "message"), BAD)
def test_bad_options_say_what_would_be_right(options, message):
    with pytest.raises(ConfigurationError, match=message):
        make(HOLE, **options)


def test_tension_task_needs_a_spring():
    with pytest.raises(ConfigurationError, match="load_stiffness above 0"):
        make("cable_envs/CableHole-Tension-Step-v0", rig="gu-inferred")


def test_unknown_keywords_and_ids_are_refused():
    with pytest.raises(ConfigurationError, match="argument 'sensor_nois'; did you mean 'sensor_noise'"):
        make(HOLE, sensor_nois=True)
    with pytest.raises(gym.error.NameNotFound, match="CableHole-Position-Step"):
        gym.make("cable_envs/CableHole-Positio-Step-v0")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"initial_positon": 0.1}, "did you mean 'initial_position'"),
        ({"initial_position": math.nan}, "initial_position"),
        ({"initial_position": "top"}, "initial_position"),
        ({"rig": {"load_mas": 1.0}}, "did you mean 'load_mass'"),
        ({"rig": "gu-steel-1mm"}, "expected a mapping"),
        ({"reference": {"kind": "stp"}}, "did you mean 'step'"),
    ],
)
def test_bad_reset_options_say_what_would_be_right(options, message):
    env = make(HOLE)
    with pytest.raises(ConfigurationError, match=message):
        env.reset(seed=0, options=options)
