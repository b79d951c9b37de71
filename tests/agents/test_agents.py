"""Learning agents: the VecEnv adapter against single environments and SB3's tools; settings; train, save, resume."""

import copy
import json
import pickle
import zipfile

import gymnasium as gym
import numpy as np
import pytest
import torch
import yaml
from stable_baselines3 import PPO
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import VecCheckNan, VecMonitor, VecNormalize

from cable_envs import ENV_IDS
from cable_envs.agents.files import agent_names
from cable_envs.agents.policy import ENTRY, load_policy
from cable_envs.agents.publish import publish_policy
from cable_envs.agents.settings import Linear, load_settings, make_settings
from cable_envs.agents.train import Interrupted, train
from cable_envs.agents.vec_env import CableVecEnv
from cable_envs.core.errors import ConfigurationError
from tests.support.tree import ROOT

HOLE = "cable_envs/CableHole-Position-Sine-v0"
CIRCUIT = "cable_envs/PulleyCircuit-Torque-Step-v0"
SHORT = {"duration": 0.25, "sensor_noise": True, "randomize": True}  # 25 steps


def _actions(n, steps, seed=0):
    return np.random.default_rng(seed).uniform(-1, 1, (steps, n, 1)).astype(np.float32)


# ---- adapter


@pytest.mark.parametrize("env_id", [HOLE, CIRCUIT])
def test_adapter_follows_single_environments_through_episode_ends(env_id):
    n, steps, seed = 3, 60, 11
    venv = CableVecEnv(env_id, n, **SHORT)
    singles = [gym.make(env_id, **SHORT) for _ in range(n)]
    venv.seed(seed)
    obs = venv.reset()
    for i, env in enumerate(singles):
        first, info = env.reset(seed=seed + i)
        np.testing.assert_array_equal(obs[i], first)
        assert venv.reset_infos[i] == info
    returns = np.zeros(n)
    for k, action in enumerate(_actions(n, steps), start=1):
        obs, rewards, dones, infos = venv.step(action)
        assert obs.dtype == rewards.dtype == np.float32 and dones.dtype == np.bool_
        for i, env in enumerate(singles):
            expected, reward, terminated, truncated, info = env.step(action[i])
            returns[i] += reward
            assert rewards[i] == np.float32(reward)
            assert dones[i] == (terminated or truncated) == (k % 25 == 0)
            if dones[i]:
                np.testing.assert_array_equal(infos[i]["terminal_observation"], expected)
                assert infos[i]["TimeLimit.truncated"] is True
                assert infos[i]["episode"]["l"] == 25
                # summed in the same order in float64
                assert infos[i]["episode"]["r"] == pytest.approx(returns[i], rel=1e-14)
                assert {name: infos[i][name] for name in info} == info
                returns[i] = 0.0
                expected, info = env.reset()
                assert venv.reset_infos[i] == info
            else:
                assert infos[i] == {}
            np.testing.assert_array_equal(obs[i], expected)


def test_torn_cable_is_no_time_limit():
    venv = CableVecEnv(HOLE, 2, duration=1.0, rig={"tension_limit": 60.0, "breaking_tension": 60.0})
    venv.seed(0)
    venv.reset()
    for _ in range(100):
        _, _, dones, infos = venv.step(np.array([[1.0], [-0.2]], np.float32))  # 120 N and 48 N
        if dones[0]:
            break
    assert dones.tolist() == [True, False]
    assert infos[0]["TimeLimit.truncated"] is False and infos[0]["peak_tension"] > 60.0
    assert infos[0]["episode"]["l"] < 100


def test_writing_to_an_info_reaches_no_other_environment_or_step():
    venv = CableVecEnv(HOLE, 3, duration=0.25)
    venv.reset()
    action = np.zeros((3, 1), np.float32)
    kept = venv.step(action)[3]
    kept[1]["mine"] = 1
    infos = venv.step(action)[3]
    assert infos == [{}, {}, {}] and kept[1] == {"mine": 1}
    infos.append("a list of its own")
    assert venv.step(action)[3] == [{}, {}, {}]


