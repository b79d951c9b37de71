"""Where effects that bring a function of their own are compiled in.

The pieces here do nothing. Plants call them at their seams by these names, and a kernel with such effects has theirs
in their place (`joined`). e, i: tile of the effects' coefficients and column.
"""

from collections.abc import Callable, Iterable, Sequence
from typing import Any

from cable_envs.core.kernels import inline
from cable_envs.effects.base import Effect, lane_of

ARGUMENTS = {
    "actuate": ("command",),
    "cable": ("tension",),
    "contact": ("speed", "tension"),
    "load": ("position", "velocity", "tension"),
}
"""What a hook is given before the numbers."""

_JOIN = {"actuate": None, "cable": None, "contact": " + ", "load": " + "}  # None: one after the other


@inline
def own_actuate(command, e, i):
    """The command that acts."""
    return command


@inline
def own_cable(tension, e, i):
    """The tension of a taut cable that the law before gives as ``tension`` (N); in the circuit N m."""
    return tension


@inline
def own_contact(speed, tension, e, i):
    """What the hole's friction coefficient has more at a sliding speed (m/s, >= 0) and a drive-side tension (N)."""
    return 0.0


@inline
def own_load(position, velocity, tension, e, i):
    """Force (N, N m) that resists the load or output, opposite to positive motion."""
    return 0.0


def joined(effects: Iterable[Effect]) -> dict[str, Any]:
    """What takes the place of the pieces of this file, by their names, for effects with hooks on a plant."""
    hooks = {}
    acting = [effect for effect in effects if effect.hooks and effect.parameters]
    for seam in ARGUMENTS:
        users = [(e.hooks[seam], [lane_of(e, p) for p in e.parameters]) for e in acting if seam in e.hooks]
        if users:
            hooks[f"own_{seam}"] = _hook(seam, users)
    return hooks


def _hook(seam: str, users: Sequence[tuple[Callable[..., float], list[str]]]) -> Callable[..., float]:
    """One scalar piece of all hooks at a seam; it is written out, as the kernels' pieces cannot take a list."""
    given = ARGUMENTS[seam]
    space: dict[str, Any] = {f"f{k}": inline(function) for k, (function, _) in enumerate(users)}
    calls = [
        f"f{k}({', '.join([*given, *(f'e.{row}[i]' for row in rows)])})" for k, (_, rows) in enumerate(users)
    ]  # fmt: skip
    between = _JOIN[seam]
    if between is not None:
        body = [f"    return {between.join(calls)}"]
    else:
        body = [*(f"    {given[0]} = {call}" for call in calls), f"    return {given[0]}"]
    exec("\n".join([f"def own({', '.join(given)}, e, i):", *body]), space)
    return inline(space["own"])
