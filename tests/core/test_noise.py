"""Counter-based noise: distribution, independence, and the same numbers in a loop, alone and without numba."""

import math
import os
import subprocess
import sys

import numpy as np
import pytest
from scipy import stats

from cable_envs.core.kernels import jit
from cable_envs.core.noise import normal, uniform


@jit
def _fill(key, stream, gaussian, out):
    for k in range(out.shape[0]):
        out[k] = normal(key, float(k), stream) if gaussian else uniform(key, float(k), stream)


def draw(key=987654321.0, stream=3, gaussian=True, n=50_000):
    out = np.empty(n)
    _fill(key, stream, gaussian, out)
    return out


# the seeds are fixed, so these pass always or never; 1e-3: what chance would do once in 1000
def test_uniform_is_uniform():
    u = draw(gaussian=False)
    assert u.min() >= 0.0 and u.max() < 1.0
    assert stats.kstest(u, "uniform").pvalue > 1e-3


def test_normal_is_normal():
    z = draw()
    assert np.isfinite(z).all() and stats.kstest(z, "norm").pvalue > 1e-3


@pytest.mark.parametrize("gaussian", [False, True])
def test_keys_counters_and_streams_are_independent(gaussian):
    a = draw(gaussian=gaussian)
    for b in (draw(key=987654322.0, gaussian=gaussian), draw(stream=4, gaussian=gaussian), np.roll(a, 1)):
        assert abs(np.corrcoef(a, b)[0, 1]) < 4 / math.sqrt(len(a))  # four standard deviations


def test_a_loop_gives_the_bits_of_single_calls():
    batch = draw(n=300)
    assert batch.tolist() == [normal(987654321.0, float(k), 3) for k in range(300)]


@pytest.mark.nojit
def test_without_numba_the_numbers_are_the_same():
    code = (
        "from cable_envs.core.noise import normal, uniform\n"
        "print(*[f(2.0**51 + 5, float(k), 3) for k in range(50) for f in (uniform, normal)])"
    )
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1", "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}
    out = subprocess.run([sys.executable, "-W", "error", "-c", code], env=environment, capture_output=True, text=True)
    here = [f(2.0**51 + 5, float(k), 3) for k in range(50) for f in (uniform, normal)]
    assert out.returncode == 0, out.stderr
    # plain Python has no fused multiply-add: the last digits of log and cosine differ
    assert [float(v) for v in out.stdout.split()] == pytest.approx(here, rel=1e-13, abs=1e-15)
