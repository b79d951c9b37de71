"""Compile the kernels of the shipped plants for a wheel: ``python -m cable_envs.shipped FOLDER``.

What users call is called here once: an environment and a native batch of every task, without and with effects, on every
variant of its plant; a recording replayed on every plant, as the diagnosis does; the ratio that controllers ask for.
"""

import os
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path

import gymnasium
import numpy as np

import cable_envs
from cable_envs.core.compiling.portable import PLAIN, written
from cable_envs.physics.hole_ratio import EXACT, hole_ratio
from cable_envs.plants import families, variants
from cable_envs.sim.replay import replay

EFFECT = {"effects": {"actuator_lag": {"time": 1e-6}}}
"""One that acts on every plant of the tasks; the kernel with effects has them all."""


def main(folder: Path) -> None:
    """Write the kernels to a folder, which is made."""
    folder.mkdir(parents=True, exist_ok=True)
    with written(folder) as files:
        environments(cable_envs.ENV_IDS + cable_envs.V1_IDS)
        replays()
        hole_ratio(EXACT, 0.01, *(1.0,) * 10)
    print(f"{len(files)} kernels in {folder}, {sum(file.stat().st_size for file in files) / 1e6:.1f} MB")


def environments(env_ids: Iterable[str]) -> None:
    """Call what steps environments: one alone and a native batch, without and with effects, every variant."""
    for env_id in env_ids:
        for variant in variants():
            for options in ({"plant": variant}, {"plant": variant, **EFFECT}):
                env = gymnasium.make(env_id, **options)
                many = gymnasium.make_vec(env_id, num_envs=2, vectorization_mode="vector_entry_point", **options)
                for made in (env, many):
                    made.reset(seed=0)
                    made.step(made.action_space.sample())
                    made.close()


def replays() -> None:
    """Call what replays recordings, on every plant."""
    for family in families().values():
        for variant in family.variants:
            plant = family.build(variant, 1)
            values = plant.table.pack({})[:, None]
            drives = [*(mode.name for mode in plant.action_modes), *plant.replays]
            replay(plant, values, np.zeros(2), 0.01, drive=drives[0], signals=[plant.signals[0].name], substeps=1)


if __name__ == "__main__":
    if all(os.environ.get(name) == value for name, value in PLAIN.items()):
        main(*map(Path, sys.argv[1:]))
    else:
        subprocess.run([sys.executable, "-m", "cable_envs.shipped", *sys.argv[1:]], env=os.environ | PLAIN, check=True)
