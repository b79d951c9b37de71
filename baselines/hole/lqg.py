"""LQG: a Kalman filter for load and disturbance, and the quadratic regulator of the load, through the nominal inverse.

Position   states y, v, d:   y' = v,  v' = a + d,  d' = white noise;     measured: y, v
           command a = r'' - d + K (r - y, r' - v)
Tension    states T2, d:     T2(t + dt) = b T2 + (1 - b) (P + d);        measured: T2
           command P = r(t + lead) - d + K (r - T2)

The load behind the hole is linear in what pulls there; friction, its two directions and its speed are inverted with the
nominal n (`inverse.InverseHole`), and what that leaves is the disturbance. K comes from the discrete algebraic Riccati
equation with weights `q` on the error over that on the command, and the filter's gain from its dual with the
intensities of the noises (Anderson and Moore, Optimal Control, 1990). Both are constant: they are computed once.
"""

import math
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from scipy.linalg import solve_discrete_are

from cable_envs.baselines.base import Reference
from cable_envs.baselines.hole.inverse import LEAD, SLEW, InverseHole, direction_gains
from cable_envs.core.params import Parameter, ParameterTable


def regulator(a: np.ndarray, b: np.ndarray, q: np.ndarray, r: np.ndarray) -> np.ndarray:
    """K that minimises sum x' q x + u' r u for x(k + 1) = a x(k) + b u(k) with u = -K x.

    Parameters
    ----------
    a, b, q, r : ndarray
        Matrices of the system, weights of state and input.

    Returns
    -------
    ndarray, shape (inputs, states)
        K.

    Examples
    --------
    >>> one = np.eye(1)
    >>> float(regulator(one, one, one, one)[0, 0].round(3))  # the golden ratio's inverse
    0.618
    """
    p = solve_discrete_are(a, b, q, r)
    return np.linalg.solve(r + b.T @ p @ b, b.T @ p @ a)


def filter_gain(a: np.ndarray, c: np.ndarray, process: np.ndarray, noise: np.ndarray) -> np.ndarray:
    """Gain of the steady Kalman filter: x = x + gain (y - c x), for x(k + 1) = a x(k) + process noise.

    Parameters
    ----------
    a, c : ndarray
        Matrices of the system and of what is measured.
    process, noise : ndarray
        Covariances of the process noise in a step and of the measurements.

    Returns
    -------
    ndarray, shape (states, measurements)
        The gain of the correction.
    """
    p = solve_discrete_are(a.T, c.T, process, noise)
    return p @ c.T @ np.linalg.inv(c @ p @ c.T + noise)


class Lqg(InverseHole):
    """Kalman filter with a disturbance, linear-quadratic regulator, nominal inverse of the friction."""

    name = "lqg"
    charged: ClassVar = {"tuning_trials": 60}
    """for a case: on steps, sinusoids, multisines and random steps of nominal and randomised rigs"""
    gain_tables: ClassVar = {
        ("hole", "tension", "position"): ParameterTable(
            Parameter("q_position", "1/s^4", 1e7, 1.0, 1e14, "weight of the squared error over that of acceleration"),
            Parameter("q_velocity", "1/s^2", 1e3, 1e-3, 1e10, "weight of the squared error of the speed"),
            Parameter("jerk", "m/s^2.5", 5.0, 1e-4, 1e6, "intensity by which the disturbance walks"),
            Parameter("noise_position", "m", 1e-5, 1e-8, 0.1, "standard deviation of the measured position"),
            Parameter("noise_velocity", "m/s", 2e-4, 1e-7, 1.0, "standard deviation of the measured speed"),
            *direction_gains(10.0, 5e-4),
        ),
        ("hole", "tension", "tension"): ParameterTable(
            Parameter("q", "1", 1e-4, 1e-9, 1e6, "weight of the squared error over that of the pull"),
            Parameter("jerk", "N/sqrt(s)", 50.0, 1e-5, 1e9, "intensity by which the disturbance walks"),
            Parameter("noise", "N", 0.05, 1e-7, 1e5, "standard deviation of the measured tension"),
            Parameter("lag", "s", 4e-4, 1e-6, 10.0, "time constant by which the tension follows the pull"),
            LEAD,
            SLEW,
            *direction_gains(2.7e-3, 7.5e-5),
        ),
    }

    def use_rig(self, rig: Mapping[str, Any]) -> None:
        super().use_rig(rig)
        g, dt = self.gains, self.dt
        if self.task == "position":
            a = np.array([[1.0, dt], [0.0, 1.0]])
            b = np.array([[0.5 * dt * dt], [dt]])
            self._gain = regulator(a, b, np.diag([g["q_position"], g["q_velocity"]]), np.eye(1))[0].tolist()
            noise = np.diag([g["noise_position"] ** 2, g["noise_velocity"] ** 2])
            whole, seen, push = np.block([[a, b], [np.zeros((1, 2)), np.eye(1)]]), np.eye(2, 3), b
        else:
            keep = math.exp(-dt / g["lag"])
            a, b = np.array([[keep]]), np.array([[1.0 - keep]])
            self._gain = regulator(a, b, np.array([[g["q"]]]), np.eye(1))[0].tolist()
            whole, seen, push = np.array([[keep, 1.0 - keep], [0.0, 1.0]]), np.array([[1.0, 0.0]]), b
            noise = np.array([[g["noise"] ** 2]])
        walk = np.zeros_like(whole)
        walk[-1, -1] = g["jerk"] ** 2 * dt
        small = np.diag([1e-9 * v for v in np.diag(seen.T @ noise @ seen)])
        self._correct = filter_gain(whole, seen, walk + small, noise).tolist()
        self._whole, self._push = whole.tolist(), [*push[:, 0].tolist(), 0.0]

    def reset(self) -> None:
        super().reset()
        self.state: list[float] | None = None
        """estimated y, v, d (tension task: T2, d); None before the first measurement"""
        self._asked = 0.0

    def pull(self, y: Mapping[str, float], ref: Reference, error: float, wanted: float) -> float:
        g = self.gains
        if self.task == "position":
            y0, v, d = self._estimate((y["load_position"], y["load_velocity"]))
            asked = ref[2] - d + self._gain[0] * (ref[0] - y0) + self._gain[1] * (ref[1] - v)
            self._asked = asked
            return self._hole.resistance(ref[0], ref[1]) + self._hole.mass * asked
        tension, d = self._estimate((y["load_tension"],))
        self._asked = ref[0] + g["lead"] * ref[1] - d + self._gain[0] * (ref[0] - tension)
        return self._asked

    def _estimate(self, measured: tuple[float, ...]) -> list[float]:
        """The filter's step: what was expected, corrected by what is measured."""
        n = len(self._push)
        if self.state is None:
            self.state = [*measured, 0.0]
            return self.state
        last = self.state
        expected = [sum(self._whole[i][j] * last[j] for j in range(n)) + self._push[i] * self._asked for i in range(n)]
        missed = [seen - expected[k] for k, seen in enumerate(measured)]
        free = [e + sum(gain * m for gain, m in zip(row, missed, strict=True)) for e, row in
                zip(expected, self._correct, strict=True)]  # fmt: skip
        if self.saturated * (last[-1] - free[-1]) > 0.0:  # a command at its limit is no disturbance
            free[-1] = last[-1]
        self.state = free
        return free
