"""What a kernel is filed under: a digest of its code, the code of every piece that it calls, and all that they read."""

import dis
import hashlib
import sys
import types
from collections.abc import Callable, Iterator
from functools import cache
from typing import Any

import numpy as np
from numba.core.dispatcher import Dispatcher
from numba.core.extending import _Intrinsic
from numba.core.types import Type


class NotStorable(TypeError):
    """Something that a kernel reads has no content that another process could recognise."""


class Digests:
    """Digests of functions with all that they call.

    Parameters
    ----------
    seed : bytes
        What every digest begins with.

    Attributes
    ----------
    functions : dict
        Digest of every function that was met.
    """

    def __init__(self, seed: bytes = b""):
        self.seed = seed
        self.functions: dict[types.FunctionType, str] = {}
        self._open: set[types.FunctionType] = set()

    def of(self, function: Any) -> str:
        """The digest of a plain function and its closure, 64 hexadecimal digits.

        Raises
        ------
        NotStorable
            Where the function reads something that cannot be told apart by its content.
        """
        if function in self.functions:
            return self.functions[function]
        if function in self._open:
            return f"recursion into {function.__name__}"
        self._open.add(function)
        digest = hashlib.sha256(self.seed)
        for part in self._parts(function):
            digest.update(part.encode())
            digest.update(b"\0")
        self._open.discard(function)
        self.functions[function] = digest.hexdigest()
        return self.functions[function]

    def _parts(self, function: types.FunctionType) -> Iterator[str]:
        code = function.__code__
        yield from self._code(code, function.__doc__)
        yield self._value(function.__defaults__)
        for name, value in sorted((function.__kwdefaults__ or {}).items()):
            yield f"{name}={self._value(value)}"
        for cell in function.__closure__ or ():
            yield self._value(cell.cell_contents)
        for name, attributes in names_read(code).items():
            if name not in function.__globals__:
                continue
            value = function.__globals__[name]
            if isinstance(value, types.ModuleType) and is_ours(value):
                for asked in attributes:
                    yield f"{name}.{asked}={self._value(getattr(value, asked, None))}"
            else:
                yield f"{name}={self._value(value)}"

    def _code(self, code: types.CodeType, doc: str | None = None) -> Iterator[str]:
        yield code.co_code.hex()
        yield repr((code.co_name, code.co_names, code.co_varnames, code.co_freevars, code.co_cellvars, code.co_flags))
        yield repr((code.co_argcount, code.co_posonlyargcount, code.co_kwonlyargcount))
        for k, value in enumerate(code.co_consts):
            if k == 0 and doc is not None and isinstance(value, str):
                continue  # the docstring
            yield "".join(self._code(value)) if isinstance(value, types.CodeType) else self._value(value)

    def _value(self, value: Any) -> str:
        """What stands for a value that compiled code may read."""
        if isinstance(value, type) and hasattr(value, "_fields"):
            return f"namedtuple {value.__name__} {value._fields!r}"
        for kinds, said in _SAID:
            if isinstance(value, kinds):
                return f"{type(value).__name__} {said(self, value)}"
        raise NotStorable(f"{type(value).__name__} {value!r:.80}")


def _function(digests: Digests, function: types.FunctionType) -> str:
    """A plain function among the globals: ours by content, a library's by name."""
    return digests.of(function) if is_ours(function) else f"{function.__module__}.{function.__name__}"


def _array(digests: Digests, array: np.ndarray) -> str:
    return f"{array.dtype} {array.shape} {hashlib.sha256(np.ascontiguousarray(array).data).hexdigest()}"


_SAID: tuple[tuple[Any, Callable[[Digests, Any], str]], ...] = (
    ((type(None), bool, int, float, complex, str, bytes, np.generic), lambda digests, value: repr(value)),
    ((tuple, list), lambda digests, value: ", ".join(digests._value(v) for v in value)),
    (frozenset, lambda digests, value: ", ".join(sorted(digests._value(v) for v in value))),
    (np.ndarray, _array),
    (Dispatcher, lambda digests, value: f"{sorted(value.targetoptions.items())!r} {digests.of(value.py_func)}"),
    (_Intrinsic, lambda digests, value: digests.of(value._defn)),
    (types.ModuleType, lambda digests, value: value.__name__),
    ((Type, np.dtype), lambda digests, value: str(value)),
    (types.FunctionType, _function),
    ((types.BuiltinFunctionType, type, np.ufunc), lambda digests, value: f"{_module_of(value)} {value.__name__}"),
)
"""How a value of each kind is written for a digest."""


def _module_of(value: Any) -> str:
    return str(getattr(value, "__module__", ""))


@cache
def names_read(code: types.CodeType) -> dict[str, list[str]]:
    """Global names that code reads, that of functions within it too, each with the attributes asked of it."""
    found: dict[str, list[str]] = {}
    last = None
    for step in dis.get_instructions(code):
        if step.opname in ("LOAD_GLOBAL", "LOAD_NAME"):
            last = found.setdefault(step.argval, [])
        else:
            if last is not None and step.opname in ("LOAD_ATTR", "LOAD_METHOD"):
                last.append(step.argval)
            last = None
    for value in code.co_consts:
        if isinstance(value, types.CodeType):
            for name, asked in names_read(value).items():
                found.setdefault(name, []).extend(asked)
    return found


def is_ours(thing: Any) -> bool:
    """Whether a function or module is no part of Python or of an installed library."""
    name = (thing.__name__ if isinstance(thing, types.ModuleType) else thing.__module__) or ""
    package = name.split(".")[0]
    return package not in sys.stdlib_module_names and package not in ("numpy", "numba", "llvmlite", "scipy")
