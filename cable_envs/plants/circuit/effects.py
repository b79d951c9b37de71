"""The pieces that effects add to both circuit plants: the pulley behind a gap, creep, friction of the output."""

import numpy as np

from cable_envs.core.kernels import clip, inline, maximum, select, sqrt
from cable_envs.effects.position_ripple import wave
from cable_envs.effects.presliding_hysteresis import begin, damping, follow
from cable_envs.effects.rows import (
    GAP,
    HARDENING,
    NEUTRAL,
    PARTIAL,
    PARTIAL_0,
    PERIOD,
    PHASE_ANGLE,
    PLAY,
    PRE_0,
    PRESLIDING,
    RIPPLE,
    SPRING,
    STARTED,
)  # fmt: skip
from cable_envs.effects.seams import DOWN, STEEP, UP, elastic
from cable_envs.physics.friction import stick_slip_step

_TAU = 2.0 * np.pi


@inline
def moves_otherwise(e, i):
    """Whether the driving pulley is not simply where the drive is."""
    return (e[GAP, i] > 0.0) | (e[RIPPLE, i] != 0.0)


@inline
def pulley(e, s, i, drive, torque, slope):
    """(angle less the drive's, turn per turn of the drive, angle in the gap) of the driving pulley; PLAY stays.

    It has no inertia: in the gap it goes to where the cables do not pull (one Newton step with dM_in/dangle = slope).
    """
    half = 0.5 * e[GAP, i]
    free = s[PLAY, i] - torque / maximum(slope, 1e-12)
    held = clip(free, drive - half, drive + half)
    inside = select(half > 0.0, held, drive)
    more, steep = wave(inside, e[RIPPLE, i], e[PERIOD, i], e[PHASE_ANGLE, i])
    turns = select((half > 0.0) & (held == free), 0.0, 1.0 + steep)
    other = moves_otherwise(e, i)
    return select(other, inside + more - drive, 0.0), select(other, turns, 1.0), inside


@inline
def spring(e, i, angle, wanted, stiffness):
    """The load's torque and stiffness with a spring to ground."""
    k = e[SPRING, i]
    return select(k > 0.0, wanted + k * (angle - e[NEUTRAL, i]), wanted), stiffness + k


@inline
def rise(e, i, tension):
    """The cable's stiffness over the one without tension."""
    return sqrt(1.0 + 2.0 * e[HARDENING, i] * maximum(tension, 0.0))


@inline
def output_step(e, s, g, i, v, inertia, ccw, cw, wanted, ahead, stiffness, damping_up, damping_down, dt):
    """Output velocity after dt.

    ccw, cw: what the cables give moving either way; their difference, the idlers' friction, and the output's own dry
    friction in g are set-valued, or build up over a distance each. ``ahead`` is what the step will subtract too much.
    """
    up, down, rising, falling = ccw, cw, -g[UP, i], g[DOWN, i]
    partial, bent = e[PARTIAL, i] > 0.0, e[PRESLIDING, i] > 0.0
    begin(s, PARTIAL_0, i, s[STARTED, i], clip((cw - wanted) / maximum(cw - ccw, 1e-12), 0.0, 1.0))
    begin(s, PRE_0, i, s[STARTED, i], 0.5)
    idlers, k_idlers = elastic(s, PARTIAL_0, i, v, ccw, cw, e[PARTIAL, i])
    own, k_own = elastic(s, PRE_0, i, v, rising, falling, e[PRESLIDING, i])
    up, down = select(partial, idlers, up), select(partial, idlers, down)
    rising, falling = select(bent, own, rising), select(bent, own, falling)
    k = select(partial, k_idlers, 0.0) + select(bent, k_own, 0.0)
    c = damping(k, inertia)
    least = -inertia / dt  # falling friction drives; what is left must still resist
    damping_up = maximum(damping_up + g[STEEP, i], least) + c
    damping_down = maximum(damping_down + g[STEEP, i], least) + c
    force_up = up - wanted + rising + ahead - c * v
    force_down = down - wanted + falling + ahead - c * v
    stiffness = stiffness + k
    sliding = stick_slip_step(v, inertia, force_up, force_down, stiffness, damping_up, damping_down, dt)
    gain = dt / (inertia + 0.5 * dt * (damping_up + 0.5 * dt * stiffness))
    smooth = v + gain * (force_up - 0.5 * dt * stiffness * v)
    v_new = select((force_up == force_down) & (partial | bent), smooth, sliding)
    moved = 0.5 * dt * (v + v_new)
    follow(s, PARTIAL_0, i, moved, e[PARTIAL, i])
    follow(s, PRE_0, i, moved, e[PRESLIDING, i])
    return v_new


def drive_at(angle: np.ndarray, torque: np.ndarray, e: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(drive angle, pulley angle in the gap) at rest with the pulley at ``angle`` under ``torque`` (rad, N m, [n])."""
    inside = angle.copy()
    if np.any(e[RIPPLE] != 0.0):
        for _ in range(60):
            inside = angle - e[RIPPLE] * np.sin(_TAU * inside / e[PERIOD] + e[PHASE_ANGLE])
    edge = np.where(np.abs(torque) > 1e-9, np.sign(torque), 0.0)
    return inside + 0.5 * e[GAP] * edge, inside
