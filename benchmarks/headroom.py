"""`python -m benchmarks.headroom`: what each task of suite v1 leaves between doing nothing and an oracle.

The error of an episode is the root mean square of the priced error (`cable_envs.sim.suite.judging`) after the homing,
on the rigs of the split "test". Run are the open loop and a drive that stays where it began, the reference controllers
with the gains of configs/controllers/<law>-suite.yaml (`benchmarks.suite_gains`) and some with their defaults, PPO
trained for the task, and the oracle: it has the true rig without the concealed effects, ideal sensors, every signal
and the acceleration of the reference, and of three sizes of its gains the best is taken, as the full ones shake the
drive. `benchmarks.verdicts` says what follows. Results are kept in a file; what is there is not run again.
"""

import argparse
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

import gymnasium as gym

import cable_envs
from benchmarks.verdicts import AGENT, CLASSICAL, NOTHING, OPEN, ORACLE, Row, rows_of, table
from cable_envs.core.files import write_atomic
from cable_envs.core.text import between_marks
from cable_envs.sim.registered import setup_of
from cablebench.bound.candidates import oracles, staying, without_effects
from cablebench.entrants.controller_files import shipped_files
from cablebench.entrants.entrant import Entrant
from cablebench.entrants.named import named_entrant
from cablebench.protocol.failures import scored_error
from cablebench.protocol.files import load_protocol
from cablebench.protocol.metrics import measure as measured
from cablebench.run.evaluation import core_of, run_episode
from cablebench.score.anchors import load_anchors

TEST = {"split": "test"}
DEFAULTS = ("feedforward-pid", "virtual-jaw")
"""Laws that run with their default gains."""
RESULTS = Path(__file__).parents[1] / "docs" / "headroom.json"
BEGIN, END = "<!-- begin: python -m benchmarks.headroom -->", "<!-- end -->"


def measure(env_id: str, entrant: Entrant, part: str, seeds: Sequence[int]) -> Row | None:
    """Run an entrant on an environment of the suite; None where it does not enter, or nothing is left to run."""
    if not seeds:
        return None
    options = entrant.enters(env_id, without_effects(env_id, TEST) if part == ORACLE else TEST)
    if options is None:
        return None
    errors, failures = [], []
    with closing(gym.make(env_id, disable_env_checker=True, **options)) as env:
        setup = core_of(env).setup
        assert setup.conditions is not None
        actor = entrant.make(setup)
        for seed in seeds:
            episode = run_episode(env, actor, seed)
            found = measured(episode)
            rule = int(episode.signals["failure"][-1])
            failed = bool(rule) or not episode.complete
            errors.append(math.inf if failed else scored_error(found))
            failures.append(setup.conditions.rules[rule - 1].name if rule else "not finite" if failed else "")
    return Row(entrant.name, part, tuple(errors), tuple(filter(None, failures)))


def policy_name(env_id: str) -> str:
    """The task whose policy a task takes: the first one with the same conditions of training."""
    for other in cable_envs.SUITE_IDS:
        if _training(other) == _training(env_id):
            return other.split("/")[1]
    raise AssertionError(env_id)


def _training(env_id: str) -> list[Any]:
    """What a training on a task depends on."""
    setup = setup_of(env_id, {"split": "train"})
    conditions = setup.conditions
    assert conditions is not None
    drawn = [conditions.start, conditions.unhomed, conditions.sensors, conditions.rules, conditions.activity]
    seen = [setup.task.name, setup.reference, setup.disturbance, setup.posture, setup.randomize, setup.sensor_delay]
    return [repr(one) for one in (*drawn, *seen, [c.name for c in setup.channels])]


def agent(env_id: str, steps: int, folder: Path) -> Entrant:
    """PPO of configs/agents/suite-ppo.yaml, trained on the rigs to train on."""
    from cable_envs.agents.settings import load_settings
    from cable_envs.agents.train import train
    from cablebench.entrants.entrant import agent_entrant

    name = policy_name(env_id)
    trained = f"cable_envs/{name}"
    settings = load_settings("suite-ppo", trained, n_timesteps=steps, env_options={"split": "train"})
    policy = train(settings, 0, folder / "ppo" / name, resume="auto")
    return agent_entrant("ppo", policy, env_id, 0, steps)


