"""After a reversal the cable slips on one idler after the other, so that friction reverses over an angle."""

from cable_envs.effects.base import Effect, EffectParameter

EFFECT = Effect(
    name="partial_slip",
    seam="contact",
    equation="share of the idlers' friction: s_k' = 4 v_out / (k angle) in [0, 1]; M_out = mix(cw, ccw, mean s)",
    source="delay and transition of Fig. 6 and Eq. (47), Zou 2022; elements: Al-Bender et al., IEEE TAC 50 (2005) 1883",
    parameters=(
        EffectParameter(
            "angle", "m", 0.0, 0.0, 1.0, "motion of the output over which the friction reverses", 1e-3, 0.05
        ),
    ),
    validity="the closed form only; the chain has this mechanism itself (its slip fronts), whatever the number is",
    experiment="Make small reversals under a constant output torque, and measure the slope of output over drive angle",
    confusable=("presliding_hysteresis", "backlash", "cable_elongation"),
)
