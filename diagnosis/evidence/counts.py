"""What a coarse sensor makes of a motion: a reading is the nearest of its steps, which is no noise where it is steady.

With the noise e of standard deviation s before a sensor that counts in steps of q the mean reading of a place x is

    x + q / pi  sum over k of (-1)^k / k  exp(-2 pi^2 k^2 s^2 / q^2) sin(2 pi k x / q)

(Widrow, Kollar, Quantization Noise, 2008, ch. 9). At a steady speed v it is a tone of v / q, and its multiples, that no
sensor's noise and no effect of a rig makes.
"""

from collections.abc import Sequence
from copy import copy
from dataclasses import replace

import numpy as np

from cable_envs.diagnosis.evidence.joint import Joint
from cable_envs.diagnosis.model.rest import COARSE

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
        The same one where no sensor is coarse: its steps are `COARSE` standard deviations of what is before it or less.
    """
    blocks = list(joint.blocks)
    for channel in dict.fromkeys(b.channel for b in joint.blocks):
        own = [k for k, b in enumerate(joint.blocks) if b.channel == channel]
        step = max(joint.blocks[k].step for k in own)
        left = np.concatenate([raw[k][joint.blocks[k].good] for k in own])
        if step**2 <= COARSE**2 * (np.mean(left**2) - step**2 / 12.0) or step == 0.0:
            continue
        turned = {k: np.exp(2j * np.pi / step * (joint.blocks[k].measured - raw[k])) for k in own}
        seen = np.concatenate([turned[k][joint.blocks[k].good] for k in own])
        cosine, sine = np.linalg.lstsq(np.column_stack([seen.real, seen.imag]), left, rcond=None)[0]
        first = np.pi / step * complex(-sine, -cosine)  # exp(-2 pi^2 s^2 / q^2), turned by where the steps begin
        damped, begin = min(abs(first), 1.0), first / max(abs(first), 1e-300)
        for k in own:
            made = sum(
                (-1) ** h * damped ** (h * h) / h * np.imag((begin * turned[k]) ** h) for h in range(1, HARMONICS + 1)
            )
            block = joint.blocks[k]
            blocks[k] = replace(block, measured=block.measured - step / np.pi * made)
    if all(a is b for a, b in zip(blocks, joint.blocks, strict=True)):
        return joint
    found = copy(joint)
    found.blocks = blocks
    return found
