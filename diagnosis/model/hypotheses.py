"""What may be missing: every registered effect that acts on the system, with the sizes at which it is first looked for.

Many effects have no slope at their null (a gap, a lag, an excess that falls with a speed that is not known), so each is
probed at finite sizes and shapes; a probe is a direction in the space of recordings, or several that act together.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product

import numpy as np

from cable_envs.core.errors import ConfigurationError, require_known
from cable_envs.effects import Effect, EffectParameter
from cable_envs.plants.base import Plant
from diagnosis.model.model import Free

SIZES = (0.1, 1.0)
"""Probed sizes over the typical one of `EffectParameter`; a screening goes on to nearer ones (`fit.screen`)."""

_FINE = {
    **dict.fromkeys(("backlash.gap", "presliding_hysteresis.displacement"), (0.05, 0.1, 0.2, 0.4, 0.7, 1.0, 2.0)),
    "stiffness_hardening.coefficient": (0.1, 0.5, 2.0, 6.0),
}
"""Sizes of what does not grow in proportion: refits from far away end elsewhere."""

PROPORTIONAL = ("sensor_bias", "sensor_scale", "sensor_rectification")
"""Effects of which twice the size is twice the change: one probe says all."""

LEAST: Mapping[str, float] = {"viscoelastic_creep.time": 0.2, "friction_drift.time": 1.0}
"""Least shapes that are looked for: creep that is over in 0.1 s is a cable's damping."""

STIFFNESSES = (1.0, 5.0, 25.0)
"""Probed stiffnesses over the typical one."""

WAVES = (1.75, 20.0, 0.5)
"""Waves of a ripple over the travel: from, to, step."""

_SHAPES: Mapping[str, tuple[float, ...]] = {
    "stribeck_friction.velocity": (0.3, 1.0, 4.0, 16.0),
    "viscoelastic_creep.time": (0.1, 1.0),
    "friction_drift.time": (0.1, 0.5, 2.0),
}
"""Probed shapes over their default; what is not here is probed at its default."""

INVERSE = ("belt_stiffness", "cable_stiffness", "tensile_stiffness")
"""Parameters of which there is the more effect the smaller they are."""

_SIGNED = (
    "asymmetric_friction.difference", "asymmetric_friction.contact", "load_dependent_friction.exponent",
    "position_ripple.force", "friction_drift.change",
)  # fmt: skip


@dataclass(frozen=True)
class Hypothesis:
    """An effect that may be there: the parameters that a refit with it frees, and where it is probed.

    probes: each a tuple of directions, each direction the parameters that differ from the null, by name, in SI.
    """

    name: str
    free: tuple[Free, ...]
    probes: tuple[tuple[Mapping[str, float], ...], ...]
    equation: str = ""
    experiment: str = ""
    confusable: tuple[str, ...] = ()
    nulls: Mapping[str, float] = field(default_factory=dict)
    """value of each parameter that leaves the effect out; those that only shape it are not here"""

    @property
    def names(self) -> tuple[str, ...]:
        """The freed parameters."""
        return tuple(p.name for p in self.free)


def hypotheses_for(
    plant: Plant,
    values: Mapping[str, float],
    modelled: Collection[str],
    signals: Sequence[str],
    *,
    only: Sequence[str] | None = None,
    without: Sequence[str] = (),
    travel: float | None = None,
) -> list[Hypothesis]:
    """Effects that the model of ``values`` leaves out and that could show in ``signals``.

    modelled: parameters that are refitted already, or known; only, without: names of effects, from the command line;
    travel: range of positions in the recording, m or rad, over which a ripple is looked for.
    A sensor's effect is a hypothesis for each signal, named "sensor_bias.force". Raises ConfigurationError for names
    that are no effects of the plant.
    """
    known = plant.effects.effects
    for name in (*(only or ()), *without):
        require_known("effect", [name], known)
        if not known[name].parameters_on(plant.name):
            raise ConfigurationError(f"effect '{name}' does not act on {plant.name}")
    found: list[Hypothesis] = []
    for effect in known.values():
        if effect.name in without or (only is not None and effect.name not in only):
            continue
        parameters = effect.parameters_on(plant.name)
        if effect.each_sensor:
            groups = [(f"{effect.name}.{p.name}", (p,)) for p in parameters if p.name in signals]
        else:
            groups = [(effect.name, parameters)] if parameters else []
        found += [
            h for name, group in groups if (h := _hypothesis(plant, effect, name, group, values, modelled, travel))
        ]
    return found


def _hypothesis(
    plant: Plant,
    effect: Effect,
    name: str,
    parameters: Sequence[EffectParameter],
    values: Mapping[str, float],
    modelled: Collection[str],
    travel: float | None,
) -> Hypothesis | None:
    rows = {p.aliases.get(plant.name, f"{effect.name}.{p.name}"): p for p in parameters}
    # what a recording claims to know as absent is what may be missing
    absent = {row: p for row, p in rows.items() if row not in modelled and values[row] == p.null}
    sizes = {row: p for row, p in absent.items() if not p.shape}
    if not sizes:
        return None  # the model has it already
    free, probes = [], []
    for row, p in absent.items():
        if p.shape and row not in _SHAPES and row not in ("position_ripple.period", "position_ripple.phase"):
            continue  # one number more than a recording of this length usually shows
        typical = p.typical_on(plant.name)
        scale = abs(typical - p.null) or abs(p.null) or 1.0
        free.append(Free(row, p.null, LEAST.get(row, p.low), p.high, scale))
    for row, p in sizes.items():
        step = p.typical_on(plant.name) - p.null
        shapes = {r: [f * absent[r].typical_on(plant.name) for f in _SHAPES[r]] for r in absent if r in _SHAPES}
        signs = (1.0, -1.0) if row in _SIGNED and p.low < p.null else (1.0,)
        sizes_of = [f * p.typical_on(plant.name) for f in STIFFNESSES] if row in INVERSE else ()
        scales = SIZES[-1:] if effect.name in PROPORTIONAL else _FINE.get(row, SIZES)
        values_of = sizes_of or [p.null + sign * size * step for size in scales for sign in signs]
        for value, *shape in product(values_of, *shapes.values()):
            one = {row: min(max(value, p.low), p.high), **dict(zip(shapes, shape, strict=True))}
            probes.append((one,))
    if effect.name == "position_ripple" and travel:
        free = [_within(f, travel) for f in free]
        probes = _waves(next(iter(sizes)), sizes, plant.name, travel)
    nulls = {row: p.null for row, p in sizes.items()}
    return Hypothesis(
        name, tuple(free), tuple(probes), effect.equation, effect.experiment, effect.confusable, nulls
    )  # fmt: skip


def _within(free: Free, travel: float) -> Free:
    """A ripple has at least one and a half waves over the travel, else it is a spring or a constant."""
    if free.name != "position_ripple.period":
        return free
    return replace(free, start=travel / 4.0, low=travel / 25.0, high=travel / 1.5, scale=travel / 4.0)


def _waves(size: str, sizes: Mapping[str, EffectParameter], plant: str, travel: float) -> list:
    """Sine and cosine together for every number of waves over the travel; steps of half a wave miss none."""
    height = 0.1 * sizes[size].typical_on(plant)
    found = []
    for waves in np.arange(*WAVES):
        period = travel / waves
        one = {size: min(height, 0.1 * period), "position_ripple.period": period}
        found.append(tuple({**one, "position_ripple.phase": phase} for phase in (0.0, 0.5 * np.pi)))
    return found
