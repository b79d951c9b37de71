"""What every plant offers to the layers above it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from cable_envs.core.inputs import FOLLOW, INPUTS
from cable_envs.core.lanes import Lanes
from cable_envs.core.params import ParameterTable
from cable_envs.effects import Effect, Layout
from cable_envs.effects.lanes import STEP
from cable_envs.effects.own import joined
from cable_envs.plants.declarations import OUT_OF_RANGE, ActionMode, Range, SecondCommand, Signal, rows_of
from cable_envs.plants.kernel import (
    Kernels,
    Rows,
    advance,
    advance_with_effects,
    device_kernel,
    kernels,
    replay_with_effects,
)

__all__ = ["OUT_OF_RANGE", "STEP_ROWS", "ActionMode", "Plant", "Range", "SecondCommand", "Signal", "rows_of"]

STEP_ROWS = Lanes("Step", STEP)


@dataclass(frozen=True)
class Plant:
    """A plant: declared parameters, a kernel, and the names of what it computes.

    Attributes
    ----------
    name : str
        Name of the plant.
    parameters : ParameterTable
        Its own parameters; `table` has those of the effects too.
    signals : tuple of Signal
        What it computes.
    signal_rows : Lanes
        Names of the signals' rows in the kernel, in their order.
    coefficient_rows : Lanes
        What the kernel computes with; ``derive`` makes it from the parameters once an episode.
    scratch : Lanes
        Rows of the kernel's own that are forgotten after a call.
    action_modes : tuple of ActionMode
        What a command can be.
    derive : callable
        (values of every parameter by name, each of shape (n,); rows of the effects by name, or None) -> rows of the
        coefficients by name. It raises ConfigurationError for what single bounds cannot exclude, and may complete rows
        of the effects that are the plant's.
    settle : callable
        (x, s, p, e, position of the output, shape (n,)): writes the signals and the states of effects at rest there, by
        name.
    solve : callable
        (x, p, u, w, e, s, g, lanes, substeps, dt): the stages of a block of columns, for the kernel
        (`cable_envs.plants.kernel`).
    effects : Layout
        The effects that act on it.
    step_rows : Lanes
        Scratch of a control step with effects.
    plain : bool
        Whether there is a kernel without effects, which is quicker. It gives the same numbers to the bit where none is
        on.
    replays : tuple of str
        How a recorded drive may drive it, besides its action modes (`cable_envs.sim.replay.replay`).
    own : tuple of Effect
        A user's own effects (`cable_envs.plants.own_effects`).
    resolves : callable, optional
        (p, e) -> the longest integration steps that follow the mechanisms' fastest motion, s, of shape (n,); p and e
        are the rows of the plant and of the effects, by name. None: any step will do.
    raised : callable, optional
        (p, dt): raises in place the inertias and dampings of mechanisms that are too quick for steps of dt seconds, for
        replays in coarse steps and for the ids ``-v0``. None: nothing is raised.
    measured : mapping of str to str
        Signal -> the signal that its sensor shows, where that is another one.
    contacts : int
        Places at which its cable rubs, where its rigs say how many; 0: they do not.
    posture : str
        Signal that the input posture changes, as the bend of a sheath (rad); empty: the plant has no posture.
    drive : str
        What moves the cable: "ideal", or "motor" (`cable_envs.plants.servo`).
    ticks : str
        Coefficient that is the time between two readings of the drive's encoder, s, which integration steps should
        divide; empty: it has none.
    ranges : tuple of Range
        Where its laws were identified; a rig that gives a range of its own for a signal overrules it.
    version : str
        Version of the ids whose numbers it gives; "v1" unless it is kept as it was.

    Notes
    -----
    Arrays are structures of arrays, with one column for each of n simulated mechanisms:

    - values, shape (len(parameters), n), in SI; `prepare` turns them into p;
    - p, shape (len(coefficients), n);
    - x, shape (len(signals), n), in SI;
    - u, shape (len(INPUTS), n): command, its rate, action mode, disturbance, posture, second command and its rate.

    Values of the whole `table` give p and x further rows behind the plant's own: those of the effects.
    """

    name: str
    parameters: ParameterTable
    signals: tuple[Signal, ...]
    signal_rows: Lanes
    coefficient_rows: Lanes
    scratch: Lanes
    action_modes: tuple[ActionMode, ...]
    derive: Callable[[Mapping[str, np.ndarray], Any], Mapping[str, Any]]
    settle: Callable[[Any, Any, Any, Any, np.ndarray], None]
    solve: Callable[..., None]
    effects: Layout
    step_rows: Lanes = STEP_ROWS
    plain: bool = True

    replays: tuple[str, ...] = ("follow", "imposed", "observed")
    own: tuple[Effect, ...] = ()
    resolves: Callable[[Any, Any], np.ndarray] | None = None
    raised: Callable[[Any, float], None] | None = None
    measured: Mapping[str, str] = field(default_factory=dict)
    contacts: int = 0
    posture: str = ""
    drive: str = "ideal"
    ticks: str = ""
    ranges: tuple[Range, ...] = ()
    version: str = "v1"

    def __post_init__(self) -> None:
        if self.signal_rows.count != len(self.signals):
            raise ValueError(f"{self.name}: {len(self.signals)} signals, but {self.signal_rows.count} rows for them")

    def __hash__(self) -> int:
        return hash((self.name, self.version, self.drive, len(self.signals), self.own))

    @property
    def tears(self) -> bool:
        """Whether something of it can tear: it then has the signal peak_tension, and the limits of that are parameters.

        Where nothing can, no tension ends an episode.
        """
        return "breaking_tension" in self.parameters.names

    @property
    def coefficients(self) -> tuple[str, ...]:
        """A name for every coefficient row of the plant's own."""
        return self.coefficient_rows.labels

    @property
    def table(self) -> ParameterTable:
        """Everything that a rig may say: the plant's own parameters, then those of the effects under dotted names."""
        return self.effects.table

    @cached_property
    def _compiled(self) -> Kernels:
        drive = "" if self.drive == "ideal" else f"_{self.drive}"
        name = f"{self.name}{drive}_{self.version}_{len(self.signals)}"
        return kernels(name, self.rows, self.solve, joined(self.effects.effects.values()))

    @property
    def kernels(self) -> tuple[Callable[..., None], ...]:
        """Kernels (x, p, u, lo, hi, substeps, dt), as of `advance`, compiled on first use.

        `kernel_needed` has their numbers. Each gives those of the one behind it, to the bit, for what it can simulate.
        """
        made = self._compiled.steps
        return made if self.plain else (made[1], *made[1:])

    def replay_kernel(self, needed: int) -> Callable[..., None]:
        """What takes columns through a whole record, with the numbers of `kernels`, to the bit.

        Parameters
        ----------
        needed : int
            Number of the kernel, as of `kernel_needed`. It has effects always.

        Returns
        -------
        function
            (x, p, inputs, rows, substeps, dt, out, lo, hi), as `cable_envs.plants.kernel.replay_with_effects`.
        """
        return self._compiled.replays[max(needed - 1, 0)]

    def device_kernel(self, needed: int, precision: str = "float64", *, replays: bool = False) -> Any:
        """One of the `kernels` for CUDA (`cable_envs.core.compiling.device`).

        Parameters
        ----------
        needed : int
            Its number, as of `kernel_needed`.
        precision : str
            "float64" or "float32": what it computes with. Its arrays have double precision.
        replays : bool
            Whether it is that of `replay_kernel`.

        Returns
        -------
        function
            A device function with the arguments of the kernel.
        """
        shell = replay_with_effects if replays else advance_with_effects if needed or not self.plain else advance
        hooks = joined(self.effects.effects.values())
        return device_kernel(shell, self.rows, self.solve, hooks, needed > 1, precision)

    @property
    def rows(self) -> Rows:
        """What its kernels work on, by name."""
        layout = self.effects
        return Rows(self.signal_rows, self.coefficient_rows, self.scratch, layout.lanes, layout.states, self.step_rows)

    def prepare(self, values: np.ndarray) -> np.ndarray:
        """Coefficients of the kernel from parameters.

        Parameters
        ----------
        values : ndarray, shape (len(parameters), n) or (len(table), n)
            Columns of parameters, SI.

        Returns
        -------
        ndarray, shape (rows, n)
            Coefficients. Values of the whole table give the rows of the effects too.

        Raises
        ------
        ConfigurationError
            For what the bounds of single parameters cannot exclude.
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
        """Signals of mechanisms at rest.

        Parameters
        ----------
        p : ndarray, shape (rows, n)
            Coefficients, as of `prepare`.
        position : ndarray, shape (n,), or float
            Position of the output, SI.

        Returns
        -------
        ndarray, shape (rows, n)
            Signals, SI, and behind them the states of the effects where ``p`` has effects.
        """
        own, n = self.coefficient_rows.count, p.shape[1]
        known = len(p) > own
        e = self.effects.lanes.over(p[own:]) if known else self.effects.lanes.zeros(n)
        states = self.effects.states
        x = np.zeros((len(self.signals) + (states.count if known else 0), n))
        s = states.over(x[len(self.signals) :]) if known else states.zeros(n)
        at = np.array(np.broadcast_to(position, n), dtype=np.float64)
        self.settle(self.signal_rows.over(x), s, self.coefficient_rows.over(p), e, at)
        for state, value in self.effects.starts.items():
            getattr(s, state)[:] = value
        return x

    def longest_step(self, p: np.ndarray) -> np.ndarray:
        """Longest integration steps that follow the fastest motion of mechanisms.

        Parameters
        ----------
        p : ndarray, shape (rows, n)
            Coefficients, as of `prepare`.

        Returns
        -------
        ndarray, shape (n,)
            Seconds; infinite where any step will do.
        """
        own, n = self.coefficient_rows.count, p.shape[1]
        if self.resolves is None:
            return np.full(n, np.inf)
        effects = p[own:] if len(p) > own else self.effects.coefficients(np.repeat(self.effects.null[:, None], n, 1))
        return self.resolves(self.coefficient_rows.over(p), self.effects.lanes.over(effects))

    def raise_to(self, p: np.ndarray, dt: float) -> None:
        """Raise the inertias and dampings of mechanisms that are too quick for steps of a length.

        The mechanism is then another one. This is for replays that trade its fastest motion for speed, and for the
        numbers of the ids ``-v0``; an environment takes shorter steps instead.

        Parameters
        ----------
        p : ndarray, shape (rows, n)
            Coefficients, as of `prepare`. They are changed in place.
        dt : float
            Length of an integration step, s.
        """
        if self.raised is not None:
            self.raised(self.coefficient_rows.over(p), dt)

    def advance(self, x: np.ndarray, p: np.ndarray, u: np.ndarray, lo: int, hi: int, substeps: int, dt: float) -> None:
        """Move columns ``lo`` to ``hi`` on by ``substeps`` steps of ``dt`` seconds.

        Parameters
        ----------
        x : ndarray, shape (rows, n)
            Signals and states of effects, as of `rest`. They are changed in place.
        p : ndarray, shape (rows, n)
            Coefficients, as of `prepare`.
        u : ndarray, shape (len(INPUTS), n)
            Inputs (`cable_envs.core.inputs`).
        lo, hi : int
            First column, and the one behind the last.
        substeps : int
            Integration steps.
        dt : float
            Length of one, s.
        """
        self.kernels[self.kernel_needed(p[:, lo:hi], u[:, lo:hi])](x, p, u, lo, hi, substeps, dt)

    def kernel_needed(self, p: np.ndarray, u: np.ndarray | None = None) -> int:
        """The quickest kernel that can simulate columns.

        Parameters
        ----------
        p : ndarray, shape (rows, n)
            Coefficients.
        u : ndarray, shape (len(INPUTS), n), optional
            Inputs.

        Returns
        -------
        int
            0: that without effects. 1: that with effects, where one is on, or where a mode is asked for that only it
            knows. 2: that which has effects too whose laws are apart (`Effect.apart`).
        """
        own = self.coefficient_rows.count
        needed = int(p[own + self.effects.lanes.row("on")].max()) if len(p) > own else 0
        follows = u is not None and bool((INPUTS.over(u).mode > FOLLOW - 0.5).any())
        return max(needed, int(follows))

    def number_of(self, mode: ActionMode) -> int:
        """Number of an action mode in the row mode of the inputs: the place of the one whose command it has."""
        return [m.name for m in self.action_modes].index(mode.of or mode.name)

    def sense_row(self, signal: str) -> int:
        """First row of the effects of a signal's sensor within p; -1 where it cannot have any."""
        own = self.coefficient_rows.count
        return own + self.effects.sense_row(signal) if signal in self.effects.measured else -1

    def row(self, signal: str) -> int:
        """Row of a signal in x."""
        return [s.name for s in self.signals].index(signal)
