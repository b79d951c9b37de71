"""Running entrants over a protocol's episodes: every entrant sees the same episodes, every episode becomes one record.

A reference controller gets the SI measurements decoded from the observation, so it sees the same noise and delay as an
agent, and answers with an SI command that is mapped to the action. Only an oracle uses the true rig it is handed.
"""

import json
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, cast

import gymnasium as gym
import numpy as np

from cable_envs.core.errors import ConfigurationError
from cablebench.entrants.entrant import Entrant
from cablebench.protocol.actors import Actor
from cablebench.protocol.episode import Episode
from cablebench.protocol.protocol import Cell, Protocol
from cablebench.run.records import badness, facts, known_seeds, make_record, run_key, typical
from cablebench.run.store import ResultStore

if TYPE_CHECKING:
    from cable_envs.envs import CableEnv

_NOT_SIGNALS = ("time", "reference", "output", "error", "command")


@dataclass(frozen=True)
class Progress:
    """How far an evaluation is: episodes done and to do, and what is running."""

    done: int
    total: int
    text: str


def core_of(env: gym.Env) -> "CableEnv":
    """The environment within its wrappers, with its setup and true rig."""
    return cast("CableEnv", env.unwrapped)


def env_id_of(env: gym.Env) -> str:
    """The id that the environment was made by."""
    assert env.spec is not None, "an environment that was not made by gymnasium.make"
    return env.spec.id


def run_episode(
    env: gym.Env,
    actor: Actor,
    seed: int,
    options: Mapping[str, Any] | None = None,
    settings: Mapping[str, Any] | None = None,
) -> Episode:
    """One episode, as arrays.

    Parameters
    ----------
    env : gymnasium.Env
        One of `cable_envs`, wrapped or not.
    actor : Actor
        What decides. One that answers with a number that is not finite ends the episode as failed, like a torn cable.
    seed : int
        Of the reset; it decides rig, noise and initial state where these are drawn.
    options : mapping, optional
        Options of the reset: rig, reference, initial_state.
    settings : mapping, optional
        Further facts to keep in `Episode.settings`; JSON types.

    Returns
    -------
    Episode
        SI, one sample for each control step.

    Examples
    --------
    >>> import cable_envs
    >>> from cablebench.entrants.entrant import controller_entrant
    >>> env = gym.make("cable_envs/CableHole-Position-Step-v0", duration=1.0)
    >>> episode = run_episode(env, controller_entrant("pid").make(env.unwrapped.setup), seed=0)
    >>> len(episode.time), episode.output_unit, episode.complete
    (100, 'm', True)
    """
    core = core_of(env)
    setup = core.setup
    observation, info = env.reset(seed=seed, options=dict(options) if options else None)
    names, rows, rewards, spent = tuple(info), [], [], []
    actor.start(core)
    terminated = truncated = False
    while not (terminated or truncated):
        before = time.perf_counter()
        action = actor.act(observation, info["time"])
        spent.append(time.perf_counter() - before)
        if not np.all(np.isfinite(action)):
            terminated = True
            rewards.append(0.0)
            rows.append(list(info.values()))
            break
        observation, reward, terminated, truncated, info = env.step(action)
        rewards.append(float(reward))
        rows.append(list(info.values()))
    arrays = dict(zip(names, np.array(rows, float).T, strict=True))
    reference = (options or {}).get("reference") or setup.reference
    return Episode(
        **{name: arrays[name] for name in ("time", "reference", "output", "command")},
        reward=np.array(rewards, float),
        inference=np.array(spent),
        signals={n: v for n, v in arrays.items() if n not in _NOT_SIGNALS},
        terminated=bool(terminated),
        dt=setup.control_period,
        horizon=setup.steps,
        output_unit=setup.output_unit,
        command_unit=setup.action_mode.unit,
        step_time=float(reference.get("start", 0.0)) if reference.get("kind") == "step" else None,
        success_error=float(setup.task.success_error),
        homing=float(setup.task.homing),
        settings={"seed": seed, "rig": setup.rig.name, "action_mode": setup.action_mode.name,
                  "env_id": env.spec.id if env.spec else "", **(settings or {})},
    )  # fmt: skip


