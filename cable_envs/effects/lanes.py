"""Named rows that the effects bring along: their states, the scratch of a control step, and what a sensor shows.

Their coefficients are named after the effects: parameter "gap" of "backlash" is ``e.backlash_gap[i]`` in a kernel
(`cable_envs.effects.Layout`). All plants share these declarations, so that the pieces that read them are the same
everywhere.
"""

from cable_envs.core.lanes import Field, Lanes

ELEMENTS = 4
"""Elements of the generalised Maxwell-slip model."""

STATE_FIELDS: tuple[Field, ...] = (
    "started", "command", "command_rate", "gap_position", "pulley_angle", "creep_top", "creep_bottom", "drift",
    "slow_creep_top", "slow_creep_bottom",
    ("presliding", ELEMENTS), ("partial", ELEMENTS), "raised", "second", "second_rate", "gap_opposed",
)  # fmt: skip
STATES = Lanes("States", STATE_FIELDS)
"""States of the effects of the library; those of effects with hooks come behind them (`cable_envs.effects.Layout`).

started: 0 until the first control step has given the states that depend on it their values. creep_top, creep_bottom:
all creep of a cable; slow_creep_top, slow_creep_bottom: the slow part of it. raised: dry friction over what it were
without Stribeck's part, in the step before."""

STEP = (
    "asked", "asked_rate", "ramped",  # the command asked for, its rate, and 1 where it goes there in a straight line
    "lag_left", "lag_late", "creep_left", "slow_left",  # what lag and creep keep over a step; the lag's mean share
    "factor",  # on dry friction, by drift
    "follows", "imposes",  # 1 where the drive follows a path, or its tension is imposed
    "start", "start_rate", "target", "target_rate",  # the drive at the start of the control step, at the step's end
    "up", "down", "steep",  # dry friction moving up and down, and its growth with the speed
    "excess", "contact_excess",  # of them Stribeck's part: force, and its share of the contact's friction
    "load_before",  # the load's position when the control step began
    "most", "idlers_most",  # largest growth of the share of friction that is mobilised with the position
    "part", "idlers_part",  # how much of a friction that builds up a step resolves
)  # fmt: skip
"""Scratch of a control step, the tile ``g`` of a kernel."""

SENSE = Lanes("Sense", ["sensor_delay", "sensor_bias", "sensor_scale", "sensor_rectification"])
"""Rows of each measured signal, behind all other coefficients."""
