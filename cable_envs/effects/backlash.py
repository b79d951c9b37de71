"""The drive, where the motion is measured, moves by a gap before what it drives moves."""

from cable_envs.core.kernels import clip, inline, maximum, minimum, select
from cable_envs.effects.base import Effect, EffectParameter

EFFECT = Effect(
    name="backlash",
    seam="actuate",
    equation="circuit: pulley q in [theta_in - gap/2, theta_in + gap/2], torque at an edge only; "
    "hole: play operator (the nut is held by its friction); by tension or torque of a tendon's drive the pull "
    "keeps it taken up; linear_drive: belt force k dz(x_m - x, gap/2)",
    source="Nordin and Gutman, Automatica 38 (2002) 1633: dead zone with a shaft's compliance, and the play operator",
    parameters=(
        EffectParameter(
            "gap", "m", 0.0, 0.0, 1.0, "whole width of the gap", 5e-4, 0.03,
            probes=(0.05, 0.1, 0.2, 0.4, 0.7, 1.0, 2.0),  # far from in proportion: a refit from far away ends elsewhere
        ),
    ),
    validity="a part between gear and cable without inertia; linear_drive needs a belt (belt_stiffness above 0)",
    experiment="Reverse with growing amplitude, with the output locked. The lost motion of a gap does not grow",
    confusable=("presliding_hysteresis", "cable_elongation", "slack"),
)  # fmt: skip


@inline
def play(nut, drive, gap):
    """Position of a nut with friction in a gap around the drive (play operator)."""
    return clip(nut, drive - 0.5 * gap, drive + 0.5 * gap)


@inline
def pulled_end(told_force, nut, drive, gap):
    """Where a drive holds a tendon, which can only pull, across a gap.

    Told its place, the drive finds the nut where its friction keeps it (`play`). Told its force, it feels the tendon's
    pull only through the nut, at the edge to which the tendon pulls it: a nut that kept the pull by itself would leave
    the drive free in the gap, and a drive that feels the pull there all the same gains gap times tension at every
    reversal, from nowhere. So the pull keeps the gap taken up, and the drive's position counts from there.
    """
    return select(told_force, drive, play(nut, drive, gap))


@inline
def apart(told_force, nut, drive, gap):
    """Whether a drive of `pulled_end` is between the edges, where it may move without the tendon's end."""
    return (not told_force) & (abs(drive - nut) < 0.4999995 * gap)


@inline
def dead_zone(stretch, gap):
    """What of a stretch is left beyond a gap."""
    half = 0.5 * gap
    return maximum(stretch - half, 0.0) + minimum(stretch + half, 0.0)
