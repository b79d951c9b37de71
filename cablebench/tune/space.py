"""What a tuner may vary: one dimension for each gain of a controller or setting of an agent.

A controller's dimensions come from its `ParameterTable`. Bounds above zero that span two decades or more are searched
on a logarithmic scale. Most gains have zero as their low bound, some are negative, where a logarithm has no meaning:
they are searched on the scale of ``asinh(value / s)``, which is linear up to s and logarithmic beyond, on both sides of
zero. s is a tenth of the default, or a thousandth of the larger bound where the default is zero. Bounds within a
hundred times s are searched linearly.

An agent's dimensions stand in its settings file (configs/agents/), names with dots going into mappings::

    search:
      learning_rate: {log: [1.0e-4, 1.0e-2], schedule: lin}   # tried as lin_<value>
      gamma: {choice: [0.9, 0.95, 0.98]}                      # choices may be lists or mappings
      batch_size: {log_int: [256, 4096]}
      policy_kwargs.log_std_init: {linear: [-2.0, 0.0]}

One of linear, log, int, log_int, choice each; the file's own value must lie inside, for it is the first trial.
"""

import json
import math
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from cable_envs.core.errors import ConfigurationError, require_known
from cable_envs.core.params import Parameter, ParameterTable, is_number

KINDS = ("linear", "log", "int", "log_int", "choice")
DIGITS = 6
"""Significant digits of what is tried: the file that is written holds the very numbers."""


@dataclass(frozen=True)
class Dimension:
    """One quantity to vary; the optimiser sees its `coordinate`."""

    name: str
    kind: str
    """one of `KINDS`, or asinh"""
    low: float = 0.0
    high: float = 0.0
    scale: float = 1.0
    """s of asinh"""
    choices: tuple[str, ...] = ()
    """as JSON texts"""
    schedule: str = ""
    """prefix of a schedule: "lin" """

    def distribution(self) -> Any:
        """Optuna's distribution of the coordinate."""
        from optuna import distributions

        if self.kind == "choice":
            return distributions.CategoricalDistribution(self.choices)
        if self.kind.endswith("int"):
            return distributions.IntDistribution(int(self.low), int(self.high), log=self.kind == "log_int")
        if self.kind == "asinh":
            return distributions.FloatDistribution(
                math.asinh(self.low / self.scale), math.asinh(self.high / self.scale)
            )
        return distributions.FloatDistribution(self.low, self.high, log=self.kind == "log")

    def value(self, coordinate: Any) -> Any:
        """The value that is tried."""
        if self.kind == "choice":
            return json.loads(coordinate)
        if self.kind.endswith("int"):
            return int(coordinate)
        raw = self.scale * math.sinh(coordinate) if self.kind == "asinh" else coordinate
        number = min(max(float(f"{raw:.{DIGITS}g}"), self.low), self.high)
        return f"{self.schedule}_{number:g}" if self.schedule else number

    def coordinate(self, value: Any) -> Any:
        """The inverse of `value`; ConfigurationError where the value lies outside."""
        if self.kind == "choice":
            text = json.dumps(value, sort_keys=True)
            if text not in self.choices:
                raise ConfigurationError(f"{self.name}: {text} is not among the choices {', '.join(self.choices)}")
            return text
        if self.schedule and isinstance(value, str):
            value = value.removeprefix(f"{self.schedule}_")
        try:
            number = float(value)
        except (TypeError, ValueError):
            raise ConfigurationError(f"{self.name}: expected a number to start from, found {value!r}") from None
        if not self.low <= number <= self.high:
            raise ConfigurationError(f"{self.name} = {number:g} is outside its range [{self.low:g}, {self.high:g}]")
        if self.kind.endswith("int"):
            return round(number)
        return math.asinh(number / self.scale) if self.kind == "asinh" else number


def gain_space(table: ParameterTable) -> tuple[Dimension, ...]:
    """The dimensions of a controller's gains."""
    return tuple(_gain(p) for p in table)


def _gain(p: Parameter) -> Dimension:
    if p.low > 0.0:
        return Dimension(p.name, "log" if p.high / p.low >= 100.0 else "linear", p.low, p.high)
    reach = max(-p.low, p.high)
    scale = abs(p.default) / 10.0 or reach / 1000.0
    return Dimension(p.name, "asinh" if reach >= 100.0 * scale else "linear", p.low, p.high, scale)


def parse_space(search: Any, source: str) -> tuple[Dimension, ...]:
    """The dimensions under ``search`` in a settings file; ConfigurationError names ``source`` and the key."""
    if not isinstance(search, Mapping) or not search:
        raise ConfigurationError(f"{source} has no 'search': a mapping of settings to what `cablebench tune` may try")
    return tuple(_setting(str(name), data, f"search.{name} in {source}") for name, data in search.items())


def _setting(name: str, data: Any, where: str) -> Dimension:
    if not isinstance(data, Mapping):
        raise ConfigurationError(f"{where}: expected a mapping with one of {', '.join(KINDS)}, found {data!r}")
    require_known(f"key of {where}", data, (*KINDS, "schedule"))
    kinds = [k for k in KINDS if k in data]
    if len(kinds) != 1:
        raise ConfigurationError(f"{where}: expected one of {', '.join(KINDS)}, found {' and '.join(kinds) or 'none'}")
    kind, schedule = kinds[0], str(data.get("schedule", ""))
    require_known(f"schedule of {where}", [schedule] if schedule else [], ("lin",))
    bounds = data[kind]
    if not isinstance(bounds, (list, tuple)) or len(bounds) < 2:
        raise ConfigurationError(f"{where}: {kind} needs a list of at least two values, found {bounds!r}")
    if kind == "choice":
        return Dimension(name, kind, choices=tuple(json.dumps(c, sort_keys=True) for c in bounds))
    low, high = (_bound(b, where) for b in bounds[:2])
    if len(bounds) != 2 or not low < high or (kind.startswith("log") and low <= 0):
        raise ConfigurationError(
            f"{where}: {kind} needs [low, high] with low < high, above 0 for log; found {bounds!r}"
        )
    return Dimension(name, kind, low, high, schedule=schedule)


def _bound(value: Any, where: str) -> float:
    if isinstance(value, str):  # YAML 1.1 takes 1e-4 for a text
        with suppress(ValueError):
            value = float(value)
    if not is_number(value):
        raise ConfigurationError(f"{where}: bounds must be numbers, found {value!r}")
    return float(value)


def nested(values: Mapping[str, Any]) -> dict[str, Any]:
    """``{"a.b": 1}`` as ``{"a": {"b": 1}}``."""
    found: dict[str, Any] = {}
    for name, value in values.items():
        *parents, last = name.split(".")
        place = found
        for parent in parents:
            place = place.setdefault(parent, {})
        place[last] = value
    return found
