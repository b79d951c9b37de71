"""The state of many environments in the memory of a GPU: a step, and the start of the next episode, are kernels there.

A thread takes one environment through a control step: action, plant, sensors with their noise and rings, reference,
reward, end of the episode. All of it is the text of `cable_envs.sim.steppers`, and the block has the rows of the CPU's
(`cable_envs.sim.buffers`).

What a new episode begins with is drawn and prepared on the host, by the code of the CPU, while the device steps: each
environment has the first state of its next episode lying ready in a second block, and takes it by itself.
"""

from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np

from cable_envs.core.compiling import device
from cable_envs.plants.base import Plant
from cable_envs.sim import steppers
from cable_envs.sim.buffers import COMMON, ENVIRONMENT
from cable_envs.sim.setup import Setup
from cable_envs.sim.simulation import Simulation

RUNNING, ENDED, NOT_FINITE = 0, 1, 2
"""What the device says of an environment after a step: it goes on, its episode has ended, or it did not move as its
action is not finite."""

_ASKED, _ASKED_SECOND = ENVIRONMENT.row("asked"), ENVIRONMENT.row("asked_second")
_REWARD, _TERMINATED, _TRUNCATED = (ENVIRONMENT.row(name) for name in ("reward", "terminated", "truncated"))

# filled in for each kernel
cuda: Any = None
step: Any = None
take: Any = None


def _take(block, obs, next_block, next_obs, i):
    """Environment i begins the episode that lies ready."""
    for row in range(block.shape[0]):
        block[row, i] = next_block[row, i]
    for k in range(obs.shape[1]):
        obs[i, k] = next_obs[i, k]


def _step_all(block, obs, common, actions, next_block, next_obs, codes, ends, restarts):
    """A control step of every environment; with ``restarts`` those that have ended begin their next episode instead."""
    i = cuda.grid(1)
    if i < obs.shape[0]:
        first = actions[i, 0]
        last = actions[i, actions.shape[1] - 1]
        if restarts and codes[i] == ENDED:
            take(block, obs, next_block, next_obs, i)
            codes[i] = RUNNING
            ends[0, i] = ends[1, i] = False
        elif abs(first) < 1e300 and abs(last) < 1e300:  # false for what is not a number
            block[_ASKED, i] = first
            if actions.shape[1] > 1:
                block[_ASKED_SECOND, i] = last
            step(block, obs, common, i, i + 1)
            ends[0, i], ends[1, i] = block[_TERMINATED, i] > 0.0, block[_TRUNCATED, i] > 0.0
            codes[i] = ENDED if ends[0, i] or ends[1, i] else RUNNING
        else:
            codes[i] = NOT_FINITE


def _restart_ended(block, obs, next_block, next_obs, codes, last_block, last_obs):
    """Environments that have ended begin their next episode at once; what they ended with is kept."""
    i = cuda.grid(1)
    if i < obs.shape[0]:
        ended = codes[i] == ENDED
        for row in range(last_block.shape[0]):
            last_block[row, i] = block[_REWARD + row, i] if ended else 0.0
        for k in range(obs.shape[1]):
            last_obs[i, k] = obs[i, k]
        if ended:
            reward, terminated, truncated = block[_REWARD, i], block[_TERMINATED, i], block[_TRUNCATED, i]
            take(block, obs, next_block, next_obs, i)
            block[_REWARD, i], block[_TERMINATED, i], block[_TRUNCATED, i] = reward, terminated, truncated
            codes[i] = RUNNING


def _put(block, obs, columns, seen, lanes):
    """Columns from the host into their places."""
    k = cuda.grid(1)
    if k < lanes.shape[0]:
        for row in range(block.shape[0]):
            block[row, lanes[k]] = columns[row, k]
        for j in range(obs.shape[1]):
            obs[lanes[k], j] = seen[k, j]


@cache
def _kernels_of(plant: Plant, needed: int, suite: bool, precision: str) -> Any:
    """The kernel `_step_all` of a plant, in tasks of the suite or in others; compiled on first use."""
    names = steppers.filled_in(1 if needed else None, suite)
    stepped = device.on_device(steppers._step, advance=plant.device_kernel(needed, precision), **names)
    return device.as_kernel(_step_all, precision, step=stepped, take=device.on_device(_take))


@cache
def _restart() -> Any:
    return device.as_kernel(_restart_ended, take=device.on_device(_take))


@cache
def _putting() -> Any:
    return device.as_kernel(_put)


