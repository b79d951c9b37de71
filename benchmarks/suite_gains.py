"""`python -m benchmarks.suite_gains`: gains of the reference controllers for the tasks of suite v1.

A law is tuned on one task of each group that has the same sensors, and its gains hold for the group. The loss is the
mean logarithm of the priced error (`cable_envs.sim.suite.judging`) over episodes of the split "train" with the
protocol's seeds for tuning; half of them have sensors that are later by `MARGIN` control periods, so that the loop
keeps a margin of delay for rigs that nobody has tuned on. Trials are chosen by Optuna's tree-structured Parzen
estimator. Test rigs are never run. ``configs/controllers/<law>-suite.yaml`` gets the gains, group after group.
"""

import argparse
import math
import shlex
from collections.abc import Mapping, Sequence
from contextlib import closing
from typing import Any

import gymnasium as gym
import numpy as np
import optuna
import yaml

import cable_envs
from cable_envs.baselines import controller_class
from cable_envs.core.config import config_root
from cable_envs.core.files import write_atomic
from cable_envs.sim.registered import setup_of
from cablebench.entrants.controller_files import SCHEMA
from cablebench.entrants.entrant import Entrant, controller_entrant
from cablebench.protocol.files import load_protocol
from cablebench.run.evaluation import core_of, run_episode
from cablebench.tune.space import gain_space

GROUPS = {
    "CableHole-Track-Easy": ("CableHole-Step-Classic", "CableHole-Sine-Classic"),
    "CableHole-Track-Medium": ("CableHole-Sine-Medium", "CableHole-Series-Medium", "CableHole-Drift-Medium"),
    "CableHole-Track-Hard": ("CableHole-Sine-Hard", "CableHole-Drift-Hard"),
    "CableHole-Step-Hard": (), "CableHole-Hold-Easy": (), "CableHole-Hold-Medium": (), "CableHole-Hold-Hard": (),
    "CableHole-Series-Hard": (),
    "PulleyCircuit-Track-Easy": (), "PulleyCircuit-Track-Medium": ("PulleyCircuit-Track-Hard",),
    "PulleyCircuit-Grasp-Easy": (), "PulleyCircuit-Grasp-Medium": ("PulleyCircuit-Grasp-Hard",),
    "TendonSheath-Track-Medium": ("TendonSheath-Track-Hard",),
}  # fmt: skip
"""Task to tune on -> tasks that take its gains."""

_GENTLE = {"approach": 0.7, "width": 0.01}

STARTS: Mapping[tuple[str, str], Mapping[str, float]] = {
    ("scheduled-pid", "position"): {"kp": 8000.0, "ki": 4e4, "ki_rest": 4e4, "kd": 200.0, **_GENTLE},
    ("scheduled-pid", "tension"): {"kp": 0.5, "ki": 15.0, "ki_rest": 15.0, **_GENTLE},
    ("adaptive-inverse", "position"): {"kp": 1600.0, "kd": 40.0, "observer": 4.0, "walk": 0.01, **_GENTLE},
    ("adaptive-inverse", "tension"): {"kp": 0.5, "ki": 15.0, **_GENTLE},
    ("lqg", "position"): {"q_position": 5e5, "q_velocity": 10.0, "jerk": 1.0, "noise_velocity": 0.02, **_GENTLE},
    ("lqg", "tension"): {"q": 0.01, "jerk": 5.0, "noise": 1.0, "lag": 0.05, "approach": 0.1, "width": 0.01},
    ("drive-side", "position"): _GENTLE,
}
"""Gains that the search begins with where the defaults, made for sensors without delay, let the loop swing."""

LAWS = ("pid", "scheduled-pid", "adaptive-inverse", "lqg", "drive-side", "camera-jaw", "grasp-jaw", "sheath-drive-side")
NEAR, INSIDE = 0.04, 0.04
"""Shares of a box: how far from the beginning half of the trials are, and how near they come to its edges."""
MARGIN = 2
"""Control periods."""
WORST = 1000.0
"""Error of an episode that a rule ends, in error scales of its task."""


