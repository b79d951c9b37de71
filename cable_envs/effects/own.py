"""Where effects that bring functions of their own are compiled in.

The pieces here do nothing. Plants call them at their seams by these names, and a kernel with such effects has theirs
in their place (`joined`). e, s, i: tiles of the effects' coefficients and states, and column.
"""

import builtins
from collections.abc import Callable, Iterable, Mapping, Sequence
from inspect import Parameter, signature
from types import FunctionType
from typing import Any

from cable_envs.core.compiling.digests import names_read
from cable_envs.core.errors import ConfigurationError, nearest
from cable_envs.core.kernels import inline, maximum
from cable_envs.effects.base import Effect, lane_of

ARGUMENTS = {
    "actuate": ("command",),
    "cable": ("tension",),
    "contact": ("speed", "tension"),
    "load": ("position", "velocity", "tension"),
}
"""What a hook that asks for nothing by name is given before the numbers."""

STEP = ("time", "dt")
GIVEN = {
    "actuate": ("command", "position", "velocity", "speed", *STEP),
    "cable": ("tension", *STEP),
    "contact": ("position", "velocity", "speed", "tension", "tension_behind", *STEP),
    "load": ("position", "velocity", "speed", "tension", *STEP),
}
"""What a hook may ask for by name at a seam, besides the effect's states and parameters."""

_HEADS = {
    "actuate": "command, position, velocity",
    "cable": "tension",
    "contact": "position, velocity, tension, tension_behind",
    "load": "position, velocity, tension",
}
_JOIN = {"actuate": None, "cable": None, "contact": " + ", "load": " + "}  # None: one after the other
_STEP_ROWS = ("own_dt", "own_time", "own_drive_velocity", "own_load_velocity")


@inline
def own_actuate(command, position, velocity, e, s, i):
    """The command that acts; position and velocity of the drive."""
    return command


@inline
def own_cable(tension, e, s, i):
    """The tension of a taut cable that the law before gives as ``tension`` (N); in the circuit N m."""
    return tension


@inline
def own_contact(position, velocity, tension, tension_behind, e, s, i):
    """What the friction coefficient of the contact has more where the cable slides; tensions (N) at its two ends."""
    return 0.0


@inline
def own_load(position, velocity, tension, e, s, i):
    """Force (N, N m) that resists the load or output, opposite to positive motion."""
    return 0.0


STEP_Y, STEP_V = 1e-7, 1e-6
"""Steps of the differences that give the slopes of an own load: m and m/s, or rad and rad/s."""


@inline
def slopes_of_own_load(position, velocity, e, s, i):
    """(own load, its stiffness, its damping) at a position and speed; the latter two are never negative."""
    at = own_load(position, velocity, 0.0, e, s, i)
    stiffness = (own_load(position + STEP_Y, velocity, 0.0, e, s, i) - at) / STEP_Y
    damping = (own_load(position, velocity + STEP_V, 0.0, e, s, i) - at) / STEP_V
    return at, maximum(stiffness, 0.0), maximum(damping, 0.0)


@inline
def begin_memory(s, i, dt):
    """Before the first step of a control step: how long its steps are."""


@inline
def advance_memory(command, drive, drive_velocity, load, load_velocity, tension, behind, e, s, i):
    """After each step: states of effects and the time move on. Positions, velocities and tensions are those reached.

    ``tension`` is that of the cable at the drive, ``behind`` what `own_load` is given.
    """


def memory(effects: Iterable[Effect]) -> dict[str, float]:
    """Rows that effects as they are on a plant add to its states, with their values at the start."""
    acting = [effect for effect in effects if effect.hooks and effect.parameters]
    rows = {_row(effect, state.name): state.start for effect in acting for state in effect.states}
    asks = any(set(asked(effect, seam)) & set(STEP) for effect in acting for seam in effect.hooks)
    return dict.fromkeys(_STEP_ROWS, 0.0) | rows if rows or asks else {}


def _row(effect: Effect, state: str) -> str:
    return f"own_{effect.name}_{state}"


def asked(effect: Effect, seam: str, state: str = "") -> list[str]:
    """What a hook, or what advances a state, is given, in its order.

    Parameters
    ----------
    effect : Effect
        With hooks.
    seam : str
        Of the hook; for a state that of the effect.
    state : str
        The state that the function advances; empty: it is the hook.

    Returns
    -------
    list of str
        Names of `GIVEN`, states and parameters.

    Raises
    ------
    ConfigurationError
        Names what the function asks for, or uses, and there is not.
    """
    function = effect.advance[state] if state else effect.hooks[seam]
    what = f"what advances '{state}'" if state else f"the hook '{seam}'"
    names = list(signature(function).parameters)
    numbers = [p.name for p in effect.parameters]
    known = [*GIVEN[seam], *(one.name for one in effect.states), *numbers]
    by_position = [*ARGUMENTS[seam], *numbers]
    if set(names) <= set(known) and len(set(known)) == len(known):
        plain = Parameter.POSITIONAL_ONLY, Parameter.POSITIONAL_OR_KEYWORD
        if any(p.kind not in plain or p.default is not p.empty for p in signature(function).parameters.values()):
            raise ConfigurationError(f"{what} takes {signature(function)}; give it plain arguments without defaults")
        given = names
    elif not effect.states and not state and len(names) == len(by_position):
        given = by_position
    else:
        for name in names:
            if name not in known:
                raise ConfigurationError(f"{what} asks for '{name}', which there is not; {nearest(name, known)}")
        twice = next(name for name in known if known.count(name) > 1)
        raise ConfigurationError(f"'{twice}' is the name of two things that {what} may ask for; rename one")
    for name in names_read(function.__code__):
        if name not in function.__globals__ and not hasattr(builtins, name):
            raise ConfigurationError(
                f"{what} uses '{name}', which it neither asks for nor finds in its file; it may ask for: "
                f"{', '.join(known)}"
            )
    return given


