"""A joint that a motor turns through a gear against a pendulum, under the controller of its servo."""

from cable_envs.plants.family import Family, Output


def _build(variant: str, holes: int):
    from cable_envs.plants.rotary_joint.plant import PLANT

    return PLANT


FAMILY = Family(
    name="rotary_joint",
    title="Rotary joint",
    build=_build,
    tasks="RotaryJoint",
    outputs={"position": Output("position_reference")},
    view="cable_envs.plants.rotary_joint.view:RotaryJointView",
    continuous="cable_envs.plants.rotary_joint.continuous:equations",
    scene="cable_envs.plants.rotary_joint.scene:RotaryJointScene",
    shown=("position", "velocity", "duty", "current", "torque", "load_torque", "sliding"),
    channels={
        "time": "s",
        "position": "rad",
        "velocity": "rad/s",
        "torque": "N m",
        "current": "A",
        "voltage": "V",
        "position_reference": "rad",
        "duty": "1",
        "release_reference": "1",
    },
    commands={"position": "position_reference", "duty": "duty"},
    limits={"torque": "torque_limit", "current": "current_limit", "position": "position_limit"},
    known=("load_mass", "arm_length", "position_gain", "rate_gain", "duty_limit"),
    nominal=("inertia", "coulomb", "viscous", "torque_constant", "resistance", "supply_voltage", "hanging_angle"),
    needs=(("position",), ("torque", "current", "voltage", "position_reference")),
    ways=("turning forward", "turning backward"),
)
