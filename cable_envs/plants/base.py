"""What every plant offers to the layers above it."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from cable_envs.core.inputs import FOLLOW, INPUTS
from cable_envs.core.lanes import Lanes
from cable_envs.core.params import ParameterTable
from cable_envs.effects import Effect, Layout
from cable_envs.effects.lanes import STATES, STEP
from cable_envs.effects.own import joined
from cable_envs.plants.kernel import kernels

STEP_ROWS = Lanes("Step", STEP)


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
    Values of the whole `table` make p and x with further rows: those of the effects, behind the plant's own.
    """

    name: str
    parameters: ParameterTable
    """its own; `table` has those of the effects too"""
    signals: tuple[Signal, ...]
    signal_rows: Lanes
    """names of the signals' rows in the kernel, in their order"""
    coefficient_rows: Lanes
    """what the kernel computes with: made from the parameters once an episode, by ``derive``"""
    scratch: Lanes
    """rows of the kernel's own that are forgotten after a call"""
    action_modes: tuple[ActionMode, ...]
    derive: Callable[[Mapping[str, np.ndarray], Any], Mapping[str, Any]]
    """(values of every parameter [n], rows of the effects by name or None) -> rows of the coefficients by name.

    It checks what single bounds cannot (raises ConfigurationError), and may complete rows of the effects that are the
    plant's."""
    settle: Callable[[Any, Any, Any, Any, np.ndarray], None]
    """(x, s, p, e, output position [n]): writes signals and states of effects at rest there, by name"""
    solve: Callable[..., None]
    """(x, p, u, w, e, s, g, lanes, substeps, dt): the stages of a block of columns, for the kernel (`plants.kernel`)"""
    effects: Layout
    step_rows: Lanes = STEP_ROWS
    """scratch of a control step with effects"""
    plain: bool = True
    """whether there is a kernel without effects, which is quicker; the same numbers to the bit where none is on"""

    replays: tuple[str, ...] = ("follow", "imposed", "observed")
    """how a recorded drive may drive it, besides its action modes (`cable_envs.sim.replay.replay`)"""
    own: tuple[Effect, ...] = ()
    """a user's own effects (`cable_envs.plants.own_effects`)"""

    def __post_init__(self) -> None:
        if self.signal_rows.count != len(self.signals):
            raise ValueError(f"{self.name}: {len(self.signals)} signals, but {self.signal_rows.count} rows for them")

    def __hash__(self) -> int:
        return hash((self.name, len(self.signals), self.own))

    @property
    def coefficients(self) -> tuple[str, ...]:
        """A name for every coefficient row of the plant's own."""
        return self.coefficient_rows.labels

    @property
    def table(self) -> ParameterTable:
        """Everything that a rig may say: the plant's own parameters, then those of the effects under dotted names."""
        return self.effects.table

    @cached_property
    def kernels(self) -> tuple[Callable[..., None], Callable[..., None]]:
        """Without and with effects, see `advance`; compiled on first use."""
        made = kernels(
            f"{self.name}_{len(self.signals)}", self.signal_rows, self.coefficient_rows, self.scratch,
            self.effects.lanes, self.step_rows, self.solve, joined(self.effects.effects.values()),
        )  # fmt: skip
        return made if self.plain else (made[1], made[1])

    def prepare(self, values: np.ndarray) -> np.ndarray:
        """Coefficients [rows, n] of parameter columns [len(parameters), n] or [len(table), n].

        Those of the whole table give the rows of the effects too. Raises ConfigurationError for what the bounds of
        single parameters cannot exclude.
        """
        own, n = len(self.parameters), values.shape[1]
        given = dict(zip(self.parameters.names, values, strict=False))
        if len(values) == own and self.plain:
            return self.coefficient_rows.pack(self.derive(given, None), n)
        effects = values[own:] if len(values) > own else np.repeat(self.effects.null[:, None], n, axis=1)
        more = self.effects.coefficients(effects)
        rows = self.coefficient_rows.pack(self.derive(given, self.effects.lanes.over(more)), n)
        return np.ascontiguousarray(np.concatenate([rows, more]))

    def rest(self, p: np.ndarray, position: np.ndarray) -> np.ndarray:
        """Signals [rows, n] of mechanisms at rest with the output at ``position`` [n], SI."""
        own, n = self.coefficient_rows.count, p.shape[1]
        known = len(p) > own
        e = self.effects.lanes.over(p[own:]) if known else self.effects.lanes.zeros(n)
        x = np.zeros((len(self.signals) + (STATES.count if known else 0), n))
        s = STATES.over(x[len(self.signals) :]) if known else STATES.zeros(n)
        at = np.array(np.broadcast_to(position, n), dtype=np.float64)
        self.settle(self.signal_rows.over(x), s, self.coefficient_rows.over(p), e, at)
        return x

    def advance(self, x: np.ndarray, p: np.ndarray, u: np.ndarray, lo: int, hi: int, substeps: int, dt: float) -> None:
        """Move columns lo..hi by ``substeps`` steps of ``dt`` seconds, in place."""
        self.kernels[self.needs_effects(p[:, lo:hi], u[:, lo:hi])](x, p, u, lo, hi, substeps, dt)

    def needs_effects(self, p: np.ndarray, u: np.ndarray | None = None) -> bool:
        """Whether columns have an effect that is on, or a mode that only the kernel with effects knows."""
        own = self.coefficient_rows.count
        on = len(p) > own and bool(p[own + self.effects.lanes.row("on")].any())
        return on or (u is not None and bool((INPUTS.over(u).mode > FOLLOW - 0.5).any()))

    def sense_row(self, signal: str) -> int:
        """First row of a sensor's effects within p; -1 where it cannot have any."""
        own = self.coefficient_rows.count
        return own + self.effects.sense_row(signal) if signal in self.effects.measured else -1

    def row(self, signal: str) -> int:
        """Row of a signal in x."""
        return [s.name for s in self.signals].index(signal)


def rows_of(signals: Iterable[Signal]) -> Lanes:
    """Rows under the names of signals, for plants none of whose signals form a sequence."""
    return Lanes("Signals", [s.name for s in signals])
