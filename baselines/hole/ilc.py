"""Iterative learning control: what the feedback had to add one period ago is given ahead of time.

    pull = pull of the scheduled PI-D + u,     u(t) = gain mean of c(t - T + lead) over +-`window`,     c = feedback + u

c is all that the feedback and the learning added to the model's pull (Bristow et al. 2006; the mean over a window is
the zero-phase filter Q). The period T is that of the reference and is found while it runs: the reference returns to a
value with the rate that it had there, and the last `SPAN` agree with what was one period before. Where nothing repeats,
as with a multisine or random steps, nothing is learned and the law is the scheduled PI-D.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import ClassVar

from cable_envs.baselines.base import Reference
from cable_envs.baselines.hole.scheduled import ScheduledPid
from cable_envs.core.params import Parameter, ParameterTable

SPAN = 1.0
"""s of the reference that have to agree with one period before"""

ALIKE = 5e-3
"""largest difference of them, as a share of the range of the reference so far"""

_LEARNING = (
    Parameter("gain", "1", 0.9, 0.0, 10.0, "share of the last period's correction that is given ahead of time"),
    Parameter("ahead", "s", 0.005, -1.0, 1.0, "how much earlier it is given"),
    Parameter("window", "s", 0.02, 0.0, 10.0, "half width of the mean over the last period's correction"),
)

_CALM = {"kp": 15000.0, "ki": 1e5, "ki_rest": 1e5, "kd": 300.0}
"""Feedback of the position that leaves something to learn: a stiffer one is better alone, and worse with learning."""


class Period:
    """The period of a sampled reference, found as it runs."""

    def __init__(self, dt: float):
        self._dt = dt
        self.values: list[float] = []
        """samples so far"""
        self._low = self._high = 0.0

    def found(self, ref: Reference) -> float:
        """The period after one more sample, s; 0 while none is known."""
        r, k = self.values, len(self.values)
        r.append(ref[0])
        self._low, self._high = min(self._low, ref[0]) if k else ref[0], max(self._high, ref[0]) if k else ref[0]
        span = round(SPAN / self._dt)
        if k < 2 * span or r[k] == r[k - 1]:
            return 0.0
        now, rising = r[k], r[k] > r[k - 1]
        for past in range(k - span, 1, -1):  # the latest time at which it was here and went the same way
            a, b = r[past - 1], r[past]
            if a != b and (b > a) == rising and min(a, b) <= now <= max(a, b):
                lag = k - (past - 1 + (now - a) / (b - a))
                return lag * self._dt if self._repeats(lag, span) else 0.0
        return 0.0

    def _repeats(self, lag: float, span: int) -> bool:
        k, most = len(self.values) - 1, ALIKE * (self._high - self._low)
        if k - lag - span < 0:
            return False
        return all(abs(self.values[j] - at(self.values, j - lag)) < most for j in range(k - span, k + 1, 5))


def at(values: list[float], place: float) -> float:
    """A value between samples, on a straight line; the first or last one beyond them."""
    k = int(place)
    if place <= 0.0 or k + 1 >= len(values):
        return values[0] if place <= 0.0 else values[-1]
    return values[k] + (place - k) * (values[k + 1] - values[k])


class Ilc(ScheduledPid):
    """Scheduled PI-D that learns its corrections from period to period."""

    name = "ilc"
    tasks = ("position",)  # with a spring behind the hole, the last period's corrections come out worse than none
    gain_tables: ClassVar = {
        case: ParameterTable(*(replace(p, default=_CALM.get(p.name, p.default)) for p in table), *_LEARNING)
        for case, table in ScheduledPid.gain_tables.items()
        if case[2] == "position"
    }

    def reset(self) -> None:
        super().reset()
        self._reference = Period(self.dt)
        self._added: list[float] = []
        self.period = 0.0
        """of the reference, s; 0 while none is known"""

    def pull(self, y: Mapping[str, float], ref: Reference, error: float, wanted: float) -> float:
        if self.period == 0.0:
            self.period = self._reference.found(ref)
            learned = self._learned()
            self.integral -= learned  # what was learned takes over from the integral without a jump
        else:
            learned = self._learned()
        model = self._hole.resistance(ref[0], ref[1]) + self._hole.mass * ref[2]
        free = super().pull(y, ref, error, wanted)
        self._added.append(free - model + learned)
        return free + learned

    def _learned(self) -> float:
        """u now, N."""
        if self.period == 0.0:
            return 0.0
        place = len(self._added) + (self.gains["ahead"] - self.period) / self.dt
        reach = round(self.gains["window"] / self.dt)
        some = [at(self._added, place + j) for j in range(-reach, reach + 1)]
        return self.gains["gain"] * sum(some) / len(some)