def test_stagger_spreads_first_episodes_and_leaves_later_ones_whole():
    n, horizon = 4, 40
    venv = CableVecEnv(HOLE, n, stagger=True, duration=0.4)
    venv.seed(0)
    obs = venv.reset()
    lengths = [[] for _ in range(n)]

    def sine(t):  # the reference over its scale
        return 0.01 * np.sin(2 * np.pi * 0.17189 * t) / 0.02

    for k in range(1, 3 * horizon + 1):
        obs, _, dones, infos = venv.step(np.zeros((n, 1), np.float32))
        for i in np.flatnonzero(dones):
            lengths[i].append(infos[i]["episode"]["l"])
            assert infos[i]["TimeLimit.truncated"] is True
            assert infos[i]["time"] == pytest.approx(0.01 * lengths[i][-1])  # of the ended episode
            assert venv.reset_infos[i]["time"] == 0.0
            assert infos[i]["terminal_observation"][0] != obs[i][0] == 0.0  # a sine's reference begins at zero
        if k == horizon:
            assert sorted(obs[:, 0]) == pytest.approx(sorted(sine(t) for t in (0.0, 0.1, 0.2, 0.3)), abs=1e-6)
    assert lengths == [[10, 40, 40], [20, 40, 40], [30, 40, 40], [40, 40, 40]]


def test_smoothing_keeps_a_share_of_the_last_action():
    smooth, plain = CableVecEnv(HOLE, 2, smoothing=0.75, duration=0.2), CableVecEnv(HOLE, 2, duration=0.2)
    for venv in (smooth, plain):
        venv.seed(5)
        venv.reset()
    # the hole's drive rests at the load's weight: 49.05 N of 120 N
    last = np.full((2, 1), 2 * 49.05 / 120.0 - 1)
    for action in 3 * _actions(2, 15):  # beyond the range: clipped before it is smoothed
        last = 0.75 * last + 0.25 * np.clip(action, -1, 1)
        a, b = smooth.step(action), plain.step(last)
        # actions are float32 there, and the rest action is only known to rounding here
        np.testing.assert_allclose(a[0], b[0], rtol=1e-4, atol=1e-5)


def test_vec_env_protocol():
    venv = CableVecEnv(HOLE, 3, duration=0.25, render_mode="rgb_array")
    assert venv.get_attr("render_mode") == ["rgb_array"] * 3
    assert venv.get_attr("num_envs", [0, 2]) == [3, 3]
    assert venv.get_attr("spec", 1)[0].id == HOLE
    assert venv.has_attr("channels") and venv.has_attr("spec") and not venv.has_attr("no_such_thing")
    venv.set_attr("remark", "x")
    assert venv.env_method("__getattribute__", "remark", indices=[1]) == ["x"]
    with pytest.raises(ValueError, match="whole batch"):
        venv.set_attr("remark", "y", indices=[0])
    assert venv.env_is_wrapped(gym.wrappers.TimeLimit) == [False] * 3
    assert venv.seed(7) == [7, 8, 9]
    a = venv.reset()
    venv.seed(7)
    np.testing.assert_array_equal(a, venv.reset())
    venv.set_options({"initial_position": 0.002})
    venv.reset()
    assert all(info["output"] == pytest.approx(0.002) for info in venv.reset_infos)
    venv.set_options([{}, {"initial_position": 0.0015}, {}])
    venv.reset()
    outputs = [info["output"] for info in venv.reset_infos]
    assert outputs[1] == pytest.approx(0.0015) and outputs[0] == outputs[2] != outputs[1]
    venv.close()


def test_what_is_asked_of_one_environment_is_of_that_one():
    venv = CableVecEnv(HOLE, 4, duration=0.5, randomize=True, smoothing=0.5)
    venv.seed(3)
    venv.reset()
    for _ in range(5):
        venv.step(np.full((4, 1), 0.2, np.float32))
    masses = [rig["load_mass"] for rig in venv.get_attr("true_rig")]
    assert len(set(masses)) == 4 and venv.get_attr("np_random_seed", [2]) == [5]
    before = venv.batch.infos()["time"]
    [(observation, info)] = venv.env_method("reset", seed=77, indices=[1])
    after = venv.batch.infos()["time"]
    assert after[1] == 0.0 == info["time"] and np.array_equal(np.delete(after, 1), np.delete(before, 1))
    alone = gym.make(HOLE, randomize=True)
    np.testing.assert_array_equal(alone.reset(seed=77)[0], observation)
    assert venv.get_attr("true_rig", 1)[0] == alone.unwrapped.true_rig
    for _ in range(50):
        _, _, dones, infos = venv.step(np.full((4, 1), 0.2, np.float32))
        for lane in np.flatnonzero(dones):
            assert infos[lane]["episode"]["l"] == 50
    assert venv.env_is_wrapped(Monitor) == [True] * 4


