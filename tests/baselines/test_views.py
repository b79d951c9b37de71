"""The reference controllers on every plant that has a view: nothing here names a plant."""

import functools
import math

import gymnasium as gym
import numpy as np
import pytest

import cable_envs
from cable_envs.baselines import CONTROLLERS
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
    if not mode.of
]


@functools.cache
def metrics(env_id, name, mode):
    options = {"action_mode": mode}
    setup = setup_of(env_id, options)
    options |= ENTRANTS[name].needs(env_id, setup)
    env = gym.make(env_id, **options)
    return measure(run_episode(env, ENTRANTS[name].make(env.unwrapped.setup), seed=1))


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
    """In the task's own action mode. A step is judged by its overshoot: whoever spreads it is late on purpose."""
    mode = setup_of(env_id, {}).action_mode.name
    found = {name: metrics(env_id, name, mode) for name in ("open-loop", "pid", "feedforward-pid", "oracle")}
    rmse = {name: series["rmse"] for name, series in found.items()}
    assert all(math.isfinite(v) for v in rmse.values())
    assert rmse["pid"] < rmse["open-loop"] and rmse["feedforward-pid"] < rmse["open-loop"], rmse
    if "Sine" in env_id:
        assert rmse["oracle"] <= rmse["feedforward-pid"] < 0.5 * rmse["pid"], rmse
    else:
        assert found["oracle"]["overshoot"] < 0.1, found["oracle"]


@pytest.mark.parametrize("env_id", [i for i in ENVS if "Sine" in i])
def test_controllers_of_a_hauled_load_apply_where_the_command_is_a_tension(env_id):
    setup = setup_of(env_id, {})
    told = family(setup.rig.plant)
    for mode in setup.plant.action_modes:
        applies = CONTROLLERS["mrac-g22"].applies(setup.plant.name, mode.name, setup.task.kind)
        assert applies == (mode.name in told.sees().hauls)
        if applies:
            adaptive, none = (metrics(env_id, name, mode.name)["rmse"] for name in ("mrac-g22", "open-loop"))
            assert adaptive < none


def test_a_plant_without_a_view_says_so():
    for one in families().values():
        if not one.view:
            with pytest.raises(ConfigurationError, match=f"{one.name} has no view"):
                one.sees()
