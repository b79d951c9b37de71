"""The one place that decides how numba compiles, and the scalar maths every kernel shares.

Kernels are written once as scalar functions on one column ``i`` of structure-of-arrays buffers; a batch is a
plain loop over columns. LLVM turns that loop into vector code when the body has no branches and no library
calls, so this module offers

* ``select(condition, a, b)``: both values are computed, one is taken (a branch-free ``if``);
* ``tile(rows)``: a scratch array [rows, LANES] on the stack. Kernels copy a block of columns into tiles and loop over
  those: the compiler then knows that rows do not overlap, which it cannot prove for arrays handed in;
* ``apart(h)``: the whole number h, of which the compiler does not know where it comes from. In a loop over rows h with
  one over columns inside, it then makes sure for each row by itself that the rows read and written do not overlap; for
  all rows at once they do, where a row takes something from the one before, and no vector code would run;
* ``widest()``: the loops of the kernel that calls it may use the widest vectors of the processor;
* ``exp``, ``expm1``, ``log``, ``power``, ``sqrt``, ``sine_cosine``: inlined polynomials with explicit fused
  multiply-adds. The scalar and the vector code round identically, so a batch is bit-equal to single runs. Accuracy
  against libm is tested: 2 ulp for ``exp`` and ``expm1`` on [-700, 700], 2 ulp or 1e-16 absolute for ``log`` on normal
  positive numbers.

``fastmath`` stays off everywhere: it would let scalar and batch round differently.
With ``NUMBA_DISABLE_JIT=1`` everything runs as plain Python (slow; for tests and debugging).
"""

import math
import struct

import numba
import numpy as np
from numba import njit

from cable_envs.core.compiling.cache import kept
from cable_envs.core.compiling.pieces import piece

JIT_DISABLED = bool(getattr(numba.config, "DISABLE_JIT"))  # noqa: B009 - set when numba is imported

LANES = 32
"""Columns of a tile: small enough for the first-level cache, a multiple of every vector width."""


def jit(function):
    """Decorator of kernels called from Python; they hold no lock of the interpreter and are kept on disk.

    Where, and for how long, is said in `cable_envs.core.compiling.cache`.
    """
    made = njit(error_model="numpy", nogil=True)(function)
    return made if JIT_DISABLED else kept(made)


inline = (lambda function: function) if JIT_DISABLED else piece
"""Decorator of scalar pieces: merged into their caller, so that loops over columns vectorise."""


def ready(kernel, *arguments):
    """The machine code of a kernel for arguments like these, compiled or loaded now.

    Calling it skips a look at the types of the arguments, a third of a microsecond; they are taken for what these are.
    """
    return kernel if JIT_DISABLED else kernel.compile(tuple(numba.typeof(a) for a in arguments))


if JIT_DISABLED:

    def select(condition, a, b):
        return a if condition else b

    def sqrt(x):
        return math.sqrt(x) if x >= 0.0 else math.nan

    def stack(rows):
        return np.empty((rows, LANES))

    def row_at(base, first):
        return base[first]

    def rows_at(base, first, shape):
        return base[first : first + shape[0]]

    def tile(rows):
        return np.empty((rows, LANES))

    def handed(array):
        return array

    def received(given, kind, shape):
        return given

    def apart(n):
        return n

    def widest():
        pass

    def _fma(a, b, c):
        return a * b + c

    def to_bits(x):
        return struct.unpack("<q", struct.pack("<d", x))[0]

    def _shift_right_52(n):
        return n >> 52

    def from_bits(n):
        return struct.unpack("<d", struct.pack("<q", n))[0]

