"""A board in five sentences, made from its own numbers: who leads, ties, agents, failures, robustness."""

import math
from collections.abc import Iterable, Sequence
from statistics import fmean

from cable_envs.plants import title_of
from cablebench.board.tables import Board, Row, Table

LISTED = 4
"""Names in a list before the rest is counted."""


def story(board: Board) -> tuple[str, ...]:
    """Five sentences on a board.

    Parameters
    ----------
    board : Board

    Returns
    -------
    tuple of str
        Who leads and with which interval; on which tasks the first two are not told apart; where trained agents lead
        and where they do not; what failed; what is survived away from the nominal rig. Open loop and oracles, which
        the scores are measured between, are left out of all of them.
    """
    return (_leaders(board), _ties(board), _agents(board), _failures(board), _robustness(board))


def main_track(board: Board) -> str:
    """The track that the sentences are about: the last one of the protocol on the board that has no sweeps."""
    found = {t.track for t in board.tables}
    names = [t.name for t in board.protocol.tracks if t.name in found]
    return next((n for n in reversed(names) if not board.protocol.track(n).sweeps), names[-1])


def _competes(row: Row, board: Board) -> bool:
    ends = (board.protocol.open_loop, board.protocol.oracle)
    return row.information != "oracle" and row.entrant not in ends


def scored(table: Table, board: Board) -> list[Row]:
    """The rows that have a score and compete, best first, over all classes."""
    rows = [r for r in table.rows if r.score is not None and _competes(r, board)]
    return sorted(rows, key=lambda r: (-_value(r), r.entrant))


def _value(row: Row) -> float:
    return row.score.value if row.score else math.nan


def apart(table: Table, first: Row, second: Row, level: float) -> bool:
    """Whether two rows differ: after Holm's correction where pairs were compared, else by intervals that are apart."""
    for pair in table.pairs:
        if {pair.first, pair.second} == {first.entrant, second.entrant}:
            return pair.adjusted < 1.0 - level
    a, b = first.score, second.score
    return a is not None and b is not None and (a.low > b.high or b.low > a.high)


def _with_interval(row: Row) -> str:
    s = row.score
    return f"{s.value:.2f} [{s.low:.2f}, {s.high:.2f}]".replace("-", "−") if s else "–"


def _names(names: Sequence[str]) -> str:
    """As "a, b and c", or "a, b, c, d and 3 more"."""
    if len(names) > LISTED + 1:
        return f"{', '.join(names[:LISTED])} and {len(names) - LISTED} more"
    return " and ".join(filter(None, [", ".join(names[:-1]), names[-1]]))


def _tasks(count: int) -> str:
    return "1 task" if count == 1 else f"{count} tasks"


def _second(rows: Sequence[Row]) -> Row | None:
    """The best row with other scores than the first: one law under two names scores the same to the last digit."""
    return next((r for r in rows[1:] if r.scores != rows[0].scores), None)


def _leaders(board: Board) -> str:
    track, level = main_track(board), f"{100 * board.protocol.level:g} %"
    overall = [t for t in board.overall if t.track == track and scored(t, board)]
    single = _single(board)
    whole = [t for t in overall if not t.family] or overall
    if not whole and len(single) <= LISTED:
        whole = single
    if whole:
        return f"{'; '.join(_leader(table, board) for table in whole)} ({track} track, {level} intervals)."
    if not single:
        return "No entrant has a score on this board, so that rows are ordered by their raw error."
    wins = _totals((scored(table, board)[0].entrant, 1) for table in single)
    ordered = sorted(wins, key=lambda n: (-wins[n], n))
    text = ", ".join(f"{name} leads on {_tasks(wins[name])}" for name in ordered)
    return f"No entrant is in a table over several tasks; on single ones {text} ({track} track)."


def _leader(table: Table, board: Board) -> str:
    rows = scored(table, board)
    first, second = rows[0], _second(rows)
    if table.task:
        where = table.task
    else:
        where = f"{title_of(table.family) if table.family else 'The whole suite'}, {_tasks(table.tasks)}"
    text = f"{where}: {first.entrant} leads with a score of {_with_interval(first)}"
    if second is None:
        return text
    differ = "differ" if apart(table, first, second, board.protocol.level) else "are not told apart"
    return f"{text} before {second.entrant} with {_with_interval(second)}, and the two {differ}"


def _single(board: Board) -> list[Table]:
    """Tables of the main track that have a score."""
    track = main_track(board)
    return [t for t in board.tables if t.track == track and scored(t, board)]


