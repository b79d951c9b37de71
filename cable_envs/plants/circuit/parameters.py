"""Declared parameters of the closed cable-pulley circuit, shared by its two plants, its closed forms and its rigs.

The circuit (Fig. 5, Zou 2022): a driving pulley P0 and a driven pulley P5 joined by two cables, t ("top") and b
("bottom"), each over four idlers of its own. Span i of a side lies between pulleys i and i + 1, so span 0 leaves the
driving pulley and span 4 arrives at the driven pulley. The cable is fixed to P0 and P5 and does not slip there.
"""

import math

from cable_envs.core.params import Parameter, ParameterTable

SIDES = ("top", "bottom")
"""Cable t and cable b; counter-clockwise drive pulls cable t."""

IDLERS = 4
"""Idlers of a side."""

_TABLE2 = "Table 2, Zou 2022"
_WRAPS = {"top": (0.279, 1.571, 3.141, 3.217), "bottom": (0.279, 1.571, 3.141, 3.390)}
_RADII = {"top": (4e-3, 8e-3, 5e-3, 8e-3), "bottom": (4e-3, 5e-3, 8e-3, 5e-3)}
_SPANS = {"top": (38.5e-3, 185e-3, 85e-3, 85e-3, 39.9e-3), "bottom": (38.5e-3, 185e-3, 85e-3, 85e-3, 38.7e-3)}


def _geometry():
    for side in SIDES:
        for i, value in enumerate(_WRAPS[side], 1):
            yield Parameter(
                f"wrap_{side}_{i}", "rad", value, 0.0, 2 * math.pi, f"wrap angle on idler {i}, cable {side[0]}", _TABLE2
            )
        for i, value in enumerate(_RADII[side], 1):
            yield Parameter(
                f"radius_{side}_{i}", "m", value, 1e-4, 1.0, f"bending radius on idler {i}, cable {side[0]}", _TABLE2
            )
        for i, value in enumerate(_SPANS[side]):
            yield Parameter(
                f"span_{side}_{i}",
                "m",
                value,
                1e-4,
                100.0,
                f"free length between pulleys {i} and {i + 1}, cable {side[0]}",
                _TABLE2,
            )


