"""The closed cable-pulley circuit of Zou et al. 2022: in closed form, and as a chain of spans and contacts."""

from cable_envs.plants.family import Family, Output


def _build(variant: str, holes: int):
    if variant == "chain":
        from cable_envs.plants.circuit import chain

        return chain.PLANT
    from cable_envs.plants.circuit import closed_form

    return closed_form.PLANT


def _as_v0(plant):
    from cable_envs.plants.circuit.v0 import as_v0

    return as_v0(plant)


def _with_motor(plant):
    from cable_envs.plants.servo import with_motor

    return with_motor(plant)


FAMILY = Family(
    name="pulley_circuit",
    title="Closed pulley circuit",
    build=_build,
    as_v0=_as_v0,
    with_motor=_with_motor,
    variants=("analytic", "chain"),
    tasks="PulleyCircuit",
    outputs={
        "position": Output("angle_reference", rigid=lambda value: value["output_radius"] / value["drive_radius"]),
        "torque": Output(
            "torque_reference",
            start=lambda value, wanted: value["contact_angle"] + wanted / value["contact_stiffness"],
            rigid=lambda value: 1.0 / (value["output_radius"] / value["drive_radius"]),
            needs=("contact_stiffness",),
        ),
    },
    observe="drive",
    continuous="cable_envs.plants.circuit.continuous:equations",
    scene="cable_envs.plants.circuit.scene:CircuitScene",
    shown=(
        "drive_angle", "drive_torque", "output_angle", "output_torque", "tension_drive_top", "tension_drive_bottom",
        "tension_output_top", "tension_output_bottom",
    ),
    channels={
        "time": "s", "drive_angle": "rad", "drive_torque": "N m", "drive_current": "A", "output_angle": "rad",
        "output_torque": "N m", "tension_top": "N", "tension_bottom": "N", "drive_angle_command": "rad",
        "drive_torque_command": "N m", "angle_reference": "rad", "torque_reference": "N m",
    },
    # of a recording's tensions the plant has those at the driving pulley
    signals={"tension_top": "tension_drive_top", "tension_bottom": "tension_drive_bottom"},
    commands={"position": "drive_angle_command", "torque": "drive_torque_command"},
    known=("drive_radius", "output_radius", "cable_radius", "shaft_radius", "payload_mass", "payload_arm", "gravity"),
    nominal=(
        "cable_friction", "shaft_friction", "tensile_stiffness", "cable_damping", "pretension_top",
        "pretension_bottom", "drive_inertia", "drive_damping", "output_inertia", "output_damping",
        "contact_stiffness", "contact_damping", "brake_torque",
    ),
    needs=(
        ("drive_angle_command", "drive_angle"),
        ("drive_torque", "output_angle", "output_torque", "tension_top", "tension_bottom"),
    ),
    ways=("turning counter-clockwise", "turning clockwise"),
)  # fmt: skip
