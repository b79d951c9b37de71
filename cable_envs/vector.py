"""Native batched environments: one kernel call steps them all; the three autoreset modes of Gymnasium."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.envs.registration import EnvSpec
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from cable_envs.core.team import WORTHWHILE, Team, available_cores
from cable_envs.envs import CableEnv
from cable_envs.render import LISTED, BatchRenderer
from cable_envs.sim.registered import described
from cable_envs.sim.setup import make_setup
from cable_envs.sim.simulation import Simulation, generator_of
from cable_envs.sim.steppers import ask
from cable_envs.spaces import make_spaces, wanted_shape

_MADE_AGAIN = frozenset((
    "setup", "simulation", "_team", "_kernel", "_advance", "_obs", "_table", "_reward", "_flags", "_pictures",
    "_generators",
))  # fmt: skip
"""Attributes that a copy makes for itself."""


def _whole(name: str, value: Any) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or value < 1:
        raise ValueError(f"{name}: expected a whole number >= 1, got {value!r}")
    return value


class CableVectorEnv(VectorEnv):
    """Many environments of `cable_envs.envs.CableEnv`, simulated together in one compiled call.

    Environment i reset with ``seed=s`` has the trajectory of the single environment reset with ``seed=s + i``, to the
    bit.

    Parameters
    ----------
    task : str
        Name of a task in configs/tasks or configs/suite, as "CableHole-Position".
    reference : str or mapping, optional
        "step", "sine", or a signal (`cable_envs.sim.references`); by default that of the level.
    num_envs : int
        Number of environments, at least 1.
    autoreset_mode : AutoresetMode or str
        When an environment begins its next episode: NEXT_STEP, SAME_STEP or DISABLED as Gymnasium defines them.
    threads : int, optional
        Threads that share the environments. By default as many as there are cores, with at least 256 environments for
        each. Give 1 inside worker processes.
    step_infos : bool
        False makes `step` return only what SAME_STEP mode says of finished episodes; `infos` gives the rest when asked.
    render_mode : str, optional
        "rgb_array", "rgb_array_list", "human" (a window) or "web" (a live page).
    render_theme : str
        "light" or "dark".
    render_lanes : sequence of int, optional
        Environments that are drawn; by default all. A window or page shows the first of them.
    max_episode_steps : int, optional
        Steps after which an episode is truncated, where that is before its ``duration``.
    **options
        Further options of `cable_envs.envs.CableEnv`, the same for all environments.

    Attributes
    ----------
    setup : Setup
        What defines the environments.
    channels : tuple of Channel
        Entries of an observation.
    simulation : Simulation
        The state of all environments.

    Raises
    ------
    ConfigurationError
        For options that do not exist or do not fit.
    ValueError
        For a number of environments or threads below 1, and for an unknown ``render_mode`` or ``autoreset_mode``.

    Examples
    --------
    >>> import gymnasium
    >>> envs = gymnasium.make_vec("cable_envs/CableHole-Position-Sine-v0", num_envs=4)
    >>> envs.observation_space.shape, envs.action_space.shape
    ((4, 10), (4, 1))
    """

    metadata = {**CableEnv.metadata, "autoreset_mode": AutoresetMode.NEXT_STEP}  # noqa: RUF012
    _spec: EnvSpec | None = None

    closed = True
    """Until there is something to close: older Gymnasiums close what was refused while it was made."""

    def __init__(
        self,
        task: str,
        reference: str | Mapping[str, Any] | None = None,
        num_envs: int = 1,
        *,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        threads: int | None = None,
        step_infos: bool = True,
        render_mode: str | None = None,
        render_theme: str = "light",
        render_lanes: Sequence[int] | None = None,
        max_episode_steps: int | None = None,
        **options: Any,
    ):
        num_envs = _whole("num_envs", num_envs)
        if render_mode is not None and render_mode not in (*self.metadata["render_modes"], LISTED):
            known = ", ".join((*self.metadata["render_modes"], LISTED))
            raise ValueError(f"unknown render_mode {render_mode!r}; valid: {known}")
        super().__init__()
        self._arguments = {"task": task, "reference": reference, **options}
        self.setup = make_setup(**self._arguments)
        if max_episode_steps is not None:
            steps = min(_whole("max_episode_steps", max_episode_steps), self.setup.steps)
            self._arguments["duration"] = steps * self.setup.control_period
            self.setup = make_setup(**self._arguments)
        self.num_envs, self.render_mode, self.render_theme = num_envs, render_mode, render_theme
        self.autoreset_mode, self.step_infos = AutoresetMode(autoreset_mode), step_infos
        fps = round(1.0 / self.setup.control_period)
        self.metadata = {**self.metadata, "autoreset_mode": self.autoreset_mode, "render_fps": fps}
        self.render_lanes = tuple(range(num_envs) if render_lanes is None else render_lanes)
        if not all(isinstance(lane, int) and 0 <= lane < num_envs for lane in self.render_lanes):
            raise ValueError(f"render_lanes: expected numbers of environments below {num_envs}, got {render_lanes!r}")
        self.single_observation_space, self.single_action_space = make_spaces(self.setup)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.channels = self.setup.channels
        size = max(min(available_cores(), num_envs // WORTHWHILE), 1) if threads is None else threads
        self._threads = _whole("threads", size)
        self._seeds = [-1] * num_envs
        self._all = np.arange(num_envs)
        self._everyone = np.ones(num_envs, dtype=np.bool_)
        self._everyone.flags.writeable = False  # handed out as the mask of every info
        self._finished = np.zeros(num_envs, dtype=np.bool_)
        self._any_finished = False
        self._running = False
        self._build()
        self.closed = False

    def _build(self) -> None:
        """What lies in memory that a kernel reads and writes."""
        self.simulation = Simulation(self.setup, self.num_envs)
        self._team: Team | None = None
        self._kernel: Callable[..., None] | None = None
        self._generators: list[np.random.Generator | None] = [None] * self.num_envs
        self._names = self.simulation.info_names
        self._masks = tuple(f"_{name}" for name in self._names)
        self._obs, self._table = self.simulation.buffers.obs, self.simulation.buffers.table
        self._reward, *self._flags = self.simulation.buffers.outcome[:3]
        self._pictures = BatchRenderer(self.setup, self.render_mode, self.render_theme, self.render_lanes)

    def __getstate__(self) -> dict[str, Any]:
        """Everything but what lies in memory that a kernel reads and writes: it is made again."""
        state = {name: value for name, value in self.__dict__.items() if name not in _MADE_AGAIN}
        return {**state, "_copied": (self.state(), bool(self._pictures.renderers), self._pictures.frames)}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """A copy goes on as the original does, to the bit."""
        copied, drawn, frames = state["_copied"]
        self.__dict__.update({name: value for name, value in state.items() if name != "_copied"})
        self._everyone.flags.writeable = False
        self.setup = make_setup(**self._arguments)
        self._build()
        self.restore(copied)
        if drawn:
            self._pictures.draw(self._names, self._table)
            self._pictures.frames = frames

    @property
    def spec(self) -> EnvSpec | None:
        """What Gymnasium knows of the batch, with the length of its episodes."""
        return self._spec

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        self._spec = described(spec, self.setup)

    @property
    def true_rig(self) -> tuple[dict[str, float], ...]:
        """Parameters of each simulated rig in its present episode, as of `cable_envs.envs.CableEnv.true_rig`."""
        return tuple(map(self.simulation.lane_rig, range(self.num_envs)))

    @property
    def last_actions(self) -> Any:
        """Actions that act now, shape (num_envs,): after a reset those that keep the mechanisms at rest."""
        return self.simulation.buffers.named.action

    # Gymnasium declares one generator and allows one for each environment; none of them is to be replaced from outside
    @property  # type: ignore[misc]
    def np_random(self) -> tuple[np.random.Generator, ...]:  # type: ignore[override]
        """A tuple with the generator of each environment."""
        return tuple(self._generator(i) for i in range(self.num_envs))

    @property
    def np_random_seed(self) -> tuple[int, ...]:  # type: ignore[override]
        """A tuple with the seed of each environment; a seed that was not given is drawn."""
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
        """Begin an episode in every environment, or in some of them.

        Parameters
        ----------
        seed : int or list of (int or None), optional
            ``seed + i`` for environment i, or a seed for each. An environment without one goes on with its generator.
        options : dict, optional
            Those of `cable_envs.envs.CableEnv.reset`, and "reset_mask": ndarray of bool, shape (num_envs,), true where
            an episode begins.

        Returns
        -------
        observations : ndarray, shape (num_envs, channels), float32
            Observations of all environments, whether they were reset or not.
        infos : dict
            As of `infos`, with values where an episode begins and zeros elsewhere.

        Raises
        ------
        ConfigurationError
            For options that do not exist or do not fit.
        ValueError
            For another number of seeds than of environments, and for a mask of another shape or type or without a true
            entry.
        """
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
            self._pictures.draw(self._names, self._table)
        return self._seen(), self.infos(None if mask is self._everyone else mask)

    def _seen(self) -> Any:
        return self._obs.copy()

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
        """Go on by one control period in every environment.

        Parameters
        ----------
        actions : ndarray, shape (num_envs, 1)
            Commands over their range, in [-1, 1]; what is beyond is clipped. Of shape (num_envs, 2) in an action mode
            with a second command.

        Returns
        -------
        observations : ndarray, shape (num_envs, channels), float32
            SI values of the channels over their scales.
        rewards : ndarray, shape (num_envs,)
            Rewards of this step.
        terminated, truncated : ndarray of bool, shape (num_envs,)
            As of `cable_envs.envs.CableEnv.step`.
        infos : dict
            As of `infos`; empty where ``step_infos`` is false. In SAME_STEP mode, where an episode has ended, also
            "final_obs", shape (num_envs, channels), and "final_info", with their masks under "_final_obs" and
            "_final_info".

        Raises
        ------
        gymnasium.error.ResetNeeded
            Before the first `reset`; in DISABLED mode also while an environment has finished and is not reset.
        ValueError
            For actions of another shape or that are not finite.

        Notes
        -----
        In NEXT_STEP mode the step after an end ignores the action of that environment: it returns the first observation
        of the next episode and the reward 0.
        """
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
            self._pictures.draw(self._names, self._table)
        return self._obs.copy(), rewards, terminated, truncated, infos

    def _ask(self, actions: Any) -> None:
        actions = np.asarray(actions)
        if actions.shape != self.action_space.shape:
            raise ValueError(f"actions must have shape {wanted_shape(self.setup, self.num_envs)}, got {actions.shape}")
        if actions.dtype != np.float32 or not actions.flags.c_contiguous:  # two versions are compiled
            actions = np.ascontiguousarray(actions, dtype=np.float64)
        if ask(self.simulation.buffers.block, actions) >= 0:
            bad = self._all[~np.isfinite(actions).all(axis=1)]
            raise ValueError(f"actions must be finite numbers in [-1, 1]; environments {bad[:5].tolist()} are not")

    def state(self, lanes: Sequence[int] | np.ndarray | None = None) -> dict[str, Any]:
        """Everything that changes from step to step, as copies.

        Parameters
        ----------
        lanes : sequence of int, optional
            Environments whose state it is; by default all.

        Returns
        -------
        dict
            State of simulation and generators, and seeds: what `restore` takes, and for one environment also
            `cable_envs.envs.CableEnv.restore`.
        """
        chosen = self._lanes(lanes)
        drawn = [self._generators[lane] for lane in chosen]
        return {
            "simulation": self.simulation.state(chosen),
            "generators": [None if g is None else g.bit_generator.state for g in drawn],
            "seeds": [self._seeds[lane] for lane in chosen],
            "running": self._running,
        }

    def restore(self, state: Mapping[str, Any], lanes: Sequence[int] | np.ndarray | None = None) -> None:
        """Go on from a `state`: the same actions then give the same trajectories, to the bit.

        Parameters
        ----------
        state : mapping
            A `state` of a batch or of a single environment with the same options. That of one environment goes into
            every one that is restored, as a planner wants it that tries many actions from one state.
        lanes : sequence of int, optional
            Environments that go back; by default all.

        Raises
        ------
        ConfigurationError
            Where the state is of other options, or of another number of environments than one or those restored.

        Examples
        --------
        >>> import gymnasium
        >>> env = gymnasium.make("cable_envs/CableHole-Position-Sine-v0")
        >>> _ = env.reset(seed=1)
        >>> envs = gymnasium.make_vec("cable_envs/CableHole-Position-Sine-v0", num_envs=3)
        >>> envs.unwrapped.restore(env.unwrapped.state())
        >>> envs.step(np.array([[0.0], [0.1], [0.2]]))[0].shape
        (3, 10)
        """
        chosen = self._lanes(lanes)
        if lanes is not None and not self._running:
            raise gym.error.ResetNeeded("call reset() before some of the environments are restored")
        self.simulation.restore(state["simulation"], None if lanes is None else chosen)
        many = len(state["seeds"]) > 1
        for k, lane in enumerate(chosen):
            self._generators[lane] = generator_of(state["generators"][k if many else 0])
            self._seeds[lane] = state["seeds"][k if many else 0]
        self._running = self._running or state["running"]
        self._finished = (self._flags[0] > 0.0) | (self._flags[1] > 0.0)
        self._any_finished = bool(self._finished.any())
        if self._running:
            self._take_kernel()

    def _lanes(self, lanes: Sequence[int] | np.ndarray | None) -> np.ndarray:
        if lanes is None:
            return self._all
        chosen = np.asarray(lanes)
        if chosen.ndim != 1 or chosen.dtype.kind not in "iu" or not np.isin(chosen, self._all).all():
            raise ValueError(f"lanes: expected numbers of environments below {self.num_envs}, got {lanes!r}")
        return chosen

    def infos(self, mask: np.ndarray | None = None) -> dict[str, Any]:
        """Infos of the present state.

        Parameters
        ----------
        mask : ndarray of bool, shape (num_envs,), optional
            Environments that are asked for; by default all.

        Returns
        -------
        dict of str to ndarray
            Every entry of `cable_envs.envs.CableEnv`'s info as an array of shape (num_envs,), zero where the mask is
            false. The mask of an entry is under its name with a leading underscore.
        """
        table = self._table.copy()
        if mask is None:
            mask = self._everyone
        else:
            mask = mask.copy()
            table[:, ~mask] = 0.0
        return {**dict(zip(self._names, table, strict=True)), **dict.fromkeys(self._masks, mask)}

    def render(self) -> tuple[Any, ...] | None:
        """Draw the environments ``render_lanes``.

        Returns
        -------
        tuple or None
            One entry for each of them. With ``render_mode`` "rgb_array" the scene in RGB, an ndarray of uint8 of shape
            (height, width, 3). With "rgb_array_list" the list of the scenes since the last call. None for "human"
            and "web", whose window or page shows the first of them.

        Raises
        ------
        gymnasium.error.ResetNeeded
            Without a ``render_mode``, and before the first `reset`.
        """
        if not self._pictures.renderers:
            raise gym.error.ResetNeeded("choose a render_mode and call reset() before render()")
        return self._pictures.pictures()

    def close_extras(self, **kwargs: Any) -> None:
        """End the threads and close the window, where there are some; Gymnasium's ``close`` calls it."""
        if self._team is not None:
            self._team.close()
        self._pictures.close()
