"""`python -m benchmarks.headroom`: what each task of suite v1 leaves between doing nothing and an oracle.

The error of an episode is the root mean square of the priced error (`cable_envs.sim.suite.judging`) after the homing,
on the rigs of the split "test". With e0 the least median of the open loop and of a drive that stays where it began, and
e1 the least median of all entrants and the oracle,

    score = min(max(ln(e0 / e) / ln(e0 / e1), 0), 1.2), and 0 where a rule has ended the episode.

The oracle has the true rig without the concealed effects, ideal sensors, every signal and the acceleration of the
reference; of three sizes of its gains the best is taken, as the full ones shake the drive. Intervals are of 95 %, by
bootstrap over episodes. A task discriminates where the intervals of the differences between the best classical
controller, the best agent and the oracle, episode by episode, leave out zero, and the best of the two first is below
0.8; without agents, where those of the classical controller and the oracle do.
"""

import argparse
import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

import cable_envs
from cable_envs.baselines import CONTROLLERS, controller_class
from cable_envs.core.errors import ConfigurationError
from cable_envs.core.files import write_atomic
from cable_envs.sim.registered import setup_of
from cablebench.entrants.entrant import Entrant, controller_entrant
from cablebench.entrants.named import named_entrant
from cablebench.protocol.files import load_protocol
from cablebench.run.evaluation import core_of, run_episode

OPEN, ORACLE, NOTHING = "open-loop", "oracle", "nothing"
IDEAL = {"sensors": "ideal", "preview": True, "sensor_noise": False, "sensor_delay": 0}
SIZES = (1.0, 0.5, 0.25)
"""Of the oracle's gains."""
ENOUGH, HIGHEST = 0.8, 1.2
DRAWS = 2000
QUIET = -2.5
"""Logarithm of the standard deviation of PPO's first actions: a quarter of the shipped one's."""


@dataclass(frozen=True)
class Row:
    """One entrant on one task: the errors of its episodes, SI (infinite where a rule has ended one), and its part."""

    entrant: str
    part: str
    errors: tuple[float, ...]
    failures: tuple[str, ...]

    @property
    def median(self) -> float:
        """The median error; infinite where half of the episodes have failed."""
        return float(np.median(self.errors))


class Stay:
    """The command of the start, whatever happens."""

    def start(self, env: Any) -> None:
        self.action = env.simulation.buffers.named.action.copy()

    def act(self, observation: np.ndarray, t: float) -> np.ndarray:
        return self.action


def staying() -> Entrant:
    """A drive that stays where it began."""
    return Entrant(NOTHING, "model-free", lambda setup: Stay(), lambda env_id, setup: {}, "")


def oracles(env_id: str) -> Iterable[Entrant]:
    """The oracle with each of the `SIZES` of its gains per second."""
    setup = setup_of(env_id, {})
    kind = controller_class(ORACLE)
    table = kind.parameters_for(setup.plant.name, setup.action_mode.name, setup.task.kind)
    rates = {name: table[name] for name in table.names if table[name].unit == "1/s"}
    for size in SIZES:
        gains = {name: max(one.default * size, one.low) for name, one in rates.items()} if size != 1.0 else {}
        yield replace(controller_entrant(ORACLE, gains), name=f"oracle x {size:g}")


def measure(env_id: str, entrant: Entrant, part: str, seeds: Iterable[int]) -> Row | None:
    """Run an entrant on an environment of the suite; None where it does not enter."""
    asked: dict[str, Any] = {"split": "test"}
    if part == ORACLE:
        drawn = setup_of(env_id, asked).randomize  # effects are drawn last: the rigs are the same without them
        open_to_it = {name: {"low": low, "high": high} for name, low, high in drawn if "." not in name}
        asked |= IDEAL | {"randomize": open_to_it}
    options = entrant.enters(env_id, asked)
    if options is None or not _allowed(env_id, options):
        return None
    env = gym.make(env_id, **options)
    setup = core_of(env).setup
    assert setup.conditions is not None
    errors, failures = [], []
    actor = entrant.make(setup)
    for seed in seeds:
        episode = run_episode(env, actor, seed)
        scored = episode.signals["priced_error"][episode.time >= setup.task.homing]
        rule = int(episode.signals["failure"][-1])
        failed = bool(rule) or not episode.complete
        errors.append(math.inf if failed else float(np.sqrt(np.mean(scored**2))))
        failures.append(setup.conditions.rules[rule - 1].name if rule else "not finite" if failed else "")
    env.close()
    return Row(entrant.title, part, tuple(errors), tuple(filter(None, failures)))


def _allowed(env_id: str, options: Mapping[str, Any]) -> bool:
    """Whether the level has the sensors that an entrant asks for."""
    try:
        setup_of(env_id, options)
    except ConfigurationError:
        return False
    return True


def scores(rows: list[Row]) -> dict[str, np.ndarray]:
    """Score of every episode by entrant."""
    e0 = min(row.median for row in rows if row.part == NOTHING)
    e1 = min(row.median for row in rows)
    if not math.isfinite(e0):
        raise ValueError("a drive that stays where it is fails in half of the episodes")
    span = math.log(e0 / e1) if e1 < e0 else math.nan
    with np.errstate(divide="ignore"):  # the logarithm of what has failed
        return {row.entrant: np.clip(np.log(e0 / np.array(row.errors)) / span, 0.0, HIGHEST) for row in rows}


