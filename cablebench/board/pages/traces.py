"""What the trace viewer of a task's page shows: signals of each entrant's median and worst episode, as whole numbers.

A series is ``[step, first, difference, difference, ...]``: whole multiples of ``step``, each after the first as the
difference from the one before it, and null where the signal has no value. Episodes share series that are equal.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from cablebench.board.pages.figures import Style
from cablebench.board.tables import Board, Row, Table
from cablebench.protocol.units import display, unit_of

Trajectories = Callable[[str], Mapping[str, Mapping[str, np.ndarray]]]
"""Run key -> {"median": arrays by name, "worst": arrays by name}, empty where nothing was kept"""

KINDS = ("median", "worst")
"""Episodes of a run of which traces are kept, by their error."""

TICKED = 4
"""Entrants that are shown before anybody has chosen, and those that a packed board keeps the traces of."""

DRAWN_POINTS = 200
"""Of an episode's signal in a packed board: more than a phone's screen shows."""

DIGITS = 5
"""Decimal digits of the largest value of a series: below a pixel of a screen, also where a tenth of it is shown."""

_ALWAYS = ("time", "reference", "output", "command", "failed")


def is_drawn(signal: str) -> bool:
    """Whether the viewer shows this signal of an episode, so that a packed board keeps it."""
    return signal in _ALWAYS or _is_tension(signal)


def _is_tension(signal: str) -> bool:
    """Tensions at the drive's end of a cable and at the load; those within a sheath would be twenty lines."""
    return "tension" in signal and signal != "peak_tension" and not signal.startswith(("tension_output", "span_"))


def shown_runs(board: Board) -> set[str]:
    """Keys of the runs whose trajectories a packed board keeps."""
    return {row.trajectory for table in board.tables for row in chosen(table, board)}


def chosen(table: Table, board: Board) -> list[Row]:
    """Up to four rows: the papers' controller, the best of each class, then the rest by rank."""
    wanted = [r for r in table.rows if r.entrant == table.paper]
    wanted += [r for r in table.rows if r.rank == 1]
    wanted += [r for r in table.rows if r.charged.get("environment_steps")]
    wanted += [r for r in table.rows if r.entrant != board.protocol.open_loop]
    found: dict[str, Row] = {}
    for row in wanted:
        if len(found) < TICKED:
            found.setdefault(row.entrant, row)
    return list(found.values())


def viewer(
    board: Board, tables: Sequence[Table], trajectories: Trajectories | None, style: Style
) -> dict[str, Any] | None:
    """The viewer's data for one task.

    Parameters
    ----------
    board : Board
    tables : sequence of Table
        Of the task, one for each track.
    trajectories : callable or None
        `cablebench.run.trajectories.Trajectories.of` of the store.
    style : mapping
        `cablebench.board.pages.figures.styles` of the board.

    Returns
    -------
    dict or None
        JSON types: ``units`` by panel; ``tracks``, a list of entrants with their episodes for each; and ``series``,
        to whose places the episodes refer. Values are in the units that the board shows. None where the store has no
        trajectories of the task.
    """
    if trajectories is None:
        return None
    pool = _Pool()
    tracks = []
    for table in tables:
        kept = {row.entrant: found for row in table.rows if (found := _whole(trajectories(row.trajectory)))}
        first = [row.entrant for row in (*chosen(table, board), *table.rows) if row.entrant in kept]
        ticked = list(dict.fromkeys(first))[:TICKED]
        entrants = [
            {
                "name": name,
                "colour": style[name]["color"],
                "width": _width(name, style),
                "ticked": name in ticked,
                "episodes": {kind: _episode(found[kind], table, pool) for kind in KINDS if kind in found},
            }
            for name, found in kept.items()
        ]
        if entrants:
            tracks.append({"name": table.track, "entrants": entrants})
    if not tracks:
        return None
    units = {"output": unit_of("output", tables[0]), "tension": "N", "command": tables[0].command_unit}
    return {"units": units, "tracks": tracks, "series": pool.series}


def _width(entrant: str, style: Style) -> float:
    """Of the line, in pixels: an entrant that shares its colour with others before it has a wider one."""
    same = [name for name, s in style.items() if s["color"] == style[entrant]["color"]]
    return 1.5 + same.index(entrant)


def _whole(found: Mapping[str, Mapping[str, np.ndarray]]) -> dict[str, Mapping[str, np.ndarray]]:
    """Those that have what every trace needs."""
    return {
        kind: arrays
        for kind, arrays in found.items()
        if all(name in arrays for name in ("time", "reference", "output")) and len(arrays["time"])
    }


def _episode(arrays: Mapping[str, np.ndarray], table: Table, pool: "_Pool") -> dict[str, Any]:
    scale = display(1.0, "output", table)
    return {
        "time": pool.place(arrays["time"]),
        "reference": pool.place(arrays["reference"] * scale),
        "output": pool.place(arrays["output"] * scale),
        "tension": [[label_of(name), pool.place(arrays[name])] for name in arrays if _is_tension(name)],
        "command": pool.place(arrays["command"]) if "command" in arrays else None,
        "failed": bool(arrays.get("failed", False)),
    }


def label_of(signal: str) -> str:
    """A tension's place: "drive" of ``drive_tension``, "drive top" of ``tension_drive_top``.

    Examples
    --------
    >>> label_of("drive_tension"), label_of("tension_drive_top")
    ('drive', 'drive top')
    """
    return " ".join(word for word in signal.split("_") if word != "tension")


class _Pool:
    """Series, each once."""

    def __init__(self) -> None:
        self.series: list[list[float | int | None]] = []
        self._places: dict[str, int] = {}

    def place(self, values: np.ndarray) -> int:
        """Where the values [T] stand among the series."""
        series = series_of(values)
        place = self._places.setdefault(repr(series), len(self.series))
        if place == len(self.series):
            self.series.append(series)
        return place


def series_of(values: np.ndarray) -> list[float | int | None]:
    """The values as a step and whole numbers.

    Parameters
    ----------
    values : ndarray [T]

    Returns
    -------
    list
        ``[step, first, difference, ...]``; `DIGITS` digits of the largest value.

    Examples
    --------
    >>> series_of(np.array([10.0, 10.25, np.nan, 10.5]))
    [0.001, 10000, 250, None, 250]
    """
    values = np.asarray(values, float)
    finite = np.isfinite(values)
    largest = float(np.max(np.abs(values[finite]), initial=0.0))
    power = DIGITS - 1 - math.floor(math.log10(largest)) if largest else 0
    whole = np.round(np.where(finite, values, 0.0) * 10.0**power).astype(int)
    series: list[float | int | None] = [float(f"1e{-power}")]
    before = 0
    for number, known in zip(whole.tolist(), finite.tolist(), strict=True):
        series.append(number - before if known else None)
        before = number if known else before
    return series
