"""Libraries that step these environments: each is used as its own users use it. docs/interop.md has the versions."""

import os
import subprocess
import sys
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest

from cable_envs import ENV_IDS

HOLE = "cable_envs/CableHole-Position-Sine-v0"


def batch(n=3, **options):
    return gym.make_vec(HOLE, num_envs=n, vectorization_mode="vector_entry_point", **options)


@pytest.mark.parametrize("env_id", ENV_IDS)
def test_gymnasiums_checker(env_id):
    from gymnasium.utils.env_checker import check_env

    check_env(gym.make(env_id).unwrapped, skip_render_check=True)


@pytest.mark.parametrize("env_id", ENV_IDS)
def test_stable_baselines3s_checker(env_id):
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    checker.check_env(gym.make(env_id))


def test_gymnasiums_wrappers_that_ask_for_the_length_of_an_episode():
    env = gym.wrappers.TimeAwareObservation(gym.make(HOLE))
    observation, _ = env.reset(seed=0)
    assert env.observation_space.contains(observation)


def test_gymnasiums_vector_wrappers():
    from gymnasium.wrappers.vector import NormalizeReward, RecordEpisodeStatistics

    envs = NormalizeReward(RecordEpisodeStatistics(batch(duration=0.05)))
    envs.reset(seed=0)
    said = [envs.step(np.zeros((3, 1), np.float32))[-1] for _ in range(5)]
    assert said[-1]["episode"]["l"].tolist() == [5, 5, 5]


def test_a_video_plays_in_real_time(tmp_path):
    moviepy = pytest.importorskip("moviepy")
    pytest.importorskip("matplotlib")
    env = gym.wrappers.RecordVideo(gym.make(HOLE, render_mode="rgb_array", duration=0.3), str(tmp_path / "film"))
    env.reset(seed=0)
    for _ in range(30):
        env.step(np.zeros(1, np.float32))
    env.close()
    with moviepy.VideoFileClip(str(next(tmp_path.rglob("*.mp4")))) as clip:
        assert clip.duration == pytest.approx(0.3, abs=0.03)


def test_videos_of_a_batch(tmp_path):
    pytest.importorskip("moviepy")
    pytest.importorskip("matplotlib")
    from gymnasium.wrappers.vector import RecordVideo

    envs = RecordVideo(
        batch(2, render_mode="rgb_array", duration=0.05), str(tmp_path / "films"), episode_trigger=lambda k: True
    )
    envs.reset(seed=0)
    for _ in range(7):
        envs.step(np.zeros((2, 1), np.float32))
    envs.close()
    assert list(tmp_path.rglob("*.mp4"))


def test_sb3_contribs_time_feature_stays_in_its_range():
    wrappers = pytest.importorskip("sb3_contrib.common.wrappers")
    env = wrappers.TimeFeatureWrapper(gym.make(HOLE, duration=0.5))
    observation, _ = env.reset(seed=0)
    seen = [observation[-1], *(env.step(np.zeros(1, np.float32))[0][-1] for _ in range(50))]
    assert seen[0] == 1.0 and min(seen) == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("env_id", ENV_IDS)
def test_torchrls_environment(env_id):
    pytest.importorskip("torchrl")
    from torchrl.envs.libs.gym import GymEnv
    from torchrl.envs.utils import check_env_specs

    check_env_specs(GymEnv(env_id))


def test_skrls_wrapper_of_the_batch():
    torch, wrappers = pytest.importorskip("torch"), pytest.importorskip("skrl.envs.wrappers.torch")
    envs = wrappers.wrap_env(batch(4))
    envs.reset()
    assert tuple(envs.step(torch.zeros(4, 1))[0].shape) == (4, 10)


@pytest.fixture
def exported(tmp_path, monkeypatch):
    """Minari, with a dataset that was exported."""
    minari = pytest.importorskip("minari")
    from cablebench.cli import main

    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    words = ["--controller", "pid", "--format", "minari", "--episodes", "2", "--out", str(tmp_path)]
    with pytest.raises(SystemExit) as end:
        main(["export", "CableHole-Position-Sine", *words, "--option", "duration=0.5", "--option", "sensor_noise=true"])
    assert end.value.code == 0
    return minari


def test_minaris_normalised_score(exported):
    data = exported.load_dataset(next(iter(exported.list_local_datasets())))
    low, high = (data.storage.metadata[f"ref_{end}_score"] for end in ("min", "max"))
    scores = exported.get_normalized_score(data, np.array([low, high, 0.5 * (low + high)]))
    assert low < high and scores.tolist() == pytest.approx([0.0, 1.0, 0.5])
    assert data.spec.env_spec.max_episode_steps == 50


def test_d3rlpys_loader_of_an_export(exported):
    d3rlpy = pytest.importorskip("d3rlpy")
    data, env = d3rlpy.datasets.get_minari(next(iter(exported.list_local_datasets())))
    assert len(data.episodes) == 2 and env.reset(seed=0)[0].shape == (10,)


@pytest.mark.filterwarnings("ignore")
def test_torchrls_replay_buffer_of_an_export(exported, tmp_path):
    pytest.importorskip("torchrl")
    from torchrl.data.datasets import MinariExperienceReplay

    name = next(iter(exported.list_local_datasets()))
    buffer = MinariExperienceReplay(name, batch_size=16, load_from_local_minari=True, root=tmp_path / "torchrl")
    batch = buffer.sample()
    assert len(buffer) == 100 and batch["observation"].shape == (16, 10) and batch["action"].shape == (16, 1)


