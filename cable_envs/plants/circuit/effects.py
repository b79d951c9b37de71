"""The pieces that effects add to both circuit plants: the pulley behind a gap, creep, friction of the output."""

import numpy as np

from cable_envs.core.kernels import clip, inline, maximum, select, sqrt
from cable_envs.effects.base import Acting
from cable_envs.effects.bristles import bristle_length
from cable_envs.effects.position_ripple import wave
from cable_envs.effects.presliding_hysteresis import begin, damping, follow, share, slope
from cable_envs.effects.seams import (
    between,
    builds_up,
    elastic,
    elastic_damping,
    mobilising,
    moved_on,
    raised,
    resolved,
)  # fmt: skip
from cable_envs.physics.friction import ringing_step

ACTING = Acting(
    effects={
        "coulomb_friction": ("level", "contact"), "viscous_friction": ("coefficient", "drive"),
        "stribeck_friction": ("excess", "velocity"), "asymmetric_friction": ("difference",),
        "presliding_hysteresis": ("displacement",), "lugre_friction": ("displacement", "damping"),
        "elastoplastic_friction": ("displacement", "damping", "breakaway"),
        "load_dependent_friction": ("coefficient", "shaft"),
        "cable_elongation": ("tensile_stiffness",), "stiffness_hardening": ("coefficient",),
        "viscoelastic_creep": ("share", "time"), "slow_creep": ("share", "time"),
        "friction_drift": ("change", "time", "travel"),
        "backlash": ("gap",), "slack": ("length",), "position_ripple": ("amplitude", "period", "phase"),
        "position_dependent_load": ("stiffness", "neutral", "mass"), "actuator_lag": ("time",),
    },
    sensors={
        "drive_angle": "rad", "drive_torque": "N m", "output_angle": "rad", "output_torque": "N m",
        "tension_drive_top": "N", "tension_drive_bottom": "N",
    },
    aliases={
        "coulomb_friction.level": "brake_torque", "coulomb_friction.contact": "cable_friction",
        "viscous_friction.coefficient": "output_damping", "viscous_friction.drive": "drive_damping",
        "load_dependent_friction.shaft": "shaft_friction", "cable_elongation.tensile_stiffness": "tensile_stiffness",
        "position_dependent_load.mass": "payload_mass",
    },
    turning=True,
)  # fmt: skip
"""What acts on both circuit plants. The slip front of the closed form alone may take an angle (`partial_slip`): the
chain's is what its contacts make it."""

_TAU = 2.0 * np.pi


@inline
def moves_otherwise(e, i):
    """Whether the driving pulley is not simply where the drive is."""
    return (e.backlash_gap[i] > 0.0) | (e.position_ripple_amplitude[i] != 0.0)


@inline
def any_apart(e, lanes):
    """Whether the driving pulley of a column of the block is not simply where its drive is."""
    found = False
    for i in range(lanes):
        found = found or moves_otherwise(e, i)
    return found


@inline
def any_creeps(e, s, lanes):
    """Whether a cable of the block creeps, or has crept."""
    found = False
    for i in range(lanes):
        found = found or (e.viscoelastic_creep_share[i] > 0.0) or (e.slow_creep_share[i] > 0.0)
        found = found or (s.creep_top[i] != 0.0) or (s.creep_bottom[i] != 0.0)
        found = found or (s.slow_creep_top[i] != 0.0) or (s.slow_creep_bottom[i] != 0.0)
    return found


@inline
def any_hardens(e, lanes):
    """Whether a cable of the block grows stiffer with its tension."""
    found = False
    for i in range(lanes):
        found = found or (e.stiffness_hardening_coefficient[i] > 0.0)
    return found


@inline
def pulley(e, s, i, drive, torque, slope):
    """(angle less the drive's, turn per turn of the drive, angle in the gap) of the driving pulley; PLAY stays.

    It has no inertia: in the gap it goes to where the cables do not pull (one Newton step with dM_in/dangle = slope).
    """
    half = 0.5 * e.backlash_gap[i]
    free = s.gap_position[i] - torque / maximum(slope, 1e-12)
    held = clip(free, drive - half, drive + half)
    inside = select(half > 0.0, held, drive)
    more, steep = wave(inside, e.position_ripple_amplitude[i], e.position_ripple_period[i], e.position_ripple_phase[i])
    turns = select((half > 0.0) & (held == free), 0.0, 1.0 + steep)
    other = moves_otherwise(e, i)
    return select(other, inside + more - drive, 0.0), select(other, turns, 1.0), inside


@inline
def spring(e, i, angle, wanted, stiffness):
    """The load's torque and stiffness with a spring to ground."""
    k = e.position_dependent_load_stiffness[i]
    return select(k > 0.0, wanted + k * (angle - e.position_dependent_load_neutral[i]), wanted), stiffness + k


