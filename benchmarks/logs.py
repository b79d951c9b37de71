"""`python -m benchmarks.logs`: what the tool says of recordings as rigs make them, kind by kind of log.

Every kind of `cable_envs.proof.logs.loggers` is made of every system: with nothing missing, with one effect, and with
physics that is in no library (generator A, for developing; the proof judges). Answers are scored as those of the proof
(`cable_envs.proof.scoring`). Each is written to ``--out`` as it comes, so that a stopped run goes on, and several runs
with ``--part`` can share a file's folder and be counted together.
"""

import argparse
import json
import shutil
import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, fields
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

from cable_envs.core.errors import ConfigurationError
from cable_envs.diagnosis.engine import diagnose
from cable_envs.proof.cases import Case
from cable_envs.proof.logs.by_kind import outcomes
from cable_envs.proof.logs.cases import make, plan
from cable_envs.proof.scoring import Result, judge, restored

FIELDS = tuple(field.name for field in fields(Result))
DEVELOPED_ON = 5
"""Seed on which numbers of the tool were set (`docs/evidence.md`); any other tells how good these are."""


def answered(case: Case, folder: Path) -> dict[str, Any]:
    """One case, made, diagnosed and scored; its recording stays in the folder."""
    warnings.simplefilter("ignore")
    where, key_file = folder / case.name, folder / f"{case.name}.json"
    if not key_file.is_file():
        shutil.rmtree(where, ignore_errors=True)
        key_file.write_text(json.dumps(make(case, where), default=float))
    key = json.loads(key_file.read_text())
    try:
        verdict = diagnose(where).as_json()
    except ConfigurationError as error:
        return {**asdict(judge(key, None)), "refused": str(error)}
    row = asdict(judge(key, verdict))
    named = verdict["effects"] if row["answer"] else []
    row["gains"] = [min(e["log_odds"], e["margin"]) for e in named if e["name"] not in key["ambient"]]
    return {**row, "cause": verdict["test"]["cause"], "seconds": verdict["about"]["seconds"]}


def reliability(claims: Iterable[tuple[float, bool]]) -> str:
    """Stated confidences beside the share of right answers, in fifths, and the expected calibration error."""
    pairs = np.array([(float(stated), float(right)) for stated, right in claims])
    if not len(pairs):
        return "no effect was named"
    lines, error = ["| stated, mean | right |", "|--:|--:|"], 0.0
    edges = np.unique(np.quantile(pairs[:, 0], np.linspace(0.0, 1.0, 6)[1:-1]))
    fifth = np.searchsorted(edges, pairs[:, 0])  # equal ones are in one
    for part in (pairs[fifth == k] for k in np.unique(fifth)):
        stated, right = part.mean(axis=0)
        error += len(part) / len(pairs) * abs(stated - right)
        lines.append(f"| {stated:.3f} | {int(part[:, 1].sum())} of {len(part)} |")
    return "\n".join([*lines, "", f"expected calibration error {error:.3f}, {len(pairs)} named effects"])


def coverage(rows: Sequence[Mapping[str, Any]]) -> str:
    """Share of 95 % intervals that contain the truth, parameter by parameter."""
    found: dict[str, list[bool]] = {}
    for row in rows:
        for name, covers in row["intervals"]:
            found.setdefault(name, []).append(covers)
    every = [covers for own in found.values() for covers in own]
    lines = [f"| {name} | {sum(own)} of {len(own)} |" for name, own in sorted(found.items())]
    return "\n".join(
        ["| parameter | contain the truth |", "|---|--:|", *lines, f"| all | {sum(every)} of {len(every)} |"]
    )


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.logs", description=__doc__)
    parser.add_argument("--seed", type=int, default=6, help=f"of the cases; {DEVELOPED_ON} was developed on")
    parser.add_argument("--each", type=int, default=1, help="cases of each kind of log, system and sort of mismatch")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--part", default="0/1", help="K/N: every N-th case from the K-th")
    parser.add_argument("--out", type=Path, default=Path("results/logs"), help="folder for recordings and answers")
    arguments = parser.parse_args()
    number, parts = (int(text) for text in arguments.part.split("/"))
    folder = arguments.out / f"seed-{arguments.seed}"
    folder.mkdir(parents=True, exist_ok=True)
    own = folder / f"answers-{number}-of-{parts}.jsonl"
    done = {row["name"] for row in _read(folder)}
    each = arguments.each
    cases = plan(nothing=each, single=each, strange=each, seed=arguments.seed)[number::parts]
    work = [(case, folder) for case in cases if case.name not in done]
    with get_context("spawn").Pool(arguments.jobs, maxtasksperchild=8) as pool, own.open("a") as out:
        for row in pool.imap_unordered(_one, work):
            out.write(json.dumps(row, default=float) + "\n")
            out.flush()
            print(row["name"], row["noise"], *row["truth"], "->", row["outcome"], *row["answer"], flush=True)
    rows = _read(folder)
    print(f"\n{len(rows)} recordings of seed {arguments.seed}\n")
    print(outcomes([restored({k: row[k] for k in FIELDS}) for row in rows]))
    print(reliability(claim for row in rows for claim in row["claims"]), "\n")
    print(coverage(rows))


def _one(work: tuple[Case, Path]) -> dict[str, Any]:
    return answered(*work)


def _read(folder: Path) -> list[dict[str, Any]]:
    found = {}
    for file in sorted(folder.glob("answers-*.jsonl")):
        for line in file.read_text().splitlines():
            row = json.loads(line)
            found[row["name"]] = row
    return list(found.values())


if __name__ == "__main__":
    main()
