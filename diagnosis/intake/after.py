"""The data once more, beside the refitted simulator: units, signs, columns, jumps and clocks that a refit shows.

Before the fit channels are held against each other (`cable_envs.diagnosis.intake.gate`) and against the stated
numbers (`cable_envs.diagnosis.intake.claims`). Where a refit has made up for a fault, it shows in where the parameters
have gone; where it could not, in what the channels are beside their predictions:

    jumps      a channel that is off by a constant from one moment of one record to its end: counts that are lost.
               What a rig does, it does in every record
    units      A force in another unit, by a factor f, multiplies every mass, stiffness, damping and force by f. A
               position does so with 1/f but for forces, a clock with f^2 for masses and f for dampings. Claims that
               are multiplied so are where the refit has gone, or a refit from them leaves far less.
    sizes      a channel in the course that the simulator gives it and in another size, or turned round; a sensor's
               scale that is negative or a factor between units
    columns    two channels of a unit, each with the other's course
    clocks     a channel that is late or early by more than any actuator or sensor of a rig
    friction   that is claimed and has gone to none: energy comes from nowhere

The last is a note, as a claim may be wrong; the others say that the data are to be mended first.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from cable_envs.diagnosis.fit.likelihood import raw_residuals
from cable_envs.diagnosis.fit.refit import Fit, Start, refit
from cable_envs.diagnosis.intake.claims import off_prediction
from cable_envs.diagnosis.intake.factors import ALIKE, HALF, OF_FORCES, OF_RATES, hint
from cable_envs.diagnosis.intake.tracks import LAG
from cable_envs.diagnosis.model.model import Free, Model, Whitener, learn_whitener
from cable_envs.diagnosis.systems.question import Question

FAR = 5.0
"""Standard deviations of its claim, from which a parameter has gone elsewhere."""
NEAR = 2.5
"""Standard deviations of its claim, within which a refit agrees with it: one of eighty is farther."""
_ITERATIONS = 4
"""Of a refit with claims in other units."""
_MASSES, _DAMPINGS, _STIFFNESSES = ("kg", "kg m^2"), ("N s/m", "N m s/rad", "N m s"), ("N/m", "N m/rad")
POWERS = {
    "an effort": dict.fromkeys((*_MASSES, *_DAMPINGS, *_STIFFNESSES, "N", "N m"), 1),
    "a position": dict.fromkeys((*_MASSES, *_DAMPINGS, *_STIFFNESSES), -1),
    "a clock": dict.fromkeys(_MASSES, 2) | dict.fromkeys(_DAMPINGS, 1),
}
"""What is in another unit -> unit of a parameter -> the power of the channel's factor that the refit gives it."""
_TIMES = {1000.0: "'milli' or 'kilo'", 60.0: "minutes and seconds", 2.0: "a right clock and one that is off by 2"}
_FACTORS = {"an effort": OF_FORCES, "a position": OF_RATES, "a clock": _TIMES}
_FRICTIONS = ("coulomb", "friction")
WHOLE = 0.25
"""Share of the sum of squares that is left where a fault is undone, when that is what was wrong."""
_WIDEST = 0.3
"""s, and at most this share of a record's length: how far a channel is shifted."""
_BRIEF = 5
"""Samples on either side of a jump, over which it is there already."""
SCALE, DELAY = "sensor_scale", "sensor_delay"


@dataclass(frozen=True)
class Suspicion:
    """A fault of the data that a refit has brought to light; ``fatal``: nothing of the rig can be told before."""

    text: str
    fatal: bool = True


def after_fit(question: Question, fit: Fit, bare: Fit | None = None) -> tuple[Suspicion, ...]:
    """Faults of the data that show beside the refitted simulator.

    Parameters
    ----------
    question : Question
        Its model, and which of the parameters are claims.
    fit : Fit
        The last refit.
    bare : Fit, optional
        The refit without effects, in case one has taken a jump.

    Returns
    -------
    tuple of Suspicion
        In the order of the module's table; empty where nothing is wrong.
    """
    found = [*_jumps(question, fit)]
    if not found and bare is not None and bare is not fit:
        found = [*_jumps(question, bare, most=True)]
    if not found:  # what is wrong from a moment on drives parameters anywhere
        found = [*_units(question, fit), *_sizes(question, fit)]
    if not found:
        pairs = _pairs(question.fit, fit)
        found = [*_columns(pairs)] or [*_clocks(pairs)]
    return (*found, *_friction(question, fit))


class _InUnits:
    """A model whose claims, with their deviations and bounds, are multiplied by the powers of a factor."""

    def __init__(self, model: Model, powers: Mapping[str, int], factor: float):
        self._model, self.blocks = model, model.blocks
        self.parameters = [_times(p, factor ** powers.get(p.name, 0)) for p in model.parameters]

    def predict(self, values: np.ndarray) -> list[np.ndarray]:
        """As `cable_envs.diagnosis.model.model.Model`."""
        return self._model.predict(values)


