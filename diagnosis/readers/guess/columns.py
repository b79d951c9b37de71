"""What a column is: by its name and its unit, and by what its numbers do.

A rate is told by regression: the slope of one column over time is k times another. The factor k tells units that no
header gives, and its sign a column that counts in the other direction.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.signal import savgol_filter

from cable_envs.diagnosis.readers.guess.raw import Column
from cable_envs.diagnosis.readers.guess.words import (
    COMMAND,
    COUNTS,
    DRIVE,
    OUTPUT,
    REFERENCE,
    Unit,
    kinds_of,
    unit_in,
    unit_of,
    words_of,
)

SURE, LIKELY, OPEN = "sure", "likely", "CONFIRM"
"""How sure a statement is; what is open the user must confirm."""
RATES = {"m": "m/s", "rad": "rad/s"}
"""SI unit of a position -> that of its rate."""
_ALIKE = 0.95
"""Correlation of a slope and a column from which one is the other's rate."""
_ALIKE_BY_NAME = 0.02
"""Of the correlation, for what else speaks for a position and a rate: several may be as like."""
_NEAR = 0.1
"""Share by which a factor may be off one between units."""
_RATES_OF_LOGS = (0.2, 5e4)
"""Hz, between which rigs are logged."""
_SMOOTH = 9
"""Rows over which a slope is taken."""
_HELD, _LEVELS = 0.8, 3
"""Share of rows that repeat the last one, and levels, from which on a column goes in steps."""
_PLAIN = {
    "m": ("m", "mm", 5.0), "rad": ("rad", "deg", 10.0), "m/s": ("m/s", "mm/s", 10.0), "rad/s": ("rad/s", "deg/s", 60.0),
    "N": ("N", "N", np.inf), "N m": ("N m", "N mm", 50.0), "A": ("A", "mA", 100.0), "V": ("V", "V", np.inf),
}  # fmt: skip
"""SI unit -> (what is taken where nothing tells, what from a range on, that range): lengths of tables and joints."""


@dataclass(frozen=True)
class Meant:
    """What a column is taken for.

    Parameters
    ----------
    column : Column
        As it stands.
    kind : str
        SI unit of the quantity; "time", "count", "constant", "text", or "" where nothing tells.
    unit : Unit, optional
        Of its numbers.
    told : str
        "command", "reference", or "" of what was measured.
    side : str
        "drive", "output" or "".
    sign : int
        -1 where the numbers tell that it counts against its position.
    sure : str
        One of "sure", "likely", "CONFIRM".
    why : tuple of str
        Reasons.
    clock : Column, optional
        Of its times, where these are not the table's.
    """

    column: Column
    kind: str = ""
    unit: Unit | None = None
    told: str = ""
    side: str = ""
    sign: int = 1
    sure: str = OPEN
    why: tuple[str, ...] = ()
    words: tuple[str, ...] = field(default=(), repr=False)
    clock: Column | None = None

    def because(self, reason: str, **changes) -> "Meant":
        """The same with another reason, and what that changes."""
        return replace(self, why=(*self.why, reason), **changes)

    @property
    def factor(self) -> float:
        """SI for one of its numbers, without sign."""
        assert self.unit is not None, "asked for of what has a unit"
        return self.unit.scale * (_si(self.unit.name, self.unit.si) if self.unit.si != COUNTS else 1.0)


def _si(unit: str, si: str) -> float:
    from cable_envs.core.params import to_si

    return to_si(1.0, unit, si)


def meant(columns: Sequence[Column]) -> list[Meant]:
    """What each column is, the time among them."""
    found = [_by_name(column) for column in columns]
    places = [m.kind for m in found if m.kind in RATES]
    found = [_counted(m, places[0] if places else "rad") for m in found]
    clock = _clock(found)
    if clock is not None:
        found = _with_own_clocks(found, clock)
        found[clock] = _timed(found, clock)
        found = _rates(found, clock)
    else:
        found = [replace(m, kind="count" if m.kind == "time" else m.kind) for m in found]
    found = _commands(found)
    return [_by_size(m) for m in found]


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
            at = replace(at, kind=next((k for k in kinds if k in _PLAIN), ""), sure=OPEN)
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
    rate = 1.0 / (step * unit.scale * _si(unit.name, "s"))
    return m.because(f"{how}: {rate:.4g} Hz", kind="time", unit=unit, sure=sure)


