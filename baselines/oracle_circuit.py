"""The oracle's law for the pulley circuit: inverse of working phase and drive, feedback on the true output."""

from collections.abc import Mapping

from cable_envs.baselines.base import Reference
from cable_envs.baselines.circuit_model import CircuitModel
from cable_envs.baselines.parts import approach_speed, follow_direction

_ARRIVED_ANGLE, _ARRIVED_SPEED = 5e-3, 0.1
"""the drive counts as arrived within these of its target, rad and rad/s"""


_STILL = 1e-3
"""rad/s; below, friction is taken against the way that the drive is to go"""


class CircuitOracle:
    """Cascade output -> drive angle -> drive speed -> drive acceleration -> command.

    The drive angle that holds the reference is Eqs. (44)-(46) inverted in the direction of the reference. The drive
    goes there with the fastest approach it can brake from; the acceleration is put through the inverse of the drive:
    the servo (position mode) or the motor's inertia and the cables' torque (torque mode).
    """

    def __init__(self, rig: Mapping[str, float], gains: Mapping[str, float], action_mode: str, task: str, dt: float):
        self._model = CircuitModel(rig)
        self._model.require_contact(task)
        self._gains, self._dt = gains, dt
        self._torque_mode, self._torque_task = action_mode == "torque", task == "torque"
        ratio = rig.get("gear_ratio", 1.0)
        self._inertia, self._damping = (
            rig["drive_inertia"] + rig.get("motor_inertia", 0.0) * ratio**2,
            rig["drive_damping"],
        )
        self._friction, self._efficiency = rig.get("drive_friction", 0.0), rig.get("gear_efficiency", 1.0)
        self._speed = rig["drive_speed_limit"]
        self._servo = rig["servo_frequency"] ** 2, 2.0 * rig["servo_damping_ratio"] * rig["servo_frequency"]
        bound = rig["drive_torque_limit"] if self._torque_mode else rig["drive_angle_limit"]
        self._acceleration = bound / self._inertia if self._torque_mode else rig["drive_acceleration_limit"]
        self.low, self.high = -bound, bound
        self.reset()

    def reset(self) -> None:
        self._direction = 0.0
        self._last_ref: float | None = None
        self._last: float | None = None
        self._correction = 0.0
        self._arrived = False

    def act(self, y: Mapping[str, float], ref: Reference) -> float:
        """Command in the unit of the action mode, within the drive's limits."""
        g = self._gains
        angle, speed = y["drive_angle"], y["drive_velocity"]
        self._direction = follow_direction(self._direction, self._last_ref, ref)
        self._last_ref = ref[0]
        self._feed_back(y, ref)
        target, rate = self._torque_target(ref) if self._torque_task else self._position_target(ref)
        self._arrived = abs(target - angle) < _ARRIVED_ANGLE and abs(speed - rate) < _ARRIVED_SPEED
        error = target + rate * self._dt - angle - speed * self._dt
        wanted = rate + approach_speed(error, g["drive_gain"], g["braking"] * self._acceleration, self._speed)
        wanted = min(max(wanted, -self._speed), self._speed)
        acceleration = min(max(g["speed_gain"] * (wanted - speed), -self._acceleration), self._acceleration)
        if self._torque_mode:
            free = self._inertia * acceleration + self._damping * speed + y["drive_torque"]
            way = speed if abs(speed) > _STILL else wanted
            free += self._friction * ((way > 0.0) - (way < 0.0))
            free *= 1.0 / self._efficiency if free * way >= 0.0 else self._efficiency
            return min(max(free, self.low), self.high)
        return self._servo_command(angle, speed, acceleration)

    def _feed_back(self, y: Mapping[str, float], ref: Reference) -> None:
        """What is left once the drive has arrived: integrated, and on a constant reference approached from its side.

        While the drive is on its way the error says nothing about the model. An output beyond a constant reference is
        held there by friction: only the working phase of the other direction brings it back.
        """
        if not self._arrived:
            return
        if self._torque_task:
            error = (ref[0] - y["output_torque"]) * self._compliance()
        else:
            error = ref[0] - y["output_angle"]
        if ref[1] == 0.0 and abs(error) > self._gains["tolerance"]:
            self._direction = 1.0 if error > 0.0 else -1.0
        limit = self._gains["correction_limit"]
        self._correction += self._gains["output_gain"] * error * self._dt
        self._correction = min(max(self._correction, -limit), limit)

    def _position_target(self, ref: Reference) -> tuple[float, float]:
        """(drive angle that holds the reference angle, its rate)."""
        model = self._model
        elongation = self._elongation(model.load_torque(ref[0], ref[1], ref[2]))
        return model.drive_angle(ref[0] + elongation + self._correction), model.drive_angle(ref[1])

    def _torque_target(self, ref: Reference) -> tuple[float, float]:
        """(drive angle that presses the object with the reference torque, its rate)."""
        model = self._model
        angle = model.grasp_angle(ref[0]) + self._elongation(ref[0]) + self._correction
        return model.drive_angle(angle), model.drive_angle(ref[1] * self._compliance())

    def _compliance(self) -> float:
        """Output angle per output torque of the object and the cables, rad/(N m)."""
        model = self._model
        phase = model.phase(self._direction)
        return model.contact_compliance + phase.elongation(1.0) - phase.elongation(0.0)

    def _elongation(self, output_torque: float) -> float:
        if self._direction == 0.0:
            return self._model.middle_elongation(output_torque)
        return self._model.phase(self._direction).elongation(output_torque)

    def _servo_command(self, angle: float, speed: float, acceleration: float) -> float:
        """Angle command for which the servo accelerates so: a = k (u - theta) + d (u' - theta') inverted."""
        k, d_rate = self._servo[0], self._servo[1] / self._dt
        last = angle if self._last is None else self._last
        ahead = angle + 0.5 * self._dt * speed
        free = (acceleration + k * ahead + self._servo[1] * speed + d_rate * last) / (k + d_rate)
        self._last = min(max(free, self.low), self.high)
        return self._last
