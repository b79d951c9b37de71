"""Constants of a record: where it began and what its encoders count from, which each record has for itself.

A prediction solves for them by the white noise of the samples, because it knows no other. Where the noise of a sensor
is slow, as of a zero that walks, its level says less than that: of a drive whose zero walked by 0.42 standard
deviations of its noise the level was believed 4.5 times too well, the load began 2 um off by it, and the load's zero
was said to drift. Once the noise W of all channels is known, so are the constants c,

    c = (R' W' W R + P)^-1 R' W' W r

for the changes R of all channels of a record with its constants, what is left r, and what is known beforehand P.
"""

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from cable_envs.diagnosis.model.model import Block, Model, Whitener


class Constant(Protocol):
    """A model whose records have constants."""

    def constants(self) -> Sequence[tuple[np.ndarray, np.ndarray]]:
        """(changes of the record's blocks with them [T, blocks, constants], P of the module) of every record."""
        ...


def constants_of(model: Model) -> list[tuple[np.ndarray, np.ndarray]]:
    """Constants of every record of a model, in the order of its blocks; none where it has none."""
    return list(model.constants()) if hasattr(model, "constants") else []


def with_constants(
    blocks: Sequence[Block], constants: Sequence[tuple[np.ndarray, np.ndarray]], whitener: Whitener, left: np.ndarray
) -> np.ndarray:
    """What is left, whitened [N], with the constants of every record as the noise of all its channels has them."""
    left, block, row = left.copy(), 0, 0
    for changes, known in constants:
        own = blocks[block : block + changes.shape[1]]
        rows = slice(row, row + sum(len(b.time) for b in own))
        block, row = block + len(own), rows.stop
        if changes.shape[2]:
            white = whitener.flat(own, [changes[:, j] for j in range(len(own))])
            left[rows] -= white @ np.linalg.pinv(white.T @ white + known, hermitian=True) @ (white.T @ left[rows])
    return left
