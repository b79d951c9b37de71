"""Native batched environments: one kernel call steps them all; the three autoreset modes of Gymnasium."""

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from cable_envs.core.team import WORTHWHILE, Team, available_cores
from cable_envs.envs import CableEnv, make_spaces
from cable_envs.sim.setup import make_setup
from cable_envs.sim.simulation import Simulation
from cable_envs.sim.steppers import ask

if TYPE_CHECKING:
    from cable_envs.render import Renderer


class CableVectorEnv(VectorEnv):
    """``num_envs`` environments of `CableEnv`, simulated together; same options, same trajectories to the bit.

    Environment i seeded with ``reset(seed=s)`` equals the single environment seeded with ``s + i``.
    Further arguments: ``autoreset_mode`` (an AutoresetMode or its value), ``threads`` (default: as many as there are
    cores, with at least 256 environments for each; give 1 inside worker processes), ``step_infos`` (False: a step
    returns the infos of finished episodes only; `infos` gives the others when asked).

    ``step`` takes actions [num_envs, 1]; rewards, terminations, truncations are [num_envs]; every info entry is an
    array [num_envs] with its mask under the name with a leading underscore. In SAME_STEP mode the last observations and
    infos of finished episodes are in ``final_obs`` [num_envs, channels] and ``final_info``.
    """

    metadata = {**CableEnv.metadata, "autoreset_mode": AutoresetMode.NEXT_STEP}  # noqa: RUF012

    def __init__(
        self,
        task: str,
        reference: str | Mapping[str, Any],
        num_envs: int = 1,
        *,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        threads: int | None = None,
        step_infos: bool = True,
        render_mode: str | None = None,
        **options: Any,
    ):
        if isinstance(num_envs, bool) or not isinstance(num_envs, int) or num_envs < 1:
            raise ValueError(f"num_envs: expected a whole number >= 1, got {num_envs!r}")
        if render_mode is not None and render_mode not in self.metadata["render_modes"]:
            raise ValueError(f"unknown render_mode {render_mode!r}; valid: {', '.join(self.metadata['render_modes'])}")
        super().__init__()
        self.setup = make_setup(task, reference, **options)
        self.num_envs, self.render_mode = num_envs, render_mode
        self.autoreset_mode, self.step_infos = AutoresetMode(autoreset_mode), step_infos
        self.metadata = {**self.metadata, "autoreset_mode": self.autoreset_mode}
        self.single_observation_space, self.single_action_space = make_spaces(self.setup)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.channels = self.setup.channels
        self.simulation = Simulation(self.setup, num_envs)
        size = max(min(available_cores(), num_envs // WORTHWHILE), 1) if threads is None else threads
        if isinstance(size, bool) or not isinstance(size, int) or size < 1:
            raise ValueError(f"threads: expected a whole number >= 1, got {threads!r}")
        self._threads = size
        self._team: Team | None = None
        self._kernel: Callable[..., None] | None = None
        self._generators: list[np.random.Generator | None] = [None] * num_envs
        self._seeds = [-1] * num_envs
        self._all = np.arange(num_envs)
        self._everyone = np.ones(num_envs, dtype=np.bool_)
        self._everyone.flags.writeable = False  # handed out as the mask of every info
        self._finished = np.zeros(num_envs, dtype=np.bool_)
        self._any_finished = False
        self._running = False
        self._names = self.simulation.info_names
        self._masks = tuple(f"_{name}" for name in self._names)
        self._obs, self._table = self.simulation.buffers.obs, self.simulation.buffers.table
        self._reward, *self._flags = self.simulation.buffers.outcome[:3]
        self._renderer: Renderer | None = None

    # Gymnasium declares one generator and allows one for each environment; none of them is to be replaced from outside
    @property  # type: ignore[misc]
    def np_random(self) -> tuple[np.random.Generator, ...]:  # type: ignore[override]
        """The generator of each environment."""
        return tuple(self._generator(i) for i in range(self.num_envs))

    @property
    def np_random_seed(self) -> tuple[int, ...]:  # type: ignore[override]
        """The seed of each environment."""
        self.np_random  # noqa: B018 (draws the seeds that were not given)
        return tuple(self._seeds)

    def _generator(self, lane: int) -> np.random.Generator:
        found = self._generators[lane]
        if found is None:
            found, self._seeds[lane] = gym.utils.seeding.np_random()
            self._generators[lane] = found
        return found

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Start new episodes: everywhere, or where ``options["reset_mask"]`` (bool [num_envs]) is true."""
        options = dict(options or {})
        mask = self._mask(options.pop("reset_mask", None))
        seeds: list[int | None]
        if seed is None:
            seeds = [None] * self.num_envs
        elif isinstance(seed, (int, np.integer)):
            seeds = [int(seed) + i for i in range(self.num_envs)]
        else:
            seeds = list(seed)
        if len(seeds) != self.num_envs:
            raise ValueError(f"expected {self.num_envs} seeds, got {len(seeds)}")
        lanes = self._all[mask]
        for lane in lanes:
            if seeds[lane] is not None:
                self._generators[lane], self._seeds[lane] = gym.utils.seeding.np_random(seeds[lane])
        self._start(lanes, options)
        self._finished[mask] = False
        self._any_finished = bool(self._finished.any())
        self._running = True
        if self.render_mode is not None:
            self._draw()
        return self._obs.copy(), self.infos(None if mask is self._everyone else mask)

    def _mask(self, mask: Any) -> np.ndarray:
        if mask is None:
            return self._everyone
        if not isinstance(mask, np.ndarray) or mask.dtype != np.bool_ or mask.shape != (self.num_envs,):
            raise ValueError(f"options['reset_mask'] must be a bool array of shape ({self.num_envs},), got {mask!r}")
        if not mask.any():
            raise ValueError("options['reset_mask'] selects no environment")
        return mask

    def _start(self, lanes: np.ndarray, options: Mapping[str, Any] | None = None) -> None:
        self.simulation.reset(lanes, [self._generator(lane) for lane in lanes], options)
        if self.simulation.kernel is not self._kernel:
            self._take_kernel()

    def _take_kernel(self) -> None:
        """The simulation's kernel, on the threads there are; another one once the first effect is on."""
        if self._team is not None:
            self._team.close()
        self._kernel = self.simulation.kernel
        self._team = self.simulation.team(self._threads) if self._threads > 1 else None
        self._advance = self._team or self.simulation.advance()

    def step(self, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Go on by one control period in every environment: arrays [environments, ...], as Gymnasium has them."""
        if not self._running:
            raise gym.error.ResetNeeded("call reset() before the first step()")
        self._ask(actions)
        if self._any_finished and self.autoreset_mode == AutoresetMode.DISABLED:
            late = self._all[self._finished]
            raise gym.error.ResetNeeded(
                f"environments {late[:5].tolist()} have finished: reset(options={{'reset_mask': ...}})"
            )
        self._advance()
        if self._any_finished:  # NEXT_STEP: what the kernel did with them is replaced by the reset
            self._start(self._all[self._finished])
        rewards, terminated, truncated = self._reward.copy(), self._flags[0] > 0.0, self._flags[1] > 0.0
        finished = terminated | truncated
        self._finished, self._any_finished = finished, bool(finished.any())
        final: dict[str, Any] = {}
        if self._any_finished and self.autoreset_mode == AutoresetMode.SAME_STEP:
            final = {
                "final_obs": self._obs.copy(), "_final_obs": finished.copy(),
                "final_info": self.infos(finished), "_final_info": finished.copy(),
            }  # fmt: skip
            self._start(self._all[finished])
            self._finished, self._any_finished = np.zeros(self.num_envs, dtype=np.bool_), False  # they run again
        infos = {**self.infos(), **final} if self.step_infos else final
        if self.render_mode is not None:
            self._draw()
        return self._obs.copy(), rewards, terminated, truncated, infos

    def _ask(self, actions: Any) -> None:
        actions = np.asarray(actions)
        if actions.shape != (self.num_envs, 1):
            raise ValueError(f"actions must have shape ({self.num_envs}, 1), got {actions.shape}")
        if actions.dtype != np.float32 or not actions.flags.c_contiguous:  # two versions are compiled
            actions = np.ascontiguousarray(actions, dtype=np.float64)
        if ask(self.simulation.buffers.block, actions) >= 0:
            bad = self._all[~np.isfinite(actions[:, 0])]
            raise ValueError(f"actions must be finite numbers in [-1, 1]; environments {bad[:5].tolist()} are not")

    def state(self) -> dict[str, Any]:
        """All that changes, generators included, as copies: what `restore` takes."""
        return {
            "simulation": self.simulation.state(),
            "generators": [None if g is None else g.bit_generator.state for g in self._generators],
            "seeds": list(self._seeds),
            "finished": self._finished.copy(),
            "running": self._running,
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from a `state` of a batch with the same options: the same trajectories to the bit."""
        self.simulation.restore(state["simulation"])
        self._take_kernel()
        self._generators = [None] * self.num_envs
        for lane, found in enumerate(state["generators"]):
            if found is not None:
                generator, _ = gym.utils.seeding.np_random(0)
                generator.bit_generator.state = found
                self._generators[lane] = generator
        self._seeds, self._finished = list(state["seeds"]), state["finished"].copy()
        self._any_finished, self._running = bool(self._finished.any()), state["running"]

    def infos(self, mask: np.ndarray | None = None) -> dict[str, Any]:
        """The infos of the present state, [num_envs] each, their masks as ``_name``; zero where ``mask`` is false."""
        table = self._table.copy()
        if mask is None:
            mask = self._everyone
        else:
            mask = mask.copy()
            table[:, ~mask] = 0.0
        return {**dict(zip(self._names, table, strict=True)), **dict.fromkeys(self._masks, mask)}

    def _draw(self) -> None:
        if self._renderer is None:
            from cable_envs.render import Renderer

            self._renderer = Renderer.for_setup(self.setup, str(self.render_mode))
        first = dict(zip(self._names, self._table[:, 0].tolist(), strict=True))
        if first["time"] == 0.0:
            self._renderer.reset()
        self._renderer.push(first, first["time"], first["reference"], first["output"])
        if self.render_mode == "human":
            self._renderer.show()

    def render(self) -> np.ndarray | None:  # type: ignore[override]  # one picture, not one of each
        """The first environment of the batch."""
        if self._renderer is None:
            raise gym.error.ResetNeeded("choose a render_mode and call reset() before render()")
        return self._renderer.frame() if self.render_mode == "rgb_array" else None

    def close_extras(self, **kwargs: Any) -> None:
        """End the threads and close the window, where there are some."""
        if self._team is not None:
            self._team.close()
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None
