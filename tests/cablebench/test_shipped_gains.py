"""Tuned gains that are shipped: their search found an optimum, and not a bound of its box."""

import math

import pytest

from cable_envs.baselines import controller_class
from cable_envs.sim.registered import setup_of
from cablebench.entrants.controller_files import load_controller_file, shipped_files
from cablebench.entrants.named import named_entrant
from cablebench.tune.space import gain_space

EDGE = 0.02
"""share of the box, on the scale of the search"""


@pytest.mark.parametrize("name", shipped_files())
def test_no_tuned_gain_lies_at_a_bound(name):
    """A bound of zero takes a term out of the law: it is no bound that was chosen too near."""
    file = load_controller_file(f"configs/controllers/{name}.yaml")
    near = []
    for env_id, gains in file.gains.items():
        setup = setup_of(env_id, {})
        kind = controller_class(file.controller)
        table = kind.parameters_for(setup.plant.name, setup.action_mode.name, setup.task.kind)
        tried = [d for d in gain_space(table) if d.name in gains]  # a gain that came later keeps its default
        for dimension in tried:
            low, high, value = (
                dimension.distribution().to_internal_repr(dimension.coordinate(v))
                for v in (dimension.low, dimension.high, gains[dimension.name])
            )
            if dimension.kind == "log":
                low, high, value = (math.log(v) for v in (low, high, value))
            share = (value - low) / (high - low)
            if share > 1.0 - EDGE or (share < EDGE and dimension.low != 0.0):
                near.append(f"{env_id} {dimension.name}")
    assert near == []


@pytest.mark.parametrize("name", shipped_files())
def test_file_says_what_its_gains_cost(name):
    entrant = named_entrant(name)
    assert entrant.charged["tuning_trials"] > 0
    envs = load_controller_file(f"configs/controllers/{name}.yaml").gains
    assert all(entrant.needs(env_id, setup_of(env_id, {})) is not None for env_id in envs)


def test_gains_of_a_suite_task_are_those_of_its_level():
    gains = load_controller_file("configs/controllers/pid-suite.yaml").gains
    for level in ("Easy", "Hard"):
        env_id = f"cable_envs/CableHole-Track-{level}-v1"
        actor = named_entrant("pid-suite").make(setup_of(env_id, {}))
        assert {name: actor.controller.gains[name] for name in gains[env_id]} == gains[env_id]
    assert gains["cable_envs/CableHole-Track-Easy-v1"] != gains["cable_envs/CableHole-Track-Hard-v1"]
