"""Does a diagnosis pay? What `cablebench pays` asks, how it scores, and what it reports.

A hidden rig (the chain of spans and contacts, with concealed effects) is controlled by what was tuned or trained on one
of three simulators (the analytic circuit): the nominal one, the one that a diagnosis of the hidden rig's recordings
corrected, and the oracle, which is told the concealed effects. A model-based controller believes its simulator's rig.
"""

import math
import shlex
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass, field
from typing import Any

import gymnasium as gym
import numpy as np

from cable_envs.errors import ConfigurationError
from cable_envs.setup import Setup
from cablebench.actors import Actor, ControllerActor
from cablebench.evaluate import badness, run_episode, setup_of
from cablebench.jobs import Context
from cablebench.metrics import measure
from cablebench.protocol import configuration_hash
from cablebench.statistics import bootstrap
from cablebench.tuning_objective import loss_of

SCHEMA = "cable-pays/1"
ENV = "cable_envs/PulleyCircuit-Position-Sine-v0"
NOMINAL_RIG = "zou-table2"
CONTROLLER, AGENT = "feedforward-pid", "residual-ppo"
LEARNERS = (CONTROLLER, AGENT)
SIMULATORS = ("nominal", "augmented", "oracle")
HIDDEN: Mapping[str, Mapping[str, float]] = {
    "backlash": {"gap": 0.1}, "actuator_lag": {"time": 0.1}, "coulomb_friction": {"level": 0.02},
}  # fmt: skip
"""Concealed effects: a gap of 0.1 rad between gear and pulley, a lag of 0.1 s, 0.02 N m of dry friction at the output:
each far above the sensors' noise, and each bends what an ideal drive would do by a few per cent of the motion."""
RESAMPLES = 4000


@dataclass(frozen=True)
class Study:
    """Everything that decides the numbers. seeds: of tuning and training; lengths in s; steps and trials for each."""

    hidden: Mapping[str, Mapping[str, float]] = field(default_factory=lambda: HIDDEN)
    seeds: tuple[int, ...] = (0, 1, 2)
    steps: int = 98_304
    trials: int = 15
    tuning_episodes: int = 2
    episodes: int = 6
    duration: float = 25.0
    record_seconds: float = 25.0

    def __post_init__(self) -> None:
        for name in ("steps", "trials", "tuning_episodes", "episodes"):
            if getattr(self, name) < 1:
                raise ConfigurationError(f"{name}: expected a whole number of at least 1, got {getattr(self, name)}")
        if not self.seeds or len(set(self.seeds)) < len(self.seeds):
            raise ConfigurationError(f"seeds: expected different whole numbers, got {list(self.seeds)}")
        setup_of(ENV, self.hidden_options())  # names what is wrong with the effects or the duration

    def hash(self) -> str:
        """Twelve hex digits that change with any setting."""
        return configuration_hash(asdict(self))

    def hidden_options(self) -> dict[str, Any]:
        """Environment options of the hidden rig."""
        effects = {name: dict(values) for name, values in self.hidden.items()}
        return {"rig": NOMINAL_RIG, "plant": "chain", "effects": effects, **self._common()}

    def simulator_options(self, simulator: str, augmented: Mapping[str, Any]) -> dict[str, Any]:
        """Environment options of one of `SIMULATORS`; ``augmented``: content of the diagnosis's augmented.yaml."""
        if simulator == "augmented":
            return {"rig": dict(augmented), **self._common()}
        told = {"effects": self.hidden_options()["effects"]} if simulator == "oracle" else {}
        return {"rig": NOMINAL_RIG, **told, **self._common()}

    def _common(self) -> dict[str, Any]:
        return {"sensor_noise": True, "observe": "drive", "duration": self.duration}


def controller_actor(gains: Mapping[str, float], believed: Setup, acting: Setup) -> Actor:
    """The controller with ``gains`` that believes the rig of one setup and acts in another."""
    from baselines import make_controller

    case = (believed.plant.name, believed.action_mode.name, believed.task.kind)
    made = make_controller(CONTROLLER, *case, believed.rig.values, believed.control_period, **gains)
    return ControllerActor(made, acting)


