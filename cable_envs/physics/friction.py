"""One inertia with set-valued dry friction: sticks exactly, slides by a second-order step."""

from cable_envs.core.kernels import inline, maximum, select


@inline
def stick_slip_step(v, mass, force_up, force_down, stiffness, damping_up, damping_down, dt, theta=0.5):
    """Velocity after dt of a mass whose net force depends on the direction of motion.

    symbol       | meaning                                                                    | unit
    ------------ | -------------------------------------------------------------------------- | ------------
    v            | velocity at the start (+ is up)                                            | m/s (rad/s)
    mass         | inertia, > 0                                                               | kg (kg m^2)
    force_up     | net force at the current state when it moves, or starts to move, up        | N (N m)
    force_down   | the same for down; force_up <= force_down (friction takes energy)          | N (N m)
    stiffness    | -dF/dposition >= 0 of the direction that applies                           | N/m
    damping_up   | -dF/dv >= 0 moving up (damping_down: moving down)                          | N s/m
    theta        | weight of the end of the step: 1/2 trapezoidal, 1 backward Euler           | 1

    The mass stays at exactly zero while force_up <= 0 <= force_down. It stops at exactly zero when its velocity would
    change sign within the step; whether it starts the other way is decided in the next step. Where it slides, the
    step is linearly implicit and stable for any stiffness and damping: trapezoidal (order 2), or backward Euler (order
    1, damps what the step cannot resolve). The caller moves the position by dt ((1 - theta) v + theta v_new).
    """
    up = (v > 0.0) | ((v == 0.0) & (force_up > 0.0))
    down = (v < 0.0) | ((v == 0.0) & (force_down < 0.0))
    force = select(up, force_up, force_down)
    damping = select(up, damping_up, damping_down)
    part = theta * dt
    gain = dt / (mass + part * (damping + part * stiffness))
    v_new = v + gain * (force - part * stiffness * v)
    return select(up & (v_new > 0.0), v_new, select(down & (v_new < 0.0), v_new, 0.0))


@inline
def crossing_step(v, mass, force_up, force_down, stiffness, damping, dt):
    """`stick_slip_step` (trapezoidal) that goes through zero within the step: order 2 at reversals too.

    Where the velocity changes sign, the rest of the step is made with the force of the other direction, if that moves
    the mass; else the mass sticks.
    """
    part = 0.5 * dt
    gain = dt / (mass + part * (damping + part * stiffness))
    return _through_zero(v, force_up, force_down, part * stiffness * v, gain, gain)[0]


@inline
def ringing_step(v, mass, force_up, force_down, stiffness, damping_up, damping_down, dt):
    """`crossing_step` whose vibrations are in time to order 4, for masses that ring long.

    A trapezoidal step of dt is late by (w dt)^2 / 12 of every turn of a vibration w. Here the stiffness counts 1/12 in
    the place of 1/4 (Fox and Goodwin 1949; Newmark's method with beta = 1/12), which takes the same energy through a
    step. Where w dt exceeds 1 it counts as much more as keeps the step stable at any stiffness.

    Returns
    -------
    v_new, short : float
        Velocity after dt, and how far less than dt (v + v_new) / 2 the mass goes, where it comes to rest. A mass that
        stops at the share 1 - s of the step has gone (1 - s) dt v / 2 by then. Without that it would stop by up to
        a dt^2 / 8 too late, always to the same side, where a is what slows it down.
    """
    part = 0.5 * dt
    up = (v > 0.0) | ((v == 0.0) & (force_up > 0.0))
    onward, back = select(up, damping_up, damping_down), select(up, damping_down, damping_up)
    gain, other = dt / ringing_inertia(mass, onward, stiffness, dt), dt / ringing_inertia(mass, back, stiffness, dt)
    new, left = _through_zero(v, force_up, force_down, part * stiffness * v, gain, other)
    return new, select(new == 0.0, part * v * left, 0.0)


