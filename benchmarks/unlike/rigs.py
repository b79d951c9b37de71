"""The rigs. Each is drawn from a seed; the MuJoCo model of four of them is the only simulator of these here.

`RIGS` has them by name: seed -> `Log`. No number of them is used anywhere in the tool.
"""

from collections.abc import Callable

import mujoco
import numpy as np

from benchmarks.unlike.logs import CONTROL, Dialect, Log, Sensor, run, sines, text, trapezoids
from benchmarks.unlike.sheath import catheter, worn_catheter
from benchmarks.unlike.touch import needle, probe

DEG, MM = 180.0 / np.pi, 1e3
_HARD = "0.9999 0.9999 0.001"
"""Impedance of a dry friction whose force is full from 1 or 2 % of the speeds of the beam's motions on."""


def _model(body: str, rest: str, step: float = 5e-4) -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(
        f'<mujoco><option timestep="{step}" integrator="implicitfast"><flag contact="disable"/></option>'
        f'<default><joint solreffriction="{2 * step} 1"/></default><worldbody>{body}</worldbody>{rest}</mujoco>'
    )


def rotary(seed: int) -> Log:
    """An arm on a geared DC motor: voltage, current with its inductance, gravity, dry friction of the gear."""
    rng = np.random.default_rng([1, seed])
    mass, length, inertia = rng.uniform(0.5, 1.5), rng.uniform(0.15, 0.35), rng.uniform(0.01, 0.03)
    gear, k, resistance, inductance = rng.uniform(40, 80), rng.uniform(0.02, 0.04), rng.uniform(0.8, 2.0), 1.5e-3
    friction, viscous = rng.uniform(0.08, 0.3), rng.uniform(0.02, 0.06)
    model = _model(
        f'<body><joint name="q" type="hinge" axis="0 -1 0" armature="{inertia}" damping="{viscous}" '
        f'frictionloss="{friction}"/><geom type="sphere" size="0.001" pos="0 0 {-length}" mass="{mass}"/></body>',
        '<actuator><motor joint="q"/></actuator>',
    )
    kp, kd, state = rng.uniform(40, 80), rng.uniform(1.0, 2.0), {"u": 0.0, "i": 0.0, "r": 0.0}

    def electric(time: float, data: mujoco.MjData) -> None:
        step = model.opt.timestep
        slope = (state["u"] - resistance * state["i"] - k * gear * data.qvel[0]) / inductance
        state["i"] += slope * step / (1.0 + step * resistance / inductance)
        data.ctrl[0] = k * gear * state["i"]

    files = {}
    motions = {
        "run1.csv": sines(rng, 0.3, ((0.5, 0.1, 0.3), (0.2, 0.5, 1.0))),
        "run2.csv": trapezoids(rng, 0.2, 0.9, rng.uniform(0.6, 1.2), 0.7),
        "run3.csv": sines(rng, -0.2, ((0.6, 0.15, 0.35), (0.15, 0.7, 1.2))),
    }
    sensors = (
        Sensor("angle_deg", DEG, 0.01, 360.0 / 8192, digits=4),
        Sensor("speed_deg_s", DEG, 0.3, filtered=0.01, digits=2),
        Sensor("current_A", 1.0, 0.02, 0.005, digits=3), Sensor("voltage_V", 1.0, 0.0, 24.0 / 1000, digits=3),
        Sensor("target_deg", DEG, digits=3),
    )  # fmt: skip
    for name, motion in motions.items():
        state.update(u=0.0, i=0.0, r=0.0)

        def law(time: float, data: mujoco.MjData, motion=motion) -> None:
            state["r"] = motion(time)
            rate = (motion(time + 1e-4) - motion(time)) / 1e-4
            state["u"] = float(np.clip(kp * (state["r"] - data.qpos[0]) + kd * (rate - data.qvel[0]), -24.0, 24.0))

        seen = run(model, law, lambda d: (d.qpos[0], d.qvel[0], state["i"], state["u"], state["r"]), 12.0, electric)
        files[name] = text(seen, sensors, Dialect("t_ms", 1e3, 200.0), rng)
    owner = {
        "load_mass": (mass, "kg", None), "arm_length": (length, "m", None),
        "torque_constant": (k * gear, "N m/A", 0.05 * k * gear), "inertia": (1.15 * inertia, "kg m^2", 0.3 * inertia),
    }  # fmt: skip
    about = "An arm with a weight on a geared DC motor. Angle, speed, current, voltage of its controller, and target."
    return Log("rotary", about, files, "run3.csv", owner, {"coulomb_friction": (friction, "N m")})


