"""Several records through a plant in one call: columns of all of them share a processor's lanes.

A processor takes `cable_envs.sim.replay.ABREAST` columns at once, and is quickest with as many as its cache holds. A
fit of two records asks for three to ten columns of each at a time: by themselves these leave half of the lanes empty.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from cable_envs.core.inputs import INPUTS
from cable_envs.plants.base import Plant
from cable_envs.plants.kernel import BLOCK
from cable_envs.sim.replay import ABREAST, replay

TIMES = (0.0, 1.0, 1.7, 2.5)
"""Time of so many times `ABREAST` columns that go through a record together, measured at a hole and a circuit."""
MOST = 1 << 25
"""Bytes of inputs of columns that go together, at the most: each has inputs of its own then, which have to be read."""


@dataclass(frozen=True)
class Asked:
    """Columns of parameters and the record that drives them, as `cable_envs.sim.replay.replay` takes them."""

    values: np.ndarray
    command: np.ndarray
    rate: np.ndarray | None = None
    disturbance: np.ndarray | None = None
    second: np.ndarray | None = None
    start: np.ndarray | float = 0.0
    state: np.ndarray | None = None

    @property
    def count(self) -> int:
        """Columns."""
        return self.values.shape[1]

    @property
    def steps(self) -> int:
        """Of the record."""
        return len(self.command)

    @property
    def given(self) -> tuple[str, ...]:
        """What it has over time, and whether it goes on from a state."""
        return tuple(f.name for f in fields(self) if f.name != "start" and getattr(self, f.name) is not None)

    def part(self, first: int, last: int) -> "Asked":
        """Some of its columns."""
        own = {name: getattr(self, name) for name in self.given}
        found = {name: v[:, first:last] if v.ndim == 2 and v.shape[1] == self.count else v for name, v in own.items()}
        start = self.start if np.ndim(self.start) == 0 else np.asarray(self.start)[first:last]
        return Asked(**found, start=start)


def replay_together(
    plant: Plant, records: Sequence[Asked], period: float, *, drive: str, signals: Sequence[str], hold: str = "ramp",
    substeps: int = 10,
) -> list[np.ndarray]:  # fmt: skip
    """True signals of many mechanisms, driven by several records: to the bit those of `replay` for each of them.

    Parameters
    ----------
    plant : Plant
        What simulates them.
    records : sequence of Asked
        Columns of parameters, and what drives them. Their ``state`` is not changed.
    period : float
        Of all records, s.
    drive, signals, hold, substeps
        As of `cable_envs.sim.replay.replay`.

    Returns
    -------
    list of ndarray
        [T, len(signals), n] of every record.
    """

    def go(one: Asked) -> np.ndarray:
        own = {name: getattr(one, name) for name in one.given if name not in ("values", "command")}
        state = {"state": own.pop("state").copy()} if one.state is not None else {"start": one.start}
        return replay(
            plant, one.values, one.command, period, drive=drive, signals=signals, hold=hold, substeps=substeps,
            sensors=False, **own, **state,
        )  # fmt: skip

    found: list[list[np.ndarray]] = [[] for _ in records]
    rests: dict[tuple[str, ...], list[tuple[int, Asked]]] = {}
    for k, record in enumerate(records):
        whole = record.count - record.count % BLOCK if len(records) > 1 else record.count
        if whole:
            found[k].append(go(record.part(0, whole) if whole < record.count else record))
        if whole < record.count:
            rests.setdefault(record.given, []).append((k, record.part(whole, record.count)))
    for alike in rests.values():
        for batch in _batches(alike):
            if len(batch) == 1:
                found[batch[0][0]].append(go(batch[0][1]))
                continue
            out, first = go(_joined([record for _, record in batch], drive, period)), 0
            for k, record in batch:
                found[k].append(out[: record.steps, :, first : first + record.count])
                first += record.count
    return [parts[0] if len(parts) == 1 else np.concatenate(parts, axis=2) for parts in found]


def _batches(records: Sequence[tuple[int, Asked]]) -> list[list[tuple[int, Asked]]]:
    """Which records go together: as long as that is quicker, the shorter ones being made as long as the longest."""
    found: list[list[tuple[int, Asked]]] = []
    count = steps = 0
    for k, record in sorted(records, key=lambda pair: -pair[1].steps):
        n = count + record.count
        apart = _time(count) * steps + _time(record.count) * record.steps
        if found and n * steps * 8 * len(INPUTS) <= MOST and _time(n) * steps <= apart:
            found[-1].append((k, record))
            count = n
        else:
            found.append([(k, record)])
            count, steps = record.count, record.steps
    return found


def _time(count: int) -> float:
    """Of a step with so many columns."""
    blocks, rest = divmod(count, BLOCK)
    return blocks * TIMES[-1] + TIMES[-(-rest // ABREAST)]


def _joined(records: Sequence[Asked], drive: str, period: float) -> Asked:
    """Records as one that is as long as the longest; what comes behind a shorter one is of no account."""
    steps, over_time = records[0].steps, dict[str, np.ndarray]()
    follows = drive == "follow" and records[0].rate is None
    for name in ("command", "rate", "disturbance", "second"):
        if name not in records[0].given and not (name == "rate" and follows):
            continue
        parts = []
        for record in records:
            series = getattr(record, name)
            if series is None:  # differences at a record's end are not those within a longer one
                series = np.gradient(record.command, period, axis=0) if record.steps > 1 else np.zeros(1)
            wide = np.empty((steps, record.count))
            wide[: record.steps] = series if series.ndim == 2 else series[:, None]
            wide[record.steps :] = 0.0 if name == "rate" else wide[record.steps - 1]
            parts.append(wide)
        over_time[name] = np.concatenate(parts, axis=1)
    values = np.concatenate([record.values for record in records], axis=1)
    if records[0].state is not None:
        state = np.concatenate([r.state for r in records if r.state is not None], axis=1)
        return Asked(values, **over_time, state=state)
    start = np.concatenate([np.broadcast_to(record.start, record.count) for record in records])
    return Asked(values, **over_time, start=start)
