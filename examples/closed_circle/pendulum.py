"""The user's simulator: a MuJoCo model of a pendulum that a tendon over a pulley pulls up, and its declaration."""

import copy

import mujoco
import numpy as np
from mujoco import rollout

from cable_envs.diagnosis.simulators import (
    Command,
    Declaration,
    ForcePort,
    FunctionSimulator,
    Output,
    SimulatorParameter,
)

PERIOD, LENGTH, PULLEY, GRAVITY, MOST = 0.02, 0.3, 0.04, 9.81, 40.0  # s, m, m, m/s^2, N
MODEL = """<mujoco model="tendon_pendulum">
  <option timestep="{step}" integrator="{integrator}"/>
  <worldbody>
    <site name="winch" pos="-0.4 0 0.04"/>
    <site name="above" pos="0 0 0.06"/>
    <geom name="pulley" type="cylinder" size="0.04 0.01" zaxis="0 1 0" contype="0" conaffinity="0"/>
    <body name="arm">
      <joint name="pivot" type="hinge" axis="0 -1 0" armature="{armature}" damping="{damping}" frictionloss="{friction}"
             solreffriction="{soft} 1"/>
      <geom name="bob" type="sphere" size="0.03" pos="0 0 -0.3" mass="{mass}" contype="0" conaffinity="0"/>
      <site name="clamp" pos="0.05 0 -0.3"/>
    </body>
  </worldbody>
  <tendon>
    <spatial name="cable">
      <site site="winch"/> <geom geom="pulley" sidesite="above"/> <site site="clamp"/>
    </spatial>
  </tendon>
  <actuator>
    <general name="tension" tendon="cable" gear="-1" ctrllimited="true" ctrlrange="0 40" {lag}/>
  </actuator>
</mujoco>
"""
BELIEVED = {"mass": 0.40, "armature": 0.004, "damping": 0.020}


def model(values, friction=0.0, lag=0.0):
    """The text of the model, with dry friction at the pivot (N m) and a first-order lag of the winch (s).

    MuJoCo's dry friction is a constraint with a time constant of two steps at least, so it takes short steps.
    """
    step, integrator = (PERIOD / 20, "implicitfast") if friction > 0.0 or lag > 0.0 else (PERIOD, "RK4")
    late = f'dyntype="filterexact" dynprm="{lag:.6g}"' if lag > 0.0 else ""
    numbers = {name: f"{values[name]:.6g}" for name in BELIEVED}
    numbers |= {"friction": f"{friction:.6g}", "step": step, "soft": 2 * step}
    return MODEL.format(**numbers, integrator=integrator, lag=late)


class Batch:
    """Copies of a MuJoCo model that take a step together; values: name -> [n], tensions [n, T], torques [n, T]."""

    INPUTS = int(mujoco.mjtState.mjSTATE_CTRL | mujoco.mjtState.mjSTATE_QFRC_APPLIED)

    def __init__(self, text, count, values=None, first=None):
        whole, made, self.models = mujoco.MjModel.from_xml_string(text), {}, []
        self.data, self.fine = mujoco.MjData(whole), round(PERIOD / whole.opt.timestep)
        for key in zip(*(values[name] for name in BELIEVED), strict=True) if values else [None] * count:
            if key not in made:  # columns of the same numbers share a model
                made[key] = copy.copy(whole)
                if key:
                    self._set(made[key], *key)
            self.models.append(made[key])
        mujoco.mj_resetData(whole, self.data)
        size = mujoco.mj_stateSize(whole, mujoco.mjtState.mjSTATE_FULLPHYSICS)
        self.state, self.runs = np.zeros((count, size)), rollout.Rollout(nthread=0)
        for place, name in ((1, "angle"), (2, "speed")):  # the state begins with the time
            self.state[:, place] = (first or {}).get(name, 0.0)

    def _set(self, one, mass, armature, damping):
        one.body_inertia[1] *= mass / one.body_mass[1]
        one.body_mass[1], one.dof_armature[0], one.dof_damping[0] = mass, armature, damping
        mujoco.mj_setConst(one, self.data)

    def step(self, tension, torque=0.0):
        """(angles, speeds), each [n, T], at the ends of T steps."""
        held = np.repeat(tension, self.fine, axis=1)
        control = np.stack([held, np.repeat(np.broadcast_to(torque, tension.shape), self.fine, axis=1)], axis=2)
        seen = np.empty((*held.shape, self.state.shape[1]))
        self.runs.rollout(
            self.models, [self.data], self.state, control, control_spec=self.INPUTS, skip_checks=True,
            nstep=held.shape[1], state=seen,
        )  # fmt: skip
        self.state = seen[:, -1].copy()
        return seen[:, self.fine - 1 :: self.fine, 1], seen[:, self.fine - 1 :: self.fine, 2]


def start(parameters, first):
    """The simulator of the diagnosis: begin runs at given angles and speeds [n]."""
    batch = Batch(model(BELIEVED), len(parameters["mass"]), parameters, first)
    return batch, {"angle": batch.state[:, 1].copy(), "speed": batch.state[:, 2].copy()}


def run(batch, commands, forces, parameters):
    """Steps of it: the winch's tension, and a torque at the pivot where physics may be added."""
    angle, speed = batch.step(commands["tension"], forces["pivot"])
    return batch, {"angle": angle, "speed": speed}


def simulator():
    """What the diagnosis is told of the MuJoCo model."""
    return FunctionSimulator(
        Declaration(
            name="tendon_pendulum",
            period=PERIOD,
            parameters=(
                SimulatorParameter("mass", "kg", BELIEVED["mass"], low=0.2, high=0.8, std=0.03),
                SimulatorParameter("armature", "kg m^2", BELIEVED["armature"], low=0.0, high=0.03, std=0.002),
                SimulatorParameter("damping", "N m s/rad", BELIEVED["damping"], low=0.0, high=0.2, std=0.01),
            ),
            commands=(Command("tension", "N"),),
            outputs=(Output("angle", "rad", starts=True), Output("speed", "rad/s", starts=True)),
            ports=(ForcePort("pivot", velocity="speed", position="angle"),),
        ),
        start,
        run,
    )


def written_back(found):
    """(text of the model with what was named, rows of effects that a MuJoCo model of this kind has no place for)."""
    values = {name: entry["value"] for name, entry in found.rig["parameters"].items()}
    friction, lag, left = 0.0, 0.0, []
    for effect, rows in found.rig.get("effects", {}).items():
        for row, entry in rows.items():
            if (effect, row) == ("coulomb_friction", "pivot.level"):
                friction = entry["value"]
            elif (effect, row) == ("viscous_friction", "pivot.coefficient"):
                values["damping"] += entry["value"]
            elif (effect, row) == ("actuator_lag", "tension.time"):
                lag = entry["value"]
            else:
                left.append(f"{effect}.{row}")
    return model(values, friction, lag), left
