"""A simulator with the physics that a diagnosis has named, at its ports; and what augmented.yaml says of it."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from cable_envs.core.config import read_yaml
from cable_envs.core.errors import ConfigurationError, require_known
from cable_envs.core.params import is_number
from cable_envs.diagnosis.model.hypotheses import Hypothesis
from cable_envs.diagnosis.simulators.base import Columns, Session, Simulator
from cable_envs.diagnosis.simulators.motion import FIRST, Course, simulated, steps_of
from cable_envs.diagnosis.simulators.signals import shown
from cable_envs.effects import EffectParameter
from cable_envs.effects.library import dotted

SCHEMA = "cable-simulator/1"


class Corrected(Simulator):
    """A simulator with physics added at its commands, ports and sensors; used as the one that it corrects.

    Parameters
    ----------
    simulator : Simulator
        What is corrected; one that has been corrected already keeps what it has.
    values : mapping of str to float
        Parameters that are nominal from now on.
    terms : mapping of str to float
        Rows of effects, "coulomb_friction.pivot.level", SI.

    Notes
    -----
    `simulate` gives what sensors show: outputs with their scale, lag and so on.
    """

    def __init__(self, simulator: Simulator, values: Mapping[str, float], terms: Mapping[str, float]):
        inner = simulator.inner
        parameters = tuple(
            replace(p, nominal=min(max(values.get(p.name, p.nominal), p.low), p.high), std=None)
            for p in simulator.declaration.parameters
        )
        super().__init__(replace(simulator.declaration, parameters=parameters), simulator.workers)
        self._inner, self.terms, self.together = inner, {**simulator.terms, **terms}, inner.together
        self._small: dict[str, float] | None = None

    @property
    def inner(self) -> Simulator:
        return self._inner

    def plain(self) -> Simulator:
        return Corrected(self._inner, self.declaration.nominal, {})

    def begin(self, parameters: Columns, first: Columns) -> Session:
        raise ConfigurationError("a corrected simulator makes whole runs: call simulate")

    def source(self) -> bytes:
        return self._inner.source()

    def whole(self, commands: Columns, parameters: Columns, first: Columns, forces: Columns) -> dict[str, np.ndarray]:
        count = len(next(iter(parameters.values())))
        parts = [slice(0, count)] if self.together else [slice(k, k + 1) for k in range(count)]
        found: list[dict[str, np.ndarray]] = []
        for part in parts:
            values = {name: column[part] for name, column in parameters.items()}
            values |= {FIRST + name: column[part] for name, column in first.items()}
            course = Course(
                {name: series[part] for name, series in commands.items()}, {},
                {name: series[part] for name, series in forces.items()},
            )  # fmt: skip
            if self._small is None:
                self._small = self._sizes(course, values)
            width = len(next(iter(values.values())))
            rows = {name: np.full(width, value) for name, value in self.terms.items()}
            found.append(self._shown(simulated(self._inner, course, {**values, **rows}, self._small), rows))
        return {name: np.concatenate([one[name] for one in found]) for name in found[0]}

    def _sizes(self, course: Course, values: Columns) -> dict[str, float]:
        one = Course({n: c[:1] for n, c in course.commands.items()})
        return steps_of(self._inner, one, {name: float(column[0]) for name, column in values.items()})

    def _shown(self, outputs: Columns, rows: Columns) -> dict[str, np.ndarray]:
        names = list(outputs)
        series = np.stack([outputs[name].T for name in names], axis=1)
        seen = shown(names, series, rows, self.declaration.period)
        return {name: np.ascontiguousarray(seen[:, j].T) for j, name in enumerate(names)}


def augmented(
    simulator: Simulator, values: Mapping[str, float], accepted: Sequence[str], rows: Mapping[str, EffectParameter],
    hypotheses: Mapping[str, Hypothesis],
) -> dict[str, Any]:  # fmt: skip
    """Content of augmented.yaml."""
    d = simulator.declaration
    own = {
        p.name: {"value": min(max(float(values[p.name]), p.low), p.high), "unit": p.unit, "source": "diagnosis"}
        for p in d.parameters
    }
    effects: dict[str, dict[str, Any]] = {}
    kept = [row for row in rows if row in simulator.terms]
    for name in accepted:
        h = hypotheses.get(name)
        effect = h.effect if h is not None else None
        if h is None or effect is None:
            continue  # of the logger, or of nothing at a port
        of = [effect.row(p) for p in effect.parameters if not effect.each_sensor or effect.row(p) == name]
        kept += [row for row in of if row not in kept]
    for row in kept:
        effect_name, _, parameter = row.partition(".")
        p = rows[row]
        there = {"value": min(max(float(values[row]), p.low), p.high), "unit": p.unit}
        effects.setdefault(effect_name, {})[parameter] = there
    found: dict[str, Any] = {"schema": SCHEMA, "name": "augmented", "simulator": d.name, "parameters": own}
    return found | ({"effects": effects} if effects else {})


def corrected(simulator: Simulator, found: Any) -> Corrected:
    """A simulator with what a diagnosis has named.

    Parameters
    ----------
    simulator : Simulator
        That was diagnosed.
    found : Diagnosis, mapping, Path or str
        The diagnosis, its augmented.yaml, or the content of that.

    Returns
    -------
    Corrected
        The same interface.

    Raises
    ------
    ConfigurationError
        For a file of something else, or of another simulator.

    Examples
    --------
    ::

        better = corrected(pendulum, "answer/augmented.yaml")
        better.simulate({"torque": torque}, first={"angle": 0.1, "speed": 0.0})["angle"]
    """
    content = getattr(found, "rig", found)
    content = content if isinstance(content, Mapping) else read_yaml(Path(content))
    if content.get("schema") != SCHEMA:
        raise ConfigurationError(f"expected an augmented.yaml of schema '{SCHEMA}', found {content.get('schema')!r}")
    name = simulator.declaration.name
    if content.get("simulator") != name:
        raise ConfigurationError(
            f"this augmented.yaml belongs to simulator '{content.get('simulator')}', not to '{name}'"
        )
    parameters = {n: _number(n, entry) for n, entry in (content.get("parameters") or {}).items()}
    require_known(f"parameter of {name}", parameters, simulator.declaration.nominal)
    terms = {row: _number(row, entry) for row, entry in _rows(content.get("effects") or {})}
    return Corrected(simulator, parameters, terms)


def _rows(effects: Mapping[str, Any]) -> list[tuple[str, Any]]:
    return list(dotted(effects))


def _number(name: str, entry: Any) -> float:
    value = entry.get("value") if isinstance(entry, Mapping) else entry
    if value is None or not is_number(value):
        raise ConfigurationError(f"{name}: expected a number, got {value!r}")
    return float(value)
