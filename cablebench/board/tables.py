"""A ranked board as plain data, that every report (terminal, JSON, Markdown, HTML) is drawn from."""

import shlex
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from cable_envs.core.errors import ConfigurationError
from cablebench.board.history import Made
from cablebench.entrants.entrant import INFORMATION
from cablebench.protocol.protocol import Protocol
from cablebench.score.anchors import Anchor
from cablebench.score.compare import Pair
from cablebench.score.statistics import BootstrapInterval

SCHEMA = 1
"""Version of board.json."""


@dataclass(frozen=True)
class Row:
    """One entrant in one table. `score` and what follows from it are None where a reference was not run."""

    entrant: str
    information: str
    failures: int
    raw: Mapping[str, float]
    """median of every metric over the completed episodes, SI; NaN where it does not apply"""
    charged: Mapping[str, float]
    """what one training seed used: environment_steps, tuning_trials, identification_samples"""
    replay: str
    rank: int = 0
    """place within the information class, from 1"""
    runs: int = 0
    """training seeds; 1 for a controller that is not trained"""
    episodes: int = 0
    """test episodes of each run"""
    score: BootstrapInterval | None = None
    median: float | None = None
    optimality_gap: float | None = None
    worst_tenth: float | None = None
    improvement: float | None = None
    """probability of improvement over the papers' controller; None for that controller itself"""
    improvement_interval: tuple[float, float] | None = None
    """its interval; score version 1"""
    robustness: float | None = None
    """share of the sweeps' values that were survived; score version 1, None where they were not run"""
    places: Mapping[str, float] = field(default_factory=dict)
    """place in the table by metric (`cablebench.board.suite.RANKED`), over several tasks their mean; score version 1"""
    violations: Mapping[str, int] = field(default_factory=dict)
    """episodes that break each failure rule (`cablebench.protocol.failures`); score version 1"""
    scores: Mapping[str, tuple[tuple[float, ...], ...]] = field(default_factory=dict)
    """task -> scores of the episodes of each run"""
    trajectory: str = ""
    """key of the run whose trajectories are shown"""


@dataclass(frozen=True)
class Table:
    """Entrants on one task and track, or (`task` empty) over all tasks of one mechanism and track."""

    family: str
    task: str
    env_id: str
    track: str
    output_unit: str
    command_unit: str
    paper: str
    rows: tuple[Row, ...]
    tasks: int = 1
    """how many tasks it covers"""
    omitted: tuple[str, ...] = ()
    """entrants left out of a table over all tasks because they did not run all of them"""
    pairs: tuple[Pair, ...] = ()
    """every two entrants compared; score version 1"""
    separated: int = 0
    """how many of the pairs differ after Holm's correction"""
    score_version: int = 0


@dataclass(frozen=True)
class Board:
    """A ranked board with what is needed to judge and to replay it."""

    protocol: Protocol
    tables: tuple[Table, ...]
    overall: tuple[Table, ...]
    created: str
    configuration: str
    versions: Mapping[str, str]
    machine: str
    seeds: tuple[int, ...]
    training_seeds: tuple[int, ...]
    episodes: int
    notes: tuple[str, ...]
    sweeps: tuple[Mapping[str, Any], ...] = ()
    """stress results: {task, sweep, unit, entrant, values, rmse, score} with the median RMSE and the mean score at each
    swept value, and `robustness`, the mean of those scores (the area under their line, with values evenly spaced)"""
    remarks: str = ""
    """what people say about it, in Markdown: NOTES.md of its folder"""
    place: str = ""
    """where its records lie, as flags of the command line: "--board quick" or "--results DIR" """
    anchors: tuple[Anchor, ...] = ()
    """what the scores of version 1 are between"""
    agreement: tuple[Mapping[str, Any], ...] = ()
    """{track, mean, pairs: [{tasks, tau}]}: Kendall's tau between the tasks' rankings; score version 1"""
    history: tuple[Made, ...] = ()
    """when each entrant's rows were made, and with which version of the source"""

    @property
    def version(self) -> int:
        """The protocol's version: boards of different versions cannot be compared."""
        return self.protocol.version

    def replay(self, table: "Table", row: "Row") -> str:
        """The command that runs a row's episodes again and compares them with the records."""
        if not self.place:
            return row.replay
        return (
            f"cablebench replay {self.place} --entrant {shlex.quote(row.entrant)} --env {table.task} "
            f"--track {table.track}"
        )

    @property
    def entrants(self) -> tuple[str, ...]:
        """Every entrant's name, by information class and then by name."""
        found = {r.entrant: r.information for t in self.tables for r in t.rows}
        return tuple(sorted(found, key=lambda n: (INFORMATION.index(found[n]), n)))

    def table(self, task: str, track: str) -> Table:
        """The table of one task (short name or id) and track."""
        for table in self.tables:
            if task in (table.task, table.env_id) and table.track == track:
                return table
        raise ConfigurationError(f"the board has no table for task '{task}' on track '{track}'")
