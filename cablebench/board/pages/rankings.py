"""The rankings of a board's page: columns with units, rows by information class, interval bars, raw values."""

import math
from collections.abc import Sequence
from typing import Any

from cable_envs.core.text import count
from cablebench.board.cells import censored, failures, improvement, main_metrics, placed, remarks
from cablebench.board.pages.figures import Style
from cablebench.board.suite import RANKED
from cablebench.board.tables import Row, Table
from cablebench.entrants.entrant import BUDGETS, INFORMATION
from cablebench.protocol.metrics import METRICS
from cablebench.protocol.units import shown, unit_of

_RAW = tuple(m for m in METRICS if not m.name.endswith("_censored") and m.name not in ("failed", "peak_tension"))


_ROBUST = "share of the values of disturbance, delay, noise and friction that were survived"

_FAILED = {
    False: "episodes that did not run to their end",
    True: "episodes that break a rule: torn, ended by a rule of the task, dropped, runaway, slack, overload",
}


def _ranked_columns(table: Table) -> list[dict[str, str]]:
    """Headings of what has a place of its own beside the score."""
    return [
        {"key": m, "label": name, "unit": unit_of(m, table) if table.task else "mean place", "title": _meaning(m)}
        for m, name in RANKED.items()
    ]


def ranking(table: Table, style: Style, markup: Any) -> dict[str, Any]:
    """A table for the template: columns with units, rows by information class, cells with text and sorting value."""
    metrics = main_metrics(table.task, (row.raw for row in table.rows))
    suite = table.score_version > 0
    columns = [
        {"key": "runs", "label": "runs", "unit": "seeds", "title": "training seeds"},
        {"key": "score", "label": "score", "unit": "IQM", "title": "interquartile mean"},
        {"key": "median", "label": "median", "unit": "", "title": "median score"},
        {"key": "gap", "label": "gap", "unit": "", "title": "optimality gap: mean shortfall below 1"},
        {
            "key": "worst_tenth",
            "label": "worst 10\N{NO-BREAK SPACE}%",
            "unit": "CVaR",
            "title": "mean of the worst tenth of the rigs" if suite else "mean of the lowest tenth of the scores",
        },
        *([{"key": "robustness", "label": "robust", "unit": "%", "title": _ROBUST}] if suite else []),
        {
            "key": "improvement",
            "label": "better than",
            "unit": "paper, %",
            "title": "probability of improvement over the papers' controller",
        },
        *({"key": m, "label": _label(m), "unit": unit_of(m, table), "title": _meaning(m)} for m in metrics),
        *(_ranked_columns(table) if suite else ()),
        {"key": "failed", "label": "failed", "unit": "episodes", "title": _FAILED[suite]},
        {"key": "environment_steps", "label": "env", "unit": "steps", "title": "environment steps charged"},
        {"key": "tuning_trials", "label": "tuning", "unit": "trials", "title": "tuning trials charged"},
        {
            "key": "identification_samples",
            "label": "ident.",
            "unit": "samples",
            "title": "identification samples charged",
        },
    ]
    groups = [
        {"name": name, "rows": [_row(r, table, metrics, style, markup) for r in table.rows if r.information == name]}
        for name in INFORMATION
        if any(r.information == name for r in table.rows)
    ]
    raw = [m for m in _RAW if any(math.isfinite(r.raw.get(m.name, math.nan)) for r in table.rows)]
    caption = f"{max(r.episodes for r in table.rows)} test episodes in a run; a run is one training seed."
    if suite:
        caption = " ".join([caption, *remarks(table)])
    elif table.omitted:
        caption += f" Left out, because they did not run all {table.tasks} tasks: {', '.join(table.omitted)}."
    return {
        "track": table.track,
        "task": table.task,
        "tasks": table.tasks,
        "caption": caption,
        "columns": columns,
        "groups": groups,
        "raw_columns": [
            {"key": m.name, "label": _label(m.name), "unit": unit_of(m.name, table), "title": m.meaning} for m in raw
        ],
        "raw_rows": [
            {"name": r.entrant, "information": r.information, "cells": [_cell(r, m.name, table) for m in raw]}
            for r in table.rows
        ],
    }


