"""Values that cannot be meant, handed to environments: each is a ConfigurationError of one line."""

import gymnasium as gym
import pytest

from cable_envs.core.errors import ConfigurationError

IDS = ("cable_envs/CableHole-Position-Step-v0", "cable_envs/PulleyCircuit-Position-Sine-v0")
NAN, INF = float("nan"), float("inf")
OPTIONS = (
    {"effects": {"nope": {}}}, {"effects": {"backlash": {}}}, {"effects": {"backlash": 3}}, {"effects": 5},
    {"effects": {"": 1}}, {"effects": {"backlash.gap": NAN}}, {"control_period": 1e-300}, {"control_period": 1e300},
    {"control_period": True}, {"duration": 1e300}, {"duration": 1e-300}, {"duration": INF}, {"duration": "20"},
    {"rig": 5}, {"rig": [1]}, {"rig": {"load_mass": "x"}}, {"rig": {1: 2}}, {"rig": "/dev/zero"}, {"rig": "a\0b"},
    {"rig": "../../../etc/passwd"}, {"substeps": 10**9}, {"substeps": -1}, {"substeps": "3"}, {"sensor_delay": 1e300},
    {"action_delay": 10**12}, {"reference": 3}, {"reference": {"kind": "nope"}}, {"disturbance": 7}, {"observe": 7},
    {"action_mode": 7}, {"plant": 7}, {"effect_file": 7}, {"effect_file": "/dev/zero"}, {"randomize": 3},
    {"sensor_noise": "yes"},
)  # fmt: skip
RESETS = (
    {"initial_position": 1e9}, {"initial_position": NAN}, {"initial_state": 5}, {"rig": 5}, {"rig": {"nope": 1}},
    {"reference": 5}, {"nope": 1},
)  # fmt: skip


@pytest.mark.parametrize("options", OPTIONS, ids=str)
@pytest.mark.parametrize("env_id", IDS)
def test_an_option_that_cannot_be_meant_is_refused(env_id, options):
    with pytest.raises(ConfigurationError) as refused:
        gym.make(env_id, **options)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("options", RESETS, ids=str)
def test_a_reset_that_cannot_be_meant_is_refused(options):
    env = gym.make(IDS[0])
    with pytest.raises(ConfigurationError) as refused:
        env.reset(seed=0, options=options)
    assert "\n" not in str(refused.value)
