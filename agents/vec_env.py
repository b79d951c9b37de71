"""The native batch as a stable-baselines3 VecEnv: one Python call per batch step, nothing per environment."""

import copy
import time
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, cast

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env.base_vec_env import VecEnv, VecEnvIndices, tile_images

from cable_envs.agents.lane import Lane
from cable_envs.agents.shaping import BASE_CHANNEL, Residual, Shaping
from cable_envs.sim.setup import Setup
from cable_envs.sim.tasks import OBSERVATION_LIMIT
from cable_envs.spaces import make_spaces
from cable_envs.vector import CableVectorEnv


def observation_space(setup: Setup, shaping: Shaping) -> gym.spaces.Box:
    """The environment's observations with the channels that a shaping adds.

    Parameters
    ----------
    setup : Setup
        What defines the environment.
    shaping : Shaping
        What lies between it and the network.

    Returns
    -------
    gymnasium.spaces.Box
        Shape (channels + extra_channels,), float32.
    """
    space, _ = make_spaces(setup)
    high = np.array([1.0 if n == BASE_CHANNEL else OBSERVATION_LIMIT for n in shaping.extra_channels], np.float32)
    return gym.spaces.Box(np.concatenate([space.low, -high]), np.concatenate([space.high, high]), dtype=np.float32)


