"""A drive with a motor: what limits it, what its encoder shows, and its motion against an integration of its own."""

import gymnasium as gym
import numpy as np
import pytest

from cable_envs import load_rig
from cable_envs.core.errors import ConfigurationError
from cable_envs.core.inputs import INPUTS
from cable_envs.physics.motor import behind_gear, current_range
from cable_envs.plants import plant_for

ID = "cable_envs/PulleyCircuit-{}-v1"
FREE, GRASP = "zou-table2-motor", "zou-grasp-motor"


def driven(rig: str, changes: dict, command, mode: int = 0, variant: str = "analytic", substeps: int = 20):
    """(values by name, signals by name [T]) of a rig that follows a command of the time, at the control period."""
    made = load_rig(rig).replace(changes)
    plant = made.simulated_by(variant)
    p = plant.prepare(made.column(plant)[: len(plant.parameters)])
    x, u = plant.rest(p, np.zeros(1)), INPUTS.zeros(1)
    u.mode[:] = mode
    seen = []
    for k in range(300):
        u.command[:], u.command_rate[:] = command(0.01 * k), (command(0.01 * k) - command(0.01 * (k - 1))) / 0.01
        plant.advance(x, p, u.rows, 0, 1, substeps, 0.01 / substeps)
        seen.append(x[: len(plant.signals), 0].copy())
    return made.values, dict(zip([s.name for s in plant.signals], np.array(seen).T, strict=True))


@pytest.mark.parametrize("variant", ["analytic", "chain"])
def test_no_command_takes_more_torque_or_current_than_the_drive_has(variant):
    """An object in the way: an ideal servo pulls 2.8 N m here, and the cable tears.

    At rest the friction of the gear holds more than the motor could have wound up.
    """
    wall = {"contact_stiffness": 50.0, "contact_angle": 0.1, "breaking_tension": 1e4}
    values, seen = driven(GRASP, wall, lambda t: min(10.0 * t, 3.0), variant=variant)
    limit = values["drive_torque_limit"]
    assert np.abs(seen["servo_torque"]).max() == pytest.approx(limit)
    driving = seen["motor_torque"] * seen["drive_velocity"] > 0.0
    assert np.abs(seen["motor_torque"][driving]).max() <= values["gear_efficiency"] * limit * (1.0 + 1e-12)
    assert np.abs(seen["drive_torque"]).max() <= limit / values["gear_efficiency"] + values["drive_friction"]
    assert np.abs(seen["motor_current"]).max() <= values["motor_current_limit"]
    assert seen["drive_torque"][-1] == pytest.approx(seen["motor_torque"][-1], abs=1.1 * values["drive_friction"])
    ideal = load_rig("zou-grasp").replace(wall)
    env = gym.make(ID.format("Torque-Sine"), rig=ideal, plant=variant, action_mode="position")
    env.reset(seed=0)
    assert max(env.step(np.array([min(k / 30, 1.0)], np.float32))[4]["drive_torque"] for k in range(60)) > 2.0 * limit


def test_voltage_and_back_emf_set_the_speed_that_is_left():
    """Full torque asked for, nothing in the way: the current is what the voltage still drives."""
    values, seen = driven(FREE, {"drive_speed_limit": 1e3, "drive_angle_limit": 1e3}, lambda t: 0.6, mode=1)
    emf = values["motor_constant"] * values["gear_ratio"] * seen["drive_velocity"]
    left = (values["supply_voltage"] - emf) / (values["motor_resistance"] + values["supply_resistance"])
    fast = slice(100, None)
    np.testing.assert_allclose(seen["motor_current"][fast], left[fast], rtol=1e-2)
    assert emf[-1] < values["supply_voltage"] and seen["drive_velocity"][-1] > 10.0
    sagging, slower = driven(
        FREE, {"drive_speed_limit": 1e3, "drive_angle_limit": 1e3, "supply_resistance": 5.0}, lambda t: 0.6, mode=1
    )
    assert slower["drive_velocity"][-1] < 0.95 * seen["drive_velocity"][-1] and sagging["supply_resistance"] == 5.0


def test_the_encoder_shows_steps_at_its_own_rate_and_the_agent_sees_them():
    changes = {"encoder_counts": 20.0, "encoder_period": 0.02}
    values, seen = driven(FREE, changes, lambda t: 0.5 * np.sin(3.0 * t))
    step = 2.0 * np.pi / (values["encoder_counts"] * values["gear_ratio"])
    np.testing.assert_allclose(seen["encoder_angle"] / step, np.round(seen["encoder_angle"] / step), atol=1e-9)
    held = np.diff(seen["encoder_angle"]) == 0.0
    assert held[::2].all() or held[1::2].all()
    env = gym.make(ID.format("Position-Sine"), rig=load_rig(FREE).replace(changes))
    env.reset(seed=0)
    for k in range(30):
        obs, *_, info = env.step(np.array([0.01 * k], np.float32))
        names = [c.name for c in env.unwrapped.channels]
        shown = obs[names.index("drive_angle")] * env.unwrapped.channels[names.index("drive_angle")].scale
        assert shown == pytest.approx(info["encoder_angle"], rel=1e-6, abs=1e-7)
        assert abs(shown - info["drive_angle"]) > 0.0 or k < 3


