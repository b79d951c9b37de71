"""The integration step fits the rig, or the rig is refused by name; what is reported obeys the contact's law."""

import re

import gymnasium as gym
import numpy as np
import pytest

import cable_envs
from cable_envs import load_rig
from cable_envs.core.errors import ConfigurationError
from cable_envs.physics.hole_ratio import EXACT, hole_ratio
from cable_envs.physics.modes import longest_step
from cable_envs.sim.registered import setup_of

HOLE = "cable_envs/CableHole-Position-Sine-v1"
CIRCUIT = "cable_envs/PulleyCircuit-Torque-Sine-v1"


def weigh(mass: float, period: float = 0.01, finer: int = 1, **rig: float) -> np.ndarray:
    """Path of the load, m, once every 0.2 s, while the driving tension swings about what holds it."""
    options = {"rig": {"load_mass": mass, **rig}, "control_period": period, "duration": 6.0}
    usual = setup_of(HOLE, options).substeps
    env = gym.make(HOLE, substeps=usual * finer, **options)
    env.reset(seed=0)
    limit, path = env.unwrapped.setup.high, []
    for k in range(round(6.0 / period)):
        pull = 1.3 * 9.81 * mass * (1.0 + 0.9 * np.sin(np.pi * k * period))
        path.append(env.step(np.array([2.0 * pull / limit - 1.0], np.float32))[4]["load_position"])
    return np.array(path)[:: max(round(0.2 / period), 1)]


@pytest.mark.parametrize("mass", [5.0, 0.5, 0.1, 0.02])
def test_loads_of_every_weight_are_within_one_percent_of_far_shorter_steps(mass):
    usual, fine = weigh(mass), weigh(mass, finer=20)
    assert np.abs(usual - fine).max() < 0.01 * np.ptp(fine)


@pytest.mark.parametrize("period", [0.001, 0.05, 0.2])
def test_control_periods_from_one_to_two_hundred_milliseconds(period):
    usual, fine = weigh(0.5, period), weigh(0.5, period, finer=10)
    assert np.abs(usual - fine).max() < 0.01 * np.ptp(fine)


@pytest.mark.parametrize("stiffness", [5e3, 1e6])
def test_soft_and_stiff_cables(stiffness):
    usual, fine = weigh(2.0, cable_stiffness=stiffness), weigh(2.0, finer=10, cable_stiffness=stiffness)
    assert np.abs(usual - fine).max() < 0.01 * np.ptp(fine)


def test_a_rig_that_is_too_quick_for_the_steps_is_refused_with_the_number_that_will_do():
    light = {"load_mass": 0.02, "cable_stiffness": 2e5}
    with pytest.raises(
        ConfigurationError, match=r"substeps = 5 is too few: this rig needs \d+ integration steps"
    ) as told:
        gym.make(HOLE, rig=light, substeps=5)
    wanted = int(re.search(r"substeps=(\d+)", str(told.value))[1])
    assert gym.make(HOLE, rig=light, substeps=wanted).unwrapped.setup.substeps == wanted
    with pytest.raises(ConfigurationError, match="is too few"):
        gym.make(HOLE, rig=light, substeps=wanted - 1)
    assert setup_of(HOLE, {"rig": light}).substeps == wanted
    assert setup_of(HOLE, {}).substeps == 20
    with pytest.raises(ConfigurationError, match=r"this rig is too quick: .* control_period="):
        gym.make(HOLE, rig={"load_mass": 1e-3, "cable_stiffness": 1e9}, control_period=0.2)


def test_a_rig_of_one_episode_and_the_ends_of_ranges_count_too():
    env = gym.make(HOLE)
    with pytest.raises(ConfigurationError, match=r"the rig of this reset needs \d+ integration steps"):
        env.reset(options={"rig": {"load_mass": 0.02, "cable_stiffness": 1e6}})
    env.reset(seed=1)  # nothing is lost
    ranges = {"load_mass": {"low": 0.01, "high": 5.0}, "cable_stiffness": {"scale": [0.3, 3.0]}}
    drawn = setup_of(HOLE, {"randomize": ranges})
    alone = setup_of(HOLE, {"rig": {"load_mass": 0.01, "cable_stiffness": 180e3}})
    assert drawn.substeps >= alone.substeps > 20
    more = {
        name: {"scale": [0.9, 1.1]}
        for name in ("gravity", "cable_damping", "wrap_angle", "radius_ratio", "cable_radius", "friction_coefficient",
                     "extrusion_gain", "inner_kp", "inner_kd")
    }  # fmt: skip
    crowded = gym.make(HOLE, randomize={**ranges, **more})
    assert crowded.unwrapped.setup.substeps >= drawn.substeps
    for seed in range(20):
        crowded.reset(seed=seed)
    many = gym.make_vec(HOLE, num_envs=3, randomize=ranges)
    many.reset(seed=0)


