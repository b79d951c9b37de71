"""Linear drive and rotary joint as environments: against SciPy, alone and in a batch, and with a corrected rig."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from scipy.integrate import solve_ivp

from cable_envs.core.errors import ConfigurationError
from cable_envs.diagnosis import Recording
from cable_envs.diagnosis.systems import prepare
from cable_envs.diagnosis.systems.question import Request
from cable_envs.diagnosis.systems.stated.limits import untorn
from cable_envs.sim.registered import setup_of
from cable_envs.sim.rigs import load_rig
from cablebench.entrants.named import reference_entrants
from cablebench.protocol.metrics import measure
from cablebench.run.evaluation import run_episode

ENTRANTS = {e.name: e for e in reference_entrants()}
PERIOD, STEPS = 0.01, 200
IDS = [
    f"cable_envs/{task}-Position-{reference}-v1"
    for task in ("LinearDrive", "RotaryJoint")
    for reference in ("Step", "Sine")
]
SMOOTH = {"coulomb": 0.0}
"""Without dry friction, which SciPy's integrators take no notice of."""
SHARE = 0.3 * np.sin(2 * np.pi * 0.9 * np.arange(STEPS) * PERIOD)
"""Actions, held over a control period each."""


def played(env_id, actions, **options):
    """Infos of an episode of given actions, one of a name [T]."""
    env = gym.make(env_id, **options)
    env.reset(seed=0)
    infos = [env.step(np.array([a], np.float32))[4] for a in actions]
    return env.unwrapped, {name: np.array([info[name] for info in infos]) for name in infos[0]}


def integrated(rate, start, actions):
    """States at the ends of the control periods [T, n] of d/dt state = rate(state, action)."""
    state, found = np.array(start, dtype=float), []
    for a in np.asarray(actions, np.float32).astype(float):
        state = solve_ivp(lambda t, s, a=a: rate(s, a), (0.0, PERIOD), state, rtol=1e-9, atol=1e-12).y[:, -1]
        found.append(state)
    return np.array(found)


@pytest.mark.parametrize("mode", ["force", "voltage"])
def test_the_drive_is_what_scipy_integrates(mode):
    """Carriage and motor with the belt between them, on an axis that is tilted by 3 %."""
    env, found = played(IDS[1], SHARE, action_mode=mode, rig=SMOOTH | {"gravity_share": 0.03})
    p = env.simulation.lane_rig(0)
    most = p["force_limit"] if mode == "force" else p["voltage_limit"] * p["force_per_volt"]
    weight = p["mass"] * p["gravity"] * p["gravity_share"]

    def rate(s, a):
        y, v, ym, vm = s
        belt = p["belt_stiffness"] * (ym - y) + p["belt_damping"] * (vm - v)
        return v, (belt - p["viscous"] * v - weight) / p["mass"], vm, (most * a - belt) / p["motor_mass"]

    truth = integrated(rate, (0.0, 0.0, weight / p["belt_stiffness"], 0.0), SHARE)
    # second order: steps of 0.5 ms turn the belt's vibration by 0.17 rad
    assert np.abs(found["position"] - truth[:, 0]).max() < 2e-3 * np.ptp(truth[:, 0])
    assert np.abs(found["motor_position"] - truth[:, 2]).max() < 2e-3 * np.ptp(truth[:, 2])


@pytest.mark.parametrize("mode", ["torque", "current", "voltage", "duty"])
def test_the_joint_is_what_scipy_integrates(mode):
    """A pendulum that the motor turns by its torque or current, or by a voltage against the back-EMF."""
    env, found = played(IDS[3], SHARE, action_mode=mode, rig=SMOOTH)
    p = env.simulation.lane_rig(0)
    k, inertia = p["torque_constant"], p["inertia"] + p["load_mass"] * p["arm_length"] ** 2
    most = {"torque": p["torque_limit"], "current": k * p["current_limit"]}.get(mode)

    def rate(s, a):
        q, v = s
        motor = most * a if most else k * (p["supply_voltage"] * a - k * v) / p["resistance"]
        gravity = p["load_mass"] * p["gravity"] * p["arm_length"] * np.sin(q)
        return v, (motor - gravity - p["viscous"] * v) / inertia

    truth = integrated(rate, (0.0, 0.0), SHARE)
    assert np.abs(found["position"] - truth[:, 0]).max() < 1e-3 * np.ptp(truth[:, 0])
    assert np.all(found["overload"] == 0.0)  # nothing of it tears


def test_commands_of_the_motor_are_one_motor():
    """Torque, the current that makes it, and a voltage over the supply's are the same commands."""
    scale = load_rig("geared-arm").values
    torque = played(IDS[3], SHARE, action_mode="torque")[1]
    current = played(IDS[3], SHARE, action_mode="current")[1]
    assert scale["torque_limit"] == scale["torque_constant"] * scale["current_limit"]
    np.testing.assert_allclose(current["position"], torque["position"], rtol=1e-12)
    duty, voltage = (played(IDS[3], SHARE, action_mode=mode)[1] for mode in ("duty", "voltage"))
    np.testing.assert_allclose(voltage["position"], duty["position"], rtol=1e-12)
    np.testing.assert_allclose(voltage["voltage"], voltage["command"], rtol=1e-6)