@pytest.mark.filterwarnings("ignore")
def test_d3rlpys_policy_learnt_from_data_sets_is_an_entrant(tmp_path):
    """examples/offline_d3rlpy.py, with two hundred gradient steps on a data set of ten seconds."""
    pytest.importorskip("d3rlpy")
    from cablebench.cli.shared.policies import policy_entrant
    from cablebench.export.datasets import make_dataset
    from cablebench.protocol.files import load_protocol
    from cablebench.run.evaluation import run_episode
    from tests.examples.test_examples import example

    suite, env_id = load_protocol("suite-v1"), "cable_envs/CableHole-Track-Medium-v1"
    task = replace(suite.task(env_id), options={"duration": 10.0})
    make_dataset(suite, task, "reference", tmp_path, 1)
    learnt = example("offline_d3rlpy").learn("bc-reference", tmp_path, task.short, tmp_path / "learnt", 200, 0)
    entrant = policy_entrant(str(learnt))
    env = gym.make(env_id, split="train", duration=10.0)
    episode = run_episode(env, entrant.make(env.unwrapped.setup), 1)
    assert episode.complete and entrant.charged == {"environment_steps": 1000}


class NumPyInfos(gym.Wrapper):
    """The infos of steps as NumPy's numbers, which only some libraries ask for (docs/interop.md)."""

    def step(self, action):
        *rest, info = self.env.step(action)
        return *rest, {name: np.float64(value) for name, value in info.items()}


def test_torchrls_register_of_infos():
    pytest.importorskip("torchrl")
    from torchrl.envs.libs.gym import GymWrapper

    env = GymWrapper(NumPyInfos(gym.make(HOLE))).auto_register_info_dict()
    seen = env.rollout(5)["next"]
    assert {"output", "error", "load_tension"} <= set(seen.keys()) and seen["output"].shape[0] == 5


def test_tianshous_vector():
    pytest.importorskip("tianshou")
    from tianshou.env import DummyVectorEnv

    envs = DummyVectorEnv([lambda: gym.make(HOLE, duration=0.2) for _ in range(3)])
    assert envs.reset(seed=0)[0].shape == (3, 10)
    steps = [envs.step(np.zeros((3, 1), np.float32)) for _ in range(20)]
    assert steps[-1][3].all() and not steps[0][3].any()


def test_tianshous_ppo():
    pytest.importorskip("tianshou")
    import torch
    from tianshou.algorithm import PPO
    from tianshou.algorithm.modelfree.reinforce import ProbabilisticActorPolicy
    from tianshou.algorithm.optim import AdamOptimizerFactory
    from tianshou.data import Collector, VectorReplayBuffer
    from tianshou.env import DummyVectorEnv
    from tianshou.trainer import OnPolicyTrainerParams
    from tianshou.utils.net.common import Net
    from tianshou.utils.net.continuous import ContinuousActorProbabilistic, ContinuousCritic

    env = gym.make(HOLE)
    shape = env.observation_space.shape
    actor = ContinuousActorProbabilistic(
        preprocess_net=Net(state_shape=shape, hidden_sizes=[16]), action_shape=env.action_space.shape, unbounded=True
    )
    algorithm = PPO(
        policy=ProbabilisticActorPolicy(
            actor=actor, action_space=env.action_space,
            dist_fn=lambda mean_std: torch.distributions.Independent(torch.distributions.Normal(*mean_std), 1),
        ),
        critic=ContinuousCritic(preprocess_net=Net(state_shape=shape, hidden_sizes=[16])),
        optim=AdamOptimizerFactory(lr=1e-3),
    )  # fmt: skip
    envs, one = (DummyVectorEnv([lambda: gym.make(HOLE, duration=0.5) for _ in range(n)]) for n in (2, 1))
    trained = algorithm.run_training(
        OnPolicyTrainerParams(
            training_collector=Collector(algorithm, envs, VectorReplayBuffer(400, 2)),
            test_collector=Collector(algorithm, one), max_epochs=1, epoch_num_steps=200, batch_size=100,
            update_step_num_repetitions=1, collection_step_num_env_steps=200, test_step_num_episodes=1,
        )
    )  # fmt: skip
    assert trained.train_step == 200 and trained.update_step >= 1


def test_rl_zoo3_trains_what_is_exported(tmp_path):
    pytest.importorskip("rl_zoo3")
    from cablebench.cli import main

    with pytest.raises(SystemExit) as end:
        main(["export", "CableHole-Position-Sine", "--format", "zoo", "--out", str(tmp_path / "zoo")])
    assert not end.value.code
    common = ["--env", HOLE, "--gym-packages", "cable_envs", "-f", str(tmp_path / "logs"), "--device", "cpu"]
    path = os.pathsep.join(p for p in sys.path if p)
    short = ["-conf", str(tmp_path / "zoo" / "ppo.yml"), "-n", "8192", "--eval-freq", "-1", "--num-threads", "1"]
    watched = ["--no-render", "-n", "50", "--exp-id", "1"]
    for module, words in (("rl_zoo3.train", short), ("rl_zoo3.enjoy", watched)):
        command = [sys.executable, "-m", module, "--algo", "ppo", *common, *words]
        done = subprocess.run(
            command, env={**os.environ, "PYTHONPATH": path}, cwd=tmp_path, capture_output=True, text=True, timeout=300
        )
        assert done.returncode == 0, done.stderr[-2000:]
    assert list((tmp_path / "logs").rglob("cable_envs-CableHole-Position-Sine-v0.zip"))