def pulleys(seed: int) -> Log:
    """A winch hauls a weight on a guide by an elastic tendon over two pulleys that turn freely; the guide rubs."""
    rng = np.random.default_rng([2, seed])
    mass, stiffness, friction = rng.uniform(2.0, 6.0), rng.uniform(4e3, 1.5e4), rng.uniform(1.0, 4.0)
    viscous = rng.uniform(2.0, 6.0)
    body = (
        '<geom name="p1" type="cylinder" size="0.03 0.01" zaxis="0 1 0" pos="0.2 0 1"/>'
        '<site name="s1" pos="0.2 0 1.1"/>'
        '<geom name="p2" type="cylinder" size="0.03 0.01" zaxis="0 1 0" pos="0.6 0 1"/>'
        '<site name="s2" pos="0.6 0 1.1"/>'
        '<site name="between" pos="0.4 0 1.03"/>'
        '<body pos="0 0 1.03"><joint name="winch" type="slide" axis="-1 0 0" damping="50"/><site name="a"/>'
        '<geom type="sphere" size="0.01" mass="2"/></body>'
        f'<body pos="0.63 0 0.3"><joint name="load" type="slide" axis="0 0 1" damping="{viscous}" '
        f'frictionloss="{friction}"/><geom type="sphere" size="0.01" mass="{mass}"/><site name="b"/></body>'
    )
    damping = 2.0 * 0.05 * np.sqrt(stiffness * mass)
    route = (
        '<site site="a"/><geom geom="p1" sidesite="s1"/><site site="between"/><geom geom="p2" sidesite="s2"/>'
        '<site site="b"/></spatial></tendon>'
    )
    probe = _model(body, f'<tendon><spatial name="t">{route}')
    data = mujoco.MjData(probe)
    mujoco.mj_forward(probe, data)
    relaxed = float(data.ten_length[0]) - mass * 9.81 / stiffness
    model = _model(
        body,
        f'<tendon><spatial name="t" stiffness="{stiffness}" damping="{damping}" springlength="0 {relaxed}">{route}'
        '<actuator><motor joint="winch"/></actuator>',
    )
    files, state = {}, {"r": 0.0}
    motions = {
        "hoist_a.csv": trapezoids(rng, 0.08, 0.07, rng.uniform(0.03, 0.06), 0.6),
        "hoist_b.csv": sines(rng, 0.08, ((0.05, 0.1, 0.2), (0.01, 0.6, 1.0))),
        "hoist_c.csv": sines(rng, 0.09, ((0.04, 0.15, 0.3), (0.01, 0.5, 0.9))),
    }
    sensors = (
        Sensor("winch_mm", MM, 0.003, 0.01, digits=3), Sensor("pull_N", 1.0, 0.05, 0.02, digits=3),
        Sensor("weight_mm", MM, 0.02, 0.01, digits=3), Sensor("winch_target_mm", MM, digits=4),
    )  # fmt: skip
    for name, motion in motions.items():

        def law(time: float, data: mujoco.MjData, motion=motion) -> None:
            state["r"] = motion(time)
            rate = (motion(time + 1e-4) - motion(time)) / 1e-4
            data.ctrl[0] = mass * 9.81 + 2e4 * (state["r"] - data.qpos[0]) + 600.0 * (rate - data.qvel[0])

        def see(d: mujoco.MjData) -> tuple[float, ...]:
            pull = stiffness * max(d.ten_length[0] - relaxed, 0.0) + damping * d.ten_velocity[0]
            return d.qpos[0], max(pull, 0.0), d.qpos[1], state["r"]

        seen = run(model, law, see, 14.0)
        files[name] = text(seen, sensors, Dialect("time_s", 1.0, 100.0, 2e-4, -3e-5), rng)
    owner = {"load_mass": (mass, "kg", None), "wrap_angle": (90.0, "deg", None)}
    about = "A winch hauls a weight that slides on a guide, over two pulleys on ball bearings."
    truth = {"coulomb_friction": (friction, "N"), "cable_elongation": (stiffness, "N/m")}
    return Log("pulleys", about, files, "hoist_c.csv", owner, truth)