CIRCUIT = ParameterTable(
    *_geometry(),
    Parameter("drive_radius", "m", 7e-3, 1e-4, 1.0, "bending radius R0 on the driving pulley", _TABLE2),
    Parameter("output_radius", "m", 5e-3, 1e-4, 1.0, "bending radius R5 on the driven pulley", _TABLE2),
    Parameter(
        "cable_radius",
        "m",
        0.56e-3,
        1e-6,
        0.05,
        "cable radius r",
        _TABLE2 + "; Table 3 needs it as a radius, although Table 1 gives the diameter 0.54 mm",
    ),
    Parameter("cable_friction", "1", 0.54, 0.0, 2.0, "friction coefficient mu_c, cable on pulley", _TABLE2),
    Parameter("shaft_friction", "1", 0.157, 0.0, 2.0, "friction coefficient mu_s, idler on its shaft", _TABLE2),
    Parameter("shaft_radius", "m", 2.5e-3, 0.0, 1.0, "radius r_s of the idlers' shafts", _TABLE2),
    Parameter(
        "idlers_fixed",
        "1",
        0.0,
        0.0,
        1.0,
        "1: idlers cannot turn, the cable slips over the whole wrap",
        "section 2.1, support type (a); Table 3 has both",
    ),
    Parameter(
        "tensile_stiffness",
        "N",
        1.684e4,
        1.0,
        1e8,
        "EA of the cable",
        _TABLE2 + " (1684 N.m in section 3.2 is a misprint)",
    ),
    Parameter(
        "pretension_top",
        "N",
        50.0,
        0.0,
        1e5,
        "tension of cable t before any torque",
        "Table 4, Zou 2022: 12.5, 50 and 150 N",
    ),
    Parameter(
        "pretension_bottom",
        "N",
        50.0,
        0.0,
        1e5,
        "tension of cable b before any torque",
        "Table 4, Zou 2022: 12.5, 50 and 150 N",
    ),
    Parameter(
        "cable_damping",
        "N s",
        8.0,
        0.0,
        1e6,
        "force per strain rate of the cables",
        "chosen: loss factor 5 % at 100 rad/s, a stranded steel rope",
    ),
    Parameter(
        "drive_inertia",
        "kg m^2",
        2.6e-4,
        1e-9,
        10.0,
        "inertia at the driving pulley: rotor times ratio squared",
        "maxon DCX 16S rotor, about 1.3 g cm^2, behind the 44:1 gear of Table 1",
    ),
    Parameter(
        "drive_damping",
        "N m s",
        5e-3,
        0.0,
        100.0,
        "viscous friction of motor and gear at the driving pulley",
        "chosen: 5 to 15 % of the rated torque at speed, usual for a planetary gear",
    ),
    Parameter(
        "drive_torque_limit",
        "N m",
        0.6,
        1e-6,
        1e3,
        "largest motor torque at the driving pulley, both ways",
        "DCX 16S with its gear: about 0.2 N m continuous, three times that for short",
    ),
    Parameter(
        "drive_speed_limit",
        "rad/s",
        15.0,
        1e-6,
        1e4,
        "largest speed of the driving pulley",
        "about 6500 rpm at the motor behind 44:1",
    ),
    Parameter(
        "drive_acceleration_limit",
        "rad/s^2",
        1000.0,
        1e-6,
        1e7,
        "largest acceleration of the position servo",
        "below torque limit over drive inertia",
    ),
    Parameter(
        "drive_angle_limit",
        "rad",
        3.0,
        1e-3,
        1e3,
        "range of the drive angle that a command may ask for",
        "the paper's drive moves by 1.74 rad",
    ),
    Parameter(
        "servo_frequency",
        "rad/s",
        60.0,
        1.0,
        400.0,
        "natural frequency of the drive's position servo",
        "chosen: 10 Hz, a usual setting of a geared servo",
    ),
    Parameter("servo_damping_ratio", "1", 0.9, 0.1, 3.0, "damping ratio of the drive's position servo", "chosen"),
    Parameter(
        "output_inertia",
        "kg m^2",
        2e-5,
        1e-9,
        10.0,
        "inertia at the driven pulley",
        "chosen: a jaw of about 15 mm and the camera's markers",
    ),
    Parameter("output_damping", "N m s", 2e-4, 0.0, 100.0, "viscous friction at the driven pulley", "chosen, small"),
    Parameter("contact_angle", "rad", 0.0, -1e3, 1e3, "output angle beyond which a grasped object is touched", ""),
    Parameter("contact_stiffness", "N m/rad", 0.0, 0.0, 1e4, "stiffness of a grasped object, 0: no object", "null"),
    Parameter("contact_damping", "N m s", 0.0, 0.0, 100.0, "damping of a grasped object while touched", "null"),
    Parameter("payload_mass", "kg", 0.0, 0.0, 1e3, "point mass carried by the driven pulley", "null"),
    Parameter(
        "payload_arm",
        "m",
        15e-3,
        0.0,
        10.0,
        "distance of the payload from the driven pulley's axis",
        "length of the grasper, section 3.2, Zou 2022",
    ),
    Parameter("gravity", "m/s^2", 9.81, 0.0, 30.0, "acceleration acting on the payload"),
    Parameter(
        "brake_torque", "N m", 0.0, 0.0, 1e3, "Coulomb friction at the driven pulley, M_fric of Eq. (48)", "null"
    ),
    Parameter(
        "hold_rule",
        "1",
        0.0,
        0.0,
        1.0,
        "analytic plant: 0 the output holds while friction balances it, 1 also while Eq. (47)'s flag is set",
    ),
    Parameter(
        "tension_limit",
        "N",
        200.0,
        1e-3,
        1e6,
        "tension at which a run counts as unsafe",
        "range of the paper's dynamometer (Table 1)",
    ),
    Parameter(
        "breaking_tension",
        "N",
        223.0,
        1e-3,
        1e6,
        "tension at which the cable tears",
        "computed: 1770 MPa rope wire, metallic area 0.126 mm^2 of a 0.54 mm 7x7 rope",
    ),
)
"""Every number a circuit rig may hold; defaults are Table 2 of Zou 2022 with 50 N on both sides, output free."""
