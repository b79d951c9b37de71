"""What a law of the hole does about jumps of a tension: where it waits for one, and how it crosses it.

**Search.** A load that nobody has moved yet is held by friction, at a tension of the drive anywhere between T2 / n and
T2 n. While the reference stands still, the drive hauls slowly until the load gives way, and waits there. What it pulls
then tells n, and the next pull moves the load at once: from the middle of the hold, the drive would first have to
stretch the cable, which costs it about a control period.

**Crossing.** The path of the load to another tension is (r - r0) / k_l, and that of the drive longer by what the cable
still stretches. The drive's limits of speed and acceleration bound it. So the fastest way is to pull with all that the
drive has, and to brake with all that it has once it stops within the path that is left (Kirk, Optimal Control Theory,
1970, ch. 5). It brakes until the cable has given up what the friction of the fast motion had stretched it by. The path
comes from the drive's position, whose noise is far below that of the load cell; the stiffness of the spring is found on
the way by least squares.
"""

import math
from collections.abc import Mapping

from cable_envs.baselines.hole_model import HoleModel
from cable_envs.baselines.parts import Hold

MISFIT = 0.35
"""N, standard deviation of the drive's tension about the line of the hold: of the drive's position, 5 um of cable."""

GONE = 2e-5
"""m of the drive beyond the line of the hold at which the load counts as sliding."""

LEAST = 2.0
"""N of search before which the line of the hold is not known well enough to leave it."""

UNCERTAIN, READ = 0.2, 1.0
"""Standard deviations of the spring's stiffness, as a share, and of the load's tension (N) about its motion."""

STANDS, BACKS = 0.75, 2.5
"""Speeds at which a braking drive counts as standing, and as going back, in those that a control period takes away."""

LONGEST = 1.0
"""s after which a crossing is given up."""


class Search:
    """The drive hauls until the load gives way. ``rate`` in N/s, ``dt`` the control period in s."""

    def __init__(self, hole: HoleModel, rate: float, dt: float):
        self._compliance, self._step = 1.0 / hole.cable_stiffness, rate * dt
        self.reset()

    def reset(self) -> None:
        self._hold = Hold(self._compliance, MISFIT, GONE)
        self._start: tuple[float, float, float] | None = None
        self._raised, self._over = 0.0, self._step <= 0.0
        self.broke = False
        """whether the load has given way"""

    @property
    def compliance(self) -> float:
        """Of the cable between drive and hole, m/N, as far as it was seen."""
        return self._hold.compliance

    def command(self, y: Mapping[str, float], reference: float) -> float | None:
        """What to pull, N; None from the first motion of the reference on."""
        if self._start is None:
            self._start = reference, y["drive_position"], y["drive_tension"]
        first, position, tension = self._start
        self._over = self._over or reference != first
        if self._over:
            return None
        if not self.broke:
            self._raised += self._step
            left = self._hold.leaves(y["drive_position"] - position, y["drive_tension"] - tension)
            self.broke = left and self._raised > LEAST
        return first + self._raised


class Crossing:
    """The drive crosses a jump of the tension as fast as it can. ``brake``: deceleration to count on, m/s^2."""

    def __init__(self, hole: HoleModel, top: float, brake: float, dt: float):
        self._hole, self._top, self._brake, self._dt = hole, top, brake, dt
        self.reset()

    def reset(self) -> None:
        self._way = 0.0
        self._brakes = False

    def begin(self, y: Mapping[str, float], before: float, after: float, compliance: float) -> None:
        """A jump of the reference, N; ``compliance`` of the cable, m/N."""
        if self._brake <= 0.0:
            return
        self._way = 1.0 if after > before else -1.0
        self._brakes = False
        self._from, self._to, self._compliance = before, after, compliance
        self._start = y["drive_position"], y["drive_tension"]
        self._stiffness = self._hole.stiffness
        self._spread = (UNCERTAIN * self._stiffness) ** 2
        self._speed, self._tension, self._since = y["drive_velocity"], y["drive_tension"], 0.0

    def command(self, y: Mapping[str, float], log_ratio: float) -> float | None:
        """What to pull, N; None where nothing is crossed. ``log_ratio``: ln n of the standing load."""
        way, tension, speed = self._way, y["drive_tension"], y["drive_velocity"]
        if way == 0.0:
            return None
        self._since += self._dt
        path = y["drive_position"] - self._start[0] - (tension - self._start[1]) * self._compliance
        faster, self._speed = (speed - self._speed) / self._dt, speed
        rises, self._tension = tension - self._tension, tension
        pulls = y["load_tension"] - self._from - self._hole.damping * speed - self._hole.mass * faster
        gain = self._spread * path / (self._spread * path * path + READ**2)
        self._stiffness += gain * (pulls - self._stiffness * path)
        self._spread *= 1.0 - gain * path
        rest = self._to * math.exp(way * log_ratio)  # what holds the load there, from the way that it came
        left = way * ((self._to - self._from) / self._stiffness - path + (rest - tension) * self._compliance)
        goes, step = way * speed, self._brake * self._dt
        late = (0.5 * max(goes, 0.0) + step) * self._dt  # until the command acts; the last step of the braking
        self._brakes = self._brakes or left - late <= 0.5 * max(goes, 0.0) ** 2 / self._brake
        if self._brakes:
            stands = goes < STANDS * step and way * (tension + 0.5 * rises - rest) < 0.0
            if stands or goes < -BACKS * step:
                self._way = 0.0
                return None
        if self._since > LONGEST:
            self._way = 0.0
            return None
        return self._top if (way > 0.0) != self._brakes else 0.0
