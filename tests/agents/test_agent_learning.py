"""Residual actions, history and normalisation act alike in training and evaluation; resumption to the bit; learning."""

import json
import os
import signal

import gymnasium as gym
import numpy as np
import pytest
import torch

from cable_envs import ENV_IDS
from cable_envs.agents.files import agent_names
from cable_envs.agents.policy import load_policy
from cable_envs.agents.settings import ALGORITHMS, load_settings, make_settings
from cable_envs.agents.shaping import Residual
from cable_envs.agents.train import Interrupted, train, training_env
from cable_envs.agents.vec_env import CableVecEnv
from cable_envs.baselines import make_controller
from cable_envs.core.errors import ConfigurationError
from cablebench.protocol.actors import ControllerActor, PolicyActor
from cablebench.run.evaluation import run_episode

HOLE = "cable_envs/CableHole-Position-Sine-v0"
CIRCUIT = "cable_envs/PulleyCircuit-Position-Sine-v0"
SHORT = {"duration": 0.25, "sensor_noise": True, "randomize": True}  # 25 steps
ON_POLICY = {"n_steps": 20, "batch_size": 40, "n_epochs": 2}
OFF_POLICY = {"buffer_size": 400, "learning_starts": 40, "batch_size": 16, "train_freq": 1, "gradient_steps": 1}


def _settings(algorithm, env_id=HOLE, steps=480, **changes):
    own = ON_POLICY if "ppo" in algorithm else OFF_POLICY
    if algorithm == "recurrent-ppo":
        own = {**own, "policy": "MlpLstmPolicy", "policy_kwargs": {"lstm_hidden_size": 8, "net_arch": [8]}}
    data = {"n_envs": 4, "n_timesteps": steps, "policy_kwargs": {"net_arch": [8]}, "env_options": SHORT, **own}
    return make_settings(algorithm, env_id, {**data, **changes})


EVERYTHING = {
    "smoothing": 0.5, "frame_stack": 3, "first_frame": True, "normalize": True, "curriculum": {"randomize": [0.1, 0.6]},
}  # fmt: skip


# ---- what lies between environment and network


@pytest.mark.parametrize(("env_id", "controller"), [(HOLE, "mrac-g22"), (CIRCUIT, "feedforward-pid")])
def test_a_residual_of_zero_is_the_controller(env_id, controller):
    """Through episode ends and cut first episodes, each environment's controller acts as a single one would."""
    n, options = 3, {"duration": 0.3, "sensor_noise": True}
    venv = CableVecEnv(env_id, n, stagger=True, residual=Residual(controller, 0.2), **options)
    venv.seed(5)
    seen, nothing = venv.reset(), np.zeros((n, 1), np.float32)
    rewards = [np.zeros(n)]
    for _ in range(30):
        assert seen.shape == (n, len(venv.channel_names)) and venv.channel_names[-1] == "base_action"
        assert venv.observation_space.contains(seen[0])
        seen, reward, _, _ = venv.step(nothing)
        rewards.append(reward)
    lane = n - 1  # its first episode is whole
    env = gym.make(env_id, **options)
    setup = env.unwrapped.setup
    case = (setup.plant.name, setup.action_mode.name, setup.task.kind)
    actor = ControllerActor(make_controller(controller, *case, setup.rig.values, setup.control_period), setup)
    alone = run_episode(env, actor, seed=5 + lane)
    # rewards are float32 in the batch; in a hard reversal a rounding of the action may show
    np.testing.assert_allclose([r[lane] for r in rewards[1:]], alone.reward, rtol=1e-5)


def test_a_residual_moves_the_action_by_its_share():
    venv = CableVecEnv(CIRCUIT, 2, residual=Residual("open-loop", 0.1), duration=0.5)
    venv.seed(0)
    base = venv.reset()[:, -1]
    venv.step(np.array([[1.0], [-0.5]], np.float32))
    expected = (base + np.array([0.1, -0.05])) * venv.batch.setup.high
    np.testing.assert_allclose(venv.batch.infos()["command"], expected, rtol=1e-6)


