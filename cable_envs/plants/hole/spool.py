"""Where the cable of the cable-hole plant ends: behind a gap, on an eccentric spool."""

from typing import Any

import numpy as np

from cable_envs.core.kernels import inline, maximum, minimum, select
from cable_envs.effects.backlash import pulled_end
from cable_envs.effects.position_ripple import wave
from cable_envs.effects.slow_creep import lasting

_TAU = 2.0 * np.pi


@inline
def engaged(e, s, i, position, speed):
    """Whether a drive that is to move at ``speed`` takes the cable's end along from the start of the step."""
    half, lead = 0.5 * e.backlash_gap[i], position - s.gap_position[i]
    at_edge = ((speed > 0.0) & (lead >= half * 0.999999)) | ((speed < 0.0) & (lead <= -half * 0.999999))
    return (half <= 0.0) | at_edge


@inline
def idle_share(e, s, i, position, speed, dt):
    """Share of a step in which a drive that is to move at ``speed`` crosses its gap before the cable's end moves."""
    half, lead = 0.5 * e.backlash_gap[i], position - s.gap_position[i]
    left = maximum(half - select(speed < 0.0, -lead, lead), 0.0)
    return select(half > 0.0, minimum(left / maximum(abs(speed) * dt, 1e-300), 1.0), 0.0)


@inline
def nut_before(e, s, i, drive, by_force):
    """Where the part behind the gap is before a step that begins with the drive there, which is told its force or not.

    Told its force, a drive has its gap taken up (`cable_envs.effects.backlash.pulled_end`).
    """
    return select((e.backlash_gap[i] > 0.0) & (not by_force), s.gap_position[i], drive)


@inline
def nut_after(e, s, i, drive, by_force):
    """Where the part behind the gap is after a step that ends with the drive there, which is told its force or not."""
    gap = e.backlash_gap[i]
    return select(gap > 0.0, pulled_end(by_force, s.gap_position[i], drive, gap), drive)


@inline
def wound(e, i, nut):
    """(position of the cable's end, how far it moves with the nut) on an eccentric spool."""
    ripple, steep = wave(nut, e.position_ripple_amplitude[i], e.position_ripple_period[i], e.position_ripple_phase[i])
    return nut + ripple, 1.0 + steep


@inline
def cable_end(e, s, i, old, new, speed, dt, by_force):
    """(position before, position after, mean speed, speed after) of the cable's end; PLAY is moved on."""
    before, after = nut_before(e, s, i, old, by_force), nut_after(e, s, i, new, by_force)
    s.gap_position[i] = after
    x0, _ = wound(e, i, before)
    x1, steep = wound(e, i, after)
    drawn = select(after != before, speed * steep, 0.0)
    return x0, x1, (x1 - x0) / dt, drawn


@inline
def moves_otherwise(e, i, by_force=False):
    """Whether the cable's end is not simply where the drive is; told its force, a drive has its gap taken up."""
    return ((e.backlash_gap[i] > 0.0) & (not by_force)) | (e.position_ripple_amplitude[i] != 0.0)


def spool_at(end: np.ndarray, e: Any) -> np.ndarray:
    """Position of the drive at which the cable's end is at ``end``, in the middle of the gap (m, [n])."""
    x = end.copy()
    if np.any(e.position_ripple_amplitude != 0.0):
        for _ in range(60):
            x = end - e.position_ripple_amplitude * np.sin(
                _TAU * x / e.position_ripple_period + e.position_ripple_phase
            )
    return x


def settle_drive(x, s, p, e, slip: np.ndarray, tension: np.ndarray) -> None:
    """The drive at rest above a hole through which ``slip`` of the cable has gone (m, [n]), at a tension (N, [n])."""
    hard = e.stiffness_hardening_coefficient
    stretch = 2.0 * tension / (1.0 + np.sqrt(1.0 + 2.0 * hard * tension)) / p.cable_stiffness
    x.drive_position[:] = spool_at(slip + stretch * (1.0 + lasting(e)) + e.slack_length, e)
    s.creep_top[:], s.slow_creep_top[:] = lasting(e) * stretch, e.slow_creep_share * stretch
    s.gap_position[:] = x.drive_position
