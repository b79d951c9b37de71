"""Batched environments whose state stays in the memory of a GPU, and what chooses between them and those of the CPU."""

from collections.abc import Mapping
from typing import Any, NoReturn

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv

from cable_envs.core.errors import ConfigurationError, nearest
from cable_envs.render import BatchRenderer
from cable_envs.sim.device.steps import ENDED, NOT_FINITE, DeviceSimulation
from cable_envs.sim.replay import DEVICES
from cable_envs.spaces import wanted_shape
from cable_envs.vector import CableVectorEnv


def make_batch(
    task: str, reference: str | Mapping[str, Any] | None = None, num_envs: int = 1, *, device: str = "cpu",
    precision: str = "float64", **options: Any,
) -> VectorEnv:  # fmt: skip
    """What ``gymnasium.make_vec`` calls for the ids of this package.

    Parameters
    ----------
    task, reference, num_envs
        As of `cable_envs.vector.CableVectorEnv`.
    device : str
        "cpu" or "cuda".
    precision : str
        What the equations of the plant are computed in: "float64", on "cuda" also "float32".
    **options
        Further options of `cable_envs.vector.CableVectorEnv`.

    Returns
    -------
    CableVectorEnv
        On "cuda" a `DeviceVectorEnv`.

    Raises
    ------
    ConfigurationError
        For an unknown device or precision, and for "cuda" where there is no GPU.
    """
    if device not in DEVICES:
        raise ConfigurationError(f"unknown device {device!r}; {nearest(str(device), DEVICES)}")
    if device == "cuda":
        return DeviceVectorEnv(task, reference, num_envs, precision=precision, **options)
    if precision != "float64":
        raise ConfigurationError(f"precision={precision!r}: the CPU has 'float64' only; device='cuda' has both")
    return CableVectorEnv(task, reference, num_envs, **options)


