"""A drive can only be told so many sizes of its command."""

from cable_envs.effects.base import Effect, EffectParameter

EFFECT = Effect(
    name="quantised_command",
    seam="actuate",
    equation="c -> limit round(steps c / limit) / steps",
    source="uniform quantiser of a digital drive: Franklin, Powell, Workman, Digital Control of Dynamic Systems, ch. "
    "10; the law is `cable_envs.physics.motor.shown`",
    parameters=(EffectParameter("steps", "1", 0.0, 0.0, 1e9, "sizes from none to the largest command; 0: any", 100.0),),
    validity="what the drive makes of its command: force or duty, behind a controller that the plant has",
    experiment="Let the reference creep. The force moves in steps",
    confusable=("dead_band",),
    hypothesis=False,
)
