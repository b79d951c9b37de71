"""Faults that a logger, a wiring or a script makes of a good recording: what a diagnosis must not take for physics.

A corruption acts on the tables of a recording, SI, and knows nothing of the rig: it is told which channels are
positions, efforts and commands. What is wrong with the log from its first row to its last (a factor, a sign, two
channels in each other's column, a late one) is so in every record; what happens once (counts that are lost, a channel
that is held, an offset that jumps) happens in the first record, at a place that is drawn.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

Table = dict[str, np.ndarray]
"""Channel, "time" among them -> [rows], SI."""

LATE = 0.006
"""Of a record's length, that a channel is late or early against the others."""
LOST = 0.04
"""Of a position's range, that its encoder loses."""
HELD = 10
"""Rows for which an effort is held."""


@dataclass(frozen=True)
class Roles:
    """Channels of a recording by what they are, the one that is corrupted first; others: of an effort to swap with."""

    positions: tuple[str, ...]
    efforts: tuple[str, ...]
    commands: tuple[str, ...] = ()
    others: tuple[str, ...] = ()


@dataclass(frozen=True)
class Corruption:
    """One kind: ``role`` says what it acts on ("positions", "efforts", "commands"), ``which`` of them, from 0.

    everywhere: in all records; else in the first one. ``act(table, channel, other, rng)`` changes a table in place;
    other: the channel with which it is swapped, or its like.
    """

    role: str
    act: Callable[[Table, str, str, np.random.Generator], None]
    everywhere: bool = True
    which: int = 0
    other: tuple[str, int] = ("", 0)


def _times(factor: float) -> Callable[..., None]:
    def act(table: Table, channel: str, other: str, rng: np.random.Generator) -> None:
        table[channel] = factor * table[channel]

    return act


def _swap(table: Table, channel: str, other: str, rng: np.random.Generator) -> None:
    table[channel], table[other] = table[other], table[channel]


def _shift(share: float) -> Callable[..., None]:
    """Late, or early, by a share of the record; rows for which the channel has no value then are left out."""

    def act(table: Table, channel: str, other: str, rng: np.random.Generator) -> None:
        time = table["time"]
        wait = share * (time[-1] - time[0])
        table[channel] = np.interp(time - wait, time, table[channel])
        kept = (time - wait >= time[0]) & (time - wait <= time[-1])
        for name in table:
            table[name] = table[name][kept]

    return act


def _somewhere(rows: int, rng: np.random.Generator) -> int:
    """A row about the middle of a record."""
    return int(rows * rng.uniform(0.4, 0.6))


