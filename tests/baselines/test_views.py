"""The reference controllers on every plant that has a view: nothing here names a plant."""

import functools
import math

import gymnasium as gym
import numpy as np
import pytest

import cable_envs
from baselines import CONTROLLERS
from cable_envs.core.errors import ConfigurationError
from cable_envs.plants import families, family, plant_for
from cable_envs.sim.registered import setup_of
from cable_envs.sim.rigs import load_rig
from cable_envs.sim.tasks import TASKS, load_task
from cablebench.entrants.named import reference_entrants
from cablebench.protocol.metrics import measure
from cablebench.run.evaluation import run_episode

VIEWED = [one for one in families().values() if one.view]
ENTRANTS = {e.name: e for e in reference_entrants()}
ENVS = [i for i in cable_envs.ENV_IDS if any(i.split("/")[1].startswith(f"{one.tasks}-") for one in VIEWED)]
CASES = [
    (task, mode.name)
    for one in VIEWED
    for task in TASKS
    if task.split("-")[0] == one.tasks
    for mode in plant_for(one.name).action_modes
]


@functools.cache
def rmse(env_id, name, mode):
    options = {"action_mode": mode}
    setup = setup_of(env_id, options)
    options |= ENTRANTS[name].needs(env_id, setup)
    env = gym.make(env_id, **options)
    return measure(run_episode(env, ENTRANTS[name].make(env.unwrapped.setup), seed=1))["rmse"]


@pytest.mark.parametrize(("task", "mode"), CASES)
def test_steady_command_is_that_of_the_plant_at_rest(task, mode):
    """Without friction the command that holds a reference is what the plant itself has at rest there."""
    declared = load_task(task)
    rig = load_rig(declared.rig)
    told, plant = family(rig.plant), plant_for(rig.plant)
    view = told.sees()(rig.values, mode, declared.kind)
    chosen = next(m for m in plant.action_modes if m.name == mode)
    values = rig.column(plant)
    for reference in declared.references.values():
        wanted = reference.get("offset", 0.0)
        start = told.output(declared.kind).start({k: np.array([v]) for k, v in rig.values.items()}, np.array([wanted]))
        held = plant.rest(plant.prepare(values), start)[plant.row(chosen.rest_signal), 0]
        assert view.steady((wanted, 0.0, 0.0), 0.0) == pytest.approx(held, rel=1e-9)
        assert view.steady((wanted, 0.0, 0.0), -1.0) < held < view.steady((wanted, 0.0, 0.0), 1.0)


@pytest.mark.parametrize("env_id", ENVS)
def test_what_knows_more_tracks_better(env_id):
    """In the task's own action mode: feedforward and feedback beat open loop, and nobody beats the oracle by much."""
    mode = setup_of(env_id, {}).action_mode.name
    found = {name: rmse(env_id, name, mode) for name in ("open-loop", "pid", "feedforward-pid", "oracle")}
    assert all(math.isfinite(v) for v in found.values())
    assert found["pid"] < found["open-loop"] and found["feedforward-pid"] < found["open-loop"], found
    assert found["oracle"] <= 1.05 * min(found.values()), found


@pytest.mark.parametrize("env_id", [i for i in ENVS if "Sine" in i])
def test_controllers_of_a_hauled_load_apply_where_the_command_is_a_tension(env_id):
    setup = setup_of(env_id, {})
    told = family(setup.rig.plant)
    for mode in setup.plant.action_modes:
        applies = CONTROLLERS["mrac-g22"].applies(setup.plant.name, mode.name, setup.task.kind)
        assert applies == (mode.name in told.sees().hauls)
        if applies:
            assert rmse(env_id, "mrac-g22", mode.name) < rmse(env_id, "open-loop", mode.name)


def test_a_plant_without_a_view_says_so():
    for one in families().values():
        if not one.view:
            with pytest.raises(ConfigurationError, match=f"{one.name} has no view"):
                one.sees()
