"""The cable-hole as a controller knows it: resistance of the load and directional tension ratio."""

from collections.abc import Mapping

from cable_envs.core.errors import ConfigurationError
from cable_envs.physics.hole_ratio import EXACT, G9, G22, hole_ratio

FORMS = {"exact": EXACT, "g22": G22, "g9": G9}


class HoleModel:
    """Numbers of one rig (SI) with the quantities of G28: m, G and n(|v|). ``form`` is a key of `FORMS`."""

    def __init__(self, rig: Mapping[str, float], form: str = "exact"):
        self.mass = rig["load_mass"]
        self.weight = rig["load_mass"] * rig["gravity"] * rig["load_gravity"]
        self.stiffness = rig["load_stiffness"]
        self.damping = rig["load_damping"]
        self.cable_stiffness = rig["cable_stiffness"]
        self.speed_limit = rig["drive_speed_limit"]
        self.acceleration_limit = rig["drive_acceleration_limit"]
        self._form = FORMS[form]
        holes = [("", rig["wrap_angle"])] + [(k[10:], v) for k, v in rig.items() if k.startswith("wrap_angle_")]
        self._holes = [
            (wrap, rig[f"radius_ratio{h}"], rig[f"friction_coefficient{h}"], rig["extrusion_delta"],
             rig["extrusion_gain"], rig["extrusion_exponent"], rig["bending_rigidity"],
             rig["radius_ratio"] * rig["cable_radius"])
            for h, wrap in holes
        ]  # fmt: skip

    def ratio(self, speed: float, drive_tension: float, load_tension: float) -> float:
        """n(|v|) >= 1 of all holes together at sliding speed v (m/s); tensions matter to a stiff cable only (G1)."""
        n = 1.0
        for hole in self._holes:
            n *= hole_ratio(self._form, speed, *hole, drive_tension, load_tension)
        return n

    def resistance(self, position: float, velocity: float) -> float:
        """G of G28, N: weight, the load's spring and damping."""
        return self.weight + self.stiffness * position + self.damping * velocity

    def require_spring(self, task: str) -> None:
        """A load-side tension can only be set against a spring; ConfigurationError for a free load."""
        if task == "tension" and self.stiffness <= 0.0:
            raise ConfigurationError(
                "load_stiffness = 0 N/m: a tension task needs the load held by a spring (load_stiffness > 0); "
                "the tension of a hanging load is its weight"
            )

    def position_of(self, tension: float, rate: float = 0.0) -> float:
        """Load position (m) at which the load side carries ``tension`` (N) that changes at ``rate`` (N/s)."""
        return (tension - self.weight - self.damping * rate / self.stiffness) / self.stiffness
