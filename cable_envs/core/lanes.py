"""Named rows of a structure of arrays, from one declaration.

A kernel works on tiles: blocks of up to `LANES` columns on the stack. `Lanes` declares the rows of such a block once; a
kernel then reads ``x.load_position[i]`` and ``p.wrap_angle[h, i]`` (column i), and Python code reads and writes whole
rows of an array [rows, n] by the same names (`Lanes.over`). No row has a number outside this file.

Names cost nothing: the compiler knows the place of every row, so the machine code is that of numbered rows.
"""

from collections import namedtuple
from collections.abc import Callable, Iterable, Mapping
from functools import cached_property
from typing import Any

import numpy as np

from cable_envs.core.kernels import LANES, inline, row_at, rows_at, stack

Field = str | tuple[str | tuple[str, ...], int]
"""A name; a name with how many rows it has; or names that take turns, with how often they do."""


class Lanes:
    """An ordered declaration of rows.

    Parameters
    ----------
    name : str
        Name of the named tuple that a tile is, for messages.
    fields : iterable of str, (str, int) or (tuple of str, int)
        A field is one row; (name, count) as many rows in sequence; ((a, b), count) the rows a, b, a, b and so on.

    Attributes
    ----------
    names : tuple of str
        Names of the fields.
    count : int
        Number of rows.
    tile : callable
        For kernels: ``tile()`` makes a block on the stack. A field of it is indexed by its column, ``x.speed[i]``, or
        by its number and column, ``x.spring[k, i]``. Its field ``rows`` is the whole block [self.count, LANES], which
        `kernels.load` and `kernels.store` fill and empty.

    Examples
    --------
    >>> mass = Lanes("Mass", ["position", "speed", ("spring", 2)])
    >>> mass.row("speed"), mass.row("spring", 1), mass.count
    (1, 3, 4)
    >>> x = mass.over(np.zeros((4, 3)))
    >>> x.speed[:] = 2.0
    >>> x.rows[1]
    array([2., 2., 2.])
    """

    def __init__(self, name: str, fields: Iterable[Field]):
        self._declared = (name, tuple(fields))
        self._places: dict[str, tuple[int, int, int]] = {}
        """field -> (first row, number of rows or -1 where it is no sequence, distance between them)"""
        self.count = 0
        declared = 0
        for field in self._declared[1]:
            turns, many = (field, -1) if isinstance(field, str) else field
            together = (turns,) if isinstance(turns, str) else turns
            for k, one in enumerate(together):
                self._places[one] = (self.count + k, many, len(together))
            declared += len(together)
            self.count += abs(many) * len(together)
        self.names = tuple(self._places)
        if len(self.names) != declared or "rows" in self.names:
            raise ValueError(f"{name}: a field is declared twice, or is called 'rows'")
        self.kind = namedtuple(name, ["rows", *self.names])  # type: ignore[misc]
        self.tile: Callable[[], Any] = self._maker()

    def __len__(self) -> int:
        return self.count

    def __contains__(self, field: str) -> bool:
        return field in self._places

    def extended(self, fields: Iterable[Field]) -> "Lanes":
        """The same rows with further ones behind them.

        Examples
        --------
        >>> Lanes("Mass", ["position"]).extended(["speed"]).names
        ('position', 'speed')
        """
        name, before = self._declared
        return Lanes(name, [*before, *fields])

    def row(self, field: str, k: int = 0) -> int:
        """Row of a field, or of its k-th one."""
        first, _, apart = self._places[field]
        return first + k * apart

    @property
    def labels(self) -> tuple[str, ...]:
        """A name for every row: that of its field, with its number behind it where the field has many."""
        found = [""] * self.count
        for field, (first, many, apart) in self._places.items():
            for k in range(abs(many)):
                found[first + k * apart] = field if many < 0 else f"{field}_{k}"
        return tuple(found)

    def pack(self, rows: Mapping[str, Any], n: int) -> np.ndarray:
        """An array [count, n] with ``rows`` (numbers, [n], or [count, n] where a field has many) in their places.

        Raises ValueError where a field is missing or unknown.
        """
        if set(rows) != set(self.names):
            raise ValueError(f"rows missing or unknown: {', '.join(sorted(set(rows) ^ set(self.names)))}")
        packed = self.zeros(n)
        for field, values in rows.items():
            getattr(packed, field)[:] = values
        return packed.rows

    def over(self, array: np.ndarray) -> Any:
        """Views of an array's [rows, n] first rows under their names: [n], or [count, n] where a field has many."""
        parts = []
        for first, many, apart in self._places.values():
            parts.append(array[first] if many < 0 else array[first : first + many * apart : apart])
        return self.kind(array[: self.count], *parts)

    def zeros(self, n: int) -> Any:
        """`over` a new array of zeros [count, n]."""
        return self.over(np.zeros((self.count, n)))

    def _maker(self) -> Callable[[], Any]:
        """The function that makes a tile; it is written out, as compiled code cannot loop over names."""
        parts = [f"rows_at(base, 0, ({max(self.count, 1)}, {LANES}))"]
        for first, many, apart in self._places.values():
            if many < 0:
                parts.append(f"row_at(base, {first})")
            elif apart == 1:
                parts.append(f"rows_at(base, {first}, ({many}, {LANES}))")
            else:
                parts.append(f"rows_at(base, {first}, ({many * apart}, {LANES}))[::{apart}]")
        body = f"base = stack({max(self.count, 1)}); return kind({', '.join(parts)})"
        return _written("tile()", body, row_at=row_at, rows_at=rows_at, stack=stack, kind=self.kind)

    def slices(self, array: str) -> list[str]:
        """For each field the text of what takes its rows from an array of that name."""
        parts = []
        for first, many, apart in self._places.values():
            turns = "" if apart == 1 else f":{apart}"
            parts.append(f"{array}[{first}]" if many < 0 else f"{array}[{first}:{first + many * apart}{turns}]")
        return parts

    @cached_property
    def views(self) -> Callable[[np.ndarray], Any]:
        """For kernels: `over`."""
        parts = [f"array[:{self.count}]", *self.slices("array")]
        return _written("views(array)", f"return kind({', '.join(parts)})", kind=self.kind)

    @cached_property
    def column(self) -> Callable[[np.ndarray, int], tuple[float, ...]]:
        """For kernels: a column of the rows, in their order, as a tuple of numbers."""
        return _written("column(array, i)", f"return ({' '.join(f'array[{row}, i],' for row in range(self.count))})")


def _written(head: str, body: str, **names: Any) -> Callable[..., Any]:
    """A piece of kernels from its text."""
    space: dict[str, Any] = dict(names)
    exec(f"def {head}: {body}", space)
    return inline(space[head.partition("(")[0]])
