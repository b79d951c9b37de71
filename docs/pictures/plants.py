"""The moving picture at the top of README: both plants under the controllers of their papers.

Run ``python docs/pictures/plants.py`` with the extras bench and render; it writes plants.webp beside itself.
"""

from pathlib import Path

import gymnasium as gym
import numpy as np
from PIL import Image

from cablebench.entrants.named import named_entrant
from cablebench.run.evaluation import run_episode

FILE = Path(__file__).with_name("plants.webp")
SHOWN = (
    ("cable_envs/CableHole-Position-Sine-v0", "mrac-g22", (20, 44, 540, 500)),
    ("cable_envs/PulleyCircuit-Position-Sine-v0", "feedforward-pid", (150, 44, 960, 370)),
)
"""Environment, controller, and the part of its frame that is shown in pixels: left, upper, right, lower."""
SECONDS = 12.5
"""Simulated time: one period of the circuit's reference, two of the hole's."""
FRAMES = 10
FRAME_SECONDS = 0.75
WIDTH = 1040
"""The whole width of the front page: its letters have ten pixels there."""


def film(env_id: str, controller: str, box: tuple[int, int, int, int]) -> list[Image.Image]:
    """Frames at equal distances over `SECONDS` of an episode without noise, cut to ``box``."""
    entrant = named_entrant(controller)
    env = gym.make(env_id, disable_env_checker=True)
    needs = entrant.needs(env_id, env.unwrapped.setup)
    env.close()
    env = gym.make(env_id, render_mode="rgb_array", sensor_noise=False, disable_env_checker=True, **needs)
    steps = round(SECONDS / env.unwrapped.setup.task.control_period)
    wanted, frames = set(np.linspace(1, steps, FRAMES).round().astype(int)), []

    class Filmed(gym.Wrapper):
        done = 0

        def step(self, action):
            *result, info = super().step(action)
            self.done += 1
            if self.done in wanted:
                frames.append(Image.fromarray(self.env.render()).crop(box))
            result[3] = result[3] or self.done == steps
            return *result, info

    run_episode(Filmed(env), entrant.make(env.unwrapped.setup), seed=0)
    env.close()
    return frames


def side_by_side(*frames: Image.Image) -> Image.Image:
    """Frames of one instant beside each other, `WIDTH` pixels wide."""
    whole = Image.new("RGB", (sum(f.width for f in frames), max(f.height for f in frames)), "white")
    left = 0
    for frame in frames:
        whole.paste(frame, (left, (whole.height - frame.height) // 2))
        left += frame.width
    return whole.resize((WIDTH, round(whole.height * WIDTH / whole.width)), Image.Resampling.LANCZOS)


def main() -> None:
    """Write `FILE`."""
    frames = [side_by_side(*pair) for pair in zip(*(film(*shown) for shown in SHOWN), strict=True)]
    frames[0].save(
        FILE,
        save_all=True,
        append_images=frames[1:],
        duration=round(1000 * FRAME_SECONDS),
        loop=0,
        quality=10,
        method=6,
        minimize_size=True,
    )
    print(f"wrote {FILE}: {len(frames)} frames, {FILE.stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    main()
