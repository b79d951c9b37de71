"""A rig says in what range its parameters hold, and a simulation beyond says so."""

import gymnasium as gym
import numpy as np
import pytest

import cable_envs
from cable_envs import load_rig
from cable_envs.core.config import config_names
from cable_envs.core.errors import ConfigurationError

ID = "cable_envs/CableHole-Position-Sine-v1"


@pytest.mark.parametrize("name", ["gu-inferred", "gu-steel-1mm"])
def test_the_rigs_of_the_paper_hold_to_the_speed_that_was_measured(name):
    rig = load_rig(name)
    low, high = rig.valid["load_velocity"]
    assert -low == high == pytest.approx(0.0108) and "section 5.3" in rig.sources["load_velocity"]
    again = load_rig(rig.content())
    assert again.valid == rig.valid and again.sources == rig.sources
    assert rig.replace({"load_mass": 2.0}).valid == rig.valid


@pytest.mark.parametrize("n", [1, 5])
def test_info_says_out_of_range_where_a_signal_is_beyond(n):
    envs = gym.make_vec(ID, num_envs=n, action_mode="speed")
    envs.reset(seed=0)
    seen = []
    for k in range(60):
        info = envs.step(np.full((n, 1), 0.004 * k, np.float32))[4]
        np.testing.assert_array_equal(info["out_of_range"], np.abs(info["load_velocity"]) > 0.0108)
        seen.append(info["out_of_range"][0])
    assert 0.0 < np.mean(seen) < 1.0


def test_a_law_says_where_it_was_identified_though_the_rig_says_nothing():
    rig = {key: value for key, value in load_rig("gu-inferred").content().items() if key != "valid"}
    for changes, beyond in (({}, True), ({"extrusion_gain": 0.0}, False)):
        env = gym.make(ID, rig=load_rig(rig).replace(changes), action_mode="speed")
        env.reset(seed=0)
        seen = [env.step(np.array([0.5], np.float32))[4] for _ in range(30)]
        fast = [beyond and abs(info["load_velocity"]) > 0.0108 for info in seen]
        assert [info["out_of_range"] > 0.0 for info in seen] == fast and any(fast) == beyond
    wider = load_rig({**rig, "valid": {"load_velocity": {"low": -0.1, "high": 0.1}}})
    assert wider.holds(wider.simulated_by()) == {"load_velocity": (-0.1, 0.1)}


def test_the_circuit_says_it_of_a_slack_cable_and_of_a_rigs_range_alike():
    rig = {**load_rig("zou-table2").content(), "valid": {"drive_velocity": {"low": -1.0, "high": 1.0}}}
    env = gym.make("cable_envs/PulleyCircuit-Position-Sine-v1", rig=rig)
    env.reset(seed=0)
    seen = [env.step(np.array([min(0.02 * k, 0.9)], np.float32))[4] for k in range(100)]
    fast = [
        abs(info["drive_velocity"]) > 1.0 or min(info["tension_drive_top"], info["tension_drive_bottom"]) <= 0
        for info in seen
    ]
    assert [info["out_of_range"] > 0.0 for info in seen] == fast and any(fast) and not all(fast)


@pytest.mark.parametrize(
    ("valid", "message"),
    [
        ({"load_speed": {"low": 0, "high": 1}}, "unknown signal under 'valid'"),
        ({"load_velocity": {"low": 1, "high": 0}}, "low 1 is not below high 0"),
        ({"load_velocity": {"low": 0}}, "expected {low, high, unit, source}"),
        ({"load_velocity": {"low": 0, "high": 1, "unit": "kg"}}, "unit"),
        ([1], "must be a mapping"),
    ],
)
def test_ranges_that_make_no_sense_are_refused(valid, message):
    with pytest.raises(ConfigurationError, match=message):
        load_rig({**load_rig("gu-inferred").content(), "valid": valid})


@pytest.mark.parametrize("name", config_names("rigs"))
def test_every_rig_that_is_shipped_says_where_it_holds_and_why(name):
    rig = load_rig(name)
    holds = rig.holds(rig.simulated_by())
    assert rig.valid and holds
    assert all(len(rig.sources[signal]) > 20 for signal in rig.valid)
    for low, high in holds.values():
        assert low < 0.0 < high  # at rest it holds


@pytest.mark.slow  # a kernel of every plant and version
@pytest.mark.parametrize("env_id", sorted({*cable_envs.ENV_IDS, *cable_envs.V1_IDS}))
def test_every_environment_says_it(env_id):
    """A range that leaves out where the episode is, and one that does not: nothing else moves."""
    plain = gym.make(env_id).unwrapped.setup.rig
    output = next(iter(plain.valid))
    seen = []
    for low, high in ((-1e6, 1e6), (1e5, 1e6)):
        ranges = {output: {"low": low, "high": high}}
        env = gym.make(env_id, rig=load_rig({**plain.content(), "valid": ranges}))
        infos = [env.reset(seed=0)[1], *(env.step(np.zeros(1, np.float32))[4] for _ in range(3))]
        seen.append([info["out_of_range"] for info in infos[1:]])
    assert seen == [[0.0] * 3, [1.0] * 3]
