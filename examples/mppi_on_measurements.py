"""A planner for the board: it tries commands in the nominal simulator, and knows of the true rig what is measured.

`examples/mppi.py` plans from the true state of the true rig, which nobody has at a rig. This file is a submission like
any other (`cablebench submit`): it keeps a simulation of the nominal rig beside the real one, draws its state towards
the measurements after every step (an observer), and plans from there by model predictive path integral control
(Williams, Aldrich, Theodorou, J. Guid. Control Dyn. 40 (2017) 344). Of the reference it is told what every controller
is told: value, rate and acceleration of this instant, which it continues over its horizon.

    cablebench submit examples/mppi_on_measurements.py --trust
"""

import gymnasium as gym
import numpy as np

import cable_envs  # noqa: F401 (registers the environments)

name = "mppi-nominal"
information = "planner"
observe = "output"
tasks = ["CableHole-Position-Sine"]
charged = {"tuning_trials": 15}  # settings that were tried, on other seeds than the board's

ENV_ID = "cable_envs/CableHole-Position-Sine-v0"
OBSERVED = ("drive_position", "drive_velocity", "load_position", "load_velocity")


class Mppi:
    """MPPI on the nominal rig, from a state that follows the measurements.

    ``lanes`` sequences of ``horizon`` steps are tried; their changes to the present plan have the standard deviation
    ``spread`` in actions, and a share ``hold`` of each goes over into the next step. ``sharpness``: share of the mean
    cost above the least at which the weight falls to 1/e. ``trust``: share of a measurement's difference that the
    simulated state takes over; ``learn``: command, N, added for each m/s that the load was faster than simulated.
    """

    def __init__(self, lanes=128, horizon=10, spread=0.1, hold=0.8, sharpness=0.1, trust=0.9, learn=10.0, seed=0):
        self.lanes, self.horizon, self.spread, self.hold = int(lanes), int(horizon), spread, hold
        self.sharpness, self.trust, self.learn, self.seed = sharpness, trust, learn, int(seed)
        self.batch = None

    def reset(self, about):
        """Begin an episode at rest; the simulations are made once."""
        if self.batch is None:
            options = {"rig": about["rig"], "control_period": about["dt"], "duration": 100000 * about["dt"]}
            self.twin = gym.make(ENV_ID, **options).unwrapped
            made = gym.make_vec(
                ENV_ID, num_envs=self.lanes, vectorization_mode="vector_entry_point", step_infos=False,
                autoreset_mode="Disabled", **options,
            )  # fmt: skip
            self.batch = made.unwrapped
            setup = self.twin.setup
            self.rows = [setup.plant.row(signal) for signal in OBSERVED]
            self.output, self.scale = setup.task.output, setup.task.error_scale
        self.low, self.span, self.dt = about["low"], about["high"] - about["low"], about["dt"]
        self.rng = np.random.default_rng(self.seed)
        self.twin.reset(seed=self.seed)
        self.last, self.bias = None, 0.0

    def act(self, t, y, ref):
        """The command, N, that the best of the tried sequences begins with."""
        if self.last is None:
            at_rest = self.twin.simulation.buffers.named.action[0]
            self.plan = np.full(self.horizon, at_rest)
        else:
            self.twin.step(self.last + np.float32(self.bias))
        self.correct(y)
        action = self.planned(ref)
        self.last = np.array([action], np.float32)
        return self.low + 0.5 * (action + 1.0) * self.span

    def correct(self, y):
        """Draw the simulated state towards what is measured, and learn what the drive seems to lack or to have over."""
        state = self.twin.simulation.buffers.x
        self.bias += self.learn * (y["load_velocity"] - state[self.rows[-1], 0]) / self.span
        for row, signal in zip(self.rows, OBSERVED, strict=True):
            state[row, 0] += self.trust * (y[signal] - state[row, 0])

    def planned(self, ref):
        """The first action of the weighted mean of all sequences, which is the next plan."""
        changes = self.rng.normal(0.0, self.spread, (self.horizon, self.lanes))
        for k in range(1, self.horizon):
            changes[k] = self.hold * changes[k - 1] + np.sqrt(1.0 - self.hold**2) * changes[k]
        changes[:, 0] = 0.0  # the plan as it is
        tried = np.clip(self.plan[:, None] + changes, -1.0, 1.0)
        distance = self.costs(tried, ref)
        distance -= distance.min()
        weights = np.exp(-distance / max(self.sharpness * distance.mean(), 1e-300))
        plan = tried @ weights / weights.sum()
        self.plan = np.append(plan[1:], plan[-1])
        return float(plan[0])

    def costs(self, tried, ref):
        """Sum of squared errors of each sequence, over the task's scale of errors; a torn cable costs most."""
        self.batch.restore(self.twin.state())
        total = np.zeros(self.lanes)
        for k, actions in enumerate(tried):
            *_, terminated, _, _ = self.batch.step((actions[:, None] + self.bias).astype(np.float32))
            ahead = (k + 1) * self.dt
            wanted = ref[0] + ref[1] * ahead + 0.5 * ref[2] * ahead**2
            total += ((wanted - self.batch.infos()[self.output]) / self.scale) ** 2 + 1e6 * terminated
        return total