@pytest.mark.parametrize("plant", ["analytic", "chain"])
def test_the_circuit_keeps_the_inertia_that_it_is_given(plant):
    rig = {"output_inertia": 1e-7, "drive_inertia": 1e-5}
    env = gym.make(CIRCUIT, rig=rig, plant=plant)
    inner = env.unwrapped
    env.reset(seed=0)
    p = inner.setup.plant.coefficient_rows.over(inner.simulation.buffers.p)
    assert p.output_inertia[0] == 1e-7 and p.drive_inertia[0] == 1e-5 and inner.setup.substeps > 100
    before = gym.make(CIRCUIT.replace("v1", "v0"), rig=rig, plant=plant).unwrapped
    assert before.setup.substeps == 20
    before.reset(seed=0)
    assert before.setup.plant.coefficient_rows.over(before.simulation.buffers.p).output_inertia[0] > 1e-7


def test_no_step_turns_a_vibration_by_more_than_a_third_or_outlasts_a_decay():
    assert longest_step(5.0, 0.0, 60e3) == pytest.approx(0.25 / np.sqrt(60e3 / 5.0))
    assert longest_step(1.0, 1000.0, 0.0) == pytest.approx(1e-3)
    quick = 500.0 + np.sqrt(500.0**2 - 100.0)
    assert longest_step(1.0, 1000.0, 100.0) == pytest.approx(1.0 / quick)
    assert longest_step(1.0, 0.0, 0.0) == np.inf


@pytest.mark.parametrize(
    "rig",
    [
        {},
        {"wrap_angle": {"value": 180, "unit": "deg"}, "radius_ratio": 5.0},
        {"wrap_angle": {"value": 360, "unit": "deg"}, "radius_ratio": 5.0, "friction_coefficient": 0.2},
        {"bending_rigidity": 2e-4},
        {"extrusion_exponent": 0.7, "extrusion_gain": 2.0},
    ],
    ids=["shipped", "half a turn", "a turn", "stiff cable", "steep at rest"],
)
def test_tensions_that_are_reported_obey_the_contacts_law(rig):
    env = gym.make("cable_envs/CableHole-Tension-Sine-v1", rig=rig, randomize={"load_mass": {"scale": [0.3, 3.0]}})
    inner, rng, worst = env.unwrapped, np.random.default_rng(0), 0.0
    for seed in range(3):
        env.reset(seed=seed)
        q = dict(zip(inner.setup.plant.table.names, inner.simulation.values[:, 0], strict=True))
        for _ in range(400):
            info = env.step(rng.uniform(-1.0, 1.0, 1).astype(np.float32))[4]
            a, b, v = info["drive_tension"], info["load_tension"], info["load_velocity"]
            assert a >= 0.0 and b >= 0.0
            n = hole_ratio(
                EXACT, v, q["wrap_angle"], q["radius_ratio"], q["friction_coefficient"], q["extrusion_delta"],
                q["extrusion_gain"], q["extrusion_exponent"], q["bending_rigidity"],
                q["radius_ratio"] * q["cable_radius"], a, b,
            )  # fmt: skip
            if max(a, b) > 0.0:
                worst = max(worst, max(a, b) / max(min(a, b), 1e-300) / n - 1.0)
            if v != 0.0 and a > 0.0:
                worst = max(worst, abs((a / b if v > 0.0 else b / a) / n - 1.0))
    assert worst < 1e-6


def test_a_gap_of_the_drive_goes_to_nothing_as_it_goes_to_nothing():
    def tensions(gap: float) -> np.ndarray:
        env = gym.make("cable_envs/CableHole-Tension-Sine-v1", effects={"backlash": {"gap": gap}}, duration=8.0)
        env.reset(seed=0)
        actions = 0.3 * np.sin(0.05 * np.arange(800))
        return np.array([env.step(np.array([a], np.float32))[4]["load_tension"] for a in actions])

    none = tensions(0.0)
    for gap, share in ((5e-11, 1e-3), (1e-8, 1e-2)):
        assert np.abs(tensions(gap) - none).max() < share * np.ptp(none)


def test_the_first_ids_keep_their_numbers_and_have_one_hole():
    assert load_rig("gu-inferred").simulated_by(version="v0").resolves is None
    with pytest.raises(ConfigurationError, match="several holes in series belong to the ids -v1"):
        gym.make("cable_envs/CableHole-Position-Step-v0", rig="gu-three-holes")
    with pytest.raises(ConfigurationError, match="unknown version 'v2'"):
        setup_of(HOLE, {"version": "v2"})
    assert not set(cable_envs.ENV_IDS) & set(cable_envs.V1_IDS)


@pytest.mark.parametrize("substeps", [20, 200])
def test_the_peak_of_a_tension_that_falls_is_that_of_the_start_whatever_the_step(substeps):
    env = gym.make("cable_envs/CableHole-Tension-Sine-v1", action_mode="speed", substeps=substeps)
    _, before = env.reset(seed=0)
    after = env.step(np.array([-0.5], np.float32))[4]
    assert after["drive_tension"] < before["drive_tension"] == after["peak_tension"]
