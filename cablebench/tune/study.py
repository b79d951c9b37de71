"""Tuning by trials: Optuna's tree-structured Parzen estimator over jobs, kept in an SQLite file.

Trials are asked for in batches: a batch is chosen from what was known before it, run, and told. So the numbers depend
on the seed and the batch size, and not on how many workers there are, where they run or which ends first. The sampler
of each trial is seeded by its number, so a study that was stopped and resumed has the same trials as one that was not:
finished ones are kept, and what a killed process left unfinished is run again under its own number.
"""

import json
import sqlite3
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import optuna
import sqlalchemy
from filelock import FileLock, Timeout
from optuna.trial import FrozenTrial, TrialState

from cable_envs.core.errors import ConfigurationError
from cable_envs.core.files import CannotWrite, require_writable
from cablebench.jobs import Backend, Done, Job, Progress
from cablebench.tune.space import Dimension

ABOUT = "about"
"""User attribute of a study: what decides its trials' numbers."""

STATES = {TrialState.COMPLETE: "complete", TrialState.FAIL: "failed", TrialState.RUNNING: "unfinished"}


@dataclass(frozen=True)
class Trial:
    """One point that was tried."""

    number: int
    values: Mapping[str, Any]
    loss: float | None
    """None where it has not been finished, or failed"""
    state: str
    """complete | failed | unfinished"""


@dataclass(frozen=True)
class Search:
    """One optimisation: where to look, from where, and how a point becomes a job whose result is its loss."""

    name: str
    """of the study in its file"""
    space: Sequence[Dimension]
    start: Mapping[str, Any]
    """the point that is tried first"""
    job: Callable[[int, Mapping[str, Any]], Job]
    """(trial's number, values) -> job"""
    about: Mapping[str, Any]
    """what else decides the numbers; a study that was begun with another is not gone on with"""
    seed: int = 0
    batch: int = 4

    def values(self, coordinates: Mapping[str, Any]) -> dict[str, Any]:
        """What is tried at a point."""
        return {d.name: d.value(coordinates[d.name]) for d in self.space}


def tune(
    file: Path,
    search: Search,
    trials: int,
    backend: Backend,
    progress: Callable[[int, int, str], None] | None = None,
    remark: Callable[[str], None] | None = None,
) -> list[Trial]:
    """Go on with the study in ``file`` until it has ``trials`` trials; all of them, by number.

    ``progress`` hears (trials ended, trials, text). A job that fails is a failed trial: it counts, and ``remark`` hears
    why; ConfigurationError is raised, as is KeyboardInterrupt after Ctrl-C, once the trials that ended are kept.
    Raises ConfigurationError where the file is no study, belongs to another search or is in use.
    """
    with _locked(file), _study(file, search) as study:
        while pending := _next_batch(study, search, trials):
            jobs = {}
            for number, coordinates in pending.items():
                job = search.job(number, search.values(coordinates))
                jobs[job.key] = (number, job)

            def report(p: Progress, study: Any = study) -> None:
                if progress is not None:
                    progress(_ended(study), trials, p.text)

            with closing(backend.run([job for _, job in jobs.values()], report)) as runs:
                for done in runs:
                    if done.stopped:
                        continue
                    _tell(study, jobs[done.job.key][0], done, remark)
                    if progress is not None:
                        progress(_ended(study), trials, f"best {best_loss(study):.4f}")
        return _trials(study, search)


def _tell(study: Any, number: int, done: Done, remark: Callable[[str], None] | None) -> None:
    if isinstance(done.error, ConfigurationError):
        raise done.error
    if done.error is not None:
        study.tell(number, state=TrialState.FAIL)
        if remark is not None:
            remark(f"trial {number} failed: {done.error}")
    else:
        study.tell(number, float(done.result))


def read_trials(file: Path, search: Search) -> list[Trial]:
    """The trials in a file so far."""
    with _study(file, search) as study:
        return _trials(study, search)


def best(trials: Sequence[Trial]) -> Trial:
    """The trial with the least loss, the first of equals; ConfigurationError where none was finished."""
    complete = [t for t in trials if t.loss is not None]
    if not complete:
        raise ConfigurationError(f"none of {len(trials)} trials was finished: there is nothing to choose from")
    return min(complete, key=lambda t: (t.loss, t.number))


def best_loss(study: Any) -> float:
    """The least loss so far; infinite where none is known."""
    return min((t.value for t in study.get_trials(False, (TrialState.COMPLETE,))), default=float("inf"))


