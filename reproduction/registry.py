"""The items, what each returns, and how they are run."""

import importlib
import math
import multiprocessing
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from cable_envs.core.errors import ConfigurationError, nearest

REPRODUCED, DIFFERS, NOT_REPRODUCIBLE = STATUSES = ("reproduced", "differs", "not reproducible")
PAPERS = {
    "gu": "Gu et al., Machines 2024, 12, 707: a cable through a hole",
    "zou": "Zou et al., Applied Sciences 2022, 12, 12126: a closed cable-pulley circuit",
}

Progress = Callable[[float, str], None]
"""progress(share, text): share done in [0, 1] and what is being done."""
Number = float | int | str | None


@dataclass(frozen=True)
class Row:
    """A printed number or claim beside the computed one. ``published``, ``computed``: numbers, words, or None."""

    quantity: str
    published: Number
    computed: Number
    unit: str
    status: str
    why: str = ""
    """the reason of a difference, what the paper does not tell, or how exact "reproduced" is"""

    def __post_init__(self):
        if self.status not in STATUSES:
            raise ValueError(f"status '{self.status}'; {nearest(self.status, STATUSES)}")
        if self.status != REPRODUCED and not self.why:
            raise ValueError(f"{self.quantity}: '{self.status}' needs a reason")

    @property
    def rel_error(self) -> float | None:
        """(computed - published) / |published|; None where either is no number or nothing but zero was printed."""
        published, computed = self.published, self.computed
        if isinstance(published, str) or isinstance(computed, str) or computed is None or not published:
            return None
        if not (math.isfinite(published) and math.isfinite(computed)):
            return None
        return (computed - published) / abs(published)

    def as_json(self, item: str) -> dict[str, Any]:
        """The row of ``--json``; numbers that are not finite become null."""
        return {
            "item": item, "quantity": self.quantity, "published": _plain(self.published),
            "computed": _plain(self.computed), "unit": self.unit, "rel_error": self.rel_error, "status": self.status,
            "why": self.why,
        }  # fmt: skip


def _plain(value: Number) -> Number:
    if value is None or isinstance(value, str):
        return value
    return float(value) if math.isfinite(value) else None


def compare(
    quantity: str,
    published: float,
    computed: float,
    unit: str,
    tolerance: float,
    *,
    why: str = "",
    differs: str = "",
    absolute: bool = False,
) -> Row:
    """A number of a paper beside the computed one.

    Parameters
    ----------
    quantity : str
        What it is, in words.
    published, computed : float
        In ``unit``.
    unit : str
        SI, "1" for a ratio.
    tolerance : float
        Relative, or in ``unit`` if ``absolute``.
    why : str
        Explains a reproduced number.
    differs : str
        Explains one that is not reproduced; without it a general sentence does.
    absolute : bool
        What ``tolerance`` means.

    Returns
    -------
    Row
        Reproduced within the tolerance, differing beyond it.

    Examples
    --------
    >>> compare("slip angle", 1.20, 1.21, "rad", 0.02).status
    'reproduced'
    """
    error = abs(computed - published)
    if error <= tolerance * (1.0 if absolute else abs(published)):
        return Row(quantity, published, computed, unit, REPRODUCED, why)
    size = f"{tolerance:g} {unit}" if absolute else f"{100 * tolerance:g} %"
    return Row(quantity, published, computed, unit, DIFFERS, differs or f"further off than {size}, reason not found")


def claim(quantity: str, published: str, computed: Number, holds: bool, why: str, unit: str = "") -> Row:
    """A statement of a paper in words, and whether the computation bears it out.

    Parameters
    ----------
    quantity : str
        What the statement is about.
    published : str
        The statement.
    computed : float, str or None
        What was computed.
    holds : bool
        Whether the statement holds.
    why : str
        How that is seen.
    unit : str
        Of the computed number.

    Returns
    -------
    Row
    """
    return Row(quantity, published, computed, unit, REPRODUCED if holds else DIFFERS, why)


def not_reproducible(quantity: str, published: Number, computed: Number, unit: str, why: str) -> Row:
    """A number whose inputs the paper does not tell.

    Parameters
    ----------
    quantity : str
        What it is, in words.
    published, computed : float, str or None
        As printed, and with the inputs that were assumed.
    unit : str
        Of both.
    why : str
        Which inputs are missing.

    Returns
    -------
    Row
    """
    return Row(quantity, published, computed, unit, NOT_REPRODUCIBLE, why)


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
    """the item's verdict in one sentence"""
    item: str = ""
    seconds: float = 0.0
    error: str = ""

    @property
    def status(self) -> str:
        """Verdict of the whole item.

        One row that differs makes the item differ; it is not reproducible when none of its rows is.
        """
        found = [row.status for row in self.rows]
        return DIFFERS if DIFFERS in found else REPRODUCED if REPRODUCED in found else NOT_REPRODUCIBLE


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
    Item("gu-fig20-25", "Step and sinusoid under MRAC, with and without extrusion (Figs. 20-25)", "gu.fig20_25", 15),
    Item("gu-tableA1", "Tracking error of nine cables under adaptive control (Table A1)", "gu.table_a1", 50),
    Item("zou-table3", "Slip angles and tension ratios of the idlers (Table 3)", "zou.table3", 3),
    Item("zou-fig6", "Transmission characteristic and its phases (Fig. 6)", "zou.fig6", 5),
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
