"""Effects: absent to the bit at null, mixed in one batch, named clearly, reachable from environments and rig files."""

import json

import gymnasium as gym
import numpy as np
import pytest

import cable_envs
from cable_envs.core.errors import ConfigurationError
from cable_envs.core.inputs import INPUTS
from cable_envs.effects import EFFECTS, SEAMS, lane_of
from cable_envs.effects.lanes import SENSE
from cable_envs.plants import families, plant_for
from cable_envs.sim.rigs import load_rig
from tests.support.golden_kernels import FILE, KEYS, fingerprint
from tests.support.inputs import COMMAND, COMMAND_RATE, MODE

HOLE, CIRCUIT = "cable_envs/CableHole-Position-Sine-v0", "cable_envs/PulleyCircuit-Position-Sine-v0"
NAMES = (
    "coulomb_friction", "viscous_friction", "stribeck_friction", "asymmetric_friction", "presliding_hysteresis",
    "load_dependent_friction", "lateral_extrusion", "bending_stiffness", "cable_elongation", "stiffness_hardening",
    "viscoelastic_creep", "friction_drift", "backlash", "slack", "partial_slip", "position_ripple",
    "position_dependent_load", "actuator_lag", "sensor_delay", "sensor_bias", "sensor_scale", "sensor_rectification",
)  # fmt: skip
"""The canonical list of diagnosis.md."""


OFTEN_SAME = (("cable_hole of three", "speed"),)
"""Kernels of many holes take long to compile, and their other mode is tested."""


@pytest.mark.parametrize("effects", [False, True], ids=["absent", "null"])
@pytest.mark.parametrize(
    ("case", "mode"),
    [pytest.param(c, m, id=f"{c}-{m}", marks=[pytest.mark.slow] if (c, m) in OFTEN_SAME else []) for c, m in KEYS],
)
def test_null_is_bit_equal_to_absence(case, mode, effects):
    """The fingerprints are of the kernels before there were effects; "null" runs the kernel that has them all."""
    assert fingerprint(case, mode, effects) == json.loads(FILE.read_text())[f"{case}, {mode}"]


PLANTS = {
    made.name: made
    for one in families().values()
    for made in (plant_for(one.name, variant) for variant in one.variants)
}


def test_every_canonical_effect_is_declared():
    assert set(NAMES) <= set(EFFECTS)
    for name, effect in EFFECTS.items():
        assert effect.name == name and effect.seam in SEAMS
        assert effect.equation and effect.source and effect.validity and effect.experiment
        assert set(effect.confusable) <= set(EFFECTS) - {name}
        assert any(plant.effects.effects[name].parameters for plant in PLANTS.values()), f"{name} acts on no plant"


@pytest.mark.parametrize("plant", PLANTS.values(), ids=PLANTS)
def test_effects_of_a_plant_have_rows_units_and_sizes(plant):
    acting = [effect for effect in plant.effects.effects.values() if effect.parameters]
    assert len(acting) > 5
    for effect in acting:
        for p in effect.parameters:
            assert p.unit and p.meaning and p.low <= p.null <= p.high and p.low <= p.typical <= p.high
            assert p.shape or p.typical != p.null
            assert effect.row(p) in plant.table
            assert effect.name in SENSE or p.alias or lane_of(effect, p) in plant.effects.lanes


@pytest.mark.parametrize("plant", PLANTS.values(), ids=PLANTS)
def test_aliases_are_parameters_of_the_plant_and_nulls_leave_the_physics_out(plant):
    for name, parameter in plant.effects.aliases.items():
        assert parameter in plant.parameters.names
        assert plant.table[name] is plant.parameters[parameter]
    values = plant.table.unpack(plant.table.pack({}))
    assert not set(plant.effects.present(values)) & {"backlash", "actuator_lag", "sensor_bias", "slack"}
    given = "backlash" if "backlash.gap" in plant.table.names else "actuator_lag"  # a rotary joint has no gap
    size = {"backlash": "gap", "actuator_lag": "time"}[given]
    assert given in plant.effects.present({**values, f"{given}.{size}": 0.1})
    assert set(plant.effects.measured) <= {s.name for s in plant.signals}