def _moving(values: np.ndarray, rows: int, rng: np.random.Generator) -> int:
    """First of ``rows`` rows in which a channel moves more than in half of all such stretches."""
    starts = np.arange(rows, len(values) - 2 * rows, max(rows // 2, 1))
    ways = np.abs(values[starts + rows] - values[starts])
    return int(rng.choice(starts[ways >= np.median(ways)]))


def _lost(table: Table, channel: str, other: str, rng: np.random.Generator) -> None:
    start = _somewhere(len(table["time"]), rng)
    values = table[channel].copy()
    values[start:] -= LOST * np.ptp(values)
    table[channel] = values


def _held(rows: int | None, share: float = 0.0) -> Callable[..., None]:
    def act(table: Table, channel: str, other: str, rng: np.random.Generator) -> None:
        values = table[channel].copy()
        length = rows or max(int(share * len(values)), 2)
        start = _moving(values, length, rng)
        values[start : start + length] = values[start]
        table[channel] = values

    return act


def _clipped(table: Table, channel: str, other: str, rng: np.random.Generator) -> None:
    most = 0.6 * np.max(np.abs(table[channel]))
    table[channel] = np.clip(table[channel], -most, most)


def _mixed(factor: float) -> Callable[..., None]:
    def act(table: Table, channel: str, other: str, rng: np.random.Generator) -> None:
        start = _somewhere(len(table["time"]), rng)
        values = table[channel].copy()
        values[start:] *= factor
        table[channel] = values

    return act


def _jumps(table: Table, channel: str, other: str, rng: np.random.Generator) -> None:
    start = _somewhere(len(table["time"]), rng)
    values = table[channel].copy()
    values[start:] += np.std(values) * rng.choice([-1.0, 1.0])
    table[channel] = values


def _spikes(table: Table, channel: str, other: str, rng: np.random.Generator) -> None:
    values = table[channel].copy()
    values[rng.choice(np.arange(len(values) // 10, len(values) - 10), 3, replace=False)] += 0.5 * np.ptp(values)
    table[channel] = values


def _again(table: Table, channel: str, other: str, rng: np.random.Generator) -> None:
    """Every fiftieth row stands twice."""
    rows = np.arange(len(table["time"]))
    picked = np.sort(np.concatenate([rows, rows[50::50]]))
    for name in table:
        table[name] = table[name][picked]


def _out_of_order(table: Table, channel: str, other: str, rng: np.random.Generator) -> None:
    """Two neighbouring blocks of a hundredth of the record each in each other's place; the clock is written anew."""
    rows = len(table["time"])
    length = max(rows // 100, 2)
    start = _moving(table[channel], length, rng)
    order = np.arange(rows)
    order[start : start + 2 * length] = np.roll(order[start : start + 2 * length], length)
    for name in table:
        if name != "time":
            table[name] = table[name][order]


def _block_twice(table: Table, channel: str, other: str, rng: np.random.Generator) -> None:
    """A buffer of a hundredth of the record is written twice, under a clock that goes on; what comes last falls off."""
    rows = len(table["time"])
    length = max(rows // 100, 2)
    start = _moving(table[channel], length, rng)
    order = np.concatenate([np.arange(start + length), np.arange(start, rows - length)])
    for name in table:
        if name != "time":
            table[name] = table[name][order]


def _rate(factor: float) -> Callable[..., None]:
    def act(table: Table, channel: str, other: str, rng: np.random.Generator) -> None:
        time = table["time"]
        table["time"] = time[0] + factor * (time - time[0])

    return act


CORRUPTIONS: Mapping[str, Corruption] = {
    "two positions swapped": Corruption("positions", _swap, other=("positions", 1)),
    "position and effort swapped": Corruption("positions", _swap, other=("efforts", 0)),
    "effort and another channel swapped": Corruption("efforts", _swap, other=("others", 0)),
    "effort x 9.81": Corruption("efforts", _times(9.81)),
    "effort x 1000": Corruption("efforts", _times(1000.0)),
    "effort / 9.81": Corruption("efforts", _times(1.0 / 9.81)),
    "position x 57.3": Corruption("positions", _times(180.0 / np.pi)),
    "position x 1000": Corruption("positions", _times(1000.0)),
    "sign of a position": Corruption("positions", _times(-1.0)),
    "sign of an effort": Corruption("efforts", _times(-1.0)),
    "sign of a command": Corruption("commands", _times(-1.0)),
    "counts lost": Corruption("positions", _lost, everywhere=False),
    "counts lost, other position": Corruption("positions", _lost, everywhere=False, which=1),
    "effort held 10 rows": Corruption("efforts", _held(HELD), everywhere=False),
    "position held 2 %": Corruption("positions", _held(None, 0.02), everywhere=False),
    "effort late": Corruption("efforts", _shift(LATE)),
    "position late": Corruption("positions", _shift(LATE)),
    "effort early": Corruption("efforts", _shift(-LATE)),
    "position stuck 10 %": Corruption("positions", _held(None, 0.1), everywhere=False),
    "effort clipped": Corruption("efforts", _clipped),
    "units mixed": Corruption("efforts", _mixed(9.81), everywhere=False),
    "offset of an effort jumps": Corruption("efforts", _jumps, everywhere=False),
    "spikes in an effort": Corruption("efforts", _spikes, everywhere=False),
    "rows twice": Corruption("positions", _again, everywhere=False),
    "rows out of order": Corruption("positions", _out_of_order, everywhere=False),
    "a block twice": Corruption("positions", _block_twice, everywhere=False),
    "clock x 2": Corruption("positions", _rate(2.0)),
    "clock / 2": Corruption("positions", _rate(0.5)),
}


def corrupted(
    kind: str, tables: Sequence[Mapping[str, np.ndarray]], roles: Roles, rng: np.random.Generator
) -> list[Table] | None:
    """Copies of a recording's tables with one fault in them.

    Parameters
    ----------
    kind : str
        One of `CORRUPTIONS`.
    tables : sequence of mapping of str to ndarray
        Its records, SI; the first is one to fit.
    roles : Roles
        What its channels are.
    rng : numpy.random.Generator
        Draws places.

    Returns
    -------
    list of dict, or None
        None where the recording lacks what the corruption acts on.
    """
    wanted = CORRUPTIONS[kind]
    there: Sequence[str] = getattr(roles, wanted.role)
    others: Sequence[str] = getattr(roles, wanted.other[0]) if wanted.other[0] else ("",)
    if wanted.which >= len(there) or wanted.other[1] >= len(others):
        return None
    found = [{name: np.array(values, float) for name, values in table.items()} for table in tables]
    for table in found if wanted.everywhere else found[:1]:
        wanted.act(table, there[wanted.which], others[wanted.other[1]], rng)
    return found
