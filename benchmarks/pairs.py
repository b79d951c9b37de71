"""Paired timing: two things by turns, so that a slow spell of the machine hits both; the median ratio counts."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True)
class Contender:
    """``run(seconds) -> units``: works for about that long and says how many units (environment steps) it did."""

    name: str
    run: Callable[[float], float]


@dataclass(frozen=True)
class Result:
    """One line of the table; ``ratio`` is the median over the pairs, ``spread`` its quartiles."""

    name: str
    target: str
    value: float = float("nan")
    spread: tuple[float, float] = (float("nan"), float("nan"))
    met: bool | None = None
    rates: dict[str, float] = field(default_factory=dict)
    """median units a second of each contender"""
    pairs: int = 0
    note: str = ""


def stepping(step: Callable[[], object], units: float) -> Callable[[float], float]:
    """A contender's ``run`` that calls ``step`` (``units`` each) until the time is over; the clock is read rarely."""

    def run(seconds: float) -> float:
        begin, calls, batch = time.perf_counter(), 0, 1
        while (passed := time.perf_counter() - begin) < seconds:
            for _ in range(batch):
                step()
            calls += batch
            if passed < 0.1 * seconds:
                batch *= 2
        return calls * units

    return run


def rate(contender: Contender, seconds: float) -> float:
    """Units a second."""
    begin = time.perf_counter()
    units = contender.run(seconds)
    return units / (time.perf_counter() - begin)


def compare(
    name: str, ours: Contender, other: Contender, target: float, pairs: int, seconds: float, note: str = ""
) -> Result:
    """How many times faster ``ours`` is: each pair runs both, in alternating order, for ``seconds`` each."""
    for contender in (ours, other):
        contender.run(0.2 * seconds)  # warm caches, compiled code, branch predictors
    ratios, rates = [], {ours.name: [], other.name: []}
    for k in range(pairs):
        for contender in (ours, other) if k % 2 == 0 else (other, ours):
            rates[contender.name].append(rate(contender, seconds))
        ratios.append(rates[ours.name][-1] / rates[other.name][-1])
    value = float(np.median(ratios))
    return Result(
        name, f">= {target:g}", value, tuple(np.quantile(ratios, [0.25, 0.75]).tolist()), value >= target,
        {n: float(np.median(r)) for n, r in rates.items()}, pairs, note,
    )  # fmt: skip