def _times(p: Free, by: float) -> Free:
    if by == 1.0:
        return p
    return Free(p.name, by * p.start, by * p.low, by * p.high, by * p.scale, by * p.std if p.std else None)


def _units(question: Question, fit: Fit) -> Iterator[Suspicion]:
    """A factor that takes the claims to where the refit has gone, or under which the records leave far less.

    Asked where a claim has been left.
    """
    model = question.fit
    claims = [p for p in model.parameters if p.name in question.nominals and p.std and p.start > 0.0]
    if not any(p.std and abs(fit.values[p.name] - p.start) > FAR * p.std for p in claims):
        return
    whitener = learn_whitener(model.blocks, raw_residuals(model, fit), 0)
    now, best, said = _cost(model, whitener, fit), np.inf, ""
    for wrong, of_unit in POWERS.items():
        powers = {p.name: of_unit.get(question.units.get(p.name, ""), 0) for p in claims}
        moved = [name for name, power in powers.items() if power]
        if len(moved) < 2:
            continue  # one number alone may simply be claimed wrongly
        for known in _FACTORS[wrong]:
            for factor in (known, 1.0 / known):
                scaled = _InUnits(model, powers, factor)
                start = Start("", tuple(question.nominals), {})
                (one,) = refit(scaled, whitener, [start], _ITERATIONS, central=False)
                there = all(_kept(p, fit) for p in scaled.parameters if p.name in powers)
                if one.cost < best and (there or one.cost < WHOLE * now):
                    best = one.cost
                    said = (
                        f"with {', '.join(map(_plain, moved))} as claimed, {wrong} {factor:.3g} times as large as it "
                        f"should be explains the records: {hint(factor, _FACTORS[wrong])}"
                    )
    if said:
        yield Suspicion(said)


def _cost(model: Model, whitener: Whitener, fit: Fit) -> float:
    """Whitened sum of squares with priors, of a refit under another noise."""
    white = whitener.flat(model.blocks, raw_residuals(model, fit))
    return float(white @ white) + sum(
        ((fit.values[p.name] - p.start) / p.std) ** 2 for p in model.parameters if p.name in fit.free and p.std
    )


def _kept(p: Free, fit: Fit) -> bool:
    """Whether a refit agrees with a claim."""
    return p.std is not None and abs(fit.values[p.name] - p.start) < NEAR * p.std


def _sizes(question: Question, fit: Fit) -> Iterator[Suspicion]:
    for fault in off_prediction(question.fit, fit.values, "after the refit"):
        yield Suspicion(f"{_plain(fault.channel)} is {fault.text}")
    for p in question.fit.parameters:
        effect, _, channel = p.name.partition(".")
        value = fit.values[p.name]
        if effect == SCALE and not 1.0 / HALF < value < HALF:
            what = "turned round" if value < 0.0 else "in another unit"
            yield Suspicion(f"{_plain(channel)} is {value:.3g} times what it should be: it is {what}")
        elif effect == DELAY and value > LAG:
            yield Suspicion(
                f"{_plain(channel)} is {1e3 * value:.0f} ms late, which no sensor is: bring it to one clock"
            )


class _Pair(NamedTuple):
    """A channel of a record: s at its first sample and between them, measured and predicted less their means [T]."""

    record: str
    unit: str
    first: float
    period: float
    seen: np.ndarray
    said: np.ndarray


Pairs = Mapping[str, Sequence[_Pair]]
"""Channel -> of every record."""


def _pairs(model: Model, fit: Fit) -> Pairs:
    predicted = model.predict(np.array([[fit.values.get(p.name, p.start)] for p in model.parameters]))
    found: dict[str, list[_Pair]] = {}
    for block, out in zip(model.blocks, predicted, strict=True):
        good = block.good & np.isfinite(block.measured) & np.isfinite(out[:, 0])
        if np.count_nonzero(good) < 3:
            continue
        first, last = np.flatnonzero(good)[[0, -1]]
        time, rows = block.time[first : last + 1], good[first : last + 1]
        seen = np.interp(time, time[rows], block.measured[first : last + 1][rows])
        said = np.interp(time, time[rows], out[first : last + 1, 0][rows])
        period = float(np.median(np.diff(time)))
        pair = _Pair(block.record, block.unit, float(time[0]), period, seen - np.mean(seen), said - np.mean(said))
        found.setdefault(block.channel, []).append(pair)
    return found


def _left(pairs: Sequence[tuple[np.ndarray, np.ndarray]]) -> float:
    """Share of the squares of one that are left beside the other, in its best size."""
    one, other = (np.concatenate(side) for side in zip(*pairs, strict=True))
    squares, over = float(one @ one), float(other @ other)
    return 1.0 - float(one @ other) ** 2 / (squares * over) if squares > 0.0 and over > 0.0 else 1.0


