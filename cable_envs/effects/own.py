"""Where a user's own effect is compiled in: these pieces do nothing, and a copy of the kernel takes others instead.

e, i: tile of the effects' coefficients and column; the numbers of an own effect begin at row `rows.OWN_0`. The plants
call these by name from their own files. See `cable_envs.plants.own_effects`.
"""

from cable_envs.core.kernels import inline


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
