"""The virtual jaw for a grasp that begins with an open jaw and an object of unknown place and stiffness.

**Closing.** The drive goes at a slow constant speed. While the jaw moves freely, the drive's torque is the plateau of
the friction. Where the torque rises above it by ``touches``, the jaw has met the object: `play.PlayFilter` begins there
with no grasp torque and the friction of the plateau.

**Grasping.** The grasp torque then rises to the reference at a limited rate, and `virtual_jaw.VirtualJaw` follows it.
A motor behind a gear does not give the torque that it is told, as the gear has friction of its own: an integral of the
measured torque's error makes it.
"""

import math
from collections.abc import Mapping
from typing import Any, ClassVar

from cable_envs.baselines.base import CIRCUITS, Reference
from cable_envs.baselines.circuit.virtual_jaw import VirtualJaw
from cable_envs.core.params import Parameter, ParameterTable

SETTLED = 0.15
"""s of motion at the closing speed before the torque counts as the plateau"""

SMOOTH = 0.2
"""share of a new torque in the torque that is compared"""

MOST = 2.0
"""torque over the nominal plateau at which the jaw counts as closed though it never moved freely"""

STEADY = 0.5
"""share of the closing speed from which the drive counts as moving"""


class GraspJaw(VirtualJaw):
    """Closes, learns the friction on the way, finds the object by the torque's rise, and holds a grasp torque."""

    name = "grasp-jaw"
    plants: ClassVar[tuple[str, ...]] = CIRCUITS
    tasks: ClassVar[tuple[str, ...]] = ("torque",)
    modes: ClassVar = ("torque",)
    gain_tables: ClassVar = {
        case: ParameterTable(
            *table,
            Parameter("closing", "rad/s", 0.3, 1e-3, 10.0, "speed of the drive while the jaw is open"),
            Parameter("closing_kp", "N m s/rad", 0.1, 0.0, 1e2, "torque per lacking speed while the jaw is open"),
            Parameter("closing_ki", "N m/rad", 1.0, 1e-3, 1e3, "torque per angle that the closing drive lags behind"),
            Parameter("touches", "N m", 0.02, 1e-4, 1.0, "rise of the torque above the plateau at the object"),
            Parameter("rises", "N m/s", 0.1, 1e-4, 1e2, "rate at which the grasp torque is first raised"),
            Parameter("inner_ki", "1/s", 5.0, 1e-3, 1e3, "integral gain of the measured torque"),
        )
        for case, table in VirtualJaw.gain_tables.items()
        if case[1:] == ("torque", "torque")
    }

    def use_rig(self, rig: Mapping[str, Any]) -> None:
        super().use_rig(rig)
        self._most = MOST * self.jaw.held_at(0.0, 1.0)[1]

    def reset(self) -> None:
        super().reset()
        self.closed = False
        """whether the object has been met"""
        self.plateau = math.inf
        """drive torque of the freely moving jaw, N m; infinite before it is known"""
        self._pushed, self._moving, self._smooth, self._inner = 0.0, 0.0, 0.0, 0.0
        self._raised: float | None = 0.0

    def act(self, t: float, y: Mapping[str, float], ref: Reference) -> float:
        if not self.closed:
            return self._close(y)
        most = self.gains["rises"] * self.dt
        if self._raised is not None:
            self._raised += min(max(ref[0] - self._raised, -most), most)
            if abs(ref[0] - self._raised) > most:
                return super().act(t, y, (self._raised, self.gains["rises"], 0.0))
            self._raised = None
        return super().act(t, y, ref)

    def _close(self, y: Mapping[str, float]) -> float:
        """Command while the jaw is open."""
        g, torque = self.gains, y["drive_torque"]
        slow = g["closing"] - y["drive_velocity"]
        self._pushed = min(max(self._pushed + g["closing_ki"] * slow * self.dt, self.low), self.high)
        self._smooth += SMOOTH * (torque - self._smooth)
        if y["drive_velocity"] > STEADY * g["closing"]:
            self._moving += self.dt
            if self._moving > SETTLED:
                self.plateau = min(self.plateau, self._smooth)
        known = self.plateau < math.inf
        if self._smooth > (self.plateau + g["touches"] if known else self._most):
            self.closed = self._begun = True
            plateau = self.plateau if known else self._most / MOST
            self.jaw.begin_grasp(y["drive_angle"], self._smooth, plateau)
            self._raised = self.jaw.output
            self._direction, self._place = 1.0, 1.0
            self._side.value = 1.0
            self._inner = self._pushed - torque
        return self.limit(self._pushed + g["closing_kp"] * slow)

    def driven(self, away: float, rate: float, needs: float, y: Mapping[str, float]) -> float:
        u = super().driven(away, rate, needs, y)
        more = self.gains["inner_ki"] * (needs - y["drive_torque"]) * self.dt
        if self.low < u + self._inner < self.high or (u + self._inner) * more < 0.0:
            self._inner += more
        return u + self._inner