def errors(actor: Callable[[Setup], Actor], options: Mapping[str, Any], seeds: Sequence[int]) -> list[float]:
    """RMSE of the true output, rad, in an episode of each seed; a failed one counts as the tuning counts it."""
    found = []
    with closing(gym.make(ENV, disable_env_checker=True, **options)) as env:
        setup: Any = env.unwrapped.setup
        acting = actor(setup)
        for seed in seeds:
            record = {"metrics": measure(run_episode(env, acting, seed))}
            found.append(math.exp(loss_of(badness(record), setup)))
    return found


def trial(context: Context, gains: Mapping[str, float], options: Mapping[str, Any], seeds: Sequence[int]) -> float:
    """Body of a tuning trial: mean logarithm of the RMSE, as `cablebench tune` minimises it."""
    found = errors(lambda setup: controller_actor(gains, setup, setup), options, seeds)
    return math.fsum(map(math.log, found)) / len(found)


def summary(scores: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """Per learner: error of each simulator, and what the augmented one saves, with 95 % bootstrap intervals over seeds.

    scores: learner -> simulator -> RMSE [seeds, episodes], rad. Savings are paired: same seed, same episode. ``closed``
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


def command(study: Study, quick: bool) -> str:
    """The command line that repeats the study (without ``--out``)."""
    words = ["cablebench", "pays"] + (["--quick"] if quick else [])
    for name, value in (
        ("--steps", study.steps), ("--trials", study.trials), ("--episodes", study.episodes),
        ("--tuning-episodes", study.tuning_episodes), ("--duration", study.duration),
        ("--record-seconds", study.record_seconds),
    ):  # fmt: skip
        words += [name, f"{value:g}" if isinstance(value, float) else str(value)]
    for seed in study.seeds:
        words += ["--seed", str(seed)]
    for effect, values in study.hidden.items():
        for parameter, value in values.items():
            words += ["--hide", f"{effect}.{parameter}={value:g}"]
    return shlex.join(words)


def page(result: Mapping[str, Any]) -> str:
    """The result as a page in Markdown."""
    lines = [
        "# Does it pay?",
        "",
        f"A hidden pulley circuit (the chain of spans and contacts; effects: {_said(result['hidden'])}) was recorded, "
        f"and `cablebench diagnose` was asked, which knew the rig `{NOMINAL_RIG}` and nothing of the effects. Then the "
        f"paper's controller (`{CONTROLLER}`) was tuned and an agent (`{AGENT}`, without randomisation) trained on "
        "three analytic simulators each: the nominal one, the corrected one, and one told the effects. All were "
        "scored on the hidden circuit.",
        "",
        "```",
        result["command"],
        "```",
        "",
        f"The diagnosis answered **{result['diagnosis']['verdict']}**: {_answer(result['diagnosis']['effects'])}.",
        "",
        "Tracking error on the hidden circuit, RMSE in mrad of the output angle, with 95 % bootstrap intervals over "
        f"{len(result['seeds'])} seeds and {result['episodes']} episodes each:",
        "",
        "| learner | nominal | augmented | oracle | saved by the diagnosis | share of the oracle's saving |",
        "|---|---|---|---|---|---|",
    ]
    for learner, entry in result["summary"].items():
        closed = "-" if entry["closed"] is None else f"{100 * entry['closed']:.0f} %"
        cells = [_mrad(entry[name]) for name in (*SIMULATORS, "saved")]
        lines.append(f"| `{learner}` | {' | '.join(cells)} | {closed} |")
    budget = result["budget"]
    lines += [
        "",
        f"Each tuning had {budget['trials']} trials, each training {budget['steps']} steps, on every simulator alike.",
        "The controller measures the drive alone and has no term for a gap, so what it can gain is in its gains and in "
        "the rig it believes; the agent can also learn to lead through a gap.",
    ]  # fmt: skip
    return "\n".join(lines) + "\n"


def _said(hidden: Mapping[str, Mapping[str, float]]) -> str:
    return ", ".join(f"{e}.{p} = {v:g}" for e, values in hidden.items() for p, v in values.items())


def _answer(effects: Sequence[Mapping[str, Any]]) -> str:
    if not effects:
        return "no effect"
    return "; ".join(
        ", ".join(f"{n} = {q['value']:.3g} {q['unit']}" for n, q in e["parameters"].items()) or e["name"]
        for e in effects
    )


def _mrad(found: Mapping[str, Any]) -> str:
    return f"{1e3 * found['value']:.1f} [{1e3 * found['low']:.1f}, {1e3 * found['high']:.1f}]"
