"""Running episodes and keeping all that a data set needs: what was observed, done, rewarded, and told in the info."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np

from cable_envs.core.errors import ConfigurationError
from cablebench.entrants.entrant import Entrant
from cablebench.protocol.episode import Episode
from cablebench.run.evaluation import core_of, run_episode

RANDOM_STREAM = 0x5EED
"""Second word of the random policy's seed: its numbers are not those that the environment draws from the same seed."""


@dataclass(frozen=True)
class Trace:
    """One episode of n steps as it was exchanged with the environment.

    observations float32 [n + 1, channels] (the first from reset); actions float32 [n, 1] as the environment got them;
    infos: float64 [n + 1] by name; rig: the episode's true parameters, SI. Rewards and the rest are in `episode`.
    """

    seed: int
    episode: Episode
    observations: np.ndarray
    actions: np.ndarray
    infos: Mapping[str, np.ndarray]
    rig: Mapping[str, float]

    @property
    def terminations(self) -> np.ndarray:
        """bool [n]: whether the cable tore, or the state stopped being finite, in this step."""
        flags = np.zeros(len(self.actions), dtype=bool)
        flags[-1] = self.episode.terminated
        return flags

    @property
    def truncations(self) -> np.ndarray:
        """bool [n]: whether the episode's time was over after this step."""
        flags = np.zeros(len(self.actions), dtype=bool)
        flags[-1] = len(self.actions) >= self.episode.horizon
        return flags


class _Recorder(gym.Wrapper):
    """Keeps every observation, action and info; actions go on as float32, so that what is kept is what was done."""

    def reset(self, **arguments: Any) -> tuple[np.ndarray, dict[str, float]]:
        observation, info = super().reset(**arguments)
        self.names = tuple(info)
        self.observations, self.infos = [observation], [list(info.values())]
        self.actions: list[np.ndarray] = []
        return observation, info

    def step(self, action: np.ndarray) -> Any:
        action = np.asarray(action, dtype=np.float32)
        result = super().step(action)
        self.actions.append(action)
        self.observations.append(result[0])
        self.infos.append(list(result[4].values()))
        return result


class RandomActor:
    """Actions drawn uniformly from [-1, 1], anew for every seed of an episode."""

    def start(self, env: Any) -> None:
        self._rng = np.random.default_rng([env.np_random_seed, RANDOM_STREAM])

    def act(self, observation: np.ndarray, t: float) -> np.ndarray:
        return self._rng.uniform(-1.0, 1.0, 1).astype(np.float32)


def random_entrant() -> Entrant:
    """The random policy, for every environment and observation level."""
    return Entrant("random", "model-free", lambda setup: RandomActor(), lambda env_id, setup: {}, "--random")


def record(
    env: gym.Env, entrant: Entrant, seeds: Iterable[int], progress: Callable[[int], None] | None = None
) -> list[Trace]:
    """One `Trace` for each seed, in ``env``, made with what the entrant needs; ``progress`` gets the number done.

    Raises ConfigurationError where the entrant answers with a number that is not finite: that is no data.
    """
    watched = _Recorder(env)
    actor = entrant.make(core_of(env).setup)
    traces = []
    for seed in seeds:
        episode = run_episode(watched, actor, seed, settings={"controller": entrant.title})
        if len(watched.actions) < len(episode.time):
            raise ConfigurationError(
                f"'{entrant.title}' answered with a number that is not finite at {episode.time[-1]:g} s "
                f"of seed {seed}; nothing is exported"
            )
        infos = dict(zip(watched.names, np.array(watched.infos, dtype=float).T.copy(), strict=True))
        traces.append(
            Trace(
                seed,
                episode,
                np.array(watched.observations),
                np.array(watched.actions).reshape(-1, 1),
                infos,
                dict(core_of(env).true_rig),
            )
        )
        if progress is not None:
            progress(len(traces))
    return traces


def measured(env: gym.Env, trace: Trace) -> dict[str, np.ndarray]:
    """What a full set of sensors read in an episode: SI arrays [n + 1] by signal, with noise and delay as simulated.

    ``env`` is the environment of the trace made anew with ``observe="full"``. The actions are taken again from the same
    seed; every info must come out the same to the bit (RuntimeError otherwise), so the sensors saw the same episode.
    """
    core: Any = env.unwrapped
    observation, info = env.reset(seed=trace.seed)
    rows, infos = [observation], [list(info.values())]
    for action in trace.actions:
        observation, _, _, _, info = env.step(action)
        rows.append(observation)
        infos.append(list(info.values()))
    again = np.array(infos, dtype=float).T
    if not all(np.array_equal(a, b, equal_nan=True) for a, b in zip(again, trace.infos.values(), strict=True)):
        raise RuntimeError(f"the episode of seed {trace.seed} did not repeat: its export would not be what happened")
    table = np.array(rows, dtype=float)
    return {c.name: table[:, k] * c.scale for k, c in enumerate(core.channels)}
