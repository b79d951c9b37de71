"""Action modes with two actions: spaces, batch, delays, copies, replays, errors, agents; one action goes on."""

import copy
import itertools

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import cable_envs
from cable_envs.baselines import make_controller
from cable_envs.core.errors import ConfigurationError
from cable_envs.plants import families, plant_for
from cable_envs.plants.base import OUT_OF_RANGE
from cable_envs.sim.replay import replay
from cable_envs.sim.rigs import load_rig
from cablebench.protocol.actors import PolicyActor

ENV, MODE = "cable_envs/AntagonistJoint-Position-Sine-v1", "position_and_co_contraction"
TWO = [
    (plant_for(one.name), mode) for one in families().values() for mode in plant_for(one.name).action_modes if mode.of
]


def actions(steps, seed=0):
    return np.random.default_rng(seed).uniform(-0.6, 0.6, (steps, 2)).astype(np.float32)


def rolled(env, given, seed=1):
    first = env.reset(seed=seed)
    return [first, *(env.step(action) for action in given)]


def made(**options):
    return gym.make(ENV, **{"action_mode": MODE, "duration": 2.0, **options})


@pytest.mark.parametrize(("plant", "mode"), TWO, ids=lambda v: v.name)
def test_a_mode_with_two_actions_has_the_command_of_one_and_a_second(plant, mode):
    one = next(m for m in plant.action_modes if m.name == mode.of)
    assert mode.name == f"{one.name}_and_{mode.second.name}"
    assert plant.number_of(mode) == plant.number_of(one)
    assert (mode.commands, one.commands) == ((mode, mode.second), (one,)) and one.second == mode.second
    signals = {s.name: s.unit for s in plant.signals}
    assert signals[f"{mode.second.name}_command"] == mode.second.unit == plant.parameters[mode.second.bound].unit
    assert not mode.second.rest_signal or signals[mode.second.rest_signal] == mode.second.unit


def test_spaces_channels_and_info():
    env = made()
    assert env.action_space == gym.spaces.Box(-1.0, 1.0, (2,), np.float32)
    assert [c.name for c in env.unwrapped.channels[4:6]] == ["command", "co_contraction_command"]
    observation, info = env.reset(seed=0)
    assert info["co_contraction_command"] == observation[5] * env.unwrapped.channels[5].scale == 15.0
    observation, _, _, _, info = env.step(np.array([0.4, 0.5], np.float32))
    assert (info["command"], info["co_contraction_command"]) == (pytest.approx(0.6), 30.0)
    assert observation[5] == pytest.approx(30.0 / env.unwrapped.channels[5].scale)
    check_env(made().unwrapped, skip_render_check=True)


def test_stable_baselines_accepts_it():
    from stable_baselines3.common.env_checker import check_env as check

    check(made())


def test_what_holds_it_at_rest_keeps_it_there_and_costs_nothing():
    for mode in (MODE, "torque_and_co_contraction"):
        env = made(action_mode=mode, reference={"kind": "constant", "offset": 0.3})
        _, first = env.reset(seed=0)
        ends = env.unwrapped.setup.ranges
        told = [first["command"], first["co_contraction_command"]]
        action = np.array([2 * (v - low) / (high - low) - 1 for v, (low, high) in zip(told, ends, strict=True)])
        for _ in range(50):
            _, reward, _, _, info = env.step(action)
        assert info["joint_angle"] == pytest.approx(0.3, abs=1e-9) and reward == pytest.approx(1.0, abs=1e-6)


def test_the_effort_is_that_of_both_actions():
    env = made()
    env.reset(seed=0)
    env.step(np.array([0.1, -0.2]))
    _, reward, _, _, info = env.step(np.array([0.4, 0.3]))
    weight, scale = env.unwrapped.setup.task.effort_weight, env.unwrapped.setup.task.error_scale
    assert reward == pytest.approx(1.0 / (1.0 + abs(info["error"]) / scale) - weight * (0.3**2 + 0.5**2), abs=1e-12)


def test_one_action_is_two_with_the_second_at_rest():
    given = actions(60)
    given[:, 1] = 2 * 15.0 / 40.0 - 1.0
    single = rolled(gym.make(ENV, action_mode="position", duration=2.0), given[:, :1])
    for (_, _, _, _, one), (_, _, _, _, two) in zip(single[1:], rolled(made(), given)[1:], strict=True):
        assert one == two


