"""What may be missing: every registered effect that acts on the system, with the sizes at which it is first looked for.

Many effects have no slope at their null (a gap, a lag, an excess that falls with a speed that is not known), so each is
probed at finite sizes and shapes; a probe is a direction in the space of recordings, or several that act together.
"""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import combinations, product
from typing import NamedTuple

import numpy as np

from cable_envs.core.errors import ConfigurationError, require_known
from cable_envs.diagnosis.model.model import Free
from cable_envs.effects import EFFECTS, Effect, EffectParameter
from cable_envs.effects.base import CONSTANT, DRIFT, PROBES
from cable_envs.plants.base import Plant

LOGGER = "logger."
"""How the names of hypotheses begin that are of the data and not of the rig."""
REFITTED, KNOWN = "refitted already", "stated as known"
"""How a parameter is in a model."""
BY_NAME = "it is asked only where it is named (--effects)"
NO_TRAVEL = "where it is met is looked for along a position, and none is recorded"
WAVES = (1.75, 20.0, 0.5)
"""Waves along the travel at which an effect that is a sine along it is probed: from, to, step."""
PLACES = (0.1, 0.3, 0.5, 0.7, 0.9)
"""Shares of the travel at which an effect that has a place along it is probed."""


class Travel(NamedTuple):
    """Where a position goes in records, m or rad: its lowest and highest place, and the widest range of one record."""

    low: float
    high: float
    widest: float

    @classmethod
    def of(cls, records: Sequence[np.ndarray]) -> "Travel":
        """Of the positions of some records, [T] each."""
        low, high = min(float(np.min(x)) for x in records), max(float(np.max(x)) for x in records)
        return cls(low, high, max(float(np.ptp(x)) for x in records))


@dataclass(frozen=True)
class Hypothesis:
    """An effect that may be there: the parameters that a refit with it frees, and where it is probed.

    What a search has to know of the effect is what the effect declares (`cable_envs.effects.Effect`); a hypothesis that
    no registered effect stands behind is as one that declares nothing.

    Parameters
    ----------
    name : str
        Name of the effect; of a sensor's with the signal, "sensor_bias.force".
    free : tuple of Free
        Parameters that a refit with it moves.
    probes : tuple of tuple of Mapping
        Each a tuple of directions, each direction the parameters that differ from the null, by name, SI.
    equation, experiment, confusable
        As of the effect.
    nulls : Mapping
        Value of each parameter that leaves the effect out; those that only shape it are not here.
    effect : Effect, optional
        What it declares; by default the registered effect of that name, if there is one.
    least : float
        Distance from the null, SI, below which its parameter says nothing of it.
    alike : bool
        Whether it is done to all channels alike, which is to be seen in them.
    redundant : str
        Channel that is left out where this was done to it: it holds nothing that another does not; "": none.
    """

    name: str
    free: tuple[Free, ...]
    probes: tuple[tuple[Mapping[str, float], ...], ...]
    equation: str = ""
    experiment: str = ""
    confusable: tuple[str, ...] = ()
    nulls: Mapping[str, float] = field(default_factory=dict)
    effect: Effect | None = None
    least: float = 0.0
    alike: bool = False
    redundant: str = ""

    def __post_init__(self) -> None:
        if self.effect is None:
            object.__setattr__(self, "effect", EFFECTS.get(self.canonical))

    @property
    def canonical(self) -> str:
        """Name of the effect, `effect_name`."""
        return effect_name(self.name)

    @property
    def of_logger(self) -> bool:
        """Whether it is of the data and not of the rig."""
        return self.name.startswith(LOGGER)

    @property
    def names(self) -> tuple[str, ...]:
        """The freed parameters."""
        return tuple(p.name for p in self.free)

    @property
    def shapes(self) -> tuple[str, ...]:
        """The freed parameters that only shape the effect."""
        return tuple(name for name in self.names if name not in self.nulls)

    @cached_property
    def parts(self) -> tuple["Hypothesis", ...]:
        """The same effect with some of its sizes only, friction in the contact or at the load, if it has several.

        One in which nothing is missing costs the evidence of the others its own parameter.
        """
        if len(self.nulls) < 2:
            return ()
        found = []
        some = (kept for count in range(1, len(self.nulls)) for kept in combinations(self.nulls, count))
        for kept in some:
            gone = self.nulls.keys() - set(kept)
            probes = tuple(p for p in self.probes if not any(gone & direction.keys() for direction in p))
            if probes:
                free = tuple(p for p in self.free if p.name not in gone)
                found.append(replace(self, free=free, probes=probes, nulls={n: self.nulls[n] for n in kept}))
        return tuple(found) if len(found) > 1 else ()

    @property
    def proportional(self) -> bool:
        """Whether twice the size is twice the change of every signal."""
        return self.effect is not None and self.effect.proportional

    @property
    def drifts(self) -> bool:
        """Whether it changes with the elapsed time alone."""
        return self.effect is not None and self.effect.over_time == DRIFT

    @property
    def constant(self) -> bool:
        """Whether what changes with the elapsed time is not this effect."""
        return self.effect is not None and self.effect.over_time == CONSTANT

    @property
    def complete(self) -> bool:
        """Whether the bound of its sizes is all of it, and no end of a search."""
        return self.effect is not None and any(p.complete for p in self.effect.parameters)

    @cached_property
    def inverse(self) -> frozenset[str]:
        """Parameters of which there is the more effect the smaller they are."""
        if self.effect is None:
            return frozenset()
        e = self.effect
        return frozenset(name for p in e.parameters if p.inverse for name in (f"{e.name}.{p.name}", e.row(p)))

    @property
    def wave(self) -> tuple[str, str] | None:
        """(period, phase) of an effect that is a sine along the position; else None."""
        if self.effect is None or self.effect.wave is None:
            return None
        period, phase = self.effect.wave
        return f"{self.effect.name}.{period}", f"{self.effect.name}.{phase}"

    @property
    def place(self) -> str:
        """Parameter that is a place along the position, of an effect that has one; else empty."""
        return f"{self.effect.name}.{self.effect.place}" if self.effect and self.effect.place else ""