def test_copies_of_the_adapter_go_on_alike():
    venv = CableVecEnv(HOLE, 3, duration=0.3, sensor_noise=True, randomize=True, smoothing=0.5, stagger=True)
    venv.seed(1)
    venv.reset()
    actions = np.random.default_rng(0).uniform(-0.3, 0.4, (60, 3, 1)).astype(np.float32)
    for action in actions[:7]:
        venv.step(action)
    twins = [copy.deepcopy(venv), pickle.loads(pickle.dumps(venv))]
    for action in actions[7:]:
        wanted = venv.step(action)
        for twin in twins:
            for a, b in zip(wanted[:3], twin.step(action)[:3], strict=True):
                np.testing.assert_array_equal(a, b)


def test_render_shows_the_environments_that_are_chosen():
    pytest.importorskip("matplotlib")
    venv = CableVecEnv(HOLE, 3, duration=0.25, render_mode="rgb_array", render_lanes=[0, 2])
    venv.reset()
    pictures = venv.get_images()
    assert pictures[1] is None and pictures[0].shape == pictures[2].shape == (640, 960, 3)
    assert venv.render().shape[:2] in ((640, 1920), (1280, 960), (1280, 1920))
    venv.close()


def test_sb3s_wrappers_and_evaluation_accept_the_adapter():
    with pytest.warns(UserWarning, match="already wrapped with a `Monitor`"):  # its infos hold the episodes
        venv = VecMonitor(VecCheckNan(CableVecEnv(HOLE, 4, duration=0.25), raise_exception=True))
    normal = VecNormalize(venv)
    model = PPO("MlpPolicy", normal, n_steps=50, batch_size=50, n_epochs=1, seed=0, device="cpu")
    model.learn(400)
    episodes = list(model.ep_info_buffer)
    assert len(episodes) == 16 and all(e["l"] == 25 for e in episodes)
    normal.training = normal.norm_reward = False
    reward, _ = evaluate_policy(model, normal, n_eval_episodes=4)
    assert 0.0 < reward <= 25.0  # at most 1 a step


def test_value_of_a_cut_episode_is_bootstrapped():
    """A time limit is not the end of the task: SB3 adds gamma times the value of the terminal observation."""
    seen = []

    class Watched(PPO):
        def collect_rollouts(self, env, callback, rollout_buffer, n_rollout_steps):
            self.policy.predict_values = lambda obs: seen.append(obs.clone()) or torch.zeros(len(obs), 1)
            return super().collect_rollouts(env, callback, rollout_buffer, n_rollout_steps)

    venv = CableVecEnv(HOLE, 2, duration=0.25)
    Watched("MlpPolicy", venv, n_steps=30, batch_size=60, n_epochs=1, device="cpu").learn(60)
    assert [len(obs) for obs in seen] == [1, 1, 2]  # two terminal observations, then the rollout's last


# ---- settings


def test_every_algorithm_has_settings_for_every_environment():
    for algo in agent_names():
        hashes = {load_settings(algo, env_id).hash() for env_id in ENV_IDS}
        assert len(hashes) == len(ENV_IDS)


@pytest.mark.parametrize(
    "task", ["CableHole-Track-Hard", "CableHole-Sine-Hard", "PulleyCircuit-Track-Hard", "TendonSheath-Track-Hard"]
)
def test_the_reference_that_a_shipped_agent_corrects_has_its_shipped_gains_and_trials(task):
    env_id = f"cable_envs/{task}-v1"
    settings, alone = load_settings("suite-residual-ppo", env_id), load_settings("suite-ppo", env_id)
    shipped = yaml.safe_load((ROOT / f"configs/controllers/{settings.residual['controller']}-suite.yaml").read_text())
    assert settings.residual["gains"] == shipped["gains"][env_id]
    assert settings.tuning_trials == alone.tuning_trials + shipped["charged"]["tuning_trials"]


