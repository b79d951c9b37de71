"""Declared parameters and signals of the cable-hole plant, and the rows they have in its kernel."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from cable_envs.core.errors import ConfigurationError
from cable_envs.core.lanes import Lanes
from cable_envs.core.params import Parameter, ParameterTable
from cable_envs.effects import Acting
from cable_envs.physics.modes import longest_step
from cable_envs.plants.base import OUT_OF_RANGE, Range, Signal

MAX_HOLES = 50

_TABLE_1 = "Table 2 / A1, Gu 2024"
_TABLE_3 = "Table 3, Gu 2024"

PARAMETERS = ParameterTable(
    Parameter("load_mass", "kg", 5.0, 1e-3, 1e4, "mass of the load", "inferred from the tension ranges of 5.3"),
    Parameter("gravity", "m/s^2", 9.81, 0.0, 30.0, "gravitational acceleration"),
    Parameter("load_gravity", "1", 1.0, 0.0, 1.0, "share of gravity along the cable: 1 hanging, 0 horizontal"),
    Parameter("load_stiffness", "N/m", 0.0, 0.0, 1e7, "spring between load and ground, relaxed at y = 0"),
    Parameter("load_damping", "N s/m", 0.0, 0.0, 1e5, "viscous damping of the load"),
    Parameter("cable_stiffness", "N/m", 60e3, 1.0, 1e9, "EA / L of the span between drive and hole"),
    Parameter("cable_damping", "N s/m", 100.0, 0.0, 1e6, "viscous damping of that span"),
    Parameter("wrap_angle", "rad", math.pi / 3, 0.0, 4 * math.pi, "wrap of the cable in the hole", "5.3, Gu 2024"),
    Parameter("radius_ratio", "1", 1.5, 1e-3, 1e6, "rho0 = hole radius / cable radius", "inferred, docs/physics.md"),
    Parameter("cable_radius", "m", 1e-3, 1e-6, 0.1, "cable radius r"),
    Parameter("bending_rigidity", "N m^2", 0.0, 0.0, 10.0, "flexural rigidity B of the cable, G1"),
    Parameter("friction_coefficient", "1", 0.43, 0.0, 5.0, "Coulomb coefficient mu", _TABLE_1),
    Parameter("extrusion_delta", "1", 0.02, -0.5, 1.0, "change of the radius ratio by extrusion, delta", _TABLE_1),
    Parameter("extrusion_gain", "SI", 6574.0, 0.0, 1e7, "K in C = K v^omega", _TABLE_1),
    Parameter("extrusion_exponent", "1", 2.03, 0.2, 10.0, "omega in C = K v^omega", _TABLE_1),
    Parameter("drive_speed_limit", "m/s", 0.1, 1e-6, 10.0, "largest drive speed"),
    Parameter("drive_acceleration_limit", "m/s^2", 2.0, 1e-6, 1e3, "largest drive acceleration"),
    Parameter("inner_kp", "m/(s N)", 0.1, 0.0, 100.0, "proportional gain of the inner tension loop", _TABLE_3),
    Parameter("inner_kd", "m/N", 0.005, 0.0, 100.0, "derivative gain of the inner tension loop", _TABLE_3),
    Parameter("tension_command_limit", "N", 120.0, 1e-3, 1e5, "largest driving tension that can be commanded"),
    Parameter("tension_limit", "N", 100.0, 1e-3, 1e6, "safety limit", "range of the tension sensor, 5.1, Gu 2024"),
    Parameter("breaking_tension", "N", 1000.0, 1e-3, 1e7, "the cable tears above this tension"),
)

RANGES = (
    Range(
        "load_velocity", -0.0108, 0.0108, "extrusion_gain",
        "C = K v^omega: the fastest motion of section 5.3, Gu 2024, which its tensions need (docs/physics.md)",
    ),
)  # fmt: skip
"""Where the laws of the hole were identified. Those without speed in them, mu and the ratio of G9, have none."""

_GONE = {
    "guide_mass": "the cable between holes has no mass since all holes of a step are solved together; leave it out"
}

EXTRA_HOLE = ("wrap_angle", "radius_ratio", "friction_coefficient")


def series_parameters(holes: int) -> ParameterTable:
    """Parameters of the plant with ``holes`` holes."""
    extra = [
        Parameter(f"{q.name}_{h}", q.unit, q.default, q.low, q.high, f"{q.meaning}; hole {h} from the drive", q.source)
        for h in range(2, holes + 1)
        for q in (PARAMETERS[name] for name in EXTRA_HOLE)
    ]
    if holes > 1:
        extra.append(Parameter("span_stiffness", "N/m", 120e3, 1.0, 1e9, "EA / L of a span between two holes"))
    return ParameterTable(*PARAMETERS, *extra, gone=_GONE if holes > 1 else None)


SIGNALS = (
    Signal("drive_position", "m", "position of the drive, positive hauls in"),
    Signal("drive_velocity", "m/s", "speed of the drive"),
    Signal("drive_tension", "N", "cable tension on the drive side, T1"),
    Signal("load_position", "m", "position of the load, positive lifted"),
    Signal("load_velocity", "m/s", "speed of the load"),
    Signal("load_tension", "N", "cable tension on the load side, T2"),
    Signal("sliding", "1", "direction in which the cable slides at the load: -1, 0 (stuck), 1"),
    Signal("slack_fraction", "1", "share of the last control step in which the drive span was slack"),
    Signal("peak_tension", "N", "largest drive-side tension within the last control step"),
    OUT_OF_RANGE,
)


def series_signals(holes: int) -> tuple[Signal, ...]:
    """Signals of the plant with ``holes`` holes: `SIGNALS`, then those of the inner holes."""
    inner = tuple(
        Signal(f"{name}_{h}", unit, f"{meaning} hole {h}")
        for h in range(1, holes)
        for name, unit, meaning in (
            ("slip_position", "m", "cable paid through"),
            ("slip_velocity", "m/s", "sliding speed in"),
            ("span_tension", "N", "tension behind"),
        )
    )
    return SIGNALS + inner


def signal_rows(holes: int) -> Lanes:
    """Rows of the signals of the plant with ``holes`` holes."""
    return Lanes(
        "Signals", [*(s.name for s in SIGNALS), (("slip_position", "slip_velocity", "span_tension"), holes - 1)]
    )


def coefficient_rows(holes: int) -> Lanes:
    """Rows of what the kernel computes with. radius_ratio is rho0 (1 + delta), edge_radius is rho0 r in m."""
    return Lanes("Coefficients", [
        "speed_limit", "acceleration_limit", "inner_kp", "inner_kd", "cable_stiffness", "cable_damping",
        "load_mass", "load_weight", "load_stiffness", "load_damping", "extrusion_gain", "extrusion_exponent",
        "bending_rigidity", "span_stiffness",
        (("wrap_angle", "radius_ratio", "friction_coefficient", "edge_radius"), holes),
    ])  # fmt: skip


def derive(value: Mapping[str, np.ndarray], e: Any) -> dict[str, Any]:
    """Rows of `coefficient_rows` from the parameters of the plant.

    Raises ConfigurationError for what the bounds of single parameters cannot exclude.
    """
    holes = 1 + sum(name.startswith("wrap_angle_") for name in value)
    weight = value["load_mass"] * value["gravity"] * value["load_gravity"]
    if np.any((weight == 0.0) & (value["load_stiffness"] == 0.0)):
        raise ConfigurationError("the load is free: give it load_gravity > 0 or load_stiffness > 0")
    if np.any(value["breaking_tension"] < value["tension_limit"]):
        raise ConfigurationError("breaking_tension must not be below tension_limit")
    wrap, rho, mu = (
        np.array([value[name if h == 0 else f"{name}_{h + 1}"] for h in range(holes)]) for name in EXTRA_HOLE
    )
    same = (
        "inner_kp", "inner_kd", "cable_stiffness", "cable_damping", "load_mass", "load_stiffness", "load_damping",
        "extrusion_gain", "extrusion_exponent", "bending_rigidity",
    )  # fmt: skip
    return {
        **{name: value[name] for name in same},
        "speed_limit": value["drive_speed_limit"], "acceleration_limit": value["drive_acceleration_limit"],
        "load_weight": weight, "span_stiffness": value.get("span_stiffness", 0.0),
        "wrap_angle": wrap, "friction_coefficient": mu,
        "radius_ratio": rho * (1.0 + value["extrusion_delta"]), "edge_radius": rho * value["cable_radius"],
    }  # fmt: skip


def resolves(p: Any, e: Any) -> np.ndarray:
    """Longest steps, s: of the load on the cable, going down against the Coulomb friction of every hole.

    The tension ratio is e^(a phi) with the a of `contact.tension_ratio`, which is never below it.
    """
    mu, rho = p.friction_coefficient + np.maximum(e.stribeck_friction_contact, 0.0), p.radius_ratio
    q = 1.0 + rho
    ratio = np.exp((2.0 * mu * rho / (q + np.sqrt(q * q + 4.0 * mu * mu * rho)) * p.wrap_angle).sum(axis=0))
    harder = np.sqrt(1.0 + 2.0 * e.stiffness_hardening_coefficient * ratio * p.load_weight)
    stiffness = ratio * p.cable_stiffness * harder + p.load_stiffness
    return longest_step(p.load_mass, ratio * p.cable_damping + p.load_damping, stiffness)


ACTING = Acting(
    effects={
        "coulomb_friction": ("level", "contact"), "viscous_friction": ("coefficient",),
        "stribeck_friction": ("excess", "contact", "velocity"), "asymmetric_friction": ("difference", "contact"),
        "presliding_hysteresis": ("displacement",), "lugre_friction": ("displacement", "damping"),
        "elastoplastic_friction": ("displacement", "damping", "breakaway"),
        "load_dependent_friction": ("coefficient", "exponent"),
        "lateral_extrusion": ("gain", "delta", "exponent"), "bending_stiffness": ("rigidity",),
        "cable_elongation": ("stiffness",), "stiffness_hardening": ("coefficient",),
        "viscoelastic_creep": ("share", "time"), "slow_creep": ("share", "time"),
        "friction_drift": ("change", "time", "travel"),
        "backlash": ("gap",), "slack": ("length",), "position_ripple": ("amplitude", "period", "phase"),
        "position_dependent_load": ("stiffness",), "actuator_lag": ("time",),
    },
    sensors={
        "drive_position": "m", "drive_velocity": "m/s", "drive_tension": "N", "load_position": "m",
        "load_velocity": "m/s", "load_tension": "N",
    },
    aliases={
        "coulomb_friction.contact": "friction_coefficient", "viscous_friction.coefficient": "load_damping",
        "lateral_extrusion.gain": "extrusion_gain", "lateral_extrusion.delta": "extrusion_delta",
        "lateral_extrusion.exponent": "extrusion_exponent", "bending_stiffness.rigidity": "bending_rigidity",
        "cable_elongation.stiffness": "cable_stiffness", "position_dependent_load.stiffness": "load_stiffness",
    },
    seams=("actuate", "cable", "contact", "load"),
)  # fmt: skip
