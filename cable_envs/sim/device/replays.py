"""Replays on a GPU: a thread takes one column through the whole record."""

from functools import cache
from typing import Any

import numpy as np

from cable_envs.core.compiling import device
from cable_envs.plants.base import Plant

MOST = 2**30
"""Bytes of inputs and signals that lie on the device at a time; more columns go in several launches."""

# filled in for each kernel
cuda: Any = None
through: Any = None


def _all_columns(x, p, shared, own, places, rows, substeps, dt, out):
    i = cuda.grid(1)
    if i < x.shape[1]:
        through(x, p, (shared, own, places), rows, substeps, dt, out, i, i + 1)


@cache
def _kernel(plant: Plant, needed: int) -> Any:
    return device.as_kernel(_all_columns, through=plant.device_kernel(needed, replays=True))


def run(plant: Plant, needed: int, arrays: tuple, substeps: int, dt: float) -> None:
    """Replay all columns, as the kernel of the CPU does.

    Parameters
    ----------
    plant : Plant
        What simulates them.
    needed : int
        Number of its kernel (`Plant.kernel_needed`).
    arrays : tuple
        x, p, inputs, rows of x that are kept, and out, as of `cable_envs.plants.kernel.replay_with_effects`: x and out
        are written.
    substeps : int
        Integration steps in a step of the record.
    dt : float
        Length of one, s.
    """
    cuda = device.module()
    kernel = _kernel(plant, needed)
    x, p, (shared, own, places), rows, out = arrays
    n = x.shape[1]
    each = 8 * out.shape[0] * (out.shape[1] + own.shape[1])
    share = max(MOST // each, 1)
    alike, of_own, kept = (cuda.to_device(a) for a in (shared, places, rows))
    for lo in range(0, n, share):
        part = slice(lo, min(lo + share, n))
        there = [cuda.to_device(np.ascontiguousarray(a)) for a in (x[:, part], p[:, part], own[:, :, part])]
        seen = cuda.device_array((*out.shape[:2], part.stop - lo), dtype=np.float64)
        x_there, p_there, own_there = there
        arguments = (x_there, p_there, alike, own_there, of_own, kept)
        device.launched(kernel, part.stop - lo, *arguments, substeps, dt, seen)
        x[:, part], out[:, :, part] = x_there.copy_to_host(), seen.copy_to_host()
