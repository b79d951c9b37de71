"""Oracle: true parameters, everything observed. Score 1 of the benchmark; no controller can have what it knows."""

from collections.abc import Mapping
from typing import Any, ClassVar

from cable_envs.baselines.base import HOLE, Controller, Levels, Reference
from cable_envs.baselines.general import SMOOTH, SteadyPid, pid_table, view_of
from cable_envs.baselines.oracle_circuit import CircuitOracle
from cable_envs.baselines.oracle_hole import HoleOracle
from cable_envs.core.params import Parameter, ParameterTable


def _hole_gains(output_gain: float, stretch_gain: float) -> ParameterTable:
    return ParameterTable(
        Parameter("output_gain", "1/s", output_gain, 0.1, 60.0, "speed wanted per output error (as slip of the cable)"),
        Parameter("speed_gain", "1/s", 60.0, 0.0, 100.0, "acceleration wanted per speed error"),
        Parameter("stretch_gain", "1/s", stretch_gain, 0.1, 90.0, "drive speed per missing stretch of the cable"),
        Parameter("braking", "1", 1.0, 0.01, 1.0, "share of the drive's acceleration used to brake"),
        Parameter("far_speed", "m/s", 0.04, 1e-3, 1.0, "approach speed above which the drive goes ahead of the load"),
        Parameter("rest_speed", "m/s", 1e-6, 0.0, 1e-3, "below this wanted speed the friction keeps its direction"),
    )


def _circuit_gains(drive_gain: float, speed_gain: float, braking: float) -> ParameterTable:
    return ParameterTable(
        Parameter("drive_gain", "1/s", drive_gain, 0.1, 90.0, "drive speed wanted per drive angle error"),
        Parameter("speed_gain", "1/s", speed_gain, 0.1, 100.0, "acceleration wanted per speed error"),
        Parameter("braking", "1", braking, 0.01, 1.0, "share of the drive's acceleration used to brake"),
        Parameter("output_gain", "1/s", 3.0, 0.0, 50.0, "integral gain of the output error"),
        Parameter("tolerance", "rad", 2e-3, 1e-5, 0.1, "output error beyond a constant reference that is brought back"),
        Parameter("correction_limit", "rad", 0.1, 0.0, 1.0, "largest correction by that integral"),
    )


class Oracle(Controller):
    """Exact inverse feedforward with the true parameters and feedback on the true output.

    `set_rig` replaces the model by the episode's true parameters; call it before `reset`.
    """

    name = "oracle"
    information = "oracle"
    charged: ClassVar = {"tuning_trials": 120}
    """on the nominal rig's step and sine, until it beat the other defaults: that it is best was a design goal"""
    general = True
    levels: ClassVar = Levels({}, "full")
    gain_tables: ClassVar = {
        ("hole", "tension", "position"): _hole_gains(30.0, 55.0),
        ("hole", "speed", "position"): _hole_gains(30.0, 55.0),
        ("hole", "tension", "tension"): _hole_gains(20.0, 40.0),  # light carriage: the tension loop sets the pace
        ("hole", "speed", "tension"): _hole_gains(20.0, 40.0),
        ("circuit", "position", "position"): _circuit_gains(42.0, 80.0, 0.5),
        ("circuit", "position", "torque"): _circuit_gains(60.0, 90.0, 0.5),
        ("circuit", "torque", "position"): _circuit_gains(58.0, 98.0, 0.3),
        ("circuit", "torque", "torque"): _circuit_gains(70.0, 85.0, 0.35),
    }

    def set_rig(self, rig: Mapping[str, Any]) -> None:
        self.use_rig(rig)

    @classmethod
    def parameters_for(cls, plant: str, action_mode: str, task: str) -> ParameterTable:
        """The tunable gains; of a plant with a view those that the view declares."""
        if plant in cls.plants:
            return super().parameters_for(plant, action_mode, task)
        cls.check_case(plant, action_mode, task)
        return pid_table(plant, action_mode, task, *SMOOTH)

    def use_rig(self, rig: Mapping[str, Any]) -> None:
        super().use_rig(rig)
        self._general: SteadyPid | None = None
        if self.plant not in self.plants:
            view = view_of(self.plant, self.rig, self.action_mode, self.task)
            self._general = SteadyPid(view, self.gains, self.dt, compensates=True)
            return
        law = HoleOracle if self.plant == HOLE else CircuitOracle
        self._law = law(self.rig, self.gains, self.action_mode, self.task, self.dt)

    def reset(self) -> None:
        (self._general or self._law).reset()

    def act(self, t: float, y: Mapping[str, float], ref: Reference) -> float:
        if self._general is not None:
            return self._general.act(y, ref, self.low, self.high)
        return self._law.act(y, ref)
