"""Backlash compensation added to the reference, PID on the drive, torque saturator.  Eq. (49) and Fig. 7, Zou 2022."""

from collections.abc import Mapping
from typing import Any, ClassVar

from cable_envs.baselines.base import CIRCUITS, Controller, Reference
from cable_envs.baselines.circuit_model import CircuitModel
from cable_envs.baselines.general import SMOOTH, SteadyPid, pid_table, view_of
from cable_envs.baselines.parts import Pid, Smoother, follow_direction
from cable_envs.core.params import Parameter, ParameterTable

_EXCEEDED = 1.05
"""share of the grasp limit above which the saturator gives way"""
_RELEASE_TIME = 0.2
"""s; afterwards it lets the torque rise again slowly, or the drive's inertia would carry it beyond the limit again"""


def _gains(kp: tuple, ki: tuple, kd: tuple, filter_time: float, smooth_time: float) -> ParameterTable:
    """kp, ki, kd: (unit, default, high)."""
    return ParameterTable(
        Parameter("kp", kp[0], kp[1], 0.0, kp[2], "proportional gain"),
        Parameter("ki", ki[0], ki[1], 0.0, ki[2], "integral gain"),
        Parameter("kd", kd[0], kd[1], 0.0, kd[2], "derivative gain"),
        Parameter("filter_time", "s", filter_time, 0.0, 10.0, "time constant of the derivative's filter"),
        Parameter("smooth_time", "s", smooth_time, 0.0, 10.0, "time constant of jumps of reference and direction"),
        Parameter("estimate_time", "s", 0.05, 0.0, 20.0, "time constant of the estimated grasp torque"),
        Parameter("grasp_limit", "N m", 0.3, 0.005, 100.0, "estimated grasp torque at which the saturator holds",
                  "chosen: twice the torque of the paper's grasps"),
    )  # fmt: skip