MISTAKES = [
    ({"backlsh": {"gap": 0.1}}, "did you mean 'backlash'"),
    ({"backlash": {"gapp": 0.1}}, "did you mean 'gap'"),
    ({"backlash.gapp": 0.1}, "did you mean 'gap'"),
    ({"backlash": {"gap": -0.1}}, "outside its physical range"),
    ({"backlash": {"gap": {"value": 1, "unit": "N"}}}, "does not fit; expected rad"),
    ({"backlash": 0.1}, "expected a mapping of parameters"),
    ({"lateral_extrusion": {"gain": 1.0}}, "does not act on pulley_circuit; these do: coulomb_friction"),
    ("backlash", "expected a mapping of effect"),
    ({"position_ripple": {"amplitude": 0.2}}, "'position_ripple': amplitude 0.2 is above period / 2 pi = 0.159155"),
    ({"position_ripple": {"amplitude": -0.02, "period": 0.1}}, "move backwards"),
]


@pytest.mark.parametrize(("effects", "message"), MISTAKES, ids=[m for _, m in MISTAKES])
def test_mistakes_are_named(effects, message):
    with pytest.raises(ConfigurationError, match=message):
        gym.make(CIRCUIT, effects=effects)


def test_shapes_that_are_lengths_are_angles_where_the_plant_turns():
    """The default of a period or of a speed is of the size that is seen on the plant, in its unit."""
    for name, length, angle in (("position_ripple.period", 5e-3, 1.0), ("stribeck_friction.velocity", 2e-3, 0.1)):
        for plant in PLANTS.values():
            effect, parameter = name.split(".")
            if name in plant.table.names and plant.effects.effects[effect] not in plant.effects.acting.forms:
                turns = "rad" in plant.table[name].unit
                assert plant.table[name].default == (angle if turns else length), (plant.name, parameter)
    gym.make(CIRCUIT, effects={"position_ripple": {"amplitude": 0.01}})


def test_a_ripple_that_may_be_drawn_too_large_is_refused():
    at_once = {
        "position_ripple.amplitude": {"low": 0.0, "high": 0.05},
        "position_ripple.period": {"low": 0.2, "high": 1.0},
    }
    with pytest.raises(ConfigurationError, match=r"amplitude 0\.05 is above period / 2 pi = 0\.0318"):
        gym.make(CIRCUIT, randomize=at_once)
    gym.make(CIRCUIT, randomize={**at_once, "position_ripple.period": {"low": 0.4, "high": 1.0}})


def test_an_effect_of_the_closed_form_is_refused_by_the_chain():
    gym.make(CIRCUIT, effects={"partial_slip": {"angle": 0.01}})
    with pytest.raises(ConfigurationError, match="does not act on pulley_chain"):
        gym.make(CIRCUIT, effects={"partial_slip": {"angle": 0.01}}, plant="chain")


def test_rig_files_hold_effects():
    rig = load_rig({
        "plant": "cable_hole",
        "effects": {"backlash": {"gap": {"value": 0.2, "unit": "mm", "source": "measured"}},
                    "viscous_friction": {"coefficient": 7.0}},
    })  # fmt: skip
    assert rig.effects == {"backlash.gap": pytest.approx(2e-4)} and rig.values["load_damping"] == 7.0
    assert rig.replace({"load_mass": 6.0}).effects == rig.effects
    assert gym.make(HOLE, rig=rig).unwrapped.simulation.lane_effects() == rig.effects
    with pytest.raises(ConfigurationError, match="unknown effect 'backlas'"):
        load_rig({"plant": "cable_hole", "effects": {"backlas": {"gap": 1}}})


def _episode(env_id, steps=40, options=None, **arguments):
    """Observations and the last info of an open-loop run."""
    env = gym.make(env_id, duration=1.0, **arguments)
    seen = [env.reset(seed=3, options=options)[0]]
    for k in range(steps):
        observation, *_, info = env.step(np.array([0.4 * np.sin(0.2 * k)], np.float32))
        seen.append(observation)
    return np.array(seen), info


