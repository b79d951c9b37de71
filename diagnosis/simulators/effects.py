"""Laws at the ports of a user's simulator that the library of effects does not have.

They are declared as the library's are (`cable_envs.effects`), and act here only: in `signals` those of a command and of
a sensor, in `ports` the forces.
"""

import numpy as np

from cable_envs.core.kernels import inline
from cable_envs.effects import Effect, EffectParameter
from cable_envs.effects.base import CONSTANT, DRIFT

QUADRATIC = Effect(
    name="quadratic_drag",
    seam="load",
    equation="F = -coefficient v |v|",
    source="Newton's resistance of inertial flow: White, Fluid Mechanics, section 7.6",
    parameters=(
        EffectParameter("coefficient", "N s^2/m^2", 0.0, 0.0, 1e6, "drag at the speed 1", 10.0, 1e-3),
    ),
    validity="turbulent flow around what moves",
    experiment="Move at eight constant speeds. The resistance over speed is a parabola",
    confusable=("viscous_friction",),
)  # fmt: skip
CONSTANT_LOAD = Effect(
    name="constant_load",
    seam="load",
    equation="F = -force",
    source="a weight, or a tilted axis",
    parameters=(
        EffectParameter("force", "N", 0.0, -1e6, 1e6, "constant force against positive motion", 1.0, signed=True),
    ),
    validity="any motion",
    experiment="Hold at rest at several places",
    confusable=("asymmetric_friction", "position_dependent_load", "sensor_bias"),
    proportional=True,
)  # fmt: skip
FORMS = (QUADRATIC, CONSTANT_LOAD)
"""Forces."""


@inline
def drag(coefficient, v):
    """(resistance, its slope to v) of `QUADRATIC`."""
    return coefficient * v * abs(v), 2.0 * coefficient * abs(v)


COMMAND_GAIN = Effect(
    name="command_gain",
    seam="actuate",
    equation="u = gain command",
    source="ISO/IEC Guide 98-3 (GUM), systematic error",
    parameters=(EffectParameter("gain", "1", 1.0, 0.01, 100.0, "factor on the command", 1.1, signed=True),),
    validity="linear amplifiers",
    experiment="Measure what two known commands give",
    confusable=("sensor_scale", "command_saturation", "supply_droop"),
    over_time=CONSTANT,
)
DEAD_BAND = Effect(
    name="command_dead_band",
    seam="actuate",
    equation="u = command beyond +-width / 2, less that; 0 within",
    source="Nordin and Gutman, Automatica 38 (2002) 1633: dead zone; the law is "
    "`cable_envs.effects.backlash.dead_zone`, and the width is no share of a largest command, which may be unknown",
    parameters=(EffectParameter("width", "1", 0.0, 0.0, 1e6, "whole width of the dead band", 0.1),),
    validity="amplifiers and valves without memory",
    experiment="Command slow ramps of small size through zero",
    confusable=("coulomb_friction", "command_step", "stribeck_friction"),
)
COMMAND_STEP = Effect(
    name="command_step",
    seam="actuate",
    equation="u = step round(command / step)",
    source="Widrow and Kollar, Quantization Noise, Cambridge 2008; the law is `cable_envs.physics.motor.shown`",
    parameters=(EffectParameter("step", "1", 0.0, 0.0, 1e6, "least step of the command", 0.1),),
    validity="converters with even steps",
    experiment="Command a slow ramp. What it does comes in steps",
    confusable=("command_dead_band",),
)
SATURATION = Effect(
    name="command_saturation",
    seam="actuate",
    equation="u = command within +-limit, else +-limit",
    source="Franklin, Powell, Emami-Naeini, Feedback Control of Dynamic Systems",
    parameters=(EffectParameter("limit", "1", 0.0, 0.0, 1e9, "largest size; 0 is no limit", 1.0, inverse=True),),
    validity="limits that are the same in both directions",
    experiment="Command the largest size in both directions",
    confusable=("command_gain", "supply_droop"),
)
DROOP = Effect(
    name="supply_droop",
    seam="actuate",
    equation="u = command (1 - droop |command| / full)",
    source="Thevenin's theorem: the voltage of a supply with a resistance falls with what is drawn",
    parameters=(EffectParameter("droop", "1", 0.0, 0.0, 0.9, "share of the supply that a full command takes", 0.2),),
    validity="commands that draw from the supply in proportion to their size",
    experiment="Command small and large steps. The large ones give less than in proportion",
    confusable=("command_saturation", "command_gain"),
)
OF_COMMANDS = (COMMAND_GAIN, DEAD_BAND, COMMAND_STEP, SATURATION, DROOP)
"""In which order they act, is said in `cable_envs.diagnosis.simulators.signals.sent`."""

SENSOR_LAG = Effect(
    name="sensor_lag",
    seam="sense",
    equation="time y' = x - y",
    source="first-order filter: Franklin, Powell, Emami-Naeini, Feedback Control of Dynamic Systems",
    parameters=(EffectParameter("signal", "s", 0.0, 0.0, 1.0, "time constant of this sensor", 0.02),),
    validity="filters of the first order",
    experiment="Command a chirp that two sensors see. The phase of a lag bends over frequency",
    confusable=("sensor_delay", "actuator_lag", "command_delay"),
    each_sensor=True,
)
SENSOR_DRIFT = Effect(
    name="sensor_drift",
    seam="sense",
    equation="y = x + rate t, t from the start of the record",
    source="ISO/IEC Guide 98-3 (GUM), drift",
    parameters=(EffectParameter("signal", "", 0.0, -1e6, 1e6, "drift of the sensor's zero", 0.01, signed=True),),
    validity="zeros that drift evenly",
    experiment="Read the sensor at rest for as long as the records last",
    confusable=("sensor_bias",),
    each_sensor=True,
    proportional=True,
    over_time=DRIFT,
)
SENSOR_STEP = Effect(
    name="sensor_step",
    seam="sense",
    equation="y = step round(x / step)",
    source="Widrow and Kollar, Quantization Noise, Cambridge 2008",
    parameters=(EffectParameter("signal", "", 0.0, 0.0, 1e6, "least step of this sensor", 0.01),),
    validity="converters and encoders with even steps",
    experiment="Move slowly. What is shown comes in steps",
    each_sensor=True,
)
OF_SENSORS = (SENSOR_LAG, SENSOR_DRIFT, SENSOR_STEP)


def limited(values: np.ndarray, limit: np.ndarray) -> np.ndarray:
    """`SATURATION`; as they are without a limit (0)."""
    most = np.where(limit > 0.0, limit, np.inf)
    return np.clip(values, -most, most)


def drooping(values: np.ndarray, droop: np.ndarray, full: float) -> np.ndarray:
    """`DROOP`."""
    return values * (1.0 - droop * np.abs(values) / full)
