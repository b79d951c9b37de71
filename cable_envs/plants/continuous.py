"""The equations of motion of a plant in continuous time, made of the pieces that its kernel is made of.

A plant's ``continuous.py`` says which signals are states, and has one function, the law:

    law(state, rows, *ways) -> (rates of the states, outputs)

``rows`` are the coefficients, inputs and scratch under the names that pieces of kernels read (``rows.p.load_mass[0]``).
``ways`` are the directions in which the plant slides, one for each dry friction that it has: 1.0, -1.0, or 0.0 where
the friction holds. The friction is set-valued at rest, so the law is asked for each direction, and
`cable_envs.continuous` decides which one holds: at rest it slides where the net force of a direction drives it that
way, and sticks otherwise.

A contact without a mass, as that of a tendon with its guide, is no such friction: what has slipped there is a state of
its own, whose rate `contained` gives.

The law is evaluated as plain Python with the elementary functions of floats, of complex steps, or of CasADi
(`cable_envs.core.compiling.templates.interpreted`). It therefore uses the functions of `cable_envs.core.kernels`, and
neither ``and`` nor ``if`` on what depends on states and inputs.
"""

from collections import namedtuple
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from cable_envs.core.kernels import maximum, minimum, select
from cable_envs.plants.base import ActionMode, Signal

Rows = namedtuple("Rows", ["p", "u", "e", "s", "g", "w", "x"])
"""Coefficients, inputs, effects; scratch: states of effects, of a control step, of the plant, its signals.

Each has its rows by name, of one column."""

Values = Mapping[str, float]
"""Every parameter of a rig by name, SI."""
Law = Callable[..., tuple[tuple[Any, ...], tuple[Any, ...]]]
Verge = Callable[..., Sequence[Any]]

TINY = 1e-300
"""Speed (m/s, rad/s) that stands for a motion that is about to start."""
NEAR = 1e-6
"""Share of the band between two limits within which something counts as at one of them."""


@dataclass(frozen=True)
class Input:
    """A quantity that drives the equations.

    Attributes
    ----------
    name : str
        Name of the input.
    unit : str
        SI unit.
    meaning : str
        What it is, for people.
    row : str
        Row of `cable_envs.core.inputs.INPUTS` that it is.
    """

    name: str
    unit: str
    meaning: str
    row: str


@dataclass(frozen=True)
class Equations:
    """What a plant says of itself in continuous time.

    Attributes
    ----------
    states : tuple of str
        Signals of the plant that are states, in the order of the law.
    inputs : tuple of Input
        What drives it.
    outputs : tuple of str
        Signals of the plant that the law gives beside the rates.
    law : callable
        (state, rows, *ways) -> (rates of the states, outputs).
    place : str
        The state that says where the output is.
    slides : tuple of str
        For each dry friction the state or input whose sign is the direction of sliding, that of the output first. At
        rest a friction may hang on the directions of those before it, and on no others.
    free : tuple of str
        Those of ``slides`` that are without dry friction in this rig: nothing stops there.
    against : tuple of str
        Those of ``slides`` that move in the negative direction when the output moves in the positive one.
    verge : callable, optional
        (state, rows, *ways) -> the same state with every contact without a mass slid to its limit that way.
    effects : tuple of str
        Effects that the law has.
    slack : mapping of callable to str
        Pieces that hold the slack of a cable as ``select(.., maximum(pull, 0.0), 0.0)`` -> the coefficient that their
        pull is over the tension, empty where it is the tension. A smooth version rounds them off.
    stiff : bool
        Whether contacts without a mass make it stiff where they come to rest.
    symbolic : mapping of str to callable
        Functions that the law calls by these names and that decide as they go -> what a CasADi function has instead.
    speed : float
        Speed over which a smooth version turns the friction round unless another is asked for, m/s or rad/s.
    """

    states: tuple[str, ...]
    inputs: tuple[Input, ...]
    outputs: tuple[str, ...]
    law: Law
    place: str
    slides: tuple[str, ...] = ()
    free: tuple[str, ...] = ()
    against: tuple[str, ...] = ()
    verge: Verge | None = None
    effects: tuple[str, ...] = ()
    slack: Mapping[Callable, str] = field(default_factory=dict)
    stiff: bool = False
    symbolic: Mapping[str, Callable] = field(default_factory=dict)
    speed: float = 1e-3


def driven(mode: ActionMode, rate: bool, disturbed: Signal) -> tuple[Input, ...]:
    """The inputs of a plant that a drive commands.

    Parameters
    ----------
    mode : ActionMode
        What the command is.
    rate : bool
        Whether the drive takes the rate of its command too.
    disturbed : Signal
        Name, unit and meaning of the disturbance.

    Returns
    -------
    tuple of Input
        The command, its rate where it is asked for, the same of a second command, and the disturbance.
    """
    told = mode.of or mode.name
    found = [Input("command", mode.unit, f"what the drive is told: {told}", "command")]
    if rate:
        found.append(
            Input("command_rate", f"{mode.unit}/s", "rate of the command, which the drive adds", "command_rate")
        )
    second = mode.second
    if second is not None:
        found.append(Input(second.name, second.unit, f"what the drives are told besides: {second.name}", "second"))
        if rate:
            found.append(Input(f"{second.name}_rate", f"{second.unit}/s", "rate of that", "second_rate"))
    return (*found, Input(disturbed.name, disturbed.unit, disturbed.meaning, "disturbance"))


def nudged(v, way):
    """Speed of a motion, which is about to start in the direction ``way`` where it is zero."""
    return v + TINY * way


def confined(rate, y, low, high, low_rate, high_rate):
    """Rate of what goes by ``rate`` of itself, and is kept between limits that move at rates of their own."""
    near = NEAR * (high - low)
    pushed = select(y <= low + near, maximum(rate, low_rate), rate)
    return select(y >= high - near, minimum(pushed, high_rate), pushed)


def rubs(value: Values, level: str) -> bool:
    """Whether the dry friction of `cable_envs.effects.seams.dry_friction` is any; ``level``: its Coulomb friction."""
    names = (level, "stribeck_friction.excess", "asymmetric_friction.difference")
    return any(value.get(name, 0.0) != 0.0 for name in names)


# The functions below are for laws. A smooth version has its own in their place.


def along(v, way):
    """Speed of sliding in a friction, which has the direction ``way`` where it is zero."""
    return nudged(v, way)


def rubbed(net, up, down, way):
    """The net force less a dry friction that is at most ``up`` moving up and ``down`` moving down; 0 where it holds."""
    return select(way > 0.0, net - up, select(way < 0.0, net + down, 0.0))


def limited(v, acceleration, limit):
    """The acceleration of a drive that gets no faster than its speed limit."""
    return select(v >= limit, minimum(acceleration, 0.0), select(v <= -limit, maximum(acceleration, 0.0), acceleration))


def engaged(pull, taut, limp):
    """One value where a cable pulls, another where it is slack."""
    return select(pull > 0.0, taut, limp)


def again(changed):
    """Whether a law that solves for what slides goes on, which it does while a pass ``changed`` something."""
    return bool(changed)


def contained(rate, y, low, high, low_rate, high_rate, unit=1.0):
    """`confined` of what slips, which a smooth version rounds off; ``unit``: of y, for one of the coordinate."""
    return confined(rate, y, low, high, low_rate, high_rate)