def _asked_of_time(found: Sequence[Meant], time: np.ndarray) -> str:
    """Unit of time by which a position with a unit has a slope that is a speed with a unit; "" where none does."""
    for place in found:
        for rate in found:
            if place.unit is None or rate.unit is None or RATES.get(place.unit.si) != rate.unit.si:
                continue
            like, k = slope_like(time, place.column.values, rate.column.values)
            if like > _ALIKE:
                seconds = abs(k) * place.factor / rate.factor  # in one unit of time
                near = (n for n in ("s", "ms", "us", "min") if abs(np.log(seconds / _si(n, "s"))) < _NEAR)
                return str(next(near, ""))
    return ""


def slope_like(time: np.ndarray, place: np.ndarray, rate: np.ndarray) -> tuple[float, float]:
    """(correlation of the slope of ``place`` over ``time`` with ``rate``, factor between them), of columns [rows]."""
    good = np.isfinite(time) & np.isfinite(place) & np.isfinite(rate)
    if good.sum() < 4 * _SMOOTH:
        return 0.0, 1.0
    step = float(np.median(np.diff(time[good])))
    best = 0.0
    for width in (_SMOOTH, 5 * _SMOOTH):  # counts want a longer one
        if good.sum() < 4 * width or step <= 0.0:
            continue
        slope = savgol_filter(place[good], width, 2, deriv=1, delta=step)[width:-width]
        other = savgol_filter(rate[good], width, 2)[width:-width]
        over = float(np.sqrt(np.sum(slope**2) * np.sum(other**2)))
        like = float(slope @ other) / over if over > 0.0 else 0.0
        best = max(best, abs(like))
    way = cumulative_trapezoid(rate[good], time[good], initial=0.0)
    basis = np.column_stack([way, time[good] - time[good][0], np.ones(len(way))])  # a bias of the rate drifts
    size = np.maximum(np.max(np.abs(basis), axis=0), 1e-300)
    return best, float(np.linalg.lstsq(basis / size, place[good], rcond=None)[0][0] / size[0])


def _rates(found: list[Meant], clock: int) -> list[Meant]:
    """With units and signs by columns that are the rates of others, on the same clock."""
    done, factor = list(found), found[clock].factor
    time = {id(m.clock): (m.clock or found[clock].column).values * factor for m in found}
    moving = [
        k for k, m in enumerate(done) if k != clock and m.kind not in ("text", "constant", "count", "stamps", "clock")
    ]
    for b in moving:
        other = [a for a in moving if a != b and done[a].clock is done[b].clock]
        of = time[id(done[b].clock)]
        pairs = [(slope_like(of, done[a].column.values, done[b].column.values), a) for a in other]
        pairs = [(pair, a) for pair, a in pairs if pair[0] > _ALIKE and _may_be(done[a], done[b])]
        if pairs:
            (_, k), a = max(
                pairs, key=lambda p: (p[0][0] + _ALIKE_BY_NAME * _of_one(done[p[1]], done[b], p[0][1]), -p[1])
            )
            done[a], done[b] = _joined(done[a], done[b], k)
    return done


def _of_one(place: Meant, rate: Meant, k: float) -> int:
    """In how much else a position and a rate are of one motion: their end, what was measured, units that agree."""
    agree = False
    if place.unit is not None and rate.unit is not None and RATES.get(place.unit.si) == rate.unit.si:
        agree = abs(np.log(place.factor * abs(k) / rate.factor)) < _NEAR
    return agree + (place.side == rate.side) + (place.told == rate.told)


