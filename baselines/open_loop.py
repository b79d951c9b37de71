"""Open loop: ideal kinematics and statics of the mechanism, no measurement. Score 0 of the benchmark."""

from collections.abc import Mapping
from typing import Any, ClassVar

from cable_envs.baselines.base import Controller, Levels, Reference
from cable_envs.baselines.circuit_model import IdealCircuit
from cable_envs.baselines.general import view_of
from cable_envs.baselines.hole_model import HoleModel
from cable_envs.baselines.parts import approach_speed

_APPROACH = 0.15
"""share of the drive's acceleration used to answer a step"""


class OpenLoop(Controller):
    """What one would command if cable and contacts were ideal.

    ==========================  =========================================================================
    hole, tension, position     F = G + m r_ddot (a load hanging on an ideal cable)
    hole, tension, tension      F = r
    hole, speed                 the drive is moved to where an elastic, frictionless cable would need it
    circuit, position           theta_in = theta_out R5 / R0; grasp torque: theta_out = contact + r / stiffness
    with a view                 its steady command without friction
    circuit, torque             M_in = M_out R0 / R5; position tasks: M_out is the load's torque at the reference
    ==========================  =========================================================================

    The speed is that of the wanted drive position: v = r_dot, and a step of the reference is driven with a share of the
    drive's acceleration that the load's inertia turns into no overload (v = r_dot alone would never answer a step). It
    integrates its own command, not a measurement.
    """

    name = "open-loop"
    information = "nominal"
    general = True
    levels: ClassVar = Levels({}, "drive")

    def use_rig(self, rig: Mapping[str, Any]) -> None:
        super().use_rig(rig)
        if self.plant == "cable_hole":
            self._hole = HoleModel(self.rig)
            self._hole.require_spring(self.task)
            self._law = {"tension": self._tension, "speed": self._speed}[self.action_mode]
        elif self.plant not in self.plants:
            view = view_of(self.plant, self.rig, self.action_mode, self.task)
            self._law = lambda ref: view.steady(ref, 0.0)
        else:
            self._circuit = IdealCircuit(self.rig)
            self._circuit.require_contact(self.task)
            self._law = {"position": self._angle, "torque": self._torque}[self.action_mode]

    def reset(self) -> None:
        self._drive: float | None = None
        self._drive_speed = 0.0

    def act(self, t: float, y: Mapping[str, float], ref: Reference) -> float:
        return self.limit(self._law(ref))

    def _tension(self, ref: Reference) -> float:
        if self.task == "tension":
            return ref[0]
        return self._hole.resistance(ref[0], ref[1]) + self._hole.mass * ref[2]

    def _speed(self, ref: Reference) -> float:
        hole = self._hole
        if self.task == "tension":
            position, rate = hole.position_of(ref[0], ref[1]), ref[1] / hole.stiffness
        else:
            position, rate = ref[0], ref[1]
        tension = hole.resistance(position, rate)
        drive = position + tension / hole.cable_stiffness
        if self._drive is None:  # an episode begins at rest at the reference
            self._drive = drive
        gentle = _APPROACH * hole.acceleration_limit
        catch_up = approach_speed(drive - self._drive, 0.5 / self.dt, gentle, hole.speed_limit)
        wanted = rate * (1.0 + hole.stiffness / hole.cable_stiffness) + catch_up
        change = min(max(wanted - self._drive_speed, -gentle * self.dt), gentle * self.dt)
        self._drive_speed = self.limit(self._drive_speed + change)
        self._drive += self._drive_speed * self.dt
        return self._drive_speed

    def _angle(self, ref: Reference) -> float:
        angle = self._circuit.grasp_angle(ref[0]) if self.task == "torque" else ref[0]
        return self._circuit.drive_angle(angle)

    def _torque(self, ref: Reference) -> float:
        load = ref[0] if self.task == "torque" else self._circuit.load_torque(ref[0], ref[1], ref[2])
        return load * self._circuit.ratio