class DeviceSimulation:
    """The state of n environments side by side on a device.

    Parameters
    ----------
    setup : Setup
        What defines the environments.
    n : int
        Number of environments.
    precision : str
        "float64", or "float32": what the plant's equations are computed in. Time, references, noise, sensors and
        rewards have double precision in both.

    Attributes
    ----------
    block, obs : device arrays
        As of `cable_envs.sim.buffers.Buffers`; ``obs`` has shape (n, channels).
    ends : device array of bool, shape (2, n)
        Whether episodes were terminated and truncated by the last step.
    values : ndarray, shape (len(plant.table), n)
        True parameters of the rigs in the present episodes, on the host.
    """

    def __init__(self, setup: Setup, n: int, precision: str = "float64"):
        device.require_precision(precision)
        self._cuda = cuda = device.module()
        self.host = Simulation(setup, n)
        self.setup, self.n, self.precision = setup, n, precision
        b = self.host.buffers
        self.info_names = self.host.info_names
        self.block, self._next_block = cuda.to_device(b.block), cuda.to_device(b.block)
        self.obs, self._next_obs = cuda.to_device(b.obs), cuda.to_device(b.obs)
        self._common = cuda.to_device(np.array(b.common).view(np.dtype(COMMON.descr, align=True)))
        self._codes = cuda.to_device(np.zeros(n, dtype=np.uint8))
        self.ends = cuda.to_device(np.zeros((2, n), dtype=np.bool_))
        self._last_block: Any = None
        self._last_obs: Any = None
        self.values, self._next_values = self.host.values.copy(), self.host.values.copy()

    @property
    def reward(self) -> Any:
        """Rewards of the last step, a device array of shape (n,)."""
        return self.block[_REWARD, : self.n]

    @property
    def action(self) -> Any:
        """Actions that act now, a device array of shape (n,)."""
        return self.block[ENVIRONMENT.row("action"), : self.n]

    @property
    def table(self) -> list[Any]:
        """The values of an info, in the order of ``info_names``: device arrays of shape (n,) that follow the state."""
        first = ENVIRONMENT.row("info")
        return [self.block[first + k, : self.n] for k in range(len(self.info_names))]

    def reset(self, lanes: np.ndarray, drawn: np.ndarray, options: Mapping[str, Any] | None = None) -> None:
        """Begin new episodes, as `Simulation.reset` does with what `Simulation.draw` has drawn."""
        self.host.reset(lanes, drawn, options)
        self.values[:, lanes] = self.host.values[:, lanes]
        self._upload(self.block, self.obs, lanes)
        codes = self._codes.copy_to_host()
        codes[lanes] = RUNNING
        self._codes.copy_to_device(codes)

    def prepare(self, lanes: np.ndarray, drawn: np.ndarray) -> None:
        """Have the first states of the next episodes lie ready on the device."""
        self.host.reset(lanes, drawn)
        self._next_values[:, lanes] = self.host.values[:, lanes]
        self._upload(self._next_block, self._next_obs, lanes)

    def _upload(self, block: Any, obs: Any, lanes: np.ndarray) -> None:
        b = self.host.buffers
        if len(lanes) == self.n:
            block.copy_to_device(b.block)
            obs.copy_to_device(b.obs)
        else:
            columns = np.ascontiguousarray(b.block[:, lanes])
            given = map(self._cuda.to_device, (columns, b.obs[lanes], lanes))
            device.launched(_putting(), len(lanes), block, obs, *given)

    def step(self, actions: Any, restarts: bool) -> None:
        """A control step with ``actions``, a device array (n, 1 or 2); it leaves ``obs``, `reward` and ``ends``.

        restarts: whether environments whose episode ended in the step before begin the next one instead.
        """
        device.launched(
            _kernels_of(self.setup.plant, self.host.with_effects, self.setup.conditions is not None, self.precision),
            self.n, self.block, self.obs, self._common, actions, self._next_block, self._next_obs, self._codes,
            self.ends, restarts,
        )  # fmt: skip

    def taken(self, lanes: np.ndarray) -> None:
        """What the host knows of episodes, once the device has begun those that lay ready."""
        self.values[:, lanes] = self._next_values[:, lanes]

    def restart(self) -> tuple[Any, list[Any]]:
        """Begin the next episode where one has just ended; returns all last observations, and infos of those."""
        if self._last_block is None:
            rows = ENVIRONMENT.row("info") - _REWARD + len(self.info_names)
            self._last_block = self._cuda.to_device(np.zeros((rows, self.n)))
            self._last_obs = self._cuda.to_device(np.zeros(self.obs.shape, dtype=np.float32))
        device.launched(
            _restart(), self.n, self.block, self.obs, self._next_block, self._next_obs, self._codes, self._last_block,
            self._last_obs,
        )  # fmt: skip
        first = ENVIRONMENT.row("info") - _REWARD
        return self._last_obs, [self._last_block[first + k] for k in range(len(self.info_names))]

    def codes(self) -> np.ndarray:
        """What became of every environment in the last step, on the host (`RUNNING` and so on); waits for it."""
        return self._codes.copy_to_host()

    def actions(self, given: Any, columns: int) -> Any:
        """Actions as a device array: itself where it lies on the device, else a copy of what NumPy makes of it."""
        if hasattr(given, "copy_to_host"):  # numba's own
            return given
        if hasattr(given, "__cuda_array_interface__"):
            return self._cuda.as_cuda_array(given)
        return self._cuda.to_device(np.ascontiguousarray(given, dtype=np.float64).reshape(self.n, columns))