def test_settings_merge_and_schedules(tmp_path, monkeypatch):
    (tmp_path / "agents").mkdir()
    (tmp_path / "agents" / "ppo.yaml").write_text(
        "default:\n  n_envs: 8\n  n_timesteps: 2e6\n  learning_rate: lin_1.0e-3\n  gamma: 0.9\n"
        "  policy_kwargs: {net_arch: [8], activation_fn: relu}\n  env_options: {sensor_noise: true}\n"
        f"{HOLE}:\n  gamma: 0.8\n  policy_kwargs: {{log_std_init: -1.0}}\n"
    )
    monkeypatch.setattr("cable_envs.agents.files.config_path", lambda kind, name: tmp_path / kind / name)
    monkeypatch.setattr("cable_envs.agents.files.config_root", lambda: tmp_path)
    s = load_settings("ppo", HOLE, env_options={"randomize": True})
    assert (s.n_envs, s.n_timesteps, s.learner["gamma"]) == (8, 2_000_000, 0.8)
    assert s.policy_kwargs == {"net_arch": [8], "activation_fn": "relu", "log_std_init": -1.0}
    assert s.policy_arguments()["activation_fn"] is torch.nn.ReLU
    assert s.env_options == {"sensor_noise": True, "randomize": True}
    assert s.arguments()["learning_rate"] == Linear(1e-3) and Linear(1e-3)(0.25) == 2.5e-4
    assert load_settings("ppo", CIRCUIT).learner["gamma"] == 0.9
    assert load_settings("ppo", HOLE, 1000).n_timesteps == 1000
    assert load_settings("ppo", HOLE, 1000).hash() != s.hash()


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ({"gama": 0.9}, "unknown key in settings 'gama'; did you mean 'gamma'"),
        ({"n_envs": 0}, "n_envs: expected a whole number of at least 1, got 0"),
        ({"n_timesteps": "many"}, "n_timesteps: expected a whole number"),
        ({"learning_rate": "cos_1e-3"}, "learning_rate: expected a number or lin_<number>, got 'cos_1e-3'"),
        ({"policy_kwargs": {"activation_fn": "tanhh"}}, "unknown activation_fn 'tanhh'; did you mean 'tanh'"),
        ({"policy": "MlpPolizy"}, "unknown policy in settings 'MlpPolizy'; did you mean 'MlpPolicy'"),
        ({"smoothing": 1.0}, r"smoothing: expected a number in \[0, 1\), got 1.0"),
    ],
)
def test_wrong_settings_are_named(data, message):
    with pytest.raises(ConfigurationError, match=message):
        make_settings("ppo", HOLE, {"n_timesteps": 1000, **data})


def test_unknown_algorithm_is_named():
    with pytest.raises(ConfigurationError, match="unknown algorithm 'pppo'; did you mean 'ppo'"):
        load_settings("pppo", HOLE)


# ---- training


def _settings(steps=1200, **changes):
    data = {
        "n_envs": 4, "n_timesteps": steps, "n_steps": 50, "batch_size": 100, "n_epochs": 2, "learning_rate": "lin_1e-3",
        "policy_kwargs": {"net_arch": [16], "log_std_init": -1.0}, "smoothing": 0.5,
        "env_options": {"duration": 0.25, "sensor_noise": True}, **changes,
    }  # fmt: skip
    return make_settings("ppo", HOLE, data)


def _weights(policy):
    return torch.cat([p.flatten() for p in policy.network.parameters()])


