"""Kernels for CUDA, made from the text of those that the CPU compiles.

A kernel's pieces are plain functions; what differs between the two machines are the few primitives of
`cable_envs.core.kernels` that are written in LLVM (`select`, `_fma` and so on), and blocks of columns: on the device
every thread has one column for itself. `on_device` copies a function, and every piece that it calls at any depth, with
the device's primitives in their places. No formula is written twice.

Two precisions: in "float64" the device does what the CPU does, with the same roundings. In "float32" every constant and
every tile of a plant's kernel has single precision, elementary functions are those of CUDA, and its compiler may join a
product and a sum into one rounding.

With ``NUMBA_ENABLE_CUDASIM=1`` in the environment the same copies run as plain Python under numba's simulator, without
a device; fused operations there are those of the CPU's compiled code. Nothing of CUDA is imported before it is asked
for.
"""

import math
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from importlib import import_module
from types import CodeType, FunctionType
from typing import Any

import numba
import numpy as np

from cable_envs.core import kernels
from cable_envs.core.compiling.digests import names_read
from cable_envs.core.compiling.templates import is_piece
from cable_envs.core.errors import ConfigurationError, nearest
from cable_envs.core.lanes import Lanes

PRECISIONS = {"float64": np.float64, "float32": np.float32}
"""Types that a plant's kernel may compute with, by their names."""

THREADS = 64
"""Threads of a block. A step takes so many registers that larger blocks would not fill a processor better."""


def module() -> Any:
    """`numba.cuda`, where there is a device or the simulator.

    Raises
    ------
    ConfigurationError
        Says what is missing.
    """
    if kernels.JIT_DISABLED:
        raise ConfigurationError("device='cuda' needs compiled code; unset NUMBA_DISABLE_JIT")
    cuda: Any = None
    with suppress(ImportError):  # numba keeps no kernels for CUDA of its own for ever
        cuda = import_module("numba.cuda")
    if cuda is not None and (simulated() or cuda.is_available()):
        return cuda
    missing = []
    if cuda is None or getattr(cuda, "implementation", "") == "Built-in":
        missing.append("the package numba-cuda is not installed (pip install 'cable-envs[gpu]')")
    if cuda is not None:
        missing.append(_reason(cuda))
    raise ConfigurationError(
        f"device='cuda' needs an NVIDIA GPU, its driver and the extra 'gpu': {'; '.join(missing)}. Without a GPU use "
        "device='cpu'"
    )


def _reason(cuda: Any) -> str:
    """Why numba finds no device, in a sentence of its own or of NVIDIA's driver."""
    try:
        cuda.current_context()
    except Exception as error:  # each layer has errors of its own
        said = [line.strip().rstrip(".:") for line in str(error).splitlines()]
        told = [line for line in said if line and not line.startswith("Error at driver init")]
        return told[0] if told else type(error).__name__
    return "numba finds no device that it can use"


def simulated() -> bool:
    """Whether kernels for CUDA run on numba's simulator."""
    return bool(getattr(numba.config, "ENABLE_CUDASIM"))  # noqa: B009 - set when numba is imported


def require_precision(name: str) -> type:
    """The type of a precision by its name.

    Raises
    ------
    ConfigurationError
        For an unknown name, with the nearest.
    """
    if name not in PRECISIONS:
        raise ConfigurationError(f"unknown precision {name!r}; {nearest(str(name), PRECISIONS)}")
    return PRECISIONS[name]


