"""What the laws of the hole share: pull behind the hole -> tension of the drive, and the direction of sliding.

    F = P n(|w|)^s + w / k_p,     P = G + m a      (position)   or   P = T2 wanted   (tension)              G28, G35
    w = r' + approach e,          s = w / width within [-1, 1]

P is what has to pull behind the hole. w is the wanted sliding speed: that of the reference, and towards it where the
load is off; a stuck load is thereby pushed with the full friction of the way that it has to go. w / k_p is the tension
that the inner loop of G35 lacks while the drive moves at w.

**Slew.** With a cable of stiffness k, that loop is  T1' = k (kp (F - T1) + kd (F' - T1')),  and k kd is far above 1: T1
follows F' at once, but what the drive's limit of acceleration a has cut of a jump follows with kd / kp, 50 ms at the
nominal rig. Where the load turns, F jumps by the whole width of the hold. A command that changes by no more than
k a dt^2 in a control period dt is hardly cut, and crosses the hold in two or three periods. ``slew`` is its limit, N/s.
"""

import math
from collections.abc import Mapping
from typing import Any, ClassVar

from cable_envs.baselines.base import HOLE, Controller, Reference
from cable_envs.baselines.hole_model import HoleModel
from cable_envs.core.params import Parameter

TENSION_SHARE = 0.98
"""Share of the safety limit that is asked for: the rest is for the ripple of the elastic cable."""


LEAD = Parameter("lead", "s", 0.01, -0.5, 0.5, "how far ahead the reference is taken")
SLEW = Parameter("slew", "N/s", 0.0, 0.0, 1e5, "fastest change of the command; 0: any")


def direction_gains(approach: float, width: float) -> tuple[Parameter, ...]:
    """The gains that every law of the hole has: ``approach`` (1/s) and ``width`` (m/s), with their defaults."""
    return (
        Parameter("approach", "1/s", approach, 1e-6, 1e5, "speed wanted per position that is missing"),
        Parameter("width", "m/s", width, 1e-8, 1.0, "wanted speed at which all of the friction is compensated"),
    )


class InverseHole(Controller):
    """Base of the laws that invert the friction of the hole; a derived class says `pull`."""

    information = "nominal"
    plants = (HOLE,)
    tasks: ClassVar[tuple[str, ...]] = ("position", "tension")
    modes: ClassVar[tuple[str, ...]] = ("tension",)

    def use_rig(self, rig: Mapping[str, Any]) -> None:
        super().use_rig(rig)
        self._hole = HoleModel(self.rig, "exact")
        self._hole.require_spring(self.task)
        self._top = min(self.high, TENSION_SHARE * self.rig["tension_limit"])
        self._per_speed = 1.0 / self.rig["inner_kp"] if self.rig["inner_kp"] > 0.0 else 0.0
        self._scale = 1.0 if self.task == "position" else 1.0 / self._hole.stiffness
        """m per unit of the output"""

    def reset(self) -> None:
        self.saturated = 0.0
        """1 or -1 where the last command was cut at the upper or lower limit"""
        self._side = 0.0
        self._force: float | None = None

    def act(self, t: float, y: Mapping[str, float], ref: Reference) -> float:
        output = y["load_position"] if self.task == "position" else y["load_tension"]
        error = ref[0] - output
        wanted = self.wanted_speed(error, ref)
        side = self._direction(wanted)
        pull = self.pull(y, ref, error, wanted)
        free = pull * math.exp(side * self.log_ratio(abs(wanted), y)) + wanted * self._per_speed
        force = 0.0 if free < 0.0 else self._top if free > self._top else free
        most = self.gains.get("slew", 0.0) * self.dt
        if most > 0.0:
            last = y["drive_tension"] if self._force is None else self._force
            force = min(max(force, last - most), last + most)
            self._force = force
        self.saturated = 0.0 if force == free else 1.0 if free > force else -1.0
        return force

    def wanted_speed(self, error: float, ref: Reference) -> float:
        """Sliding speed that is wanted, m/s: at most what the drive can do."""
        limit = self._hole.speed_limit
        wanted = (ref[1] + self.gains["approach"] * error) * self._scale
        return -limit if wanted < -limit else limit if wanted > limit else wanted

    def pull(self, y: Mapping[str, float], ref: Reference, error: float, wanted: float) -> float:
        """What has to pull behind the hole, N."""
        raise NotImplementedError

    def log_ratio(self, speed: float, y: Mapping[str, float]) -> float:
        """ln n at a sliding speed (m/s): that of the nominal rig."""
        behind = y["load_tension"] if self.task == "tension" else self._hole.weight
        return math.log(self._hole.ratio(speed, y["drive_tension"], behind))

    def _direction(self, wanted: float) -> float:
        """s in [-1, 1]. With a spring behind the hole it keeps its last value at rest: the cable must not slip back."""
        width = self.gains["width"]
        s = max(-1.0, min(1.0, wanted / width))
        if self.task == "position":
            return s
        if abs(s) >= 1.0:
            self._side = s
        return self._side