else:
    from llvmlite import ir
    from numba.core import cgutils, types
    from numba.extending import intrinsic

    @intrinsic
    def select(typingctx, condition, a, b):
        def codegen(context, builder, signature, args):
            return builder.select(*args)

        return types.float64(types.boolean, types.float64, types.float64), codegen

    @intrinsic
    def sqrt(typingctx, x):
        def codegen(context, builder, signature, args):
            return builder.call(builder.module.declare_intrinsic("llvm.sqrt", [ir.DoubleType()]), args)

        return types.float64(types.float64), codegen

    @intrinsic
    def stack(typingctx, rows):
        if not isinstance(rows, types.IntegerLiteral):
            return None

        def codegen(context, builder, signature, args):
            array = ir.ArrayType(ir.DoubleType(), rows.literal_value * LANES)
            return builder.bitcast(cgutils.alloca_once(builder, array), ir.DoubleType().as_pointer())

        return types.CPointer(types.float64)(rows), codegen

    @intrinsic
    def _offset(typingctx, base, first):
        def codegen(context, builder, signature, args):
            place = builder.mul(args[1], ir.Constant(args[1].type, LANES))
            return builder.gep(args[0], [place])

        return base(base, types.intp), codegen

    @inline
    def row_at(base, first):
        return _offset(base, first)  # type: ignore[call-arg]  # numba gives the context

    @inline
    def rows_at(base, first, shape):
        return numba.carray(_offset(base, first), shape)  # type: ignore[call-arg]  # numba gives the context

    @inline
    def tile(rows):
        return numba.carray(stack(rows), (rows, LANES))

    def handed(array):
        """What a kernel takes for an array that is always the same one: the address of its first entry.

        To look at an array takes a call from Python 25 ns. Whoever makes the call must keep the array.
        """
        return array.ctypes.data

    @intrinsic
    def _entries(typingctx, address, kind):
        def codegen(context, builder, signature, args):
            return builder.inttoptr(args[0], context.get_value_type(signature.return_type))

        return types.CPointer(kind.dtype)(address, kind), codegen

    @inline
    def received(given, kind, shape):
        """In a kernel: the array that was `handed`, of a kind and shape that the kernel knows."""
        return numba.carray(_entries(given, kind), shape)  # type: ignore[call-arg]  # numba gives the context

    @intrinsic
    def apart(typingctx, n):
        def codegen(context, builder, signature, args):
            kind = ir.FunctionType(args[0].type, [args[0].type])
            return builder.asm(kind, "", "=r,0", args, False)

        return n(n), codegen

    @intrinsic
    def widest(typingctx):
        """With vectors of 512 bits LLVM takes half of them unless a function says otherwise; eight columns are one."""

        def codegen(context, builder, signature, args):
            set.add(builder.function.attributes, '"prefer-vector-width"="512"')  # llvmlite knows no names with values
            return context.get_dummy_value()

        return types.none(), codegen

    @intrinsic
    def _fma(typingctx, a, b, c):
        def codegen(context, builder, signature, args):
            return builder.fma(*args)

        return types.float64(types.float64, types.float64, types.float64), codegen

    @intrinsic
    def to_bits(typingctx, x):
        def codegen(context, builder, signature, args):
            return builder.bitcast(args[0], ir.IntType(64))

        return types.int64(types.float64), codegen

    @intrinsic
    def _shift_right_52(typingctx, n):
        def codegen(context, builder, signature, args):
            return builder.lshr(args[0], ir.Constant(ir.IntType(64), 52))

        return types.int64(types.int64), codegen

    @intrinsic
    def from_bits(typingctx, n):
        def codegen(context, builder, signature, args):
            return builder.bitcast(args[0], ir.DoubleType())

        return types.float64(types.int64), codegen


@inline
def load(tile_, array, first, lanes):
    """Copy columns first..first+lanes of ``array`` into a tile."""
    if lanes == LANES:  # the compiler then knows how many there are
        for row in range(tile_.shape[0]):
            for lane in range(LANES):
                tile_[row, lane] = array[row, first + lane]
    else:
        for row in range(tile_.shape[0]):
            for lane in range(lanes):
                tile_[row, lane] = array[row, first + lane]


@inline
def store(tile_, array, first, lanes):
    """Copy a tile back into columns first..first+lanes of ``array``."""
    if lanes == LANES:
        for row in range(tile_.shape[0]):
            for lane in range(LANES):
                array[row, first + lane] = tile_[row, lane]
    else:
        for row in range(tile_.shape[0]):
            for lane in range(lanes):
                array[row, first + lane] = tile_[row, lane]


@inline
def minimum(a, b):
    """The smaller of two floats, without a branch. A NaN in ``a`` is passed on; one in ``b`` is dropped."""
    return select(b < a, b, a)


@inline
def maximum(a, b):
    """The larger of two floats, without a branch. A NaN in ``a`` is passed on; one in ``b`` is dropped."""
    return select(b > a, b, a)


@inline
def clip(x, low, high):
    """``x`` limited to [low, high], without a branch."""
    return minimum(maximum(x, low), high)


@inline
def sign(x):
    """-1.0, 0.0 or 1.0."""
    return select(x > 0.0, 1.0, select(x < 0.0, -1.0, 0.0))


