"""Training on the native batch: seeds, checkpoints, learning curve. A stopped training goes on to the bit."""

import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict
from importlib import metadata as packages
from pathlib import Path
from typing import Any, cast

import numpy as np
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import Logger
from stable_baselines3.common.running_mean_std import RunningMeanStd
from stable_baselines3.common.vec_env import VecEnv, VecFrameStack, VecNormalize

from cable_envs.agents import checkpoint
from cable_envs.agents.files import CHECKPOINT, POLICY, policy_file
from cable_envs.agents.policy import Metadata, Policy, load_policy, read_policy, save_policy
from cable_envs.agents.settings import Settings
from cable_envs.agents.vec_env import CableVecEnv
from cable_envs.core.errors import ConfigurationError
from cable_envs.core.files import require_writable

ProgressReport = Callable[[int, int, str], None]
"""(steps done, steps to do, text)"""

CURVE_POINTS = 200
"""Most points kept of a learning curve."""


class Interrupted(Exception):
    """The training was stopped by Ctrl-C or SIGTERM; it is saved and can go on.

    Attributes
    ----------
    policy : Policy
        The policy as it was saved.
    """

    def __init__(self, policy: Policy):
        super().__init__(f"stopped after {policy.steps} of {policy.metadata.settings['n_timesteps']} steps")
        self.policy = policy


class _Stop(Exception):
    """Raised between two rollouts to leave SB3's loop."""


def train(
    settings: Settings,
    seed: int,
    out: str | Path,
    *,
    resume: bool | str = False,
    overwrite: bool = False,
    checkpoint_every: float = 60.0,
    progress: ProgressReport | None = None,
    tensorboard: str | Path | None = None,
) -> Policy:
    """Train an agent and save it.

    Parameters
    ----------
    settings : Settings
        Everything but the seed.
    seed : int
        Of network, exploration and environments; environment i starts from ``seed n_envs + i``, so that those of
        two training seeds differ. The same settings and seed give the same policy on one machine, with any number of
        stops and resumptions in between.
    out : str or Path
        Folder for policy.zip and checkpoint.pt; each is replaced whole or not at all.
    resume : bool or "auto"
        True goes on from the checkpoint; "auto" does so where there is one, starts where there is nothing, and returns
        the policy where it is complete.
    overwrite : bool
        Whether to replace what is there.
    checkpoint_every : float
        s between two checkpoints.
    progress : callable, optional
        Called with (steps done, steps, text).
    tensorboard : str or Path, optional
        Folder for TensorBoard's logs.

    Returns
    -------
    Policy
        As loaded from ``out``.

    Raises
    ------
    ConfigurationError
        When ``out`` holds a policy or a checkpoint and neither resume nor overwrite is asked for, when what is to be
        resumed was trained with other settings, and when ``out`` cannot be written to, which is tried before anything
        is trained.
    Interrupted
        After Ctrl-C or SIGTERM, once everything is saved.
    """
    torch.set_num_threads(1)  # two threads are slower on networks this small, and would take the environment's core
    folder = Path(out)
    kept, done = _before(folder, settings, seed, resume, overwrite)
    if done is not None:
        return done
    require_writable(folder)
    env = training_env(settings)
    try:
        model = _new_model(settings, seed, env) if kept is None else checkpoint.restore_model(kept, settings, env)
        if tensorboard is None:
            model.set_logger(Logger(None, []))  # its own would make a temporary folder and leave it
        else:
            model.tensorboard_log = str(tensorboard)
        recorder = _Recorder(model, settings, seed, folder, kept, checkpoint_every, progress)
        stopped = False
        with _stop_between_rollouts(recorder):
            try:
                # learn() counts its steps from where num_timesteps stands
                model.learn(
                    settings.n_timesteps - model.num_timesteps, callback=recorder, reset_num_timesteps=kept is None,
                    tb_log_name=f"{settings.algo}-{settings.env_id.split('/')[-1]}-{seed}",
                )  # fmt: skip
            except (_Stop, KeyboardInterrupt):
                stopped = True
        recorder.save(complete=not stopped)
    finally:
        env.close()
    policy = load_policy(folder)
    if stopped:
        raise Interrupted(policy)
    return policy


def training_env(settings: Settings) -> VecEnv:
    """The environments as the learner sees them: adapter, stacked observations, running statistics.

    Parameters
    ----------
    settings : Settings
        Say how many there are, and what lies between them and the network.

    Returns
    -------
    VecEnv
        To be closed by the caller. VecNormalize is outermost where observations or rewards are normalised.
    """
    env: VecEnv = CableVecEnv(
        settings.env_id, settings.n_envs, stagger=settings.stagger, smoothing=settings.smoothing,
        residual=settings.correction(), first_frame=settings.first_frame, **settings.env_options,
    )  # fmt: skip
    if settings.frame_stack > 1:
        env = VecFrameStack(env, settings.frame_stack)
    if settings.normalize:
        gamma = settings.learner.get("gamma", 0.99)
        env = VecNormalize(env, gamma=gamma, **settings.normalize)
    return env


def _new_model(settings: Settings, seed: int, env: VecEnv) -> BaseAlgorithm:
    model = settings.algorithm()(
        settings.policy, env, policy_kwargs=settings.policy_arguments(), seed=seed, device="cpu",
        **settings.arguments(),
    )  # fmt: skip
    env.seed(settings.env_seeds(seed).start)  # the algorithm has seeded them with seed + i
    return model


