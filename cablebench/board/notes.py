"""What a reader must know about a board before believing it: what is missing, left out, or less than asked for."""

from collections.abc import Sequence

from cablebench.board.scoring import Record
from cablebench.board.tables import Table
from cablebench.protocol.protocol import Protocol

REMARKS = "NOTES.md"
"""Remarks by people, in a board's folder: shown on the page and in board.md."""


def notes(
    everything: Sequence[Record],
    own: Sequence[Record],
    incomplete: Sequence[str],
    tables: Sequence[Table],
    protocol: Protocol,
) -> tuple[str, ...]:
    """Sentences about a board made from ``own`` of ``everything`` in the store; ``incomplete`` runs were left out."""
    found = [protocol.note, *_coverage(tables, protocol), *_seeds(tables, protocol)]
    rows = [r for t in tables for r in t.rows]
    if any(r.score is not None and r.score.single for r in rows):
        found.append(
            "The interval of a row with a single run is over test episodes only. It does not say how much another "
            "training would differ."
        )
    missing = [f"{t.task} ({t.track})" for t in tables if t.rows and t.rows[0].score is None]
    if missing and protocol.score_version:
        found.append(
            f"There are no scores where '{protocol.anchors}' has no anchors (`cablebench anchors`): "
            f"{', '.join(missing)}. Rows there are ordered by raw RMSE."
        )
    elif missing:
        found.append(
            "There are no scores where the open loop or the oracle is missing, or where the oracle is no better: "
            f"{', '.join(missing)}. Rows there are ordered by raw RMSE."
        )
    if incomplete:
        found.append(f"These were left out because some of their episodes are missing: {', '.join(incomplete)}.")
    return tuple(filter(None, [*found, *_others(everything, protocol), _mixture(own)]))


def _coverage(tables: Sequence[Table], protocol: Protocol) -> list[str]:
    """Tasks and tracks of the protocol that nobody ran, or ran on fewer episodes than it asks for."""
    asked: dict[tuple[str, str], int] = {}
    for cell in protocol.cells():
        if protocol.score_version and cell.sweep:
            continue  # no ranking: a column says what was survived
        key = (cell.task.short, cell.track.name)
        asked[key] = asked.get(key, 0) + cell.episodes
    found = {(t.task, t.track): max(r.episodes for r in t.rows) for t in tables}
    absent = [f"{task} ({track})" for task, track in asked if (task, track) not in found]
    thin = [
        f"{task} ({track}): {found[task, track]} of {n}"
        for (task, track), n in asked.items()
        if found.get((task, track), n) < n
    ]
    lines = []
    if absent:
        lines.append(
            f"Incomplete board: of the {len(asked)} rankings that the protocol asks for, these were not run: "
            f"{', '.join(absent)}."
        )
    if thin:
        lines.append(f"These have fewer test episodes than the protocol asks for: {', '.join(thin)}.")
    return lines


def _seeds(tables: Sequence[Table], protocol: Protocol) -> list[str]:
    """Learning agents with fewer training seeds than the protocol asks for, with the numbers."""
    few: dict[str, dict[str, int]] = {}
    for table in tables:
        for row in table.rows:
            if row.charged.get("environment_steps") and row.runs < protocol.training_seeds:
                known = few.setdefault(row.entrant, {})
                known[table.task] = min(row.runs, known.get(table.task, row.runs))
    if not few:
        return []
    texts = []
    for name, tasks in sorted(few.items()):
        counts = sorted(set(tasks.values()))
        where = ", ".join(tasks) if len(tasks) <= 2 else f"{len(tasks)} tasks"
        texts.append(f"{name} ({'-'.join(map(str, dict.fromkeys((counts[0], counts[-1]))))} on {where})")
    return [f"These have fewer than the protocol's {protocol.training_seeds} training seeds: {', '.join(texts)}."]


def _others(everything: Sequence[Record], protocol: Protocol) -> list[str]:
    """Records that do not belong: of other versions of the protocol, or of other configurations."""
    configuration = protocol.hash()
    versions: dict[int, int] = {}
    others = 0
    for r in everything:
        if r["protocol_hash"] == configuration:
            continue
        version = r.get("protocol_version", protocol.version)
        if r.get("protocol", protocol.name) == protocol.name and version != protocol.version:
            versions[version] = versions.get(version, 0) + 1
        else:
            others += 1
    lines = [
        f"{count} records of version {version} of the protocol were left out, because this board is of version "
        f"{protocol.version}."
        for version, count in sorted(versions.items())
    ]
    if others:
        lines.append(f"{others} records of other configurations in the store were left out.")
    return lines


def _mixture(own: Sequence[Record]) -> str:
    # an agent's records name further packages; what all name must agree
    common = sorted(set.intersection(*(set(r["versions"]) for r in own)))
    versions = {tuple(r["versions"][name] for name in common) for r in own}
    if len(versions) < 2:
        return ""
    return f"The records come from {len(versions)} different sets of package versions; the newest is listed."
