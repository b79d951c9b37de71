"""The friction of a gear grows with the torque that it passes on, by which side drives."""

from cable_envs.core.kernels import exp, inline, maximum, select
from cable_envs.effects.base import Effect, EffectParameter

EFFECT = Effect(
    name="gear_friction",
    seam="load",
    equation="F = -driving |T| sign(v) where the load is driven (T v > 0), -backdriving |T| sign(v) where it drives; "
    "T: torque that the load takes, its inertia included; both times 1 + rise exp(-(v / velocity)^2)",
    source="losses of a gear in proportion to the torque passed on, other ones where it is driven from behind: "
    "Giberti, Cinquemani, Legnani, Mechatronics 20 (2010) 604; the fall with the speed: Stribeck 1902",
    parameters=(
        EffectParameter("driving", "1", 0.0, 0.0, 10.0, "loss over the load's torque, the motor drives", 0.3),
        EffectParameter("backdriving", "1", 0.0, 0.0, 0.99, "loss over the load's torque, the load drives", 0.3),
        EffectParameter(
            "rise", "1", 0.0, 0.0, 10.0, "how much more it is at standstill", 0.5, shape=True, probes=(1.0,)
        ),
        EffectParameter(
            "velocity", "m/s", 0.1, 1e-6, 1e3, "speed at which the rise has fallen to 1/e", 0.1, 1.0, shape=True,
            probes=(0.5, 2.0), null_turning=1.0,
        ),
    ),
    validity="one gear without a gap; a backdriving loss of 1 holds any load (self-locking)",
    experiment="Lift and lower three loads slowly. The drive's torque over the load's differs up and down",
    confusable=("coulomb_friction", "stribeck_friction", "load_dependent_friction", "supply_sag", "torque_saturation"),
)  # fmt: skip


@inline
def shares(driving, backdriving, rise, velocity, v):
    """(share of the load's torque that counts where it is driven, where it drives) at a speed: 1 and 1 without loss."""
    u = v / velocity
    more = 1.0 + rise * exp(-u * u)
    return 1.0 + driving * more, maximum(1.0 - backdriving * more, 0.0)


@inline
def geared(net, load, rotor, inertia, driven, drives):
    """(net force, mass) of an upward motion through a gear with losses.

    net: force on the motor's side, its dry friction subtracted; load: what the load takes at rest; rotor, inertia: of
    the motor's side and of the load; driven, drives: `shares`. Of J a = net - T' and T = load + m a is T' = driven T
    where T > 0, drives T where T < 0. T > 0 is net m + load J > 0. For downward motion net, load and the force found
    have the other sign.
    """
    part = select(net * inertia + load * rotor > 0.0, driven, drives)
    return net - part * load, rotor + part * inertia
