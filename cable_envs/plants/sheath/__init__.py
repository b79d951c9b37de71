"""A tendon in a bent sheath (Bowden cable): friction by the capstan law, compliance, a load on a return spring."""

from cable_envs.plants.family import Family, Output, Replayed


def _build(variant: str, holes: int):
    from cable_envs.plants.sheath.plant import PLANT

    return PLANT


def _with_contacts(contacts: int):
    from cable_envs.plants.sheath.contacts import sheath_with_contacts

    return sheath_with_contacts(contacts)


def _as_v0(plant):
    from cable_envs.plants.sheath.v0 import as_v0

    return as_v0(plant)


def _with_motor(plant):
    from cable_envs.plants.sheath.motor import with_motor

    return with_motor(plant)


FAMILY = Family(
    name="tendon_sheath",
    title="Tendon in a sheath",
    build=_build,
    as_v0=_as_v0,
    with_contacts=_with_contacts,
    with_motor=_with_motor,
    tasks="TendonSheath",
    outputs={
        "position": Output("position_reference"),
        "tension": Output(
            "tension_reference",
            start=lambda value, wanted: (wanted - value["load_preload"]) / value["load_stiffness"],
            needs=("load_stiffness",),
        ),
    },
    observe="output",
    view="cable_envs.plants.sheath.view:SheathView",
    continuous="cable_envs.plants.sheath.continuous:equations",
    scene="cable_envs.plants.sheath.scene:SheathScene",
    shown=("drive_position", "drive_tension", "load_position", "load_tension", "sliding"),
    channels={
        "time": "s", "drive_position": "m", "drive_velocity": "m/s", "drive_tension": "N", "load_position": "m",
        "load_velocity": "m/s", "load_tension": "N", "drive_position_command": "m", "drive_tension_command": "N",
        "position_reference": "m", "tension_reference": "N",
    },
    commands={"position": "drive_position_command", "tension": "drive_tension_command"},
    known=("bend_angle", "load_mass", "drive_mass", "drive_speed_limit", "drive_acceleration_limit"),
    nominal=(
        "friction_coefficient", "tendon_stiffness", "sheath_stiffness", "tendon_damping", "load_stiffness",
        "load_preload", "load_damping", "load_friction", "drive_damping", "servo_frequency", "servo_damping_ratio",
    ),
    replayed=Replayed(
        drive="drive_position",
        of_drive=("drive_position", "drive_velocity"),
        predicted=(
            "drive_position", "drive_velocity", "drive_tension", "load_position", "load_velocity", "load_tension",
        ),
        refitted=(
            "friction_coefficient", "tendon_stiffness", "tendon_damping", "load_stiffness", "load_preload",
            "load_damping", "load_mass",
        ),
        servo=("servo_frequency", "servo_damping_ratio"),
        by_servo=("drive_position_command",),
        stiff={"tendon_stiffness": 1e5},
        places=("load_position", "drive_position"),
        pulls=("drive_tension", "load_tension"),
        far=("load_position", "load_tension"),
        contacts=40,
    ),
    ways=("pulling in", "paying out"),
)  # fmt: skip