@dataclass(frozen=True)
class Candidates:
    """Which effects are asked, and why others are not.

    Parameters
    ----------
    asked : tuple of Hypothesis
        What may be missing.
    not_asked : Mapping of str to str
        Name of a hypothesis that is not among them, or of a parameter that is left out of one -> why, in plain words.
        What the caller himself left out is not here.
    """

    asked: tuple[Hypothesis, ...] = ()
    not_asked: Mapping[str, str] = field(default_factory=dict)

    def less(self, reasons: Mapping[str, str]) -> "Candidates":
        """The candidates without those of them for which there are ``reasons`` not to ask, by name."""
        gone = {h.name: reasons[h.name] for h in self.asked if h.name in reasons}
        return Candidates(tuple(h for h in self.asked if h.name not in gone), {**self.not_asked, **gone})

    def each(self, change: Callable[[Hypothesis], Hypothesis]) -> "Candidates":
        """The candidates with every hypothesis as ``change`` makes it."""
        return replace(self, asked=tuple(change(h) for h in self.asked))

    def and_also(self, others: "Candidates") -> "Candidates":
        """These and ``others``."""
        return Candidates((*self.asked, *others.asked), {**self.not_asked, **others.not_asked})


def unsearched(plant: Plant, searched: Collection[str], alike: Mapping[str, str]) -> dict[str, str]:
    """Why a plant's sensors' effects are no hypotheses of a model that searches for some only, by name.

    searched: names of the hypotheses; alike: name -> the refitted parameter that does the same.
    """
    names = [
        f"{e.name}.{p.name}" for e in plant.effects.effects.values() if e.each_sensor for p in e.parameters
    ]  # fmt: skip
    why = "the model of this recording declares no search for it"
    return {
        n: f"it looks the same as the refitted {alike[n]}" if n in alike else why for n in names if n not in searched
    }


def effect_name(hypothesis: str) -> str:
    """Name of the effect of a hypothesis: "sensor_bias" of "sensor_bias.velocity"; a logger's fault has its own."""
    return hypothesis if hypothesis.startswith(LOGGER) else hypothesis.partition(".")[0]


def hypotheses_for(
    plant: Plant,
    values: Mapping[str, float],
    modelled: Mapping[str, str],
    signals: Sequence[str],
    *,
    only: Sequence[str] | None = None,
    without: Sequence[str] = (),
    travel: Travel | None = None,
) -> Candidates:
    """Effects that the model of ``values`` leaves out and that could show in ``signals``; of the others, why not.

    modelled: parameters that are in the model already -> whether they are `REFITTED` or `KNOWN`; only, without: names
    of effects, from the command line; travel: over which a ripple, and the place of what has one, is looked for.
    A sensor's effect is a hypothesis for each signal, named "sensor_bias.force". Raises ConfigurationError for names
    that are no effects of the plant.
    """
    known = plant.effects.effects
    for name in (*(only or ()), *without):
        require_known("effect", [name], known)
        if not known[name].parameters:
            raise ConfigurationError(f"effect '{name}' does not act on {plant.name}")
    found: list[Hypothesis] = []
    refused: dict[str, str] = {}
    for effect in known.values():
        if effect.name in without or (only is not None and effect.name not in only):
            continue
        if only is None and not effect.hypothesis:
            refused |= {effect.name: BY_NAME} if effect.parameters else {}
            continue
        parameters = effect.parameters
        groups: list[tuple[str, Sequence[EffectParameter]]]
        if effect.each_sensor:
            groups = [(f"{effect.name}.{p.name}", (p,)) for p in parameters if p.name in signals]
        else:
            groups = [(effect.name, parameters)] if parameters else []
        for name, group in groups:
            if effect.place and travel is None:
                refused[name] = NO_TRAVEL
            elif why := _in_already(plant, effect, group, values, modelled):
                refused[name] = why
            else:
                found.append(_hypothesis(effect, name, group, values, modelled, travel))
    return Candidates(tuple(found), refused)


