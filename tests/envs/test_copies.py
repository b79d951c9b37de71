"""Copies of environments go on as the original does; a state of one goes into many; what Gymnasium is told is whole."""

import copy
import json
import pickle

import cloudpickle
import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec

from cable_envs import ENV_IDS, load_rig
from cable_envs.core.errors import ConfigurationError
from cable_envs.sim.registered import setup_of
from cablebench.entrants.named import reference_entrants
from cablebench.run.evaluation import run_episode

HOLE, CIRCUIT = "cable_envs/CableHole-Position-Sine-v0", "cable_envs/PulleyCircuit-Torque-Step-v0"
HARD = {"sensor_noise": True, "randomize": True, "sensor_delay": 2, "action_delay": 1, "duration": 0.3}
COPIES = {
    "deepcopy": copy.deepcopy,
    "pickle": lambda env: pickle.loads(pickle.dumps(env)),
    "cloudpickle": lambda env: cloudpickle.loads(cloudpickle.dumps(env)),
}


def batch(env_id, n, **options):
    return gym.make_vec(env_id, num_envs=n, vectorization_mode="vector_entry_point", **options).unwrapped


def rollout(env, steps=40):
    """Everything that a single environment says, through the end of an episode and into the next one."""
    said = []
    for action in np.linspace(-0.2, 0.4, steps, dtype=np.float32):
        observation, reward, terminated, truncated, info = env.step(np.array([action]))
        said.append((observation.tobytes(), reward, terminated, truncated, tuple(info.items())))
        if terminated or truncated:
            observation, info = env.reset()
            said.append((observation.tobytes(), tuple(info.items())))
    return said


@pytest.mark.parametrize("env_id", ENV_IDS)
@pytest.mark.parametrize("how", COPIES)
def test_a_copy_goes_on_as_the_original(env_id, how):
    env = gym.make(env_id, **HARD)
    env.reset(seed=3)
    for _ in range(17):
        env.step(np.array([0.1], np.float32))
    twin = COPIES[how](env)
    assert rollout(env) == rollout(twin)
    assert len(pickle.dumps(env)) < 100_000


@pytest.mark.parametrize("how", COPIES)
@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_a_copy_of_a_batch_goes_on_as_the_original(how, mode):
    envs = batch(CIRCUIT, 5, autoreset_mode=mode, **HARD)
    envs.reset(seed=1)
    actions = np.random.default_rng(0).uniform(-0.2, 0.3, (50, 5, 1)).astype(np.float32)
    for action in actions[:10]:
        envs.step(action)
    twin = COPIES[how](envs)
    for action in actions[10:]:
        for a, b in zip(envs.step(action)[:4], twin.step(action)[:4], strict=True):
            np.testing.assert_array_equal(a, b)
        for name, values in envs.infos().items():
            np.testing.assert_array_equal(values, twin.infos()[name])
    assert len(pickle.dumps(envs)) < 100_000


def test_copies_before_the_first_reset_and_at_the_end_of_an_episode():
    env = copy.deepcopy(gym.make(HOLE, duration=0.05))
    with pytest.raises(gym.error.ResetNeeded):
        env.step(np.zeros(1, np.float32))
    env.reset(seed=0)
    for _ in range(5):
        *_, truncated, _ = env.step(np.zeros(1, np.float32))
    assert truncated
    with pytest.warns(UserWarning, match=r"step\(\) after the end of an episode"):
        copy.deepcopy(env).step(np.zeros(1, np.float32))


def test_a_copy_draws_where_the_original_was():
    pytest.importorskip("matplotlib")
    env = gym.make(HOLE, render_mode="rgb_array")
    env.reset(seed=0)
    env.step(np.array([0.5], np.float32))
    assert copy.deepcopy(env).render().shape == env.render().shape


def test_stepping_after_the_end_warns_and_reset_ends_the_warning(recwarn):
    env = gym.make(HOLE, duration=0.03)
    env.reset(seed=0)
    for _ in range(3):
        env.step(np.zeros(1, np.float32))
    assert not [w for w in recwarn if "after the end" in str(w.message)]
    with pytest.warns(UserWarning, match="after the end of an episode"):
        env.step(np.zeros(1, np.float32))
    env.reset()
    recwarn.clear()
    env.step(np.zeros(1, np.float32))
    assert not [w for w in recwarn if "after the end" in str(w.message)]


def test_a_state_goes_back_to_the_bit():
    env = gym.make(HOLE, **HARD).unwrapped
    env.reset(seed=5)
    env.step(np.array([0.2], np.float32))
    kept = env.state()
    first = rollout(env)
    env.restore(kept)
    assert rollout(env) == first


def test_one_state_goes_into_many_lanes_and_each_goes_its_own_way():
    env = gym.make(HOLE, **{**HARD, "duration": 1.0}).unwrapped
    env.reset(seed=5)
    for _ in range(9):
        env.step(np.array([0.2], np.float32))
    envs = batch(HOLE, 64, **{**HARD, "duration": 1.0})
    envs.restore(env.state())
    plans = np.random.default_rng(2).uniform(-0.5, 0.5, (20, 64, 1)).astype(np.float32)
    for plan in plans:
        observations, rewards, *_ = envs.step(plan)
    twin = copy.deepcopy(env)
    for plan in plans[:, 7]:
        observation, reward, *_ = twin.step(plan)
    np.testing.assert_array_equal(observations[7], observation)
    assert rewards[7] == reward
    env.restore(envs.state([7]))  # and back: the plan that was best
    np.testing.assert_array_equal(env.step(plans[0, 0])[0], twin.step(plans[0, 0])[0])


