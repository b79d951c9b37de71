"""Functions that kernels call: merged into each of them, and seldom called from Python."""

from functools import cached_property
from typing import Any

from numba.core.dispatcher import Dispatcher
from numba.core.registry import CPUDispatcher

_FOR_KERNELS = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
_OPTIONS = {"nopython": True, "forceinline": True, "error_model": "numpy"}


class Piece(CPUDispatcher):
    """A compiled function for kernels; what a call from Python needs is compiled at the first such call.

    That is code which unpacks arguments and packs results, for many pieces more than the function itself: without it a
    plant is compiled in two thirds of the time.
    """

    @cached_property
    def _for_python(self) -> Dispatcher:
        options = {name: value for name, value in self.targetoptions.items() if name not in _FOR_KERNELS}
        return CPUDispatcher(self.py_func, self.locals, options)

    def add_overload(self, cres: Any) -> None:
        """As of a dispatcher, but not where a call from Python looks: there is no address that it could jump to."""
        self.overloads[tuple(cres.signature.args)] = cres

    def _compile_for_args(self, *args: Any, **kws: Any) -> Any:
        """What a call from Python runs, asked for once for each signature."""
        callable_: Any = self._for_python
        own: Any = self
        entry = callable_._compile_for_args(*args, **kws)
        for found in callable_.overloads.values():
            if found.entry_point is entry:
                own._insert([kind._code for kind in found.signature.args], entry, found.objectmode)
        return entry


def piece(function: Any) -> Piece:
    """A plain function as a piece of kernels."""
    return Piece(function, targetoptions=_OPTIONS | _FOR_KERNELS)
