"""Training on the native batch: seeds, checkpoints, learning curve. An interrupted training keeps its work."""

import time
from collections.abc import Callable
from dataclasses import asdict
from importlib import metadata as packages
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback

from agents.policy import FILE, Metadata, Policy, load_policy, policy_file, read_policy, save_policy
from agents.settings import Settings
from agents.vec_env import CableVecEnv
from cable_envs.errors import ConfigurationError

ProgressReport = Callable[[int, int, str], None]
"""(steps done, steps to do, text)"""

CURVE_POINTS = 200
"""Most points kept of a learning curve."""


class Interrupted(Exception):
    """The training was stopped by Ctrl-C; what it had learned is saved."""

    def __init__(self, policy: Policy):
        super().__init__(f"stopped after {policy.steps} of {policy.metadata.settings['n_timesteps']} steps")
        self.policy = policy


def train(
    settings: Settings,
    seed: int,
    out: str | Path,
    *,
    resume: bool = False,
    overwrite: bool = False,
    checkpoint_every: float = 60.0,
    progress: ProgressReport | None = None,
    tensorboard: str | Path | None = None,
) -> Policy:
    """Train and save to ``out``/policy.zip; returns the policy as loaded from there.

    seed: of network, exploration and environments; environment i starts from ``seed n_envs + i``, so that the
        environments of two training seeds differ. The same settings and seed give the same policy on one machine.
    resume: go on from the policy in ``out`` (weights, optimiser, steps; the environments start anew).
    overwrite: replace a policy that is there.
    checkpoint_every: s between two savings; each replaces the file as a whole.
    tensorboard: folder for TensorBoard's logs.

    Raises ConfigurationError when ``out`` holds a policy and neither resume nor overwrite is asked for, and when what
    is to be resumed was trained with other settings; `Interrupted` after Ctrl-C, once everything is saved.
    """
    torch.set_num_threads(1)  # two threads are slower on networks this small, and would take the environment's core
    file = Path(out) / FILE
    before = _before(file, settings, seed, resume, overwrite)
    env = CableVecEnv(
        settings.env_id, settings.n_envs, stagger=settings.stagger, smoothing=settings.smoothing, **settings.env_options
    )
    env.seed(seed * settings.n_envs)
    try:
        model = settings.algorithm()(
            settings.policy, env, policy_kwargs=settings.policy_arguments(), seed=seed, device="cpu",
            tensorboard_log=None if tensorboard is None else str(tensorboard), **settings.arguments(),
        )  # fmt: skip
        if before is not None:
            model.set_parameters(file, device="cpu")
            model.num_timesteps = before.steps
        recorder = _Recorder(model, settings, seed, file, before, checkpoint_every, progress)
        stopped = False
        try:
            # learn() counts its steps from where num_timesteps stands
            model.learn(
                settings.n_timesteps - model.num_timesteps, callback=recorder, reset_num_timesteps=before is None
            )
        except KeyboardInterrupt:
            stopped = True
        recorder.save(complete=not stopped)
    finally:
        env.close()
    policy = load_policy(out)
    if stopped:
        raise Interrupted(policy)
    return policy


def _before(file: Path, settings: Settings, seed: int, resume: bool, overwrite: bool) -> Metadata | None:
    """What there is to resume; None for a new training. Refuses to overwrite silently."""
    if resume:
        _, found = read_policy(policy_file(file.parent))
        if found.settings_hash != settings.hash() or found.seed != seed:
            raise ConfigurationError(
                f"{file} was trained with other settings (configuration {found.settings_hash}, seed {found.seed}); "
                f"asked for are {settings.hash()}, seed {seed}"
            )
        if found.steps >= settings.n_timesteps:
            raise ConfigurationError(f"{file} already has its {found.steps} steps: nothing to resume")
        return found
    if file.exists() and not overwrite:
        raise ConfigurationError(f"{file} exists: choose another folder, or resume or overwrite it")
    return None


class _Recorder(BaseCallback):
    """Reports progress, keeps the learning curve, saves checkpoints."""

    def __init__(
        self, model: BaseAlgorithm, settings: Settings, seed: int, file: Path, before: Metadata | None,
        checkpoint_every: float, progress: ProgressReport | None,
    ):  # fmt: skip
        super().__init__()
        self._settings, self._seed, self._file = settings, seed, file
        self._every, self._progress = checkpoint_every, progress
        self._curve = list(before.curve) if before else []
        self._trained = self._curve[-1][1] if self._curve else 0.0
        self._started = self._saved = time.monotonic()
        self.model = model

    def _on_step(self) -> bool:
        return True

    def _on_rollout_start(self) -> None:
        now = time.monotonic()
        done, total = self.model.num_timesteps, self._settings.n_timesteps
        reward = self._reward()
        if np.isfinite(reward) and (not self._curve or done - self._curve[-1][0] >= total / CURVE_POINTS):
            self._curve.append((done, round(self._trained + now - self._started, 3), round(reward, 5)))
        if self._progress is not None:
            shown = f"reward per step {reward:.3f}" if np.isfinite(reward) else "first episodes"
            self._progress(min(done, total), total, shown)
        if now - self._saved >= self._every:
            self.save(complete=False)
            self._saved = now

    def _reward(self) -> float:
        """Mean reward per step of the last episodes (first ones may be shorter); NaN before the first."""
        episodes = self.model.ep_info_buffer or ()
        steps = sum(e["l"] for e in episodes)
        return sum(e["r"] for e in episodes) / steps if steps else float("nan")

    def save(self, complete: bool) -> None:
        """Write the policy as it stands."""
        metadata = Metadata(
            name=self._settings.algo,
            env_id=self._settings.env_id,
            seed=self._seed,
            steps=self.model.num_timesteps,
            complete=complete,
            channels=tuple(c.name for c in self._channels()),
            settings=asdict(self._settings),
            settings_hash=self._settings.hash(),
            versions={name: packages.version(name) for name in ("torch", "stable_baselines3")},
            curve=tuple(self._curve),
        )
        save_policy(self.model, metadata, self._file)

    def _channels(self) -> Any:
        return self.model.get_env().get_attr("channels", [0])[0]
