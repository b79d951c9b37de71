"""What Gymnasium's own tests ask of every registered environment, asked of all ids.

Its published source distributions (1.0.0 to 1.4.0 were looked through) hold only its tests of `gymnasium.core`, which
name no environment. So the properties that its tests/envs and tests/wrappers hold are written here anew.
"""

import pickle

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import wrappers
from gymnasium.utils.env_checker import data_equivalence
from gymnasium.utils.passive_env_checker import env_reset_passive_checker, env_step_passive_checker
from gymnasium.wrappers import vector

from cable_envs import ENV_IDS

pytestmark = [
    pytest.mark.parametrize("env_id", ENV_IDS),
    pytest.mark.filterwarnings("ignore:overflow encountered in cast"),  # Gymnasium's own, where a Box changes its type
]
SHORT = {"duration": 0.2}


@pytest.fixture
def env(env_id):
    made = gym.make(env_id, **SHORT)
    yield made
    made.close()


@pytest.fixture
def envs(env_id):
    made = gym.make_vec(env_id, num_envs=3, vectorization_mode="vector_entry_point", **SHORT)
    yield made
    made.close()


def test_the_passive_checker_has_nothing_to_say(env):
    env.action_space.seed(0)
    env_reset_passive_checker(env, seed=0)
    for _ in range(10):
        env_step_passive_checker(env, env.action_space.sample())


def test_two_with_the_same_seed_are_the_same(env_id):
    pair = [gym.make(env_id, sensor_noise=True, randomize=True, **SHORT) for _ in range(2)]
    assert data_equivalence(*(env.reset(seed=7) for env in pair))
    pair[0].action_space.seed(7)
    for _ in range(20):
        action = pair[0].action_space.sample()
        steps = [env.step(action) for env in pair]
        assert data_equivalence(*steps)
        assert pair[0].observation_space.contains(steps[0][0])


def test_it_is_pickled_before_and_within_an_episode(env):
    for _ in range(2):
        twin = pickle.loads(pickle.dumps(env))
        assert data_equivalence(env.reset(seed=1), twin.reset(seed=1), exact=True)
        action = env.action_space.sample()
        assert data_equivalence(env.step(action), twin.step(action))


def test_its_spec_makes_it_again(env, env_id):
    again = gym.make(gym.envs.registration.EnvSpec.from_json(env.spec.to_json()))
    assert data_equivalence(env.reset(seed=2), again.reset(seed=2), exact=True)
    assert env.spec.id == env_id and env.spec.max_episode_steps == 20
    assert set(env.metadata["render_modes"]) == {"rgb_array", "human", "web"} and env.metadata["render_fps"] == 100


def test_an_episode_ends_where_its_spec_says(env):
    env.reset(seed=0)
    ends = [env.step(np.zeros(1, np.float32))[2:4] for _ in range(20)]
    assert ends[-1][1] and not any(cut for _, cut in ends[:-1])


WRAPPERS = {
    "ClipAction": wrappers.ClipAction,
    "DelayObservation": lambda env: wrappers.DelayObservation(env, delay=2),
    "DtypeObservation": lambda env: wrappers.DtypeObservation(env, np.float64),
    "FlattenObservation": wrappers.FlattenObservation,
    "FrameStackObservation": lambda env: wrappers.FrameStackObservation(env, 3),
    "MaxAndSkipObservation": lambda env: wrappers.MaxAndSkipObservation(env, skip=2),
    "NormalizeObservation": wrappers.NormalizeObservation,
    "NormalizeReward": wrappers.NormalizeReward,
    "OrderEnforcing": wrappers.OrderEnforcing,
    "PassiveEnvChecker": wrappers.PassiveEnvChecker,
    "RecordEpisodeStatistics": wrappers.RecordEpisodeStatistics,
    "RescaleAction": lambda env: wrappers.RescaleAction(env, np.float32(-2.0), np.float32(2.0)),
    "RescaleObservation": lambda env: wrappers.RescaleObservation(env, np.float32(-1.0), np.float32(1.0)),
    "StickyAction": lambda env: wrappers.StickyAction(env, 0.3),
    "TimeAwareObservation": wrappers.TimeAwareObservation,
    "TimeLimit": lambda env: wrappers.TimeLimit(env, 5),
}


@pytest.mark.slow  # some hundred of them; `make interop` runs all
@pytest.mark.parametrize("name", WRAPPERS)
def test_wrappers(env, name):
    wrapped = WRAPPERS[name](env)
    observation, _ = wrapped.reset(seed=3)
    wrapped.action_space.seed(3)
    done, steps = False, 0
    while not done:
        assert wrapped.observation_space.contains(np.asarray(observation, wrapped.observation_space.dtype))
        observation, reward, terminated, truncated, _ = wrapped.step(wrapped.action_space.sample())
        done, steps = terminated or truncated, steps + 1
        assert np.isfinite(reward)
    assert steps <= 20


VECTOR = {
    "ClipReward": lambda envs: vector.ClipReward(envs, -1.0, 1.0),
    "DictInfoToList": vector.DictInfoToList,
    "DtypeObservation": lambda envs: vector.DtypeObservation(envs, np.float64),
    "FlattenObservation": vector.FlattenObservation,
    "NormalizeObservation": vector.NormalizeObservation,
    "NormalizeReward": vector.NormalizeReward,
    "RecordEpisodeStatistics": vector.RecordEpisodeStatistics,
    "RescaleAction": lambda envs: vector.RescaleAction(envs, np.float32(-2.0), np.float32(2.0)),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", VECTOR)
def test_wrappers_of_the_batch(envs, name):
    wrapped = VECTOR[name](envs)
    wrapped.reset(seed=4)
    wrapped.action_space.seed(4)
    ended = np.zeros(3, bool)
    for _ in range(25):
        observation, reward, terminated, truncated, _ = wrapped.step(wrapped.action_space.sample())
        ended |= terminated | truncated
        assert observation.shape == wrapped.observation_space.shape and np.isfinite(reward).all()
    assert ended.all()


def test_the_batch_is_gymnasiums_own_in_one_call(env_id):
    options = {"sensor_noise": True, **SHORT}
    native = gym.make_vec(env_id, num_envs=3, vectorization_mode="vector_entry_point", **options)
    sync = gym.make_vec(env_id, num_envs=3, vectorization_mode="sync", **options)
    assert np.array_equal(native.reset(seed=5)[0], sync.reset(seed=5)[0])
    sync.action_space.seed(5)
    for _ in range(25):
        actions = sync.action_space.sample()
        for ours, theirs in zip(native.step(actions)[:4], sync.step(actions)[:4], strict=True):
            assert np.array_equal(ours, theirs)
