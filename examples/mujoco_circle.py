"""A MuJoCo model as one's own simulator, from a log of the real rig to a corrected model and a better controller.

A pendulum hangs on a pivot, and a tendon over a pulley pulls it up. The user's simulator is a MuJoCo model of it. The
"real" rig is another program: its own integrator in small steps, other masses, a bearing that sticks, a winch that
follows its command late, an encoder with counts and noise, and a logger with a clock of its own. Its log is diagnosed
with the MuJoCo model. What is named is written back into the model file, as `frictionloss` of the joint and as the
filter of the actuator. Both models then predict runs that no fit saw, and a controller is tuned on each and tried on
the real rig.

    python examples/mujoco_circle.py
    python examples/mujoco_circle.py --rigs 5
"""

import argparse
import copy
from pathlib import Path

import mujoco
import numpy as np
from mujoco import rollout
from scipy import stats

from cable_envs.diagnosis import Recording, diagnose
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


class Reality:
    """The real rig: a program without MuJoCo. Its numbers are drawn; nobody tells them to the diagnosis."""

    FINE, COUNT = 100, 2 * np.pi / 4096  # steps of 0.2 ms, and the encoder's angle of one count

    def __init__(self, rig, count, noise_seed):
        draw, self.rng = np.random.default_rng([25, rig]), np.random.default_rng([26, rig, noise_seed])
        self.mass, self.bearing, self.viscous = draw.normal(0.42, 0.01), 0.004, draw.normal(0.018, 0.002)
        self.friction, self.lag = draw.uniform(0.02, 0.05), draw.uniform(0.025, 0.05)  # concealed: N m, s
        self.angle, self.speed, self.pull = np.zeros(count), np.zeros(count), np.zeros(count)

    def step(self, tension):
        """What the encoder shows [n] after 20 ms under commanded tensions [n]."""
        h, inertia = PERIOD / self.FINE, self.bearing + self.mass * LENGTH**2
        for _ in range(self.FINE):
            late, self.pull = self.pull, self.pull - (np.clip(tension, 0.0, MOST) - self.pull) * np.expm1(-h / self.lag)
            weight = self.mass * GRAVITY * LENGTH * np.sin(self.angle)
            free = self.speed + h * (PULLEY * 0.5 * (late + self.pull) - weight - self.viscous * self.speed) / inertia
            self.speed = np.sign(free) * np.maximum(np.abs(free) - h * self.friction / inertia, 0.0)
            self.angle = self.angle + h * self.speed
        return self.COUNT * np.round((self.angle + self.rng.normal(0.0, 3e-4, len(self.angle))) / self.COUNT)


def commands(rng, seconds):
    """A tension to try: three sines about a mean, which begins softly, held for 20 ms each."""
    time = np.arange(round(seconds / PERIOD)) * PERIOD
    tension = 9.0 * np.minimum(time / 0.5, 1.0)
    for rate, size in ((rng.uniform(0.1, 0.3), 5.0), (rng.uniform(0.5, 1.2), 3.0), (rng.uniform(2.0, 4.0), 3.0)):
        tension = tension + size * np.sin(2 * np.pi * (rate * time + rng.uniform())) * np.minimum(time / 0.5, 1.0)
    return np.clip(tension, 0.0, MOST)


