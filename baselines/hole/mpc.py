"""Nonlinear model predictive control of the load on the nominal plant, with CasADi.

Every control period the commands of the next `HORIZON` steps are found that minimise

    sum ((y - r) / x_weight)^2 + ((v - r') / v_weight)^2 + (change of F / f_weight)^2

within the drive's range and the safety limit, and the first one acts. The states (drive position, load position, load
speed) obey the plant's own equations of motion with a smooth friction (`cable_envs.model(rig).casadi()`) by the
trapezoidal rule. The references of the coming steps are those of the present one with its rate and acceleration. One
step of sequential quadratic programming is made a period, from the solution of the step before (real-time iteration;
Diehl et al. 2002). A disturbance that is estimated from the speed that was not expected makes it free of offset.

Needs ``pip install 'cable-envs[casadi]'``.
"""

from collections.abc import Mapping
from importlib import import_module
from importlib.util import find_spec
from typing import Any, ClassVar

import numpy as np

from cable_envs.baselines.base import HOLE, Controller, Reference
from cable_envs.baselines.hole.inverse import TENSION_SHARE
from cable_envs.continuous.models import model
from cable_envs.core.errors import ConfigurationError
from cable_envs.core.params import Parameter, ParameterTable

HORIZON = 10
OPTIONS = {
    "print_time": False, "print_header": False, "print_iteration": False, "print_status": False, "max_iter": 2,
    "error_on_fail": False, "qpsol": "qrqp", "hessian_approximation": "exact", "convexify_strategy": "regularize",
    "qpsol_options": {"print_iter": False, "print_header": False, "print_info": False, "error_on_fail": False},
}  # fmt: skip
STATES = ("drive_position", "load_position", "load_velocity")


def _installed() -> bool:
    try:
        return find_spec("casadi") is not None
    except ImportError:  # a finder that refuses it
        return False


class Mpc(Controller):
    """Nonlinear model predictive controller of the nominal hole."""

    name = "mpc"
    charged: ClassVar = {"tuning_trials": 1}
    information = "nominal"
    plants = (HOLE,)
    tasks = ("position",)
    modes: ClassVar = ("tension",)
    gain_tables: ClassVar = {
        ("hole", "tension", "position"): ParameterTable(
            Parameter("x_weight", "m", 1e-4, 1e-8, 1.0, "error of the position that costs 1"),
            Parameter("v_weight", "m/s", 1e-2, 1e-6, 10.0, "error of the speed that costs 1"),
            Parameter("f_weight", "N", 10.0, 1e-3, 1e5, "change of the command in a step that costs 1"),
            Parameter("smooth", "m/s", 1e-3, 1e-6, 0.1, "speed over which the friction turns round"),
            Parameter("observer", "1", 0.03, 1e-5, 1.0, "share of an unexpected speed that the disturbance takes over"),
        )
    }

    @classmethod
    def check_case(cls, plant: str, action_mode: str, task: str) -> None:
        """As of `Controller`, and refuse to run where CasADi is not installed."""
        super().check_case(plant, action_mode, task)
        if not _installed():
            raise ConfigurationError("controller 'mpc' needs casadi: pip install 'cable-envs[casadi]'")

    def use_rig(self, rig: Mapping[str, Any]) -> None:
        super().use_rig(rig)
        if any(name.startswith("wrap_angle_") for name in self.rig):
            raise ConfigurationError("controller 'mpc' is made for one hole, not for several in series")
        self._model = model(
            {"schema": "cable-rig/1", "name": "nominal", "plant": self.plant, "parameters": dict(self.rig)}, "tension"
        )
        self._rest = float(self._model.rest(0.0)[1][0])
        self._top = min(self.high, TENSION_SHARE * self.rig["tension_limit"])
        self._solver, self._bounds = self._problem()

    def _problem(self) -> tuple[Any, dict[str, np.ndarray]]:
        """The quadratic programs' solver, and the bounds of its unknowns."""
        casadi, g, f = import_module("casadi"), self.gains, self._model.casadi(speed=self.gains["smooth"]).f
        x, u = casadi.SX.sym("x", 3, HORIZON + 1), casadi.SX.sym("u", 1, HORIZON)
        given = casadi.SX.sym("given", 5 + 2 * HORIZON)  # state, last command, disturbance, references
        before, push, wanted = given[3], given[4], casadi.reshape(given[5:], 2, HORIZON)
        cost, gaps = 0.0, [(x[:, 0] - given[:3]) * 1e3]
        for k in range(HORIZON):
            drive = casadi.vertcat(u[k], (u[k] - before) / self.dt, push)
            mean = 0.5 * (f(x[:, k], drive) + f(x[:, k + 1], drive))
            gaps.append((x[:, k + 1] - x[:, k] - self.dt * mean) * 1e3)
            cost += ((x[1, k + 1] - wanted[0, k]) / g["x_weight"]) ** 2
            cost += ((x[2, k + 1] - wanted[1, k]) / g["v_weight"]) ** 2 + ((u[k] - before) / g["f_weight"]) ** 2
            before = u[k]
        problem = {"x": casadi.vertcat(casadi.vec(x), casadi.vec(u)), "p": given, "f": cost, "g": casadi.vertcat(*gaps)}
        solver = casadi.nlpsol("mpc", "sqpmethod", problem, OPTIONS)
        free = np.full(3 * (HORIZON + 1), np.inf)
        return solver, {
            "lbx": np.append(-free, np.zeros(HORIZON)), "ubx": np.append(free, np.full(HORIZON, self._top)),
        }  # fmt: skip

    def reset(self) -> None:
        self._guess: np.ndarray | None = None
        self._before, self._expected = self._rest, 0.0
        self.disturbance = 0.0
        """estimated force on the load, N"""

    def act(self, t: float, y: Mapping[str, float], ref: Reference) -> float:
        state = [y[name] for name in STATES]
        ahead = self.dt * np.arange(1, HORIZON + 1)
        if self._guess is None:
            self._before = min(max(y["drive_tension"], 0.0), self._top)
            self._guess = np.append(np.tile(state, HORIZON + 1), np.full(HORIZON, self._before))
        else:
            self.disturbance += self.gains["observer"] * (state[2] - self._expected) * self.rig["load_mass"] / self.dt
        wanted = np.array([ref[0] + ref[1] * ahead + 0.5 * ref[2] * ahead**2, ref[1] + ref[2] * ahead])
        given = np.concatenate([state, [self._before, self.disturbance], wanted.T.ravel()])
        found = np.asarray(self._solver(x0=self._guess, p=given, lbg=0.0, ubg=0.0, **self._bounds)["x"]).ravel()
        if not np.all(np.isfinite(found)):
            found = np.append(np.tile(state, HORIZON + 1), np.full(HORIZON, self._before))
        self._guess, self._expected = found, float(found[5])
        self._before = min(max(float(found[3 * (HORIZON + 1)]), 0.0), self._top)
        return self._before