def _before(
    folder: Path, settings: Settings, seed: int, resume: bool | str, overwrite: bool
) -> tuple[dict[str, Any] | None, Policy | None]:
    """(checkpoint to go on from, finished policy); both None for a new training. Refuses to overwrite silently."""
    file, state = folder / POLICY, folder / CHECKPOINT
    if resume:
        if resume == "auto" and not file.exists() and not state.exists():
            return None, None
        if state.exists() and not file.exists():  # it ended between its first checkpoint and its first policy
            return checkpoint.load_checkpoint(state, settings, seed), None
        _, found = read_policy(policy_file(folder))
        if found.settings_hash != settings.hash() or found.seed != seed:
            raise ConfigurationError(
                f"{file} was trained with other settings (configuration {found.settings_hash}, seed {found.seed}); "
                f"asked for are {settings.hash()}, seed {seed}"
            )
        if found.complete:
            state.unlink(missing_ok=True)  # it ended after its last policy
            if resume == "auto":
                return None, load_policy(folder)
            raise ConfigurationError(f"{file} already has its {found.steps} steps: nothing to resume")
        if not state.exists():
            raise ConfigurationError(f"{file} is not complete, but there is no {state.name} beside it to go on from")
        return checkpoint.load_checkpoint(state, settings, seed), None
    if not overwrite and (there := next((f for f in (file, state) if f.exists()), None)):
        raise ConfigurationError(f"{there} exists: choose another folder, or --resume, or --overwrite")
    return None, None


@contextmanager
def _stop_between_rollouts(recorder: "_Recorder") -> Iterator[None]:
    """Ctrl-C and SIGTERM stop the training when the rollout is done; a second Ctrl-C at once.

    Only a main thread can listen to signals; elsewhere they stay with whoever has them.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def ask(number: int, frame: Any) -> None:
        if recorder.asked_to_stop:
            raise KeyboardInterrupt
        recorder.asked_to_stop = True

    before = {number: signal.signal(number, ask) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


class _Recorder(BaseCallback):
    """Reports progress, keeps the learning curve, saves checkpoints, sets the curriculum."""

    def __init__(
        self, model: BaseAlgorithm, settings: Settings, seed: int, folder: Path, kept: dict[str, Any] | None,
        checkpoint_every: float, progress: ProgressReport | None,
    ):  # fmt: skip
        super().__init__()
        self._settings, self._seed, self._folder = settings, seed, folder
        self._every, self._progress = checkpoint_every, progress
        self._curve = list(kept["recorder"]["curve"]) if kept else []
        self._trained = kept["recorder"]["trained"] if kept else 0.0
        self._started = self._saved = time.monotonic()
        self.asked_to_stop = False
        self.model = model
        self._adapter = cast(CableVecEnv, checkpoint.layers(model)[-1])
        self._between = model.num_timesteps
        if kept is None:
            self._adapter.set_spread(settings.spread(0.0))  # before the first reset

    def _on_step(self) -> bool:
        return True

    def _on_rollout_start(self) -> None:
        now = time.monotonic()
        done, total = self.model.num_timesteps, self._settings.n_timesteps
        self._between = done
        if self._settings.curriculum:
            self._adapter.set_spread(self._settings.spread(done / total))
        if not self._curve or done - self._curve[-1][0] >= total / CURVE_POINTS:
            reward = self._reward()
            if np.isfinite(reward):
                self._curve.append((done, round(self._seconds(), 3), round(reward, 5)))
            if self._progress is not None:
                shown = f"reward per step {reward:.3f}" if np.isfinite(reward) else "first episodes"
                self._progress(min(done, total), total, shown)
        if self.asked_to_stop:
            raise _Stop
        if now - self._saved >= self._every:
            self.save(complete=False)
            self._saved = now

    def _seconds(self) -> float:
        return self._trained + time.monotonic() - self._started

    def _reward(self) -> float:
        """Mean reward per step of the last episodes (first ones may be shorter); NaN before the first."""
        episodes = self.model.ep_info_buffer or ()
        steps = sum(e["l"] for e in episodes)
        return sum(e["r"] for e in episodes) / steps if steps else float("nan")

    def save(self, complete: bool) -> None:
        """Write the policy as it stands, and unless it is complete what is needed to go on."""
        state = self._folder / CHECKPOINT
        if not complete and self.model.num_timesteps == self._between:  # in the middle of a rollout it would not repeat
            kept = {"curve": list(self._curve), "trained": self._seconds()}
            checkpoint.save_checkpoint(self.model, self._settings, self._seed, kept, state)
        metadata = Metadata(
            name=self._settings.algo,
            env_id=self._settings.env_id,
            seed=self._seed,
            steps=self.model.num_timesteps,
            complete=complete,
            channels=self._adapter.channel_names,
            settings=asdict(self._settings),
            settings_hash=self._settings.hash(),
            versions={name: packages.version(name) for name in ("torch", "stable_baselines3")},
            curve=tuple(self._curve),
            normalization=_statistics(self.model.get_env()),
        )
        save_policy(self.model, metadata, self._folder / POLICY)
        if complete:
            state.unlink(missing_ok=True)


def _statistics(env: VecEnv | None) -> dict[str, Any] | None:
    """What `agents.policy.Policy` needs to normalise as VecNormalize does; None where nothing is normalised."""
    if not isinstance(env, VecNormalize) or not env.norm_obs:
        return None
    observed = cast(RunningMeanStd, env.obs_rms)  # one for all channels: they are no dict
    return {
        "mean": observed.mean.tolist(), "variance": observed.var.tolist(),
        "clip": env.clip_obs, "epsilon": env.epsilon,
    }  # fmt: skip
