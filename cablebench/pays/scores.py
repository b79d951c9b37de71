"""Does a diagnosis pay? What `cablebench retrain-study` asks, how it scores, and what it sums up.

A hidden rig (`cablebench.pays.rigs`) is controlled by what was tuned or trained on one of three simulators: the nominal
one, the one that a diagnosis of the hidden rig's recordings corrected, and the oracle, which is told the concealed
effects. A model-based controller believes its simulator's rig.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np

from cable_envs.core.config import configuration_hash
from cable_envs.core.errors import ConfigurationError, require_known
from cable_envs.sim.registered import setup_of
from cable_envs.sim.setup import Setup
from cablebench.jobs import Context
from cablebench.pays.rigs import RIGS, HiddenRig
from cablebench.protocol.actors import Actor, controller_actor
from cablebench.protocol.metrics import measure
from cablebench.run.evaluation import core_of, run_episode
from cablebench.run.records import badness
from cablebench.score.statistics import bootstrap
from cablebench.tune.objective import loss_of

SCHEMA = "cable-pays/1"
SIMULATORS = ("nominal", "augmented", "oracle")
RESAMPLES = 4000


@dataclass(frozen=True)
class Study:
    """Everything that decides the numbers of one rig. seeds: of tuning and training; lengths in s.

    rig: a key of `RIGS`; hidden, duration: None takes that rig's effects and length of an episode.
    """

    rig: str = "circuit"
    hidden: Mapping[str, Mapping[str, float]] | None = None
    seeds: tuple[int, ...] = (0, 1, 2)
    steps: int = 499_712
    trials: int = 60
    tuning_episodes: int = 2
    episodes: int = 6
    duration: float | None = None
    record_seconds: float = 25.0

    def __post_init__(self) -> None:
        require_known("rig", [self.rig], RIGS)
        for name in ("steps", "trials", "tuning_episodes", "episodes"):
            if getattr(self, name) < 1:
                raise ConfigurationError(f"{name}: expected a whole number of at least 1, got {getattr(self, name)}")
        if not self.seeds or len(set(self.seeds)) < len(self.seeds):
            raise ConfigurationError(f"seeds: expected different whole numbers, got {list(self.seeds)}")
        setup_of(self.bench.env, self.hidden_options())  # names what is wrong with the effects or the duration

    @property
    def bench(self) -> HiddenRig:
        """The rig that is hidden."""
        return RIGS[self.rig]

    @property
    def learners(self) -> tuple[str, str]:
        """(controller, agent)."""
        return self.bench.controller, self.bench.agent

    @property
    def effects(self) -> dict[str, dict[str, float]]:
        """What is concealed, SI."""
        chosen = self.bench.effects if self.hidden is None else self.hidden
        return {name: dict(values) for name, values in chosen.items()}

    def asked(self) -> dict[str, Any]:
        """All that decides a seed's numbers. Which seeds there are does not: a study may be given more, or fewer."""
        return {
            "rig": self.rig, "preset": self.bench.preset, "hidden": self.effects, "steps": self.steps,
            "trials": self.trials, "tuning_episodes": self.tuning_episodes, "episodes": self.episodes,
            "duration": self.duration or self.bench.duration, "record_seconds": self.record_seconds,
        }  # fmt: skip

    def hash(self) -> str:
        """Twelve hex digits that change with any setting but the seeds."""
        return configuration_hash(self.asked())

    def hidden_options(self) -> dict[str, Any]:
        """Environment options of the hidden rig."""
        return {"rig": self.bench.preset, "plant": self.bench.plant, "effects": self.effects, **self._common()}

    def simulator_options(self, simulator: str, augmented: Mapping[str, Any]) -> dict[str, Any]:
        """Environment options of one of `SIMULATORS`; ``augmented``: content of the diagnosis's augmented.yaml."""
        if simulator == "augmented":
            return {"rig": dict(augmented), **self._common()}
        told = {"effects": self.effects} if simulator == "oracle" else {}
        return {"rig": self.bench.preset, **told, **self._common()}

    def _common(self) -> dict[str, Any]:
        length = self.duration or self.bench.duration
        return {"sensor_noise": True, "observe": self.bench.observe, "duration": length}


def errors(
    env_id: str, actor: Callable[[Setup], Actor], options: Mapping[str, Any], seeds: Sequence[int]
) -> list[float]:
    """RMSE of the true output, SI, in an episode of each seed; a failed one counts as the tuning counts it."""
    found = []
    with closing(gym.make(env_id, disable_env_checker=True, **options)) as env:
        setup = core_of(env).setup
        acting = actor(setup)
        for seed in seeds:
            record = {"metrics": measure(run_episode(env, acting, seed))}
            found.append(math.exp(loss_of(badness(record), setup)))
    return found


def trial(
    context: Context, rig: str, gains: Mapping[str, float], options: Mapping[str, Any], seeds: Sequence[int]
) -> float:
    """Body of a tuning trial: mean logarithm of the RMSE, as `cablebench tune` minimises it."""
    bench = RIGS[rig]
    found = errors(bench.env, lambda setup: controller_actor(bench.controller, gains, setup, setup), options, seeds)
    return math.fsum(map(math.log, found)) / len(found)


def summary(scores: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """Per learner: error of each simulator, and what the augmented one saves, with 95 % bootstrap intervals over seeds.

    scores: learner -> simulator -> RMSE [seeds, episodes], SI. Savings are paired: same seed, same episode. ``closed``
    is the share of the way from nominal to oracle; None where the oracle is not better than the nominal.
    """
    found: dict[str, Any] = {}
    for learner, by_simulator in scores.items():
        tables = {name: np.asarray(by_simulator[name], float) for name in SIMULATORS}
        entry: dict[str, Any] = {name: _interval(table) for name, table in tables.items()}
        entry["saved"] = _interval(tables["nominal"] - tables["augmented"])
        entry["saved_by_oracle"] = _interval(tables["nominal"] - tables["oracle"])
        way = entry["saved_by_oracle"]["value"]
        entry["closed"] = entry["saved"]["value"] / way if way > 0.0 else None
        found[learner] = entry
    return found


def _interval(table: np.ndarray) -> dict[str, Any]:
    made = bootstrap({"hidden": table}, lambda v: v.mean(axis=-1), np.random.default_rng(20261121), RESAMPLES)
    return {"value": made.value, "low": made.low, "high": made.high, "over": made.unit, "runs": made.runs}
