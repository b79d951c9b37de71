"""Rows of an effect's numbers in a plant's arrays: behind the plant's own coefficients, and behind its signals.

A plant whose arrays lack these rows, or whose row ON is zero throughout a block of columns, runs its kernel without
effects. All plants share one order, so that the pieces that read them are the same everywhere.
"""

OWN = 8
"""Rows for the parameters of a user's own effect."""

PARAMETERS = (
    "on",
    "coulomb_friction.level", "stribeck_friction.excess", "stribeck_friction.contact", "stribeck_friction.velocity",
    "asymmetric_friction.difference", "asymmetric_friction.contact", "presliding_hysteresis.displacement",
    "load_dependent_friction.coefficient", "load_dependent_friction.exponent",
    "stiffness_hardening.coefficient", "viscoelastic_creep.share", "viscoelastic_creep.time",
    "friction_drift.change", "friction_drift.time", "friction_drift.travel", "backlash.gap", "slack.length",
    "partial_slip.angle", "position_ripple.amplitude", "position_ripple.period", "position_ripple.phase",
    "position_dependent_load.stiffness", "position_dependent_load.neutral", "actuator_lag.time",
    *(f"own.{k}" for k in range(OWN)),
)  # fmt: skip
"""Coefficient rows. An effect's parameter that is not here is a parameter of the plant itself, or of a sensor."""

(ON, COULOMB, EXCESS, CONTACT_EXCESS, STRIBECK_V, DIFFERENCE, LOPSIDED, PRESLIDING, LOAD_SHARE, LOAD_EXPONENT,
 HARDENING, CREEP, CREEP_TIME, DRIFT, DRIFT_TIME, DRIFT_TRAVEL, GAP, SLACK_LENGTH, PARTIAL, RIPPLE, PERIOD,
 PHASE_ANGLE, SPRING, NEUTRAL, LAG, OWN_0) = range(len(PARAMETERS) - OWN + 1)  # fmt: skip
ROWS_E = len(PARAMETERS)

ELEMENTS = 4
"""Elements of the generalised Maxwell-slip model."""

STATES = (
    "started", "command", "command_rate", "gap_position", "pulley_angle", "creep_top", "creep_bottom", "drift",
    *(f"presliding_{k}" for k in range(ELEMENTS)), *(f"partial_{k}" for k in range(ELEMENTS)),
)  # fmt: skip
"""State rows. started: 0 until the first control step has given the states that depend on it their values."""

(STARTED, COMMAND_STATE, RATE_STATE, PLAY, PLAYED, CREEP_T, CREEP_B, WORN) = range(8)
PRE_0 = 8
PARTIAL_0 = PRE_0 + ELEMENTS
ROWS_S = len(STATES)

SENSE = ("sensor_delay", "sensor_bias", "sensor_scale", "sensor_rectification")
"""Rows of each measured signal, behind all the others."""
S_DELAY, S_BIAS, S_SCALE, S_RECTIFICATION = range(len(SENSE))
