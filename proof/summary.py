"""What a proof says in a dozen lines: the table of README, from the proof's record.

``python -m cable_envs.proof.summary docs/proof/proof.json.xz`` prints it.
"""

import sys
from collections.abc import Mapping, Sequence
from typing import Any

from cable_envs.core.files import read_json
from cable_envs.proof.logs.by_kind import headline
from cable_envs.proof.report import cell, wanted
from cable_envs.proof.scoring import Row, of_laboratory, restored

LINES = (
    "effect adds more than 10 %: exact name",
    "effect adds more than 10 %: exact name or class",
    "effect adds 3 to 10 %: exact name",
    "effect adds 3 to 10 %: exact name or class",
    "effect adds 1 to 3 %: exact name",
    "effect adds 1 to 3 %: exact name or class",
    "effect adds 1 to 3 %: wrong name",
    "two effects at once: exact name or class of both",
    'physics outside the library: "unknown"',
    "nothing missing, white noise: something is reported",
    "nothing missing, coloured noise: something is reported",
    "only parameters wrong: an effect is named",
    "95 % intervals of parameters that contain the true value",
)
"""Rows of the proof that are shown."""
METHODS = {"diagnose": "`diagnose`", "no refit": "without refit", "sparse regression": "SINDy"}


def summary(record: Mapping[str, Any], methods: Mapping[str, str] = METHODS) -> str:
    """The headline figures of a proof as a Markdown table.

    A proof with logs as rigs make them has a table by kind of log, of the first method
    (`cable_envs.proof.logs.by_kind.headline`).

    Exact names, and names or classes, are lines of their own: an answer that gives several effects which the recording
    cannot tell apart, the right one among them, counts in the second only.

    Parameters
    ----------
    record : Mapping
        Record of a proof, as `cable_envs.proof.report.record` makes it.
    methods : Mapping
        Methods that get a column, by their names in the record, with the columns' headings.

    Returns
    -------
    str
        The table; shares of the first method with 95 % Clopper-Pearson limits, counts for all.

    Raises
    ------
    KeyError
        Where the record lacks a method or a row.
    """
    first, *others = methods
    own = [restored(case) for case in record["methods"][first]["cases"]]
    if not of_laboratory(own):
        return headline(own)
    rows = {method: {row["name"]: row for row in record["methods"][method]["rows"]} for method in methods}
    lines = [
        "| in the recording | wanted | " + " | ".join(methods.values()) + " |",
        "|---|--:|" + "--:|" * len(methods),
    ]
    for name in LINES:
        row = rows[first][name]
        cells = [_wanted(row), cell(_row(row)), *(_count(rows[method][name]) for method in others)]
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def _row(row: Mapping[str, Any]) -> Row:
    return Row(row["name"], row["count"], row["total"], row["direction"], row["reach"])


def _wanted(row: Mapping[str, Any]) -> str:
    """What was asked of the row before the proof, and whether it was missed: a rounded share may hide one case."""
    words = wanted(row)
    return f"{words}, missed" if row["reached"] is False else words


def _count(row: Mapping[str, Any]) -> str:
    return f"{row['count']} of {row['total']}" if row["total"] else "–"


def main(arguments: Sequence[str]) -> int:
    """Print the table of the record that is named."""
    if len(arguments) != 1:
        print(__doc__, file=sys.stderr)
        return 2
    print(summary(read_json(arguments[0])), end="")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
