"""Adaptive inverse of the hole's friction with a disturbance observer.

Position:  F = G e^p0 (1 + a / g) n^s,   a = r'' + kp e + kd e' + d,    ln n = p1 + p2 (|v| / v0)^omega
Tension:   F = (r(t + lead) + kp e + ki int e) n^s

**Adaptation.** While the cable slides, ln T1 = ln P + p0 + s (p1 + p2 (|v|/v0)^omega), with P the nominal pull behind
the hole (tension task: the measured one, without p0). This is linear in p0 (the weight), p1 (Coulomb friction) and p2
(extrusion), so recursive least squares finds them (a Kalman filter of parameters that walk slowly; Ljung, System
Identification, 1999, ch. 11). It begins at the nominal values with their uncertainty as covariance. Both ways of
sliding tell the weight and the friction apart; in one way only what that way needs is found. In a tension task speed
and ln T1 / T2 are smoothed alike before: the drive's speed trembles by more than the cable slides.

**The way of sliding** in a tension task follows r' + approach e with e smoothed (`AdaptiveInverse.wanted_speed`).

**Disturbance observer.** d = L / (s + L) (a - v'), the part of the wanted acceleration that does not arrive (Ohnishi
1987). Solved for d this is d = L (int (a - d) - v): no speed is differentiated. It stands still at a limit of the
command. A load that is stuck is pushed more and more until it goes.

**Jumps** of a tension: `jumps.Search` and `jumps.Crossing`, with the gains ``search`` and ``brake``.
"""

import math
from collections.abc import Mapping
from typing import Any, ClassVar

from cable_envs.baselines.base import Reference
from cable_envs.baselines.hole.inverse import LEAD, SLEW, InverseHole, direction_gains
from cable_envs.baselines.hole.jumps import Crossing, Search
from cable_envs.baselines.parts import has_jumped
from cable_envs.core.params import Parameter, ParameterTable

REFERENCE_SPEED = 0.01
"""v0, m/s"""

UNCERTAIN = (0.15, 0.2, 0.2)
"""Standard deviations of p before anything was measured: 15 % of the weight, 20 % of a tension by friction."""

JUMP = 0.5
"""N, change of the reference in a step, beside what its rate explains, that counts as a jump"""

HEARD = 0.05
"""s, time constant of what the adaptation of a tension task hears"""

MOST = 1.4
"""Largest ln n: T1 / T2 = 4"""

FOUND = 0.02
"""Standard deviation of ln n at rest after a search has found it."""


def _adaptation(slides: float, misfit: float, walk: float) -> tuple[Parameter, ...]:
    return (
        Parameter("slides", "m/s", slides, 1e-5, 0.05, "measured speed above which the cable counts as sliding"),
        Parameter("misfit", "1", misfit, 1e-5, 100.0, "standard deviation of ln T1 about the model"),
        Parameter("walk", "1/sqrt(s)", walk, 1e-10, 100.0, "how far a parameter walks in a second"),
    )


