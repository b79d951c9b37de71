"""Linear model predictive control of a load that hangs from a cable through a hole, as one small quadratic program.

The model is that of the nominal rig with its friction turned around: the drive's command is the tension that the load
should feel, times the hole's tension ratio in the direction in which the reference moves. What remains is a mass,
x'' = F / m, with a disturbance that an observer estimates from the measured speed (offset-free MPC). Every 10 ms the
forces of the next ``horizon`` steps are found that minimise

    sum (x - x_ref)^2 + ((v - v_ref) / v_weight)^2 + (effort (F - F_ref))^2    within the range of the drive,

condensed into a least-squares problem with bounds (`scipy.optimize.lsq_linear`), and the first one acts. The file
prints the root mean square of the tracking error (RMSE) beside those of the open loop and of PID with its gains as
shipped, in an episode with sensor noise.

    python examples/linear_mpc.py
"""

import argparse

import gymnasium as gym
import numpy as np
from scipy.optimize import lsq_linear

import cable_envs  # noqa: F401 (registers the environments)
from cable_envs.baselines.hole_model import HoleModel
from cablebench.entrants.entrant import controller_entrant
from cablebench.protocol.actors import ControllerActor
from cablebench.protocol.metrics import measure
from cablebench.run.evaluation import run_episode

ENV_ID = "cable_envs/CableHole-Position-Sine-v0"


class LinearMpc:
    """MPC of the nominal rig; ``act`` gives the drive's tension in N from measurements in SI.

    ``horizon``: steps; ``v_weight``: 1/s, speed error that weighs as much as 1 m; ``effort``: m/N, what a newton
    costs; ``gain``: share of an unexpected speed that the disturbance takes over at each step; ``soft``: m/s, speed of
    the reference below which the direction of friction fades.
    """

    def __init__(self, rig, dt, low, high, horizon=15, v_weight=100.0, effort=2e-6, gain=0.1, soft=0.0005):
        self.model, self.dt, self.low, self.high = HoleModel(rig), dt, low, high
        self.horizon, self.v_weight, self.gain, self.soft = horizon, v_weight, gain, soft
        k, m = np.arange(horizon), self.model.mass
        later = np.maximum(k[:, None] - k[None, :] + 1, 0) * (k[:, None] >= k[None, :])  # steps since force j began
        self.to_speed = np.where(later > 0, dt / m, 0.0)
        self.to_place = np.where(later > 0, (later - 0.5) * dt**2 / m, 0.0)
        self.matrix = np.vstack([self.to_place, self.to_speed / v_weight, effort * np.eye(horizon)])
        self.reset()

    def reset(self):
        self.expected, self.disturbance = None, 0.0

    def act(self, t, y, ref):
        x, v, dt = y["load_position"], y["load_velocity"], self.dt
        if self.expected is not None:
            self.disturbance += self.gain * (v - self.expected) * self.model.mass / dt
        ahead = dt * np.arange(1, self.horizon + 1)
        wanted_v = ref[1] + ref[2] * ahead
        wanted_x = ref[0] + ref[1] * ahead + 0.5 * ref[2] * ahead**2
        push = np.full(self.horizon, self.disturbance)
        free_x, free_v = x + v * ahead + self.to_place @ push, v + self.to_speed @ push
        usual = self.model.mass * ref[2] - self.disturbance
        effort = self.matrix[-1, -1]
        target = np.concatenate(
            [wanted_x - free_x, (wanted_v - free_v) / self.v_weight, effort * np.full(self.horizon, usual)]
        )
        lam = self.model.ratio(abs(ref[1]), y["drive_tension"], self.model.weight)
        lam = lam ** np.clip(ref[1] / self.soft, -1.0, 1.0)
        bounds = (self.low / lam - self.model.weight, self.high / lam - self.model.weight)
        force = lsq_linear(self.matrix, target, bounds).x[0]
        self.expected = v + (force + self.disturbance) / self.model.mass * dt
        return float(np.clip(lam * (self.model.weight + force), self.low, self.high))


def run(controller, seconds=20.0, seed=0):
    """RMSE in m of one episode; ``controller``: a name, or a class like `LinearMpc`."""
    env = gym.make(ENV_ID, duration=seconds, sensor_noise=True)
    setup = env.unwrapped.setup
    if isinstance(controller, str):
        actor = controller_entrant(controller).make(setup)
    else:
        actor = ControllerActor(controller(setup.rig.values, setup.control_period, setup.low, setup.high), setup)
    return measure(run_episode(env, actor, seed))["rmse"]


def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=20.0, help="length of each episode")
    chosen = parser.parse_args(arguments)
    for title, controller in (("open loop", "open-loop"), ("PID as shipped", "pid"), ("linear MPC", LinearMpc)):
        print(f"{title:15} RMSE {1e3 * run(controller, chosen.seconds):.3f} mm")


if __name__ == "__main__":
    main()
