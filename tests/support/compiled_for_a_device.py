"""Machine code of a plant's kernels for a GPU, without one.

``python -m tests.support.compiled_for_a_device ID PRECISION`` needs numba-cuda and the compiler of the toolkit (the
extra `gpu`), and ends with 77 where these are missing. It prints a line for each text, the first of the plant's own
kernel, the second of a step: its length, its operations in double and in single precision, those in double that the
assembler may still join, and the fused ones.
"""

import re
import sys
from contextlib import nullcontext

import numba
import numpy as np

from cable_envs.core.compiling import device
from cable_envs.sim import replay
from cable_envs.sim.buffers import COMMON
from cable_envs.sim.device import replays, steps
from cable_envs.sim.registered import setup_of

CAPABILITY = (8, 0)
MISSING = 77
DOUBLE, SINGLE, WHOLE = numba.float64, numba.float32, numba.int64


class Device:
    """Stands for the device that there is not."""

    compute_capability = CAPABILITY


def ptx_of(cuda, precision, kernel, *types):
    with device.rounded_as_written() if precision == "float64" else nullcontext():
        return cuda.compile_ptx(kernel.py_func, numba.void(*types), cc=CAPABILITY)[0]


cuda = advance = None  # filled in


def _alone(x, p, u, substeps, dt):
    i = cuda.grid(1)
    if i < x.shape[1]:
        advance(x, p, u, i, i + 1, substeps, dt)


def main(env_id, precision):
    try:
        from numba import cuda
        from numba.cuda import dispatcher
        from numba.cuda.cudadrv import nvvm

        nvvm.NVVM()
    except Exception as error:  # NVIDIA's packages raise their own
        print(error)
        sys.exit(MISSING)
    if getattr(cuda, "implementation", "") == "Built-in":
        print("numba-cuda is not installed")
        sys.exit(MISSING)
    device.module, dispatcher.get_current_device = (lambda: cuda), Device
    setup = setup_of(f"cable_envs/{env_id}", {})
    plant, suite = setup.plant, setup.conditions is not None
    needed = plant.kernel_needed(plant.prepare(setup.rig.column(plant)))
    block, obs, flags = DOUBLE[:, ::1], SINGLE[:, ::1], numba.uint8[::1]
    common = numba.from_dtype(np.dtype(COMMON.descr, align=True))[::1]
    state = (block, obs, block, obs)
    alone = device.as_kernel(_alone, precision, advance=plant.device_kernel(needed, precision))
    stepped = steps._kernels_of(plant, needed, suite, precision)
    texts = [
        ptx_of(cuda, precision, alone, block, block, block, WHOLE, DOUBLE),
        ptx_of(
            cuda, precision, stepped, block, obs, common, SINGLE[:, ::1], block, obs, flags, numba.boolean[:, ::1],
            numba.boolean,
        ),
        ptx_of(cuda, precision, steps._restart(), *state, flags, block, obs),
        ptx_of(cuda, precision, steps._putting(), *state, numba.int64[::1]),
    ]  # fmt: skip
    if precision == "float64":
        cube, kept = DOUBLE[:, :, ::1], numba.int64[::1]
        kernel = replays._kernel(replay._through, plant, 1)
        texts.append(ptx_of(cuda, precision, kernel, block, block, cube, kept, WHOLE, DOUBLE, cube))
    for text in texts:
        counts = [len(re.findall(rf"\b(?:fma\.rn|mul|add|sub)\S*\.f{bits}\b", text)) for bits in (64, 32)]
        free = len(re.findall(r"\b(?:mul|add|sub)\.f64\b", text))  # that the assembler may still join
        print(len(text), *counts, free, len(re.findall(r"\bfma\.rn\.f64\b", text)))


if __name__ == "__main__":
    main(*sys.argv[1:])
