"""Batches and replays on a GPU: the same numbers as on the CPU, to the bit, on numba's simulator of CUDA.

On a device the compiler may round a product and a sum once instead of twice, so its numbers are near, not equal.
"""

import os
import subprocess
import sys

import gymnasium as gym
import pytest

import cable_envs
from tests.support.compiled_for_a_device import MISSING
from tests.support.tree import ROOT

HELD = (
    "plant CableHole-Tension-Step-v1", "plant PulleyCircuit-Torque-Sine-v0", "effects", "autoreset NextStep",
    "autoreset SameStep", "disabled", "refused", "single", "replays linear_drive", "replays cable_hole",
)  # fmt: skip
SLOW = (
    "plant PulleyCircuit-Position-Sine-v1", "plant TendonSheath-Position-Sine-v1",
    "plant AntagonistJoint-Torque-Sine-v1", "plant Wrist-Position-Sine-v1", "own_effect",
    "replays pulley_circuit", "example",
)  # fmt: skip


@pytest.mark.parametrize("what", [*HELD, *(pytest.param(name, marks=pytest.mark.slow) for name in SLOW)])
def test_the_device_gives_the_numbers_of_the_cpu(what):
    command = [sys.executable, "-W", "error", "-m", "tests.support.on_the_simulator", *what.split()]
    environment = {**os.environ, "NUMBA_ENABLE_CUDASIM": "1"}
    done = subprocess.run(command, env=environment, cwd=ROOT, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr[-3000:]


@pytest.mark.slow
@pytest.mark.parametrize("precision", ["float64", "float32"])
def test_kernels_compile_for_a_device(precision):
    """The simulator knows no types: what it runs may not compile. Single precision must not fall back to double."""
    command = [sys.executable, "-m", "tests.support.compiled_for_a_device", "CableHole-Position-Sine-v1", precision]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=900)
    if done.returncode == MISSING:
        pytest.skip(f"the extra 'gpu' is not installed: {done.stdout.strip()[:200]}")
    assert done.returncode == 0, done.stderr[-3000:]
    _, double, single = map(int, done.stdout.split("\n")[0].split())
    few = 2  # once in a control step the share of slack is divided by a whole number
    assert double > single == 0 if precision == "float64" else double <= few < single / 100


def test_without_a_device_the_error_says_what_is_missing():
    try:
        from numba import cuda

        found = cuda.is_available()
    except ImportError:
        found = False
    if found:
        pytest.skip("this machine has a GPU")
    with pytest.raises(cable_envs.ConfigurationError, match=r"needs an NVIDIA GPU.*'gpu'"):
        gym.make_vec("cable_envs/CableHole-Position-Sine-v1", num_envs=2, device="cuda")


def test_cuda_is_not_imported_before_it_is_asked_for():
    code = (
        "import sys, gymnasium, cable_envs, cable_envs.sim.replay\n"
        "gymnasium.make_vec('cable_envs/CableHole-Position-Sine-v1', num_envs=2).reset(seed=1)\n"
        "print('numba.cuda' in sys.modules or 'numba_cuda' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"
