"""The pictures of joint and wrist in docs/cable-mechanisms.md: both commands of each in motion, drawn once.

Run ``python docs/pictures/joints.py`` with the extra render; it writes joint.webp and wrist.webp beside itself.
"""

from pathlib import Path

import gymnasium as gym
import numpy as np
from PIL import Image

import cable_envs  # noqa: F401 - registers the environments

SHOWN = {
    "joint": ("cable_envs/AntagonistJoint-Position-Sine-v1", "position_and_co_contraction"),
    "wrist": ("cable_envs/Wrist-Position-Sine-v1", "position_and_pitch"),
}
"""File -> environment and action mode."""
SECONDS = 12.0


def drawn(env_id: str, mode: str) -> Image.Image:
    """The last frame of an episode in which the first command follows the reference and the second swings slowly."""
    env = gym.make(env_id, action_mode=mode, render_mode="rgb_array", duration=SECONDS, disable_env_checker=True)
    setup = env.unwrapped.setup
    env.reset(seed=0)
    for k in range(setup.steps):
        t = (k + 1) * setup.control_period
        wanted = setup.reference.get("offset", 0.0) + setup.reference["amplitude"] * np.sin(
            2.0 * np.pi * setup.reference["frequency"] * t
        )
        first = 2.0 * (wanted - setup.low) / (setup.high - setup.low) - 1.0
        env.step(np.array([first, 0.6 * np.sin(2.0 * np.pi * t / 8.0)], np.float32))
    return Image.fromarray(env.render())


if __name__ == "__main__":
    for name, (env_id, mode) in SHOWN.items():
        drawn(env_id, mode).save(Path(__file__).with_name(f"{name}.webp"), quality=25, method=6)
