"""Records of any plant as a `Model`: the drive's input goes through the kernel, every other channel is predicted.

What happened before a record began is known to a constant only (where the load hung when the drive's counter was set).
Such a constant shifts some channels by a known shape; how much is solved for in every prediction, from the record that
is predicted, held out or not: it is its initial condition.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from cable_envs.plants.base import Plant
from cable_envs.replay import replay
from diagnosis.model import Block, Free


@dataclass(frozen=True)
class Run:
    """One record's input and what to compare.

    command, rate | of the drive at every sample [T] (`cable_envs.replay.replay`), rate None: from the command
    start         | position of the output before the record
    signals       | of the plant, one for each block
    blocks        | channels of this record
    given         | parameters that only this record has (its load, its wrap angle), SI
    """

    command: np.ndarray
    rate: np.ndarray | None
    start: float
    signals: tuple[str, ...]
    blocks: tuple[Block, ...]
    given: Mapping[str, float] = field(default_factory=dict)


class ReplayModel:
    """See `diagnosis.model.Model`.

    values     | the rig, by name of the plant's whole table
    parameters | rows that columns may change, of the plant's table
    drive      | how the kernel takes `Run.command`
    shifted    | step of `Run.start` (m, rad) at which its effect on all channels is measured; 0: it is known
    lead       | control steps at rest before each record
    """

    def __init__(
        self, plant: Plant, runs: Sequence[Run], values: Mapping[str, float], parameters: Sequence[Free],
        period: float, *, drive: str, substeps: int, shifted: float = 0.0, lead: int = 0,
    ):  # fmt: skip
        self.plant, self.runs, self.parameters = plant, tuple(runs), tuple(parameters)
        self.period, self.drive, self.substeps, self.lead = period, drive, substeps, lead
        self.blocks: list[Block] = [block for run in runs for block in run.blocks]
        self._base = plant.table.pack(values)
        self._rows = [plant.table.index(p.name) for p in self.parameters]
        self._shift = [self._response(run, shifted) for run in runs] if shifted > 0.0 else None

    def predict(self, values: np.ndarray) -> list[np.ndarray]:
        """Predictions [T, n] of every block for parameter columns [len(parameters), n]."""
        columns = np.repeat(self._base[:, None], values.shape[1], axis=1)
        columns[self._rows] = values
        found = []
        for k, run in enumerate(self.runs):
            out = self._replay(run, columns, run.start)
            if self._shift is not None:
                self._settle(run, self._shift[k], out)
            found += [out[:, j] for j in range(len(run.blocks))]
        return found

    def _replay(self, run: Run, columns: np.ndarray, start: float) -> np.ndarray:
        """Signals [T, blocks, n] of a run."""
        if run.given:
            columns = columns.copy()
            for name, value in run.given.items():
                columns[self.plant.table.index(name)] = value
        command, rate = run.command, run.rate
        if self.lead:
            command = np.concatenate([np.full(self.lead, command[0]), command])
            rate = None if rate is None else np.concatenate([np.zeros(self.lead), rate])
        out = replay(
            self.plant, columns, command, self.period, drive=self.drive, signals=run.signals, rate=rate, start=start,
            substeps=self.substeps,
        )  # fmt: skip
        return out[self.lead :]

    def _response(self, run: Run, step: float) -> np.ndarray:
        """Change of every block [T, blocks] per change of the start, over the channels' noise."""
        base = self._base[:, None]
        change = self._replay(run, base, run.start + step) - self._replay(run, base, run.start)
        return change[:, :, 0] / step

    def _settle(self, run: Run, response: np.ndarray, out: np.ndarray) -> None:
        """Shift predictions (in place) to the start that fits the record best, channels weighed by their noise."""
        over, under = 0.0, 0.0
        for j, block in enumerate(run.blocks):
            weight = block.good / _jitter(block) ** 2
            over = over + (weight * response[:, j]) @ (block.measured[:, None] - out[:, j])
            under += float((weight * response[:, j]) @ response[:, j])
        if under > 0.0:
            out += response[:, :, None] * (over / under)


def _jitter(block: Block) -> float:
    """About the noise of a channel: from second differences, whose variance is 6 times that of white noise."""
    second = np.diff(block.measured[block.good], 2)
    scale = float(np.median(np.abs(second))) / 0.6745 / np.sqrt(6.0) if len(second) else 0.0
    return scale or 1e-9 * (float(np.max(np.abs(block.measured))) or 1.0)