@inline
def rise(e, i, tension):
    """The cable's stiffness over the one without tension."""
    return sqrt(1.0 + 2.0 * e.stiffness_hardening_coefficient[i] * maximum(tension, 0.0))


@inline
def output_step(e, s, g, i, v, inertia, ccw, cw, wanted, ahead, stiffness, damping_up, damping_down, dt, builds):
    """Output velocity after dt, and how far the output falls short of its mean speed where it stops.

    ccw, cw: what the cables give moving either way; their difference, the idlers' friction, and the output's own dry
    friction in g are set-valued, or build up over a distance each. ``ahead`` is what the step will subtract too much.
    builds: `cable_envs.effects.seams.any_builds_up`.
    """
    up, down, rising, falling = ccw, cw, -g.up[i], g.down[i]
    least = -inertia / dt  # falling friction drives; what is left must still resist
    damping_up, damping_down = maximum(damping_up + g.steep[i], least), maximum(damping_down + g.steep[i], least)
    if not builds:
        up, down = up - wanted + rising + ahead, down - wanted + falling + ahead
        v_new, short = output_slides(v, inertia, up, down, stiffness, damping_up, damping_down, dt)
        return v_new, select(v_new == 0.0, short, 0.0)
    angle, band = e.partial_slip_angle[i], maximum(g.up[i] + g.down[i], 1e-12)
    partial, bent = angle > 0.0, builds_up(e, i)
    begin(s.partial, i, s.started[i], clip((cw - wanted) / maximum(cw - ccw, 1e-12), 0.0, 1.0))
    begin(s.presliding, i, s.started[i], 0.5)
    over = raised(e, s, i, band, 2.0 * g.excess[i])
    most = g.most[i] / over
    part, steep, bends = mobilising(e, s, i, v, most)
    idlers, k_idlers = elastic(share(s.partial, i), slope(s.partial, i, v, angle), ccw, cw)
    own, k_own = elastic(part, steep, rising, falling)
    # what no step resolves stays set-valued
    some = g.idlers_part[i]
    up, down = between(ccw, idlers, some), between(cw, idlers, some)
    most_own = select(bent, squared(resolved(most, band, inertia, dt)), 0.0)
    rising, falling = between(rising, own, most_own), between(falling, own, most_own)
    k = some * k_idlers + most_own * k_own
    c_idlers = some * damping(k_idlers, inertia)
    c_own = most_own * elastic_damping(e, i, inertia, k_own, most * band, bends, dt)
    both = sqrt(c_idlers * c_idlers + c_own * c_own)
    c = select(bristle_length(e, i) > 0.0, c_idlers + c_own, both)
    damping_up, damping_down = damping_up + c, damping_down + c
    force_up = up - wanted + rising + ahead - c * v
    force_down = down - wanted + falling + ahead - c * v
    stiffness = stiffness + k
    sliding, short = output_slides(v, inertia, force_up, force_down, stiffness, damping_up, damping_down, dt)
    gain = dt / (inertia + 0.5 * dt * (damping_up + 0.5 * dt * stiffness))
    smooth = v + gain * (force_up - 0.5 * dt * stiffness * v)
    v_new = select((force_up == force_down) & (partial | bent), smooth, sliding)
    moved = 0.5 * dt * (v + v_new)
    follow(s.partial, i, moved, angle)
    moved_on(e, s, i, moved, over)
    return v_new, select(v_new == 0.0, short, 0.0)


@inline
def output_slides(v, inertia, up, down, stiffness, damping_up, damping_down, dt):
    """Speed of the output after a step, which may turn round within it, and what it falls short where it stops."""
    return ringing_step(v, inertia, up, down, stiffness, damping_up, damping_down, dt)


@inline
def resolve_idlers(e, g, i, ccw, cw, inertia, dt):
    """How much of the idlers' friction turns round over an angle, and not at once, into g."""
    part = resolved(g.idlers_most[i], maximum(cw - ccw, 1e-12), inertia, dt)
    g.idlers_part[i] = select(e.partial_slip_angle[i] > 0.0, squared(part), 0.0)


@inline
def squared(part):
    """Of what is resolved: the stiffness of a force with this part in it goes to zero with the distance."""
    return part * part


def drive_at(angle: np.ndarray, torque: np.ndarray, e) -> tuple[np.ndarray, np.ndarray]:
    """(drive angle, pulley angle in the gap) at rest with the pulley at ``angle`` under ``torque`` (rad, N m, [n])."""
    inside = angle.copy()
    if np.any(e.position_ripple_amplitude != 0.0):
        for _ in range(60):
            inside = angle - e.position_ripple_amplitude * np.sin(
                _TAU * inside / e.position_ripple_period + e.position_ripple_phase
            )
    edge = np.where(np.abs(torque) > 1e-9, np.sign(torque), 0.0)
    return inside + 0.5 * e.backlash_gap * edge, inside
