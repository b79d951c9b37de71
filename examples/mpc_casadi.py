"""Nonlinear model predictive control of a load that hangs from a cable through a hole, with CasADi.

The model is the plant's own equations of motion with a smooth friction (`cable_envs.model(rig).casadi()`): the drive
with its inner tension loop, the cable, the hole and the load. Every 10 ms the commands F of the next ``horizon`` steps
are found that minimise

    sum ((x - x_ref) / x_weight)^2 + ((v - v_ref) / v_weight)^2 + ((change of F) / f_weight)^2

within the range of the drive, by IPOPT from the solution of the step before, and the first one acts. The states obey
the equations by the trapezoidal rule; a disturbance that an observer estimates from the measured speed makes it free
of offset. The file prints the root mean square of the tracking error (RMSE) beside that of PID with its gains as
shipped, in an episode with sensor noise.

    pip install 'cable-envs[casadi]'
    python examples/mpc_casadi.py
"""

import argparse
import time

import casadi
import gymnasium as gym
import numpy as np

import cable_envs
from cablebench.entrants.entrant import controller_entrant
from cablebench.protocol.actors import ControllerActor
from cablebench.protocol.metrics import measure
from cablebench.run.evaluation import run_episode

ENV_ID = "cable_envs/CableHole-Position-Sine-v1"
QUIET = {"print_time": False, "ipopt": {"print_level": 0, "sb": "yes", "max_iter": 30, "tol": 1e-4,
         "warm_start_init_point": "yes", "mu_init": 1e-3}}  # fmt: skip


class NonlinearMpc:
    """MPC of the nominal rig; ``act`` gives the drive's tension in N from measurements in SI.

    ``horizon``: steps; ``smooth``: m/s over which the friction turns round; ``x_weight``, ``v_weight``, ``f_weight``:
    m, m/s and N that cost the same; ``gain``: share of an unexpected speed that the disturbance takes over at each
    step.
    """

    def __init__(self, setup, horizon=10, smooth=1e-3, x_weight=1e-4, v_weight=1e-2, f_weight=10.0, gain=0.03):
        model = cable_envs.model(setup.rig, "tension")
        self.rest, self.mass = model.rest(0.0)[1][0], setup.rig.values["load_mass"]
        self.low, self.high = model.command_range
        self.dt, self.horizon, self.gain = setup.control_period, horizon, gain
        self.f = model.casadi(speed=smooth).f
        x, u = casadi.SX.sym("x", 3, horizon + 1), casadi.SX.sym("u", 1, horizon)
        given = casadi.SX.sym("given", 3 + 2 + 2 * horizon)  # state, last command, disturbance, references
        before, push, wanted = given[3], given[4], casadi.reshape(given[5:], 2, horizon)
        cost, gaps = 0.0, [x[:, 0] - given[:3]]
        for k in range(horizon):
            rates = self._mean(x[:, k], x[:, k + 1], u[k], before, push)
            gaps.append((x[:, k + 1] - x[:, k] - self.dt * rates) * 1e3)
            cost += ((x[1, k + 1] - wanted[0, k]) / x_weight) ** 2 + ((x[2, k + 1] - wanted[1, k]) / v_weight) ** 2
            cost += ((u[k] - before) / f_weight) ** 2
            before = u[k]
        z = casadi.vertcat(casadi.vec(x), casadi.vec(u))
        problem = {"x": z, "p": given, "f": cost, "g": casadi.vertcat(*gaps)}
        self.solver = casadi.nlpsol("mpc", "ipopt", problem, QUIET)
        free = np.full(3 * (horizon + 1), np.inf)
        self.bounds = {
            "lbx": np.append(-free, np.full(horizon, self.low)),
            "ubx": np.append(free, np.full(horizon, self.high)),
        }
        self.reset()

    def _mean(self, x, later, command, before, push):
        """Mean rates over a step by the trapezoidal rule."""
        u = casadi.vertcat(command, (command - before) / self.dt, push)
        return 0.5 * (self.f(x, u) + self.f(later, u))

    def reset(self):
        self.guess, self.before, self.disturbance, self.expected = None, self.rest, 0.0, None

    def act(self, t, y, ref):
        state = np.array([y["drive_position"], y["load_position"], y["load_velocity"]])
        if self.expected is not None:
            self.disturbance += self.gain * (state[2] - self.expected) * self.mass / self.dt
        ahead = self.dt * np.arange(1, self.horizon + 1)
        wanted = np.array([ref[0] + ref[1] * ahead + 0.5 * ref[2] * ahead**2, ref[1] + ref[2] * ahead])
        if self.guess is None:
            self.guess = np.append(np.tile(state, self.horizon + 1), np.full(self.horizon, self.before))
        given = np.concatenate([state, [self.before, self.disturbance], wanted.T.ravel()])
        found = np.array(self.solver(x0=self.guess, p=given, lbg=0.0, ubg=0.0, **self.bounds)["x"]).ravel()
        self.guess, self.expected = found, found[5]
        self.before = float(np.clip(found[3 * (self.horizon + 1)], self.low, self.high))
        return self.before


def run(controller, seconds=10.0, seed=0):
    """(RMSE in m of one episode, mean time of a step in s); ``controller``: a name, or a class like `NonlinearMpc`."""
    env = gym.make(ENV_ID, duration=seconds, sensor_noise=True)
    setup = env.unwrapped.setup
    named = isinstance(controller, str)
    actor = controller_entrant(controller).make(setup) if named else ControllerActor(controller(setup), setup)
    start = time.perf_counter()
    rmse = measure(run_episode(env, actor, seed))["rmse"]
    return rmse, (time.perf_counter() - start) * setup.control_period / seconds


def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=10.0, help="length of each episode")
    chosen = parser.parse_args(arguments)
    for title, controller in (("PID as shipped", "pid"), ("nonlinear MPC", NonlinearMpc)):
        rmse, took = run(controller, chosen.seconds)
        print(f"{title:15} RMSE {1e3 * rmse:.3f} mm, {1e3 * took:.1f} ms a step")


if __name__ == "__main__":
    main()