@inline
def stick_slip_whole(v, mass, force_up, force_down, stiffness, damping_up, damping_down, dt):
    """In the place of `ringing_step` for the ids ``-v0``, which stop at the end of a step."""
    return stick_slip_step(v, mass, force_up, force_down, stiffness, damping_up, damping_down, dt), 0.0


@inline
def ringing_mass(mass, quarter):
    """What resists a change of speed in `ringing_step`, besides damping; ``quarter``: dt^2 / 4 times the stiffness."""
    return mass + maximum(quarter / 3.0, quarter - mass / 6.0)


@inline
def in_time(mass, stiffness, dt):
    """The mass with which a trapezoidal step on a spring is that of `ringing_step`."""
    quarter = 0.25 * dt * dt * stiffness
    return ringing_mass(mass, quarter) - quarter


@inline
def damped(held, damping, dt):
    """What damping resists a change of speed in `ringing_step`, besides ``held``, the `ringing_mass`.

    Half of it, as in a trapezoidal step, where it takes less than the whole speed within dt. Where it takes more it
    counts as much more as keeps the speed from changing its sign by damping alone: friction that grows with the speed
    as v^omega, omega >= 1, from its slope at the start of the step, then never throws the mass back.
    """
    return maximum(0.5 * dt * damping, dt * damping - held)


@inline
def beyond_middle(mass, damping, stiffness, dt):
    """How far behind the middle of a step `damped` has a force act, over half the step: 0 in the middle, 1 at its end.

    Where damping takes more than the whole speed within dt the mass goes with the force, m / c later. The force that
    counts is then that of the step's end less m / c, so that a force which grows evenly is followed exactly.
    """
    held = ringing_mass(mass, 0.25 * dt * dt * stiffness)
    return 1.0 - held / maximum(0.5 * dt * damping, held)


@inline
def ringing_inertia(mass, damping, stiffness, dt):
    """What resists a change of speed in `ringing_step`: dt times a unit of force over this is the change."""
    held = ringing_mass(mass, 0.25 * dt * dt * stiffness)
    return held + damped(held, damping, dt)


@inline
def trapezoidal_inertia(mass, damping, stiffness, dt):
    """In the place of `ringing_inertia` for trapezoidal steps."""
    return mass + 0.5 * dt * (damping + 0.5 * dt * stiffness)


@inline
def ringing_way(change, dt):
    """How far a change of speed within a step of `ringing_step` moves what it pulls at in the middle of the step.

    There the place of a mass counts as x + dt v / 2 + dt change / 12. It must be the same 1/12 for both masses of a
    spring, and for a place that is imposed: else their common vibrations are late by (w dt)^2 / 12 of every turn again.
    """
    return dt * change / 12.0


@inline
def ringing_lag(change, dt):
    """How far that place is behind the middle between both ends of the step, x + dt v / 2 + dt change / 4."""
    return dt * change / 6.0


@inline
def no_way(change, dt):
    """In the place of `ringing_way` and `ringing_lag` for the ids ``-v0``, whose steps are trapezoidal."""
    return 0.0


@inline
def _through_zero(v, force_up, force_down, late, gain, other):
    """(velocity after a step that changes it by gain (force - late), share of the step that is left at a reversal).

    After a reversal the velocity is the rest of the step times ``other`` times the force; without one nothing is left.
    """
    up = (v > 0.0) | ((v == 0.0) & (force_up > 0.0))
    down = (v < 0.0) | ((v == 0.0) & (force_down < 0.0))
    straight = v + gain * (select(up, force_up, force_down) - late)
    turns = (up & (straight < 0.0)) | (down & (straight > 0.0))
    left = 1.0 - v / select(turns, v - straight, 1.0)
    back = select(up, select(force_down < 0.0, force_down, 0.0), select(force_up > 0.0, force_up, 0.0))
    return select(up | down, select(turns, left * other * back, straight), 0.0), select(turns, left, 0.0)
