"""The HTML page of a blind proof, from its JSON record: table, confusion matrix, calibration. One file, no network."""

from collections.abc import Mapping, Sequence
from typing import Any

from cable_envs.drawing import pages
from cable_envs.drawing.charts import BLUE, GRID, INK, SOFT, svg
from cable_envs.proof.logs.by_kind import confidences, headline_rows
from cable_envs.proof.report import SMALL_PRINT, WORDS, limits_kept, missing_words, wanted
from cable_envs.proof.scoring import of_laboratory, restored


def render(record: Mapping[str, Any]) -> str:
    """The page as text; ``record``: what `cable_envs.proof.report.record` made."""
    from markupsafe import Markup

    methods = record["methods"]
    figures = [
        {
            "method": name,
            "matrix": Markup(matrix(method["confusion"])) if method["confusion"] else "",
            "calibration": Markup(calibration(method["calibration"])) if method["calibration"] else "",
        }
        for name, method in methods.items()
    ]
    content = {"record": record, "methods": methods, "rows": _rows(methods), "figures": figures, "words": WORDS}
    content |= {"broken": record["broken_rules"], "missing": missing_words(record), "small_print": SMALL_PRINT}
    content |= {"limits_kept": limits_kept(next(iter(methods), "nobody"), record["broken_rules"])}
    own = [restored(case) for case in next(iter(methods.values()), {"cases": []})["cases"]]
    content |= {"headline": () if of_laboratory(own) else headline_rows(own), "confidences": confidences(own)}
    return pages.render("cablebench.pages", "templates/proof.html.j2", content)


def _rows(methods: Mapping[str, Any]) -> list[dict[str, Any]]:
    first = next(iter(methods.values()))["rows"]
    return [
        {
            "name": row["name"],
            "wanted": wanted(row),
            "cells": [_cell(method["rows"][k]) for method in methods.values()],
        }
        for k, row in enumerate(first)
    ]


def _cell(row: Mapping[str, Any]) -> dict[str, str]:
    if row["share"] is None:
        return {"text": "–", "limits": "", "state": ""}
    limits = f"{100 * row['low']:.0f}–{100 * row['high']:.0f} %, {row['count']} of {row['total']}"
    state = {True: "reached", False: "missed", None: ""}[row["reached"]]
    return {"text": f"{100 * row['share']:.0f} %", "limits": limits, "state": state}


def matrix(confusion: Mapping[str, Mapping[str, int]]) -> str:
    """True names against answers; shade: share of the row, number: cases."""
    rows = sorted(confusion, key=lambda n: (n in ("nothing", "decoy", "strange"), n))
    answers = {a for row in confusion.values() for a in row}
    last = ("unknown", "no mismatch", "no verdict")
    columns = sorted(answers, key=lambda n: (n in last, n.startswith("class of"), n))

    def draw(figure: Any) -> None:
        ax = figure.subplots()
        for i, true in enumerate(rows):
            total = sum(confusion[true].values())
            for j, answer in enumerate(columns):
                count = confusion[true].get(answer, 0)
                if not count:
                    continue
                share = count / total
                ax.add_patch(_square(j, i, share))
                ax.text(j, i, str(count), ha="center", va="center", color="white" if share > 0.5 else INK, fontsize=7.5)
        ax.set(xlim=(-0.5, len(columns) - 0.5), ylim=(len(rows) - 0.5, -0.5), xlabel="answer", ylabel="truth")
        ax.set_xticks(range(len(columns)), [c.replace("_", " ") for c in columns], rotation=90)
        ax.set_yticks(range(len(rows)), [r.replace("_", " ") for r in rows])
        ax.set_axisbelow(True)
        width, height = figure.get_size_inches()
        figure.subplots_adjust(left=1.75 / width, right=1 - 0.1 / width, top=1 - 0.1 / height, bottom=1.85 / height)

    return svg(draw, 2.2 + 0.27 * len(columns), 2.2 + 0.24 * len(rows))


def _square(x: float, y: float, share: float) -> Any:
    from matplotlib.patches import Rectangle

    return Rectangle((x - 0.46, y - 0.46), 0.92, 0.92, facecolor=BLUE, alpha=0.12 + 0.88 * share, linewidth=0)


def calibration(bins: Sequence[Mapping[str, Any]]) -> str:
    """Stated confidence against the share that is right, with 95 % limits; on the dashed line it would be exact."""

    def draw(figure: Any) -> None:
        ax = figure.subplots()
        ax.plot([0, 1], [0, 1], color=SOFT, linestyle=(0, (4, 2)), linewidth=0.9)
        for b in bins:
            ax.plot([b["stated"]] * 2, b["limits"], color=BLUE, linewidth=1.1)
            ax.plot(b["stated"], b["share"], "o", color=BLUE, markersize=5)
            ax.annotate(
                str(b["answers"]),
                (b["stated"], b["share"]),
                (5, -9),
                textcoords="offset points",
                color=SOFT,
                fontsize=7.5,
            )
        ax.axvline(0.9, color=GRID, linewidth=0.8)
        ax.set(xlim=(0, 1.03), ylim=(0, 1.03), xlabel="stated confidence", ylabel="share right")
        figure.subplots_adjust(left=0.15, right=0.97, top=0.97, bottom=0.15)

    return svg(draw, 3.4, 3.2)