def test_train_save_load_predict(tmp_path):
    reports = []
    policy = train(_settings(), 3, tmp_path, progress=lambda *r: reports.append(r))
    m = policy.metadata
    assert (m.name, m.env_id, m.seed, m.steps, m.complete) == ("ppo", HOLE, 3, 1200, True)
    assert m.settings_hash == _settings().hash() and m.channels[:3] == (
        "reference",
        "reference_rate",
        "reference_acceleration",
    )
    assert reports[-1][:2] == (1000, 1200) and len(m.curve) >= 3  # the last rollout begins at 1000
    assert all(0.0 < reward <= 1.0 for _, _, reward in m.curve)
    assert [p.name for p in tmp_path.iterdir()] == ["policy.zip"]  # the checkpoint is no longer needed
    # stable-baselines3 reads the same file, and both answer alike
    model = PPO.load(tmp_path / "policy.zip", device="cpu")
    observation = gym.make(HOLE).reset(seed=1)[0]
    raw, _ = model.predict(observation, deterministic=True)
    action, state = policy.predict(observation)
    assert action.dtype == np.float32
    rest = 2 * 49.05 / 120.0 - 1
    np.testing.assert_allclose(action, 0.5 * rest + 0.5 * raw, rtol=1e-5)
    again, _ = policy.predict(observation, state, episode_start=np.array([False]))
    np.testing.assert_allclose(again, 0.5 * action + 0.5 * raw, rtol=1e-6)
    fresh, _ = policy.predict(observation, state, episode_start=np.array([True]))
    np.testing.assert_array_equal(fresh, action)
    batch, _ = policy.predict(np.stack([observation, observation]))
    np.testing.assert_allclose(batch, np.stack([action, action]), rtol=1e-6)


def test_policy_acts_in_an_evaluation_as_in_training(tmp_path):
    """The smoothing that training did in the batch is done by the loaded policy: same rewards over an episode."""
    from cablebench.protocol.actors import PolicyActor
    from cablebench.run.evaluation import run_episode

    policy = train(_settings(400, env_options={}), 0, tmp_path)
    options = {"duration": 0.5}
    episode = run_episode(gym.make(HOLE, **options), PolicyActor(policy), seed=9)
    venv = CableVecEnv(HOLE, 1, smoothing=0.5, **options)
    venv.seed(9)
    obs, rewards = venv.reset(), []
    for _ in range(50):
        obs, reward, _, _ = venv.step(policy.network.predict(obs, deterministic=True)[0])
        rewards.append(reward[0])
    # float32 actions here, float64 inside the batch there
    np.testing.assert_allclose(episode.reward, rewards, rtol=1e-4)


def test_same_seed_same_policy_other_seed_other_policy(tmp_path):
    a, b, c = (train(_settings(400), seed, tmp_path / str(k)) for k, seed in enumerate((0, 0, 1)))
    assert torch.equal(_weights(a), _weights(b))
    assert not torch.equal(_weights(a), _weights(c))


def test_interrupted_training_is_saved_and_resumes(tmp_path):
    settings = _settings()

    def stop(done, total, text):
        if done >= 600:
            raise KeyboardInterrupt

    with pytest.raises(Interrupted, match="stopped after 600 of 1200 steps") as caught:
        train(settings, 0, tmp_path, progress=stop)
    half = caught.value.policy
    assert (half.metadata.complete, half.steps) == (False, 600)
    with pytest.raises(ConfigurationError, match="trained with other settings"):
        train(settings, 1, tmp_path, resume=True)
    whole = train(settings, 0, tmp_path, resume=True)
    assert (whole.metadata.complete, whole.steps) == (True, 1200)
    assert whole.metadata.curve[: len(half.metadata.curve)] == half.metadata.curve
    assert not torch.equal(_weights(half), _weights(whole))
    # the rollout before the stop ended with an episode in every environment: none of them begins twice
    assert torch.equal(_weights(train(settings, 0, tmp_path / "undisturbed")), _weights(whole))
    # the optimiser went on, too: 6 rollouts of 2 epochs of 2 batches
    with zipfile.ZipFile(tmp_path / "policy.zip") as archive, archive.open("policy.optimizer.pth") as file:
        state = torch.load(file, weights_only=True)["state"]
    assert {int(s["step"]) for s in state.values()} == {24}
    with pytest.raises(ConfigurationError, match="nothing to resume"):
        train(settings, 0, tmp_path, resume=True)


def test_a_policy_is_not_overwritten_unasked(tmp_path):
    train(_settings(200), 0, tmp_path)
    before = (tmp_path / "policy.zip").read_bytes()
    with pytest.raises(ConfigurationError, match="exists: choose another folder"):
        train(_settings(200), 0, tmp_path)
    assert (tmp_path / "policy.zip").read_bytes() == before
    assert train(_settings(400), 0, tmp_path, overwrite=True).steps == 400


def test_checkpoints_are_whole_policies(tmp_path):
    found = []

    def look(done, total, text):
        if (tmp_path / "policy.zip").exists():
            found.append((load_policy(tmp_path).steps, load_policy(tmp_path).metadata.complete))

    train(_settings(800), 0, tmp_path, checkpoint_every=0.0, progress=look)
    assert found == [(0, False), (200, False), (400, False)]


