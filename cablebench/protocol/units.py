"""How SI values are shown to people: units, factors, three significant digits. Stored values are always SI."""

from typing import Any

from cable_envs.core.text import number
from cablebench.protocol.metrics import METRICS

_PERCENT = (
    "overshoot",
    "slack",
    "overload",
    "dropped",
    "success",
    "failed",
    "settling_2_censored",
    "settling_5_censored",
)
_BY_NAME = {m.name: m for m in METRICS}


def unit_of(name: str, table: Any) -> str:
    """Unit in which metric ``name`` (or "output", the controlled quantity) of a board table is shown."""
    if name in _PERCENT:
        return "%"
    output = "mm" if table.output_unit == "m" else table.output_unit
    if name == "output":
        return output
    unit = _BY_NAME[name].unit_of(output, table.command_unit)
    return unit.replace("^2", "²").replace("us", "µs") if unit != "1" else ""


def display(value: Any, name: str, table: Any) -> Any:
    """SI ``value`` of that metric in the unit of `unit_of`: metres as millimetres, shares as per cent."""
    if name in _PERCENT:
        return value * 100.0
    if table.output_unit == "m" and (name == "output" or "{y}" in _BY_NAME[name].unit):
        return value * 1e3
    return value


def axis_label(name: str, table: Any) -> str:
    """Label with unit for a figure's axis."""
    if name == "output":
        return f"output [{unit_of(name, table)}]"
    label = {"effort": "effort ∫u² dt"}.get(name, _BY_NAME[name].label)
    unit = unit_of(name, table)
    return f"{label} [{unit}]" if unit else label


def shown(value: float | None, name: str, table: Any) -> str:
    """A metric as text in the unit in which a table shows it.

    Parameters
    ----------
    value : float or None
        SI; None and NaN are shown as a dash.
    name : str
        Of the metric.
    table : Table
        Says the units of output and command.

    Returns
    -------
    str
        Three significant digits, without the unit (`unit_of`).
    """
    return number(None if value is None else display(value, name, table))
