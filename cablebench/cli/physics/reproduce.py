"""``cablebench reproduce``: both papers recomputed, beside the printed numbers."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from cablebench.cli.shared.output import console, print_json, progress_bar


def reproduce(
    names: Annotated[
        list[str] | None, typer.Argument(help="Items, for example gu-table2 zou-table3; all when left out.")
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Folder for the report, the rows and the figures.")] = None,
    jobs: Annotated[int, typer.Option(min=0, help="Processes; 0: two, or one on a single core.")] = 0,
    as_list: Annotated[bool, typer.Option("--list", help="Only list the items.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="All rows and counts as JSON on standard output.")] = False,
) -> None:
    """Recompute the tables and figures of both papers and put each number beside the printed one.

    Ends with exit code 1 if an item could not be computed. A number that differs is a result, not a failure.
    """
    from cable_envs.reproduction import registry, report

    items = registry.find(names or ())
    if as_list:
        _list(items, as_json)
        return
    if out is not None:
        report.prepare(out)  # before minutes of computing
    results: list[registry.Result] = []
    with progress_bar() as update:
        workers = jobs or min(2, os.cpu_count() or 1)
        say = lambda name, share, text: update(name, round(100 * share), 100, text)  # noqa: E731
        results.extend(registry.run(items, say, workers))
    results = report.in_order(results)
    paths = report.write(results, out) if out is not None else None
    if as_json:
        print_json(report.as_json(results))
    else:
        _print(results, console())
    err = console(stderr=True)
    if paths is not None:
        err.print(f"report: {paths['html']}", markup=False)
    elif not as_json:
        err.print("Nothing was written: --out FOLDER keeps the report with all figures.", style="dim")
    failed = [r for r in results if r.error]
    for result in failed:
        err.print(f"{result.item} failed:\n{result.error}", markup=False)
    if failed:
        raise typer.Exit(1)


def _list(items: Sequence[Any], as_json: bool) -> None:
    from rich.table import Table

    from cable_envs.reproduction.registry import PAPERS

    if as_json:
        print_json([{"item": i.name, "title": i.title, "paper": PAPERS[i.paper], "seconds": i.seconds} for i in items])
        return
    table = Table(box=None, pad_edge=False)
    for name in ("item", "what", "seconds"):
        table.add_column(name, justify="right" if name == "seconds" else "left")
    for item in items:
        table.add_row(item.name, item.title, f"{item.seconds:g}")
    console().print(table)


def _print(results: Sequence[Any], out: Any) -> None:
    """How many rows of each item have which status, then every row that is not reproduced and why."""
    from rich.table import Table
    from rich.text import Text

    from cable_envs.reproduction.report import shown, total
    from cable_envs.reproduction.yardstick import REPRODUCED, STATUSES

    table = Table(box=None, pad_edge=False)
    table.add_column("item")
    for status in STATUSES:
        table.add_column(Text(f"{status.sign} {status.name}", status.colour), justify="right")
    table.add_column("time", justify="right")
    for r in results:
        cells = [
            Text(f"{n}" if n else "·", s.colour if n else "dim")
            for s, n in zip(STATUSES, r.counts.values(), strict=True)
        ]
        table.add_row(r.item, *([Text("failed", "red"), *cells[1:]] if r.error else cells), f"{r.seconds:.0f} s")
    if len(results) > 1:
        sums = (Text(f"{n}", s.colour) for s, n in zip(STATUSES, total(results).values(), strict=True))
        table.add_row("all", *sums, f"{sum(r.seconds for r in results):.0f} s")
    out.print(table)
    for r in results:
        for row in r.rows:
            status = row.status
            if status is REPRODUCED:
                continue
            unit = "" if row.unit == "1" else f" {row.unit}"
            head = f"\n{r.item}: {row.quantity}: published {shown(row.published)}, computed {shown(row.computed)}{unit}"
            out.print(Text(head), Text(f"{status.sign} {status.name}", status.colour))
            out.print(Text(f"  {row.why}", "dim"))