def _may_be(place: Meant, rate: Meant) -> bool:
    """Whether names and units let one column be the rate of another."""
    if place.told != rate.told and place.told and rate.told:
        return False
    a, b = place.kind, rate.kind
    return (a in RATES or a == "") and (b in RATES.values() or b == "") and not (a == "" and b == "")


def _joined(place: Meant, rate: Meant, k: float) -> tuple[Meant, Meant]:
    """A position and its rate, with what the factor k between them tells."""
    one, other = place.column.name or place.column.place, rate.column.name or rate.column.place
    si = place.kind or next(p for p, r in RATES.items() if r == rate.kind)
    if place.kind and rate.kind and RATES[place.kind] != rate.kind:  # "speed" of an angle
        rate = replace(rate, kind=RATES[place.kind], unit=rate.unit if rate.unit and rate.unit.si != "m/s" else None)
    place, rate = replace(place, kind=si), replace(rate, kind=RATES[si])
    place, rate = _usable(place), _usable(rate)
    sign = -1 if k < 0.0 else 1
    turned = ", and counts the other way" if sign < 0 else ""
    if rate.unit is not None and place.unit is not None:
        ratio = place.factor * abs(k) / rate.factor
        if abs(np.log(ratio)) < _NEAR:
            said = f"the slope of {one} agrees with it{turned}"
            return place.because(f"its slope is {other}", sure=SURE), rate.because(said, sign=sign, sure=SURE)
        said = f"the slope of {one} is {ratio:.4g} times as large: one of the two units is wrong"
        return place.because(f"but {other} disagrees", sure=OPEN), rate.because(said, sign=sign, sure=OPEN)
    if place.unit is not None:
        unit = _nearest(place.factor * abs(k), RATES[si])
        return place, rate.because(f"the slope of {one}{turned}", unit=unit, sign=sign, sure=LIKELY)
    if rate.unit is not None:
        unit = _nearest(rate.factor / abs(k), si)
        return place.because(f"its slope is {other}", unit=unit, sure=LIKELY), replace(rate, sign=sign)
    place = _by_size(place)
    assert place.unit is not None, "every position has one then"
    unit = _nearest(place.factor * abs(k), RATES[si])
    return place, rate.because(f"the slope of {one}{turned}", unit=unit, sign=sign, sure=OPEN)


def _usable(m: Meant) -> Meant:
    """Without a unit that is of another kind than the column, or only counts."""
    return replace(m, unit=None) if m.unit is not None and m.unit.si != m.kind else m


def _nearest(factor: float, si: str) -> Unit:
    """The unit of a kind with about that factor to SI, or the SI unit with a scale."""
    for name in ("m", "mm", "cm", "um", "rad", "deg", "rev", "m/s", "mm/s", "cm/s", "rad/s", "deg/s", "rpm"):
        unit = unit_of(name)
        if unit is not None and unit.si == si and abs(np.log(factor / (unit.scale * _si(unit.name, si)))) < _NEAR:
            return unit
    return Unit(si, float(f"{factor:.4g}"), si)


def _commands(found: list[Meant]) -> list[Meant]:
    """Columns that go in steps, or lead another one of their kind, are commands where no name says so."""
    done = list(found)
    for k, m in enumerate(done):
        if m.told or m.kind not in _PLAIN or m.kind in ("A", "V"):
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
    return lag >= 1 and likes[lag] > _ALIKE


def _by_size(m: Meant) -> Meant:
    """With the unit that the range of the numbers suggests, where nothing else tells."""
    if m.kind not in _PLAIN:
        return m
    counts = m.unit is not None and m.unit.si == COUNTS
    if m.unit is not None and m.unit.si == m.kind:
        return m
    if counts:
        return m.because(
            "counts: state the unit and the scale, the units for one count", unit=Unit(m.kind, 1.0, m.kind), sure=OPEN
        )
    small, large, most = _PLAIN[m.kind]
    span = float(np.nanmax(m.column.values) - np.nanmin(m.column.values))
    unit = unit_of(large if span > most else small)
    assert unit is not None, "names of units"
    return m.because(f"no unit is given; {unit.name} by its range of {span:.3g}", unit=unit, sure=OPEN)
