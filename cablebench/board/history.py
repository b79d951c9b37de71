"""When the rows of a board were made, and with which version of the source code: from the records alone."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

Record = Mapping[str, Any]


@dataclass(frozen=True)
class Made:
    """What one entrant has on a board of one version of the source."""

    entrant: str
    version: str
    """of the package"""
    source: str
    """hash of the source code; empty where the records do not say"""
    first: str
    """day of the oldest record, UTC, as "2026-11-21"; empty where no record says"""
    last: str
    """day of the newest"""
    rankings: int
    """pairs of a task and a track"""
    episodes: int


def made_at(record: Record) -> datetime | None:
    """When a record was made, UTC; None where it does not say, as a record may say what it likes about that."""
    try:
        made = datetime.fromisoformat(record.get("created", ""))
    except ValueError:
        return None
    return made.astimezone(UTC) if made.tzinfo else made.replace(tzinfo=UTC)


def newest_date(records: Iterable[Record]) -> str:
    """When the newest record was made: the same records give the same board on every day."""
    dates = [made for record in records if (made := made_at(record))]
    return max(dates).strftime("%Y-%m-%d %H:%M UTC") if dates else "no date"


def history(records: Iterable[Record]) -> tuple[Made, ...]:
    """When each entrant's records were made, and with which versions of the source.

    Parameters
    ----------
    records : iterable of mapping
        Those that the board is made from.

    Returns
    -------
    tuple of Made
        The newest first, by the day of the last record and then by name.
    """
    groups: dict[tuple[str, str, str], list[Record]] = {}
    for r in records:
        versions = r.get("versions") or {}
        key = (r["entrant"], str(versions.get("cable-envs", "")), str(versions.get("source", "")))
        groups.setdefault(key, []).append(r)
    found = []
    for (entrant, version, source), own in groups.items():
        days = sorted(made.strftime("%Y-%m-%d") for r in own if (made := made_at(r)))
        first, last = (days[0], days[-1]) if days else ("", "")
        rankings = len({(r["task"], r["track"]) for r in own})
        found.append(Made(entrant, version, source, first, last, rankings, len(own)))
    found.sort(key=lambda m: (m.entrant, m.version, m.source))
    return tuple(sorted(found, key=lambda m: m.last, reverse=True))
