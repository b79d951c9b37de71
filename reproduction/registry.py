"""The items, what each returns, and how they are run."""

import importlib
import multiprocessing
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from cable_envs.core.errors import ConfigurationError, nearest
from cable_envs.reproduction.rows import Number, Row
from cable_envs.reproduction.yardstick import STATUSES

PAPERS = {
    "gu": "Gu et al., Machines 2024, 12, 707: a cable through a hole",
    "zou": "Zou et al., Applied Sciences 2022, 12, 12126: a closed cable-pulley circuit",
}

Progress = Callable[[float, str], None]
"""progress(share, text): share done in [0, 1] and what is being done."""


@dataclass(frozen=True)
class Figure:
    """A figure of an item: file name without item and suffix, caption, SVG text (`reproduction.style.svg`)."""

    name: str
    caption: str
    svg: str
    wide: bool = True
    """whether it takes the page's width"""


@dataclass(frozen=True)
class Extra:
    """A table of the report that goes beyond the paper. Cells are text or numbers."""

    title: str
    columns: tuple[str, ...]
    rows: Sequence[Sequence[Number]]
    note: str = ""


@dataclass(frozen=True)
class Result:
    """What an item's ``reproduce`` returns; `run` fills in ``item``, ``seconds`` and, if it raised, ``error``."""

    rows: Sequence[Row]
    figures: Sequence[Figure] = ()
    tables: Sequence[Extra] = ()
    notes: Sequence[str] = ()
    why: str = ""
    """what came out of the item, in a sentence or two"""
    item: str = ""
    seconds: float = 0.0
    error: str = ""

    @property
    def counts(self) -> dict[str, int]:
        """How many rows have which status; all five are named."""
        found = [row.status for row in self.rows]
        return {status.name: found.count(status) for status in STATUSES}


@dataclass(frozen=True)
class Item:
    """An entry of the registry. ``module`` is imported when the item is run and has ``reproduce(progress)``."""

    name: str
    title: str
    module: str
    seconds: float
    """measured on one core of a two-core machine, kernels compiled; starts the longest first"""

    @property
    def paper(self) -> str:
        """Key of `PAPERS`."""
        return self.name.split("-")[0]

    def reproduce(self, progress: Progress) -> Result:
        """Run it here. An exception becomes ``Result.error``: one broken item must not take the others along."""
        start = time.perf_counter()
        try:
            result = importlib.import_module(f"cable_envs.reproduction.{self.module}").reproduce(progress)
        except Exception:
            result = Result((), error=traceback.format_exc())
        progress(1.0, "done")
        return replace(result, item=self.name, seconds=time.perf_counter() - start)


ITEMS: tuple[Item, ...] = (
    Item("gu-table2", "Identified parameters of nine cables (Tables 2, A1, Fig. 14)", "gu.table2", 120),
    Item("gu-fig12", "Tension ratio over wrap and speed (Fig. 12)", "gu.fig12", 5),
    Item("gu-fig13", "Compression and diameter over wrap and speed (Fig. 13, Table A1)", "gu.fig13", 5),
    Item("gu-fig15-17", "Sensitivity of the swarm to w, c1 and c2 (Figs. 15-17)", "gu.fig15_17", 65),
    Item("gu-fig18-19", "Inputs of the control experiments: step and sinusoid (Figs. 18, 19)", "gu.fig18_19", 3),
    Item("gu-fig20-25", "Step and sinusoid under MRAC, with and without extrusion (Figs. 20-25)", "gu.fig20_25", 15),
    Item("gu-tableA1", "Tracking error of nine cables under adaptive control (Table A1)", "gu.table_a1", 50),
    Item("zou-fig3", "Stretch of a wrapped part, loading and unloading (Fig. 3, Eqs. (12)-(21))", "zou.pulley.fig3", 5),
    Item("zou-fig4", "Pulleys on three supports (Fig. 4, Eqs. (22)-(30))", "zou.pulley.fig4", 2),
    Item("zou-table3", "Slip angles and tension ratios of the idlers (Table 3)", "zou.pulley.table3", 3),
    Item("zou-fig6", "Transmission characteristic and its phases (Fig. 6)", "zou.fig6", 5),
    Item("zou-eq48", "Friction between the cables and the grasp (Eq. (48))", "zou.eq48", 1),
    Item("zou-fig7", "What the torque saturator does to the grasp (Fig. 7)", "zou.fig7", 4),
    Item("zou-fig10", "Output angle and torque at three pretensions (Fig. 10)", "zou.fig10", 5),
    Item("zou-table4", "Errors at three pretensions, and their minimum near 50 N (Table 4)", "zou.table4", 60),
    Item("zou-fig11", "Estimated output at 25 N (Fig. 11)", "zou.fig11", 10),
    Item("zou-fig12", "Backlash compensation at 25 N (Fig. 12)", "zou.fig12", 20),
    Item("zou-fig14", "Surgical instrument with compensation (Fig. 14)", "zou.fig14", 20),
)
"""In the order of the papers."""


def find(names: Sequence[str] = ()) -> list[Item]:
    """Items of the registry by name.

    Parameters
    ----------
    names : sequence of str
        Names of items; empty: all.

    Returns
    -------
    list of Item
        In the order of the registry.

    Raises
    ------
    ConfigurationError
        With the nearest name for an unknown one.

    Examples
    --------
    >>> [item.paper for item in find(("zou-table3", "gu-fig12"))]
    ['gu', 'zou']
    """
    known = {item.name: item for item in ITEMS}
    for name in names:
        if name not in known:
            raise ConfigurationError(f"unknown item '{name}'; {nearest(name, known)}")
    return [item for item in ITEMS if not names or item.name in names]


def run(items: Sequence[Item], progress: Callable[[str, float, str], None], jobs: int = 1) -> Iterator[Result]:
    """Results of items as they are done.

    Parameters
    ----------
    items : sequence of Item
    progress : callable
        Called with (item's name, share done, text) in this process.
    jobs : int
        Processes.

    Yields
    ------
    Result
        In any order; an item that raised has its traceback in ``error``.
    """
    if jobs <= 1 or len(items) <= 1:
        for item in items:
            yield item.reproduce(partial(progress, item.name))
        return
    context = multiprocessing.get_context("spawn")  # fork would copy numba's and matplotlib's threads
    with context.Manager() as manager:
        messages = manager.Queue()
        with ProcessPoolExecutor(min(jobs, len(items)), mp_context=context) as pool:
            queue = sorted(items, key=lambda item: -item.seconds)
            futures = {pool.submit(_in_process, item, messages) for item in queue}
            while futures:
                finished = {f for f in futures if f.done()}
                while not messages.empty():
                    progress(*messages.get())
                for future in finished:
                    yield future.result()
                futures -= finished
                if futures and not finished:
                    _wait(futures)


def _wait(futures: set) -> None:
    try:
        next(as_completed(futures, timeout=0.2))
    except TimeoutError:
        return


def _in_process(item: Item, messages: Any) -> Result:
    return item.reproduce(lambda share, text: messages.put((item.name, share, text)))
