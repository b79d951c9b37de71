"""Effects of a lumped cable transmission: parameters, bounds, and what is probed; names as in `cable_envs.effects`."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import brentq

from cable_envs.core.errors import require_known
from cable_envs.effects import EFFECTS
from cable_envs.physics.contact import tension_ratio
from cable_envs.plants import plant_for
from cable_envs.sim.rigs import SCHEMA as RIG_SCHEMA
from cable_envs.sim.rigs import load_rig
from diagnosis.model.hypotheses import Hypothesis
from diagnosis.model.model import Free
from diagnosis.systems.question import Request
from diagnosis.systems.transmission_kernel import DRIFT_TIME


@dataclass(frozen=True)
class Limit:
    """Unit, null, bounds and a size that matters (SI) of one parameter; ``shape``: its null alone says nothing."""

    unit: str
    null: float
    low: float
    high: float
    scale: float
    shape: bool = False

    def at(self, start: float, name: str) -> Free:
        """The parameter of a refit that begins at ``start``."""
        return Free(name, start, self.low, self.high, self.scale)


LIMITS: Mapping[str, Limit] = {
    "ratio": Limit("1", 1.0, 0.01, 100.0, 1.0),
    "torque_zero": Limit("N m", 0.0, -10.0, 10.0, 0.01),
    "torque_constant": Limit("N m/A", 1.0, 0.0, 1e3, 0.1),
    "sensor_scale.output_torque": Limit("1", 1.0, 0.3, 3.0, 0.05),
    "cable_elongation.drive_side": Limit("rad/(N m)", 0.0, 0.0, 50.0, 0.5),
    "cable_elongation.output_side": Limit("rad/(N m)", 0.0, 0.0, 50.0, 0.5),
    "stiffness_hardening.drive_side": Limit("1/(N m)", 0.0, 0.0, 300.0, 10.0),
    "stiffness_hardening.output_side": Limit("1/(N m)", 0.0, 0.0, 300.0, 10.0),
    "coulomb_friction.level": Limit("N m", 0.0, 0.0, 10.0, 0.02),
    "load_dependent_friction.exponent": Limit("1", 0.0, 0.0, 3.0, 0.2),
    "presliding_hysteresis.share": Limit("1", 0.0, 0.0, 1.2, 0.5),
    "partial_slip.share": Limit("1", 0.0, 0.0, 0.95, 0.3),
    "partial_slip.compliance": Limit("rad/(N m)", 0.0, 0.0, 50.0, 0.5),
    "viscous_friction.coefficient": Limit("N m s/rad", 0.0, 0.0, 10.0, 0.01),
    "stribeck_friction.excess": Limit("N m", 0.0, 0.0, 10.0, 0.02),
    "stribeck_friction.velocity": Limit("rad/s", 0.3, 0.01, 10.0, 0.1, shape=True),
    "backlash.width": Limit("rad", 0.0, 0.0, 1.0, 0.02),
    "viscoelastic_creep.share": Limit("1", 0.0, 0.0, 20.0, 0.2),
    "viscoelastic_creep.time": Limit("s", 1.0, 0.02, 100.0, 1.0, shape=True),
    "friction_drift.change": Limit("1", 0.0, -0.5, 5.0, 0.1),
    "position_ripple.sine": Limit("rad", 0.0, -1.0, 1.0, 0.02),
    "position_ripple.cosine": Limit("rad", 0.0, -1.0, 1.0, 0.02),
    "position_dependent_load.drive_side": Limit("N m/rad", 0.0, -1.0, 1.0, 0.02),
    "position_dependent_load.output_side": Limit("N m/rad", 0.0, -1.0, 1.0, 0.02),
    "sensor_delay.output_angle": Limit("s", 0.0, 0.0, 0.2, 0.02),
}
"""Every row of the kernel. Bounds are wide: what a tool's drive can have, in either sense."""

NULLS: Mapping[str, float] = {name: limit.null for name, limit in LIMITS.items()}
SIZES = (0.1, 1.0)
"""Probed sizes over `Limit.scale`."""
_SHAPES = {"stribeck_friction.velocity": (0.1, 0.3, 1.0), "viscoelastic_creep.time": (0.1, 1.0, 5.0)}
_CONFUSED = {
    "coulomb_friction": ("load_dependent_friction", "asymmetric_friction"),
    "presliding_hysteresis": ("backlash", "cable_elongation", "partial_slip"),
}
"""Beside what the registry says: pretension times the capstan's exponent looks like Coulomb friction, and the torque
sensor's free zero takes up any difference between the directions."""


def hypotheses(request: Request | None = None) -> tuple[Hypothesis, ...]:
    """Every effect that the rigid, frictionless transmission lacks. Raises ConfigurationError for unknown names."""
    request = request or Request()
    effects = dict.fromkeys(_effect(name) for name in LIMITS if "." in name)
    for name in (*(request.only or ()), *request.without):
        require_known("effect", [name], EFFECTS)
    wanted = [e for e in effects if e.split(".")[0] not in request.without]
    if request.only is not None:
        wanted = [e for e in wanted if e.split(".")[0] in request.only]
    return tuple(_hypothesis(effect) for effect in wanted)


def _effect(name: str) -> str:
    """Name of a parameter's hypothesis: a sensor's effect is one for each signal."""
    return name if name.startswith("sensor_") else name.split(".")[0]


