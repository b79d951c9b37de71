"""A drive does nothing for commands that are small."""

from cable_envs.effects.base import Effect, EffectParameter

EFFECT = Effect(
    name="dead_band",
    seam="actuate",
    equation="c -> dz(c, width limit): c - width limit for c > width limit, c + width limit for c < -width limit, "
    "else 0",
    source="dead zone of an amplifier or a valve: Slotine and Li, Applied Nonlinear Control, Prentice-Hall 1991, sec. "
    "5.2; the law is `cable_envs.effects.backlash.dead_zone`",
    parameters=(EffectParameter("width", "1", 0.0, 0.0, 0.9, "half of the band, over the largest command", 0.02),),
    validity="what the drive makes of its command: force or duty, behind a controller that the plant has",
    experiment="Command small steps around zero with the load taken off. Nothing moves within the band",
    confusable=("coulomb_friction", "quantised_command"),
    hypothesis=False,
)
