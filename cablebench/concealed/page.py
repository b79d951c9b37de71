"""Tables of the concealed track in Markdown, between two marks of a page that people have written."""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from cable_envs.core.errors import ConfigurationError
from cable_envs.core.files import write_atomic
from cable_envs.core.intervals import Interval
from cable_envs.core.text import between_marks, markdown_text
from cablebench.concealed import worth
from cablebench.concealed.entrants import ROWS
from cablebench.concealed.hidden import KINDS
from cablebench.concealed.mechanism import load_mechanism, mechanisms
from cablebench.protocol.units import shown, unit_of

FEWEST = 5
"""Rigs that an interval takes."""
BEGIN, END = "<!-- begin: cablebench concealed -->", "<!-- end: cablebench concealed -->"


def tables(result: Mapping[str, Any]) -> str:
    """The tables of a result: for each mechanism the rows, what a diagnosis is worth, and the rigs.

    Parameters
    ----------
    result : mapping
        Mechanism -> its rigs, as `cablebench.concealed.track.run` gives them.

    Returns
    -------
    str
        Markdown.
    """
    return "\n".join(line for name, rigs in result.items() for line in _of_mechanism(name, rigs))


def write_tables(page: Path, result: Mapping[str, Any]) -> None:
    """Put the tables of a result between the marks of a page; those there of other mechanisms stay.

    Parameters
    ----------
    page : Path
        A Markdown file with both marks.
    result : mapping
        As of `tables`.

    Raises
    ------
    ConfigurationError
        Where the page lacks a mark.
    """
    write_atomic(page, _with_tables(page, {name: tables({name: rigs}) for name, rigs in result.items()}))


def require_page(page: Path) -> None:
    """A page that can take the tables, asked before hours go into these; ConfigurationError where it cannot."""
    _with_tables(page, {})


def _with_tables(page: Path, made: Mapping[str, str]) -> str:
    if not page.is_file():
        raise ConfigurationError(f"no page {page}: expected a Markdown file with the lines '{BEGIN}' and '{END}'")
    text = page.read_text(encoding="utf-8")
    _, _, old = text.partition(BEGIN)
    parts = re.split(r"^(?=## )", old.partition(END)[0], flags=re.MULTILINE)
    kept = {part.partition("\n")[0]: part.strip() for part in parts[1:]}
    heads = {f"## {load_mechanism(name).title}": name for name in mechanisms()}
    order = [head for head in kept if head in heads] + [head for head in heads if head not in kept]
    sections = [made.get(heads[head]) or kept.get(head, "") for head in order]
    return between_marks(text, BEGIN, END, "\n\n".join(part.strip() for part in sections if part))


def _of_mechanism(name: str, rigs: Sequence[worth.Rig]) -> list[str]:
    mechanism = load_mechanism(name)
    task = mechanism.env.rpartition("/")[2]
    episodes = len(next(iter(rigs[0]["rows"].values()))["scores"])
    lines = [
        f"## {mechanism.title}", "",
        f"{len(rigs)} hidden rigs, {episodes} episodes of `{task}` on each.", "",
        "| row | uses | score | ahead of the nominal controller | " + " | ".join(KINDS) + " | median error | failed |",
        "|---|---|---|---|" + "--:|" * (len(KINDS) + 2),
    ]  # fmt: skip
    unit = _unit(mechanism.env)
    for entry in worth.standing(rigs):
        told = ROWS[entry["row"]].told if entry["row"] in ROWS else "as its file says"
        cells = [
            f"`{markdown_text(entry['row'])}`", told, _interval(entry["score"]),
            _interval(entry["ahead"], "+") if "ahead" in entry else "–",
            *("–" if value is None else f"{value:.2f}" for value in entry["kinds"].values()),
            f"{shown(entry['error'], 'rmse', unit)} {unit_of('rmse', unit)}",
            f"{entry['failed']} of {entry['episodes']}",
        ]  # fmt: skip
        lines.append(f"| {' | '.join(cells)} |")
    rows = worth.rows_of(rigs)
    for who in ("controller", "agent"):
        with_it, without, oracle = f"diagnosed-{who}", f"nominal-{who}", f"oracle-{who}"
        if {with_it, without, oracle} <= set(rows):
            lines += _worth(rigs, who, with_it, without, oracle)
    lines += _episodes_saved(rigs, [row for row in ("diagnosed-controller", "diagnosed-agent") if row in rows])
    return [*lines, "", *_rigs(rigs), ""]


def _worth(rigs: Sequence[worth.Rig], who: str, with_it: str, without: str, oracle: str) -> list[str]:
    lines = [
        "", f"What the diagnosis is worth to the {who}: error without it over error with it, geometric mean.", "",
        "| the diagnosis answered | rigs | `" + without + "` / `" + with_it + "` | `" + without + "` / `" + oracle
        + "` | smaller error with it |", "|---|--:|---|---|--:|",
    ]  # fmt: skip
    for one in worth.diagnosis(rigs, with_it, without, oracle):
        times = [_interval(x) if one["rigs"] >= FEWEST else f"{x.value:.2f}" for x in (one["times"], one["oracle"])]
        cells = [one["answer"], str(one["rigs"]), *times]
        lines.append(f"| {' | '.join(cells)} | {one['better']} of {one['rigs']} |")
    return lines


def _episodes_saved(rigs: Sequence[worth.Rig], diagnosed: Sequence[str]) -> list[str]:
    by_row = {row: worth.episodes_saved(rigs, row) for row in diagnosed}
    counts = next(iter(by_row.values()), [])
    if not counts:
        return []
    lines = [
        "", "Gains chosen by episodes on the hidden rig itself, against the rows with a diagnosis:", "",
        "| episodes on the rig | score | " + " | ".join(f"`{row}` is ahead by" for row in by_row) + " |",
        "|--:|---|" + "---|" * len(by_row),
    ]  # fmt: skip
    for same in zip(*by_row.values(), strict=True):
        ahead = " | ".join(_interval(one["ahead"], "+") for one in same)
        lines.append(f"| {same[0]['episodes']} | {_interval(same[0]['score'])} | {ahead} |")
    return lines


def _rigs(rigs: Sequence[worth.Rig]) -> list[str]:
    rows = [r for r in ("nominal-controller", "diagnosed-controller", "oracle-controller") if r in worth.rows_of(rigs)]
    lines = ["| rig | concealed | answered | named | " + " | ".join(f"`{row}`" for row in rows) + " |",
             "|--:|---|---|---|" + "--:|" * len(rows)]  # fmt: skip
    for rig in rigs:
        hidden = rig["hidden"]
        concealed = ", ".join(
            markdown_text(f"{effect}.{name} = {value:.3g}")
            for effect, numbers in hidden["effects"].items() for name, value in numbers.items()
        )  # fmt: skip
        named = rig["answer"]["named"] if rig["answer"] else ()
        cells = [str(hidden["number"]), concealed, worth.answered(rig) or "–", markdown_text(", ".join(named))]
        lines.append(f"| {' | '.join([*cells, *(f'{worth.score(rig, row):.2f}' for row in rows)])} |")
    return lines


def _interval(found: Interval, sign: str = "") -> str:
    return f"{found.value:{sign}.2f} [{found.low:{sign}.2f}, {found.high:{sign}.2f}]"


def _unit(env_id: str) -> Any:
    from types import SimpleNamespace

    from cable_envs.sim.registered import setup_of

    setup = setup_of(env_id, {})
    return SimpleNamespace(output_unit=setup.output_unit, command_unit=setup.action_mode.unit)
