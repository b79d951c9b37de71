"""What every plant offers to the layers above it."""

from collections.abc import Callable
from dataclasses import dataclass, field
from types import ModuleType

import numpy as np

from cable_envs.core.params import ParameterTable
from cable_envs.effects import Effect, Layout
from cable_envs.effects.rows import ON

INPUTS = ("command", "command_rate", "mode", "disturbance")
"""Rows of every plant's input array u: the drive command in the unit of the action mode, its rate, the number of the
action mode (the position of its name in `Plant.action_modes`), and a disturbance on the load (N or N m)."""

COMMAND, COMMAND_RATE, MODE, DISTURBANCE = range(4)

FOLLOW, IMPOSED, OBSERVED, RAMPED = 2, 3, 4, 10
"""Numbers for the row MODE beside those of the action modes, for replays of recordings. FOLLOW: the drive's position
goes to `command` with the speed `command_rate` there (a cubic). IMPOSED: the drive's tension is `command`. OBSERVED
(linear_drive): the motor's force is `disturbance` plus what the servo adds to hold the carriage to `command`. RAMPED is
added to a number: the command goes there in a straight line over the control step instead of jumping."""


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
    """its own; `table` has those of the effects too"""
    coefficients: tuple[str, ...]
    signals: tuple[Signal, ...]
    action_modes: tuple[ActionMode, ...]
    prepare: Callable[[np.ndarray], np.ndarray]
    """values -> p; checks what single bounds cannot (raises ConfigurationError); vectorised over columns"""
    rest: Callable[[np.ndarray, np.ndarray], np.ndarray]
    """(p, output position [n]) -> x at rest there"""
    kernels: tuple[Callable[..., None], Callable[..., None]]
    """without and with effects, see `advance`; the same numbers to the bit where no effect is on"""
    effects: Layout
    """Values of the whole `table` make p and x with further rows, behind the plant's own (`cable_envs.effects.rows`);
    without them the plant has no effects"""

    own: tuple[Effect, ...] = ()
    """a user's own effects (`cable_envs.plants.own_effects`)"""
    home: ModuleType | None = field(default=None, compare=False)
    """the module of its kernels where own effects are compiled in"""

    def __hash__(self) -> int:
        return hash((self.name, len(self.signals), self.own))

    @property
    def table(self) -> ParameterTable:
        """Everything that a rig may say: the plant's own parameters, then those of the effects under dotted names."""
        return self.effects.table

    def advance(self, x: np.ndarray, p: np.ndarray, u: np.ndarray, lo: int, hi: int, substeps: int, dt: float) -> None:
        """Move columns lo..hi by ``substeps`` steps of ``dt`` seconds, in place."""
        self.kernels[self.needs_effects(p[:, lo:hi], u[:, lo:hi])](x, p, u, lo, hi, substeps, dt)

    def needs_effects(self, p: np.ndarray, u: np.ndarray | None = None) -> bool:
        """Whether columns have an effect that is on, or a mode that only the kernel with effects knows."""
        own = len(self.coefficients)
        on = len(p) > own and bool(p[own + ON].any())
        return on or (u is not None and bool((u[MODE] > FOLLOW - 0.5).any()))

    def sense_row(self, signal: str) -> int:
        """First row of a sensor's effects within p; -1 where it cannot have any."""
        return len(self.coefficients) + self.effects.sense_row(signal) if signal in self.effects.measured else -1

    def row(self, signal: str) -> int:
        """Row of a signal in x."""
        return [s.name for s in self.signals].index(signal)
