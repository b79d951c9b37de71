"""Files of a run: rows as JSON, figures as SVG, and one page that needs nothing else."""

import json
import re
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from cable_envs.core.errors import ConfigurationError
from cable_envs.core.files import jsonable, write_atomic
from cable_envs.core.text import number
from cable_envs.drawing import pages
from cable_envs.reproduction.registry import ITEMS, PAPERS, Result
from cable_envs.reproduction.yardstick import KINDS, STATUSES


def as_json(results: Sequence[Result]) -> dict[str, Any]:
    """What ``--json`` prints and ``results.json`` holds.

    Parameters
    ----------
    results : sequence of Result
        In any order.

    Returns
    -------
    dict
        "statuses" and "kinds": what the words mean, with the tolerances; "items": name, title, seconds, counts of rows
        by status; "rows": every row, in the order of the registry.
    """
    results = in_order(results)
    titles = _titles(results)
    return {
        "statuses": {status.name: status.says for status in STATUSES},
        "kinds": {kind.name: {"agrees": kind.agrees, "says": kind.says} for kind in KINDS},
        "items": [
            {"item": r.item, "title": titles[r.item], "seconds": round(r.seconds, 1), "counts": r.counts}
            | ({"error": r.error} if r.error else {})
            for r in results
        ],
        "rows": [row.as_json(result.item) for result in results for row in result.rows],
    }


def _titles(results: Sequence[Result]) -> dict[str, str]:
    return {result.item: result.item for result in results} | {item.name: item.title for item in ITEMS}


def total(results: Sequence[Result]) -> dict[str, int]:
    """How many rows of all items have which status."""
    return {status.name: sum(result.counts[status.name] for result in results) for status in STATUSES}


def in_order(results: Sequence[Result]) -> list[Result]:
    """Results in registry order, whatever the order in which they were done."""
    place = {item.name: k for k, item in enumerate(ITEMS)}
    return sorted(results, key=lambda result: place.get(result.item, len(place)))


def write(results: Sequence[Result], folder: Path | str) -> dict[str, Path]:
    """Write the report of a run.

    Parameters
    ----------
    results : sequence of Result
    folder : Path or str
        It is made. ``results.json`` gets every row and the counts of all items, ``tables.json`` the tables beyond the
        papers, ``index.html`` the page, ``figures/<item>-<name>.svg`` each figure.

    Returns
    -------
    dict of Path
        "json", "tables", "html", "figures".

    Raises
    ------
    ConfigurationError
        Where the folder cannot be made.
    """
    folder = prepare(folder)
    for result in results:
        for figure in result.figures:
            path = folder / "figures" / f"{result.item}-{figure.name}.svg"
            write_atomic(path, standalone(figure.svg))
    paths = {
        "json": folder / "results.json",
        "tables": folder / "tables.json",
        "html": folder / "index.html",
        "figures": folder / "figures",
    }
    tables = [
        {
            "item": r.item,
            "title": t.title,
            "note": t.note,
            "columns": list(t.columns),
            "rows": [list(line) for line in t.rows],
        }
        for r in in_order(results)
        for t in r.tables
    ]
    write_atomic(paths["tables"], json.dumps(jsonable(tables), indent=1, ensure_ascii=False) + "\n")
    write_atomic(paths["json"], json.dumps(jsonable(as_json(results)), indent=1, ensure_ascii=False) + "\n")
    write_atomic(paths["html"], render_html(results))
    return paths


def prepare(folder: Path | str) -> Path:
    """Make the folder; ConfigurationError where that is not possible."""
    folder = Path(folder)
    try:
        (folder / "figures").mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigurationError(f"cannot write to {folder}: {error.strerror or error}") from error
    return folder


def standalone(svg: str) -> str:
    """An inline SVG element as a file of its own: printed at its size."""
    return '<?xml version="1.0" encoding="utf-8"?>\n' + svg + ("" if svg.endswith("\n") else "\n")


def render_html(results: Sequence[Result]) -> str:
    """The page of a run: what the words mean, and every item with its counts, figures and tables inline.

    Parameters
    ----------
    results : sequence of Result
        In any order.

    Returns
    -------
    str
        HTML that needs nothing else.
    """
    from markupsafe import Markup

    from cable_envs.core.provenance import machine, versions

    results = in_order(results)
    filters = {
        "number": shown,
        "percent": percent,
        "words": lambda cell: Markup(' class="words"') if _wordy(cell) else "",
        "inline": Markup,
        "plain": lambda text: re.sub(r"\s+", " ", text),
    }
    papers = [(PAPERS[key], [r for r in results if r.item.startswith(key + "-")]) for key in PAPERS]
    content = {
        "papers": [(name, found) for name, found in papers if found],
        "titles": _titles(results),
        "statuses": STATUSES,
        "kinds": KINDS,
        "counts": total(results),
        "seconds": sum(result.seconds for result in results),
        "created": datetime.now(UTC).strftime("%Y-%m-%d"),
        "versions": versions(),
        "machine": machine(),
    }
    return pages.render("cable_envs.reproduction", "templates/reproduction.html.j2", content, filters)


def shown(value: Any) -> str:
    """A cell: words as they are, numbers to four significant digits, a dash for none."""
    if isinstance(value, str):
        return value
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int) and abs(value) < 10**6:
        return f"{value}"
    return number(value, 4)


def _wordy(cell: Any) -> bool:
    """Whether a cell reads as text and goes to the left."""
    return isinstance(cell, str) and len(re.findall(r"[^\W\d_]{2,}", cell)) > 1


def percent(value: float | None) -> str:
    """A relative error in per cent.

    Examples
    --------
    >>> percent(0.0123), percent(-0.5), percent(0.0), percent(None)
    ('+1.2 %', '−50 %', '0 %', '–')
    """
    if value is None:
        return "–"
    return "0 %" if abs(value) < 5e-7 else f"{100 * value:+.2g} %".replace("-", "−")
