"""A controller written by hand: the capstan equation as feedforward, and feedback for what it leaves.

A cable that is hauled around an edge needs more tension than the load (the tension ratio lambda > 1), and less while it
is paid out (1 / lambda). Knowing lambda for the nominal rig, the drive can be told the tension before any error arises;
a proportional, integral and derivative feedback corrects the rest. The file prints the root mean square of the tracking
error (RMSE) in mm of an episode with sensor noise, on the paper's rig, without and with the feedforward.

    python examples/controller_by_hand.py

It needs nothing of Gymnasium and is a submission as it stands:

    cablebench submit examples/controller_by_hand.py --check-only --trust
"""

import argparse

from cable_envs.physics.contact import extrusion_coefficient, tension_ratio

name = "capstan-by-hand"
information = "nominal"
observe = "output"
tasks = ["CableHole-Position-Step", "CableHole-Position-Sine"]


class CapstanFeedforward:
    """Tension of the load times the ratio of the hole in the direction of motion, and PID on the measured position.

    ``kp``, ``ki``, ``kd``: gains in N/m, N/(m s) and N s/m. ``friction``: share of the hole's friction that the
    feedforward compensates. ``soft``: speed in m/s below which the direction fades, so that a reversal is no jump.
    """

    def __init__(self, kp=8000.0, ki=60000.0, kd=200.0, friction=1.0, soft=0.0005):
        self.kp, self.ki, self.kd, self.friction, self.soft = kp, ki, kd, friction, soft

    def reset(self, about):
        """Begin an episode; ``about`` holds the nominal rig, the control period and the range of the command."""
        self.rig, self.dt, self.low, self.high = about["rig"], about["dt"], about["low"], about["high"]
        self.integral = 0.0

    def ratio(self, speed):
        """Drive tension over load tension while the cable slides with ``speed``, m/s; positive while hauling."""
        rig = self.rig
        extruded = extrusion_coefficient(rig["extrusion_gain"], rig["extrusion_exponent"], abs(speed))
        edge = rig["radius_ratio"] * (1.0 + rig["extrusion_delta"])
        lam = tension_ratio(edge, rig["friction_coefficient"] + extruded, rig["wrap_angle"])
        direction = max(-1.0, min(1.0, speed / self.soft))
        return lam ** (self.friction * direction)

    def act(self, t, y, ref):
        """The command, N; ``y``: measurements by name; ``ref``: reference with its rate and acceleration; all SI."""
        position, velocity, acceleration = ref
        error = position - y["load_position"]
        self.integral += error * self.dt
        load = self.rig["load_mass"] * (self.rig["gravity"] + acceleration)
        feedback = self.kp * error + self.ki * self.integral + self.kd * (velocity - y["load_velocity"])
        return min(max(load * self.ratio(velocity) + feedback, self.low), self.high)


def run(controller, seconds=20.0, seed=0, env_id="cable_envs/CableHole-Position-Sine-v0"):
    """RMSE in m of one episode of a task of the hole."""
    import gymnasium as gym
    import numpy as np

    import cable_envs  # noqa: F401 (registers the environments)

    env = gym.make(env_id, observe=observe, sensor_noise=True, duration=seconds)
    core, errors, done = env.unwrapped, [], False
    observation, _ = env.reset(seed=seed)
    low, high = core.setup.low, core.setup.high
    controller.reset({"rig": core.setup.rig.values, "dt": core.setup.control_period, "low": low, "high": high})
    while not done:
        y = {c.name: v * c.scale for c, v in zip(core.channels, observation.tolist())}
        ref = (y["reference"], y["reference_rate"], y["reference_acceleration"])
        command = controller.act(len(errors) * core.setup.control_period, y, ref)
        action = np.array([2.0 * (command - low) / (high - low) - 1.0], np.float32)
        observation, _, terminated, truncated, info = env.step(action)
        errors.append(info["error"])
        done = terminated or truncated
    return float(np.sqrt(np.mean(np.square(errors))))


def main(arguments=None):
    """The command line of this file."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=20.0, help="length of each episode")
    chosen = parser.parse_args(arguments)
    for title, friction in (("feedback and weight", 0.0), ("and the friction of the hole", 1.0)):
        rmse = run(CapstanFeedforward(friction=friction), chosen.seconds)
        print(f"{title:30} RMSE {1e3 * rmse:.3f} mm")


if __name__ == "__main__":
    main()
