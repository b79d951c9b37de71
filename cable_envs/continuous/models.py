"""A rig as equations of motion: `model` gives them by the name of a preset."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cable_envs.continuous.linear import Linear
from cable_envs.continuous.motion import Motion, integrate
from cable_envs.continuous.numbers import NUMBERS
from cable_envs.continuous.points import balanced, slopes
from cable_envs.continuous.ways import Sliding, Ways, as_forced, asked, told
from cable_envs.core.compiling.templates import interpreted
from cable_envs.core.errors import ConfigurationError, nearest
from cable_envs.core.inputs import INPUTS
from cable_envs.core.lanes import Lanes
from cable_envs.effects.lanes import STATES
from cable_envs.plants import family_of
from cable_envs.plants.base import ActionMode, Plant, Signal
from cable_envs.plants.continuous import Rows
from cable_envs.sim.rigs import Rig, load_rig


def model(rig: str | Path | Mapping[str, Any] | Rig, action_mode: str | None = None, variant: str = "") -> "Model":
    """The equations of motion of a rig.

    Parameters
    ----------
    rig : str, path, mapping or Rig
        What names or holds it, as in `cable_envs.load_rig`.
    action_mode : str, optional
        What the drive is told; by default the first action mode of the plant.
    variant : str
        "analytic", or "chain" for a pulley circuit as a chain of spans and contacts; "": the rig's own.

    Returns
    -------
    Model
        In SI.

    Raises
    ------
    ConfigurationError
        For unknown names, and for rigs with what the equations leave out: effects with a memory.

    Examples
    --------
    >>> m = model("gu-inferred")
    >>> [s.name for s in m.states]
    ['drive_position', 'load_position', 'load_velocity']
    >>> x, u = m.rest(0.0)
    >>> m.f(x, u).round(9)
    array([0., 0., 0.])
    """
    return Model(load_rig(rig), action_mode, variant)


class Model:
    """A rig in continuous time: dx/dt = f(x, u), y = h(x, u).

    Dry friction depends on the direction of motion, and at rest it is whatever keeps the balance, within its limits.
    `f` therefore takes the direction from the speed in the state; at speed 0 it slides where the forces exceed the
    friction, and is held otherwise. ``sliding`` asks for one direction instead, 1 or -1, or 0 for being held; where a
    plant has several frictions (`frictions`), for all of them as they slide when the output moves that way, or with one
    number for each.

    Parameters
    ----------
    rig : Rig
        Its parameters.
    action_mode : str, optional
        What the drive is told.
    variant : str
        Which simulator of the rig.

    Attributes
    ----------
    rig : Rig
        The parameters.
    action_mode : str
        What the drive is told; empty for plants that are only moved.
    command_range : tuple of two float
        Lowest and highest command of the drive, SI; infinite for plants that are only moved.
    states, inputs, outputs : tuple of Signal
        Name, unit and meaning of each entry of x, u and y.
    plant : Plant
        What simulates the rig step by step.
    equations : cable_envs.plants.continuous.Equations
        What the plant's folder says of its equations.
    frictions : tuple of str
        For each dry friction the state or input whose sign is its direction of sliding; that of the output first.
    places : tuple of int
        Their places in the state; -1 where it is an input.
    held : int
        The first of them: place of the state that dry friction can hold at zero; -1 where there is none.
    """

    def __init__(self, rig: Rig, action_mode: str | None = None, variant: str = ""):
        self.rig = rig
        self.plant = rig.simulated_by(variant)
        mode = _mode(self.plant, action_mode)
        self.action_mode = mode.name if mode else ""
        value = self.plant.table.unpack(rig.column(self.plant)[:, 0])
        top = value[mode.bound] if mode else np.inf
        self.command_range = (0.0 if mode and mode.one_sided else -top, top)
        self.equations = family_of(self.plant.name).moves()(self.plant, mode, value)
        _refuse(rig, self.plant, self.equations.effects)
        signals = {s.name: s for s in self.plant.signals}
        self.states = tuple(signals[name] for name in self.equations.states)
        self.inputs = tuple(Signal(i.name, i.unit, i.meaning) for i in self.equations.inputs)
        self.outputs = tuple(signals[name] for name in self.equations.outputs)
        self._mode = float(self.plant.number_of(mode)) if mode else 0.0
        self._coefficients = self.plant.prepare(rig.column(self.plant))
        floats, own = self._coefficients.astype(object), self.plant.coefficient_rows.count
        self._p, self._e = self.plant.coefficient_rows.over(floats), self.plant.effects.lanes.over(floats[own:])
        self._law = interpreted(self.equations.law, **NUMBERS)
        self._verge = interpreted(self.equations.verge, **NUMBERS) if self.equations.verge else None
        names = [s.name for s in self.states]
        self.frictions = self.equations.slides
        self.places = tuple(names.index(name) if name in names else -1 for name in self.frictions)
        self.held = (*self.places, -1)[0]

    def __repr__(self) -> str:
        return f"<Model of {self.rig.name}: {len(self.states)} states, inputs {', '.join(i.name for i in self.inputs)}>"

    def f(self, x: ArrayLike, u: ArrayLike, sliding: Sliding | None = None) -> np.ndarray:
        """Rates of the states.

        Parameters
        ----------
        x : array_like, shape (len(states),)
            State, SI.
        u : array_like, shape (len(inputs),)
            Input, SI.
        sliding : int or tuple of int, optional
            Direction of sliding: 1, -1, or 0 where friction holds; for all frictions or for each. By default that of
            the state.

        Returns
        -------
        ndarray, shape (len(states),)
            dx/dt, SI.

        Raises
        ------
        ConfigurationError
            For other shapes, and for another direction than -1, 0, 1.
        """
        return np.array(self._at(x, u, sliding)[0])

    def h(self, x: ArrayLike, u: ArrayLike, sliding: Sliding | None = None) -> np.ndarray:
        """Outputs: tensions, torques and what else can be measured; arguments as of `f`.

        Examples
        --------
        >>> m = model("gu-inferred")
        >>> x, u = m.rest(0.0)
        >>> m.outputs[2].name, float(m.h(x, u)[2].round(2))
        ('drive_tension', 49.05)
        """
        return np.array(self._at(x, u, sliding)[1])

    def sliding(self, x: ArrayLike, u: ArrayLike) -> Sliding:
        """Direction of sliding of a state: 1, -1, or 0 where friction holds; arguments as of `f`.

        Where there are several frictions, a tuple with the direction of each.
        """
        return told(as_forced(self, *self._checked(x, u)))

    def rest(self, position: float = 0.0, sliding: Sliding = 0) -> tuple[np.ndarray, np.ndarray]:
        """State and input at rest.

        Parameters
        ----------
        position : float
            Position of the output, SI.
        sliding : int or tuple of int
            0: amid the friction, with equal tensions on both sides of it. 1 or -1: on the verge of sliding that way,
            where all friction is mobilised.

        Returns
        -------
        x : ndarray, shape (len(states),)
            State.
        u : ndarray, shape (len(inputs),)
            Input that keeps it.

        Raises
        ------
        ConfigurationError
            Where no command brings it to the verge of sliding.

        Examples
        --------
        To lift, the tension must exceed the weight by the friction of the hole.

        >>> m = model("gu-inferred")
        >>> [float(m.rest(0.0, way)[1][0].round(2)) for way in (0, 1, -1)]
        [49.05, 61.21, 39.31]
        """
        at = self.plant.rest(self._coefficients, np.array([float(position)]))[:, 0]
        x = np.array([at[self.plant.row(s.name)] for s in self.states])
        u = np.zeros(len(self.inputs))
        ways, rows = asked(self.equations, sliding), [i.row for i in self.equations.inputs]
        mode = self.plant.action_modes[int(self._mode)] if self.action_mode else None
        for row, command in (("command", mode), ("second", mode and mode.second)):
            if command and command.rest_signal:
                u[rows.index(row)] = at[self.plant.row(command.rest_signal)]
        if self.held < 0 or (not any(ways) and not self.f(x, u).any()):
            return x, u
        return balanced(self, x, u, ways)

    def linearise(self, sliding: Sliding = 1, at: float | tuple[ArrayLike, ArrayLike] = 0.0) -> Linear:
        """The linear system around a point, for one direction of sliding.

        Parameters
        ----------
        sliding : int or tuple of int
            1 or -1: sliding that way. 0: held by friction.
        at : float, or (x, u)
            Position of the output, on the verge of sliding that way; or a state and an input.

        Returns
        -------
        Linear
            A, B, C, D with the names of states, inputs and outputs. Derivatives are exact, by complex steps.

        Examples
        --------
        >>> A, B, C, D = model("gu-inferred").linearise(sliding=+1)
        >>> A.shape, B.shape, C.shape, D.shape
        ((3, 3), (3, 3), (6, 3), (6, 3))
        """
        x, u = self.rest(at, sliding) if isinstance(at, (int, float)) else self._checked(*at)
        ways = asked(self.equations, sliding)
        gx, gu = slopes(self, x, u, ways)
        rates, shown = self.evaluated(x, u, ways)
        n = len(self.states)
        return Linear(
            gx[:n], gu[:n], gx[n:], gu[n:], _names(self.states), _names(self.inputs), _names(self.outputs),
            x, u, np.array(rates), np.array(shown), told(ways),
        )  # fmt: skip

    def simulate(self, t: ArrayLike, u: Any, x0: ArrayLike | None = None, **options: Any) -> Motion:
        """Motion from a state, by `scipy.integrate.solve_ivp` with events where the cable stops and breaks away.

        Parameters
        ----------
        t : array_like, shape (N,)
            Times at which the motion is wanted, s, growing; it begins at the first.
        u : array_like or callable
            A constant input of shape (len(inputs),); inputs of shape (N - 1, len(inputs)), each held from one time to
            the next; or a function of the time.
        x0 : array_like, shape (len(states),), optional
            State at the first time; by default at rest at 0.
        **options
            ``method``, ``rtol``, ``atol``, ``max_step`` of `scipy.integrate.solve_ivp`.

        Returns
        -------
        Motion
            Times, states, inputs, outputs and directions of sliding.

        Examples
        --------
        >>> m = model("gu-inferred")
        >>> x, u = m.rest(0.0)
        >>> motion = m.simulate([0.0, 0.5], u + [20.0, 0.0, 0.0])
        >>> bool(motion.x[-1, 1] > 0.003)  # it lifts
        True
        """
        return integrate(self, t, u, self.rest()[0] if x0 is None else x0, **options)

    def casadi(self, speed: float | None = None, tension: float = 0.1) -> Any:
        """The equations as CasADi functions, with friction and slack rounded off.

        Needs ``pip install 'cable-envs[casadi]'``.

        Parameters
        ----------
        speed : float, optional
            Speed v_s of the smooth friction, m/s or rad/s: the laws of both directions are mixed in the shares
            (1 + tanh(v / v_s)) / 2 and (1 - tanh(v / v_s)) / 2. By default that of the plant.
        tension : float
            Tension T_s of the smooth slack, N: max(0, T) becomes T_s ln(1 + exp(T / T_s)).

        Returns
        -------
        cable_envs.continuous.symbolic.Smooth
            ``f`` and ``h``, both `casadi.Function` of (x, u).

        Raises
        ------
        ConfigurationError
            Where CasADi is not installed, and for a smoothing that is not above zero.
        """
        from cable_envs.continuous.symbolic import smooth

        return smooth(self, self.equations.speed if speed is None else speed, tension)

    def rows(self, u: Sequence[Any]) -> Rows:
        """Coefficients, inputs and fresh scratch under the names that the pieces of the plant's kernel read."""
        plant = self.plant
        given, step = _zeros(INPUTS), _zeros(plant.step_rows)
        given.mode[0], step.factor[0] = self._mode, 1.0
        for entry, value in zip(self.equations.inputs, u, strict=True):
            getattr(given, entry.row)[0] = value
        return Rows(
            self._p, given, self._e, _zeros(STATES), step, _zeros(plant.scratch), _zeros(plant.signal_rows)
        )  # fmt: skip

    def evaluated(self, x: Any, u: Any, ways: Ways) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
        """(rates, outputs) by the law, of floats or complex steps, with all frictions sliding their ``ways``."""
        return self._law(tuple(x), self.rows(u), *map(float, ways))

    def slid(self, x: Sequence[Any], u: Sequence[Any], ways: Ways) -> Sequence[Any]:
        """The state with every contact without a mass at its limit that way; itself where there is none."""
        return x if self._verge is None else self._verge(tuple(x), self.rows(u), *map(float, ways))

    def _at(self, x, u, sliding):
        x, u = self._checked(x, u)
        ways = as_forced(self, x, u) if sliding is None else asked(self.equations, sliding)
        return self.evaluated(x.tolist(), u.tolist(), ways)

    def _checked(self, x: ArrayLike, u: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        found = []
        for name, given, signals in (("x", x, self.states), ("u", u, self.inputs)):
            array = np.asarray(given, dtype=np.float64)
            if array.shape != (len(signals),):
                raise ConfigurationError(
                    f"{name}: expected {len(signals)} numbers ({', '.join(_names(signals))}), got shape {array.shape}"
                )
            found.append(array)
        return found[0], found[1]


def _zeros(lanes: Lanes) -> Any:
    """Rows of zeros that take any kind of number."""
    return lanes.over(np.full((lanes.count, 1), 0.0, dtype=object))


def _names(signals: Sequence[Signal]) -> tuple[str, ...]:
    return tuple(s.name for s in signals)


def _mode(plant: Plant, name: str | None) -> ActionMode | None:
    modes = {mode.name: mode for mode in plant.action_modes}
    if name is None:
        return next(iter(modes.values()), None)
    if name not in modes:
        raise ConfigurationError(f"unknown action mode '{name}' of {plant.name}; {nearest(name, modes)}")
    return modes[name]


def _refuse(rig: Rig, plant: Plant, has: Sequence[str]) -> None:
    """ConfigurationError for an effect of the rig that the equations leave out."""
    for full, value in rig.effects.items():
        name, parameter = full.split(".", 1)
        effect = plant.effects.effects[name]
        declared = {p.name: p for p in effect.parameters}
        on = effect.each_sensor or (parameter in declared and not declared[parameter].shape)
        if on and name not in has and value != plant.table[full].default:
            raise ConfigurationError(
                f"the equations of {plant.name} in continuous time leave out the effect '{name}'; they have: "
                f"{', '.join(has) or 'none'}"
            )
