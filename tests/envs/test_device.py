"""Batches and replays on a GPU: the same numbers as on the CPU, to the bit, on numba's simulator of CUDA."""

import json
import os
import subprocess
import sys

import gymnasium as gym
import pytest

import cable_envs
from benchmarks.gpu import measure, tables
from tests.support.compiled_for_a_device import MISSING
from tests.support.tree import ROOT

HELD = {  # in one process: to start it takes as long as the checks
    "quick": (
        "plant:CableHole-Tension-Step-v1", "plant:CableHole-Track-Hard-v1", "effects", "autoreset:NextStep",
        "autoreset:SameStep", "disabled", "refused", "single", "contacts", "shards", "replays:linear_drive",
    ),
}  # fmt: skip
SLOW = {
    "plants": (
        "plant:PulleyCircuit-Torque-Sine-v0", "plant:PulleyCircuit-Position-Sine-v1",
        "plant:TendonSheath-Position-Sine-v1", "plant:AntagonistJoint-Torque-Sine-v1",
        "plant:Wrist-Position-Sine-v1", "plant:PulleyCircuit-Track-Medium-v1", "plant:CableHole-Series-Hard-v1",
        "plant:TendonSheath-Track-Hard-v1", "own_effect", "replays:cable_hole", "replays:pulley_circuit",
    ),
    "episode": ("episode:CableHole-Position-Sine-v1",),
    "example": ("example",),
}  # fmt: skip
SIMULATOR = {**os.environ, "NUMBA_ENABLE_CUDASIM": "1"}


def on_the_simulator(*command):
    done = subprocess.run(
        [sys.executable, "-m", *command], env=SIMULATOR, cwd=ROOT, capture_output=True, text=True, timeout=1200
    )
    assert done.returncode == 0, done.stderr[-3000:]
    return done.stdout


@pytest.mark.parametrize("what", [*HELD, *(pytest.param(name, marks=pytest.mark.slow) for name in SLOW)])
def test_the_device_gives_the_numbers_of_the_cpu(what):
    on_the_simulator("tests.support.on_the_simulator", *{**HELD, **SLOW}[what])


@pytest.mark.slow
def test_the_benchmark_runs_from_end_to_end_and_goes_on(tmp_path):
    """All that it does on a device, on the simulator; a second run finds everything there."""
    out = tmp_path / "gpu.json"
    command = (
        "benchmarks.gpu", "--cases", "hole", "circuit", "--sizes", "2", "3", "--seconds", "0", "--jobs", "1",
        "--ppo-steps", "8192", "--ppo-envs", "2", "--ppo-updates", "1", "--no-diagnosis", "--shards", "2",
        "--out", str(out),
    )  # fmt: skip
    on_the_simulator(*command)
    found = json.loads(out.read_text())
    assert set(found["rates/circuit/float32"]) == {"2", "3"} and len(found["shards"]) == 2
    assert found["ppo/cuda"][0]["steps"] == 2 * 128 and found["ppo/cuda"][0]["seconds"] > 0.0
    assert on_the_simulator(*command) == "" and json.loads(out.read_text()) == found


def test_shares_of_the_peaks_and_prices_are_reckoned_right():
    work = {"operations": 1000.0, "traffic": 2000, "substeps": 10}
    found = {f"work/{case}": work for case in measure.CASES}
    found |= {f"rates/{case}/cpu": {"1024": 1e6, "16384": 2e6} for case in measure.CASES}
    found |= {f"episodes/{case}": {"steps": 2000, "each": 4e-6} for case in measure.CASES}
    on_a_gpu = [line for line in tables.rates(found, None).splitlines() if "| GPU" in line]
    assert len(on_a_gpu) == 2 * len(measure.CASES)
    assert all(line.endswith(f"| {tables.NOT_MEASURED} | {tables.NOT_MEASURED} |") for line in on_a_gpu)
    found["rates/hole/float32"] = {"1024": 1e8, "65536": 1e9}  # 1e12 operations and 2e12 bytes a second
    fast = next(line for line in tables.rates(found, "NVIDIA H100 80GB HBM3").splitlines() if "| 1,000 |" in line)
    assert fast.endswith("| 1.5 % | 60 % |")  # of 67e12 and 3.35e12
    # 2e6, 64 of them, 1e9; 2e6 * 3600 / 0.05 dollars, 1e9 * 3600 / 3
    paid = tables.dollars(found, 0.05, 3.0).splitlines()[2]
    assert paid == "| hole | 2 | 128 | not measured; 1,000 | 144 | not measured; 1,200 |"
    # 2e6 * 1e-4; 2e6 * 60, of min(34e12 / 1000, 3.35e12 / 2000); 2000 steps in 4 us
    assert tables.costs(found, 0.05, 3.0, 1e-4).splitlines()[2] == "| hole | 200 | 120 | 7.2 % | 4 | 500 |"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("env_id", "precision"),
    [
        ("CableHole-Position-Sine-v1", "float64"), ("CableHole-Position-Sine-v1", "float32"),
        ("PulleyCircuit-Track-Medium-v1", "float64"), ("CableHole-Track-Hard-v1", "float32"),
    ],
)  # fmt: skip
def test_kernels_compile_for_a_device(env_id, precision):
    """The simulator knows no types: what it runs may not compile.

    Single precision must not fall back to double, and double must round as the CPU does.
    """
    command = [sys.executable, "-m", "tests.support.compiled_for_a_device", env_id, precision]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=900)
    if done.returncode == MISSING:
        pytest.skip(f"the extra 'gpu' is not installed: {done.stdout.strip()[:200]}")
    assert done.returncode == 0, done.stderr[-3000:]
    texts = [[int(number) for number in line.split()] for line in done.stdout.splitlines()]
    _, double, single, *_ = texts[0]
    if precision == "float64":
        assert double > single == 0
        assert all(joined == 0 for _, _, _, joined, _ in texts)
    else:
        few = 2  # once in a control step the share of slack is divided by a whole number
        assert double <= few < single / 100


def test_without_a_device_the_error_says_what_is_missing():
    try:
        from numba import cuda

        found = cuda.is_available()
    except ImportError:
        found = False
    if found:
        pytest.skip("this machine has a GPU")
    with pytest.raises(cable_envs.ConfigurationError, match=r"needs an NVIDIA GPU.*'gpu'.*: \w+"):
        gym.make_vec("cable_envs/CableHole-Position-Sine-v1", num_envs=2, device="cuda")


def test_cuda_is_not_imported_before_it_is_asked_for():
    code = (
        "import sys, gymnasium, cable_envs, cable_envs.sim.replay\n"
        "gymnasium.make_vec('cable_envs/CableHole-Position-Sine-v1', num_envs=2).reset(seed=1)\n"
        "print('numba.cuda' in sys.modules or 'numba_cuda' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"
