"""Records of any plant as a `Model`: the drive's input goes through the kernel, every other channel is predicted.

What a record begins with is known to a constant only: where the load hung, what an encoder counts from. Such a
constant shifts channels by a known shape; how much is solved for in every prediction, from the record that is
predicted, held out or not: it is that record's initial condition.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from cable_envs.diagnosis.model.driven import Recorded
from cable_envs.diagnosis.model.model import Block, Free
from cable_envs.diagnosis.model.noise import jitter
from cable_envs.diagnosis.systems.common import HELD_STEPS, mean_over_samples
from cable_envs.diagnosis.systems.conditions import with_given
from cable_envs.plants.base import Plant
from cable_envs.sim.replay import distort
from cable_envs.sim.together import Asked, replay_together

FINE = 4
"""Parts of a control step, at least, in which a late sensor's signal is computed."""

SECANTS, SHIFT = 3, 1e-5
"""Steps, and their length in m or rad, in which the rest of an output is found from that of its drive."""
NEAR = 0.01
"""Share of the travel within which a record begins where its first samples say."""


@dataclass(frozen=True)
class Run:
    """One record's input and what to compare.

    command, rate | of the drive at every sample [T] (`cable_envs.sim.replay.replay`), rate None: from the command
    start         | position of the output before the record
    signals       | of the plant, one for each block
    blocks        | channels of this record
    given         | parameters that only this record has (its load, its wrap angle), SI
    offset        | signals whose zero means nothing in this record
    hold          | "ramp": the command goes from sample to sample; "step": each is held over the step that ends there
    mean          | whether samples are means over the control step around them
    second        | of a drive with a second command: at every sample [T]; None: as at rest
    held_at       | signal of the drive that is at ``command[0]`` when the record begins, at rest: the output is where
                  | each set of parameters has it then; "": it is at ``start``
    recorded      | of a drive that follows its recorded position: what ``command`` and ``rate`` are of
    """

    command: np.ndarray
    rate: np.ndarray | None
    start: float
    signals: tuple[str, ...]
    blocks: tuple[Block, ...]
    given: Mapping[str, float] = field(default_factory=dict)
    offset: tuple[str, ...] = ()
    hold: str = "ramp"
    mean: bool = False
    second: np.ndarray | None = None
    held_at: str = ""
    recorded: Recorded | None = None


