"""What a command says: JSON and tables on standard output, progress and remarks on standard error."""

import logging
import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from cable_envs.core.files import json_text


def print_json(data: Any) -> None:
    """``data`` as JSON on standard output, and nothing else there."""
    sys.stdout.write(json_text(data))


FILE_WIDTH = 160
"""Columns of a table that goes to a file or a pipe; a terminal has its own width."""


def console(stderr: bool = False) -> Any:
    """A rich console; results go to standard output, progress and remarks to standard error."""
    from rich.console import Console

    made = Console(stderr=stderr, highlight=False, soft_wrap=True)
    if not made.is_terminal and "COLUMNS" not in os.environ:
        made.width = FILE_WIDTH
    return made


@contextmanager
def remarks_shown() -> Iterator[None]:
    """Within the block the remarks of `cable_envs` (that it compiles something) go to standard error.

    A program that has set the level of the logger ``cable_envs`` has its way.
    """
    log, shown = logging.getLogger("cable_envs"), logging.StreamHandler(sys.stderr)
    before = log.level
    if before == logging.NOTSET:
        log.setLevel(logging.INFO)
    log.addHandler(shown)
    try:
        yield
    finally:
        log.removeHandler(shown)
        log.setLevel(before)


PLAIN_INTERVAL = 15.0
"""s between progress lines where standard error is no terminal."""


@contextmanager
def progress_bar() -> Iterator[Any]:
    """Progress on standard error; yields ``update(name, done, total, text="")``, which makes a bar for each name.

    Where standard error is no terminal, a line now and then takes the place of the bars.
    """
    err = console(stderr=True)
    bars: Any = _bars(err) if err.is_terminal else None
    known: dict[str, Any] = {}

    def draw(name: str, done: int, total: int, text: str = "") -> None:
        if not known:
            bars.start()
        if name not in known:
            known[name] = bars.add_task(name, total=total, text=text)
        bars.update(known[name], completed=done, total=total, text=text)

    def write(name: str, done: int, total: int, text: str = "") -> None:
        now = time.monotonic()
        if now - known.setdefault(name, now) >= PLAIN_INTERVAL:
            known[name] = now
            err.print(f"{name}: {done} of {total}, {text}", markup=False)

    try:
        yield write if bars is None else draw
    finally:
        if bars is not None and known:
            bars.stop()


def _bars(err: Any) -> Any:
    from rich import progress

    columns = (
        progress.TextColumn("{task.description}"),
        progress.BarColumn(24),
        progress.TaskProgressColumn(),
        progress.TimeElapsedColumn(),
        progress.TimeRemainingColumn(),
        progress.TextColumn("{task.fields[text]}", style="dim"),
    )
    return progress.Progress(*columns, console=err, transient=True)
