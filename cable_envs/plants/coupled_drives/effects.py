"""The effects of the library that act on coupled drives, and those of their speed sensor."""

from dataclasses import replace

from cable_envs.effects import EFFECTS, Acting, Effect, EffectParameter

RECTIFICATION = replace(
    EFFECTS["sensor_rectification"],
    equation="y = x - share min(x, 0), then the detector's power: a share of 1 cuts negative speeds off, a share of 2 "
    "makes them positive",
    parameters=(
        EffectParameter("share", "1", 0.0, 0.0, 3.0, "share of negative values that is lost", 1.0, complete=True),
    ),
    each_sensor=False,
)
DETECTOR = Effect(
    name="detector_power",
    seam="sense",
    equation="z = sign(y) |y|^power",
    source="diode detector: a square law for small signals, a linear one for large signals (Horowitz and Hill, The Art "
    "of Electronics); the power stands for the law between",
    parameters=(EffectParameter("power", "1", 1.0, 0.5, 4.0, "power of the reading over the speed", 2.0),),
    validity="speeds within the range of the recording",
    experiment="Run at six constant speeds. The reading over the speed is not a straight line",
    confusable=("stribeck_friction",),
)

ACTING = Acting(
    effects={
        "coulomb_friction": ("level",), "viscous_friction": ("coefficient",),
        "stribeck_friction": ("excess", "velocity"), "asymmetric_friction": ("difference",),
        "presliding_hysteresis": ("displacement",), "lugre_friction": ("displacement", "damping"),
        "elastoplastic_friction": ("displacement", "damping", "breakaway"), "cable_elongation": ("belt_stiffness",),
        "stiffness_hardening": ("coefficient",), "viscoelastic_creep": ("share", "time"),
        "slow_creep": ("share", "time"),
        "friction_drift": ("change", "time", "travel"), "backlash": ("gap",),
        "position_ripple": ("force", "period", "phase"), "position_dependent_load": ("stiffness", "neutral"),
        "actuator_lag": ("time",),
    },
    sensors={"speed_reading": "V"},
    aliases={
        "coulomb_friction.level": "coulomb", "viscous_friction.coefficient": "viscous",
        "cable_elongation.belt_stiffness": "belt_stiffness",
    },
    forms=(RECTIFICATION, DETECTOR),
)  # fmt: skip