def joined(effects: Iterable[Effect]) -> dict[str, Any]:
    """What takes the place of the pieces of this file, by their names, for effects with hooks on a plant."""
    acting = [effect for effect in effects if effect.hooks and effect.parameters]
    hooks: dict[str, Any] = {}
    for seam in ARGUMENTS:
        users = [effect for effect in acting if seam in effect.hooks]
        if users:
            hooks[f"own_{seam}"] = _hook(seam, users)
    if memory(acting):
        hooks["begin_memory"] = _piece("begin(s, i, dt)", ["s.own_dt[i] = dt"], {})
        hooks["advance_memory"] = _advance(acting)
    return hooks


def _hook(seam: str, users: Sequence[Effect]) -> Callable[..., float]:
    """One scalar piece of all hooks at a seam; it is written out, as the kernels' pieces cannot take a list.

    States, and the time, are those in the middle of the step: so what a plant does with the slopes of a hook (it finds
    them by differences) counts how the states follow the motion within the step.
    """
    body, space, calls = [], {}, []
    for k, effect in enumerate(users):
        space[f"f{k}"] = _compiled(effect.hooks[seam])
        now = _readings(effect, "s.own_time[i]", "0.5 * s.own_dt[i]")
        middle = _readings(effect, "s.own_time[i] + 0.5 * s.own_dt[i]", "s.own_dt[i]")
        if seam == effect.seam:  # elsewhere it is not known what moves them
            body += _advanced(effect, k, now, space)
            middle |= {state.name: f"m{k}_{j}" for j, state in enumerate(effect.states)}
        calls.append(f"f{k}({', '.join(middle[n] for n in asked(effect, seam))})")
        if _JOIN[seam] is None:
            body.append(f"{ARGUMENTS[seam][0]} = {calls[-1]}")
    between = _JOIN[seam]
    body.append(f"return {ARGUMENTS[seam][0] if between is None else between.join(calls)}")
    first = ["speed = abs(velocity)"] if "velocity" in _HEADS[seam] else []
    return _piece(f"own({_HEADS[seam]}, e, s, i)", first + body, space)


def _advanced(effect: Effect, k: int, now: Mapping[str, str], space: dict[str, Any]) -> list[str]:
    """Lines that put the states of the k-th effect, moved on, into m{k}_0, m{k}_1 and so on."""
    lines = []
    for j, state in enumerate(effect.states):
        space[f"a{k}_{j}"] = _compiled(effect.advance[state.name])
        given = ", ".join(now[name] for name in asked(effect, effect.seam, state.name))
        lines.append(f"m{k}_{j} = a{k}_{j}({given})")
    return lines


_AT = {
    "actuate": {"position": "drive - half * at_drive", "velocity": "at_drive"},
    "cable": {},
    "contact": {"position": "load - half * at_load", "velocity": "at_load", "tension_behind": "behind"},
    "load": {"position": "load - half * at_load", "velocity": "at_load", "tension": "behind"},
}
"""Of what `advance_memory` is given: what is asked for at a seam, in the middle of the step."""


def _advance(acting: Sequence[Effect]) -> Callable[..., None]:
    body, moved = [], []
    space: dict[str, Any] = {}
    body.append("half = 0.5 * s.own_dt[i]")
    body.append("at_drive = 0.5 * (s.own_drive_velocity[i] + drive_velocity)")
    body.append("at_load = 0.5 * (s.own_load_velocity[i] + load_velocity)")
    for k, effect in enumerate(acting):
        now = _readings(effect, "s.own_time[i]", "s.own_dt[i]") | _AT[effect.seam]
        now["speed"] = f"abs({now['velocity']})"
        body += _advanced(effect, k, now, space)
        moved += [f"s.{_row(effect, state.name)}[i] = m{k}_{j}" for j, state in enumerate(effect.states)]
    moved.append("s.own_time[i] += s.own_dt[i]")
    moved.append("s.own_drive_velocity[i], s.own_load_velocity[i] = drive_velocity, load_velocity")
    head = "own(command, drive, drive_velocity, load, load_velocity, tension, behind, e, s, i)"
    return _piece(head, [*body, *moved], space)


def _readings(effect: Effect, time: str, dt: str) -> dict[str, str]:
    """How a piece writes what an effect's functions ask for."""
    plain = {name: name for given in GIVEN.values() for name in given}
    states = {state.name: f"s.{_row(effect, state.name)}[i]" for state in effect.states}
    return {
        **plain,
        "time": time,
        "dt": dt,
        **states,
        **{p.name: f"e.{lane_of(effect, p)}[i]" for p in effect.parameters},
    }


def _compiled(function: Callable[..., float], seen: Mapping[Any, Any] | None = None) -> Any:
    """A plain function as a piece of kernels, with the plain functions of its own file that it calls."""
    done = {} if seen is None else seen
    if function in done:
        return done[function]
    others = {}
    for name in names_read(function.__code__):
        used = function.__globals__.get(name)
        if isinstance(used, FunctionType) and used.__globals__ is function.__globals__ and used is not function:
            others[name] = _compiled(used, done)
    if others:
        space = {**function.__globals__, **others}
        function = FunctionType(function.__code__, space, function.__name__, closure=function.__closure__)
    return inline(function)


def _piece(head: str, body: Sequence[str], space: dict[str, Any]) -> Callable[..., Any]:
    exec("\n".join([f"def {head}:", *(f"    {line}" for line in body)]), space)
    return inline(space[head.partition("(")[0]])
