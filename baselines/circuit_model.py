"""The pulley circuit as a controller knows it: ideal kinematics, Zou's working phase, and an estimated grasp torque.

The closed forms live in `circuit.statics` and work on arrays. In one direction they are piecewise linear in
the drive torque (both cables taut, or one slack), so here they are sampled once at the corners and interpolated: the
same equations at the price of a few comparisons.
"""

import math
from collections.abc import Mapping

import numpy as np

from cable_envs.core.errors import ConfigurationError
from cable_envs.plants.circuit.statics import Statics


class IdealCircuit:
    """Rigid cable without friction, and the load at the driven pulley.  SI; angles in rad, torques in N m."""

    def __init__(self, rig: Mapping[str, float]):
        self.ratio = rig["drive_radius"] / rig["output_radius"]
        self.relaxation = rig["cable_damping"] / rig["tensile_stiffness"]
        """s by which a stretched cable's tension is ahead of its stretch"""
        self._contact = rig["contact_angle"]
        self._stiffness = rig["contact_stiffness"]
        self._contact_damping = rig["contact_damping"]
        self._damping = rig["output_damping"]
        self._inertia = rig["output_inertia"] + rig["payload_mass"] * rig["payload_arm"] ** 2
        self._payload = rig["payload_mass"] * rig["gravity"] * rig["payload_arm"]
        self._brake = rig["brake_torque"]

    def require_contact(self, task: str) -> None:
        """A grasp torque needs something to grasp; ConfigurationError otherwise."""
        if task == "torque" and self._stiffness <= 0.0:
            raise ConfigurationError(
                "contact_stiffness = 0 N m/rad: a torque task needs a grasped object (contact_stiffness > 0)"
            )

    def drive_angle(self, output_angle: float) -> float:
        """Drive angle of an ideal circuit."""
        return output_angle / self.ratio

    def grasp_angle(self, torque: float) -> float:
        """Output angle at which the object is pressed with ``torque``."""
        return self._contact + torque / self._stiffness

    @property
    def contact_compliance(self) -> float:
        """Angle per torque of the grasped object, rad/(N m)."""
        return 1.0 / self._stiffness

    def load_torque(self, angle: float, velocity: float, acceleration: float) -> float:
        """Torque the driven pulley must give to move so: object, payload, friction, inertia."""
        torque = self._inertia * acceleration + self._damping * velocity + self._payload * math.cos(angle)
        if velocity != 0.0:
            torque += math.copysign(self._brake, velocity)
        depth = angle - self._contact
        if depth > 0.0 and self._stiffness > 0.0:
            torque += max(self._stiffness * depth + self._contact_damping * velocity, 0.0)
        return torque


class WorkingPhase:
    """Eqs. (42)-(45) and their inverse in one direction (+1 ccw, -1 cw), scalar; slack cables included."""

    __slots__ = ("_elongation", "_input", "_output")

    def __init__(self, statics: Statics, direction: int):
        low, high = (float(v[0]) for v in statics.torque_range(direction))
        corners = np.unique([low - 1.0, low, high, high + 1.0])
        points = [statics.working(m, direction) for m in corners]
        self._input = [float(m) for m in corners]
        self._output = [float(np.squeeze(p.output_torque)) for p in points]
        self._elongation = [float(np.squeeze(p.elongation_angle)) for p in points]

    def output_torque(self, drive_torque: float) -> float:
        """M_out at a drive torque.  Eq. (44), Zou 2022."""
        return _interpolate(self._input, self._output, drive_torque)

    def drive_torque(self, output_torque: float) -> float:
        """M_in that gives an output torque: the inverse of Eq. (44)."""
        return _interpolate(self._output, self._input, output_torque)

    def elongation(self, output_torque: float) -> float:
        """D = theta_in R0/R5 - theta_out at an output torque, rad.  Eq. (45), Zou 2022."""
        return _interpolate(self._output, self._elongation, output_torque)

    def compliance(self) -> float:
        """dD / dM_in with both cables taut, rad/(N m)."""
        k = len(self._input) // 2
        return (self._elongation[k] - self._elongation[k - 1]) / (self._input[k] - self._input[k - 1])


def _interpolate(x: list[float], y: list[float], at: float) -> float:
    """Piecewise linear through increasing x, extended beyond both ends."""
    k = 1
    while k < len(x) - 1 and at > x[k]:
        k += 1
    return y[k - 1] + (y[k] - y[k - 1]) * (at - x[k - 1]) / (x[k] - x[k - 1])


class CircuitModel(IdealCircuit):
    """Friction and elasticity of the circuit; `estimate` follows the grasp torque through reversals."""

    def __init__(self, rig: Mapping[str, float]):
        super().__init__(rig)
        statics = Statics.from_rig(rig)
        self.ccw = WorkingPhase(statics, 1)
        self.cw = WorkingPhase(statics, -1)

    def phase(self, direction: float) -> WorkingPhase:
        """The working phase of motion in ``direction``."""
        return self.ccw if direction > 0.0 else self.cw

    def estimate(self, previous: float, drive_torque: float) -> float:
        """Output torque after the drive torque has become ``drive_torque``, N m.

        Between the clockwise and the counter-clockwise working line the output holds, as Eq. (47) lumps delay and
        transition; on the lines Eq. (44) applies. This is a play operator: it needs no sign of a noisy speed.
        """
        low, high = self.ccw.output_torque(drive_torque), self.cw.output_torque(drive_torque)
        return min(max(previous, low), high)

    def middle_elongation(self, output_torque: float) -> float:
        """D halfway between both directions: without knowledge of the direction the best guess, rad."""
        return 0.5 * (self.ccw.elongation(output_torque) + self.cw.elongation(output_torque))