@inline
def _exp_parts(x):
    """(2**k, e**r - 1) with x = k ln 2 + r, |r| <= ln 2 / 2; arguments are limited to [-700, 700].

    The polynomials here are minimax fits (Remez) of relative error below 5e-18, summed in pairs (Estrin): a chain of
    dependent multiply-adds would be twice as long.
    """
    x = clip(x, -700.0, 700.0)
    shifted = x * 1.4426950408889634 + 6755399441055744.0  # 1.5 * 2**52: the low bits hold round(x / ln 2)
    k = shifted - 6755399441055744.0
    r = _fma(k, -0.6931471803691238, x)
    r = _fma(k, -1.9082149292705877e-10, r)
    r2 = r * r
    r4 = r2 * r2
    low = _fma(
        _fma(0.008333333333494461, r, 0.041666666666530155), r2, _fma(0.16666666666666413, r, 0.5000000000000011)
    )
    high = _fma(
        _fma(2.755758637378518e-06, r, 2.480149309888739e-05),
        r2,
        _fma(0.00019841269506578723, r, 0.0013888888943630134),
    )
    p = _fma(_fma(_fma(2.500006162553128e-08, r, 2.763024838532302e-07), r4, high), r4, low)
    return from_bits((to_bits(shifted) - 0x4338000000000000 + 1023) << 52), _fma(r2, p, r)


@inline
def exp(x):
    """e**x; arguments are limited to [-700, 700], so the result is always a normal finite number."""
    two_to_k, part = _exp_parts(x)
    return _fma(two_to_k, part, two_to_k)


@inline
def expm1(x):
    """e**x - 1 without the cancellation at small x; arguments are limited to [-700, 700]."""
    two_to_k, part = _exp_parts(x)
    return _fma(two_to_k, part, two_to_k - 1.0)


@inline
def log(x):
    """Natural logarithm of a positive normal number."""
    bits = to_bits(x)
    # biased exponent that leaves a mantissa in [sqrt(1/2), sqrt(2)]; kept positive, vector units have no signed shift
    e = _shift_right_52(bits + (0x3FF0000000000000 - 0x3FE6A09E667F3BCD))
    m = from_bits(bits - ((e - 1023) << 52))
    ef = from_bits(e + 0x4330000000000000) - 4503599627371519.0  # 2**52 + 1023
    f = (m - 1.0) / (m + 1.0)
    s = f * f  # artanh f = f + f s (1/3 + s / 5 + ...), |f| <= 0.1716
    s2 = s * s
    low = _fma(_fma(0.11111099282046658, s, 0.14285714371234792), s2, _fma(0.19999999999707171, s, 0.3333333333333367))
    high = _fma(0.07398047610772812, s2, _fma(0.07657018395524093, s, 0.09091782416035915))
    p = _fma(high, s2 * s2, low)
    two_f = 2.0 * f
    tail = _fma(two_f * s, p, ef * 1.9082149292705877e-10)
    return _fma(ef, 0.6931471803691238, two_f + tail)


@inline
def power(x, y):
    """x**y for x >= 0 and y > 0 (0**y = 0); relative error about |y ln x| ulp."""
    safe = maximum(x, 1e-300)
    return select(x > 0.0, exp(y * log(safe)), 0.0)


@inline
def sine_cosine(x):
    """(sin x, cos x) within 2e-16 + |x| 1e-16, for |x| < 1e5."""
    shifted = x * 0.6366197723675814 + 6755399441055744.0  # quarter turns, see _exp_parts
    k = shifted - 6755399441055744.0
    r = _fma(k, -1.5707963267948966, x)
    r = _fma(k, -6.123233995736766e-17, r)
    s = r * r
    s2 = s * s
    low = _fma(-0.00019841269829725205, s, 0.008333333333322316)
    p = _fma(_fma(-2.505075326465642e-08, s, 2.755731366205819e-06), s2, low)
    sine = _fma(r * s, _fma(_fma(1.5896504954252202e-10, s2 * s2, p), s, -0.16666666666666632), r)
    low = _fma(2.4801587289394926e-05, s, -0.001388888888887399)
    p = _fma(_fma(2.0875719558851413e-09, s, -2.755731432603134e-07), s2, low)
    cosine = _fma(s2, _fma(_fma(-1.1359448689984626e-11, s2 * s2, p), s, 0.0416666666666666), _fma(-0.5, s, 1.0))
    quarter = to_bits(shifted)
    odd = (quarter & 1) == 1
    a, b = select(odd, cosine, sine), select(odd, sine, cosine)
    return select((quarter & 2) == 2, -a, a), select(((quarter + 1) & 2) == 2, -b, b)