def _columns(pairs: Pairs) -> Iterator[Suspicion]:
    names = list(pairs)
    for k, one in enumerate(names):
        for other in names[k + 1 :]:
            a, b = pairs[one], pairs[other]
            if a[0].unit != b[0].unit or [len(x.seen) for x in a] != [len(x.seen) for x in b]:
                continue
            own = [_left([(x.seen, x.said) for x in of]) for of in (a, b)]
            swapped = [
                _left([(x.seen, y.said) for x, y in zip(a, b, strict=True)]),
                _left([(y.seen, x.said) for x, y in zip(a, b, strict=True)]),
            ]
            if all(s < WHOLE * o and s < 1.0 - ALIKE**2 for s, o in zip(swapped, own, strict=True)):
                yield Suspicion(f"{_plain(one)} has the course of {_plain(other)}, and that one its: exchange the two")


def _jumps(question: Question, fit: Fit, most: bool = False) -> Iterator[Suspicion]:
    """A jump of a channel in one record; ``most``: only where it is most of what all records leave of the channel.

    A model without an effect that is there may stick where the rig slips, which is a step too, and leaves other records
    unexplained beside it.
    """
    fitted, heldout = (_pairs(model, fit) for model in (question.fit, question.heldout))
    known = {pair.record for of in fitted.values() for pair in of}
    for channel, of in fitted.items():
        records = [*of, *(pair for pair in heldout.get(channel, ()) if pair.record not in known)]
        seen = [(pair, jump) for pair in records if (jump := _jump(pair)) is not None]
        if len(seen) != 1 or len(records) < 2:
            continue
        ((pair, (height, seconds)),) = seen
        if most and _off(pair) < (1.0 - WHOLE) * sum(_off(p) for p in records):
            continue
        yield Suspicion(
            f"{_plain(channel)} of {pair.record} jumps by {height:.3g} {pair.unit} at {seconds:.3g} s and stays "
            "there, in no other record: counts that are lost, or a zero that was set anew, of this channel or of one "
            "that drives the simulator"
        )


def _off(pair: _Pair) -> float:
    """Sum of squares by which a record is off its prediction, but for a constant."""
    return float(np.sum((pair.seen - pair.said) ** 2))


def _jump(pair: _Pair) -> tuple[float, float] | None:
    """(height, s) of the one step that is nearly all that a record leaves; None without one."""
    left = pair.seen - pair.said  # both without their means
    count, sums = len(left), np.cumsum(left)[:-1]
    rows = np.arange(1, count)
    gains = sums**2 * count / (rows * (count - rows))
    edge = max(_BRIEF * 4, count // 50)
    if count <= 2 * edge:
        return None
    inner = gains[edge:-edge]
    k = int(np.argmax(inner)) + edge + 1
    if float(inner.max()) < (1.0 - WHOLE) * float(left @ left):
        return None
    height = float(np.mean(left[k:]) - np.mean(left[:k]))
    near = float(np.mean(left[k + 1 : k + 1 + _BRIEF]) - np.mean(left[k - 1 - _BRIEF : k - 1]))
    return (height, pair.first + k * pair.period) if near > 0.5 * height > 0.0 or near < 0.5 * height < 0.0 else None


def _clocks(pairs: Pairs) -> Iterator[Suspicion]:
    for channel, of in pairs.items():
        shifts = [_shift(pair) for pair in of]
        late = [shift for shift, _ in shifts]
        before, after = (sum(squares[k] for _, squares in shifts) for k in (0, 1))
        if min(late) * max(late) > 0.0 and min(map(abs, late)) > LAG and after < WHOLE * before:
            seconds = float(np.median(late))
            way = "late" if seconds > 0.0 else "early"
            yield Suspicion(
                f"{_plain(channel)} is {1e3 * abs(seconds):.0f} ms {way} against what the refitted simulator makes of "
                "the other channels, which no sensor is: bring them to one clock"
            )


def _shift(pair: _Pair) -> tuple[float, tuple[float, float]]:
    """(by how much one is late, s, (squares that are left before, and when it is brought back))."""
    period, seen, said = pair.period, pair.seen, pair.said
    most = round(min(_WIDEST / period, 0.1 * len(seen)))
    inner = said[most : len(said) - most]
    squares = [float(np.sum((seen[k : k + len(inner)] - inner) ** 2)) for k in range(2 * most + 1)]
    best = int(np.argmin(squares))
    return (best - most) * period, (squares[most], squares[best])


def _friction(question: Question, fit: Fit) -> Iterator[Suspicion]:
    for p in question.fit.parameters:
        rubs = question.units.get(p.name, "") in _DAMPINGS or any(word in p.name for word in _FRICTIONS)
        claimed = p.name in question.nominals and p.std and p.start > FAR * p.std
        if rubs and claimed and p.low == 0.0 and p.name in fit.at_bounds and fit.values[p.name] == 0.0:
            yield Suspicion(
                f"the refit has no {_plain(p.name)}, and {p.start:.3g} {question.units.get(p.name, '')} is claimed: an "
                "effort with the wrong sign or in another's column gives energy where friction takes it",
                fatal=False,
            )


def _plain(name: str) -> str:
    return name.replace("_", " ")
