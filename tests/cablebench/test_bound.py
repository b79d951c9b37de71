"""The upper bound: commands that the simulator confirms, slopes that it confirms too, and limits that are kept."""

import gymnasium as gym
import numpy as np
import pytest

import cable_envs  # noqa: F401 - registers the environments
from cable_envs.core.errors import ConfigurationError
from cablebench.bound import upper_bound
from cablebench.bound.motion import Plants
from cablebench.entrants.controller_files import controller_file_entrant
from cablebench.protocol.metrics import priced_rmse
from cablebench.run.evaluation import run_episode

SINE = "cable_envs/CableHole-Position-Sine-v0"
OPTIONS = {"duration": 1.5, "randomize": True}


@pytest.fixture(scope="module")
def found():
    return upper_bound(SINE, [2000000, 2000002], OPTIONS, rounds=4)


def replayed(env_id, options, seed, command):
    """(RMSE, outputs) of commands in the environment itself."""
    with gym.make(env_id, **options) as env:
        env.reset(seed=seed)
        setup, errors = env.unwrapped.setup, []
        for u in command:
            action = 2.0 * (u - setup.low) / (setup.high - setup.low) - 1.0
            info = env.step(np.array([action], dtype=np.float32))[4]
            errors.append(info["reference"] - info["output"])
    return float(np.sqrt(np.mean(np.square(errors))))


def test_no_start_is_better_and_the_environment_confirms_it(found):
    for bound in found:
        assert bound.rmse < min(bound.starts.values())
        # actions of an environment are float32: 120 N have steps of 7e-6 N
        assert replayed(SINE, OPTIONS, bound.seed, bound.command) == pytest.approx(bound.rmse, rel=0.02)


def test_rigs_differ_and_the_safety_limit_is_kept(found):
    assert found[0].rmse != found[1].rmse
    for bound in found:
        assert bound.command.max() <= 100.0 + 1e-9
        assert 0.0 <= bound.off <= 1.0 and bound.spread >= 0.0


def test_on_a_task_of_the_suite_no_law_that_it_began_from_is_ahead():
    """With the sensors of the level a law sends the commands that it sends on the board."""
    env_id, options = "cable_envs/CableHole-Hold-Hard-v1", {"split": "test", "duration": 5.0}
    (bound,) = upper_bound(env_id, [2000017], options, rounds=1)
    assert {"oracle", "oracle x 0.25", "stay", "lqg-suite", "pid-suite"} <= set(bound.starts)
    assert not {"camera-jaw-suite", "drive-side-suite"} & set(bound.starts)
    assert bound.rmse <= min(bound.starts.values()) * (1.0 + 1e-9)
    entrant = controller_file_entrant("lqg-suite")
    with gym.make(env_id, **entrant.enters(env_id, options)) as env:
        episode = run_episode(env, entrant.make(env.unwrapped.setup), 2000017)
    assert bound.starts["lqg-suite"] == pytest.approx(priced_rmse(episode), rel=1e-12)


def test_a_single_step_is_not_known_before_it_comes():
    """Up to the step the commands are those of a controller that did not know of it."""
    env_id, options = "cable_envs/CableHole-Position-Step-v0", {"duration": 1.0}
    reference = {"kind": "step", "start": 0.5, "amplitude": 0.002}
    (bound,) = upper_bound(env_id, [3], options, {"reference": reference}, starts=1, rounds=2)
    assert np.ptp(bound.command[:50]) < 0.5 < np.ptp(bound.command)


def test_slopes_are_those_of_the_simulator():
    """Along a motion, the slopes of all steps predict where a small change of the actions leads. 5 %: it is small."""
    with gym.make(SINE, duration=0.5) as env:
        env.reset(seed=0)
        plants = Plants([env.unwrapped.simulation.state()], env.unwrapped.setup)
    actions = np.linspace(-0.2, 0.6, 50)[:, None]
    _, errors, blocks = plants.follow(lambda k, _: actions[k], 1, keep=True)
    plants.relevant(blocks)
    a, b, output = plants.slopes(blocks, plants.scales(blocks))
    assert len(plants.rows) < 10  # of some thirty signals and states
    change, state = 1e-5 * np.cos(np.arange(50.0)), np.zeros(len(plants.rows))
    _, moved, _ = plants.follow(lambda k, _: actions[k] + change[k], 1)
    for k in range(50):
        state = a[k, 0] @ state + b[k, 0] * change[k]
    assert errors[-1, 0] - moved[-1, 0] == pytest.approx(state[output], rel=0.05)


def test_unknown_environments_and_options_are_refused():
    with pytest.raises(ConfigurationError, match="CableHole-Position-Sine"):
        upper_bound("cable_envs/CableHole-Position-Sin-v0", [0])
    with pytest.raises(ConfigurationError, match="randomize"):
        upper_bound(SINE, [0], {"randomise": True})