@pytest.mark.parametrize("options", [
    {}, {"action_delay": 3}, {"sensor_delay": 2, "sensor_noise": True}, {"randomize": True},
    {"effects": {"actuator_lag": {"time": 0.05}, "backlash": {"gap": 0.05}}},
], ids=str)  # fmt: skip
def test_a_batch_is_its_single_environments(options):
    given = [actions(40, seed) for seed in range(3)]
    batch = gym.make_vec(ENV, num_envs=3, action_mode=MODE, duration=2.0, **options)
    assert batch.action_space.shape == (3, 2)
    seen, _ = batch.reset(seed=5)
    many = [(seen, None), *(batch.step(np.stack(now)) for now in zip(*given, strict=True))]
    for k in range(3):
        for single, together in zip(rolled(made(**options), given[k], 5 + k), many, strict=True):
            assert np.array_equal(single[0], together[0][k])
            assert len(single) == 2 or single[1] == together[1][k]


def test_a_delay_holds_both_actions_back():
    given = actions(20)
    prompt, late = rolled(made(), given), rolled(made(action_delay=4), given)
    for before, after in zip(prompt[1:], late[5:], strict=False):
        for name in ("command", "co_contraction_command"):
            assert before[4][name] == after[4][name]
    assert late[1][4]["co_contraction_command"] == 15.0


def test_a_copy_and_a_saved_state_go_on_to_the_bit():
    given, env = actions(30), made(action_delay=2)
    rolled(env, given[:10])
    other, kept = copy.deepcopy(env), env.unwrapped.state()
    first = [env.step(action)[0] for action in given[10:]]
    assert all(np.array_equal(a, other.step(action)[0]) for a, action in zip(first, given[10:], strict=True))
    env.unwrapped.restore(kept)
    assert all(np.array_equal(a, env.step(action)[0]) for a, action in zip(first, given[10:], strict=True))


WRIST = "cable_envs/Wrist-Position-Sine-v1"
DRIVEN = [
    (ENV, MODE, "finger-joint", "joint_angle"),
    (ENV, MODE, "finger-joint-motor", "joint_angle"),
    (ENV, "torque_and_co_contraction", "finger-joint-motor", "joint_angle"),
    (WRIST, "position_and_pitch", "wrist-8mm", "yaw_angle"),
    (WRIST, "position_and_pitch", "wrist-8mm-motor", "yaw_angle"),
]
"""Environment, mode with two actions, rig, and the signal that says where an episode begins."""
slow_beyond_one = [pytest.param(*case, marks=[pytest.mark.slow] if k > 1 else []) for k, case in enumerate(DRIVEN)]


@pytest.mark.parametrize(("env_id", "mode", "rig", "output"), slow_beyond_one)
def test_a_replay_of_both_commands_is_the_episode(env_id, mode, rig, output):
    """Ideal drives and motors: the episode, encoders and currents included, comes out again."""
    env = gym.make(env_id, action_mode=mode, rig=rig, duration=2.0)
    (_, first), *steps = rolled(env, actions(50))
    infos = [step[4] for step in steps]
    setup, rows = (
        env.unwrapped.setup,
        [s.name for s in env.unwrapped.setup.plant.signals if s.name != OUT_OF_RANGE.name],
    )
    both = "command", f"{mode.split('_and_')[1]}_command"
    one, two = (np.array([info[name] for info in (first, *infos)]) for name in both)
    again = replay(
        setup.plant, setup.rig.column(setup.plant), one[1:], 0.01, drive=mode, hold="step", signals=rows,
        start=first[output], substeps=setup.substeps, rate=np.diff(one) / 0.01, second=two[1:],
        second_rate=np.diff(two) / 0.01,
    )[:, :, 0]  # fmt: skip
    assert again == pytest.approx(np.array([[info[name] for name in rows] for info in infos]), rel=1e-12, abs=1e-12)
    assert rig.endswith("motor") == any("current" in name for name in rows)


@pytest.mark.slow  # five kernels to compile where none is kept
@pytest.mark.parametrize(("env_id", "mode", "rig", "output"), DRIVEN)
def test_pictures_show_both_actions_with_motors_too(env_id, mode, rig, output):
    pytest.importorskip("matplotlib")
    env = gym.make(env_id, action_mode=mode, rig=rig, duration=2.0, render_mode="rgb_array")
    env.reset(seed=1)
    frames = [env.render()]
    for action in ([0.3, 0.0], [0.3, 0.0], [0.3, 0.8], [0.3, 0.8]):
        for _ in range(10):
            env.step(np.array(action, np.float32))
        frames.append(env.render())
    assert all(f.shape == frames[0].shape and f.dtype == np.uint8 and f.shape[2] == 3 for f in frames)
    changed = [np.count_nonzero((a != b).any(axis=2)) for a, b in itertools.pairwise(frames)]
    assert min(changed) > 200  # pixels, of the mechanism and its traces


