"""The oracle's law for the cable-hole: exact inverse of the plant with true parameters, feedback on the true output."""

from collections.abc import Mapping

from cable_envs.baselines.base import Reference
from cable_envs.baselines.hole_model import HoleModel
from cable_envs.baselines.parts import approach_speed

_TENSION_SHARE = 0.97
"""share of the safety limit that may be asked for: what is left covers the ripple of the elastic cable"""


class HoleOracle:
    """Cascade output -> sliding speed -> driving tension -> drive speed; in tension mode G35 is inverted as well.

    The wanted sliding speed is the reference's plus the fastest approach the drive can brake from; the driving tension
    is G28 inverted with the exact n, for the direction and speed of the wanted motion. Using the wanted speed leaves
    the plant its own damping by extrusion; compensating the measured speed would take it away.
    """

    def __init__(self, rig: Mapping[str, float], gains: Mapping[str, float], action_mode: str, task: str, dt: float):
        self._hole = HoleModel(rig, "exact")
        self._hole.require_spring(task)
        self._gains, self._dt = gains, dt
        self._speed_mode, self._tension_task = action_mode == "speed", task == "tension"
        self._force_limit = min(rig["tension_command_limit"], _TENSION_SHARE * rig["tension_limit"])
        self._command_limit = rig["tension_command_limit"]
        kp, kd = rig["inner_kp"], rig["inner_kd"]
        self._inner = kp, kd / dt, kd * self._hole.cable_stiffness
        self.reset()

    def reset(self) -> None:
        self._side = 0.0
        self._last: float | None = None

    def act(self, y: Mapping[str, float], ref: Reference) -> float:
        """Command in the unit of the action mode, before the drive's limits."""
        hole, g = self._hole, self._gains
        velocity = y["load_velocity"]
        if self._tension_task:
            scale = 1.0 / hole.stiffness
            error = (ref[0] + ref[1] * self._dt - y["load_tension"]) * scale - velocity * self._dt
            rate, acceleration = ref[1] * scale, ref[2] * scale
        else:
            error = ref[0] - y["load_position"]
            rate, acceleration = ref[1], ref[2]
        limit = hole.speed_limit
        wanted = rate + approach_speed(error, g["output_gain"], g["braking"] * hole.acceleration_limit, limit)
        wanted = min(max(wanted, -limit), limit)
        if abs(wanted) > g["rest_speed"]:
            self._side = 1.0 if wanted > 0.0 else -1.0
        resistance = hole.resistance(y["load_position"], velocity)
        push = hole.mass * (acceleration + g["speed_gain"] * (wanted - velocity))
        n = hole.ratio(wanted, y["drive_tension"], y["load_tension"])
        force = min(max((resistance + push) * n**self._side, 0.0), self._force_limit)
        stretch = (force - y["drive_tension"]) / hole.cable_stiffness
        growth = (hole.stiffness * rate + hole.damping * acceleration) * n**self._side / hole.cable_stiffness
        speed = velocity + growth + approach_speed(stretch, g["stretch_gain"], hole.acceleration_limit, limit)
        far = min(max(abs(wanted - rate) / g["far_speed"] - 1.0, 0.0), 1.0)
        speed += far * (wanted - speed)  # far from the reference the drive goes ahead of the load, as far as
        room = (self._force_limit - y["drive_tension"]) / hole.cable_stiffness  # the tension limit has room
        speed = min(speed, velocity + approach_speed(room, g["stretch_gain"], hole.acceleration_limit, limit))
        speed = min(max(speed, -limit), limit)
        return speed if self._speed_mode else self._command(speed, velocity, y["drive_tension"])

    def _command(self, speed: float, slip: float, tension: float) -> float:
        """Driving tension that makes the inner loop G35 run at ``speed``: its inverse over one period.

        (1 + kd k) v = kp (F - T1) + kd (F - F_last) / dt + kd k slip, with T1 half a period ahead.
        """
        kp, kd_rate, through = self._inner
        last = tension if self._last is None else self._last
        ahead = tension + 0.5 * self._dt * self._hole.cable_stiffness * (speed - slip)
        force = ((1.0 + through) * speed - through * slip + kp * ahead + kd_rate * last) / (kp + kd_rate)
        self._last = min(max(force, 0.0), self._command_limit)
        return self._last
