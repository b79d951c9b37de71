"""A joint that two tendons pull in opposite directions, each by its own drive: angle, torque and stiffness."""

from cable_envs.plants.family import Family, Output


def _build(variant: str, holes: int):
    from cable_envs.plants.antagonist.plant import PLANT

    return PLANT


def _held(value, wanted):
    from cable_envs.plants.antagonist.parameters import angle_of_torque

    return angle_of_torque(value, wanted)


def _with_motor(plant):
    from cable_envs.plants.antagonist.motor import with_motor

    return with_motor(plant)


FAMILY = Family(
    name="antagonistic_joint",
    title="Joint with two tendons",
    build=_build,
    with_motor=_with_motor,
    tasks="AntagonistJoint",
    outputs={
        "position": Output("angle_reference"),
        "torque": Output("torque_reference", start=_held, needs=("spring_stiffness",)),
    },
    observe="output",
    view="cable_envs.plants.antagonist.view:JointView",
    continuous="cable_envs.plants.antagonist.continuous:equations",
    scene="cable_envs.plants.antagonist.scene:JointScene",
    shown=(
        "joint_angle", "drive_angle", "drive_a_position", "drive_b_position", "tension_drive_a", "tension_joint_a",
        "tension_drive_b", "tension_joint_b", "joint_stiffness",
    ),
    ways=("pulling with tendon a", "pulling with tendon b"),
)  # fmt: skip