def _label(name: str) -> str:
    return next(m.label for m in METRICS if m.name == name).replace(" %", "\N{NO-BREAK SPACE}%")


def _meaning(name: str) -> str:
    return next(m.meaning for m in METRICS if m.name == name)


def _cell(row: Row, name: str, table: Table) -> dict[str, Any]:
    text = shown(row.raw[name], name, table)
    return {"text": f"> {text}" if censored(row, name) else text, "value": row.raw[name], "bad": False}


def _placed_cell(row: Row, name: str, table: Table) -> dict[str, Any]:
    value = row.places.get(name, math.nan) if table.tasks > 1 else row.raw[name]
    return {"text": placed(row, name, table), "value": value, "bad": False}


def _row(row: Row, table: Table, metrics: Sequence[str], style: Style, markup: Any) -> dict[str, Any]:
    def score(value: float | None) -> dict[str, Any]:
        text = "–" if value is None else f"{value:.2f}".replace("-", "−")
        return {"text": text, "value": "nan" if value is None else value, "bad": value is not None and value < 0}

    better = math.nan if row.improvement is None else 100 * row.improvement
    suite = table.score_version > 0
    robust = math.nan if row.robustness is None else 100 * row.robustness
    shown_better = improvement(row).replace(" %", "") if suite else "–" if math.isnan(better) else f"{better:.0f}"
    return {
        "name": row.entrant,
        "information": row.information,
        "rank": row.rank,
        "bar": markup(_bar(row, style[row.entrant]["color"])),
        "cells": [
            {"text": str(row.runs), "value": row.runs, "bad": False},
            score(row.score.value if row.score else None),
            score(row.median),
            score(row.optimality_gap),
            score(row.worst_tenth),
            *(
                [{"text": "–" if math.isnan(robust) else f"{robust:.0f}", "value": robust, "bad": False}]
                if suite
                else []
            ),
            {"text": shown_better, "value": better, "bad": False},
            *(_cell(row, m, table) for m in metrics),
            *(_placed_cell(row, m, table) for m in (RANKED if suite else ())),
            {"text": failures(row), "value": row.failures, "bad": row.failures > 0},
            *({"text": count(row.charged.get(k, 0)), "value": row.charged.get(k, 0), "bad": False} for k in BUDGETS),
        ],
    }


_BAR = (-1.0, 1.25, 180, 20)
"""Axis of the interval bars: lowest and highest score, width and height in pixels."""


def _bar_x(score: float) -> float:
    low, high, width, _ = _BAR
    return round(8 + (width - 16) * (min(max(score, low), high) - low) / (high - low), 1)


def bar_axis() -> str:
    """The axis of the bars, for the table's head."""
    width = _BAR[2]
    labels = "".join(
        f'<text x="{_bar_x(v)}" y="10" text-anchor="middle" font-size="11" fill="#5b6770">{t}</text>'
        for v, t in ((-1, "−1"), (0, "0"), (1, "1"))
    )
    return f'<svg width="{width}" height="13" viewBox="0 0 {width} 13" aria-hidden="true">{labels}</svg>'


def _bar(row: Row, colour: str) -> str:
    """The interval as a line with its point; hollow where it is over episodes of a single run."""
    if row.score is None:
        return ""
    s, (_, _, width, height), x = row.score, _BAR, _bar_x
    ticks = "".join(
        f'<line x1="{x(v)}" x2="{x(v)}" y1="1" y2="{height - 1}" stroke="{"#b9c1c7" if v in (0, 1) else "#e6eaed"}"/>'
        for v in (-1, -0.5, 0, 0.5, 1)
    )
    fill = "#ffffff" if s.single else colour
    middle = height // 2
    return (
        f'<svg width="{width}" height="{height}" viewBox="0 0 {width} {height}" role="img" '
        f'aria-label="{s.value:.2f}, interval {s.low:.2f} to {s.high:.2f}, over {s.unit}">{ticks}'
        f'<line x1="{x(s.low)}" x2="{x(s.high)}" y1="{middle}" y2="{middle}" stroke="{colour}" stroke-width="3" '
        f'stroke-linecap="round"/>'
        f'<circle cx="{x(s.value)}" cy="{middle}" r="4" fill="{fill}" stroke="{colour}" stroke-width="2"/></svg>'
    )