def entrants_of(env_id: str, names: Iterable[str]) -> Iterable[tuple[Entrant, str]]:
    """All but agent and oracles, with their parts."""
    yield named_entrant(OPEN), NOTHING
    yield staying(), NOTHING
    yield from ((named_entrant(name), CLASSICAL) for name in names)


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.headroom", description=__doc__)
    parser.add_argument("tasks", nargs="*", help="parts of ids, as CableHole-Track or Hard; all by default")
    parser.add_argument("--episodes", type=int, default=20, help="test episodes of each task; 0: what is kept")
    parser.add_argument("--controller", action="append", help="a classical entrant; default: <law>-suite and some more")
    parser.add_argument("--train", type=int, default=0, help="steps to train PPO for on each task; 0: no agent")
    parser.add_argument("--again", action="append", default=[], help="parts of names of entrants that are run anew")
    parser.add_argument("--no-oracle", action="store_true", help="run none where the frozen bound has no episodes")
    parser.add_argument("--out", type=Path, default=Path("results/headroom"), help="folder for policies")
    parser.add_argument("--results", type=Path, default=RESULTS, help="file that keeps the errors of every episode")
    parser.add_argument("--page", type=Path, help="a page whose marked part is replaced by the table")
    arguments = parser.parse_args()
    suite = [name for name in shipped_files() if name.endswith("-suite")]
    names = arguments.controller or [*suite, *DEFAULTS]
    chosen = [i for i in cable_envs.SUITE_IDS if not arguments.tasks or any(part in i for part in arguments.tasks)]
    seeds = load_protocol("suite-v1").seeds(arguments.episodes)
    file = arguments.results
    results: dict[str, Any] = json.loads(file.read_text()) if file.is_file() else {}
    for env_id in chosen if seeds else ():
        kept = results.setdefault(env_id, {})
        entered = list(entrants_of(env_id, names))
        if arguments.train:
            entered.append((agent(env_id, arguments.train, arguments.out), AGENT))
        if frozen(env_id, len(seeds)) is None and not arguments.no_oracle:
            entered += [(entrant, ORACLE) for entrant in oracles(env_id, TEST)]
        for entrant, part in entered:
            if any(text in entrant.name for text in arguments.again):
                kept.pop(entrant.name, None)
            has = kept.get(entrant.name, {"part": part, "errors": [], "failures": []})
            row = measure(env_id, entrant, part, seeds[len(has["errors"]) :])
            if row is None:
                continue
            errors = [float(f"{e:.4g}") if math.isfinite(e) else None for e in row.errors]
            failures = [*has["failures"], *row.failures]
            kept[entrant.name] = {"part": part, "errors": [*has["errors"], *errors], "failures": failures}
            print(env_id, entrant.name, f"{row.median:.3g}", *row.failures, flush=True)
            write_atomic(file, as_lines(results).encode())
    shown = {}
    for env_id in chosen:
        rows = rows_of(results[env_id])
        bound = frozen(env_id, len(rows[0].errors))
        rows = [row for row in rows if bound is None or row.part != ORACLE]
        shown[env_id] = rows if bound is None else [*rows, bound]
    text = table(shown, anchors())
    print(text)
    if arguments.page:
        page = arguments.page.read_text(encoding="utf-8")
        write_atomic(arguments.page, between_marks(page, BEGIN, END, text))


def as_lines(results: Mapping[str, Mapping[str, Any]]) -> str:
    """JSON with one entrant a line."""
    tasks = []
    for env_id, kept in results.items():
        lines = ",\n".join(f"  {json.dumps(name)}: {json.dumps(one)}" for name, one in kept.items())
        tasks.append(f" {json.dumps(env_id)}: {{\n{lines}\n }}")
    return "{\n" + ",\n".join(tasks) + "\n}\n"


def frozen(env_id: str, episodes: int) -> Row | None:
    """The frozen bound's errors of as many episodes; None where it has fewer."""
    one = load_anchors("suite-v1").get((env_id, "test"))
    if one is None or len(one.bounds) < episodes:
        return None
    return Row("bound", ORACLE, tuple(one.bounds[:episodes]), ())


def anchors() -> Mapping[str, tuple[float, float]]:
    """e0 and e1 of the tasks, as they are frozen."""
    kept = load_anchors("suite-v1")
    return {env_id: (one.open_loop, one.bound) for (env_id, track), one in kept.items() if track == "test"}


if __name__ == "__main__":
    main()