def interval(values: np.ndarray) -> tuple[float, float]:
    """95 % interval of the mean."""
    picks = np.random.default_rng(0).integers(0, len(values), (DRAWS, len(values)))
    low, high = np.quantile(values[picks].mean(axis=1), [0.025, 0.975])
    return float(low), float(high)


def judged(rows: list[Row]) -> dict[str, Any]:
    """The best of each part with its score, and whether the task discriminates."""
    found = scores(rows)
    best: dict[str, Any] = {}
    for part in ("classical", "agent", ORACLE):
        means = {row.entrant: float(found[row.entrant].mean()) for row in rows if row.part == part}
        if means:
            name = max(means, key=lambda n: means[n])
            best[part] = {"entrant": name, "score": means[name], "interval": interval(found[name])}
    chosen = [found[one["entrant"]] for one in best.values()]
    ends = [interval(a - b) for k, a in enumerate(chosen) for b in chosen[:k]]  # they see the same episodes
    separate = all(low > 0.0 or high < 0.0 for low, high in ends)
    others = [best[part]["score"] for part in best if part != ORACLE]
    return {**best, "discriminates": separate and max(others, default=1.0) < ENOUGH if others else None}


def agent(env_id: str, steps: int, folder: Path) -> Entrant:
    """PPO with its shipped settings but less exploration, whose noise is priced; trained on the rigs to train on."""
    from cable_envs.agents.settings import load_settings
    from cable_envs.agents.train import train
    from cablebench.entrants.entrant import agent_entrant

    changes = {"policy_kwargs": {"log_std_init": QUIET}, "gamma": 0.98}
    settings = load_settings("ppo", env_id, n_timesteps=steps, env_options={"split": "train"}, changes=changes)
    policy = train(settings, 0, folder / env_id.split("/")[1], resume="auto")
    return agent_entrant("ppo", policy, env_id, 0, steps)


def table(results: Mapping[str, Any]) -> str:
    """The results as Markdown."""
    lines = [
        "| task | doing nothing | best classical | best agent | oracle | discriminates |",
        "|---|--:|---|---|--:|---|",
    ]
    for env_id, one in results.items():
        unit = setup_of(env_id, {}).output_unit
        cells = [f"{min(one['errors'][name] for name in (OPEN, NOTHING) if name in one['errors']):.3g} {unit}"]
        for part in ("classical", "agent", ORACLE):
            best = one["judged"].get(part)
            cells.append(_cell(best, one, unit) if best else "none")
        verdict = {True: "yes", False: "no", None: "none enters"}[one["judged"]["discriminates"]]
        lines.append(f"| {env_id.split('/')[1]} | {' | '.join(cells)} | {verdict} |")
    return "\n".join(lines)


def _cell(best: Mapping[str, Any], one: Mapping[str, Any], unit: str) -> str:
    low, high = best["interval"]
    error, failed = one["errors"][best["entrant"]], len(one["failures"].get(best["entrant"], ()))
    text = f"{best['entrant']} {error:.3g} {unit}, {best['score']:.2f} [{low:.2f}, {high:.2f}]"
    return text + (f", {failed} failed" if failed else "")


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.headroom", description=__doc__)
    parser.add_argument("tasks", nargs="*", help="parts of ids, as CableHole-Track or Hard; all by default")
    parser.add_argument("--episodes", type=int, default=8, help="test episodes of each task")
    parser.add_argument("--controller", action="append", help="a classical entrant; all references by default")
    parser.add_argument("--train", type=int, default=0, help="steps to train PPO for on each task; 0: no agent")
    parser.add_argument("--out", type=Path, default=Path("results/headroom"))
    arguments = parser.parse_args()
    names = arguments.controller or [name for name in CONTROLLERS if name not in (OPEN, ORACLE)]
    chosen = [i for i in cable_envs.SUITE_IDS if not arguments.tasks or any(part in i for part in arguments.tasks)]
    seeds = load_protocol("quick").seeds(arguments.episodes)
    file = arguments.out / "headroom.json"
    results: dict[str, Any] = json.loads(file.read_text()) if file.is_file() else {}
    for env_id in chosen:
        entrants = [(named_entrant(OPEN), NOTHING), (staying(), NOTHING)]
        entrants += [(entrant, ORACLE) for entrant in oracles(env_id)]
        entrants += [(named_entrant(name), "classical") for name in names]
        if arguments.train:
            entrants.append((agent(env_id, arguments.train, arguments.out), "agent"))
        rows = [row for entrant, part in entrants if (row := measure(env_id, entrant, part, seeds)) is not None]
        results[env_id] = {
            "episodes": arguments.episodes, "errors": {row.entrant: row.median for row in rows},
            "failures": {row.entrant: row.failures for row in rows}, "judged": judged(rows),
            "scores": {name: float(values.mean()) for name, values in scores(rows).items()},
        }  # fmt: skip
        print(env_id, json.dumps(results[env_id]), flush=True)
        arguments.out.mkdir(parents=True, exist_ok=True)
        write_atomic(file, json.dumps(results, indent=1).encode())
    print(table({env_id: results[env_id] for env_id in chosen}))


if __name__ == "__main__":
    main()
