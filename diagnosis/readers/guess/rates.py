"""Columns that are the rates of others, told by regression: the slope of one over time is k times the other.

The factor k tells units that no header gives, and its sign a column that counts in the other direction.
"""

from dataclasses import replace

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.signal import savgol_filter

from cable_envs.diagnosis.readers.guess.meant import LIKELY, OPEN, RATES, SURE, Meant, by_size, si_of
from cable_envs.diagnosis.readers.guess.words import Unit, unit_of

ALIKE = 0.95
"""Correlation of a slope and a column from which one is the other's rate."""
_ALIKE_BY_NAME = 0.02
"""Of the correlation, for what else speaks for a position and a rate: several may be as like."""
NEAR = 0.1
"""Share by which a factor may be off one between units."""
_SMOOTH = 9
"""Rows over which a slope is taken."""


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


def with_rates(found: list[Meant], clock: int) -> list[Meant]:
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
        pairs = [(pair, a) for pair, a in pairs if pair[0] > ALIKE and _may_be(done[a], done[b])]
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
        agree = abs(np.log(place.factor * abs(k) / rate.factor)) < NEAR
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
        if abs(np.log(ratio)) < NEAR:
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
    place = by_size(place)
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
        if unit is not None and unit.si == si and abs(np.log(factor / (unit.scale * si_of(unit.name, si)))) < NEAR:
            return unit
    return Unit(si, float(f"{factor:.4g}"), si)