def test_some_lanes_go_back_and_the_others_go_on():
    envs, plain = batch(HOLE, 4, sensor_noise=True), batch(HOLE, 4, sensor_noise=True)
    for one in (envs, plain):
        one.reset(seed=9)
    kept = envs.state([1, 3])
    actions = np.random.default_rng(3).uniform(-0.3, 0.3, (12, 4, 1)).astype(np.float32)
    for action in actions[:6]:
        envs.step(action)
        plain.step(action)
    envs.restore(kept, lanes=[1, 3])
    assert envs.infos()["time"].tolist() == pytest.approx([0.06, 0.0, 0.06, 0.0])
    a, b = envs.step(actions[6])[0], plain.step(actions[6])[0]
    np.testing.assert_array_equal(a[[0, 2]], b[[0, 2]])


def test_a_state_that_does_not_fit_is_refused_and_nothing_changes():
    env, other = gym.make(HOLE).unwrapped, gym.make(HOLE, control_period=0.02).unwrapped
    env.reset(seed=0)
    other.reset(seed=0)
    with pytest.raises(ConfigurationError, match="other settings"):
        env.restore(other.state())
    envs = batch(HOLE, 3)
    envs.reset(seed=0)
    before = envs.infos()
    with pytest.raises(ConfigurationError, match="of 3 environments, and 2 are to be restored"):
        envs.restore(envs.state(), lanes=[0, 1])
    with pytest.raises(ValueError, match="lanes: expected numbers of environments below 3"):
        envs.restore(env.state(), lanes=[3])
    assert all(np.array_equal(values, envs.infos()[name]) for name, values in before.items())


@pytest.mark.parametrize("env_id", ENV_IDS)
def test_specs_say_how_long_an_episode_is(env_id):
    env = gym.make(env_id)
    assert env.spec.max_episode_steps == setup_of(env_id, {}).steps
    env = gym.make(env_id, duration=1.0, control_period=0.02)
    assert env.spec.max_episode_steps == 50 and env.metadata["render_fps"] == 50
    assert type(env.unwrapped) is type(env)  # no wrapper that counts steps is needed
    timed = gym.wrappers.TimeAwareObservation(env)
    timed.reset(seed=0)
    assert gym.make(env.spec).spec.max_episode_steps == 50


@pytest.mark.parametrize("env_id", ENV_IDS)
def test_a_task_counts_as_solved_where_the_best_reference_controller_is(env_id):
    """And the open loop, which every task beats, is below."""
    threshold = gym.spec(env_id).reward_threshold
    setup, found = setup_of(env_id, {}), {}
    for entrant in reference_entrants():
        options = entrant.needs(env_id, setup)
        if options is not None and entrant.name in ("open-loop", "pid", "mrac-g22", "mrac-g9", "feedforward-pid"):
            env = gym.make(env_id, **options)
            found[entrant.name] = float(np.sum(run_episode(env, entrant.make(env.unwrapped.setup), seed=0).reward))
    assert found["open-loop"] < threshold <= max(found.values()) < threshold + 10.0


def test_a_batch_takes_the_length_that_gymnasium_hands_over():
    envs = batch(HOLE, 2, max_episode_steps=5, autoreset_mode="Disabled")
    envs.reset(seed=0)
    ends = [envs.step(np.zeros((2, 1), np.float32))[3].all() for _ in range(5)]
    assert ends == [False] * 4 + [True] and envs.spec.max_episode_steps == 5
    assert batch(HOLE, 2, max_episode_steps=10**6).setup.steps == setup_of(HOLE, {}).steps


def test_a_spec_with_a_rig_is_read_again():
    rig = load_rig("gu-steel-1mm").replace({"backlash.gap": 1e-4})
    env = gym.make(HOLE, rig=rig, sensor_noise=True)
    text = env.spec.to_json()
    again = gym.make(EnvSpec.from_json(text)).unwrapped.setup
    assert again.rig.values == rig.values and again.rig.effects == rig.effects
    assert "gu-steel-1mm" in json.dumps(json.loads(text))


def test_an_unknown_keyword_is_refused_in_pythons_words():
    with pytest.raises(TypeError, match=r"got an unexpected keyword argument 'frameskip'"):
        gym.make(HOLE, frameskip=4)
    with pytest.raises(ConfigurationError, match="did you mean 'sensor_noise'"):
        gym.make(HOLE, sensor_nois=True)


def test_the_info_of_a_reset_has_types():
    _, info = gym.make(HOLE).reset(seed=0)
    assert {value.dtype for value in info.values()} == {np.dtype(np.float64)}


def test_a_batch_gives_a_picture_of_each_lane_that_is_chosen():
    pytest.importorskip("matplotlib")
    envs = batch(HOLE, 3, render_mode="rgb_array", render_lanes=[2, 0])
    envs.reset(seed=0)
    assert [frame.shape for frame in envs.render()] == [(640, 960, 3)] * 2
    envs.close()
    listed = batch(HOLE, 2, render_mode="rgb_array_list")
    listed.reset(seed=0)
    listed.step(np.zeros((2, 1), np.float32))
    assert [len(frames) for frames in listed.render()] == [2, 2] and [len(f) for f in listed.render()] == [0, 0]
    listed.close()
    with pytest.raises(ValueError, match="render_lanes: expected numbers of environments below 2"):
        batch(HOLE, 2, render_mode="rgb_array", render_lanes=[2])
