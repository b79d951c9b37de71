"""Pieces of kernels: compiled for kernels alone, and for Python when Python calls them."""

import pytest
from numba import njit

from cable_envs.core.compiling.pieces import Piece
from cable_envs.core.kernels import JIT_DISABLED, inline, jit

pytestmark = pytest.mark.skipif(JIT_DISABLED, reason="pieces are plain functions without numba")


def wrappers(found):
    """Functions of the machine code that unpack what Python or C hands over."""
    return [f.name for f in found.library.get_defined_functions() if f.name.startswith(("_ZN7cpython", "cfunc."))]


def test_for_a_kernel_nothing_is_compiled_that_python_would_need():
    half = inline(lambda x: 0.5 * x)
    kernel = njit(lambda x: half(x) + 1.0)  # not kept on disk: from there it comes without its pieces
    assert kernel(3.0) == 2.5
    (found,) = half.overloads.values()
    assert isinstance(half, Piece) and wrappers(found) == []
    (own,) = kernel.overloads.values()
    assert len(wrappers(own)) == 2  # what is looked for is there, where it is needed


def test_called_from_python_it_gives_what_the_kernel_gives():
    half = inline(lambda x, y=1.0: 0.5 * x + y)
    kernel = jit(lambda x: half(x))
    assert [half(3.0), kernel(3.0), half(3.0), half(3)] == [2.5, 2.5, 2.5, 2.5]
    asked = half._for_python.overloads.copy()
    assert half(5.0) == 3.5 and half._for_python.overloads == asked  # compiled once


def test_a_piece_that_cannot_be_compiled_says_why():
    from numba.core.errors import TypingError

    with pytest.raises(TypingError, match="argument 0"):
        inline(lambda x: x + 1.0)(object())
