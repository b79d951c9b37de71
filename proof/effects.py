"""What can be missing from a simulator, system by system, and what no library knows. Sizes are set by `refit`.

Names and, where both sides mean the same number, parameters are those of `docs/effects`; ``compare`` lists only these.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

SYSTEMS = ("linear_drive", "cable_hole", "pulley_circuit")


@dataclass(frozen=True)
class Missing:
    """One effect on one system.

    sized    | simulator's parameter (or "kind:channel" of a sensor) -> value at size 1; the size multiplies all of them
    shaped   | parameter -> (low, high) of what only shapes the effect; drawn evenly in the logarithm where low > 0
    compare  | parameter of the verdict -> (simulator's parameter, factor, unit), or with what the rig has of it anyway
    known    | what the recording claims as measured, because the simulator leaves it out
    signed   | whether the size may be negative
    """

    name: str
    sized: Mapping[str, float]
    shaped: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    compare: Mapping[str, tuple] = field(default_factory=dict)
    known: Mapping[str, float] = field(default_factory=dict)
    signed: bool = False
    largest: float = 30.0

    def draw(self, rng: np.random.Generator) -> tuple[dict[str, float], float]:
        """(shape parameters, sign of the size)."""
        shape = {}
        for name, (low, high) in self.shaped.items():
            shape[name] = float(np.exp(rng.uniform(*np.log([low, high]))) if low > 0 else rng.uniform(low, high))
        return shape, float(rng.choice([-1.0, 1.0])) if self.signed else 1.0

    def comparable(self, drawn: Mapping[str, float]) -> Mapping[str, tuple]:
        """What of ``compare`` means the same in the law that was drawn; here there is one law."""
        return self.compare


def _sensor(kind: str, channel: str, size: float, unit: str, signed: bool = True) -> Missing:
    key = f"{kind}:{channel}"
    largest = 2.0 / size if kind == "rectification" else 30.0  # 1: half the wave is lost; 2: it is turned up
    return Missing(f"sensor_{kind}", {key: size}, compare={channel: (key, 1.0, unit)}, signed=signed, largest=largest)


_PHASE = (0.0, 2 * np.pi)
_LAG = Missing("actuator_lag", {"actuator_lag.time": 0.01}, compare={"time": ("actuator_lag.time", 1.0, "s")})
_DRIFT = Missing(
    "friction_drift",
    {"friction_drift.change": 0.2},
    {"friction_drift.time": (6.0, 20.0)},
    {"change": ("friction_drift.change", 1.0, "1"), "time": ("friction_drift.time", 1.0, "s")},
    signed=True,
    largest=4.0,
)
_GAP = "backlash.gap"

LIBRARY: Mapping[str, tuple[Missing, ...]] = {
    "linear_drive": (
        Missing(
            "coulomb_friction",
            {"coulomb_friction.force": 2.0},
            compare={"level": ("coulomb_friction.force", 1.0, "N")},
            known={"coulomb": 0.0},
        ),
        Missing(
            "viscous_friction",
            {"viscous_friction.coefficient": 10.0},
            compare={"coefficient": ("viscous_friction.coefficient", 1.0, "N s/m")},
            known={"viscous": 0.0},
        ),
        Missing(
            "stribeck_friction",
            {"stribeck_friction.excess": 2.0},
            {"stribeck_friction.speed": (0.004, 0.03)},
            {"excess": ("stribeck_friction.excess", 1.0, "N"), "velocity": ("stribeck_friction.speed", 1.0, "m/s")},
        ),
        Missing(
            "asymmetric_friction",
            {"asymmetric_friction.difference": 0.5},
            compare={"difference": ("asymmetric_friction.difference", 2.0, "N")},
            signed=True,
            largest=4.0,
        ),
        Missing("presliding_hysteresis", {"presliding_hysteresis.distance": 1e-4}, largest=20.0),
        Missing(
            "cable_elongation",
            {"cable_elongation.compliance": 1e-6},
            known={"belt_stiffness": 0.0},
            largest=40.0,
        ),
        Missing("backlash", {_GAP: 5e-5}, compare={"gap": (_GAP, 1.0, "m")}),
        _DRIFT,
        Missing(
            "position_ripple",
            {"position_ripple.amplitude": 1.0},
            {"position_ripple.period": (0.01, 0.05), "position_ripple.phase": _PHASE},
            {
                "force": ("position_ripple.amplitude", 1.0, "N"),
                "period": ("position_ripple.period", 1.0, "m"),
            },
        ),
        Missing(
            "position_dependent_load",
            {"position_dependent_load.stiffness": 20.0},
            compare={"stiffness": ("position_dependent_load.stiffness", 1.0, "N/m")},
        ),
        _LAG,
        _sensor("delay", "position", 0.004, "s", False),
        _sensor("bias", "velocity", 2e-3, "m/s"),
        _sensor("scale", "velocity", 0.02, "1"),
        _sensor("rectification", "velocity", 0.05, "1", False),
    ),
    "cable_hole": (
        Missing(
            "coulomb_friction", {"coulomb_friction.force": 1.0}, compare={"level": ("coulomb_friction.force", 1.0, "N")}
        ),
        Missing(
            "viscous_friction",
            {"viscous_friction.coefficient": 40.0},
            compare={"coefficient": ("viscous_friction.coefficient", 1.0, "N s/m")},
            known={"load_damping": 0.0},
        ),
        Missing("stribeck_friction", {"stribeck_friction.excess": 0.2}, {"stribeck_friction.speed": (0.001, 0.006)}),
        Missing("asymmetric_friction", {"asymmetric_friction.difference": 0.05}, signed=True, largest=8.0),
        Missing("presliding_hysteresis", {"presliding_hysteresis.distance": 1e-4}),
        Missing(
            "load_dependent_friction",
            {"load_dependent_friction.exponent": 0.1},
            compare={"exponent": ("load_dependent_friction.exponent", 1.0, "1")},
            signed=True,
            largest=8.0,
        ),
        Missing(
            "lateral_extrusion",
            {"lateral_extrusion.gain": 500.0},
            compare={"gain": ("lateral_extrusion.gain", 1.0, "SI")},
            known={"extrusion_gain": 0.0},
        ),
        Missing(
            "bending_stiffness",
            {"bending_stiffness.rigidity": 2e-6},
            compare={"rigidity": ("bending_stiffness.rigidity", 1.0, "N m^2")},
            known={"bending_rigidity": 0.0},
        ),
        Missing("cable_elongation", {"cable_elongation.compliance": 2e-6}, known={"cable_stiffness": 2e5}),
        Missing("stiffness_hardening", {"stiffness_hardening.coefficient": 60.0}, largest=10.0),
        Missing(
            "viscoelastic_creep",
            {"viscoelastic_creep.share": 0.2},
            {"viscoelastic_creep.time": (1.0, 8.0)},
            {"share": ("viscoelastic_creep.share", 1.0, "1")},
        ),
        _DRIFT,
        Missing("backlash", {_GAP: 1e-4}, compare={"gap": (_GAP, 1.0, "m")}),
        Missing(
            "position_ripple",
            {"position_ripple.amplitude": 5e-5},
            {"position_ripple.period": (0.003, 0.01), "position_ripple.phase": _PHASE},
            {
                "amplitude": ("position_ripple.amplitude", 1.0, "m"),
                "period": ("position_ripple.period", 1.0, "m"),
            },
        ),
        Missing(
            "position_dependent_load",
            {"position_dependent_load.stiffness": 40.0},
            compare={"stiffness": ("position_dependent_load.stiffness", 1.0, "N/m")},
            known={"load_stiffness": 0.0},
        ),
        _LAG,
        _sensor("delay", "drive_tension", 0.01, "s", False),
        _sensor("bias", "drive_tension", 0.5, "N"),
        _sensor("scale", "drive_tension", 0.01, "1"),
        _sensor("rectification", "drive_velocity", 0.1, "1", False),
    ),
    "pulley_circuit": (
        Missing(
            "coulomb_friction",
            {"coulomb_friction.torque": 4e-3},
            compare={"level": ("coulomb_friction.torque", 1.0, "N m")},
            known={"brake_torque": 0.0},
        ),
        Missing(
            "viscous_friction",
            {"viscous_friction.coefficient": 4e-3},
            compare={"coefficient": ("viscous_friction.coefficient", 1.0, "N m s", 2e-4)},
            known={"output_damping": 2e-4},
        ),
        Missing(
            "stribeck_friction",
            {"stribeck_friction.excess": 4e-3},
            {"stribeck_friction.speed": (0.6, 2.0)},
            {"excess": ("stribeck_friction.excess", 1.0, "N m"), "velocity": ("stribeck_friction.speed", 1.0, "rad/s")},
        ),
        Missing("asymmetric_friction", {"asymmetric_friction.difference": 0.1}, signed=True, largest=8.0),
        Missing("presliding_hysteresis", {"presliding_hysteresis.distance": 5e-3}, largest=20.0),
        Missing(
            "load_dependent_friction",
            {"load_dependent_friction.coefficient": 5e-3},
            compare={"coefficient": ("load_dependent_friction.coefficient", 1.0, "1")},
            known={"brake_torque": 0.0},
        ),
        Missing(
            "cable_elongation", {"cable_elongation.compliance": 2e-5}, known={"tensile_stiffness": 5e4}, largest=5.0
        ),
        # T = P + E A e (1 + H e) reaches no zero where H > E A / (4 P), 42 at 90 N
        Missing("stiffness_hardening", {"stiffness_hardening.coefficient": 30.0}, largest=1.3),
        Missing(
            "viscoelastic_creep",
            {"viscoelastic_creep.share": 0.1},
            {"viscoelastic_creep.time": (1.0, 8.0)},
            {"share": ("viscoelastic_creep.share", 1.0, "1")},
            largest=10.0,
        ),
        _DRIFT,
        Missing("backlash", {_GAP: 5e-3}, compare={"gap": (_GAP, 1.0, "rad")}),
        Missing(
            "position_ripple",
            {"position_ripple.amplitude": 4e-3},
            {"position_ripple.number": (9.5, 20.0), "position_ripple.phase": _PHASE},  # one wave is no ripple
            {"amplitude": ("position_ripple.amplitude", 1.0, "rad")},
        ),
        Missing(
            "position_dependent_load",
            {"position_dependent_load.stiffness": 0.02},
            compare={"stiffness": ("position_dependent_load.stiffness", 1.0, "N m/rad")},
        ),
        _LAG,
        _sensor("delay", "output_angle", 0.01, "s", False),
        _sensor("bias", "output_torque", 3e-3, "N m"),
        _sensor("scale", "output_torque", 0.02, "1"),
        _sensor("rectification", "output_torque", 0.1, "1", False),
    ),
}
"""Effects of the canonical list where they can act. Left out: what the plants always have (slack, and partial slip on
the circuit), what is moved into a parameter that is refitted, and what the system has no part for."""

_RATCHET = {"ratchet.place": (-0.02, 0.02)}
STRANGE: Mapping[str, tuple[Missing, ...]] = {
    "linear_drive": (
        Missing("pendulum_sway", {"pendulum_sway.mass": 0.2}, {"pendulum_sway.length": (0.1, 0.8)}),
        Missing("gusty_drag", {"gusty_drag.coefficient": 5.0}, {"gusty_drag.wind": (0.3, 1.0)}),
        Missing("supply_sag", {"supply_sag.share": 0.03}, {"supply_sag.time": (0.3, 3.0)}, largest=10.0),
        Missing("floor_vibration", {"floor_vibration.amplitude": 1.0}, {"floor_vibration.frequency": (1.5, 8.0)}),
        Missing("ratchet", {"ratchet.force": 2.0}, _RATCHET),
        _sensor("thermal_scale", "position", 0.005, "1", False),
        _sensor("lost_counts", "position", 2e-4, "m", False),
    ),
    "cable_hole": (
        Missing("sheath_rubbing", {"sheath_rubbing.curvature": 100.0}),
        Missing("thermal_length", {"thermal_length.amplitude": 2e-4}, {"thermal_length.period": (13.0, 40.0)}),
        Missing("leaking_load", {"leaking_load.rate": 2e-3}, largest=20.0),
        Missing("floor_vibration", {"floor_vibration.amplitude": 1.0}, {"floor_vibration.frequency": (1.5, 8.0)}),
        Missing("strand_slips", {"strand_slips.step": 1e-4}, {"strand_slips.interval": (5.0, 9.0)}),
        Missing("ratchet", {"ratchet.force": 1.0}, {"ratchet.place": (0.013, 0.023)}),
        _sensor("lost_counts", "load_position", 1e-4, "m", False),
    ),
    "pulley_circuit": (
        Missing(
            "thermal_length", {"thermal_length.strain": 2e-4}, {"thermal_length.period": (13.0, 40.0)}, largest=8.0
        ),
        Missing("pendulum_sway", {"pendulum_sway.inertia": 2e-4}, {"pendulum_sway.frequency": (4.0, 20.0)}),
        Missing("floor_vibration", {"floor_vibration.amplitude": 0.01}, {"floor_vibration.frequency": (1.5, 8.0)}),
        Missing("ratchet", {"ratchet.torque": 0.01}, {"ratchet.place": (-0.4, 0.4)}),
        Missing("sheath_rubbing", {"sheath_rubbing.curvature": 0.1}),
        _sensor("thermal_scale", "output_angle", 0.005, "1", False),
        _sensor("lost_counts", "output_angle", 3e-3, "rad", False),
    ),
}
"""Physics that the tool's library does not hold: the right answer is "unknown"."""

AMBIENT: Mapping[str, tuple[str, ...]] = {"linear_drive": (), "cable_hole": (), "pulley_circuit": ("partial_slip",)}
"""True of every recording of the system, so neither right nor wrong to name: the circuit's slip fronts travel."""

CLASSES = (
    ("actuator_lag", "sensor_delay"),
    ("asymmetric_friction", "sensor_bias", "sensor_scale", "load_dependent_friction"),
    ("asymmetric_friction", "coulomb_friction", "load_dependent_friction"),
    ("coulomb_friction", "stribeck_friction"),
    ("coulomb_friction", "load_dependent_friction", "bending_stiffness"),
    ("viscoelastic_creep", "friction_drift"),
    ("viscous_friction", "lateral_extrusion"),
    ("backlash", "cable_elongation", "presliding_hysteresis"),
    ("cable_elongation", "stiffness_hardening", "viscoelastic_creep"),
    ("position_ripple", "position_dependent_load"),
)
"""Sets of names that one recording need not tell apart (diagnosis.md, recipe, step 10, and what they imply).

At a hole W exp(+-m a) becomes W exp(+-m a + d a) by an asymmetry d of the friction, which is a scale exp(d a) of the
tension; and of the two levels that one load gives, a bias moves both like a scale once the friction is refitted. A
coefficient that grows with the tension, m (T / W)^z, is m (1 + z m a) hauling and m (1 - z m a) lowering one load: an
asymmetry. Friction in one direction only is Coulomb's of half its size and a constant force, which shows only where the
sensors' zero does not wander and no offset is refitted."""


def share_class(a: str, b: str) -> bool:
    """Whether two names may be confused by declaration."""
    return a == b or any(a in c and b in c for c in CLASSES)


def find(system: str, name: str) -> Missing:
    """The effect of that name on a system; KeyError where there is none."""
    for effect in (*LIBRARY[system], *STRANGE[system]):
        if effect.name == name:
            return effect
    raise KeyError(f"{system} has no effect '{name}'")
