"""Kernels made from the text of others, with other values for some of the names that it reads."""

from types import FunctionType

import numba
from numba.core.dispatcher import Dispatcher

from cable_envs.core.compiling.cache import KernelCache, kept
from cable_envs.core.compiling.digests import is_ours, names_read
from cable_envs.core.compiling.pieces import Piece
from cable_envs.core.kernels import JIT_DISABLED, inline, jit


def inlined(kernel):
    """A kernel's text as a piece of another kernel: merged into its caller, which may know more about its arguments."""
    return inline(getattr(kernel, "py_func", kernel))


def instantiate(template, name="", /, **names):
    """A kernel made from another one's text, with other values for some of the names that it reads.

    Parameters
    ----------
    template : function
        A plain function, a kernel or a piece of one. It is left as it is.
    name : str, optional
        Name of the new kernel, by default that of the template.
    **names
        Values of global names, in the template and in every piece that it calls by name, at any depth. What reads none
        of them is shared with the template.

    Returns
    -------
    function
        As `jit` makes it.

    Examples
    --------
    >>> def total(a, n):
    ...     return law(a) * n
    >>> double = instantiate(total, "double", law=inline(lambda a: 2.0 * a))
    >>> double(1.5, 4.0)
    12.0
    """
    function = getattr(template, "py_func", template)
    return jit(_copied(function, name, _others(function, names, {})))


def specialised(piece, **names):
    """A piece of a kernel with other values for some of the names that it reads, as `instantiate` makes a kernel.

    Where neither the piece nor what it calls reads one of them, the piece itself.
    """
    function = getattr(piece, "py_func", piece)
    others = _others(function, names, {})
    return _like(piece, _copied(function, "", others)) if others else piece


def interpreted(function, /, **names):
    """A function, and every piece of a kernel that it calls by name, as plain Python.

    Parameters
    ----------
    function : function
        A plain function or a piece of a kernel. It is left as it is.
    **names
        Values of global names, in the function and in what it calls, at any depth: elementary functions of other
        numbers than floats, for instance.

    Returns
    -------
    function
        It takes whatever numbers ``names`` can work with.

    Examples
    --------
    >>> root = inline(lambda a: sqrt(a))
    >>> interpreted(lambda a: 2.0 * piece(a), piece=interpreted(root, sqrt=abs))(-3.0)
    6.0
    """
    return _interpreted(getattr(function, "py_func", function), names, {})


def names_within(piece):
    """Every global name that a piece of a kernel reads, or a piece that it calls by name, at any depth."""
    found, waiting, seen = set(), [piece], set()
    while waiting:
        function = waiting.pop()
        function = getattr(function, "py_func", function)
        if function not in seen:
            seen.add(function)
            names = names_read(function.__code__)
            found |= set(names)
            waiting += [value for name in names if is_piece(value := function.__globals__.get(name))]
    return found


def _others(function, names, done):
    """The globals of a function that must be others: those of ``names``, and the pieces that use one of them."""
    others = {}
    for used in names_read(function.__code__):
        if used in names:
            others[used] = names[used]
        elif is_piece(piece := function.__globals__.get(used)):
            if piece not in done:
                inner = getattr(piece, "py_func", piece)
                changed = _others(inner, names, done)
                done[piece] = _like(piece, _copied(inner, "", changed)) if changed else piece
            if done[piece] is not piece:
                others[used] = done[piece]
    return others


def _interpreted(function, names, done):
    if function not in done:
        others = {}
        for used in names_read(function.__code__):
            value = function.__globals__.get(used)
            inner = getattr(value, "py_func", value)
            if used in names:
                others[used] = names[used]
            elif isinstance(inner, FunctionType) and is_ours(inner):
                others[used] = _interpreted(inner, names, done)
        done[function] = _copied(function, "", others)
    return done[function]


def _copied(function, name, others):
    made = FunctionType(
        function.__code__, {**function.__globals__, **others}, name or function.__name__, function.__defaults__,
        function.__closure__,
    )  # fmt: skip
    made.__kwdefaults__ = function.__kwdefaults__
    made.__qualname__ = made.__name__
    return made


def is_piece(value):
    """Whether a value is a kernel or a piece of one."""
    if JIT_DISABLED:
        return isinstance(value, FunctionType) and is_ours(value)
    return isinstance(value, Dispatcher)


def _like(piece, function):
    """``function``, compiled as ``piece`` is."""
    if JIT_DISABLED or isinstance(piece, Piece):
        return inline(function)
    made = numba.jit(**piece.targetoptions)(function)
    return kept(made) if isinstance(piece._cache, KernelCache) else made