@pytest.mark.parametrize(("env_id", "gap"), [(HOLE, 1e-3), (CIRCUIT, 0.05)])
def test_effects_by_option_rig_and_reset_are_the_same(env_id, gap):
    plain, _ = _episode(env_id)
    option, info = _episode(env_id, effects={"backlash": {"gap": gap}})
    assert not np.array_equal(plain, option)
    assert np.array_equal(option, _episode(env_id, rig={"backlash.gap": gap})[0])
    assert np.array_equal(option, _episode(env_id, options={"rig": {"backlash.gap": gap}})[0])
    assert np.array_equal(option, _episode(env_id, randomize={"backlash.gap": {"low": gap, "high": gap}})[0])
    assert set(info) == set(_episode(env_id)[1])  # states of effects are no signals


def test_a_batch_mixes_rigs_with_different_effects():
    """Three environments with other effects each, and one without any: each as it is alone, to the bit."""
    changes = [{}, {"backlash.gap": 0.04}, {"actuator_lag.time": 0.05}, {"coulomb_friction.level": 0.01}]
    batch = gym.make_vec(CIRCUIT, num_envs=4, vectorization_mode="vector_entry_point", duration=1.0, threads=1)
    batch.reset(seed=3)
    for k, change in enumerate(changes):
        batch.reset(seed=[3] * 4, options={"reset_mask": np.arange(4) == k, "rig": change})
    alone = [gym.make(CIRCUIT, duration=1.0) for _ in changes]
    for env, change in zip(alone, changes, strict=True):
        env.reset(seed=3, options={"rig": change})
    for k in range(30):
        action = np.array([[0.5 * np.sin(0.3 * k)]], np.float32)
        together = batch.step(np.repeat(action, 4, axis=0))[0]
        single = np.array([env.step(action[0])[0] for env in alone])
        assert np.array_equal(together, single)
    assert len({row.tobytes() for row in together}) == 4


def test_a_delay_longer_than_the_environment_was_made_for_is_refused():
    env = gym.make(CIRCUIT, duration=1.0)
    with pytest.raises(ConfigurationError, match="longer than the environment was made for"):
        env.reset(options={"rig": {"sensor_delay.drive_angle": 0.02}})


@pytest.mark.parametrize("late", [0.02, 0.025])
def test_sensor_effects_act_on_the_observation_only(late):
    bent = {"sensor_delay.drive_angle": late, "sensor_scale.drive_torque": -2.0, "sensor_bias.drive_torque": 0.01,
            "sensor_rectification.drive_torque": 1.0}  # fmt: skip
    plain, truth = _episode(CIRCUIT)
    seen, same = _episode(CIRCUIT, effects=bent)
    assert truth == same  # the mechanism itself does not know its sensors
    channels = gym.make(CIRCUIT).unwrapped.channels
    at = {c.name: (k, c.scale) for k, c in enumerate(channels)}
    k, scale = at["drive_torque"]
    expected = -2.0 * plain[:, k] * scale + 0.01
    assert seen[:, k] * scale == pytest.approx(np.maximum(expected, 0.0), abs=1e-6)  # float32 observations
    k, _ = at["drive_angle"]
    time = np.arange(len(plain)) * 0.01
    assert seen[:, k] == pytest.approx(np.interp(time - late, time, plain[:, k]), abs=1e-6)


def _circuit(variant, mode="position", **effects):
    plant = plant_for("pulley_circuit", variant)
    values = plant.table.pack(effects)[:, None]
    p = plant.prepare(values)
    x, u = plant.rest(p, np.zeros(1)), np.zeros((len(INPUTS), 1))
    u[MODE] = [m.name for m in plant.action_modes].index(mode)
    u[COMMAND] = x[plant.row("drive_angle" if mode == "position" else "drive_torque")]
    return plant, p, x, u


