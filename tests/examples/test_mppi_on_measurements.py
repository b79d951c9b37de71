"""The planner for the board: a class of its own, fed by measurements only, ahead of the tuned controllers."""

from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

from cablebench.board import build_board
from cablebench.entrants.apart import submission_entrant
from cablebench.entrants.named import named_entrant
from cablebench.protocol.protocol import Protocol, SeedRange, Task, Track
from cablebench.run.evaluation import evaluate

PLANNER = Path(__file__).parents[2] / "examples" / "mppi_on_measurements.py"
HOLE = "cable_envs/CableHole-Position-Sine-v0"


@pytest.fixture(scope="module", autouse=True)
def _compiled():
    """The kernels of the planner, kept before it runs: its own process may write nothing, and each would compile."""
    env = gym.make(HOLE)
    env.reset(seed=0)
    env.step(env.action_space.sample())
    batch = gym.make_vec(HOLE, num_envs=2, vectorization_mode="vector_entry_point", step_infos=False)
    batch.reset(seed=0)
    batch.step(batch.action_space.sample())


def test_it_is_told_the_nominal_rig_and_what_is_measured():
    entrant = submission_entrant(PLANNER)
    env = gym.make(HOLE, randomize=True, **entrant.needs(HOLE, gym.make(HOLE).unwrapped.setup))
    commands = []
    for seed in (1, 2):  # other rigs, the same measurements
        env.reset(seed=seed)
        actor = entrant.make(env.unwrapped.setup)
        actor.start(env.unwrapped)
        seen = np.full(len(env.unwrapped.channels), 0.01, np.float32)
        commands.append([float(actor.act(seen, 0.01 * k)[0]) for k in range(3)])
    assert commands[0] == commands[1] and len(set(commands[0])) == 3


@pytest.mark.slow
def test_it_leaves_the_tuned_controllers_behind_and_ranks_apart():
    protocol = Protocol(
        name="short", title="Short", tasks=(Task(HOLE, {"duration": 3.0}),),
        tracks=(Track("nominal", {"sensor_noise": True}),), train=SeedRange(0, 10), tune=SeedRange(10, 10),
        test=SeedRange(20, 10), episodes=2, resamples=50,
    )  # fmt: skip
    tuned = ("pid-tuned", "mrac-g22-tuned")
    entrants = [submission_entrant(PLANNER), *map(named_entrant, (*tuned, "open-loop", "oracle", "mrac-g22"))]
    rows = {r.entrant: r for r in build_board(protocol, evaluate(protocol, entrants)).tables[0].rows}
    planner = rows["mppi-nominal"]
    assert (planner.information, planner.rank) == ("planner", 1)
    for name in tuned:
        assert planner.raw["rmse"] < 0.6 * rows[name].raw["rmse"], name


@pytest.mark.slow
def test_an_episode_begins_as_the_first_did():
    entrant = submission_entrant(PLANNER)
    env = gym.make(HOLE, duration=0.2)
    actor = entrant.make(env.unwrapped.setup)
    runs = []
    for _ in range(2):
        observation, info = env.reset(seed=3)
        actor.start(env.unwrapped)
        runs.append([])
        for _ in range(20):
            observation, *_, info = env.step(actor.act(observation, info["time"]))
            runs[-1].append(info["output"])
    assert runs[0] == runs[1]