def continuum(seed: int) -> Log:
    """A flexible beam that a tendon along its side bends: twelve hinges with springs that rub a little."""
    rng = np.random.default_rng([3, seed])
    count, length, bending = 12, 0.2, rng.uniform(0.02, 0.05)  # m, N m^2
    side, rub = 0.006, rng.uniform(2e-3, 8e-3)
    hinge, link = bending * count / length, length / count
    body = '<site name="base" pos="0.006 0 0"/>'
    close = ""
    for k in range(count):
        body += (
            f'<body pos="0 0 {0.0 if k == 0 else link}"><joint name="j{k}" type="hinge" axis="0 1 0" '
            # of so light links MuJoCo's usual impedance makes a drag of 4 % of the friction, and nothing that sticks
            f'stiffness="{hinge}" damping="{hinge * 0.01}" frictionloss="{rub}" solimpfriction="{_HARD}"/>'
            f'<geom type="capsule" size="0.002" fromto="0 0 0 0 0 {link}" mass="0.004"/>'
            f'<site name="d{k}" pos="{side} 0 {0.5 * link}"/>'
        )
        close += "</body>"
    route = "".join(f'<site site="d{k}"/>' for k in range(count))
    model = _model(
        body + close + '<body pos="0.006 0 -0.1"><joint name="winch" type="slide" axis="0 0 -1" damping="20"/>'
        '<geom type="sphere" size="0.005" mass="0.3"/><site name="a"/></body>',
        f'<tendon><spatial name="t" stiffness="2e4" damping="10" springlength="0 {0.1 + length - 0.5 * link}">'
        f'<site site="a"/><site site="base"/>{route}</spatial></tendon><actuator><motor joint="winch"/></actuator>',
        2.5e-4,
    )  # fmt: skip
    place = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, "winch")
    relaxed, files, state = float(model.tendon_lengthspring[0, 1]), {}, {"r": 0.0}
    motions = {
        "bend1.txt": sines(rng, 0.004, ((0.002, 0.1, 0.2), (0.0005, 0.4, 0.8))),
        "bend2.txt": trapezoids(rng, 0.004, 0.003, 0.002, 0.5),
        "bend3.txt": sines(rng, 0.0035, ((0.0025, 0.1, 0.25), (0.0005, 0.4, 0.8))),
    }
    sensors = (
        Sensor("Seilweg [mm]", MM, 0.002, 0.001, digits=4), Sensor("Seilkraft [N]", 1.0, 0.02, 0.01, digits=3),
        Sensor("Spitzenwinkel [Grad]", DEG, 0.05, 0.02, digits=3),
    )  # fmt: skip
    for name, motion in motions.items():

        def law(time: float, data: mujoco.MjData, motion=motion) -> None:
            state["r"] = motion(time)
            data.ctrl[0] = 5e4 * (state["r"] - data.qpos[place]) - 200.0 * data.qvel[place]

        def see(d: mujoco.MjData) -> tuple[float, ...]:
            pull = 2e4 * max(d.ten_length[0] - relaxed, 0.0)
            return d.qpos[place], pull, float(np.sum(d.qpos[:count]))

        seen = run(model, law, see, 12.0)
        dialect = Dialect("Zeit [s]", 1.0, 100.0, delimiter=";", decimal=",", preamble=("Kontinuum, Versuch", "v1.2"))
        files[name] = text(seen, sensors, dialect, rng)
    about = (
        "A flexible arm of 200 mm that a tendon along its side bends. Tendon's travel and tension, angle of the tip."
    )
    truth = {"internal_friction_of_the_beam": (rub, "N m")}
    return Log("continuum", about, files, "bend3.txt", {"length": (length, "m", None)}, truth)


