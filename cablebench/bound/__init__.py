"""Upper bound of what a controller can reach: the commands of an episode found off-line, with its true rig.

>>> from cablebench.bound import upper_bound
>>> found = upper_bound("cable_envs/CableHole-Position-Sine-v0", seeds=[2000000], options={"duration": 1.0}, rounds=2)
>>> found[0].rmse < found[0].starts["oracle"]
True
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np

from cable_envs.core.errors import ConfigurationError
from cable_envs.sim.registered import setup_of
from cable_envs.sim.setup import Setup
from cable_envs.sim.tasks import action_of
from cablebench.bound.candidates import laws, oracles, staying
from cablebench.bound.motion import Plants
from cablebench.bound.search import Found, improve
from cablebench.entrants.entrant import IDEAL, Entrant, controller_entrant
from cablebench.protocol.episode import Episode
from cablebench.protocol.metrics import priced_rmse, rmse
from cablebench.run.evaluation import core_of, run_episode

STARTS = ("oracle", "adaptive-inverse", "lqg", "virtual-jaw")
"""Controllers from whose commands a search may begin, the oracle first. On tasks of suite v1: oracles of three sizes of
their gains, with ideal sensors, a drive that stays, and `cablebench.bound.candidates.LAWS` with the level's sensors."""

ROOM = 2.5e8
"""Bytes that the slopes of all steps may take: episodes are searched in groups."""


@dataclass(frozen=True)
class Bound:
    """What the best commands found lead to in one episode.

    Attributes
    ----------
    seed : int
        Of the episode.
    rmse : float
        The error that the episode is scored by, SI: the root of the mean squared error, on tasks of suite v1 that of
        the priced error after the homing.
    off : float
        Share of ``rmse`` that the slopes at the end of the search still promise: how far it may be above the least
        error near these commands. A search that goes down from a few starts proves no least error of all.
    spread : float
        By what share the second best start ended above the best one: 0 where both found the same.
    starts : mapping of str to float
        Errors of the controllers that it began from, without sensor noise, SI; infinite where an episode failed.
    overload : float
        Share of the control steps in which a tension was beyond the rig's limit.
    command : ndarray, shape (steps,)
        The commands, SI.
    """

    seed: int
    rmse: float
    off: float
    spread: float
    starts: Mapping[str, float]
    overload: float
    command: np.ndarray


def upper_bound(
    env_id: str,
    seeds: Sequence[int],
    options: Mapping[str, Any] | None = None,
    reset: Mapping[str, Any] | None = None,
    starts: int = 2,
    rounds: int = 12,
    least: float = 0.01,
) -> list[Bound]:
    """The least error that was found for episodes, with the true rig, the whole reference and the limits of the drive.

    Commands keep the rig's tension limit, as those of every reference controller. The search of
    `cablebench.bound.search` begins from the commands of the oracle and of the best other controllers. A single step is
    not known before it comes: the commands up to it stay as they were. Other references are known from the beginning,
    so that the bound of random steps, which it sees coming, lies below what any controller can do.

    Parameters
    ----------
    env_id : str
        Registered id of the environment, namespace and version included.
    seeds : sequence of int
        Of the resets; each decides the rig of an episode.
    options : mapping, optional
        Of the environment, as ``{"randomize": True}`` or ``{"split": "test"}``. Sensors, their noise and their delay
        do not matter.
    reset : mapping, optional
        Options of the resets, as ``{"reference": {...}}``.
    starts : int
        Controllers to begin from.
    rounds : int
        Most rounds of the search.
    least : float
        Fall of the mean squared error in a round, as a share, below which it ends.

    Returns
    -------
    list of Bound
        One for each seed.

    Raises
    ------
    ConfigurationError
        For unknown environments and options, and where no controller to begin from ends an episode.
    """
    setup, states, began = _beginnings(env_id, seeds, dict(options or {}), dict(reset or {}))
    signal = {**setup.reference, **((reset or {}).get("reference") or {})}
    first = round(signal.get("start", 0.0) / setup.control_period) if signal.get("kind") == "step" else 0
    chosen = []  # for each episode the names of the best beginnings
    for k, seed in enumerate(seeds):
        able = [name for name, (errors, _) in began.items() if np.isfinite(errors[k])]
        if not able:
            raise ConfigurationError(f"{env_id}, seed {seed}: no controller to begin from ends the episode")
        chosen.append(sorted(able, key=lambda name: began[name][0][k])[:starts])
    bounds: list[Bound] = []
    most = _together(states[0], setup, _asked(began[chosen[0][0]][1][0], setup)) // starts
    for group in range(0, len(seeds), max(most, 1)):
        mine = range(group, min(group + max(most, 1), len(seeds)))
        runs = [(k, name) for k in mine for name in chosen[k]]
        plants = Plants([states[k] for k, _ in runs], setup)
        actions = np.stack([_asked(began[name][1][k], setup) for k, name in runs], axis=1)
        found = improve(plants, actions, _limits(setup), rounds, least, first)
        overloads = plants.overload(found.actions)
        for k in mine:
            told = {name: float(errors[k]) for name, (errors, _) in began.items()}
            ends = [j for j, (episode, _) in enumerate(runs) if episode == k]
            bounds.append(_bound(int(seeds[k]), setup, found, ends, overloads, told))
    return bounds


