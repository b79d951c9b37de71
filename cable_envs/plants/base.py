"""What every plant offers to the layers above it."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cable_envs.params import ParameterTable

INPUTS = ("command", "command_rate", "mode", "disturbance")
"""Rows of every plant's input array u: the drive command in the unit of the action mode, its rate, the number of the
action mode (the position of its name in `Plant.action_modes`), and a disturbance on the load (N or N m)."""

COMMAND, COMMAND_RATE, MODE, DISTURBANCE = range(4)


@dataclass(frozen=True)
class Signal:
    """One row of a plant's signal array: a state, or something the plant reports."""

    name: str
    unit: str
    meaning: str


@dataclass(frozen=True)
class ActionMode:
    """How a command is understood by the drive."""

    name: str
    unit: str
    bound: str
    """name of the parameter that bounds the command; the range is [-bound, bound], or [0, bound] when `one_sided`"""
    one_sided: bool = False
    rest_signal: str = ""
    """signal whose value at rest is the command that keeps the plant at rest; empty: zero"""


@dataclass(frozen=True)
class Plant:
    """A plant: declared parameters, a kernel, and the names of what it computes.

    Arrays are structures of arrays, one column for each simulated mechanism:
    values [len(parameters), n] -> prepare -> p [len(coefficients), n]; x [len(signals), n]; u [len(INPUTS), n].
    """

    name: str
    parameters: ParameterTable
    coefficients: tuple[str, ...]
    signals: tuple[Signal, ...]
    action_modes: tuple[ActionMode, ...]
    prepare: Callable[[np.ndarray], np.ndarray]
    """values -> p; checks what single bounds cannot (raises ConfigurationError); vectorised over columns"""
    rest: Callable[[np.ndarray, np.ndarray], np.ndarray]
    """(p, output position [n]) -> x at rest there"""
    advance: Callable[..., None]
    """kernel (x, p, u, lo, hi, substeps, dt): moves columns lo..hi by ``substeps`` steps of ``dt`` seconds, in place"""

    def row(self, signal: str) -> int:
        """Row of a signal in x."""
        return [s.name for s in self.signals].index(signal)