def belt(seed: int) -> Log:
    """A carriage on an elastic belt, with a motor whose encoder its controller uses; the carriage's rails rub."""
    rng = np.random.default_rng([4, seed])
    radius, rotor, mass = 0.02, rng.uniform(2e-4, 6e-4), rng.uniform(3.0, 8.0)
    stiffness, friction, viscous = rng.uniform(3e4, 1e5), rng.uniform(4.0, 12.0), rng.uniform(10.0, 30.0)
    damping = 2.0 * 0.03 * np.sqrt(stiffness * mass)
    model = _model(
        f'<body><joint name="motor" type="hinge" axis="0 1 0" armature="{rotor}"/><geom type="sphere" size="0.001" '
        f'mass="1e-6"/></body><body pos="0 0.1 0"><joint name="x" type="slide" axis="1 0 0" damping="{viscous}" '
        f'frictionloss="{friction}"/><geom type="box" size="0.05 0.05 0.02" mass="{mass}"/></body>',
        f'<tendon><fixed name="belt" stiffness="{stiffness}" damping="{damping}">'
        f'<joint joint="motor" coef="{-radius}"/><joint joint="x" coef="1"/></fixed></tendon>'
        '<actuator><motor joint="motor"/></actuator>',
    )
    total = rotor + mass * radius**2
    w, state, files = rng.uniform(25.0, 40.0), {"r": 0.0}, {}
    motions = {
        "axis_01.csv": sines(rng, 0.0, ((0.15, 0.1, 0.3), (0.03, 0.8, 1.5))),
        "axis_02.csv": trapezoids(rng, 0.0, 0.2, rng.uniform(0.1, 0.3), 0.4),
        "axis_03.csv": sines(rng, 0.0, ((0.12, 0.2, 0.4), (0.03, 0.7, 1.3))),
    }
    sensors = (
        Sensor("x_mm", MM, 0.003, 0.005, digits=3), Sensor("motor_deg", DEG, 0.0, 360.0 / 10000, digits=3),
        Sensor("torque_Nm", 1.0, 0.004, 0.001, digits=4), Sensor("x_ref_mm", MM, digits=3),
    )  # fmt: skip
    for name, motion in motions.items():

        def law(time: float, data: mujoco.MjData, motion=motion) -> None:
            state["r"] = motion(time)
            rate = (motion(time + CONTROL / 10) - motion(time)) / (CONTROL / 10)
            error = w**2 * (state["r"] / radius - data.qpos[0]) + 1.6 * w * (rate / radius - data.qvel[0])
            data.ctrl[0] = float(np.clip(total * error, -5.0, 5.0))

        seen = run(model, law, lambda d: (d.qpos[1], d.qpos[0], d.ctrl[0], state["r"]), 12.0)
        files[name] = text(seen, sensors, Dialect("t_s", 1.0, 200.0, 5e-5), rng)
    owner = {
        "mass": (mass * 1.04, "kg", 0.05 * mass), "pulley_radius": (radius, "m", None),
        "rotor_inertia": (rotor, "kg m^2", 0.1 * rotor),
    }  # fmt: skip
    about = "A carriage on a toothed belt. Linear encoder, motor's encoder, motor's torque, target."
    truth = {"coulomb_friction": (friction, "N"), "cable_elongation": (stiffness, "N/m")}
    return Log("belt", about, files, "axis_03.csv", owner, truth)


RIGS: dict[str, Callable[[int], Log]] = {
    "rotary": rotary, "pulleys": pulleys, "continuum": continuum, "belt": belt,
    "catheter": catheter, "worn-catheter": worn_catheter, "probe": probe, "needle": needle,
}  # fmt: skip