def test_files_that_are_no_policy_are_refused(tmp_path):
    with pytest.raises(ConfigurationError, match="no policy at"):
        load_policy(tmp_path)
    (tmp_path / "policy.zip").write_bytes(b"PK nonsense")
    with pytest.raises(ConfigurationError, match=r"policy\.zip is no whole zip file of a policy"):
        load_policy(tmp_path)


def test_policy_for_other_channels_is_refused(tmp_path):
    file = tmp_path / "policy.zip"
    train(_settings(200), 0, tmp_path)
    with zipfile.ZipFile(file) as archive:
        content = {name: archive.read(name) for name in archive.namelist()}
    data = json.loads(content[ENTRY])
    data["channels"] = data["channels"][::-1]
    content[ENTRY] = json.dumps(data).encode()
    with zipfile.ZipFile(file, "w") as archive:
        for name, text in content.items():
            archive.writestr(name, text)
    with pytest.raises(ConfigurationError, match="was trained on the channels load_velocity"):
        load_policy(file)


@pytest.mark.slow
@pytest.mark.parametrize(("env_id", "share"), [(HOLE, 0.1), ("cable_envs/PulleyCircuit-Position-Sine-v0", 0.5)])
def test_ppo_learns_to_track(env_id, share, tmp_path):
    """With configs/agents/ppo.yaml as it is: the error on the paper's rig is a share of the open loop's.

    All the steps of the file: its rigs are randomised, and what is learned shows while the learning rate falls to zero.
    With 400 000 the hole's seed 0 was left at 0.0010 m; the boards' three policies are at 0.00004 to 0.00010 m.
    """
    from cablebench.entrants.entrant import controller_entrant
    from cablebench.protocol.actors import PolicyActor
    from cablebench.run.evaluation import run_episode

    policy = train(load_settings("ppo", env_id), 0, tmp_path)
    env = gym.make(env_id, sensor_noise=True)
    learned = run_episode(env, PolicyActor(policy), seed=0)
    open_loop = run_episode(env, controller_entrant("open-loop").make(env.unwrapped.setup), seed=0)
    assert learned.complete
    assert np.sqrt(np.mean(learned.error**2)) < share * np.sqrt(np.mean(open_loop.error**2))


@pytest.mark.parametrize("algorithm", ["ppo", "sac"])
def test_a_published_policy_acts_as_before_and_is_smaller(algorithm, tmp_path):
    own = {} if algorithm == "ppo" else {"learning_starts": 40, "batch_size": 16, "buffer_size": 400}
    data = {"n_envs": 4, "n_timesteps": 200, "policy_kwargs": {"net_arch": [32, 32]}, "smoothing": 0.5, **own}
    if algorithm == "ppo":
        data |= {"n_steps": 25, "batch_size": 50}
    policy = train(make_settings(algorithm, HOLE, {**data, "env_options": {"duration": 0.25}}), 0, tmp_path / "run")
    published = load_policy(publish_policy(tmp_path / "run", tmp_path / "small" / "a.zip"))
    assert published.metadata == policy.metadata
    assert (tmp_path / "small" / "a.zip").stat().st_size < 0.4 * (tmp_path / "run" / "policy.zip").stat().st_size
    assert (
        publish_policy(tmp_path / "run", tmp_path / "b.zip").read_bytes() == (tmp_path / "small" / "a.zip").read_bytes()
    )
    seen = np.random.default_rng(0).normal(size=(5, len(policy.setup.channels))).astype(np.float32)
    np.testing.assert_array_equal(published.predict(seen)[0], policy.predict(seen)[0])
    with zipfile.ZipFile(tmp_path / "b.zip") as archive:
        assert sorted(archive.namelist()) == [ENTRY, "policy.pth"]  # nothing that would be unpickled


def test_an_unfinished_training_is_not_published(tmp_path):
    def stop(done, total, text):
        raise KeyboardInterrupt

    with pytest.raises(Interrupted):
        train(_settings(400), 0, tmp_path, progress=stop)
    with pytest.raises(ConfigurationError, match="is not complete; finish it"):
        publish_policy(tmp_path, tmp_path / "a.zip")
