"""Moving and still pictures of the mechanisms at work, each under the controller that its task's threshold names."""

import io
import re
from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
from PIL import Image

from cable_envs.core.config import config_path
from cablebench.entrants.named import named_entrant
from cablebench.run.evaluation import run_episode

FRAMES, WIDTH, FRAME_SECONDS, QUALITY = 48, 800, 0.11, 32


def best_controller(task: str, reference: str) -> str:
    """The reference controller whose return the threshold of a task is, as configs/thresholds says it.

    Examples
    --------
    >>> best_controller("PulleyCircuit-Position", "sine")
    'feedforward-pid'
    """
    text = config_path("thresholds", f"{task}.yaml").read_text(encoding="utf-8")
    found = re.search(rf"^{reference.lower()}:.*# *([\w-]+):", text, re.MULTILINE)
    if found is None:
        raise ValueError(f"configs/thresholds/{task}.yaml names no controller beside '{reference.lower()}'")
    return found[1]


def film(env_id: str, controller: str) -> bytes:
    """About two periods of an episode without noise, as an animated WebP."""
    period = 1.0 / _setup(env_id).reference.get("frequency", 0.1)
    seconds = min(2.0 * period, _setup(env_id).steps * _setup(env_id).control_period)
    frames = _frames(env_id, controller, np.linspace(0.0, seconds, FRAMES + 1)[1:])
    buffer = io.BytesIO()
    frames[0].save(
        buffer, format="WEBP", save_all=True, append_images=frames[1:], duration=round(1000 * FRAME_SECONDS), loop=0,
        quality=QUALITY, method=4,
    )  # fmt: skip
    return buffer.getvalue()


def still(env_id: str, controller: str, at: float) -> bytes:
    """One frame, ``at`` seconds into an episode, as a WebP."""
    buffer = io.BytesIO()
    _frames(env_id, controller, np.array([at]))[0].save(buffer, format="WEBP", quality=80, method=6)
    return buffer.getvalue()


def _setup(env_id: str) -> Any:
    from cable_envs.sim.setup import make_setup

    return make_setup(**gym.spec(env_id).kwargs)


def _frames(env_id: str, controller: str, times: np.ndarray) -> list[Image.Image]:
    """Frames of one episode at the given times, s."""
    entrant = named_entrant(controller)
    needs = entrant.needs(env_id, _setup(env_id))
    env = gym.make(env_id, render_mode="rgb_array", sensor_noise=False, disable_env_checker=True, **needs)
    wanted = set((times / env.unwrapped.setup.control_period).round().astype(int))
    frames: list[Image.Image] = []
    run_episode(_Filmed(env, wanted, frames.append), entrant.make(env.unwrapped.setup), seed=0)
    env.close()
    return frames


class _Filmed(gym.Wrapper):
    """Hands over the frames of some control steps, and ends the episode after the last of them."""

    def __init__(self, env: gym.Env, wanted: set[int], keep: Callable[[Image.Image], None]):
        super().__init__(env)
        self.wanted, self.keep, self.done = wanted, keep, 0

    def step(self, action: Any) -> Any:
        observation, reward, terminated, truncated, info = super().step(action)
        self.done += 1
        if self.done in self.wanted:
            frame = Image.fromarray(self.env.render())
            self.keep(frame.resize((WIDTH, round(frame.height * WIDTH / frame.width)), Image.Resampling.LANCZOS))
        return observation, reward, terminated, truncated or self.done >= max(self.wanted), info
