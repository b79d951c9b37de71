"""Compile the kernels of the shipped environments for a wheel: ``python -m cable_envs.shipped FOLDER``.

What a user calls is called here, once for every task: an environment and a native batch, each without and with effects.
"""

import os
import subprocess
import sys
from pathlib import Path

import gymnasium

import cable_envs
from cable_envs.core.compiling.portable import PLAIN, written

OPTIONS: tuple[dict, ...] = ({}, {"effects": {"backlash": {"gap": 1e-6}}})


def call() -> None:
    """Reset and step an environment and a batch of every registered id."""
    for env_id in cable_envs.ENV_IDS:
        for options in OPTIONS:
            env = gymnasium.make(env_id, **options)
            env.reset(seed=0)
            env.step(env.action_space.sample())
            envs = gymnasium.make_vec(env_id, num_envs=2, vectorization_mode="vector_entry_point", **options)
            envs.reset(seed=0)
            envs.step(envs.action_space.sample())


def main(folder: str) -> None:
    """Write the kernels to a folder, which is made."""
    Path(folder).mkdir(parents=True, exist_ok=True)
    with written(Path(folder)) as files:
        call()
    print(f"{len(files)} kernels, {sum(file.stat().st_size for file in files) / 1e6:.1f} MB")


if __name__ == "__main__":
    if all(os.environ.get(name) == value for name, value in PLAIN.items()):
        main(*sys.argv[1:])
    else:
        subprocess.run([sys.executable, "-m", "cable_envs.shipped", *sys.argv[1:]], env=os.environ | PLAIN, check=True)
