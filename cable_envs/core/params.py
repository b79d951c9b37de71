"""Declared parameters: name, unit, default, bounds, source. What a rig may hold is declared once, in its plant.

A `ParameterTable` turns a mapping of values (numbers in SI, or ``{value, unit}``) into a float64 vector in table
order, and refuses unknown names, wrong units and values outside the physical bounds.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from cable_envs.core.errors import ConfigurationError, nearest, require_known

_UNITS: dict[str, tuple[str, float]] = {  # unit -> (SI unit, factor)
    "mm": ("m", 1e-3),
    "cm": ("m", 1e-2),
    "um": ("m", 1e-6),
    "km": ("m", 1e3),
    "mm/s": ("m/s", 1e-3),
    "mm/s^2": ("m/s^2", 1e-3),
    "deg": ("rad", math.pi / 180),
    "deg/s": ("rad/s", math.pi / 180),
    "rpm": ("rad/s", math.pi / 30),
    "g": ("kg", 1e-3),
    "kN": ("N", 1e3),
    "mN": ("N", 1e-3),
    "N/mm": ("N/m", 1e3),
    "kN/m": ("N/m", 1e3),
    "mN m": ("N m", 1e-3),
    "N mm": ("N m", 1e-3),
    "g cm^2": ("kg m^2", 1e-7),
    "N mm^2": ("N m^2", 1e-6),
    "ms": ("s", 1e-3),
    "us": ("s", 1e-6),
    "min": ("s", 60.0),
    "h": ("s", 3600.0),
    "GPa": ("Pa", 1e9),
    "MPa": ("Pa", 1e6),
    "%": ("1", 1e-2),
    "Hz": ("Hz", 1.0),
    "kHz": ("Hz", 1e3),
    "mA": ("A", 1e-3),
}


def to_si(value: float, unit: str, si_unit: str, name: str = "value") -> float:
    """A number given in one unit, converted to another of the same kind.

    Parameters
    ----------
    value : float
        The number.
    unit : str
        Its unit.
    si_unit : str
        SI unit that is wanted.
    name : str
        What it is, for the error.

    Returns
    -------
    float
        The number in ``si_unit``.

    Raises
    ------
    ConfigurationError
        When the unit is unknown or of another kind.

    Examples
    --------
    >>> to_si(0.2, "mm", "m")
    0.0002
    """
    if unit == si_unit:
        return float(value)
    si, factor = _UNITS.get(unit, (None, 0.0))
    if si != si_unit:
        fits = [si_unit, *(u for u, (base, _) in _UNITS.items() if base == si_unit)]
        raise ConfigurationError(f"{name}: unit '{unit}' does not fit; expected {' or '.join(fits)}")
    return float(value) * factor


def si_of(unit: str) -> str:
    """The SI unit to which a unit converts; the unit itself where it is one, or is not known.

    Parameters
    ----------
    unit : str
        As in a file.

    Returns
    -------
    str
        The unit of the converted number.

    Examples
    --------
    >>> si_of("mm"), si_of("N m")
    ('m', 'N m')
    """
    return _UNITS.get(unit, (unit, 1.0))[0]


def is_number(value: Any) -> bool:
    """Whether a value is a finite real number, of Python or NumPy; a bool is none.

    Parameters
    ----------
    value : Any
        What was given.

    Returns
    -------
    bool
        False for NaN, infinities, and everything that is no number.

    Examples
    --------
    >>> is_number(1.5), is_number(True), is_number(float("nan")), is_number("1.5")
    (True, False, False, False)
    """
    number = isinstance(value, (int, float, np.floating, np.integer)) and not isinstance(value, bool)
    return number and math.isfinite(value)


@dataclass(frozen=True)
class Parameter:
    """One declared number.

    Attributes
    ----------
    name : str
        Name of the parameter.
    unit : str
        SI unit.
    default : float
        Value where a rig says none.
    low, high : float
        Physical bounds, both included.
    meaning : str
        What it is, for people.
    source : str
        Where the default is from.
    """

    name: str
    unit: str
    default: float
    low: float
    high: float
    meaning: str
    source: str = ""

    def check(self, value: Any) -> float:
        """A given value as a number in SI.

        Parameters
        ----------
        value : float or mapping
            A number in SI, or a mapping with "value" and, unless it is in SI, "unit". "source" and "note" may stand
            beside.

        Returns
        -------
        float
            Within the bounds, SI.

        Raises
        ------
        ConfigurationError
            For what is no number, a unit that does not fit, and values out of bounds.

        Examples
        --------
        >>> Parameter("mass", "kg", 1.0, 0.0, 10.0, "mass of the load").check({"value": 500, "unit": "g"})
        0.5
        """
        if isinstance(value, Mapping):
            require_known(f"key in parameter '{self.name}'", value, ("value", "unit", "source", "note"))
            if "value" not in value:
                raise ConfigurationError(f"{self.name}: a mapping needs 'value' (and 'unit' unless it is {self.unit})")
            number, unit = value["value"], str(value.get("unit", self.unit))
        else:
            number, unit = value, self.unit
        if isinstance(number, bool) or not isinstance(number, (int, float, np.floating, np.integer)):
            raise ConfigurationError(f"{self.name}: expected a number in {self.unit}, got {number!r}")
        result = to_si(float(number), unit, self.unit, self.name)
        if not (math.isfinite(result) and self.low <= result <= self.high):
            raise ConfigurationError(
                f"{self.name} = {result:g} {self.unit} is outside its physical range [{self.low:g}, {self.high:g}]"
            )
        return result


class ParameterTable:
    """An ordered set of `Parameter`; the order is the row order of the kernels' parameter arrays.

    Parameters
    ----------
    *parameters : Parameter
        In their order.
    aliases : mapping of str to str, optional
        Further names of some of them.
    gone : mapping of str to str, optional
        Names that were parameters once, and why they no longer are.

    Attributes
    ----------
    names : tuple of str
        Names of the parameters, without the aliases.

    Raises
    ------
    ValueError
        Where a name is declared twice.

    Examples
    --------
    >>> mass, force = Parameter("mass", "kg", 1.0, 0.0, 10.0, "mass"), Parameter("force", "N", 0.0, -5.0, 5.0, "force")
    >>> table = ParameterTable(mass, force)
    >>> table.pack({"force": 2.0})
    array([1., 2.])
    >>> table.unpack([1.0, 2.0])
    {'mass': 1.0, 'force': 2.0}
    """

    def __init__(
        self, *parameters: Parameter, aliases: Mapping[str, str] | None = None, gone: Mapping[str, str] | None = None
    ):
        self._items = {p.name: p for p in parameters}
        self._aliases, self.gone = dict(aliases or {}), dict(gone or {})
        if len(self._items) != len(parameters):
            raise ValueError("parameter declared twice")
        self.names = tuple(self._items)

    def __iter__(self) -> Iterator[Parameter]:
        return iter(self._items.values())

    def __len__(self) -> int:
        return len(self.names)

    def __contains__(self, name: str) -> bool:
        return self._aliases.get(name, name) in self._items

    def __getitem__(self, name: str) -> Parameter:
        name = self._aliases.get(name, name)
        if name not in self._items:
            raise ConfigurationError(f"unknown parameter '{name}'; {nearest(name, self.names)}")
        return self._items[name]

    def index(self, name: str) -> int:
        """Row of a parameter, by its name or an alias; ValueError where there is none."""
        return self.names.index(self._aliases.get(name, name))

    def pack(self, values: Mapping[str, Any]) -> np.ndarray:
        """Given values over the defaults.

        Parameters
        ----------
        values : mapping
            Name or alias to a value as `Parameter.check` takes it.

        Returns
        -------
        ndarray of float64, shape (len(self),)
            In the order of the table, SI.

        Raises
        ------
        ConfigurationError
            For unknown names (with the nearest), names that have gone (with the reason), wrong units and values out of
            bounds.
        """
        for name in values:
            if name in self.gone:
                raise ConfigurationError(f"parameter '{name}' has gone: {self.gone[name]}")
        values = {self._aliases.get(name, name): value for name, value in values.items()}
        require_known("parameter", values, self.names)
        return np.array([p.check(values.get(p.name, p.default)) for p in self])

    def unpack(self, vector: np.ndarray) -> dict[str, float]:
        """The inverse of `pack`: values of shape (len(self),) by name."""
        return {name: float(v) for name, v in zip(self.names, vector, strict=True)}
