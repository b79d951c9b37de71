"""What a coarse sensor makes of a motion: a reading is the nearest of its steps, which is no noise where it is steady.

With the noise e of standard deviation s before a sensor that counts in steps of q the mean reading of a place x is

    x + q / pi  sum over k of (-1)^k / k  exp(-2 pi^2 k^2 s^2 / q^2) sin(2 pi k x / q)

(Widrow, Kollar, Quantization Noise, 2008, ch. 9). At a steady speed v it is a tone of v / q, and its multiples, that no
sensor's noise and no effect of a rig makes. Where a sample is the mean of readings at the times t_j about its own, the
sine of each k is multiplied by the mean of cos(2 pi k v t_j / q).
"""

from collections.abc import Sequence
from copy import copy
from dataclasses import replace

import numpy as np

from cable_envs.diagnosis.data.readings import weights_of_mean
from cable_envs.diagnosis.evidence.joint import Joint
from cable_envs.diagnosis.model.model import Block

SURELY = 4.0
"""Standard deviations by which the first sine of the sum must be there."""
HARMONICS = 8
"""Of the sum of the module. The ninth of a sensor without noise is 1/9 of the first, and folds into noise."""


def without_counts(joint: Joint, raw: Sequence[np.ndarray]) -> Joint:
    """All records without what rounding makes of the motion, in the channels where it is more than a noise.

    Parameters
    ----------
    joint : Joint
        The records.
    raw : sequence of ndarray
        What a model leaves [T] of every block.

    Returns
    -------
    Joint
        The same one where no sensor is so coarse that the first sine is seen beside its noise.
    """
    blocks = list(joint.blocks)
    for channel in dict.fromkeys(b.channel for b in joint.blocks):
        own = [k for k, b in enumerate(joint.blocks) if b.channel == channel]
        step = max(joint.blocks[k].reading.step for k in own)
        if step == 0.0:
            continue
        sines = {k: _sines(joint.blocks[k], joint.blocks[k].measured - raw[k], step) for k in own}
        first, left = (
            np.concatenate([series[k][joint.blocks[k].good] for k in own])
            for series in ({k: one[0] for k, one in sines.items()}, dict(enumerate(raw)))
        )
        table = np.column_stack([first.real, first.imag])
        cosine, sine = np.linalg.lstsq(table, left, rcond=None)[0]
        size = np.pi / step * complex(-sine, -cosine)  # exp(-2 pi^2 s^2 / q^2), turned by where the steps begin
        damped, begin = min(abs(size), 1.0), size / max(abs(size), 1e-300)
        chance = np.pi / step * np.sqrt(2.0 * float(np.mean(left**2)) / max(float(np.sum(np.abs(first) ** 2)), 1e-300))
        if damped < SURELY * chance:
            continue
        for k in own:
            made = sum((-1) ** h * damped ** (h * h) / h * np.imag(begin**h * one) for h, one in enumerate(sines[k], 1))
            block = joint.blocks[k]
            blocks[k] = replace(block, measured=block.measured - step / np.pi * made)
    if all(a is b for a, b in zip(blocks, joint.blocks, strict=True)):
        return joint
    found = copy(joint)
    found.blocks = blocks
    return found


def _sines(block: Block, place: np.ndarray, step: float) -> list[np.ndarray]:
    """exp(2 pi i k x / q) of the module [T], as the means of readings have it, for each k from 1 on."""
    weights = weights_of_mean(block.reading.rows)
    times = (np.arange(len(weights)) - len(weights) // 2) / block.reading.rows  # over the time between two samples
    turn = 2.0 * np.pi / step
    ahead = turn * np.outer(np.gradient(place), times)
    return [
        np.exp(1j * h * turn * place) * (np.cos(h * ahead) @ weights / weights.sum()) for h in range(1, HARMONICS + 1)
    ]
