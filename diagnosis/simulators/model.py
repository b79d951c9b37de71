"""Records of a user's simulator as a `Model`."""

import pickle
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from itertools import pairwise
from multiprocessing import get_context
from typing import Any

import numpy as np

from cable_envs.core.errors import ConfigurationError
from cable_envs.diagnosis.model.model import Block, Free
from cable_envs.diagnosis.model.noise import jitter
from cable_envs.diagnosis.simulators.base import Simulator
from cable_envs.diagnosis.simulators.motion import FIRST, Course, moved
from cable_envs.diagnosis.simulators.signals import shown


@dataclass(frozen=True)
class Start:
    """An output at the start of a record, as its sensor shows it.

    Parameters
    ----------
    value : float
        SI.
    channel : str
        Which channel showed it, or of which it is the slope; empty: none, and the value is the simulator's or 0.
    slope : bool
        Whether it is the slope of that channel.
    step : float
        About its standard error, by which its effect on all channels is measured; 0: the value is known.
    """

    value: float
    channel: str = ""
    slope: bool = False
    step: float = 0.0

    def true(self, values: Mapping[str, np.ndarray]) -> Any:
        """The output itself, where the channel's sensor has a scale or a bias [n]."""
        if not self.channel:
            return self.value
        bias = 0.0 if self.slope else values.get(f"sensor_bias.{self.channel}", 0.0)
        return (self.value - bias) / values.get(f"sensor_scale.{self.channel}", 1.0)


@dataclass(frozen=True)
class Run:
    """One record: its course, its start, and what to compare.

    offset: channels whose zero means nothing in this record.
    """

    course: Course
    starts: Mapping[str, Start]
    blocks: tuple[Block, ...]
    offset: tuple[str, ...] = ()


class PortedModel:
    """See `cable_envs.diagnosis.model.model.Model`.

    Parameters
    ----------
    simulator : Simulator
        What is run.
    runs : sequence of Run
        The records.
    base : mapping of str to float
        Every parameter of the simulator and every row of effects.
    parameters : sequence of Free
        Those that columns may change.
    every : int
        Steps of the simulator between samples.
    small : mapping of str to float
        As of `cable_envs.diagnosis.simulators.motion.steps_of`.
    held : bool
        Whether a command jumps.
    """

    def __init__(
        self, simulator: Simulator, runs: Sequence[Run], base: Mapping[str, float], parameters: Sequence[Free],
        every: int, small: Mapping[str, float], held: bool,
    ):  # fmt: skip
        self.parameters = tuple(parameters)
        self.blocks: list[Block] = [block for run in runs for block in run.blocks]
        self.resolved = simulator.declaration.period if held else 0.0
        self._core = _Core(simulator, tuple(runs), dict(base), tuple(p.name for p in parameters), every, dict(small))
        self._pool: ProcessPoolExecutor | None = None
        self._workers = simulator.workers
        if self._workers > 1:
            _require_shared(self._core)
        self._open = [[name for name, start in run.starts.items() if start.step > 0.0] for run in runs]
        """outputs of which it is not known where each record begins"""

    def predict(self, values: np.ndarray) -> list[np.ndarray]:
        """Predictions [T, n] of every block for parameter columns [len(parameters), n]; NaN where a trial failed.

        Where a record begins is solved for, from what a small change of it does in each column.
        """
        count, most = values.shape[1], max(map(len, self._open))
        by = []
        for run, names in zip(self._core.runs, self._open, strict=True):
            shifts = {name: np.zeros((1 + most, count)) for name in names}
            for k, name in enumerate(names):
                shifts[name][1 + k] = run.starts[name].step
            by.append({name: shift.ravel() for name, shift in shifts.items()})
        seen = self._seen(np.tile(values, 1 + most), by)
        found: list[np.ndarray] = []
        for run, names, whole in zip(self._core.runs, self._open, seen, strict=True):
            parts = whole.reshape(*whole.shape[:2], 1 + most, count)
            steps = np.array([run.starts[name].step for name in names])
            changes = parts[:, :, 1 : 1 + len(names)] - parts[:, :, :1]
            out = _settled(run, changes / steps[:, None], parts[:, :, 0])
            found += [out[:, j] for j in range(out.shape[1])]
        return found

    def _seen(self, values: np.ndarray, by: Sequence[Mapping[str, np.ndarray]]) -> list[np.ndarray]:
        """Signals [T, blocks, n] of every run; ``by``: of every run, output -> how far it begins elsewhere [n]."""
        if self._workers == 1 or values.shape[1] == 1:
            return self._core.seen(values, by)
        if self._pool is None:
            self._pool = ProcessPoolExecutor(
                self._workers, get_context("spawn"), initializer=_begin, initargs=(self._core,)
            )
        parts = np.array_split(np.arange(values.shape[1]), min(self._workers, values.shape[1]))
        jobs = [(values[:, part], [{n: c[part] for n, c in one.items()} for one in by]) for part in parts]
        found = list(self._pool.map(_job, jobs))
        return [np.concatenate([one[k] for one in found], axis=2) for k in range(len(by))]


