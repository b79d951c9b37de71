"""Kill every command at random moments, go on, and compare with the run that nobody killed.

    python -m tests.crashes.kills --kills 200 --seed 1 --out kills.jsonl

Each line of the file is one chain: a command that was killed once or more and went on until it ended. The table at the
end says of how many kills nothing was lost. Of every second kill the moment is drawn over the duration of the whole
run, of the others over its changes of files (`tests.crashes.killing`).
"""

import argparse
import importlib
import json
import os
import random
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from tests.crashes.commands import CASES, EVALUATE, Case, make_stock
from tests.crashes.killing import PATIENCE, Ended, command, leftovers, run

LOADED = (
    "torch._dynamo", "h5py", "minari", "optuna", "optuna.storages", "sqlalchemy.dialects.sqlite", "alembic.command",
    "cable_envs.agents.train", "cable_envs.diagnosis.engine", "cable_envs.diagnosis.readers.writer",
    "cable_envs.proof.run", "cable_envs.proof.cases", "cablebench.board.pages.task", "cablebench.board.learning",
    "cablebench.cli.app", "cablebench.cli.learn.tune_controllers", "cablebench.cli.shared.policies",
    "cablebench.cli.shared.training", "cablebench.export.minari", "cablebench.export.recording",
    "cablebench.jobs.local", "cablebench.pages.diagnosis", "cablebench.pages.proof", "cablebench.run.jobs",
    "cablebench.tune.study", "matplotlib.pyplot", "rich.table",
)  # fmt: skip

AGAIN = 0.3
"""How often the run that goes on is killed as well."""


class Whole:
    """Every case without a kill: what it comes to, how long it takes, how many changes of files it makes."""

    def __init__(self, place: Path, cases: Sequence[Case]):
        self.place, self.stock = place, place / "stock"
        make_stock(self.stock)
        if any("leaderboard" in c.name or "pack" in c.name for c in cases):
            _must(run(command(*EVALUATE), self.stock))
        if any(c.name == "publish" for c in cases):
            words = ("train", "--env", "CableHole-Position-Sine", "--algo", "ppo-tiny.yaml", "--out", "trained")
            _must(run(command(*words), self.stock))
        self.ended: dict[str, Ended] = {}
        self.results: dict[str, Any] = {}
        for case in cases:
            folder = self.folder(case, "whole")
            run(case.first, folder)  # what is loaded or compiled once
            folder = self.folder(case, "whole")
            self.ended[case.name] = _must(run(case.first, folder))
            self.results[case.name] = _told(case, folder)

    def folder(self, case: Case, name: str) -> Path:
        """A new folder with what the case needs."""
        folder = self.place / case.name.replace(" ", "-") / name
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        case.prepare(folder, self.stock)
        return folder


def _must(ended: Ended) -> Ended:
    if ended.code:
        raise SystemExit(f"a run that nobody killed ended with {ended.code}: {ended.err[-2000:]}")
    return ended


def _told(case: Case, folder: Path) -> Any:
    return json.loads(json.dumps(case.result(folder)))


def chain(case: Case, whole: Whole, rng: random.Random, name: str, first: str = "") -> dict[str, Any]:
    """Kill a case, once or more, and let it end; what was found wrong is in "wrong", empty where nothing was."""
    folder, wrong, kills, told = whole.folder(case, name), [], [], []
    reference, body, how = whole.ended[case.name], case.first, first
    while True:
        how = how or rng.choice(("time", "change"))
        if how == "time":
            at = {"after": rng.uniform(0.0, reference.seconds)}
        else:
            at = {"at_change": rng.randint(1, max(reference.changes, 1))}
        ended = run(body, folder, **at)
        told += ended.told
        wrong += _faults(ended, killed=ended.code == -9)
        if ended.code != -9:
            break
        before = (folder / case.kept).read_bytes() if case.kept and (folder / case.kept).exists() else b""
        kills.append({**at, "changes": ended.changes, "told": len(ended.told)})
        body = case.again(folder)
        if rng.random() > AGAIN:
            ended = run(body, folder)
            told += ended.told
            wrong += _faults(ended, killed=False)
            break
        how = ""
    if kills and case.kept and not (folder / case.kept).read_bytes().startswith(before):
        wrong.append(f"{case.kept}: what was there before is not a prefix of what is there now")
    wrong += _compare(case, folder, whole, told)
    if not wrong:
        shutil.rmtree(folder)
    return {"case": case.name, "kills": kills, "wrong": wrong, "folder": str(folder) if wrong else ""}