def _next_batch(study: Any, search: Search, trials: int) -> dict[int, Mapping[str, Any]]:
    """{number: coordinates} of what is to be run next: unfinished trials of an earlier process, or new ones."""
    asked = study.get_trials(deepcopy=False, states=tuple(STATES))
    pending = {t.number: t.params for t in asked if t.state == TrialState.RUNNING}
    first = len(asked)
    last = first if pending and first % search.batch == 0 else (first // search.batch + 1) * search.batch
    distributions = {d.name: d.distribution() for d in search.space}
    for number in range(first, min(last, trials)):
        chosen = _chosen(study, search, number, distributions)
        study.add_trial(chosen)
        pending[number] = chosen.params
    return pending


def _chosen(study: Any, search: Search, number: int, distributions: Mapping[str, Any]) -> FrozenTrial:
    """The trial of that number, unfinished, to be added to the study whole.

    Optuna's ``ask`` adds an empty trial and then one coordinate after the other; a process that is killed in between
    would leave half a trial, and the rest could not be drawn again as it would have been. So it asks a copy in memory.
    """
    # multivariate: gains depend on each other; the liar takes unfinished trials for bad, so a batch spreads
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)
        sampler = optuna.samplers.TPESampler(
            seed=1_000_003 * search.seed + number, multivariate=True, constant_liar=True
        )
    copy = optuna.create_study(sampler=sampler)
    copy.add_trials(study.get_trials(deepcopy=False))
    if number == 0:
        copy.enqueue_trial({d.name: d.coordinate(search.start[d.name]) for d in search.space})
    asked = copy.ask(dict(distributions))
    attributes = copy.trials[number].system_attrs
    return optuna.trial.create_trial(
        state=TrialState.RUNNING, params=asked.params, distributions=dict(distributions), system_attrs=attributes
    )


def _ended(study: Any) -> int:
    return len(study.get_trials(deepcopy=False, states=(TrialState.COMPLETE, TrialState.FAIL)))


def _trials(study: Any, search: Search) -> list[Trial]:
    return [
        Trial(t.number, search.values(t.params), t.value, STATES[t.state])
        for t in study.get_trials(deepcopy=False, states=tuple(STATES))
        if len(t.params) == len(search.space)
    ]


@contextmanager
def _study(file: Path, search: Search) -> Iterator[Any]:
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    about = json.loads(json.dumps({**search.about, "seed": search.seed, "batch": search.batch,
                                   "space": [repr(d) for d in search.space]}))  # fmt: skip
    try:
        storage = optuna.storages.RDBStorage(f"sqlite:///{file}")
    except (sqlalchemy.exc.DatabaseError, RuntimeError) as error:
        _require_space(file, error)
        raise ConfigurationError(f"{file} is no study of `cablebench tune`: {str(error).splitlines()[0]}") from error
    try:
        study = optuna.create_study(storage=storage, study_name=search.name, load_if_exists=True)
        begun = study.user_attrs.get(ABOUT)
        if begun is None:
            study.set_user_attr(ABOUT, about)
        elif begun != about:
            other = [k for k in {**begun, **about} if begun.get(k) != about.get(k)]
            was = "; ".join(f"{k}: {_short(begun.get(k))}, not {_short(about.get(k))}" for k in other)
            raise ConfigurationError(
                f"'{search.name}' in {file} was begun with other settings ({was}): choose another file"
            )
        yield study
    except (sqlalchemy.exc.SQLAlchemyError, optuna.exceptions.StorageInternalError) as error:
        _require_space(file, error)
        raise
    finally:
        storage.engine.dispose()


WRITING = ("full", "I/O error", "readonly", "unable to open")
"""Words of SQLite's errors that are the disk's and not the file's."""


def _require_space(file: Path, error: Exception) -> None:
    """ConfigurationError that names file and reason where an error of SQLite came from writing."""
    said: BaseException | None = error
    while said is not None and not isinstance(said, sqlite3.Error):
        said = getattr(said, "orig", None) or said.__cause__
    if said is not None and any(word in str(said) for word in WRITING):
        kept = "; trials that ended before are kept" if file.stat().st_size else ""
        raise ConfigurationError(f"cannot write {file}: {said}{kept}") from None


def _short(value: Any) -> str:
    text = str(value)
    return text if len(text) < 40 else f"{text[:37]}..."


@contextmanager
def _locked(file: Path) -> Iterator[None]:
    """Hold the file for this process: two that go on with the same study would run the same trials."""
    require_writable(file.parent)
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        file.touch()
    except OSError as error:
        raise CannotWrite.of(file, error) from None
    lock = FileLock(f"{file}.lock", timeout=0)
    try:
        lock.acquire()
    except Timeout:
        raise ConfigurationError(f"{file} is in use by another `cablebench tune`") from None
    try:
        yield
    finally:
        lock.release()
