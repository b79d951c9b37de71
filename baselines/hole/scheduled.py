"""PI-D on the load with gains that follow the operating point: direction and speed of sliding.

    F = [G + m r'' + kp e + I + kd e'] n(|w|)^s,     I' = ki(w) e,     ki(w) = ki_rest + (ki - ki_rest) min(|w| / v, 1)

Through the hole a newton of the drive arrives as 1 / n where the load is lifted and as n where it is lowered. So the
gains are scheduled by n(|w|)^s of the nominal rig (Rugh and Shamma 2000), and the integral by the wanted speed: about
rest, where friction holds the load, it may be stronger or weaker than in motion. The derivative acts on the measured
speed. Tension: F = (r(t + lead) + kp e + I) n^s.
"""

from collections.abc import Mapping
from typing import ClassVar

from cable_envs.baselines.base import Reference
from cable_envs.baselines.hole.inverse import LEAD, SLEW, InverseHole, direction_gains
from cable_envs.core.params import Parameter, ParameterTable


def _schedule(kp: tuple, ki: tuple, rest: float, moves: float) -> tuple[Parameter, ...]:
    """kp, ki: (unit, default, high)."""
    return (
        Parameter("kp", kp[0], kp[1], 1e-4, kp[2], "proportional gain"),
        Parameter("ki", ki[0], ki[1], 1e-4, ki[2], "integral gain in motion"),
        Parameter("ki_rest", ki[0], rest, 1e-4, ki[2], "integral gain at rest"),
        Parameter("moves", "m/s", moves, 1e-7, 100.0, "v, wanted speed from which the gain of motion holds"),
    )


class ScheduledPid(InverseHole):
    """PI-D whose gains follow the direction and the speed of sliding."""

    name = "scheduled-pid"
    charged: ClassVar = {"tuning_trials": 60}
    """for a case: on steps, sinusoids, multisines and random steps of nominal and randomised rigs"""
    gain_tables: ClassVar = {
        ("hole", "tension", "position"): ParameterTable(
            *_schedule(("N/m", 39000.0, 1e7), ("N/(m s)", 2.2e4, 1e9), 7e5, 0.5),
            Parameter("kd", "N s/m", 140.0, 0.1, 1e5, "derivative gain"),
            *direction_gains(4.8, 5e-5),
        ),
        ("hole", "tension", "tension"): ParameterTable(
            *_schedule(("1", 0.1, 100.0), ("1/s", 84.0, 1e5), 0.06, 2.2e-4),
            LEAD,
            SLEW,
            *direction_gains(1.0, 6e-5),
        ),
    }

    def reset(self) -> None:
        super().reset()
        self.integral = 0.0

    def pull(self, y: Mapping[str, float], ref: Reference, error: float, wanted: float) -> float:
        g = self.gains
        if self.saturated * error <= 0.0:
            share = min(abs(wanted) / g["moves"], 1.0)
            self.integral += (g["ki_rest"] + (g["ki"] - g["ki_rest"]) * share) * error * self.dt
        if self.task == "tension":
            return ref[0] + g["lead"] * ref[1] + g["kp"] * error + self.integral
        damping = g["kd"] * (ref[1] - y["load_velocity"])
        push = self._hole.mass * ref[2] + g["kp"] * error + self.integral + damping
        return self._hole.resistance(ref[0], ref[1]) + push