def _in_already(
    plant: Plant, effect: Effect, parameters: Sequence[EffectParameter], values: Mapping[str, float],
    modelled: Mapping[str, str],
) -> str:  # fmt: skip
    """Why the model has an effect already, in words; empty where one of its sizes may be missing."""
    sizes = [(effect.row(p), p) for p in parameters if not p.shape]
    if any(row not in modelled and values[row] == p.null for row, p in sizes):
        return ""
    return "; ".join(_has(plant, row, values[row], modelled.get(row)) for row, _ in sizes)


def _has(plant: Plant, row: str, value: float, how: str | None) -> str:
    """How the model has a parameter."""
    if how:
        return f"{row} is {how}"
    unit = "" if plant.table[row].unit == "1" else f" {plant.table[row].unit}"
    default = ", the default of its simulator" if value == plant.table[row].default else ""
    return f"the model has it: {row} is {value:.4g}{unit}{default}"


def _hypothesis(
    effect: Effect,
    name: str,
    parameters: Sequence[EffectParameter],
    values: Mapping[str, float],
    modelled: Mapping[str, str],
    travel: Travel | None,
) -> Hypothesis:
    rows = {effect.row(p): p for p in parameters}
    # what a recording claims to know as absent is what may be missing
    absent = {row: p for row, p in rows.items() if row not in modelled and values[row] == p.null}
    sizes = {row: p for row, p in absent.items() if not p.shape}
    free = [free_of(row, p) for row, p in absent.items() if _searched(effect, p)]
    probes: list[tuple[dict[str, float], ...]] = [(one,) for one in _probes(effect, sizes, absent)]
    if effect.wave and travel:
        period, phase = (f"{effect.name}.{name}" for name in effect.wave)
        free = [_within(f, travel.widest) if f.name == period else f for f in free]
        probes = _waves(next(iter(sizes)), sizes, period, phase, travel.widest)
    if effect.place and travel:
        row = f"{effect.name}.{effect.place}"
        free = [_along(f, travel) if f.name == row else f for f in free]
        at = [travel.low + share * (travel.high - travel.low) for share in PLACES]
        probes = [({**one, row: here},) for (one,) in probes for here in at]
    nulls = {row: p.null for row, p in sizes.items()}
    least = max((p.least for p in sizes.values()), default=0.0)
    return Hypothesis(
        name, tuple(free), tuple(probes), effect.equation, effect.experiment, effect.confusable, nulls, effect, least
    )  # fmt: skip


def _searched(effect: Effect, p: EffectParameter) -> bool:
    """Whether a refit moves a parameter: sizes, and shapes that are probed."""
    return not p.shape or bool(p.probes) or p.name in (*(effect.wave or ()), effect.place)


def free_of(row: str, p: EffectParameter) -> Free:
    """A parameter of an effect as a refit moves it, by its row of the plant's table."""
    typical = p.typical
    scale = abs(typical - p.null) or abs(p.null) or 1.0
    return Free(row, p.null, p.low if p.search_low is None else p.search_low, p.high, scale)


def _probes(
    effect: Effect, sizes: Mapping[str, EffectParameter], absent: Mapping[str, EffectParameter]
) -> Iterator[dict[str, float]]:  # fmt: skip
    """Every size with every shape, one direction each."""
    shapes = {
        row: [factor * p.typical for factor in p.probes]
        for row, p in absent.items()
        if p.shape and p.probes
    }  # fmt: skip
    for row, p in sizes.items():
        for value, *shape in product(_sizes(effect, p), *shapes.values()):
            yield {row: min(max(value, p.low), p.high), **dict(zip(shapes, shape, strict=True))}


def _sizes(effect: Effect, p: EffectParameter) -> list[float]:
    typical = p.typical
    factors = PROBES if p.probes is None else p.probes
    if p.inverse:
        return [factor * typical for factor in factors]
    factors = PROBES[-1:] if effect.proportional else factors
    signs = (1.0, -1.0) if p.signed and p.low < p.null else (1.0,)
    return [p.null + sign * factor * (typical - p.null) for factor in factors for sign in signs]


def _within(free: Free, travel: float) -> Free:
    """The period of a wave, of which there is one and a half over the travel, or it were a spring or a constant."""
    return replace(free, start=travel / 4.0, low=travel / 25.0, high=travel / 1.5, scale=travel / 4.0)


def _along(free: Free, travel: Travel) -> Free:
    """A place along the position: anywhere that the records go, each place as likely as any other."""
    length = travel.high - travel.low
    middle = travel.low + 0.5 * length
    return replace(free, start=middle, low=travel.low, high=travel.high, scale=0.25 * length, std=length / np.sqrt(12))


def _waves(
    size: str, sizes: Mapping[str, EffectParameter], period: str, phase: str, travel: float
) -> list[tuple[dict[str, float], ...]]:  # fmt: skip
    """Sine and cosine together for every number of waves over the travel; steps of half a wave miss none."""
    height = 0.1 * sizes[size].typical
    found = []
    for waves in np.arange(*WAVES):
        length = travel / waves
        one = {size: min(height, 0.1 * length), period: length}
        found.append(tuple({**one, phase: turn} for turn in (0.0, 0.5 * np.pi)))
    return found