def test_the_start_of_the_episode_stays_in_view():
    venv = CableVecEnv(CIRCUIT, 2, first_frame=True, **SHORT)
    venv.seed(3)
    names = venv.channel_names
    measured = [k for k, c in enumerate(venv.batch.setup.channels) if c.measured]
    first = [names.index(f"first_{names[k]}") for k in measured]
    seen = start = venv.reset()
    for k in range(60):
        np.testing.assert_array_equal(seen[:, first], start[:, measured])
        seen, _, dones, infos = venv.step(np.full((2, 1), 0.1, np.float32))
        if dones[0]:
            assert (k + 1) % 25 == 0
            np.testing.assert_array_equal(infos[0]["terminal_observation"][first], start[0, measured])
            assert not np.array_equal(seen[:, measured], start[:, measured])
            start = seen


def test_curriculum_opens_the_ranges():
    settings = _settings("ppo", curriculum={"randomize": [0.2, 0.6]})
    assert [settings.spread(p) for p in (0.0, 0.2, 0.4, 0.6, 1.0)] == pytest.approx([0, 0, 0.5, 1, 1])
    drawn = {}
    for share in (0.0, 0.5, 1.0):
        venv = CableVecEnv(HOLE, 200, duration=0.25, randomize={"load_mass": {"low": 4.0, "high": 7.0}})
        venv.set_spread(share)
        venv.seed(0)
        venv.reset()
        simulation = venv.batch.simulation
        drawn[share] = simulation.values[simulation.setup.plant.parameters.index("load_mass")]
    assert set(drawn[0.0]) == {5.0}  # the nominal rig
    assert 4.5 <= drawn[0.5].min() < 4.6 and 5.9 < drawn[0.5].max() <= 6.0
    np.testing.assert_allclose(drawn[0.5], 2.5 + 0.5 * drawn[1.0], rtol=1e-14)  # rounding


def test_state_of_the_adapter_is_everything_that_matters():
    options = dict(stagger=True, smoothing=0.3, residual=Residual("mrac-g22", 0.2), first_frame=True, **SHORT)
    a, b = CableVecEnv(HOLE, 4, **options), CableVecEnv(HOLE, 4, **options)
    actions = np.random.default_rng(0).uniform(-1, 1, (70, 4, 1)).astype(np.float32)
    a.seed(1)
    a.reset()
    for action in actions[:33]:
        a.step(action)
    kept = a.state()
    expected = [a.step(action) for action in actions[33:]]
    b.seed(9)
    b.reset()
    b.restore(kept)
    for action, (obs, reward, done, _) in zip(actions[33:], expected, strict=True):
        again = b.step(action)
        np.testing.assert_array_equal(again[0], obs)
        np.testing.assert_array_equal(again[1], reward)
        np.testing.assert_array_equal(again[2], done)


@pytest.mark.parametrize("algorithm", ["ppo", "sac", "recurrent-ppo"])
def test_policy_acts_in_an_evaluation_as_in_training(algorithm, tmp_path):
    """Base controller, stack, start, statistics: an episode by the loaded policy equals one in the training batch."""
    residual = {"controller": "mrac-g22", "share": 0.3}
    settings = _settings(algorithm, residual=residual, **EVERYTHING)
    policy = train(settings, 0, tmp_path)
    options = {"duration": 0.5}
    episode = run_episode(gym.make(HOLE, **options), PolicyActor(policy), seed=9)
    data = {"n_envs": 1, "n_timesteps": 1, "stagger": False, "env_options": options, "residual": residual, **EVERYTHING}
    network = {"policy": settings.policy, "policy_kwargs": settings.policy_kwargs}
    alike = make_settings(algorithm, HOLE, {**data, **network})
    env = training_env(alike)
    statistics = policy.metadata.normalization
    env.training, env.obs_rms.mean = False, np.array(statistics["mean"])
    env.obs_rms.var = np.array(statistics["variance"])
    env.norm_reward = False
    env.seed(9)
    seen, state, start, rewards = env.reset(), None, np.array([True]), []
    for _ in range(50):
        action, state = policy.network.predict(seen, state, start, deterministic=True)
        seen, reward, start, _ = env.step(action)
        rewards.append(reward[0])
    # float32 actions and rewards in the batch
    np.testing.assert_allclose(episode.reward, rewards, rtol=1e-4)


