"""Named rows of a structure of arrays, from one declaration.

A kernel works on tiles: blocks of up to `LANES` columns on the stack. `Lanes` declares the rows of such a block once; a
kernel then reads ``x.load_position[i]`` and ``p.wrap_angle[h, i]`` (column i), and Python code reads and writes whole
rows of an array [rows, n] by the same names (`Lanes.over`). No row has a number outside this file.

Names cost nothing: the compiler knows the place of every row, so the machine code is that of numbered rows.
"""

from collections import namedtuple
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from cable_envs.core.kernels import LANES, inline, rows_at, stack

Field = str | tuple[str, int]
"""A name, or a name with how many rows it has."""


class Lanes:
    """An ordered declaration of rows.

    Parameters
    ----------
    name : str
        Name of the named tuple that a tile is, for messages.
    fields : iterable of str or (str, int)
        A field is one row, or (name, count) as many rows in sequence.

    Attributes
    ----------
    names : tuple of str
        Names of the fields.
    count : int
        Number of rows.
    tile : callable
        For kernels: ``tile()`` makes a block on the stack; every field of it is [LANES], or [count, LANES]. Its field
        ``rows`` is the whole block [self.count, LANES], which `kernels.load` and `kernels.store` fill and empty.

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
        declared = [(field, 0) if isinstance(field, str) else field for field in fields]
        self.names = tuple(field for field, _ in declared)
        if len(set(self.names)) != len(declared) or "rows" in self.names:
            raise ValueError(f"{name}: a field is declared twice, or is called 'rows'")
        self._many = dict(declared)
        self._first: dict[str, int] = {}
        self.count = 0
        for field, many in declared:
            self._first[field] = self.count
            self.count += max(many, 1)
        self.kind = namedtuple(name, ["rows", *self.names])  # type: ignore[misc]
        self.tile: Callable[[], Any] = self._maker()

    def __contains__(self, field: str) -> bool:
        return field in self._first

    def row(self, field: str, k: int = 0) -> int:
        """Row of a field, or of its k-th one."""
        return self._first[field] + k

    def over(self, array: np.ndarray) -> Any:
        """Views of an array's [rows, n] first rows under their names: [n], or [count, n] where a field has many."""
        parts = []
        for field in self.names:
            first, many = self._first[field], self._many[field]
            parts.append(array[first : first + many] if many else array[first])
        return self.kind(array[: self.count], *parts)

    def zeros(self, n: int) -> Any:
        """`over` a new array of zeros [count, n]."""
        return self.over(np.zeros((self.count, n)))

    def _maker(self) -> Callable[[], Any]:
        """The function that makes a tile; it is written out, as compiled code cannot loop over names."""
        parts = [f"rows_at(base, 0, ({max(self.count, 1)}, {LANES}))"]
        for field in self.names:
            many = self._many[field]
            shape = f"({many}, {LANES})" if many else f"({LANES},)"
            parts.append(f"rows_at(base, {self._first[field]}, {shape})")
        text = f"def tile():\n    base = stack({max(self.count, 1)})\n    return kind({', '.join(parts)})"
        space: dict[str, Any] = {"rows_at": rows_at, "stack": stack, "kind": self.kind}
        exec(text, space)
        return inline(space["tile"])
