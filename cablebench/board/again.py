"""Traces that a board keeps none of: median and worst episodes run again, and compared with the records."""

from collections.abc import Callable, Sequence
from contextlib import closing
from pathlib import Path

import gymnasium as gym
import numpy as np

from cable_envs.core.errors import ConfigurationError
from cable_envs.core.files import jsonable
from cablebench.board.pages.traces import KINDS, chosen
from cablebench.board.replay import arguments_of, differing
from cablebench.board.scoring import Record
from cablebench.board.tables import Board, Row, Table
from cablebench.entrants.entrant import Entrant
from cablebench.protocol.protocol import Cell, Protocol
from cablebench.run.evaluation import core_of, run_episode
from cablebench.run.records import TRAJECTORY_POINTS, badness, facts
from cablebench.run.trajectories import Trajectories


def without_traces(board: Board, records: Sequence[Record], kept: Trajectories) -> list[list[Record]]:
    """The runs that the pages would show traces of, and that none are kept of.

    Parameters
    ----------
    board : Board
    records : sequence of mapping
        Of the store.
    kept : Trajectories
        Of the store.

    Returns
    -------
    list of list of mapping
        The records of each run. Tracks with sweeps are left out: their episodes are of one rig.
    """
    tracks = {track.name for track in board.protocol.tracks if not track.sweeps}
    shown = [row.trajectory for table in board.tables if table.track in tracks for row in _drawn(table, board)]
    of = {run: [r for r in records if r["run"] == run] for run in dict.fromkeys(shown)}
    return [row for run, row in of.items() if row and not kept.of(run)]


def _drawn(table: Table, board: Board) -> list[Row]:
    return [row for row in chosen(table, board) if row.trajectory]


def typical_again(
    protocol: Protocol, run: Sequence[Record], entrant: Entrant
) -> dict[str, dict[str, np.ndarray]] | None:
    """The median and the worst episode of a run, simulated again.

    Parameters
    ----------
    protocol : Protocol
        Of the records.
    run : sequence of mapping
        The records of one run, an episode each.
    entrant : Entrant
        Who made them.

    Returns
    -------
    dict of dict or None
        "median" and "worst" -> arrays by name (`cablebench.protocol.episode.Episode.thinned`); None where a number is
        not as it was recorded.

    Raises
    ------
    ConfigurationError
        Where the protocol has no such condition, or the entrant does not enter it.
    """
    order = sorted(run, key=badness)
    wanted = dict(zip(KINDS, (order[(len(order) - 1) // 2], order[-1]), strict=True))
    cell = _cell(protocol, order[0])
    options = entrant.enters(cell.task.env, cell.environment_options())
    if options is None:
        raise ConfigurationError(f"'{entrant.title}' does not enter {cell.key}")
    found = {}
    with closing(gym.make(cell.task.env, disable_env_checker=True, **options)) as env:
        setup = core_of(env).setup
        actor = entrant.make(setup)
        for kind, record in wanted.items():
            episode = run_episode(env, actor, record["seed"], cell.reset_options(setup))
            if differing(record["metrics"], jsonable(facts(episode)["metrics"])):
                return None
            found[kind] = episode.thinned(TRAJECTORY_POINTS)
    return found


def _cell(protocol: Protocol, record: Record) -> Cell:
    for cell in protocol.cells((record["env_id"],), (record["track"],)):
        if cell.sweep is None:
            return cell
    raise ConfigurationError(f"protocol '{protocol.name}' has no {record['env_id']} on track '{record['track']}'")


def keep_traces(
    protocol: Protocol,
    runs: Sequence[Sequence[Record]],
    store: Trajectories,
    folders: Sequence[Path],
    made: Callable[[str, Record], Entrant],
    report: Callable[[int, int, str], None],
) -> dict[str, int]:
    """Simulate what the pages show of each run, and keep it.

    Parameters
    ----------
    protocol : Protocol
    runs : sequence of sequence of mapping
        As of `without_traces`.
    store : Trajectories
        Gets the traces.
    folders : sequence of Path
        Where the policies that the records name may lie.
    made : callable
        Flags of a record's replay command, and the record -> the entrant.
    report : callable
        Called with (done, total, text) before each run.

    Returns
    -------
    dict
        "kept", "without a policy" (its file is not there) and "not as recorded" -> number of runs.
    """
    count = {"kept": 0, "without a policy": 0, "not as recorded": 0}
    for done, run in enumerate(runs):
        report(done, len(runs), f"{run[0]['entrant']} on {run[0]['task']}")
        try:
            ((words, records),) = arguments_of(run, folders).items()
        except ConfigurationError:
            count["without a policy"] += 1
            continue
        found = typical_again(protocol, records, made(words, records[0]))
        if found is None:
            count["not as recorded"] += 1
            continue
        store.keep(run[0]["run"], found)
        count["kept"] += 1
    report(len(runs), len(runs), "done")
    return count
