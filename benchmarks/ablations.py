"""`python -m benchmarks.ablations`: what history, randomised rigs and a look ahead are worth to an agent.

PPO of configs/agents/suite-ppo.yaml is trained with one thing changed at a time, and tested on the 20 test episodes of
suite v1 with that suite's score. Every finished training is a line of the results file, so that the same command goes
on from there; ``--page`` puts the table between two marks of a page.
"""

import argparse
import json
import math
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import gymnasium as gym
import numpy as np

from cable_envs.core.files import write_atomic
from cable_envs.core.text import between_marks
from cablebench.protocol.actors import PolicyActor
from cablebench.protocol.files import load_protocol
from cablebench.run.evaluation import core_of, run_episode
from cablebench.run.records import badness, facts
from cablebench.score.anchors import anchors_of
from cablebench.score.log_score import log_score
from cablebench.score.two_level import Plan, mean_of_tasks, task_draws

BASE = "suite-ppo"
TASKS = ("cable_envs/CableHole-Track-Medium-v1", "cable_envs/PulleyCircuit-Track-Medium-v1")
VARIANTS: Mapping[str, tuple[str, Mapping[str, Any]]] = {
    "as it is": ("it sees the first observation of the episode and the last one", {}),
    "no history": ("it sees the last observation alone", {"first_frame": False}),
    "longer history": ("it sees the first observation and the last four", {"frame_stack": 4}),
    "one rig": ("training on the task's own rig, with nothing drawn", {"env_options": {"randomize": False}}),
    "preview": ("it sees the acceleration of the reference, in training and test", {"env_options": {"preview": True}}),
    "no smoothing": ("the network's answer is the command", {"smoothing": 0.0}),
}
"""Name -> what it is, and what is changed in the settings."""

TESTED = ("preview",)
"""Options of the environment that hold in the test, too."""
BEGIN, END = "<!-- begin: python -m benchmarks.ablations -->", "<!-- end: ablations -->"


def tested(env_id: str, variant: str, seed: int, steps: int) -> dict[str, Any]:
    """Train one variant with one seed, and test it: the line of the results file."""
    from cable_envs.agents.settings import load_settings
    from cable_envs.agents.train import train

    settings = load_settings(BASE, env_id, steps, changes=dict(VARIANTS[variant][1]))
    with TemporaryDirectory() as folder:
        policy = train(replace(settings, algo=variant), seed, folder)
    protocol = load_protocol("suite-v1")
    anchor = anchors_of(protocol)[env_id, "test"]
    options = {"split": "test", **{k: v for k, v in settings.env_options.items() if k in TESTED}}
    with closing(gym.make(env_id, disable_env_checker=True, **options)) as env:
        actor = PolicyActor(policy)
        actor.start(core_of(env))
        seeds = protocol.seeds(protocol.episodes)
        errors = [badness(facts(run_episode(env, actor, episode))) for episode in seeds]
    worst = protocol.worst_score
    scores = [log_score(e, anchor.open_loop, anchor.bound) if math.isfinite(e) else worst for e in errors]
    return {"env": env_id, "variant": variant, "seed": seed, "steps": steps, "scores": scores}


def table(found: Sequence[Mapping[str, Any]]) -> str:
    """Variants by tasks: interquartile mean of the scores with its interval over training seeds and rigs."""
    tasks = [env for env in TASKS if any(r["env"] == env for r in found)]
    heads = [env.split("/")[1].removesuffix("-v1") for env in tasks]
    lines = [f"| changed | what | {' | '.join(heads)} |", "|---|---|" + "--:|" * len(tasks)]
    for variant, (what, _) in VARIANTS.items():
        cells = [_cell([r["scores"] for r in found if (r["env"], r["variant"]) == (env, variant)], env, variant)
                 for env in tasks]  # fmt: skip
        lines.append(f"| {variant} | {what} | {' | '.join(cells)} |")
    return "\n".join(lines)


def _cell(scores: Sequence[Sequence[float]], env_id: str, variant: str) -> str:
    if not scores:
        return "–"
    draws = task_draws(variant, env_id, np.array(scores), Plan("ablations"))
    one = mean_of_tasks([draws], 0.95, -1.0)
    return f"{one.value:.2f} [{one.low:.2f}, {one.high:.2f}]"


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.ablations", description=__doc__)
    parser.add_argument("--results", type=Path, required=True, help="file of the results, a line a training")
    parser.add_argument("--seeds", type=int, default=3, help="training seeds, from 0")
    parser.add_argument("--steps", type=int, default=1_200_000, help="of each training")
    parser.add_argument("--page", type=Path, help="a page whose marked part gets the table")
    arguments = parser.parse_args()
    path = arguments.results
    found = [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []
    done = {(r["env"], r["variant"], r["seed"], r["steps"]) for r in found}
    for seed in range(arguments.seeds):
        for env_id in TASKS:
            for variant in VARIANTS:
                if (env_id, variant, seed, arguments.steps) not in done:
                    found.append(tested(env_id, variant, seed, arguments.steps))
                    with path.open("a", encoding="utf-8") as file:
                        file.write(json.dumps(found[-1]) + "\n")
                    print(found[-1]["env"], variant, seed, np.round(np.mean(found[-1]["scores"]), 2), flush=True)
    text = table(found)
    print(text)
    if arguments.page:
        write_atomic(arguments.page, between_marks(arguments.page.read_text(encoding="utf-8"), BEGIN, END, text))


if __name__ == "__main__":
    main()
