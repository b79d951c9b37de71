"""Policies of any library as a .py file with act_observation(obs): the observation is the project's own."""

import textwrap

import gymnasium as gym
import numpy as np
import pytest

from cable_envs.core.errors import ConfigurationError
from cable_envs.sim.registered import setup_of
from cablebench.cli import main
from cablebench.entrants.apart import submission_entrant
from cablebench.entrants.controller_files import controller_file_entrant
from cablebench.run.evaluation import run_episode
from tests.cablebench.test_submit import TINY

HOLE, CIRCUIT = "cable_envs/CableHole-Position-Sine-v0", "cable_envs/PulleyCircuit-Position-Sine-v0"
WEIGHTS = [0.1, 0.02, 0.0, 0.4, 0.3, 0.05, -0.1, 0.2, 0.0, 0.01]
GOOD = f"""
name = "net"
information = "model-free"
observe = "output"
action_mode = "tension"

def act_observation(obs):
    return [sum(w * x for w, x in zip({WEIGHTS}, obs))]
"""


class Direct:
    """What the file does, without a file."""

    def start(self, env):
        pass

    def act(self, observation, t):
        return np.array([sum(w * x for w, x in zip(WEIGHTS, observation.tolist()))], np.float32)


@pytest.fixture
def written(tmp_path):
    def write(text=GOOD, name="net.py"):
        (tmp_path / name).write_text(textwrap.dedent(text))
        return tmp_path / name

    return write


def test_it_sees_the_environments_observation_and_its_answer_is_the_action(written):
    entrant = submission_entrant(written())
    options = entrant.enters(HOLE, {"duration": 0.5, "sensor_noise": True})
    assert options == {"duration": 0.5, "sensor_noise": True, "observe": "output", "action_mode": "tension"}
    env = gym.make(HOLE, **options)
    theirs = run_episode(env, entrant.make(env.unwrapped.setup), seed=3)
    ours = run_episode(gym.make(HOLE, **options), Direct(), seed=3)
    assert np.array_equal(theirs.reward, ours.reward) and len(np.unique(ours.command)) > 10


def test_it_enters_where_its_action_mode_is_there(written):
    entrant = submission_entrant(written())
    assert entrant.needs(CIRCUIT, setup_of(CIRCUIT, {})) is None  # a circuit's drive is not commanded in tension
    assert entrant.needs(HOLE, setup_of(HOLE, {})) is not None


def test_reset_may_be_there_and_gains_go_to_a_class(written, tmp_path):
    written("""
        information = "model-free"
        tasks = ["CableHole-Position-Sine"]

        class Net:
            def __init__(self, gain=0.0):
                self.gain = gain

            def reset(self, about):
                assert "rig" not in about and about["task"] == "position"
                self.steps = 0

            def act_observation(self, obs):
                self.steps += 1
                return self.gain * self.steps
    """)
    (tmp_path / "net.yaml").write_text(
        "schema: cable-controller/1\nname: net-tuned\ncontroller: net.py\n"
        "gains: {CableHole-Position-Sine: {gain: 0.001}}\n"
    )
    entrant = controller_file_entrant(tmp_path / "net.yaml")
    env = gym.make(HOLE, duration=0.1)
    actor = entrant.make(env.unwrapped.setup)
    for _ in range(2):  # an episode begins anew
        observation, _ = env.reset(seed=0)
        actor.start(env.unwrapped)
        assert [float(actor.act(observation, 0.0)[0]) for _ in range(2)] == pytest.approx([0.001, 0.002])


def asked_once(path):
    env = gym.make(HOLE)
    env.reset(seed=0)
    actor = submission_entrant(path).make(env.unwrapped.setup)
    actor.start(env.unwrapped)
    actor.act(np.zeros(10, np.float32), 0.0)


@pytest.mark.parametrize(("change", "expected"), [
    (("act_observation(obs)", "act_observation(t, obs)"), r"act_observation\(t, obs\) does not take the arguments"),
    (('"tension"', '"tensoin"'), "did you mean 'tension'"),
    (("def act_obs", "def act(t, y, ref):\n    return 0.0\n\ndef act_obs"), "has both act"),
    (("return [", "return [1.0, 2.0] or ["), r"answered \[1.0, 2.0\] \(list\) at t = 0 s; expected one number"),
    (("return [", "return obs['error'] or ["), r"act_observation\(\) raised TypeError"),
])  # fmt: skip
def test_what_is_wrong_is_said_with_the_file(written, change, expected):
    path = written(GOOD.replace(*change))
    with pytest.raises(ConfigurationError, match=expected) as caught:
        asked_once(path)
    assert str(path) in str(caught.value) and "\n" not in str(caught.value)


def test_it_gets_a_row_on_a_board(written, tmp_path, capsys):
    (tmp_path / "tiny.yaml").write_text(TINY)
    place = ["--protocol", tmp_path / "tiny.yaml", "--results", tmp_path / "results"]
    with pytest.raises(SystemExit) as end:
        main([str(word) for word in ("submit", written(), *place, "--trust")])
    said = capsys.readouterr().err
    assert not end.value.code and "(model-free)" in said, said