@pytest.mark.parametrize("algorithm", [a for a in ALGORITHMS if a != "recurrent-ppo"])
def test_the_short_way_to_the_mean_action_is_the_networks_own(algorithm, tmp_path):
    policy = train(_settings(algorithm, steps=80), 0, tmp_path)
    seen = np.random.default_rng(0).normal(size=(7, len(policy.setup.channels))).astype(np.float32)
    with torch.inference_mode():
        short = policy._mean(torch.from_numpy(seen)).numpy()
    # float32: tanh is taken of a sum in another order
    np.testing.assert_allclose(np.clip(short, -1, 1), policy.network.predict(seen, deterministic=True)[0], atol=1e-6)


def test_wrong_settings_are_named():
    for changes, message in (
        ({"residual": {"controller": "mrac-g23", "share": 0.2}}, "mrac-g22"),
        ({"residual": {"controller": "mrac-g22", "share": 0.0}}, "residual.share: expected a number above 0"),
        ({"residual": {"controler": "mrac-g22"}}, "unknown key of residual 'controler'; did you mean 'controller'"),
        ({"curriculum": {"randomize": [0.5, 0.2]}}, "expected two rising shares"),
        ({"normalize": {"norm_obss": True}}, "unknown key of normalize 'norm_obss'; did you mean 'norm_obs'"),
        ({"noise_type": "pink"}, "unknown noise_type 'pink'"),
        ({"frame_stack": 0}, "frame_stack: expected a whole number of at least 1"),
    ):
        with pytest.raises(ConfigurationError, match=message):
            _settings("ppo", **changes)
    with pytest.raises(ConfigurationError, match="feedforward-pid"):
        _settings("ppo", HOLE, residual={"controller": "feedforward-pid", "share": 0.2})  # made for circuits


def test_files_name_every_algorithm():
    used = {load_settings(name, ENV_IDS[0]).algorithm() for name in agent_names()}
    assert used == set(ALGORITHMS.values())
    residual = load_settings("residual-ppo", CIRCUIT)
    assert (residual.algo, residual.information) == ("residual-ppo", "nominal")
    assert (
        residual.residual["controller"] == "feedforward-pid" and load_settings("ppo", HOLE).information == "model-free"
    )


# ---- stopping and going on


SLOW = [a if a in ("ppo", "sac") else pytest.param(a, marks=pytest.mark.slow) for a in ALGORITHMS]


@pytest.mark.parametrize("algorithm", SLOW)
def test_a_stopped_training_goes_on_to_the_bit(algorithm, tmp_path):
    """Stopped twice, or never: the same weights, statistics and learning curve."""
    noise = {"noise_type": "normal"} if algorithm == "td3" else {}
    settings = _settings(algorithm, residual={"controller": "mrac-g22", "share": 0.3}, **EVERYTHING, **noise)

    def stop_at(steps):
        def report(done, total, text):
            if steps <= done < steps + 80:
                os.kill(os.getpid(), signal.SIGINT)

        return report

    whole = train(settings, 2, tmp_path / "whole")
    for steps in (160, 320):
        with pytest.raises(Interrupted):
            train(settings, 2, tmp_path / "parts", resume="auto", progress=stop_at(steps))
        half = load_policy(tmp_path / "parts")
        assert not half.metadata.complete and steps <= half.steps < steps + 80
    parts = train(settings, 2, tmp_path / "parts", resume="auto")
    assert parts.metadata.complete and not (tmp_path / "parts" / "checkpoint.pt").exists()
    for name, value in whole.network.state_dict().items():
        assert torch.equal(value, parts.network.state_dict()[name]), name
    assert whole.metadata.normalization == parts.metadata.normalization
    assert [(s, r) for s, _, r in whole.metadata.curve] == [(s, r) for s, _, r in parts.metadata.curve]
    assert train(settings, 2, tmp_path / "parts", resume="auto").digest == parts.digest  # nothing left to do


