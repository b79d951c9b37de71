"""The amplifier of the drive follows the command with a first-order lag."""

from cable_envs.core.kernels import exp, inline, select
from cable_envs.effects.base import Effect, EffectParameter

EFFECT = Effect(
    name="actuator_lag",
    seam="actuate",
    equation="time c' = command - c; the drive sees c, and its rate likewise",
    source="first-order actuator: Franklin, Powell, Emami-Naeini, Feedback Control of Dynamic Systems",
    parameters=(EffectParameter("time", "s", 0.0, 0.0, 10.0, "time constant", 0.03),),
    validity="lags that are small against the periods of the motion; it is solved exactly for a command that is held",
    experiment="Command a chirp. The phase of a lag bends over frequency, that of a delay is straight",
    confusable=("sensor_delay", "viscous_friction"),
)


@inline
def keep(time, dt):
    """Share of the distance to the command that is left after dt; 0 without the effect."""
    return select(time > 0.0, exp(-dt / select(time > 0.0, time, 1.0)), 0.0)


@inline
def lagged(state, command, left):
    """The command that acts after a step; the command itself, to the bit, where nothing is left."""
    return select(left > 0.0, command + (state - command) * left, command)
