"""The supply of a drive gives less voltage the more current the drive takes."""

from cable_envs.effects.base import Effect, EffectParameter

EFFECT = Effect(
    name="supply_sag",
    seam="actuate",
    equation="rotary_joint: duty V - k_t v = i (R + resistance |duty|): the supply is in the circuit for the share "
    "|duty| of each period of the bridge",
    source="averaged model of a bridge: Erickson and Maksimovic, Fundamentals of Power Electronics, Springer 2001, "
    "ch. 3, with a resistance in the supply's path and none in the path in which the current runs on",
    parameters=(
        EffectParameter(
            "resistance", "ohm", 0.0, 0.0, 100.0, "resistance of supply, leads and the bridge's switch", 1.0
        ),
    ),
    validity="current that does not stop within a period of the bridge; a supply without a capacitor that would carry "
    "it over one",
    experiment="Hold loads at rest with small and with large duty. Torque over duty falls",
    confusable=("winding_heating", "gear_friction", "torque_saturation"),
)