class CableVecEnv(VecEnv):
    """Environments for stable-baselines3, stepped in one call: a `CableVectorEnv` in SAME_STEP mode.

    Environment i follows the trajectories of ``gymnasium.make(env_id)`` seeded with ``seed + i``.

    Parameters
    ----------
    env_id : str
        Registered id.
    num_envs : int
        Number of environments.
    stagger : bool
        Whether the first episode of environment i is cut after (i + 1) / num_envs of its length, as a truncation. The
        environments are then spread over the episode. Without it the whole batch stands at the same time of the same
        reference, and every rollout shows a short piece of the task only.
    smoothing : float
        Share of the last action that is kept at every step (`cable_envs.agents.shaping`).
    residual : Residual, optional
        Controller whose action is corrected. It adds a channel to the observation.
    first_frame : bool
        Whether the measurements at the start of the episode stay in view, as further channels.
    **options
        Options of `cable_envs.envs.CableEnv`.

    Attributes
    ----------
    batch : CableVectorEnv
        The environments.
    channel_names : tuple of str
        Names of the entries of an observation.

    Notes
    -----
    Where an episode ends, its info holds "terminal_observation", "TimeLimit.truncated", "episode" (r: return, l: length
    in steps, t: s since construction) and the environment's own info. All other infos are empty.

    A policy that was trained with a shaping must be run with it, as `cable_envs.agents.policy.Policy` does.
    """

    def __init__(
        self, env_id: str, num_envs: int, *, stagger: bool = False, smoothing: float = 0.0,
        residual: Residual | None = None, first_frame: bool = False, **options: Any,
    ):  # fmt: skip
        made = gym.make_vec(
            env_id, num_envs=num_envs, vectorization_mode="vector_entry_point",
            autoreset_mode=AutoresetMode.SAME_STEP, step_infos=False, **options,
        )  # fmt: skip
        self.batch = cast(CableVectorEnv, made.unwrapped)
        self.env_id, self.render_mode = env_id, self.batch.render_mode
        self._shaping = Shaping(self.batch.setup, num_envs, smoothing, residual, first_frame)
        self.channel_names = (*(c.name for c in self.batch.channels), *self._shaping.extra_channels)
        super().__init__(num_envs, observation_space(self.batch.setup, self._shaping), self.batch.single_action_space)
        self._spec = gym.spec(env_id)
        self._started = time.monotonic()
        self._returns = np.zeros(num_envs)
        self._lengths = np.zeros(num_envs, dtype=np.int64)
        horizon = self.batch.setup.steps
        cuts = np.ceil(horizon * np.arange(1, num_envs + 1) / num_envs).astype(np.int64)
        self._first_cuts = cuts if stagger and num_envs > 1 else None
        self._cuts: np.ndarray | None = None
        self._ticks = self._next_cut = 0
        self._infos: list[dict[str, Any]] = [{} for _ in range(num_envs)]
        self._actions: np.ndarray | None = None

    def reset(self) -> np.ndarray:
        """Begin an episode in every environment, with the seeds and options that were set before.

        Returns
        -------
        ndarray of float32, shape (num_envs, channels)
            Observations as the network sees them.

        """
        observation = self._begin(range(self.num_envs), self._seeds, self._options)
        infos = self.batch.infos()
        self._reset_seeds()
        self._reset_options()
        self._shaping.begin(observation)
        self._returns[:], self._lengths[:] = 0.0, 0
        self._cuts = None if self._first_cuts is None else self._first_cuts.copy()
        self._ticks = 0
        self._plan_cut()
        self.reset_infos = [self._lane_info(infos, i) for i in range(self.num_envs)]
        return self._shaping.view(observation)

    def _begin(
        self, lanes: Iterable[int], seeds: Sequence[int | None], options: Sequence[Mapping[str, Any] | None]
    ) -> np.ndarray:
        """New episodes in some lanes, together where their options are the same; observations of all environments."""
        left = list(lanes)
        observation = np.empty(0)
        while left:
            same = [lane for lane in left if (options[lane] or {}) == (options[left[0]] or {})]
            mask = np.isin(np.arange(self.num_envs), same)
            given = [seeds[lane] if mask[lane] else None for lane in range(self.num_envs)]
            observation, _ = self.batch.reset(seed=given, options={**(options[left[0]] or {}), "reset_mask": mask})
            left = [lane for lane in left if lane not in same]
        return observation

    def begin(
        self, lane: int, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin an episode in one environment.

        Parameters
        ----------
        lane : int
            Its number.
        seed, options
            As of `cable_envs.envs.CableEnv.reset`.

        Returns
        -------
        observation : ndarray of float32, shape (channels,)
            As the network sees it.
        info : dict
            Of this environment.
        """
        observation = self._begin([lane], [seed] * self.num_envs, [options] * self.num_envs)
        here = np.array([lane])
        self._shaping.begin(observation[here], here)
        self._returns[lane], self._lengths[lane] = 0.0, 0
        if self._cuts is not None:
            self._cuts[lane] = -1
        self.reset_infos[lane] = self._lane_info(self.batch.infos(), lane)
        return self._shaping.view(observation[here], here)[0], self.reset_infos[lane]

    def step_async(self, actions: np.ndarray) -> None:
        """Keep the actions, shape (num_envs, actions), for `step_wait`."""
        self._actions = actions

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        """Go on by one control period with the actions of `step_async`.

        Returns
        -------
        observations : ndarray of float32, shape (num_envs, channels)
            As the network sees them; the first of the next episode where one has ended.
        rewards : ndarray of float32, shape (num_envs,)
            Rewards of this step.
        dones : ndarray of bool, shape (num_envs,)
            Where an episode has ended.
        infos : list of dict
            One for each environment; see the class.
        """
        assert self._actions is not None, "step_wait() without step_async()"
        action = self._shaping.apply(self._actions)
        observation, rewards, terminated, truncated, batch_infos = self.batch.step(action)
        self._returns += rewards
        self._lengths += 1
        dones = terminated | truncated
        infos = self._blank_infos()
        if batch_infos:  # some have ended
            self._finish(np.flatnonzero(dones), infos, batch_infos["final_obs"], batch_infos["final_info"], truncated)
            self._renew(np.flatnonzero(dones), self.batch.infos())
            if self._cuts is not None:
                self._cuts[dones] = -1
        if self._cuts is not None:
            self._ticks += 1
            if self._ticks == self._next_cut:
                observation = self._cut(observation, dones, infos)
        if dones.any():
            self._shape_ends(observation, dones, infos)
        else:
            self._shaping.advance(observation)
        return self._shaping.view(observation), rewards.astype(np.float32), dones, infos

    def _shape_ends(self, observation: np.ndarray, dones: np.ndarray, infos: list[dict[str, Any]]) -> None:
        """Where episodes have ended: last observations as the network sees them, then the new episodes begin."""
        ended, going = np.flatnonzero(dones), np.flatnonzero(~dones)
        last = np.array([infos[i]["terminal_observation"] for i in ended])
        self._shaping.advance(last, ended)
        for i, seen in zip(ended, self._shaping.view(last, ended), strict=True):
            infos[i]["terminal_observation"] = seen
        self._shaping.advance(observation[going], going)
        self._shaping.begin(observation[dones], ended)

    def _blank_infos(self) -> list[dict[str, Any]]:
        """An empty dict for each environment: last step's, but for those that something was written to."""
        if any(self._infos):
            self._infos = [{} if info else info for info in self._infos]
        return self._infos.copy()

    def _finish(
        self,
        lanes: np.ndarray,
        infos: list[dict[str, Any]],
        final_obs: np.ndarray,
        final_info: dict[str, Any],
        truncated: np.ndarray,
    ) -> None:
        """Fill the infos of episodes that have ended, and start counting the next ones."""
        elapsed = round(time.monotonic() - self._started, 6)
        for i in lanes.tolist():
            infos[i] = {
                **self._lane_info(final_info, i),
                "terminal_observation": final_obs[i].copy(),
                "TimeLimit.truncated": bool(truncated[i]),
                "episode": {"r": float(self._returns[i]), "l": int(self._lengths[i]), "t": elapsed},
            }
        self._returns[lanes], self._lengths[lanes] = 0.0, 0

    def _renew(self, lanes: np.ndarray, batch_infos: dict[str, Any]) -> None:
        for i in lanes.tolist():
            self.reset_infos[i] = self._lane_info(batch_infos, i)

    def _cut(self, observation: np.ndarray, dones: np.ndarray, infos: list[dict[str, Any]]) -> np.ndarray:
        """End first episodes that have reached their share (see ``stagger``); ``dones`` and ``infos`` are filled in."""
        assert self._cuts is not None, "the first episodes are not cut"
        cut = self._lengths == self._cuts
        if cut.any():
            lanes = np.flatnonzero(cut)
            self._finish(lanes, infos, observation, self.batch.infos(), cut)
            dones |= cut
            self._cuts[cut] = -1
            observation, batch_infos = self.batch.reset(options={"reset_mask": cut})
            self._renew(lanes, batch_infos)
        self._plan_cut()
        return observation

    def _plan_cut(self) -> None:
        """When to look for the next first episode to cut."""
        left = None if self._cuts is None else self._cuts[self._cuts > self._ticks]
        if left is None or not left.size:
            self._cuts = None
        else:
            self._next_cut = int(left.min())

    @staticmethod
    def _lane_info(infos: dict[str, Any], lane: int) -> dict[str, float]:
        return {
            name: float(values[lane])
            for name, values in infos.items()
            if not name.startswith("_") and isinstance(values, np.ndarray) and values.ndim == 1
        }

    def state(self) -> dict[str, Any]:
        """Everything that changes, as copies: what `restore` takes. It is to be taken between two steps."""
        return {
            "batch": self.batch.state(), "shaping": copy.deepcopy(self._shaping.state()),
            "returns": self._returns.copy(), "lengths": self._lengths.copy(), "cuts": copy.copy(self._cuts),
            "ticks": self._ticks, "next_cut": self._next_cut,
        }  # fmt: skip

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from a `state` of an adapter with the same arguments: the same trajectories to the bit."""
        self.batch.restore(state["batch"])
        self._shaping.restore(copy.deepcopy(state["shaping"]))
        self._returns[:], self._lengths[:] = state["returns"], state["lengths"]
        self._cuts, self._ticks, self._next_cut = copy.copy(state["cuts"]), state["ticks"], state["next_cut"]
        self._reset_seeds()

    def set_spread(self, share: float) -> None:
        """Draw episodes from a ``share`` of the randomisation ranges, about the nominal rig, from the next reset on."""
        self.batch.simulation.spread = share

    def close(self) -> None:
        """Close the environments."""
        self.batch.close()

    def get_images(self) -> Sequence[np.ndarray | None]:
        """The pictures of the environments ``render_lanes`` where ``render_mode`` is "rgb_array"; None for others."""
        shown = dict(zip(self.batch.render_lanes, self.batch.render() or (), strict=False))
        return [shown.get(lane) for lane in range(self.num_envs)]

    def render(self, mode: str | None = None) -> np.ndarray | None:
        """The pictures of the environments ``render_lanes`` side by side; None where ``render_mode`` is another."""
        if self.render_mode != "rgb_array":  # a window shows by itself
            return None
        return tile_images([picture for picture in self.get_images() if picture is not None])

    # What `agents.lane.Lane` has is asked of each environment; all else is the batch's own, the same for each.

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """An attribute of each environment asked for."""
        lanes = [Lane(self, number) for number in self._get_indices(indices)]
        if hasattr(Lane, attr_name) and not attr_name.startswith("__"):
            return [getattr(lane, attr_name) for lane in lanes]
        value = self._spec if attr_name == "spec" else getattr(self.batch, attr_name)
        return [value for _ in lanes]

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        """Set an attribute of the batch; ValueError where it is asked for some environments only."""
        if len(list(self._get_indices(indices))) != self.num_envs:
            raise ValueError(f"'{attr_name}' belongs to the whole batch: it cannot be set for some environments only")
        setattr(self.batch, attr_name, value)

    def has_attr(self, attr_name: str) -> bool:
        """Whether `get_attr` finds an attribute."""
        return attr_name == "spec" or hasattr(Lane, attr_name) or hasattr(self.batch, attr_name)

    def env_method(self, method_name: str, *args: Any, indices: VecEnvIndices = None, **kwargs: Any) -> list[Any]:
        """Call a method of each environment asked for; one that only the batch has is called once for all of them."""
        chosen = list(self._get_indices(indices))
        if hasattr(Lane, method_name) and not method_name.startswith("__"):
            return [getattr(Lane(self, number), method_name)(*args, **kwargs) for number in chosen]
        result = getattr(self.batch, method_name)(*args, **kwargs)
        return [result for _ in chosen]

    def env_is_wrapped(self, wrapper_class: type[gym.Wrapper], indices: VecEnvIndices = None) -> list[bool]:
        """True for `Monitor`, as the infos hold what it would write; no environment has another wrapper."""
        return [issubclass(Monitor, wrapper_class) for _ in self._get_indices(indices)]