def launched(kernel: Any, n: int, *arguments: Any) -> None:
    """Run a kernel of `as_kernel` on ``n`` threads."""
    if simulated():
        kernel[n, 1](*arguments)
    else:
        _configured(kernel, -(-n // THREADS))(*arguments)


@cache
def _configured(kernel: Any, blocks: int) -> Any:
    with warnings.catch_warnings():  # that a small batch leaves most of a device idle is no news
        warnings.simplefilter("ignore")
        return kernel[blocks, THREADS]


def as_kernel(function: Any, precision: str = "float64", /, **names: Any) -> Any:
    """A function of ``cuda`` and pieces of `on_device`, by name, as a kernel that is launched."""
    cuda = module()
    made = _copied(function, {"cuda": cuda, **names})
    if simulated():
        return cuda.jit(_quiet(made))
    kernel = cuda.jit(made)
    if precision == "float64":
        kernel.compile = _rounded(kernel.compile)
    return kernel


def _rounded(compiles: Callable[[Any], Any]) -> Callable[[Any], Any]:
    def compile_(signature):
        with rounded_as_written():
            return compiles(signature)

    return compile_


@contextmanager
def rounded_as_written() -> Iterator[None]:
    """Kernels compiled within round every product and every sum, as those of the CPU do.

    NVIDIA's compiler otherwise joins a product and a sum into an operation that rounds once. numba has no option for
    its switch.
    """
    module()
    from numba.cuda.cudadrv import nvvm

    usual = nvvm.compile_ir
    nvvm.compile_ir = lambda ir, **options: usual(ir, **{**options, "fma": False})
    try:
        yield
    finally:
        nvvm.compile_ir = usual


def _quiet(function: FunctionType) -> FunctionType:
    """On the simulator numbers are NumPy's, which warn where compiled ones do not; it sets ``cuda`` in the globals."""

    def quiet(*arguments):
        with ignoring(all="ignore"):
            function(*arguments)

    ignoring = np.errstate
    return FunctionType(quiet.__code__, function.__globals__, function.__name__, None, quiet.__closure__)


def on_device(function: Any, precision: str = "float64", /, **names: Any) -> Any:
    """A function, and every piece of a kernel that it calls by name, as pieces of kernels for the device.

    Parameters
    ----------
    function : function
        A plain function, a kernel or a piece of one. It is left as it is.
    precision : str
        "float64" or "float32".
    **names
        Values of global names, at any depth, as of `templates.instantiate`.

    Returns
    -------
    function
        A device function of `numba.cuda`; on the simulator a plain function.
    """
    require_precision(precision)
    done: dict[Any, Any] = {}
    return _converted(getattr(function, "py_func", function), precision, names, done)


def tile(lanes: Lanes, precision: str = "float64") -> Callable[[], Any]:
    """What `Lanes.tile` is on the device: the rows of one column, private to a thread."""
    space: dict[str, Any]
    space, array = {"kind": lanes.kind, "real": PRECISIONS[precision], "empty": np.empty}, "empty"
    if not simulated():
        space |= {"cuda": module(), "real": numba.from_dtype(np.dtype(precision))}
        array = "cuda.local.array"
    rows = ", ".join(("base", *lanes.slices("base")))
    exec(f"def tile(): base = {array}(({max(lanes.count, 1)}, 1), real); return kind({rows})", space)
    return _piece(space["tile"])


def _converted(function: FunctionType, precision: str, names: dict[str, Any], done: dict[Any, Any]) -> Any:
    if function not in done:
        others, primitives = {}, _primitives(precision)
        for used in names_read(function.__code__):
            if used in names:
                others[used] = names[used]
                continue
            if used not in function.__globals__:  # a builtin
                continue
            value = function.__globals__[used]
            if id(value) in primitives:
                others[used] = primitives[id(value)][1]
            elif is_piece(value):
                others[used] = _converted(getattr(value, "py_func", value), precision, names, done)
            else:
                others[used] = _in_precision(value, PRECISIONS[precision])
        done[function] = _piece(_copied(function, others, PRECISIONS[precision]))
    return done[function]


def _piece(function: Any) -> Any:
    if simulated():
        return function
    cuda = module()
    built_in = getattr(cuda, "implementation", "") == "Built-in"
    merged = {"inline": True} if built_in else {"forceinline": True}
    return cuda.jit(device=True, **merged)(function)


def _copied(function: FunctionType, others: dict[str, Any], real: type | None = None) -> FunctionType:
    code = function.__code__
    made = FunctionType(
        _code_in(code, real) if real else code, {**function.__globals__, **others}, function.__name__,
        function.__defaults__, function.__closure__,
    )  # fmt: skip
    made.__kwdefaults__ = function.__kwdefaults__
    return made


def _code_in(code: CodeType, real: type) -> CodeType:
    return code.replace(co_consts=tuple(_in_precision(value, real) for value in code.co_consts))


def _in_precision(value: Any, real: type) -> Any:
    """Constants of a type: a plain float would make everything that it meets one of double precision."""
    if type(value) is float:
        return real(value) if abs(value) <= np.finfo(real).max else real(math.copysign(math.inf, value))
    if type(value) is tuple and any(type(one) is float for one in value):
        return tuple(_in_precision(one, real) for one in value)
    return value


@cache
def _primitives(precision: str) -> dict[int, tuple[Any, Any]]:
    """Id of a function of `kernels` -> (it, what it is on the device)."""
    found = _simulated(precision) if simulated() else _native(precision)
    return {id(at := getattr(kernels, name)): (at, made) for name, made in found.items()}


def _apart(n):
    return n


def _widest():
    return None


def _simulated(precision: str) -> dict[str, Any]:
    """On the simulator. What numba compiles for the CPU can be called there."""
    real = PRECISIONS[precision]

    def select(condition, a, b):
        return real(a) if condition else real(b)

    def sqrt(x):
        return real(np.sqrt(x))

    found = {"select": select, "sqrt": sqrt, "apart": _apart, "widest": _widest}
    if precision == "float32":
        return found | _single(lambda f: f, real, np)
    fused = numba.njit(lambda a, b, c: kernels._fma(a, b, c))
    to_bits, from_bits = numba.njit(lambda x: kernels.to_bits(x)), numba.njit(lambda n: kernels.from_bits(n))
    return found | {
        "_fma": lambda a, b, c: np.float64(fused(a, b, c)),
        "to_bits": lambda x: to_bits(np.float64(x)),
        "from_bits": lambda n: np.float64(from_bits(np.int64(n))),
        "_shift_right_52": lambda n: n >> 52,  # of a positive number
    }


def _native(precision: str) -> dict[str, Any]:
    """On a device: what `kernels` writes in LLVM, in the words of CUDA."""
    from numba.cuda import libdevice

    real = PRECISIONS[precision]

    def select(condition, a, b):
        return real(a) if condition else real(b)

    def sqrt(x):
        return math.sqrt(x)

    def fma(a, b, c):
        return libdevice.fma(a, b, c)

    def to_bits(x):
        return libdevice.double_as_longlong(x)

    def from_bits(n):
        return libdevice.longlong_as_double(n)

    def shift_right_52(n):
        return np.int64(np.uint64(n) >> np.uint64(52))

    found = {"select": select, "sqrt": sqrt, "apart": _apart, "widest": _widest}
    if precision == "float32":
        return {name: _piece(one) for name, one in found.items()} | _single(_piece, real, math)
    found |= {"_fma": fma, "to_bits": to_bits, "from_bits": from_bits, "_shift_right_52": shift_right_52}
    return {name: _piece(one) for name, one in found.items()}


def _single(piece: Callable[[Any], Any], real: type, library: Any) -> dict[str, Any]:
    """Elementary functions in single precision, with the limits that those of `kernels` keep."""
    most, least, tiny = real(87.0), real(-87.0), real(1e-37)
    natural, raised, less_one = library.exp, library.log, library.expm1
    sine, cosine = library.sin, library.cos

    def exp(x):
        return real(natural(min(max(real(x), least), most)))

    def expm1(x):
        return real(less_one(min(max(real(x), least), most)))

    def log(x):
        return real(raised(max(real(x), tiny)))

    def power(x, y):
        return real(natural(min(max(real(y) * real(raised(max(real(x), tiny))), least), most))) if x > 0 else real(0.0)

    def sine_cosine(x):
        return real(sine(x)), real(cosine(x))

    made = {"exp": exp, "expm1": expm1, "log": log, "power": power, "sine_cosine": sine_cosine}
    return {name: piece(one) for name, one in made.items()}
