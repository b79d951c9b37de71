"""What a drive is told arrives late."""

from cable_envs.effects.base import Effect, EffectParameter

EFFECT = Effect(
    name="command_delay",
    seam="actuate",
    equation="c(t) -> c(t - time); a command that is held is a mean over each control step",
    source="transport delay of a bus: Franklin, Powell, Workman, Digital Control of Dynamic Systems",
    parameters=(EffectParameter("time", "s", 0.0, 0.0, 10.0, "delay of the command", 0.01),),
    validity="commands of a record (`cable_envs.sim.replay.replay`); before the first sample the first one acts",
    experiment="Command a chirp. The phase of a delay is straight over frequency, that of a lag bends",
    confusable=("actuator_lag", "sensor_delay"),
    hypothesis=False,
)
