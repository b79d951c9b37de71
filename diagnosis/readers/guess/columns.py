"""What each column is: by its name and its unit, and by what its numbers do."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cable_envs.diagnosis.readers.guess.meant import LIKELY, OPEN, PLAIN, RATES, SURE, Meant, by_size, si_of
from cable_envs.diagnosis.readers.guess.rates import ALIKE, NEAR, slope_like, with_rates
from cable_envs.diagnosis.readers.guess.raw import Column
from cable_envs.diagnosis.readers.guess.words import (
    COMMAND,
    COUNTS,
    DRIVE,
    OUTPUT,
    REFERENCE,
    kinds_of,
    unit_in,
    unit_of,
    words_of,
)

_RATES_OF_LOGS = (0.2, 5e4)
"""Hz, between which rigs are logged."""
_HELD, _LEVELS = 0.8, 3
"""Share of rows that repeat the last one, and levels, from which on a column goes in steps."""


def meant(columns: Sequence[Column]) -> list[Meant]:
    """What each column is, the time among them."""
    found = [_by_name(column) for column in columns]
    places = [m.kind for m in found if m.kind in RATES]
    found = [_counted(m, places[0] if places else "rad") for m in found]
    clock = _clock(found)
    if clock is not None:
        found = _with_own_clocks(found, clock)
        found[clock] = _timed(found, clock)
        found = with_rates(found, clock)
    else:
        found = [replace(m, kind="count" if m.kind == "time" else m.kind) for m in found]
    found = _commands(found)
    return [by_size(m) for m in found]


def _counted(m: Meant, kind: str) -> Meant:
    """Counts of an encoder as a position, of the kind of the others, where the name says nothing else."""
    if m.kind or m.unit is None or m.unit.si != COUNTS:
        return m
    return m.because("counts are taken for a position", kind=kind)


def _with_own_clocks(found: Sequence[Meant], clock: int) -> list[Meant]:
    """Further columns of times as clocks, each of the columns behind it."""
    done, own = [], None
    for k, m in enumerate(found):
        if k == clock:
            own = None
        elif (
            m.kind == "time"
            and _evenness(m) > 0.0
            and not np.array_equal(m.column.values, found[clock].column.values, equal_nan=True)
        ):
            m, own = m.because("a clock of its own", kind="clock"), m.column
        elif m.kind == "time":
            m = m.because("the times once more", kind="count")
        done.append(replace(m, clock=own) if m.kind not in ("time", "clock") else m)
    return done


def _evenness(m: Meant) -> float:
    """Share of steps that are near the usual one, of a column that rises; 0 of others."""
    values = m.column.values
    steps = np.diff(values[np.isfinite(values)])
    if m.kind in ("text", "constant", "stamps") or len(steps) < 2 or np.mean(steps > 0.0) < 0.99:
        return 0.0
    usual = float(np.median(steps))
    return float(np.mean(np.abs(steps - usual) < 0.5 * abs(usual)))


def _by_name(column: Column) -> Meant:
    """What name, unit and the plainest of the numbers say."""
    words, values = words_of(column.name), column.values
    at = Meant(column, words=tuple(words))
    if not np.isfinite(values).any():
        if np.isfinite(column.stamps).sum() > 2:
            return at.because("times of day as text", kind="stamps")
        return at.because("no numbers", kind="text")
    side = {"drive": bool(DRIVE & set(words)), "output": bool(OUTPUT & set(words))}
    told = "reference" if REFERENCE & set(words) else "command" if COMMAND & set(words) else ""
    at = replace(at, told=told, side=next((s for s, is_it in side.items() if is_it), ""))
    given, how = unit_of(column.unit) if column.unit else None, "the row of units"
    if given is None:
        given, how = unit_in(column.name), "the header"
    kinds = kinds_of(words)
    if given is not None:
        at = at.because(f"{how} says {column.unit or _as_said(column.name)}", unit=given, kind=given.si, sure=LIKELY)
        if given.si == "s":
            at = replace(at, kind="time")
        if given.si in kinds or at.kind in kinds:
            at = at.because("and so does its name", sure=SURE)
        if given.si == COUNTS:
            at = replace(at, kind=next((k for k in kinds if k in PLAIN), ""), sure=OPEN)
    elif kinds:
        at = at.because(f"by its name: {' '.join(words)}", kind=kinds[0], sure=OPEN)
    return _unless_still(at, values[np.isfinite(values)])


def _unless_still(at: Meant, values: np.ndarray) -> Meant:
    """The same, or what is constant or counts rows as such."""
    steps = np.diff(values)
    if len(steps) and np.all(steps == 0.0):
        return at.because(f"constant at {values[0]:g}", kind="constant")
    whole = len(steps) > 0 and bool(np.all(steps == steps[0])) and abs(steps[0]) == 1.0
    if whole and (at.unit is None or at.unit.si == COUNTS) and at.kind != "time":
        return at.because("counts rows", kind="count")
    return replace(at, kind="") if at.kind == "count" else at


def _as_said(name: str) -> str:
    return name.strip()


def _clock(found: Sequence[Meant]) -> int | None:
    """Which column is the time: one that rises evenly, best by name or unit."""
    best, score = None, 0.0
    for k, m in enumerate(found):
        even = _evenness(m)
        if even == 0.0:
            continue
        named = 2.0 if m.kind == "time" and m.unit is not None else 1.0 if m.kind == "time" else 0.0
        count = m.kind == "count" or m.told != ""
        mark = named + 0.5 * even - (1.0 if count else 0.0) - (0.2 if m.unit is not None and not named else 0.0)
        if mark > max(score, 0.4):
            best, score = k, mark
    return best


def _timed(found: Sequence[Meant], clock: int) -> Meant:
    """The clock with its unit: that of the header, else the one that a position and its speed ask for, else by size."""
    m = found[clock]
    values = m.column.values
    step = float(np.median(np.diff(values[np.isfinite(values)])))
    if m.unit is not None and m.unit.si == "s":
        hz = 1.0 / (step * m.factor)
        if not _RATES_OF_LOGS[0] < hz < _RATES_OF_LOGS[1]:
            return m.because(f"but its step of {step:.4g} would be a rate of {hz:.4g} Hz", kind="time", sure=OPEN)
        return m.because(f"rises evenly, {hz:.4g} Hz", kind="time", sure=SURE if m.sure == SURE else LIKELY)
    asked = _asked_of_time(found, m.column.values)
    guessed = next(n for n, most in (("s", 0.45), ("ms", 450.0), ("us", 4.5e5), ("ns", np.inf)) if step < most)
    name, how, sure = (
        (asked, "a position and its speed tell the unit", LIKELY) if asked else
        (guessed, f"no unit is given; {guessed} by its step of {step:.4g}", OPEN)
    )  # fmt: skip
    unit = unit_of(name)
    assert unit is not None, "names of units of time"
    rate = 1.0 / (step * unit.scale * si_of(unit.name, "s"))
    return m.because(f"{how}: {rate:.4g} Hz", kind="time", unit=unit, sure=sure)


def _asked_of_time(found: Sequence[Meant], time: np.ndarray) -> str:
    """Unit of time by which a position with a unit has a slope that is a speed with a unit; "" where none does."""
    for place in found:
        for rate in found:
            if place.unit is None or rate.unit is None or RATES.get(place.unit.si) != rate.unit.si:
                continue
            like, k = slope_like(time, place.column.values, rate.column.values)
            if like > ALIKE:
                seconds = abs(k) * place.factor / rate.factor  # in one unit of time
                near = (n for n in ("s", "ms", "us", "min") if abs(np.log(seconds / si_of(n, "s"))) < NEAR)
                return str(next(near, ""))
    return ""


def _commands(found: list[Meant]) -> list[Meant]:
    """Columns that go in steps, or lead another one of their kind, are commands where no name says so."""
    done = list(found)
    for k, m in enumerate(done):
        if m.told or m.kind not in PLAIN or m.kind in ("A", "V"):
            continue
        values = m.column.values[np.isfinite(m.column.values)]
        held = float(np.mean(np.diff(values) == 0.0))
        levels = len(np.unique(values))
        if held > _HELD and levels >= _LEVELS and levels < 0.02 * len(values):
            others = [o for o in done if o is not m and o.kind == m.kind and not o.told]
            if others:
                done[k] = m.because(f"goes in steps between {levels} levels", told="command", sure=OPEN)
                continue
        alike = [o for o in done if o is not m and o.kind == m.kind and not o.told and m.side in ("", o.side)]
        ahead = next((o for o in alike if _leads(m, o)), None)
        if ahead is not None:
            name = ahead.column.name or ahead.column.place
            done[k] = m.because(f"leads {name}, and has no noise", told="command", sure=OPEN)
    return done


def _leads(m: Meant, other: Meant) -> bool:
    """Whether a column without noise is what another one with noise follows, later."""
    one, two = m.column.values, other.column.values
    good = np.isfinite(one) & np.isfinite(two)
    one, two = one[good] - np.mean(one[good]), two[good] - np.mean(two[good])
    if len(one) < 100 or not (np.any(one) and np.any(two)):
        return False
    rough = [float(np.std(np.diff(x, 3)) / np.std(x)) for x in (one, two)]
    if rough[0] > 0.1 * rough[1]:
        return False
    most = min(len(one) // 10, 200)
    scale = float(np.sqrt((one @ one) * (two @ two)))
    likes = [float(one[: len(one) - lag] @ two[lag:]) / scale for lag in range(most)]
    lag = int(np.argmax(likes))
    return lag >= 1 and likes[lag] > ALIKE