@pytest.mark.parametrize(("action", "message"), [
    (np.zeros(1), r"action must have shape \(2,\) \(position, co_contraction\), got \(1,\)"),
    (np.zeros(3), r"action must have shape \(2,\) \(position, co_contraction\), got \(3,\)"),
    (0.0, r"action must have shape \(2,\) \(position, co_contraction\), got \(\)"),
    (np.array([0.0, np.nan]), "action must be two finite numbers"),
])  # fmt: skip
def test_wrong_actions_are_named(action, message):
    env = made()
    env.reset(seed=0)
    with pytest.raises(ValueError, match=message):
        env.step(action)


def test_wrong_actions_of_a_batch_are_named():
    batch = gym.make_vec(ENV, num_envs=2, action_mode=MODE)
    batch.reset(seed=0)
    with pytest.raises(
        ValueError, match=r"actions must have shape \(2, 2\) \(position, co_contraction\), got \(2, 1\)"
    ):
        batch.step(np.zeros((2, 1)))
    with pytest.raises(ValueError, match=r"environments \[1\] are not"):
        batch.step(np.array([[0.0, 0.0], [0.0, np.inf]]))


def test_two_actions_for_an_environment_with_one_are_named():
    env = gym.make(ENV)
    env.reset(seed=0)
    with pytest.raises(ValueError, match=r"action must have shape \(1,\), got \(2,\)"):
        env.step(np.zeros(2))


def test_a_reference_controller_is_refused_and_told_the_mode_that_it_has():
    rig = load_rig("finger-joint").values
    with pytest.raises(ConfigurationError, match=r"'pid' gives one command.*action_mode='position'"):
        make_controller("pid", "antagonistic_joint", MODE, "position", rig, 0.01)
    make_controller("pid", "antagonistic_joint", "position", "position", rig, 0.01)


def test_a_policy_of_one_number_is_refused_by_name():
    class One:
        def predict(self, observation, state=None, episode_start=None, deterministic=True):
            return np.zeros(1), None

    env, actor = made(), PolicyActor(One())
    observation, _ = env.reset(seed=0)
    actor.start(env.unwrapped)
    with pytest.raises(ValueError, match=r"shape \(2,\) \(position, co_contraction\), got \(1,\)"):
        env.step(actor.act(observation, 0.0))


def test_a_replay_refuses_a_second_command_where_there_is_none():
    hole = plant_for("cable_hole")
    values = load_rig("gu-inferred").column(hole)
    with pytest.raises(ConfigurationError, match="no second command"):
        replay(hole, values, np.zeros(3), 0.01, drive="tension", signals=["load_position"], second=np.zeros(3))


def test_an_agent_trains_acts_and_is_kept(tmp_path):
    """Two actions through cablebench's own training: shaping, network, file, and an evaluation of what was kept."""
    pytest.importorskip("stable_baselines3")
    from cable_envs.agents.policy import load_policy
    from cable_envs.agents.settings import load_settings
    from cable_envs.agents.train import train

    settings = load_settings("ppo", ENV, changes={"n_envs": 2, "n_timesteps": 256, "n_steps": 64, "batch_size": 32,
                                                  "smoothing": 0.3},
                             env_options={"action_mode": MODE, "duration": 1.0})  # fmt: skip
    train(settings, seed=0, out=tmp_path / "agent")
    policy = load_policy(tmp_path / "agent")
    env, actor = made(duration=1.0), PolicyActor(policy)
    observation, _ = env.reset(seed=0)
    actor.start(env.unwrapped)
    action = actor.act(observation, 0.0)
    assert action.shape == (2,) and policy.metadata.options["action_mode"] == MODE
    env.step(action)


def test_a_command_line_that_asks_a_controller_for_two_commands_is_told_the_mode():
    from cablebench.cli.shared.arguments import options_for
    from cablebench.entrants.named import named_entrant

    with pytest.raises(ConfigurationError, match=r"'pid' gives one command.*-o action_mode=position, where"):
        options_for(named_entrant("pid"), ENV, {"action_mode": MODE})
    assert options_for(named_entrant("pid"), ENV, {})["observe"] == "output"


@pytest.mark.parametrize("env_id", [i for i in cable_envs.FIRST_IDS if i.endswith("-Sine-v1")])
def test_environments_that_are_new_pass_the_checker_with_every_action_mode(env_id):
    for mode in gym.make(env_id).unwrapped.setup.plant.action_modes:
        check_env(gym.make(env_id, action_mode=mode.name, duration=0.5).unwrapped, skip_render_check=True)
