"""What a program is: records, functions, constants; and what is known of a value before it runs."""

import ast
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from cable_envs.core.errors import ConfigurationError
from cable_envs.core.lanes import Lanes

TILES = {
    "x": "signals", "p": "rig", "u": "inputs", "w": "scratch", "e": "effects", "s": "states", "g": "control",
}  # fmt: skip
"""The records of a program, by the names that `cable_envs.plants.base.Plant.solve` has for them."""

ELEMENTARY = ("select", "minimum", "maximum", "clip", "sign", "sqrt")
"""Functions of `cable_envs.core.kernels` that a program may leave to whoever prints it."""

INTRINSIC = ("select", "sqrt", "_fma", "to_bits", "from_bits", "_shift_right_52")
"""Those that have no source of their own."""


TOP = "control_step"
"""Name of the function of a program that calls all others."""


class NotTranslated(ConfigurationError):
    """A stage function has a construct that an export does not know."""


@dataclass(frozen=True)
class Tile:
    """One of the records; ``counts``: how many numbers each of its fields has, -1 where it is one number."""

    name: str
    counts: Mapping[str, int] = field(compare=False, hash=False)

    @classmethod
    def of(cls, name: str, lanes: Lanes) -> "Tile":
        """The record with the fields of a declaration."""
        rows = lanes.zeros(1)
        return cls(name, {f: len(getattr(rows, f)) if getattr(rows, f).ndim == 2 else -1 for f in lanes.names})


@dataclass(frozen=True)
class Row:
    """A field of a record: a number, or a sequence of ``count`` numbers, or the k-th of these."""

    tile: str
    field: str
    count: int = -1
    k: int = -1


@dataclass(frozen=True)
class Group:
    """A named tuple of rows."""

    fields: tuple[tuple[str, Any], ...]


@dataclass(frozen=True)
class Known:
    """A value that is known before the program runs."""

    value: Any
    name: str = ""


@dataclass(frozen=True)
class Mark:
    """The column that a function works on, or the number of columns."""

    what: str


COLUMN, LANES, NONE = Mark("column"), Mark("lanes"), Known(None)


@dataclass
class Made:
    """A function of the program.

    Attributes
    ----------
    node : ast.FunctionDef
        Its text. It takes the records that it needs, in the order of `TILES`, and then numbers.
    tiles : tuple of str
        The records.
    constant : Known, str or None
        What it always gives: a number, or its argument of that name. None: its text says it.
    origin : str
        Module and name of the function that it is made from.
    """

    node: ast.FunctionDef
    tiles: tuple[str, ...]
    constant: Any
    origin: str


@dataclass
class Program:
    """A plant's kernel for one mechanism.

    Attributes
    ----------
    functions : list of Made
        In an order in which each is defined before it is called; the last is `TOP`, with the arguments
        ``substeps`` and ``dt`` behind its records.
    constants : dict of str to (int or float)
        Named numbers that they read.
    records : dict of str to Lanes
        Fields of the records that the plant has.
    """

    functions: list[Made]
    constants: dict[str, float]
    records: dict[str, Lanes]