def _ties(board: Board) -> str:
    found = [(t, rows[0], second) for t in _single(board) if (second := _second(rows := scored(t, board)))]
    if not found:
        return "No task has two entrants with different scores to tell apart."
    level, count = board.protocol.level, len(found)
    tied = [table.task for table, first, second in found if not apart(table, first, second, level)]
    how = f"p above {1.0 - level:.2g} after Holm's correction" if found[0][0].pairs else "their intervals overlap"
    if not tied:
        return f"On {_all(count)} the first entrant is told apart from the second."
    on = _all(count) if len(tied) == count else f"{len(tied)} of {_tasks(count)}"
    return f"On {on} the first two entrants are not told apart ({how}): {_names(tied)}."


def _all(count: int) -> str:
    return {1: "the only task", 2: "both tasks"}.get(count, f"all {count} tasks")


def _is_agent(row: Row) -> bool:
    return bool(row.charged.get("environment_steps"))


def _agents(board: Board) -> str:
    if not any(_is_agent(r) for t in board.tables for r in t.rows):
        return "No trained agent is on this board."
    leads, behind, nothing, count = [], [], [], 0
    for table in _single(board):
        rows = scored(table, board)
        agents, others = ([r for r in rows if _is_agent(r) is kind] for kind in (True, False))
        if not agents or not others:
            continue
        count += 1
        best, other = agents[0], others[0]
        if _value(best) > _value(other):
            leads.append(table.task)
        elif apart(table, best, other, board.protocol.level):
            behind.append(table.task)
        if _value(best) <= 0.0:
            nothing.append(table.task)
    if not count:
        return "Trained agents are on this board, and on no task do a controller and an agent both have a score."
    text = f"Trained agents lead on {len(leads)} of {_tasks(count)}; "
    if behind:
        text += f"on {len(behind)} a controller is better and told apart from them ({_names(behind)}), "
    else:
        text += "on none is a controller better and told apart from them, "
    if nothing:
        return text + f"and on {len(nothing)} no agent scores above 0, the score of doing nothing ({_names(nothing)})."
    return text + "and on each of them an agent scores above 0, the score of doing nothing."


def _failures(board: Board) -> str:
    rows = [(t, r) for t in board.tables for r in t.rows if _competes(r, board)]
    episodes = sum(r.runs * r.episodes for _, r in rows)
    failed = sum(r.failures for _, r in rows)
    if not failed:
        return f"None of the {_count(episodes)} test episodes failed (open loop and oracle not counted)."
    task = _most((t.task, r.failures) for t, r in rows)
    entrant = _most((r.entrant, r.failures) for _, r in rows)
    rules = _totals((name, n) for _, r in rows for name, n in r.violations.items())
    text = f"{_count(failed)} of {_count(episodes)} test episodes failed (open loop and oracle not counted), "
    text += f"most on {task[0]} ({task[1]}) and by {entrant[0]} ({entrant[1]})"
    if rules:
        ordered = sorted(rules, key=lambda n: (-rules[n], n))
        text += "; the rules broken: " + ", ".join(f"{name} {_count(rules[name])}" for name in ordered)
    return text + "."


def _count(value: int) -> str:
    return f"{value:,}".replace(",", "\N{NARROW NO-BREAK SPACE}")


def _totals(pairs: Iterable[tuple[str, int]]) -> dict[str, int]:
    found: dict[str, int] = {}
    for name, n in pairs:
        found[name] = found.get(name, 0) + n
    return found


def _most(pairs: Iterable[tuple[str, int]]) -> tuple[str, int]:
    totals = _totals(pairs)
    return min(totals.items(), key=lambda item: (-item[1], item[0]))


def _robustness(board: Board) -> str:
    competing = {r.entrant for t in board.tables for r in t.rows if _competes(r, board)}
    values: dict[str, list[float]] = {}
    by_sweep: dict[str, list[float]] = {}
    for line in board.sweeps:
        if line["entrant"] in competing and math.isfinite(line["robustness"]):
            values.setdefault(line["entrant"], []).append(line["robustness"])
            by_sweep.setdefault(line["sweep"], []).append(line["robustness"])
    if not values:
        return "No entrant was run away from its rig on sweeps, so this board says nothing of robustness."
    most = max(map(len, values.values()))
    whole = {name: fmean(v) for name, v in values.items() if len(v) == most}
    best = min(whole, key=lambda n: (-whole[n], n))
    hardest = min(by_sweep, key=lambda s: (fmean(by_sweep[s]), s))
    least = fmean(by_sweep[hardest])
    of = "the only one on all sweeps" if len(whole) == 1 else f"of {len(whole)} entrants on all sweeps"
    if board.protocol.score_version:
        return (
            f"Most robust is {best} ({of}), which survives {100 * whole[best]:.0f} % of the swept values; hardest is "
            f"{hardest}, of which entrants survive {100 * least:.0f} % on average."
        )
    return (
        f"Most robust is {best} ({of}) with a mean score of {whole[best]:.2f} over the sweeps; hardest is {hardest}, "
        f"where the entrants' mean is {least:.2f}."
    ).replace("-0.", "−0.")