class ReplayModel:
    """See `cable_envs.diagnosis.model.model.Model`.

    values     | the rig, by name of the plant's whole table
    parameters | rows that columns may change, of the plant's table
    drive      | how the kernel takes `Run.command`
    shifted    | step of `Run.start` (m, rad) at which its effect on all channels is measured; 0: the start is known
    lead       | control steps at rest before each record
    """

    def __init__(
        self, plant: Plant, runs: Sequence[Run], values: Mapping[str, float], parameters: Sequence[Free],
        period: float, *, drive: str, substeps: int, shifted: float = 0.0, lead: int = 0,
    ):  # fmt: skip
        self.plant, self.runs, self.parameters = plant, tuple(runs), tuple(parameters)
        self.period, self.drive, self.lead = period, drive, lead
        self.blocks: list[Block] = [block for run in runs for block in run.blocks]
        self._base = plant.table.pack(values)
        self._rows = [plant.table.index(p.name) for p in self.parameters]
        self._late = [plant.table.index(f"sensor_delay.{signal}") for signal in runs[0].signals] if runs else []
        self._sensors = [k for k, p in enumerate(plant.table) if p.name.startswith("sensor_")]
        self._shifted = shifted
        self._of_steps: dict[int, list[np.ndarray]] = {}
        self.resolve(substeps)
        if shifted > 0.0:
            claimed = self._prompt(self.runs, self.as_plant(self._base[:, None].copy()))
            self.runs = tuple(map(self._from_where_it_begins, self.runs, self._shifts, claimed))
            self._of_steps.clear()
            self.resolve(substeps)

    @staticmethod
    def _from_where_it_begins(run: Run, responses: np.ndarray, out: np.ndarray) -> Run:
        """The run from the start that fits it best; out: its signals [T, blocks, 1] at the values that are claimed.

        Of a record that begins in motion the first samples tell it to millimetres. What so large a shift makes of a
        tension would be wrong by as much as the claims, and another for each record.
        """
        found = _constants(run, responses, out, begins=True)
        return replace(run, start=run.start + float(found[0, 0]))

    def resolve(self, substeps: int) -> None:
        """Take so many steps of integration in every control step."""
        self.substeps = substeps
        if substeps not in self._of_steps:
            self._of_steps[substeps] = self._responses(self._shifted)
        self._shifts = self._of_steps[substeps]

    @property
    def resolved(self) -> float:
        """Step of integration, s, where commands jump: a simulator's drive takes as long to follow; 0 where none do.

        With longer steps a held command is followed as by an environment all the same.
        """
        held = any(run.hold == "step" for run in self.runs)
        return self.period / max(self.substeps, HELD_STEPS) if held else 0.0

    def predict(self, values: np.ndarray) -> list[np.ndarray]:
        """Predictions [T, n] of every block for parameter columns [len(parameters), n]."""
        columns = np.repeat(self._base[:, None], values.shape[1], axis=1)
        columns[self._rows] = values
        columns = self.as_plant(columns)
        late = columns[self._late].copy()
        columns[self._late] = 0.0
        found = []
        for run, shifts, out in zip(self.runs, self._shifts, self._seen(columns, late), strict=True):
            if shifts.size:
                out = out + shifts @ _constants(run, shifts, out, self._shifted > 0.0)
            found += [out[:, j] for j in range(len(run.blocks))]
        return found

    def constants(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """As `cable_envs.diagnosis.model.constants.Constant`."""
        begins = self._shifted > 0.0
        changes = [
            shifts if shifts.size else np.empty((len(run.command), len(run.blocks), 0))
            for run, shifts in zip(self.runs, self._shifts, strict=True)
        ]
        return [(c, _beforehand(run, c.shape[2], begins)) for run, c in zip(self.runs, changes, strict=True)]

    def driven_by(self) -> list[Recorded]:
        """As `cable_envs.diagnosis.model.driven.Driven`."""
        return [run.recorded for run in self.runs if run.recorded is not None]

    def answers(
        self, values: Mapping[str, float], errors: Sequence[np.ndarray], rates: Sequence[np.ndarray]
    ) -> list[np.ndarray]:
        """As `cable_envs.diagnosis.model.driven.Driven`; sensors are as late as if they were not."""
        columns = self._base[:, None].copy()
        columns[self._rows, 0] = [values.get(p.name, p.start) for p in self.parameters]
        columns = self.as_plant(columns)
        columns[self._late] = 0.0
        found: list[np.ndarray] = []
        for run, error, rate in zip(self.runs, errors, rates, strict=True):
            assert run.rate is not None, "a recorded drive has a speed"
            moved = [
                replace(run, command=run.command + e, rate=run.rate + r) for e, r in zip(error.T, rate.T, strict=True)
            ]
            out, *changed = self._prompt([run, *moved], columns)
            change = np.concatenate(changed, axis=2) - out
            found += [change[:, j] for j in range(len(run.blocks))]
        return found

    def as_plant(self, columns: np.ndarray) -> np.ndarray:
        """Columns [len(table), n] as the plant takes them, where a model's parameters mean something else."""
        return columns

    def _seen(self, columns: np.ndarray, late: np.ndarray) -> list[np.ndarray]:
        """Signals [T, blocks, n] of every run as sensors that are ``late`` [blocks, n] s show them.

        Between samples 10 ms apart tensions turn corners, so a delay is made on a finer clock.
        """
        waits = np.any(late > 0.0, axis=0)
        if not waits.any():
            return self._prompt(self.runs, columns)
        prompt = [] if waits.all() else self._prompt(self.runs, columns[:, ~waits])
        fine, found = self._fine(), []
        for k, (run, series) in enumerate(
            zip(self.runs, self._replay(self.runs, columns[:, waits], fine), strict=True)
        ):
            out = np.empty((len(run.command), len(run.blocks), columns.shape[1]))
            if prompt:
                out[:, :, ~waits] = prompt[k]
            for j in range(len(run.blocks)):
                seen = delayed(series[:, j], late[j, waits] * fine / self.period)
                out[:, j, waits] = mean_over_samples(seen, fine) if run.mean else seen[fine - 1 :: fine]
            found.append(out)
        return found

    def _prompt(self, runs: Sequence[Run], columns: np.ndarray, shift: float = 0.0) -> list[np.ndarray]:
        """Signals [T, blocks, n] of runs as sensors that are not late show them; ``shift`` of the output's start."""
        if not runs or not runs[0].mean:
            return self._replay(runs, columns, 1, shift)
        fine = self._fine()
        return [mean_over_samples(series, fine) for series in self._replay(runs, columns, fine, shift)]

    def _fine(self) -> int:
        """Parts of a control step in which signals are computed where the step's end alone does not do."""
        return 1 if self.drive == "follow" else min(d for d in range(1, self.substeps + 1) if self._divides(d))

    def _divides(self, parts: int) -> bool:
        """Whether a control step may be cut into so many: at least `FINE` if it has as many steps of integration."""
        return self.substeps % parts == 0 and parts >= min(FINE, self.substeps)

    def _begins(self, run: Run, columns: np.ndarray) -> np.ndarray:
        """Position of the output when the record begins, for columns [len(table), n]."""
        at = np.full(columns.shape[1], run.start)
        if not run.held_at:
            return at
        p, row = self.plant.prepare(columns), self.plant.row(run.held_at)
        for _ in range(SECANTS):
            here, beside = (self.plant.rest(p, at + more)[row] for more in (0.0, SHIFT))
            at = at + SHIFT * (run.command[0] - here) / np.maximum(beside - here, 1e-3 * SHIFT)
        return at

    def _replay(self, runs: Sequence[Run], columns: np.ndarray, fine: int, shift: float = 0.0) -> list[np.ndarray]:
        """Signals [T fine, blocks, n] of runs, ``fine`` times in every control step."""
        own = [with_given(self.plant, columns, run.given) for run in runs]
        moved, places = zip(*map(self._without_sensors, own), strict=True) if runs else ((), ())
        starts = [self._begins(run, alone) + shift for run, alone in zip(runs, moved, strict=True)]
        asked = [
            self._asked(run, alone, start, fine) for run, alone, start in zip(runs, moved, starts, strict=True)
        ]  # fmt: skip
        alike: dict[tuple[tuple[str, ...], str], list[int]] = {}
        for k, run in enumerate(runs):
            alike.setdefault((run.signals, run.hold), []).append(k)
        outs: dict[int, np.ndarray] = {}
        for (signals, hold), those in alike.items():
            together = replay_together(
                self.plant, [asked[k] for k in those], self.period / fine, drive=self.drive, signals=signals,
                hold=hold, substeps=self.substeps // fine,
            )  # fmt: skip
            outs |= dict(zip(those, together, strict=True))
        found = []
        for k, run in enumerate(runs):
            rows = [self.plant.row(name) for name in run.signals]
            first = self.plant.rest(self.plant.prepare(moved[k]), starts[k])[rows]
            out, p = outs[k], self.plant.prepare(own[k])
            if not np.array_equal(places[k], np.arange(columns.shape[1])):
                out = np.take(out, places[k], axis=2)
            out = distort(self.plant, p, run.signals, out, self.period / fine, np.take(first, places[k], axis=1))
            found.append(out[self.lead * fine :])
        return found

    def _asked(self, run: Run, columns: np.ndarray, start: np.ndarray, fine: int) -> Asked:
        """What a replay is told of a run, ``fine`` times in every control step."""
        command, rate = run.command, run.rate
        if fine > 1 and run.hold == "step":
            command, rate = np.repeat(command, fine), None
        elif fine > 1:
            ends = np.arange(1, fine * len(command) + 1) / fine - 1.0
            command, rate = np.interp(ends, np.arange(len(command)), command), None
        if self.lead:
            command = np.concatenate([np.full(self.lead * fine, command[0]), command])
            rate = None if rate is None else np.concatenate([np.zeros(self.lead), rate])
        second = None if run.second is None else np.repeat(run.second, fine)
        if second is not None and self.lead:
            second = np.concatenate([np.full(self.lead * fine, second[0]), second])
        return Asked(columns, command, rate, second=second, start=start)

    def _without_sensors(self, columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(columns that differ by more than their sensors, which of them each column [n] is).

        A sensor changes what is shown and not the motion, which is simulated once for all of them.
        """
        moved = np.delete(columns, self._sensors, axis=0)
        _, first, place = np.unique(moved, axis=1, return_index=True, return_inverse=True)
        kept = np.sort(first)  # in the order in which they came
        return columns[:, kept], np.searchsorted(kept, first)[place.ravel()]

    def _responses(self, step: float) -> list[np.ndarray]:
        """Change of all blocks of each run with its start, and with every free offset [T, blocks, constants]."""
        changes: list[list[np.ndarray]] = [[] for _ in self.runs]
        if step > 0.0:
            there, here = (self._prompt(self.runs, self._base[:, None], by) for by in (step, 0.0))
            changes = [[(a - b)[:, :, 0] / step] for a, b in zip(there, here, strict=True)]
        for run, found in zip(self.runs, changes, strict=True):
            for j, signal in enumerate(run.signals):
                if signal in run.offset:
                    found.append(np.zeros((len(run.command), len(run.blocks))))
                    found[-1][:, j] = 1.0
        return [np.stack(found, axis=2) if found else np.empty(0) for found in changes]


def delayed(series: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """Series [T, n] late by ``steps`` [n] of the clock, by cubics through four samples (Lagrange's).

    Straight lines, as sensors are delayed in `replay`, make a fast motion smaller: a delay of a fraction of a sample
    would be found 5 % too short. No sample looks ahead: what comes next may answer to the noise that is in it, and a
    delay of 0.3 ms gained 54 by that where a controller felt its sensor's noise.
    """
    found = np.empty(series.shape)
    late = np.maximum(np.ceil(steps).astype(int), 2)  # of the second of the four samples
    for by in np.unique(late):
        own = late == by
        some, own = (series, slice(None)) if own.all() else (series[:, own], own)
        first = min(by + 1, len(series))  # before, samples of the start are missing
        found[:first, own] = _late_at_first(some[: first + 1], steps[own], first)
        a, b, c, d = (some[first - by - 1 + k : len(some) - by - 1 + k] for k in range(4))
        before, at, after, last = _cubic(by - steps[own])
        found[first:, own] = before * a + at * b + after * c + last * d
    return found


def _cubic(part: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Weights of four samples in a row for a value that is by ``part`` of their distance behind the second."""
    return (
        -part * (part - 1.0) * (part - 2.0) / 6.0, (part + 1.0) * (part - 1.0) * (part - 2.0) / 2.0,
        -(part + 1.0) * part * (part - 2.0) / 2.0, (part + 1.0) * part * (part - 1.0) / 6.0,
    )  # fmt: skip


def _late_at_first(series: np.ndarray, steps: np.ndarray, first: int) -> np.ndarray:
    """The ``first`` samples of a series that is late, before which it stood still."""
    now = np.arange(first)[:, None]
    at = np.maximum(now - steps, 0.0)
    whole = np.minimum(at.astype(int), np.maximum(now - 2, 0))
    columns = np.arange(series.shape[1])
    four = (series[np.clip(whole + k, 0, len(series) - 1), columns] for k in (-1, 0, 1, 2))
    return sum((weight * value for weight, value in zip(_cubic(at - whole), four, strict=True)), np.zeros(at.shape))


def _constants(run: Run, responses: np.ndarray, out: np.ndarray, begins: bool) -> np.ndarray:
    """Constants [constants, n] by which predictions [T, blocks, n] fit the record best, by the channels' noise."""
    matrix = _beforehand(run, responses.shape[2], begins)
    right = np.zeros((responses.shape[2], out.shape[2]))
    for j, block in enumerate(run.blocks):
        if not block.good.any():
            continue
        weighed = (
            responses[:, j] * (block.good / jitter(block.measured[block.good], block.reading.as_one) ** 2)[:, None]
        )
        matrix = matrix + weighed.T @ responses[:, j]
        right = right + weighed.T @ (block.measured[:, None] - out[:, j])
    return np.linalg.pinv(matrix, hermitian=True) @ right


def _beforehand(run: Run, count: int, begins: bool) -> np.ndarray:
    """What is known of constants before they are seen, as the inverse of their covariance [constants, constants].

    begins: whether the first constant is where the output begins. It is then near where it was measured: what a record
    that rests at first tells of it is next to nothing, and a model that is far off would shift it by metres.
    """
    known = np.zeros((count, count))
    travels = [np.ptp(b.measured[b.good]) for b in run.blocks if b.unit in ("m", "rad") and b.good.any()]
    if count and begins and travels and max(travels) > 0.0:
        known[0, 0] = (NEAR * max(travels)) ** -2
    return known