def _hypothesis(effect: str) -> Hypothesis:
    mine = {name: limit for name, limit in LIMITS.items() if "." in name and _effect(name) == effect}
    sizes = {name: limit for name, limit in mine.items() if not limit.shape}
    shapes: list[dict[str, float]] = [{}]
    for name, values in _SHAPES.items():
        if name in mine:
            shapes = [{**s, name: value} for s in shapes for value in values]
    probes = tuple(
        tuple({name: limit.null + size * limit.scale, **shape} for name, limit in sizes.items())
        for size in SIZES
        for shape in shapes
    )
    known = EFFECTS[effect.split(".")[0]]
    confusable = tuple(dict.fromkeys((*known.confusable, *_CONFUSED.get(effect, ()))))
    return Hypothesis(
        effect, tuple(limit.at(limit.null, name) for name, limit in mine.items()), probes, known.equation,
        known.experiment, confusable, {name: limit.null for name, limit in sizes.items()},
    )  # fmt: skip


def rig_of(values: Mapping[str, float], accepted: Sequence[str], name: str = "augmented") -> dict[str, Any]:
    """Content of augmented.yaml: the circuit of the rig zou-table2 with the ratio, friction and compliance found.

    What the lumped transmission does not tell is taken as that rig has it: radii of the drive, wraps, spans. Fixed
    idlers with the friction coefficient whose tension ratio over the path is e^exponent; the friction without load as
    that ratio times a pretension; EA so that both cables together give the compliance found.
    """
    base = load_rig("zou-table2").values
    named, radius = {**NULLS, **values}, base["drive_radius"]
    exponent, level = named["load_dependent_friction.exponent"], named["coulomb_friction.level"]
    length = sum(base[f"span_top_{k}"] for k in range(5))
    soft = sum(named[f"cable_elongation.{side}_side"] for side in ("drive", "output"))
    found: dict[str, tuple[float, str]] = {
        "output_radius": (radius / abs(named["ratio"]), "m"),
        "idlers_fixed": (1.0, "1"),
        "cable_friction": (_coefficient(exponent, base) if exponent > 0.0 else 0.0, "1"),
    }
    if exponent > 0.01 and level > 0.0:
        tension = level / (2.0 * radius * float(np.sinh(exponent)))
        found |= {"pretension_top": (tension, "N"), "pretension_bottom": (tension, "N")}
    else:
        found["brake_torque"] = (level / abs(named["ratio"]), "N m")
    if soft > 0.0:
        found["tensile_stiffness"] = (length / (2.0 * radius**2 * soft), "N")
    if "viscous_friction" in accepted:
        found["drive_damping"] = (base["drive_damping"] + named["viscous_friction.coefficient"], "N m s")
    table = plant_for("pulley_circuit").parameters
    entries = {
        p.name: {"value": float(base[p.name]), "unit": p.unit, "source": "zou-table2: not told by the recording"}
        for p in table
    }
    entries |= {key: {"value": float(v), "unit": unit, "source": "diagnosis"} for key, (v, unit) in found.items()}
    rig = {"schema": RIG_SCHEMA, "name": name, "plant": "pulley_circuit", "parameters": entries}
    effects = _effects_of(named, accepted, radius)
    return rig | ({"effects": effects} if effects else {})


def _coefficient(exponent: float, rig: Mapping[str, float]) -> float:
    """Friction coefficient of fixed idlers whose tension ratio over the top cable's path is e^exponent."""

    def over(coefficient: float) -> float:
        ratios = (
            tension_ratio(rig[f"radius_top_{k}"] / rig["cable_radius"] - 1.0, coefficient, rig[f"wrap_top_{k}"])
            for k in range(1, 5)
        )
        return sum(float(np.log(r)) for r in ratios) - exponent

    return float(brentq(over, 1e-6, 2.0)) if over(2.0) > 0.0 else 2.0


def _effects_of(named: Mapping[str, float], accepted: Sequence[str], radius: float) -> dict[str, dict[str, Any]]:
    """Effects of the plant for the accepted ones that are no parameters of it."""
    wave = complex(named["position_ripple.sine"], named["position_ripple.cosine"])
    spring = named["position_dependent_load.output_side"] + named["position_dependent_load.drive_side"]
    table: dict[str, dict[str, tuple[float, str]]] = {
        "stiffness_hardening": {"coefficient": (named["stiffness_hardening.output_side"] * radius, "1/N")},
        "stribeck_friction": {
            "excess": (named["stribeck_friction.excess"], "N m"),
            "velocity": (named["stribeck_friction.velocity"], "rad/s"),
        },
        "backlash": {"gap": (named["backlash.width"], "rad")},
        "viscoelastic_creep": {
            "share": (named["viscoelastic_creep.share"], "1"), "time": (named["viscoelastic_creep.time"], "s"),
        },
        "friction_drift": {"change": (named["friction_drift.change"], "1"), "time": (DRIFT_TIME, "s")},
        "position_ripple": {
            "amplitude": (abs(wave), "rad"), "period": (np.pi, "rad"), "phase": (float(np.angle(wave)), "rad"),
        },
        "position_dependent_load": {"stiffness": (max(spring, 0.0), "N m/rad")},
        "sensor_scale": {"output_torque": (1.0 / named["sensor_scale.output_torque"], "1")},
        "sensor_delay": {"output_angle": (named["sensor_delay.output_angle"], "s")},
    }  # fmt: skip
    there = {name.split(".")[0] for name in accepted}
    return {
        effect: {k: {"value": float(v), "unit": unit} for k, (v, unit) in entries.items()}
        for effect, entries in table.items()
        if effect in there
    }
