"""A linear system with the names of what it is about."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Linear:
    """dx' = A dx + B du, dy = C dx + D du around (x, u), for one direction of sliding.

    It unpacks into the four matrices: ``A, B, C, D = linear``, ``control.ss(*linear)``.

    Attributes
    ----------
    A, B, C, D : ndarray
        The matrices, SI.
    states, inputs, outputs : tuple of str
        Names of their rows and columns.
    x, u : ndarray
        The point.
    rates : ndarray, shape (len(states),)
        f(x, u): zero where the point is one of rest.
    y : ndarray, shape (len(outputs),)
        h(x, u).
    sliding : int or tuple of int
        The direction of sliding: 1, -1, or 0 where friction holds; of several frictions that of each.
    """

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    x: np.ndarray
    u: np.ndarray
    rates: np.ndarray
    y: np.ndarray
    sliding: int | tuple[int, ...]

    def __iter__(self) -> Iterator[np.ndarray]:
        return iter((self.A, self.B, self.C, self.D))
