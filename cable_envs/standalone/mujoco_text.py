"""A drive of one axis as a MuJoCo model: its law in the joint, the belt as a tendon, the motor as an actuator.

    inertia     mass of a body; a rigid motor is the joint's armature
    friction    damping (viscous), frictionloss (Coulomb, which MuJoCo approximates by a stiff constraint)
    spring      stiffness and springref of the joint (position_dependent_load)
    belt        a fixed tendon of the length x_m - x with stiffness and damping
    weight      gravity along the axis; the motor's body is compensated for it
    motor       general actuators: gain for a force or a voltage; gain and bias for the servo, within the joint's limit
    lag         the filter of the actuator (actuator_lag)

Source: MuJoCo documentation, XML reference (3.x).
"""

from collections.abc import Mapping
from typing import Any
from xml.sax.saxutils import quoteattr

from cable_envs.core.errors import ConfigurationError
from cable_envs.standalone.law import Law

PLANTS = ("linear_drive", "coupled_drives")
"""Plants whose law MuJoCo's own elements express."""

EFFECTS = ("coulomb_friction", "viscous_friction", "cable_elongation", "position_dependent_load", "actuator_lag")
"""Effects that they express too."""

HARD = 0.9999
"""Impedance of the constraint that stands for dry friction: near 1 it creeps little at rest."""


def mjcf(law: Law) -> str:
    """A rig as an MJCF model.

    Parameters
    ----------
    law : Law
        The rig, with a drive that is told a force, a voltage or a position.

    Returns
    -------
    str
        XML. Its keyframe "start" is the rig at rest.

    Raises
    ------
    ConfigurationError
        Names the plant, the effects or the drive that MuJoCo has no element for.
    """
    _refuse(law)
    rig = law.values["rig"]
    belt = rig["belt_stiffness"] > 0.0
    bodies = _bodies(law, rig, belt)
    weight = rig.get("weight", 0.0)
    gravity = -weight / rig["mass"]
    return "\n".join([
        "<!-- Written by `cablebench export-rig`. All numbers are SI. -->",
        f"<mujoco model={quoteattr(law.rig.name)}>",
        f'  <option timestep="{law.period / law.substeps!r}" integrator="implicitfast" gravity="{gravity!r} 0 0"/>',
        "  <worldbody>", *bodies, "  </worldbody>",
        *(_tendon(rig) if belt else []),
        "  <actuator>", *_actuators(law, rig, "motor" if belt else "carriage"), "  </actuator>",
        "  <keyframe>", _key(law, belt), "  </keyframe>",
        "</mujoco>", "",
    ])  # fmt: skip


def _refuse(law: Law) -> None:
    plant = law.plant
    if plant.name not in PLANTS:
        raise ConfigurationError(f"MuJoCo has no elements for the law of {plant.name}; it has for {', '.join(PLANTS)}")
    named = plant.table.unpack(law.rig.column(plant)[:, 0])
    others = [name for name in plant.effects.present(named) if name not in EFFECTS]
    if others:
        known = ", ".join(EFFECTS)
        raise ConfigurationError(f"MuJoCo has no element for {', '.join(others)}; of the effects it has for {known}")
    if law.follows:
        raise ConfigurationError("a drive that follows a path has no actuator; export with --drive and an action mode")
    if law.values["effects"].get("position_dependent_load_stiffness", 0.0) < 0.0:
        raise ConfigurationError("MuJoCo has no joint with a negative stiffness, as position_dependent_load has here")


def _bodies(law: Law, rig: Mapping[str, Any], belt: bool) -> list[str]:
    """The driven body is the motor where there is a belt; dry friction is the carriage's, or that of coupled motors."""
    e = law.values["effects"]
    spring = e.get("position_dependent_load_stiffness", 0.0)
    held = f' stiffness="{spring!r}" springref="{e["position_dependent_load_neutral"]!r}"' if spring else ""
    step = 2.0 * law.period / law.substeps
    rubbing = (
        f' damping="{rig["viscous"]!r}" frictionloss="{rig["coulomb"]!r}" '
        f'solreffriction="{step!r} 1" solimpfriction="{HARD} {HARD} 0.001"{held}'
    )
    if law.plant.name == "coupled_drives":
        return [*_body("motor", rig["mass"], rubbing, ""), *_body("pulley", rig["pulley_mass"], "", "")]
    limit = f' actuatorfrcrange="{-rig["force_limit"]!r} {rig["force_limit"]!r}"'
    if not belt:
        return _body("carriage", rig["mass"], f' armature="{rig["motor_mass"]!r}"{rubbing}{limit}', "")
    return [*_body("carriage", rig["mass"], rubbing, ""), *_body("motor", rig["motor_mass"], limit, ' gravcomp="1"')]


def _body(name: str, mass: float, joint: str, body: str) -> list[str]:
    size = 0.05
    return [
        f'    <body name="{name}"{body}>',
        f'      <joint name="{name}" type="slide" axis="1 0 0"{joint}/>',
        f'      <geom type="box" size="{size} {size} {size}" mass="{mass!r}" contype="0" conaffinity="0"/>',
        "    </body>",
    ]


def _tendon(rig: Mapping[str, Any]) -> list[str]:
    other = "pulley" if "pulley_mass" in rig else "carriage"
    return [
        "  <tendon>",
        f'    <fixed name="belt" stiffness="{rig["belt_stiffness"]!r}" damping="{rig["belt_damping"]!r}" '
        'springlength="0">',
        '      <joint joint="motor" coef="1"/>', f'      <joint joint="{other}" coef="-1"/>', "    </fixed>",
        "  </tendon>",
    ]  # fmt: skip


def _actuators(law: Law, rig: Mapping[str, Any], joint: str) -> list[str]:
    late = law.values["effects"].get("actuator_lag_time", 0.0)
    lag = f' dyntype="filterexact" dynprm="{late!r}"' if late else ""
    if law.drive == "position":
        k, c = rig["servo_stiffness"], rig["servo_damping"]
        parts = (("command", k, f"0 {-k!r} 0"), ("command_rate", c, f"0 0 {-c!r}"))
        return [
            f'    <general name="{name}" joint="{joint}" gainprm="{gain!r}" biastype="affine" biasprm="{bias}"{lag}/>'
            for name, gain, bias in parts
        ]
    gain = rig["force_per_volt"] if law.drive == "voltage" else 1.0
    limit = ""
    if law.plant.name == "linear_drive":
        limit = f' forcelimited="true" forcerange="{-rig["force_limit"]!r} {rig["force_limit"]!r}"'
    return [f'    <general name="command" joint="{joint}" gainprm="{gain!r}"{lag}{limit}/>']


def _key(law: Law, belt: bool) -> str:
    x = law.values["signals"]
    if law.plant.name == "coupled_drives":
        places = [x["motor_position"], x["pulley_position"]]
    else:
        places = [x["position"], x["motor_position"]] if belt else [x["position"]]
    rest = next(m.rest_signal for m in law.plant.action_modes if m.name == law.drive)
    told = [float(x[rest]) if rest else 0.0, *([0.0] if law.drive == "position" else [])]
    act = f' act="{" ".join(map(repr, told))}"' if law.values["effects"].get("actuator_lag_time", 0.0) else ""
    return f'    <key name="start" qpos="{" ".join(map(repr, places))}" ctrl="{" ".join(map(repr, told))}"{act}/>'