@pytest.mark.parametrize("variant", ["analytic", "chain"])
def test_backlash_of_the_circuit_is_lost_motion_of_its_gap(variant):
    """Slowly to and fro: beyond what the cables take up, the drive turns by the gap before the output follows."""
    lost = []
    for gap in (0.0, 0.05):
        plant, p, x, u = _circuit(variant, **{"backlash.gap": gap})
        angles = []
        for k in range(500):
            rate = 1.0 if k < 250 else -1.0
            u[COMMAND] += 0.01 * rate
            u[COMMAND_RATE] = rate
            plant.advance(x, p, u, 0, 1, 10, 1e-3)
            angles.append((x[plant.row("drive_angle"), 0], x[plant.row("output_angle"), 0]))
        drive, output = np.array(angles).T
        lost.append(1.4 * drive[200] - output[200] - (1.4 * drive[480] - output[480]))
    assert lost[1] - lost[0] == pytest.approx(1.4 * 0.05, rel=0.02)  # seen at the output through R0 / R5 = 1.4


def test_backlash_of_the_hole_is_a_play_operator():
    plant = plant_for("cable_hole")
    gap = 1e-3
    p = plant.prepare(plant.table.pack({"backlash.gap": gap, "cable_stiffness": 1e7})[:, None])
    x, u = plant.rest(p, np.zeros(1)), np.zeros((len(INPUTS), 1))
    u[MODE] = 1.0
    row, nut, load = plant.row("drive_position"), x[0, 0], []
    start = x[row, 0]
    for k in range(600):
        u[COMMAND] = 0.004 if k // 200 % 2 == 0 else -0.004
        plant.advance(x, p, u, 0, 1, 20, 5e-4)
        nut = np.clip(nut, x[row, 0] - gap / 2, x[row, 0] + gap / 2)
        load.append((nut - start, x[plant.row("load_position"), 0]))
    nut, load = np.array(load).T
    assert nut.max() > 5e-3
    assert load == pytest.approx(nut, abs=2e-5)  # the cable's own stretch: 75 N over 1e7 N/m, and its change


@pytest.mark.parametrize("variant", ["analytic", "chain"])
def test_actuator_lag_is_first_order(variant):
    """The servo with a lag follows the mean of the lagged command over each step."""
    T, dt = 0.05, 1e-3
    plant, p, x, u = _circuit(variant, **{"actuator_lag.time": T})
    other = _circuit(variant)
    lagged = u[COMMAND, 0]
    plant.advance(x, p, u, 0, 1, 1, dt)  # at rest: the lag has settled
    for _ in range(300):
        u[COMMAND] = 0.3
        plant.advance(x, p, u, 0, 1, 1, dt)
        left = np.exp(-dt / T)
        other[3][COMMAND], lagged = 0.3 + (lagged - 0.3) * (1 - left) * T / dt, 0.3 + (lagged - 0.3) * left
        plant.advance(other[2], other[1], other[3], 0, 1, 1, dt)
        row = plant.row("drive_angle")
        assert x[row, 0] == pytest.approx(other[2][row, 0], abs=1e-12)


def test_a_lag_far_shorter_than_the_step_is_no_delay():
    """It was half a step once, by the mean of the command's ends."""
    plant, p, x, u = _circuit("analytic", **{"actuator_lag.time": 1e-5})
    other = _circuit("analytic")
    for k in range(50):
        for column in (u, other[3]):
            column[COMMAND] = 0.3 * np.sin(0.1 * k)
        plant.advance(x, p, u, 0, 1, 1, 1e-3)
        plant.advance(other[2], other[1], other[3], 0, 1, 1, 1e-3)
    row = plant.row("drive_angle")
    assert (
        abs(x[row, 0] - other[2][row, 0]) < 0.02 * 0.03
    )  # the command moves by 0.03 rad a step, the lag is 0.01 steps


def test_registered_environments_take_effects():
    for env_id in cable_envs.ENV_IDS:
        env = gym.make(env_id, duration=0.05, effects={"viscous_friction": {"coefficient": 1e-3}})
        env.reset(seed=0)
        env.step(env.action_space.sample())