class AdaptiveInverse(InverseHole):
    """PI-D on the load through an inverse model of the friction that is fitted while the cable slides."""

    name = "adaptive-inverse"
    charged: ClassVar = {"tuning_trials": 80}
    """for a case: on steps, sinusoids, multisines and random steps of nominal and randomised rigs"""
    gain_tables: ClassVar = {
        ("hole", "tension", "position"): ParameterTable(
            Parameter("kp", "1/s^2", 11655.0, 1.0, 1e6, "acceleration per error"),
            Parameter("kd", "1/s", 101.0, 0.1, 1e4, "acceleration per error of the speed"),
            Parameter("observer", "1/s", 3e-3, 1e-6, 500.0, "L, bandwidth of the disturbance observer"),
            *direction_gains(5.0, 4.5e-5),
            *_adaptation(6e-4, 0.79, 0.25),
        ),
        ("hole", "tension", "tension"): ParameterTable(
            Parameter("kp", "1", 0.3, 1e-4, 20.0, "gain of the error"),
            Parameter("ki", "1/s", 42.0, 1e-3, 1e3, "gain of its integral"),
            LEAD,
            SLEW,
            Parameter("calm", "s", 0.05, 0.0, 10.0, "time constant of the error that decides the way of sliding"),
            *direction_gains(14.0, 1e-4),
            *_adaptation(1e-3, 0.1, 1e-5),
            Parameter("search", "N/s", 0.0, 0.0, 1e3, "rise of the pull until a load at rest gives way; 0: none"),
            Parameter(
                "brake",
                "m/s^2",
                0.0,
                0.0,
                100.0,
                "braking counted on where a jump is crossed at the limits of the drive; 0: no such crossing",
            ),
        ),
    }

    def use_rig(self, rig: Mapping[str, Any]) -> None:
        super().use_rig(rig)
        hole = self._hole
        still, moving = (math.log(hole.ratio(v, hole.weight, hole.weight)) for v in (0.0, REFERENCE_SPEED))
        self._start = 0.0, still, moving - still
        self._exponent = self.rig["extrusion_exponent"]
        if self.task == "tension":
            self._search = Search(hole, self.gains["search"], self.dt)
            self._crossing = Crossing(hole, self._top, self.gains["brake"], self.dt)

    def reset(self) -> None:
        super().reset()
        self.fitted = list(self._start)
        """p0, p1, p2"""
        self._spread = [[s * s if i == j else 0.0 for j in range(3)] for i, s in enumerate(UNCERTAIN)]
        self._nominal_speed: float | None = None
        self._integral = 0.0
        self._last: float | None = None
        self._calm_error, self._jumped = 0.0, 0.0
        self._speed, self._logarithm, self._heard = 0.0, 0.0, 0.0
        if self.task == "tension":
            self._search.reset()
            self._crossing.reset()

    def act(self, t: float, y: Mapping[str, float], ref: Reference) -> float:
        if self.task == "tension":
            waits = self._wait(y, ref)
            if waits is not None:
                return waits
        last = self._last
        self._adapt(y, ref)
        free = super().act(t, y, ref)
        if self.task != "tension":
            return free
        if last is not None and has_jumped(ref, last, self.dt, JUMP):
            self._crossing.begin(y, last, ref[0], self._search.compliance)
        crosses = self._crossing.command(y, min(max(self.fitted[1], 0.0), MOST))
        return free if crosses is None else crosses

    def _wait(self, y: Mapping[str, float], ref: Reference) -> float | None:
        """What to pull while the friction is searched, before the reference has ever moved."""
        before = self._search.broke
        pull = self._search.command(y, ref[0])
        if pull is None:
            return None
        self._last, self._side = ref[0], 1.0
        if self._search.broke and not before:
            self.fitted[1] = math.log(max(pull / ref[0], 1.0))
            for k in range(3):
                self._spread[k][1] = self._spread[1][k] = FOUND**2 if k == 1 else 0.0
        return min(pull, self._top)

    def wanted_speed(self, error: float, ref: Reference) -> float:
        """In a tension task the error is smoothed, but for that of a jump of the reference until it is made up for.

        A change of the way jumps the reading by what the cable stretches, which would change the way back at once.
        """
        if self.task != "tension":
            return super().wanted_speed(error, ref)
        if has_jumped(ref, self._last, self.dt, JUMP):
            self._jumped = 1.0 if error > 0.0 else -1.0
        self._last = ref[0]
        if self._jumped * error <= 0.0:
            self._jumped = 0.0
        share = 1.0 if self._jumped else self.dt / (self.dt + self.gains["calm"])
        self._calm_error += share * (error - self._calm_error)
        return super().wanted_speed(self._calm_error, ref)

    def pull(self, y: Mapping[str, float], ref: Reference, error: float, wanted: float) -> float:
        g = self.gains
        if self.task == "tension":
            if self.saturated * error <= 0.0:
                self._integral += g["ki"] * error * self.dt
            return ref[0] + g["lead"] * ref[1] + g["kp"] * error + self._integral
        velocity = y["load_velocity"]
        asked = ref[2] + g["kp"] * error + g["kd"] * (ref[1] - velocity)
        if self._nominal_speed is None:
            self._nominal_speed = velocity
        lacks = g["observer"] * (self._nominal_speed - velocity)
        if self.saturated * asked <= 0.0:
            self._nominal_speed += asked * self.dt
        return (self._hole.resistance(ref[0], ref[1]) + self._hole.mass * (asked + lacks)) * math.exp(self.fitted[0])

    def log_ratio(self, speed: float, y: Mapping[str, float]) -> float:
        still, moving = self.fitted[1], self.fitted[2]
        return min(max(still + moving * (speed / REFERENCE_SPEED) ** self._exponent, 0.0), MOST)

    def _adapt(self, y: Mapping[str, float], ref: Reference) -> None:
        """One step of recursive least squares, where the cable slides."""
        hole = self._hole
        if self.task == "tension":
            velocity, behind, weight = y["drive_velocity"], y["load_tension"], 0.0
        else:
            velocity, weight = y["load_velocity"], 1.0
            behind = hole.resistance(y["load_position"], velocity) + hole.mass * ref[2]
        above = y["drive_tension"]
        if abs(velocity) < self.gains["slides"]:
            self._speed = 0.0
            return
        if behind <= 1.0 or above <= 1.0:
            return
        told = math.log(above / behind)
        if self.task == "tension":
            velocity, told = self._smoothed(velocity, told)
            if self._heard < HEARD:
                return
        side = 1.0 if velocity > 0.0 else -1.0
        row = (weight, side, side * (abs(velocity) / REFERENCE_SPEED) ** self._exponent)
        spread, walked = self._spread, self.gains["walk"] ** 2 * self.dt
        for k in range(3):
            spread[k][k] += walked
        along = [sum(spread[i][j] * row[j] for j in range(3)) for i in range(3)]
        total = sum(row[i] * along[i] for i in range(3)) + self.gains["misfit"] ** 2
        missed = told - sum(p * x for p, x in zip(self.fitted, row, strict=True))
        for i in range(3):
            self.fitted[i] += along[i] * missed / total
            for j in range(3):
                spread[i][j] -= along[i] * along[j] / total

    def _smoothed(self, velocity: float, told: float) -> tuple[float, float]:
        """Speed and ln T1 / T2 through the same low pass, which begins anew at each change of the way.

        The drive's speed trembles with the command by more than the cable slides; squared, that would look like
        friction without extrusion.
        """
        if velocity * self._speed <= 0.0:
            self._speed, self._logarithm, self._heard = velocity, told, 0.0
        self._heard += self.dt
        share = self.dt / (self.dt + HEARD)
        self._speed += share * (velocity - self._speed)
        self._logarithm += share * (told - self._logarithm)
        return self._speed, self._logarithm