class _DrivePid(Controller):
    """Fig. 7: reference (+ compensation) -> PID on the drive -> saturator fed by the estimated grasp torque.

    ====================  ================================================  ==============================
    case                  reference of the drive                            command
    ====================  ================================================  ==============================
    position, position    theta_in = (r + D) R5/R0                          angle + PID of the angle
    torque, position      the same                                          M_in + PID of the angle
    position, torque      theta_in = (contact + r/stiffness + D) R5/R0      angle + PID of the drive torque
    torque, torque        M_in that gives M_out = r                         M_in + PID of the drive torque
    ====================  ================================================  ==============================

    (action mode, task). D is dtheta_out of Eq. (45) in the direction of the reference, at the estimated load torque, so
    that D R5/R0 is theta_comp of Eq. (49); uncompensated, D = 0 and M_in = M_out R0/R5. The direction changes with the
    sign of the reference's rate, or with the sign of its jump, and is kept at rest. Nothing behind the drive is
    measured: the grasp torque is estimated from the drive torque (`CircuitModel.estimate`).

    Added to Fig. 7: jumps of the reference and changes of direction are spread over ``smooth_time``. Passed on as jumps
    they make the elastic drive overshoot, and the friction of the circuit keeps the output where it was carried to.
    """

    information = "nominal"
    charged: ClassVar = {"tuning_trials": 85}
    """for the compensated loop; the uncompensated one runs with the same gains and was never searched by itself"""
    plants = CIRCUITS
    tasks = ("position", "tension", "torque")
    compensates: ClassVar[bool]
    gain_tables: ClassVar = {
        # rounded from random searches (40, 85, 56, 64 trials) with compensation, on the nominal rig's step and sine
        ("circuit", "position", "position"): _gains(
            ("1", 0.1, 100.0), ("1/s", 1.0, 1e4), ("s", 0.0, 10.0), 0.02, 0.055
        ),
        # a larger ki winds up in a step
        ("circuit", "torque", "position"): _gains(
            ("N m/rad", 1.2, 1e3), ("N m/(rad s)", 1.0, 1e5), ("N m s/rad", 0.015, 30.0), 0.004, 0.05
        ),
        ("circuit", "position", "torque"): _gains(
            ("rad/(N m)", 0.1, 1e3), ("rad/(N m s)", 0.8, 1e5), ("rad s/(N m)", 0.0, 10.0), 0.02, 0.025
        ),
        # motor inertia on the cables' stiffness swings at about 120 rad/s: out of reach, so nothing may excite it
        ("circuit", "torque", "torque"): _gains(("1", 0.04, 100.0), ("1/s", 5.0, 1e4), ("s", 0.002, 10.0), 0.005, 0.05),
    }

    def use_rig(self, rig: Mapping[str, Any]) -> None:
        super().use_rig(rig)
        g = self.gains
        self._model = CircuitModel(self.rig)
        self._model.require_contact(self.task)
        self._pid = Pid(g["kp"], g["ki"], g["kd"], g["filter_time"], self.dt)
        self._reference, self._side = Smoother(self.dt, g["smooth_time"]), Smoother(self.dt, g["smooth_time"])
        self._law = self._position if self.task == "position" else self._torque
        limit = g["grasp_limit"]
        self._torque_range = self._model.cw.drive_torque(-limit), self._model.ccw.drive_torque(limit)

    def reset(self) -> None:
        self._pid.reset()
        self._reference.reset()
        self._side.reset()
        self._direction = 0.0
        self._last: float | None = None
        self.grasp: float | None = None
        """estimated grasp torque, N m; None before the first measurement"""
        self._smooth = 0.0
        self._allowed = self._torque_range
        """range of the drive torque that the saturator allows, N m"""

    def act(self, t: float, y: Mapping[str, float], ref: Reference) -> float:
        self._direction = follow_direction(self._direction, self._last, ref)
        self._last = ref[0]
        self._side.update(self._direction)
        self._estimate(y["drive_torque"])
        target, measured, rate, feedforward = self._law(y, (self._reference.update(ref[0], ref[1]), ref[1], ref[2]))
        low, high = self._saturate(y)
        return self._pid.update(target - measured, measured, rate, feedforward, low, high)

    def _estimate(self, drive_torque: float) -> None:
        """Grasp torque from the drive torque; an episode begins at rest with equal tension all along a cable."""
        if self.grasp is None:
            self.grasp = self._smooth = drive_torque / self._model.ratio
        self.grasp = self._model.estimate(self.grasp, drive_torque)
        self._smooth += (self.grasp - self._smooth) * self.dt / (self.dt + self.gains["estimate_time"])

    def _blend(self, cw: float, ccw: float) -> float:
        """Between both directions: a sudden change would make the elastic drive overshoot, and friction keeps that."""
        return cw + 0.5 * (1.0 + (self._side.value or 0.0)) * (ccw - cw)

    def _elongation(self, output_torque: float) -> float:
        if not self.compensates:
            return 0.0
        model = self._model
        return self._blend(model.cw.elongation(output_torque), model.ccw.elongation(output_torque))

    def _drive_torque(self, output_torque: float) -> float:
        model = self._model
        if not self.compensates:
            return output_torque * model.ratio
        return self._blend(model.cw.drive_torque(output_torque), model.ccw.drive_torque(output_torque))

    def _position(self, y: Mapping[str, float], ref: Reference) -> tuple[float, float, float, float]:
        model = self._model
        target = model.drive_angle(ref[0] + self._elongation(self._smooth))
        feedforward = target if self.action_mode == "position" else self._drive_torque(self._smooth)
        return target, y["drive_angle"], model.drive_angle(ref[1]), feedforward

    def _torque(self, y: Mapping[str, float], ref: Reference) -> tuple[float, float, float, float]:
        model = self._model
        target = self._drive_torque(ref[0])
        angle = model.drive_angle(model.grasp_angle(ref[0]) + self._elongation(ref[0]))
        return target, y["drive_torque"], ref[1] * model.ratio, angle if self.action_mode == "position" else target

    def _saturate(self, y: Mapping[str, float]) -> tuple[float, float]:
        """Range of the command that keeps the estimated grasp torque within its limit.

        The drive torque may reach the working line of the limit; once the limit is exceeded, only the other direction's
        line brings the output back. A position command is held by the cables' compliance from half the limit on.
        """
        model, limit, grasp = self._model, self.gains["grasp_limit"], self.grasp or 0.0
        share = self.dt / (self.dt + _RELEASE_TIME)
        low, high = (
            now + (free - now) * share for now, free in zip(self._allowed, self._torque_range, strict=True)
        )  # fmt: skip
        if grasp > _EXCEEDED * limit:
            high = min(high, model.cw.drive_torque(limit))
        elif grasp < -_EXCEEDED * limit:
            low = max(low, model.ccw.drive_torque(-limit))
        self._allowed = low, high
        if self.action_mode == "position":
            per_torque = model.drive_angle(model.phase(grasp).compliance())
            high = y["drive_angle"] + (high - y["drive_torque"]) * per_torque if grasp > 0.5 * limit else self.high
            low = y["drive_angle"] + (low - y["drive_torque"]) * per_torque if grasp < -0.5 * limit else self.low
        return max(low, self.low), min(high, self.high)


class FeedforwardPid(_DrivePid):
    __doc__ = f"Backlash compensation with PID and torque saturator (Z49, Fig. 7). {_DrivePid.__doc__}"
    name = "feedforward-pid"
    compensates = True
    general = True

    @classmethod
    def parameters_for(cls, plant: str, action_mode: str, task: str) -> ParameterTable:
        """The tunable gains; of a plant with a view those that the view declares."""
        if plant in cls.plants:
            return super().parameters_for(plant, action_mode, task)
        cls.check_case(plant, action_mode, task)
        return pid_table(plant, action_mode, task, *SMOOTH)

    def use_rig(self, rig: Mapping[str, Any]) -> None:
        self._general: SteadyPid | None = None
        if self.plant in self.plants:
            return super().use_rig(rig)
        Controller.use_rig(self, rig)
        view = view_of(self.plant, self.rig, self.action_mode, self.task)
        self._general = SteadyPid(view, self.gains, self.dt, compensates=True)
        return None

    def reset(self) -> None:
        if self._general is None:
            super().reset()
        else:
            self._general.reset()

    def act(self, t: float, y: Mapping[str, float], ref: Reference) -> float:
        if self._general is None:
            return super().act(t, y, ref)
        return self._general.act(y, ref, self.low, self.high)


class UncompensatedPid(_DrivePid):
    __doc__ = f"The same loop without compensation: what the paper compares with. {_DrivePid.__doc__}"
    name = "uncompensated-pid"
    compensates = False
