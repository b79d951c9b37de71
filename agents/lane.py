"""One environment of a batch, as libraries ask for it by its number."""

from collections.abc import Mapping
from typing import Any

import numpy as np


class Lane:
    """One environment of an adapter.

    Parameters
    ----------
    venv : VecEnv
        The adapter: it has ``batch``, ``begin`` and ``get_images``.
    number : int
        Which of its environments.
    """

    def __init__(self, venv: Any, number: int):
        self._venv, self._number = venv, number

    @property
    def true_rig(self) -> dict[str, float]:
        """Parameters of the simulated rig in its present episode by name, SI."""
        return self._venv.batch.simulation.lane_rig(self._number)

    @property
    def np_random(self) -> np.random.Generator:
        """Its random generator."""
        return self._venv.batch.np_random[self._number]

    @property
    def np_random_seed(self) -> int:
        """The seed of that."""
        return self._venv.batch.np_random_seed[self._number]

    def reset(
        self, *, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin an episode in this environment alone.

        Parameters
        ----------
        seed, options
            As of `cable_envs.envs.CableEnv.reset`.

        Returns
        -------
        observation : ndarray of float32, shape (channels,)
            As the network sees it.
        info : dict
            Of this environment.
        """
        return self._venv.begin(self._number, seed, options)

    def render(self) -> np.ndarray | None:
        """Its picture, where it is among ``render_lanes`` and ``render_mode`` is "rgb_array"."""
        return self._venv.get_images()[self._number]

    def state(self) -> dict[str, Any]:
        """Its state (`cable_envs.vector.CableVectorEnv.state`), without what lies between it and a network."""
        return self._venv.batch.state([self._number])