def loss(env_id: str, entrant: Entrant, seeds: Sequence[int]) -> float:
    """Mean logarithm of the priced errors."""
    late = setup_of(env_id, {"split": "train"}).sensor_delay + MARGIN
    found = []
    for k, asked in enumerate(({"split": "train"}, {"split": "train", "sensor_delay": late})):
        options = entrant.enters(env_id, asked)
        assert options is not None
        with closing(gym.make(env_id, disable_env_checker=True, **options)) as env:
            setup = core_of(env).setup
            actor = entrant.make(setup)
            for seed in seeds[k::2]:
                episode = run_episode(env, actor, seed)
                scored = episode.signals["priced_error"][episode.time >= setup.task.homing]
                failed = episode.signals["failure"][-1] > 0.0 or not episode.complete
                worst = WORST * setup.task.error_scale
                found.append(math.log(worst if failed else min(float(np.sqrt(np.mean(scored**2))), worst)))
    return math.fsum(found) / len(found)


def tuned(law: str, env_id: str, trials: int, seeds: Sequence[int]) -> tuple[dict[str, float], float]:
    """The best gains of a law on a task, and their loss."""
    setup = setup_of(env_id, {"split": "train"})
    kind = controller_class(law)
    table = kind.parameters_for(setup.plant.name, setup.action_mode.name, setup.task.kind)
    space = gain_space(table)
    begins = {p.name: p.default for p in table} | dict(STARTS.get((law, setup.task.kind), {}))
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    sampler = optuna.samplers.TPESampler(seed=0, n_startup_trials=max(trials // 4, 4))
    study = optuna.create_study(sampler=sampler)
    study.enqueue_trial({d.name: d.coordinate(begins[d.name]) for d in space})
    spread = np.random.default_rng(0)
    for _ in range(trials // 2):  # about the beginning: the box spans decades that no loop can use
        near = {}
        for d in space:
            ends = d.coordinate(d.low), d.coordinate(d.high), d.coordinate(begins[d.name])
            low, high, begin = map(math.log, ends) if d.kind == "log" else ends
            where = begin + NEAR * (high - low) * spread.standard_normal()
            where = min(max(where, low + INSIDE * (high - low)), high - INSIDE * (high - low))
            near[d.name] = math.exp(where) if d.kind == "log" else where
        study.enqueue_trial(near)

    def one(trial: optuna.Trial) -> float:
        chosen = {d.name: trial._suggest(d.name, d.distribution()) for d in space}
        return loss(env_id, controller_entrant(law, {d.name: d.value(chosen[d.name]) for d in space}), seeds)

    study.optimize(one, n_trials=trials)
    return {d.name: d.value(study.best_params[d.name]) for d in space}, study.best_value


def written(law: str, gains: Mapping[str, Mapping[str, float]], trials: int, made_by: str) -> None:
    """Write the controller file of a law."""
    content: dict[str, Any] = {
        "schema": SCHEMA, "name": f"{law}-suite", "controller": law, "charged": {"tuning_trials": trials},
        "gains": {env_id: dict(gains[env_id]) for env_id in cable_envs.SUITE_IDS if env_id in gains},
        "made_by": made_by,
    }  # fmt: skip
    text = yaml.safe_dump(content, sort_keys=False, width=120)
    write_atomic(config_root() / "controllers" / f"{law}-suite.yaml", text)


def full(name: str) -> str:
    """The id of a task of the suite."""
    return f"cable_envs/{name}-v1"


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.suite_gains", description=__doc__)
    parser.add_argument("laws", nargs="*", default=LAWS, help=f"controllers; default: {shlex.join(LAWS)}")
    parser.add_argument("--trials", type=int, default=40, help="gain sets for a law and a group")
    parser.add_argument("--episodes", type=int, default=4, help="tuning episodes of a trial")
    parser.add_argument("--task", action="append", default=[], help="parts of names of tasks to tune on; default: all")
    arguments = parser.parse_args()
    seeds = [load_protocol("quick").tune.seed(k) for k in range(arguments.episodes)]
    for law in arguments.laws:
        file = config_root() / "controllers" / f"{law}-suite.yaml"
        gains = dict(yaml.safe_load(file.read_text())["gains"]) if file.is_file() else {}
        for name, others in GROUPS.items():
            if arguments.task and not any(part in name for part in arguments.task):
                continue
            if controller_entrant(law).enters(full(name), {"split": "train"}) is None:
                continue
            best, reached = tuned(law, full(name), arguments.trials, seeds)
            print(f"{law} on {name}: {math.exp(reached):.3g}, {best}", flush=True)
            gains |= {full(one): best for one in (name, *others)}
            asked = "".join(f" --task {part}" for part in arguments.task)
            made_by = f"python -m benchmarks.suite_gains {law} --trials {arguments.trials}{asked}"
            written(law, gains, arguments.trials, made_by)


if __name__ == "__main__":
    main()
