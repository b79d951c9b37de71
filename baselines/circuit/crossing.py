"""A jump of the angle, crossed as fast as the drive can.

The drive's position loop is of second order, theta'' = k (u - theta) + d (u' - theta'), within limits of speed and
acceleration. Told the new angle at once it takes several of its time constants. Told more than that it accelerates with
all it has, and told less, it brakes; bang-bang is the fastest way between two rests (Kirk, Optimal Control Theory,
1970, ch. 5). In every period the command is the largest after which, by this model of the drive, it can still stop at
the target: its speed then is at most that of `parts.approach_speed`.
"""

from collections.abc import Mapping

from cable_envs.baselines.parts import approach_speed
from cable_envs.physics.servo import placed

JUMP = 0.03
"""rad, change of the reference in a step, beside what its rate explains, that is crossed"""

NEAR, SLOW = 4e-3, 0.4
"""rad and rad/s from the target at which the crossing ends."""

CATCH = 1.0
"""Share of a small path that is left which a control period takes."""

SUBSTEPS, HALVINGS = 5, 24
"""Steps of the model in a control period, and of the search for the command."""


class Crossing:
    """Commands of a position loop that cross a jump; ``hurry``: share of the drive's acceleration to count on."""

    def __init__(self, rig: Mapping[str, float], hurry: float, dt: float):
        self._stiffness = rig["servo_frequency"] ** 2
        self._damping = 2.0 * rig["servo_damping_ratio"] * rig["servo_frequency"]
        self._fastest, self._most = rig["drive_speed_limit"], rig["drive_acceleration_limit"]
        self._brake, self._dt = hurry * self._most, dt
        self.on = False
        """whether a jump is being crossed"""

    def begin(self) -> None:
        """A jump of the reference."""
        self.on = self._brake > 0.0

    def command(self, target: float, angle: float, speed: float, last: float) -> float:
        """The command (rad) towards ``target`` from an angle and a speed of the drive; ``last``: the one before."""
        low, high = sorted((angle, target))
        reach = self._fastest * self._dt + self._most / self._stiffness
        low, high = low - reach, high + reach
        way = 1.0 if target > angle else -1.0
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            there, then = self.after(middle, angle, speed, last)
            may = approach_speed(way * (target - there), CATCH / self._dt, self._brake, self._fastest)
            if (way * then > may) == (way > 0.0):
                high = middle
            else:
                low = middle
        found = 0.5 * (low + high)
        near = max(abs(found - target), abs(angle - target), 0.5 * abs(last - target)) < NEAR
        self.on = not (near and abs(speed) < SLOW)
        return found if self.on else target

    def after(self, command: float, angle: float, speed: float, last: float) -> tuple[float, float]:
        """Angle and speed of the drive a control period later."""
        rate = min(max((command - last) / self._dt, -self._fastest), self._fastest)
        h = self._dt / SUBSTEPS
        for _ in range(SUBSTEPS):
            new = placed(angle, speed, command, rate, self._stiffness, self._damping, self._most, self._fastest, h)
            angle, speed = angle + 0.5 * h * (speed + new), new
        return angle, speed