class DeviceVectorEnv(CableVectorEnv):
    """`cable_envs.vector.CableVectorEnv` on an NVIDIA GPU.

    Observations, rewards and ends are arrays in its memory, which torch, CuPy and JAX take as theirs without a copy
    (``torch.as_tensor(observations, device="cuda")``; they have ``__cuda_array_interface__``). They are overwritten by
    the next `step` or `reset`: copy what is to be kept. Actions may be any such array, or one of NumPy.

    Parameters
    ----------
    task, reference, num_envs, **options
        As of `cable_envs.vector.CableVectorEnv`, but that there are no ``threads`` and no ``render_mode``.
    precision : str
        "float64", or "float32": the equations of the plant in single precision, all else as before.

    Raises
    ------
    ConfigurationError
        Where there is no GPU, and for options that do not exist or do not fit.
    """

    def __init__(
        self, task: str, reference: str | Mapping[str, Any] | None = None, num_envs: int = 1, *,
        precision: str = "float64", **options: Any,
    ):  # fmt: skip
        for name in ("render_mode", "threads"):
            if options.get(name) is not None:
                raise ConfigurationError(f"{name}: there is none with device='cuda'; leave it out")
        self.precision = precision
        super().__init__(task, reference, num_envs, **options)

    def _build(self) -> None:
        self.device = DeviceSimulation(self.setup, self.num_envs, self.precision)
        self.simulation, self._team = self.device.host, None
        self._generators = [None] * self.num_envs
        self._ahead = np.empty((self.num_envs, 1 + len(self.setup.randomize)))
        self._drawn_by: list[Any] = [None] * self.num_envs
        self._names = self.device.info_names
        self._masks = tuple(f"_{name}" for name in self._names)
        self._pictures = BatchRenderer(self.setup, None)

    @property
    def true_rig(self) -> tuple[dict[str, float], ...]:
        """Parameters of each simulated rig in its present episode, as of `cable_envs.envs.CableEnv.true_rig`."""
        parameters = self.setup.plant.parameters
        return tuple(map(parameters.unpack, self.device.values[: len(parameters)].T))

    @property
    def last_actions(self) -> Any:
        """As of `cable_envs.vector.CableVectorEnv`, a device array."""
        return self.device.action

    def _start(self, lanes: np.ndarray, options: Mapping[str, Any] | None = None) -> None:
        """Begin episodes now, and have the next ones lie ready."""
        self.device.reset(lanes, self._draws(lanes), options)
        self._begun(lanes)

    def _begun(self, lanes: np.ndarray) -> None:
        """These environments have begun the episodes that were drawn for them: the next ones are prepared."""
        for lane in lanes:
            self._drawn_by[lane] = None
        self.device.prepare(lanes, self._draws(lanes))

    def _draws(self, lanes: np.ndarray) -> np.ndarray:
        """What the next episodes take from their generators, drawn once: those of new generators again."""
        late = [lane for lane in lanes if self._drawn_by[lane] is not self._generator(lane)]
        if late:
            generators = [self._generator(lane) for lane in late]
            self._ahead[late] = self.simulation.draw(generators)
            for lane, generator in zip(late, generators, strict=True):
                self._drawn_by[lane] = generator
        return self._ahead[lanes]

    def _seen(self) -> Any:
        return self.device.obs

    def infos(self, mask: Any = None) -> dict[str, Any]:
        """Infos of the present state: device arrays of shape (num_envs,) that follow it.

        Parameters
        ----------
        mask : ndarray of bool, shape (num_envs,), optional
            What the entries ``_name`` hold; no value is set to zero.
        """
        masks = dict.fromkeys(self._masks, self._everyone if mask is None else mask.copy())
        return {**dict(zip(self._names, self.device.table, strict=True)), **masks}

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """Go on by one control period in every environment.

        Parameters
        ----------
        actions : array, shape (num_envs, 1) or (num_envs, 2)
            As of `cable_envs.vector.CableVectorEnv.step`: an array on the device, or one of NumPy.

        Returns
        -------
        observations, rewards, terminated, truncated : device arrays
            As of `cable_envs.vector.CableVectorEnv.step`.
        infos : dict
            As there, with device arrays as values; masks are NumPy's.

        Raises
        ------
        gymnasium.error.ResetNeeded
            As there.
        ValueError
            For actions of another shape, and for some that are not finite: their environments have not moved then, the
            others have.
        """
        if not self._running:
            raise gym.error.ResetNeeded("call reset() before the first step()")
        if self._any_finished and self.autoreset_mode == AutoresetMode.DISABLED:
            late = self._all[self._finished]
            raise gym.error.ResetNeeded(
                f"environments {late[:5].tolist()} have finished: reset(options={{'reset_mask': ...}})"
            )
        shape = tuple(getattr(actions, "shape", None) or np.shape(actions))
        if shape != self.action_space.shape:
            raise ValueError(f"actions must have shape {wanted_shape(self.setup, self.num_envs)}, got {shape}")
        d = self.device
        d.step(d.actions(actions, len(self.setup.ranges)), self._any_finished)
        if self._any_finished:  # while the device steps
            begun = self._all[self._finished]
            d.taken(begun)
            self._begun(begun)
        codes = d.codes()
        if (codes == NOT_FINITE).any():
            bad = self._all[codes == NOT_FINITE]
            raise ValueError(f"actions must be finite numbers in [-1, 1]; environments {bad[:5].tolist()} are not")
        self._finished = codes == ENDED
        self._any_finished = bool(self._finished.any())
        final = self._restarted() if self.autoreset_mode == AutoresetMode.SAME_STEP and self._any_finished else {}
        infos = {**self.infos(), **final} if self.step_infos else final
        return d.obs, d.reward, d.ends[0], d.ends[1], infos

    def _restarted(self) -> dict[str, Any]:
        """SAME_STEP: the next episodes have begun; what the last ones ended with."""
        ended, masks = self._finished.copy(), dict.fromkeys(self._masks, self._finished.copy())
        obs, table = self.device.restart()
        lanes = self._all[ended]
        self.device.taken(lanes)
        self._begun(lanes)
        self._finished, self._any_finished = np.zeros(self.num_envs, dtype=np.bool_), False
        final_info = {**dict(zip(self._names, table, strict=True)), **masks}
        return {"final_obs": obs, "_final_obs": ended, "final_info": final_info, "_final_info": ended.copy()}

    def _on_the_host_only(self, *_: Any, **__: Any) -> NoReturn:
        raise ConfigurationError("not with device='cuda': copies and saved states are those of device='cpu'")

    state = restore = __getstate__ = __setstate__ = _on_the_host_only