def log(rig, seconds=6.0):
    """A recording of the real rig: two runs to fit and one held out, on the logger's own clock."""
    rng, runs = np.random.default_rng([27, rig]), {}
    for name in ("one", "two", "other"):
        tension, real = commands(rng, seconds), Reality(rig, 1, noise_seed=len(runs))
        angle = np.array([0.0] + [real.step(tension[k : k + 1])[0] for k in range(len(tension))])
        time = np.arange(len(angle)) * PERIOD * (1.0 + 2e-5) + rng.normal(0.0, 1e-4, len(angle))
        runs[name] = {"time": time, "tension": np.append(tension, tension[-1]), "angle": angle}
    return Recording.from_arrays(
        "own", runs, units={"tension": "N", "angle": "rad"}, heldout="other", channels={"tension": {"hold": "step"}}
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


def models(found):
    """Name -> text of a MuJoCo model: as it was believed, refitted without new physics, and corrected."""
    refitted = {name: found.absorbed[name]["after_refit"] for name in BELIEVED}
    return {"believed": model(BELIEVED), "refitted": model(refitted), "corrected": written_back(found)[0]}


def predicted(text, rig, runs=8, seconds=6.0):
    """RMS error [runs] of a model's angle, rad, on runs of the real rig that are in no recording."""
    rng, real = np.random.default_rng([28, rig]), Reality(rig, runs, noise_seed=100)
    tension = np.stack([commands(rng, seconds) for _ in range(runs)])
    shown = np.stack([real.step(tension[:, k]) for k in range(tension.shape[1])], axis=1)
    return np.sqrt(np.mean((Batch(text, runs).step(tension)[0] - shown) ** 2, axis=1))


class Controller:
    """What the model says that a motion takes, looking ``lead`` s ahead, and a PD law; gains [n]: kp, kd, lead."""

    def __init__(self, text, gains):
        one = mujoco.MjModel.from_xml_string(text)
        self.mass, self.inertia = one.body_mass[1], one.dof_armature[0] + one.body_mass[1] * LENGTH**2
        self.damping, self.friction = one.dof_damping[0], one.dof_frictionloss[0]
        (self.kp, self.kd, self.lead), self.before, self.rate = gains, None, 0.0

    def act(self, time, shown, path):
        """Tensions [n] at a time, s, from the shown angles [n]; path: function of the time."""
        change = 0.0 if self.before is None else (shown - self.before) / PERIOD
        self.before, self.rate = shown, 0.5 * (self.rate + change)  # of counts, hence smoothed
        here, ahead = path(time), path(time + self.lead)
        torque = self.mass * GRAVITY * LENGTH * np.sin(ahead[0]) + self.inertia * ahead[2] + self.damping * ahead[1]
        torque = torque + self.friction * np.tanh(ahead[1] / 0.02)
        tension = torque / PULLEY + self.kp * (here[0] - shown) + self.kd * (here[1] - self.rate)
        return np.clip(tension, 0.0, MOST)


def path(seed, count):
    """Angles to follow [count], with rate and acceleration, as a function of the time (a number, or [count])."""
    rng = np.random.default_rng([29, seed])
    parts = [(rng.uniform(low, high, count), rng.uniform(0.0, 2 * np.pi, count), size)
             for low, high, size in ((0.6, 1.2, 0.25), (1.5, 3.0, 0.12))]  # fmt: skip

    def of(time):
        found = [0.5, 0.0, 0.0]
        for w, phase, size in parts:
            found[0] = found[0] + size * np.sin(w * time + phase)
            found[1] = found[1] + size * w * np.cos(w * time + phase)
            found[2] = found[2] - size * w**2 * np.sin(w * time + phase)
        return found

    return of


def followed(step, text, gains, along, seconds=5.0):
    """RMS error, rad, of each column [n] after the first second, under ``step``: tensions [n] -> shown angles [n]."""
    controller, shown, squares = Controller(text, gains), np.zeros(len(gains[0])), 0.0
    steps, begun = round(seconds / PERIOD), round(1.0 / PERIOD)
    for k in range(steps):
        shown = step(controller.act(k * PERIOD, shown, along))
        if k >= begun:
            squares = squares + (shown - along((k + 1) * PERIOD)[0]) ** 2
    return np.sqrt(squares / (steps - begun))


LOWEST, HIGHEST = np.array([1.0, 0.05, 0.0]), np.array([400.0, 40.0, 0.12])  # N/rad, N s/rad, s


def tuned(text, seed=0, tries=24, rounds=8, paths=3):
    """Gains [3] that follow best in a model, by the cross-entropy method (Rubinstein and Kroese 2004)."""
    rng, along = np.random.default_rng([30, seed]), path(seed, tries * paths)
    noise, count = np.random.default_rng([31, seed]), Reality.COUNT
    middle, spread = np.array([0.6, 0.5, 0.3]), np.array([0.25, 0.25, 0.25])  # of the way, in kp and kd by factors
    for _ in range(rounds):
        parts = np.clip(middle + spread * rng.normal(size=(tries, 3)), 0.0, 1.0)
        parts[0] = middle
        gains = np.repeat(_gains(parts), paths, axis=1)
        batch = Batch(text, tries * paths)

        def step(tension, batch=batch):
            angle = batch.step(tension[:, None])[0][:, 0] + noise.normal(0.0, 3e-4, tries * paths)
            return count * np.round(angle / count)  # the encoder is known from its data sheet

        errors = followed(step, text, gains, along).reshape(tries, paths).mean(axis=1)
        best = parts[np.argsort(errors)[: tries // 4]]
        middle, spread = best.mean(axis=0), best.std(axis=0) + 0.01
    return _gains(middle[None])[:, 0]


def _gains(parts):
    """Gains [3, n] from shares [n, 3] of the way from the lowest to the highest."""
    low, high = np.log(LOWEST[:2]), np.log(HIGHEST[:2])
    return np.vstack([np.exp(low + parts[:, :2] * (high - low)).T, LOWEST[2] + parts[:, 2] * (HIGHEST[2] - LOWEST[2])])


def tried(text, gains, rig, runs=8):
    """RMS error [runs], rad, on the real rig, along paths of which no tuning knew."""
    real = Reality(rig, runs, noise_seed=200)
    return followed(real.step, text, np.repeat(np.reshape(gains, (3, 1)), runs, axis=1), path(1000 + rig, runs))


def factor(before, after):
    """How many times as large, with a 95 % interval: pairs of runs, logarithms, Student's t."""
    logs = np.log(np.asarray(before) / np.asarray(after))
    half = stats.t.ppf(0.975, len(logs) - 1) * stats.sem(logs)
    return tuple(float(v) for v in np.exp([logs.mean(), logs.mean() - half, logs.mean() + half]))


def circle(rig, effects=None, tell=print):
    """Log, diagnosis, corrected model, prediction and controller of one real rig; ``effects``: all, or those to ask."""
    found, real = diagnose(log(rig), simulator=simulator(), effects=effects), Reality(rig, 1, 0)
    tell(f"rig {rig}: {found.verdict}; concealed: friction {real.friction:.4f} N m, lag {1e3 * real.lag:.1f} ms")
    for effect in found.effects:
        for name, e in effect.parameters.items():
            tell(f"  {effect.name}, {name}: {e.value:.4f} {e.unit} (95 %: {e.low:.4f} to {e.high:.4f})")
    texts, left = models(found), written_back(found)[1]
    tell(f"  no place in the model: {', '.join(left) or 'nothing'}")
    errors = {}
    for name, text in texts.items():
        gains = tuned(text)
        errors[name] = predicted(text, rig), tried(text, gains, rig)
        rms = [1e3 * float(np.sqrt(np.mean(e**2))) for e in errors[name]]
        tell(f"  {name:9s} predicts unseen runs to {rms[0]:5.1f} mrad; its controller follows to {rms[1]:5.1f} mrad")
    return texts["corrected"], errors


def told(errors_of_rigs):
    """By what factors the other models' errors are larger: over the runs of one rig, or over several rigs."""
    for k, what in enumerate(("prediction", "controller")):
        for other in ("believed", "refitted"):
            pairs = np.array([[errors[name][k] for name in (other, "corrected")] for errors in errors_of_rigs])
            if len(pairs) > 1:  # runs of one rig are alike: each rig counts once
                pairs = np.exp(np.log(pairs).mean(axis=2, keepdims=True))
            mean, low, high = factor(pairs[:, 0].ravel(), pairs[:, 1].ravel())
            print(f"{what}, {other} model: {mean:.1f} times the corrected one's error (95 %: {low:.1f} to {high:.1f})")


def main():
    """The circle, for one rig or several."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rigs", type=int, default=1, help="how many real rigs")
    parser.add_argument("--effects", nargs="*", help="look for these effects only")
    parser.add_argument("--out", default="pendulum_corrected.xml", help="where the corrected model of the last goes")
    asked = parser.parse_args()
    done = [circle(rig, asked.effects) for rig in range(asked.rigs)]
    Path(asked.out).write_text(done[-1][0], encoding="utf-8")
    told([errors for _, errors in done])


if __name__ == "__main__":
    main()
