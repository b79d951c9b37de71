"""Kernel maths: accuracy against libm, the same bits in a loop and alone, the same results without numba."""

import json
import math
import os
import subprocess
import sys

import numba
import numpy as np
import pytest

from cable_envs.core import kernels
from cable_envs.physics import contact, supports


def _ulps(function, exact, arguments):
    got = np.array([function(x) for x in arguments])
    want = np.array([exact(x) for x in arguments])
    return np.abs(got - want) / np.spacing(np.abs(want)), np.abs(got - want)


def test_exp_within_two_ulp_of_libm():
    rng = np.random.default_rng(1)
    arguments = np.concatenate([rng.uniform(-700, 700, 4000), rng.uniform(-3, 3, 4000), [0.0, 700.0, -700.0]])
    assert _ulps(kernels.exp, math.exp, arguments)[0].max() <= 2  # the bound the module promises


def test_expm1_within_two_ulp_of_libm():
    rng = np.random.default_rng(2)
    tiny = 10.0 ** rng.uniform(-300, -1, 2000)
    arguments = np.concatenate([rng.uniform(-700, 700, 3000), rng.uniform(-3, 3, 4000), tiny, -tiny])
    assert _ulps(kernels.expm1, math.expm1, arguments)[0].max() <= 2  # the bound the module promises


def test_log_within_two_ulp_or_1e_16_of_libm():
    rng = np.random.default_rng(3)
    arguments = np.concatenate([np.exp(rng.uniform(-690, 690, 4000)), rng.uniform(0.5, 2, 4000), [1.0]])
    ulps, absolute = _ulps(kernels.log, math.log, arguments)
    assert np.all((ulps <= 2) | (absolute <= 1e-16))  # the bound the module promises


def test_power_error_is_the_exponents_rounding():
    rng = np.random.default_rng(4)
    for x, y in zip(10 ** rng.uniform(-12, 6, 2000), rng.uniform(0.1, 4, 2000), strict=True):
        bound = (abs(y * math.log(x)) + 4) * 2.3e-16  # y ln x rounded to half an ulp, then exp and log
        assert kernels.power(x, y) == pytest.approx(x**y, rel=bound, abs=0)
    assert kernels.power(0.0, 2.03) == 0.0


def test_exp_stays_finite_at_the_ends():
    assert kernels.exp(1e300) == kernels.exp(700.0) < math.inf
    assert kernels.exp(-1e300) == kernels.exp(-700.0) > 0.0


@pytest.mark.parametrize("function", [kernels.exp, kernels.expm1, lambda x: kernels.clip(x, -1.0, 1.0)])
def test_nan_is_passed_on(function):
    assert math.isnan(function(math.nan))


def test_minimum_maximum_clip_sign():
    for a in (-2.0, -0.5, 0.0, 0.5, 3.0):
        for b in (-1.0, 0.0, 2.0):
            assert kernels.minimum(a, b) == min(a, b)
            assert kernels.maximum(a, b) == max(a, b)
        assert kernels.clip(a, -1.0, 2.0) == min(max(a, -1.0), 2.0)
        assert kernels.sign(a) == np.sign(a)


def test_a_loop_over_columns_gives_the_bits_of_single_calls():
    ratio, power = contact.tension_ratio, kernels.power

    @numba.njit(error_model="numpy")
    def batch(rho, mu, phi, out):
        for i in range(out.shape[0]):
            out[i] = ratio(rho[i], mu[i], phi[i]) + power(mu[i], rho[i])

    rng = np.random.default_rng(5)
    rho, mu, phi = rng.uniform(0.5, 20, 257), rng.uniform(0, 2, 257), rng.uniform(0, 6, 257)
    out = np.empty(257)
    batch(rho, mu, phi, out)
    single = [ratio(*row) + power(row[1], row[0]) for row in zip(rho, mu, phi, strict=True)]
    assert out.tolist() == single  # bit for bit: the reason for writing exp and log ourselves


_CALLS = """
import json
from cable_envs.physics import contact
from cable_envs.core import kernels
from cable_envs.physics import supports
points = [(0.7, 0.05, 0.2), (1.5, 0.43, 1.05), (8.0, 1.1, 3.1), (60.0, 0.2, 6.2)]
rows = []
for rho, mu, phi in points:
    rows += [kernels.exp(rho - phi), kernels.expm1(mu - phi), kernels.log(rho), kernels.power(mu, rho)]
    rows += [kernels.clip(phi, 0.5, 3.0), kernels.sign(mu - 0.3), contact.tension_integral(rho, mu, phi)]
    rows += list(contact.tension_ratio_and_slope(rho, mu, phi)) + [contact.tension_ratio_perturbed(rho, 0.02, mu, phi)]
    rows += [contact.extrusion_coefficient(6574.0, 2.03, -mu / 40)]
    rows += [contact.wrap_in_contact(phi, 1e-5, 5e-3, 10.0, 20.0)]
    rows += [supports.shaft_ratio(mu / 10, 0.3), supports.loaded_shaft_ratio(rho, mu / 10, 0.3)]
    rows += [supports.slip_angle(rho + 1, mu, phi)]
print(json.dumps(rows))
"""


@pytest.mark.nojit
def test_without_numba_the_results_are_the_same():
    here = {}
    exec(_CALLS.replace("print(json.dumps(rows))", ""), here)
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1", "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}
    done = subprocess.run([sys.executable, "-c", _CALLS], env=environment, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    # plain Python has no fused multiply-add; slope and Phi lose up to two digits to cancellation
    assert json.loads(done.stdout) == pytest.approx(here["rows"], rel=1e-12)


def test_kernels_accept_python_floats():
    for value in (contact.tension_ratio(1.5, 0.43, 1.0), supports.shaft_ratio(0.01, -1.0)):
        assert isinstance(value, float)


@numba.njit
def _scaled(a, b):
    kernels.widest()
    for i in range(a.shape[0]):
        b[i] = 2.0 * a[i] + 1.0


def test_a_kernel_may_take_the_widest_vectors_of_the_processor():
    """LLVM is told so, with the attribute of which llvmlite knows nothing; numbers stay what they are."""
    a, b = np.linspace(0.0, 1.0, 37), np.empty(37)
    _scaled(a, b)
    assert np.array_equal(b, 2.0 * a + 1.0)
    if not kernels.JIT_DISABLED:
        (text,) = _scaled.inspect_llvm().values()
        assert '"prefer-vector-width"="512"' in text
