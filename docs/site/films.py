"""Moving and still pictures of the mechanisms at work, each under the controller that its task's threshold names."""

import io
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, cast

import gymnasium as gym
import numpy as np
from PIL import Image

from cable_envs.core.config import config_path
from cable_envs.plants import family_of, plant_for
from cable_envs.render import Renderer
from cable_envs.sim.replay import replay
from cablebench.entrants.named import named_entrant
from cablebench.run.evaluation import core_of, run_episode

FRAMES, FRAME_SECONDS, QUALITY = 48, 0.11, 32
SMALL = 620
"""Pixels of the width of a picture in a list: it stands across a phone."""


@dataclass(frozen=True)
class Played:
    """How a plant without tasks is moved for its picture.

    Attributes
    ----------
    drive : str
        Action mode, or "follow".
    swing, frequency : float
        Of the sine that is commanded or followed: SI, Hz.
    disturbance : float
        Of a sine that leads by 30 degrees.
    shown : str
        Signal of the upper trace.
    changes : tuple of (str, float)
        Parameters that differ from the defaults.
    """

    drive: str
    swing: float
    frequency: float
    shown: str
    disturbance: float = 0.0
    changes: tuple[tuple[str, float], ...] = ()


PLAYED: Mapping[str, Played] = {
    "linear_drive": Played("position", 0.1, 0.4, "position", changes=(("belt_stiffness", 5e4),)),
    "coupled_drives": Played("voltage", 3.0, 0.8, "pulley_position"),
    "rotary_joint": Played("position", 1.0, 0.4, "position", changes=(("gear_friction.driving", 0.3),)),
    "band_brake": Played("follow", 0.01, 0.4, "position"),
    "transmission": Played("follow", 0.8, 0.4, "output_angle", disturbance=0.04),
}
PLAYED_SECONDS = 4.3


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


def still(env_id: str, controller: str, at: float) -> Image.Image:
    """One frame, ``at`` seconds into an episode."""
    return _frames(env_id, controller, np.array([at]))[0]


def small(frame: Image.Image, plant: str) -> bytes:
    """The mechanism alone, for a list, as a WebP."""
    part = frame.crop(family_of(plant).draws().mechanism)
    return webp(part.resize((SMALL, round(part.height * SMALL / part.width)), Image.Resampling.LANCZOS))


def last(film: bytes) -> Image.Image:
    """The last frame of an animated WebP."""
    opened = Image.open(io.BytesIO(film))
    opened.seek(getattr(opened, "n_frames", 1) - 1)
    return opened.convert("RGB")


def webp(frame: Image.Image) -> bytes:
    """A picture's file."""
    buffer = io.BytesIO()
    frame.save(buffer, format="WEBP", quality=80, method=6)
    return buffer.getvalue()


def played(name: str) -> Image.Image:
    """The last frame of a plant without tasks that is moved as `PLAYED` says."""
    plant, how, period = plant_for(name), PLAYED[name], 0.01
    values = plant.table.pack(dict(how.changes))[:, None]
    t = period * np.arange(1, round(PLAYED_SECONDS / period) + 1)
    phase = 2.0 * np.pi * how.frequency * t
    path, disturbance = how.swing * np.sin(phase), how.disturbance * np.sin(phase + np.pi / 6.0)
    names = [s.name for s in plant.signals]
    out = replay(plant, values, path, period, drive=how.drive, signals=names, disturbance=disturbance, substeps=20)
    unit = plant.signals[plant.row(how.shown)].unit
    rig = plant.parameters.unpack(values[: len(plant.parameters), 0])
    renderer = Renderer(name, rig, "moved to and fro", unit, window=PLAYED_SECONDS)
    for time, row in zip(t, out[:, :, 0], strict=True):
        signals = dict(zip(names, map(float, row), strict=True))
        renderer.push(signals, float(time), signals[how.shown], signals[how.shown])
    return Image.fromarray(renderer.frame())


def _setup(env_id: str) -> Any:
    from cable_envs.sim.setup import make_setup

    return make_setup(**gym.spec(env_id).kwargs)


def _frames(env_id: str, controller: str, times: np.ndarray) -> list[Image.Image]:
    """Frames of one episode at the given times, s."""
    entrant = named_entrant(controller)
    needs = entrant.needs(env_id, _setup(env_id)) or {}
    env = gym.make(env_id, render_mode="rgb_array", sensor_noise=False, disable_env_checker=True, **needs)
    setup = core_of(env).setup
    wanted = set((times / setup.control_period).round().astype(int))
    frames: list[Image.Image] = []
    run_episode(_Filmed(env, wanted, frames.append), entrant.make(setup), seed=0)
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
            self.keep(Image.fromarray(cast(np.ndarray, self.env.render())))
        return observation, reward, terminated, truncated or self.done >= max(self.wanted), info
