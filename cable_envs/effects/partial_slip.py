"""After a reversal the cable slips idler by idler: friction turns round over an angle (delay and transition)."""

from cable_envs.effects.base import Effect, EffectParameter

EFFECT = Effect(
    name="partial_slip",
    seam="contact",
    equation="share of the idlers' friction: s_k' = 4 v_out / (k angle) in [0, 1]; M_out = mix(cw, ccw, mean s)",
    source="delay and transition of Fig. 6 and Eq. (47), Zou 2022; elements: Al-Bender et al., IEEE TAC 50 (2005) 1883",
    parameters=(
        EffectParameter("angle", "m", 0.0, 0.0, 1.0, "output motion over which the friction turns round", 1e-3, 0.05),
    ),
    validity="closed form only: the chain has the mechanism itself (its slip fronts), whatever this number is",
    experiment="small reversals under a constant output torque: the slope of output over drive angle",
    confusable=("presliding_hysteresis", "backlash", "cable_elongation"),
)
