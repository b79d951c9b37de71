"""Physics that a simulator may lack: one file per effect, all of them in one registry.

Every effect has a null value that is bit-equal to its absence, so one compiled kernel holds them all and a batch can
mix rigs with different effects. Switch one on with ``gymnasium.make(..., effects={"backlash": {"gap": 0.02}})``, in a
rig file under ``effects:``, or by its dotted name wherever a rig's parameter may be named ("backlash.gap").
"""

from cable_envs.effects.base import SEAMS, Acting, Effect, EffectParameter, EffectState, lane_of
from cable_envs.effects.layout import Layout
from cable_envs.effects.library import EFFECTS, dotted

__all__ = ["EFFECTS", "SEAMS", "Acting", "Effect", "EffectParameter", "EffectState", "Layout", "dotted", "lane_of"]