def evaluate(
    protocol: Protocol,
    entrants: Sequence[Entrant],
    tasks: Sequence[str] = (),
    tracks: Sequence[str] = (),
    store: ResultStore | None = None,
    progress: Callable[[Progress], None] | None = None,
    resume: bool = False,
) -> list[dict[str, Any]]:
    """Run every entrant on every condition that it enters.

    Parameters
    ----------
    protocol : Protocol
        Decides the episodes.
    entrants : sequence of Entrant
        All see the same episodes.
    tasks, tracks : sequence of str
        Names; empty means all tasks and the protocol's own choice of tracks.
    store : ResultStore, optional
        Gets each record as soon as its episode has ended, and the trajectories of each run's median and worst episode
        before the record that makes the run whole.
    progress : callable, optional
        Called with a `Progress` before each episode and once at the end.
    resume : bool
        Whether runs that the store holds whole (same configuration, same source) are left out. One that was stopped
        half-way is run anew, and its newer records count.

    Returns
    -------
    list of dict
        The new records, one for each episode.

    Raises
    ------
    ConfigurationError
        For unknown names, and where an entrant enters none of the chosen conditions.
    """
    plan = make_plan(protocol, entrants, tasks, tracks)
    known = known_seeds(store) if store is not None and resume else {}
    total, done, records = sum(cell.episodes for cell, _, _ in plan), 0, []
    with _Environments() as environments:
        for cell, entrant, options in plan:
            run = run_key(protocol, cell, entrant, options)
            seeds = protocol.seeds(cell.episodes)
            if known.get(run, set()) >= set(seeds):
                done += len(seeds)
                continue
            env = environments.get(cell.task.env, options)
            setup = core_of(env).setup
            actor = entrant.make(setup)
            kept: list[tuple[float, Episode]] = []
            for seed in seeds:
                if progress is not None:
                    progress(Progress(done, total, f"{entrant.title} on {cell.key}"))
                done += 1
                episode = run_episode(env, actor, seed, cell.reset_options(setup))
                record = make_record(protocol, cell, entrant, options, run, seed, facts(episode))
                records.append(record)
                kept.append((badness(record), episode))
                if store is None:
                    continue
                if seed == seeds[-1]:  # with the last record the run is whole, and a resumed evaluation leaves it out
                    store.trajectories.keep(run, typical(kept))
                store.append(record)
    if progress is not None:
        progress(Progress(total, total, "done"))
    return records


def make_plan(
    protocol: Protocol, entrants: Sequence[Entrant], tasks: Sequence[str], tracks: Sequence[str]
) -> list[tuple[Cell, Entrant, dict[str, Any]]]:
    """What an evaluation has to run.

    Parameters
    ----------
    protocol, entrants, tasks, tracks
        As of `evaluate`.

    Returns
    -------
    list of (Cell, Entrant, dict)
        Condition, entrant, and the options of the environment.

    Raises
    ------
    ConfigurationError
        As `evaluate`.
    """
    cells = protocol.cells(tuple(tasks), tuple(tracks))
    plan = []
    for cell in cells:
        for entrant in entrants:
            options = entrant.enters(cell.task.env, cell.environment_options())
            if options is not None:
                plan.append((cell, entrant, options))
    for entrant in entrants:
        if not any(e is entrant for _, e, _ in plan):
            ids = ", ".join(dict.fromkeys(c.task.env for c in cells))
            raise ConfigurationError(f"'{entrant.title}' enters none of the chosen tasks: {ids}")
    return plan


class _Environments:
    """One environment object for each id and set of options, closed together."""

    def __enter__(self) -> "_Environments":
        self._made: dict[str, gym.Env] = {}
        return self

    def __exit__(self, *_: object) -> None:
        for env in self._made.values():
            env.close()

    def get(self, env_id: str, options: Mapping[str, Any]) -> gym.Env:
        key = json.dumps([env_id, options], sort_keys=True, default=str)
        if key not in self._made:
            self._made[key] = gym.make(env_id, disable_env_checker=True, **options)
        return self._made[key]