def test_a_checkpoint_of_another_training_is_refused(tmp_path):
    settings = _settings("ppo")

    def stop(done, total, text):
        if done >= 160:
            raise KeyboardInterrupt

    with pytest.raises(Interrupted):
        train(settings, 0, tmp_path, progress=stop)
    with pytest.raises(ConfigurationError, match="trained with other settings"):
        train(settings, 1, tmp_path, resume="auto")
    (tmp_path / "checkpoint.pt").write_bytes(b"nonsense")
    with pytest.raises(ConfigurationError, match="is not a checkpoint of this version"):
        train(settings, 0, tmp_path, resume=True)
    (tmp_path / "checkpoint.pt").unlink()
    with pytest.raises(ConfigurationError, match=r"there is no checkpoint\.pt"):
        train(settings, 0, tmp_path, resume=True)


def test_environments_of_two_training_seeds_differ(tmp_path):
    """Environment i of training seed s starts from s n_envs + i, whatever the algorithm does to seeds."""
    settings, seen = _settings("ppo", steps=80), []
    for seed in (0, 1, 2):
        train(settings, seed, tmp_path / str(seed), checkpoint_every=0.0, progress=lambda *_: None)
    env = CableVecEnv(HOLE, 4, **SHORT)
    for seed in (0, 1, 2):
        env.seed(seed * 4)
        env.reset()
        seen.append(env.batch.simulation.values.copy())
    assert len({v.tobytes() for v in seen}) == 3
    from cable_envs.agents.train import _new_model

    model = _new_model(settings, 2, env)
    model._setup_learn(1)
    np.testing.assert_array_equal(env.batch.simulation.values, seen[2])


def test_tensorboard_and_metadata(tmp_path):
    train(_settings("ppo"), 0, tmp_path / "run", tensorboard=tmp_path / "logs")
    assert list((tmp_path / "logs").glob("ppo-CableHole-Position-Sine-v0-0_1/events.out.tfevents.*"))
    metadata = load_policy(tmp_path / "run").metadata
    assert json.loads(json.dumps(metadata.settings)) == metadata.settings


# ---- learning

TRIVIAL = {"reference": {"kind": "constant", "offset": 0.4}, "duration": 0.4, "rig": {"drive_angle_limit": 0.4}}
"""Hold the driven pulley where it is: one constant action, about 0.7, does it."""


@pytest.mark.parametrize("algorithm", SLOW)
def test_every_algorithm_learns_a_trivial_task(algorithm, tmp_path):
    data = {
        "n_envs": 16, "stagger": False, "env_options": TRIVIAL, "gamma": 0.9, "learning_rate": 1e-2,
        "policy_kwargs": {"net_arch": [16]}, "smoothing": 0.5,
    }  # fmt: skip
    if "ppo" in algorithm:
        data |= {"n_timesteps": 19200, "n_steps": 40, "batch_size": 320, "n_epochs": 10, "gae_lambda": 0.9}
        data["policy_kwargs"]["log_std_init"] = -1.0
    else:
        data |= {"n_timesteps": 9600, "buffer_size": 9600, "learning_starts": 320, "batch_size": 128, "tau": 0.05}
        data |= {"train_freq": 1, "gradient_steps": 2}
    if algorithm == "recurrent-ppo":
        data |= {"policy": "MlpLstmPolicy"}
        data["policy_kwargs"] |= {"lstm_hidden_size": 8}
    if algorithm == "td3":
        data |= {"noise_type": "normal", "noise_std": 0.2}
    if algorithm == "crossq":
        del data["tau"]
    policy = train(make_settings(algorithm, CIRCUIT, data), 0, tmp_path)
    env = gym.make(CIRCUIT, **TRIVIAL)
    learned = run_episode(env, PolicyActor(policy), seed=0).reward.mean()
    untrained = run_episode(env, _Still(), seed=0).reward.mean()
    assert untrained < 0.1 and learned > 0.2  # 1 is to be had


class _Still:
    """An action of zero."""

    def start(self, env):
        pass

    def act(self, observation, t):
        return np.zeros(1, np.float32)
