"""The elementary functions of `cable_envs.core.kernels` for floats and for complex steps, as plain Python.

A complex step x + i h with h = 1e-30 carries the derivative in its imaginary part, exact to rounding (Squire and Trapp,
SIAM Review 40 (1998) 110). Comparisons look at the real part, and at the imaginary one where that does not decide, as
NumPy orders complex numbers: each branch is differentiated where it is taken, and a kink on the side of the step.
"""

import cmath
import math
from typing import Any

import numpy as np

STEP = 1e-30
LARGEST = 700.0
"""Largest size of an argument of exp, as in the kernels."""


def _select(condition: Any, a: Any, b: Any) -> Any:
    return a if condition else b


def _real(x: Any) -> float:
    return float(x.real)


def _limited(x: Any) -> Any:
    return x if abs(_real(x)) <= LARGEST else math.copysign(LARGEST, _real(x))


def _exp(x: Any) -> Any:
    x = _limited(x)
    return np.exp(x) if isinstance(x, complex) else math.exp(x)


def _expm1(x: Any) -> Any:
    x = _limited(x)
    return np.expm1(x) if isinstance(x, complex) else math.expm1(x)


def _log(x: Any) -> Any:
    return np.log(x) if isinstance(x, complex) else math.log(x)


def _sqrt(x: Any) -> Any:
    if isinstance(x, complex):
        return np.complex128(cmath.sqrt(x)) if x.real >= 0.0 else np.complex128(math.nan)
    return math.sqrt(x) if x >= 0.0 else math.nan


def _power(x: Any, y: Any) -> Any:
    return _exp(y * _log(x)) if x > 0.0 else 0.0


def _sine(x: Any) -> Any:
    return np.sin(x) if isinstance(x, complex) else math.sin(x)


def _cosine(x: Any) -> Any:
    return np.cos(x) if isinstance(x, complex) else math.cos(x)


def _abs(x: Any) -> Any:
    return x if x >= 0.0 else -x


def _sign(x: Any) -> float:
    return float(x > 0.0) - float(x < 0.0)


def _minimum(a: Any, b: Any) -> Any:
    return b if b < a else a


def _maximum(a: Any, b: Any) -> Any:
    return b if b > a else a


def _clip(x: Any, low: Any, high: Any) -> Any:
    return _minimum(_maximum(x, low), high)


NUMBERS: dict[str, Any] = {
    "select": _select, "exp": _exp, "expm1": _expm1, "log": _log, "sqrt": _sqrt, "power": _power,
    "sine": _sine, "cosine": _cosine, "sine_cosine": lambda x: (_sine(x), _cosine(x)),
    "abs": _abs, "sign": _sign, "minimum": _minimum, "maximum": _maximum, "clip": _clip,
    "apart": lambda h: h,
}  # fmt: skip
"""Name of a function of `cable_envs.core.kernels` (and ``abs``) -> the same for floats and complex steps."""
