"""The evaluation of `cablebench.run.evaluation` as jobs: one for each entrant on each condition, the same numbers.

Every episode is seeded by itself, so it does not matter which process runs it. An `Entrant` holds closures and cannot
travel; a recipe does: a picklable call without arguments that makes the entrant again in the worker. Records are made
and stored by the caller alone, whole runs at a time, in the order in which they end.
"""

from collections.abc import Callable, Sequence
from contextlib import closing
from functools import lru_cache
from typing import Any

import gymnasium as gym
import numpy as np

from cablebench.entrants.entrant import Entrant
from cablebench.jobs import Backend, Context, Job
from cablebench.jobs import Progress as JobProgress
from cablebench.protocol.episode import Episode
from cablebench.protocol.protocol import Cell, Protocol
from cablebench.run.evaluation import Progress, core_of, make_plan, run_episode
from cablebench.run.records import badness, facts, known_seeds, make_record, run_key, typical
from cablebench.run.store import ResultStore

Recipe = Callable[[], Entrant]
"""Picklable and hashable: a `functools.partial` of a module-level function, or a frozen dataclass."""


def evaluate_in_jobs(
    protocol: Protocol,
    recipes: Sequence[Recipe],
    backend: Backend,
    tasks: Sequence[str] = (),
    tracks: Sequence[str] = (),
    store: ResultStore | None = None,
    progress: Callable[[Progress], None] | None = None,
    resume: bool = False,
) -> list[dict[str, Any]]:
    """The same as `cablebench.run.evaluate`, in several processes.

    Parameters
    ----------
    protocol, tasks, tracks, store, progress, resume
        As of `evaluate`.
    recipes : sequence of Recipe
        Make the entrants, here and in the workers.
    backend : Backend
        Runs one job for each entrant on each condition.

    Returns
    -------
    list of dict
        The new records, in the order of `evaluate`.

    Raises
    ------
    ConfigurationError
        As `evaluate`.
    KeyboardInterrupt
        After Ctrl-C; the store then holds the runs that were finished.
    """
    entrants = [recipe() for recipe in recipes]
    plan = make_plan(protocol, entrants, tasks, tracks)
    known = known_seeds(store) if store is not None and resume else {}
    total = sum(cell.episodes for cell, _, _ in plan)
    jobs, about = [], {}
    for cell, entrant, options in plan:
        run, seeds = run_key(protocol, cell, entrant, options), protocol.seeds(cell.episodes)
        if run not in about and not known.get(run, set()) >= set(seeds):
            recipe = recipes[next(i for i, e in enumerate(entrants) if e is entrant)]
            jobs.append(Job(run, run_cell, {"recipe": recipe, "cell": cell, "options": options, "seeds": seeds}))
            about[run] = (cell, entrant, options)
    running: dict[str, int] = {}
    finished = total - sum(cell.episodes for cell, _, _ in about.values())

    def report(p: JobProgress) -> None:
        running[p.key] = p.done
        if progress is not None:
            progress(Progress(finished + sum(running.values()), total, p.text))

    found: dict[str, list[dict[str, Any]]] = {}
    with closing(backend.run(jobs, report)) as ended:
        for done in ended:
            if done.stopped:
                continue
            run = done.job.key
            episodes, trajectories = done.value()
            found[run] = [make_record(protocol, *about[run], run, seed, seen) for seed, seen in episodes]
            if store is not None:
                store.trajectories.keep(run, trajectories)  # first: with its records a run counts as done
                store.append(found[run])
            running.pop(run, None)
            finished += len(episodes)
            report(JobProgress(run, 0, 0, f"{about[run][1].title} on {about[run][0].key}"))
    if progress is not None:
        progress(Progress(total, total, "done"))
    return [record for job in jobs for record in found[job.key]]


def run_cell(
    context: Context, recipe: Recipe, cell: Cell, options: dict[str, Any], seeds: Sequence[int]
) -> tuple[list[tuple[int, dict[str, Any]]], dict[str, dict[str, np.ndarray]]]:
    """Body of a job: ([(seed, facts)], trajectories of the median and the worst episode)."""
    entrant = _entrant(recipe)
    env = gym.make(cell.task.env, disable_env_checker=True, **options)
    try:
        setup = core_of(env).setup
        actor = entrant.make(setup)
        found: list[tuple[int, dict[str, Any]]] = []
        kept: list[tuple[float, Episode]] = []
        for seed in seeds:
            context.report(len(found), len(seeds), f"{entrant.title} on {cell.key}")
            episode = run_episode(env, actor, seed, cell.reset_options(setup))
            found.append((seed, facts(episode)))
            kept.append((badness(found[-1][1]), episode))
    finally:
        env.close()
    return found, typical(kept)


@lru_cache(maxsize=8)
def _entrant(recipe: Recipe) -> Entrant:
    """The same entrant runs many conditions; a worker makes it once (loading a policy takes 50 ms and more)."""
    return recipe()