def test_its_motion_is_that_of_its_own_equations_in_short_explicit_steps():
    """The torque of the cables as the kernel found it; motor, gear, friction and servo in 10 us Euler steps."""
    changes = {"encoder_counts": 0.0, "cogging_torque": 2e-4, "motor_inertia": 5e-8}

    def command(t: float) -> float:
        return 0.6 * np.sin(5.0 * t)

    q, seen = driven(FREE, changes, command, substeps=200)
    cables = np.interp(np.arange(0.0, 3.0, 1e-5), 0.01 * np.arange(1, 301), seen["drive_torque"])
    ratio, constant = q["gear_ratio"], q["motor_constant"]
    inertia = q["drive_inertia"] + q["motor_inertia"] * ratio**2
    a = v = reading = rate = integral = asked = 0.0
    path, due = [], 0
    for k, pull in enumerate(cables):
        t = 1e-5 * k
        told, before = command(0.01 * int(t / 0.01 + 1e-9)), command(0.01 * (int(t / 0.01 + 1e-9) - 1))
        if k == due:
            due += round(q["encoder_period"] / 1e-5)
            period = q["encoder_period"]
            rate += period / (period + q["servo_filter"]) * ((a - reading) / period - rate)
            reading, error = a, told - a
            integral += period * q["servo_ki"] * error
            asked = q["servo_kp"] * error + q["servo_kd"] * ((told - before) / 0.01 - rate) + integral
            asked = min(max(asked, -q["drive_torque_limit"]), q["drive_torque_limit"])
        resistance = q["motor_resistance"] + q["supply_resistance"]
        low, high = current_range(constant * ratio * v, resistance, q["supply_voltage"], q["motor_current_limit"])
        torque = behind_gear(constant * min(max(asked / constant / ratio, low), high), v, ratio, q["gear_efficiency"])
        torque -= q["cogging_torque"] * ratio * np.sin(q["cogging_periods"] * ratio * a) + q["drive_damping"] * v + pull
        if abs(v) < 1e-9 and abs(torque) <= q["drive_friction"]:
            v = 0.0
        else:
            way = np.sign(v) if abs(v) > 1e-9 else np.sign(torque)
            new = v + 1e-5 * (torque - way * q["drive_friction"]) / inertia
            v = 0.0 if new * v < 0.0 else new
        a += 1e-5 * v
        if (k + 1) % 1000 == 0:
            path.append(a)
    assert np.sqrt(np.mean((np.array(path) - seen["drive_angle"]) ** 2)) < 0.01 * np.ptp(seen["drive_angle"])


def test_power_is_lost_in_the_gear_whichever_way_it_flows():
    for torque in (-0.2, 0.3):
        for speed in (-2.0, 1.0):
            out = behind_gear(torque, speed, 44.0, 0.8)
            assert out * speed / 44.0 <= torque * speed + 1e-12


@pytest.mark.parametrize("plant", ["analytic", "chain"])
def test_lanes_are_single_environments_to_the_bit(plant):
    many = gym.make_vec(ID.format("Position-Sine"), num_envs=3, plant=plant, randomize=True, sensor_noise=True)
    alone = [gym.make(ID.format("Position-Sine"), plant=plant, randomize=True, sensor_noise=True) for _ in range(3)]
    first = many.reset(seed=[3, 4, 5])[0]
    np.testing.assert_array_equal(first, [one.reset(seed=s)[0] for one, s in zip(alone, (3, 4, 5), strict=True)])
    rng = np.random.default_rng(0)
    for _ in range(60):
        actions = rng.uniform(-1.0, 1.0, (3, 1)).astype(np.float32)
        together = many.step(actions)[0]
        np.testing.assert_array_equal(together, [one.step(a)[0] for one, a in zip(alone, actions, strict=True)])


def test_it_stays_at_rest_and_is_refused_where_it_does_not_belong():
    values, seen = driven(GRASP, {"contact_angle": -0.5}, lambda t: 0.0, mode=0)
    held = driven(FREE, {}, lambda t: 0.0)[1]
    assert (
        np.ptp(held["drive_angle"]) < 1e-3 and np.isfinite(seen["drive_angle"]).all() and values["gear_ratio"] == 44.0
    )
    with pytest.raises(ConfigurationError, match="coupled_drives has an ideal drive only"):
        plant_for("coupled_drives", drive="motor")
    with pytest.raises(ConfigurationError, match="belongs to the ids -v1"):
        gym.make("cable_envs/PulleyCircuit-Position-Sine-v0", rig=FREE)
    with pytest.raises(ConfigurationError, match="unknown drive 'engine'"):
        load_rig({"plant": "pulley_circuit", "drive": "engine"})
    with pytest.raises(ConfigurationError, match="extends zou-table2, which is of pulley_circuit"):
        load_rig({"plant": "cable_hole", "extends": "zou-table2"})