def _settled(run: Run, responses: np.ndarray, out: np.ndarray) -> np.ndarray:
    """Signals [T, blocks, n] shifted by the constants that fit the record best, by the channels' noise.

    responses: what a constant changes [T, blocks, constants, n]; free zeros of channels come behind them.
    """
    offsets = [j for j, block in enumerate(run.blocks) if block.channel in run.offset]
    own = np.zeros((*out.shape[:2], len(offsets), out.shape[2]))
    for k, j in enumerate(offsets):
        own[:, j, k] = 1.0
    every = np.concatenate([responses, own], axis=2)
    if not every.shape[2]:
        return out
    weights = np.stack([b.good / jitter(b.measured[b.good], b.reading.as_one) ** 2 for b in run.blocks], axis=1)
    left = np.stack([b.measured for b in run.blocks], axis=1)[:, :, None] - out
    sound = np.isfinite(every).all(axis=(0, 1, 2)) & np.isfinite(left[weights > 0.0]).all(axis=0)
    every, found = np.where(sound, every, 0.0), out.copy()
    weighed = every * weights[:, :, None, None]
    matrix = np.einsum("tjkn,tjln->nkl", weighed, every, optimize=True)
    right = np.einsum("tjkn,tjn->nk", weighed, np.where(sound & (weights > 0.0)[:, :, None], left, 0.0), optimize=True)
    size = np.sqrt(np.maximum(np.einsum("nkk->nk", matrix), 1e-300))
    scaled = np.linalg.pinv(matrix / (size[:, :, None] * size[:, None]), hermitian=True)
    constants = np.einsum("nkl,nl->nk", scaled, right / size) / size
    return found + np.einsum("tjkn,nk->tjn", every, constants, optimize=True)


@dataclass(frozen=True)
class _Core:
    """What a process needs of a model to run it."""

    simulator: Simulator
    runs: tuple[Run, ...]
    base: dict[str, float]
    names: tuple[str, ...]
    every: int
    small: dict[str, float]

    def seen(self, values: np.ndarray, by: Sequence[Mapping[str, np.ndarray]]) -> list[np.ndarray]:
        """Signals [T, blocks, n] of every run for columns; ``by`` as of `PortedModel._seen`."""
        asked = [self._asked(run, values, shift) for run, shift in zip(self.runs, by, strict=True)]
        motions = [motion for motion, _, _ in asked]
        if self.simulator.together:
            course, columns = _joined([run.course for run in self.runs], motions)
            whole = moved(self.simulator, course, columns, self.small)
            ends = np.cumsum([0, *(_count(motion) for motion in motions)])
            outs = [{n: series[a:b] for n, series in whole.items()} for a, b in pairwise(ends)]
        else:
            outs = [
                moved(self.simulator, run.course, motion, self.small)
                for run, motion in zip(self.runs, motions, strict=True)
            ]
        found = []
        for run, out, (_, sensed, place) in zip(self.runs, outs, asked, strict=True):
            names = [block.channel for block in run.blocks]
            series = np.stack([out[n][:, : run.course.steps + 1].T for n in names], axis=1)[:, :, place]
            found.append(shown(names, series, sensed, self.simulator.declaration.period)[:: self.every])
        return found

    def _asked(self, run: Run, values: np.ndarray, by: Mapping[str, np.ndarray]) -> tuple[Any, Any, np.ndarray]:
        """(rows of the motion, without columns that only differ by their sensors; of the sensors; which each is)."""
        count = values.shape[1]
        rows = {name: np.full(count, value) for name, value in self.base.items()}
        rows |= dict(zip(self.names, values, strict=False))
        rows |= {name: np.full(count, value) for name, value in run.course.given.items()}
        for name, start in run.starts.items():
            rows[FIRST + name] = np.broadcast_to(start.true(rows) + by.get(name, 0.0), (count,))
        sensed = {name: row for name, row in rows.items() if name.startswith("sensor_") and "." in name}
        motion = {name: row for name, row in rows.items() if name not in sensed}
        # a sensor changes what is shown and not the motion, which is simulated once for all of them
        _, first, place = np.unique(np.stack(list(motion.values())), axis=1, return_index=True, return_inverse=True)
        return {name: row[first] for name, row in motion.items()}, sensed, place.ravel()


def _count(rows: Mapping[str, np.ndarray]) -> int:
    return len(next(iter(rows.values())))


def _joined(
    courses: Sequence[Course], rows: Sequence[Mapping[str, np.ndarray]]
) -> tuple[Course, dict[str, np.ndarray]]:
    """Runs as one of all their columns; short ones go on with their last command."""
    steps = max(course.steps for course in courses)
    commands = {
        name: np.concatenate([
            np.repeat(np.pad(course.commands[name], (0, steps - course.steps), mode="edge")[None], _count(own), axis=0)
            for course, own in zip(courses, rows, strict=True)
        ])
        for name in courses[0].commands
    }  # fmt: skip
    return Course(commands), {name: np.concatenate([own[name] for own in rows]) for name in rows[0]}


def _require_shared(core: _Core) -> None:
    try:
        pickle.dumps(core)
    except Exception as error:
        raise ConfigurationError(
            f"simulator '{core.simulator.declaration.name}' cannot be given to several workers ({error}): its "
            "functions must stand at the top of a file that can be imported"
        ) from error


_core: _Core | None = None
"""Of this process."""


def _begin(core: _Core) -> None:
    global _core
    _core = core


def _job(job: tuple[np.ndarray, Sequence[Mapping[str, np.ndarray]]]) -> list[np.ndarray]:
    assert _core is not None, "the process was begun with a model"
    return _core.seen(*job)