def _bound(
    seed: int, setup: Setup, found: Found, ends: Sequence[int], overloads: np.ndarray, told: Mapping[str, float]
) -> Bound:
    """The best of the ends of one episode's searches."""
    best, *others = sorted(ends, key=lambda j: found.cost[j])
    rmse = float(np.sqrt(found.cost[best]))
    spread = float(np.sqrt(found.cost[others[0]])) / max(rmse, 1e-300) - 1.0 if others else 0.0
    promised = 1.0 - float(np.sqrt(max(1.0 - found.promised[best], 0.0)))
    command = setup.low + 0.5 * (found.actions[:, best] + 1.0) * (setup.high - setup.low)
    return Bound(seed, rmse, promised, spread, told, float(overloads[best]), command)


def _together(state: Mapping[str, Any], setup: Setup, actions: np.ndarray) -> int:
    """How many searches fit into `ROOM`, by the states that reach the output."""
    one = Plants([state], setup)
    _, _, blocks = one.follow(lambda k, _: actions[k : k + 1], 1, keep=True)
    one.relevant(blocks)
    n, rows = len(one.rows), blocks.shape[1]
    return int(ROOM // (8 * setup.steps * (n * n + 8 * n + rows)))


def _beginnings(env_id: str, seeds: Sequence[int], options: dict[str, Any], reset: dict[str, Any]) -> Any:
    """(setup, states after the resets, {controller: (error, commands) of each episode})."""
    of_suite = setup_of(env_id, options).conditions is not None
    quiet = {**options, **(IDEAL if of_suite else {"sensor_noise": False}), "observe": "full"}
    setup_of(env_id, quiet)  # refuses what does not fit
    if of_suite:
        entrants = [*oracles(env_id, quiet), staying()]
        own = laws(env_id, options)
    else:
        entrants = [e for e in map(controller_entrant, STARTS) if e.enters(env_id, {**options, "sensor_noise": False})]
        own = ()
    with gym.make(env_id, disable_env_checker=True, **quiet) as env:
        setup, states = core_of(env).setup, []
        for seed in seeds:
            env.reset(seed=int(seed), options=reset or None)
            states.append(core_of(env).simulation.state())
        began = {entrant.name: _played(env, entrant, seeds, reset) for entrant in entrants}
    for entrant, seen in own:  # sensors do not change what is drawn, nor what commands do
        with gym.make(env_id, disable_env_checker=True, **seen) as env:
            began[entrant.name] = _played(env, entrant, seeds, reset)
    return setup, states, began


def _played(
    env: gym.Env, entrant: Entrant, seeds: Sequence[int], reset: Mapping[str, Any]
) -> tuple[list[float], list[np.ndarray]]:
    """Error and commands of an entrant in each episode; the error is infinite where the episode ended early."""
    actor = entrant.make(core_of(env).setup)
    episodes = [run_episode(env, actor, int(seed), reset or None) for seed in seeds]
    return [_error(e) if e.complete else math.inf for e in episodes], [e.command for e in episodes]


def _error(episode: Episode) -> float:
    """What the episode is scored by."""
    priced = priced_rmse(episode)
    return rmse(episode) if math.isnan(priced) else priced


def _limits(setup: Setup) -> tuple[float, float]:
    """Actions of the lowest and of the highest command that keep the rig's tension limit."""
    if setup.action_mode.unit != "N":
        return -1.0, 1.0
    most = min(setup.high, setup.rig.values["tension_limit"])
    return -1.0, float(action_of(np.array(most), setup.low, setup.high))


def _asked(command: np.ndarray, setup: Setup) -> np.ndarray:
    """The actions that were asked for, from the commands that acted: those are late by the action delay."""
    late = setup.action_delay
    action = action_of(command, setup.low, setup.high)
    return np.append(action[late:], np.full(late, action[-1:]))