@pytest.mark.parametrize("env_id", IDS)
def test_gymnasium_finds_nothing(env_id):
    check_env(gym.make(env_id).unwrapped, skip_render_check=True)


@pytest.mark.parametrize("env_id", [IDS[1], IDS[3]])
@pytest.mark.parametrize("heavier", [1.0, 10.0])
def test_reference_controllers_follow_with_any_inertia(env_id, heavier):
    """The PID asks for an acceleration. Where friction matters, who knows it follows at least twice as well."""
    values = setup_of(env_id, {}).rig.values
    rig = {name: heavier * values[name] for name in ("mass", "inertia") if name in values}
    found = {}
    for name in ("open-loop", "pid", "feedforward-pid"):
        env = gym.make(env_id, rig=rig)
        found[name] = measure(run_episode(env, ENTRANTS[name].make(env.unwrapped.setup), seed=1))["rmse"]
    assert max(found["pid"], found["feedforward-pid"]) < 0.1 * found["open-loop"], found
    assert heavier > 1.0 or found["feedforward-pid"] < 0.5 * found["pid"], found


def test_a_corrected_rig_of_another_plant_is_refused_by_name():
    with pytest.raises(ConfigurationError, match="needs a rig of plant linear_drive; geared-arm is of rotary_joint"):
        gym.make(IDS[0], rig="geared-arm")


def recorded(system, seconds=6.0):
    """A log of a drive or joint that SciPy integrates against a spring that the rig's numbers lack, and its rig.

    The effort is held over each sample, as an action is; what is returned can be asked, and made a corrected rig.
    """
    time = np.arange(0.0, seconds, PERIOD)
    joint = system == "rotary_joint"
    inertia, viscous, spring, size = (0.03, 0.4, 4.0, 1.7) if joint else (3.0, 30.0, 400.0, 21.0)
    effort = size * (np.sin(2.1 * time) + 0.5 * np.sin(7.3 * time))
    state, path = np.zeros(2), [np.zeros(2)]

    def law(t, s, push):
        return s[1], (push - viscous * s[1] - spring * s[0]) / inertia

    for push in effort[:-1]:
        state = solve_ivp(law, (0.0, PERIOD), state, args=(push,), rtol=1e-9, atol=1e-12).y[:, -1]
        path.append(state)
    table = {"time": time, "position": np.array(path)[:, 0], "torque" if joint else "force": effort}
    stated = {"inertia": inertia, "load_mass": 0.0} if joint else {"mass": inertia}
    recording = Recording.from_arrays(system, {"run": table}, known=stated)
    found = {"viscous_friction.coefficient": viscous, "position_dependent_load.stiffness": spring}
    question = prepare(recording, Request(only=("viscous_friction", "position_dependent_load")))
    return table, question.rig(found, ("viscous_friction", "position_dependent_load"))


@pytest.mark.parametrize(("system", "effort", "most"), [
    ("linear_drive", "force", "force_limit"), ("rotary_joint", "torque", "torque_limit"),
])  # fmt: skip
def test_a_corrected_rig_predicts_the_record_that_it_came_from(system, effort, most):
    table, rig = recorded(system)
    env = gym.make(IDS[1] if system == "linear_drive" else IDS[3], rig=rig, duration=6.0).unwrapped
    limit = 1.05 * np.abs(table[effort]).max()
    assert env.setup.high == pytest.approx(limit, rel=1e-12) and env.true_rig[most] == env.setup.high
    env.reset(seed=0, options={"initial_position": 0.0})
    infos = [env.step(np.array([push / limit]))[4] for push in table[effort][:-1]]
    seen, true = np.array([info["position"] for info in infos]), table["position"][1:]
    assert np.abs(seen - true).max() < 1e-3 * np.ptp(true)
    assert not any(info["overload"] for info in infos)


def test_nothing_tears_at_a_force_that_was_recorded():
    time = np.arange(0.0, 2.0, PERIOD)
    table = {"time": time, "position": 0.01 * np.sin(3 * time), "force": 900.0 * np.sin(3 * time)}
    recording = Recording.from_arrays("linear_drive", {"run": table}, known={"mass": 3.0})
    parameters = load_rig("belt-axis").content()["parameters"]
    raised = untorn(recording, {"plant": "linear_drive", "parameters": parameters})["parameters"]
    peak = 1.05 * np.abs(table["force"]).max()
    assert raised["tension_limit"]["value"] == pytest.approx(peak)
    assert raised["breaking_tension"]["value"] == pytest.approx(5.0 * peak)  # as they were to each other
    stated = Recording.from_arrays("linear_drive", {"run": table}, known={"mass": 3.0, "breaking_tension": 1e4})
    assert untorn(stated, {"plant": "linear_drive", "parameters": parameters})["parameters"] == parameters