def _faults(ended: Ended, killed: bool) -> list[str]:
    found = []
    if "Traceback" in ended.err + ended.out:
        found.append(f"traceback: {ended.err[-1500:]}")
    if not killed and ended.code:
        found.append(f"ended with {ended.code}: {ended.err[-600:]}")
    if ended.orphans:
        found.append(f"{ended.orphans} processes still ran {PATIENCE:g} s later")
    return found


def _compare(case: Case, folder: Path, whole: Whole, told: Sequence[str]) -> list[str]:
    """What differs from the run that nobody killed."""
    found = [f"temporary files stay: {', '.join(names)}" for names in [leftovers(folder)] if names]
    found += [f"reported as saved and gone: {line}" for line in told if not case.holds(folder, line)]
    try:
        if _told(case, folder) != whole.results[case.name]:
            found.append("the result differs from that of the run that nobody killed")
    except (OSError, ValueError, KeyError, StopIteration) as problem:
        found.append(f"the result cannot be read: {type(problem).__name__}: {problem}")
    return found


def order(cases: Sequence[Case], kills: int, rng: random.Random) -> Iterator[Case]:
    """Cases in a random order, as often as their shares say, for about so many kills."""
    total = sum(c.share for c in cases)
    found = [c for c in cases for _ in range(max(round(c.share * kills / total), 1))]
    rng.shuffle(found)
    yield from found


def summary(found: Sequence[dict[str, Any]]) -> str:
    """The table: command, chains, kills, kills after which nothing was wrong."""
    rows = ["command                    chains  kills  survived"]
    for name in dict.fromkeys(c.name for c in CASES):
        own = [f for f in found if f["case"] == name]
        if own:
            rows.append(f"{name:26} {len(own):6} {_count(own):6} {_count(f for f in own if not f['wrong']):9}")
    whole = f"{len(found):6} {_count(found):6} {_count(f for f in found if not f['wrong']):9}"
    return "\n".join([*rows, f"{'all':26} {whole}"])


def _count(found: Any) -> int:
    return sum(len(f["kills"]) for f in found)


def main() -> None:
    """Read the options, kill, write a line for each chain, print the table; exit code 1 where something was wrong."""
    options = argparse.ArgumentParser(prog="python -m tests.crashes.kills")
    options.add_argument("--kills", type=int, default=200, help="at least so many kills in all")
    options.add_argument("--seed", type=int, default=0)
    options.add_argument("--out", type=Path, default=Path("kills.jsonl"))
    options.add_argument("--only", action="append", help="a case by name; may be repeated")
    asked = options.parse_args()
    cases = [c for c in CASES if not asked.only or c.name in asked.only]
    rng, found, began = random.Random(asked.seed), [], time.monotonic()
    import_everything()
    asked.out.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="kills-", ignore_cleanup_errors=True) as place:
        whole = Whole(Path(place), cases)
        for name, ended in whole.ended.items():
            print(f"{name}: {ended.seconds:.1f} s, {ended.changes} changes of files", file=sys.stderr, flush=True)
        with asked.out.open("a", encoding="utf-8") as file:
            while _count(found) < asked.kills:
                for case in order(cases, asked.kills - _count(found), rng):
                    found.append(chain(case, whole, rng, f"chain-{len(found)}"))
                    file.write(json.dumps(found[-1]) + "\n")
                    file.flush()
    print(summary(found))
    print(f"{time.monotonic() - began:.0f} s")
    sys.exit(any(f["wrong"] for f in found))


def import_everything() -> None:
    """What the commands import, once for all forks; one thread each, as two would make forks unsafe."""
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    for module in LOADED:
        importlib.import_module(module)
    import gymnasium as gym
    import torch

    torch.set_num_threads(1)
    for name in ("CableHole-Position-Sine", "PulleyCircuit-Position-Sine"):  # their kernels, from disk
        env = gym.make(f"cable_envs/{name}-v0", sensor_noise=True)
        env.reset(seed=0)
        env.step(env.action_space.sample())


if __name__ == "__main__":
    main()
