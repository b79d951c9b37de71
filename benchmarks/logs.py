"""`python -m benchmarks.logs`: what the tool says of recordings as rigs make them, kind by kind of log.

Every kind of `cable_envs.proof.logs.loggers` is made of every system: with nothing missing, with one effect, and with
physics that is in no library (generator A, for developing; the proof judges). Answers are scored as those of the proof
(`cable_envs.proof.scoring`), and faults of the data that are said are held against those that were put in. Each is
written to ``--out`` as it comes, so that a stopped run goes on, and several runs with ``--part`` can share a file's
folder and be counted together.
"""

import argparse
import json
import re
import shutil
import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, fields, replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import minimize

from cable_envs.core.errors import ConfigurationError
from cable_envs.diagnosis.engine import diagnose
from cable_envs.diagnosis.search.known.noise import NOISE_IS_LEARNT
from cable_envs.proof.cases import Case
from cable_envs.proof.effects import SYSTEMS
from cable_envs.proof.logs.by_kind import outcomes
from cable_envs.proof.logs.cases import make, plan
from cable_envs.proof.logs.loggers import KINDS
from cable_envs.proof.scoring import Result, judge, restored

FIELDS = tuple(field.name for field in fields(Result))
OUTSIDE = 0.1
"""Share of physics outside the library of all logs with a mismatch, in a blind proof (`docs/proof/history.md`: 126 of
1233), by which names are calibrated; a benchmark of logs has as many of it as of effects."""
OF_DATA = "of the data, not of the rig: "
"""How the notes of an answer begin that say a fault of the data."""
FAULTS = ("fast", "resampled", "filtered", "hum", "walk")
"""What of `cable_envs.proof.logs.loggers.Log` an answer may say."""
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
    row["errors"] = errors(key, verdict) if row["answer"] else []
    row["gains"] = [min(e["log_odds"], e["margin"]) for e in named if e["name"] not in key["ambient"]]
    row["learnt"] = any(NOISE_IS_LEARNT in note for note in verdict["notes"])
    row["faults"] = [n.removeprefix(OF_DATA) for n in verdict["notes"] if n.startswith(OF_DATA)]
    row["put_in"] = [put_in(fault, key["log"]) for fault in row["faults"]]
    row["faulty"] = any(key["log"][fault] for fault in FAULTS)
    return {**row, "cause": verdict["test"]["cause"], "seconds": verdict["about"]["seconds"]}


def errors(key: Mapping[str, Any], verdict: Mapping[str, Any]) -> list[float]:
    """Errors of the values of effects that are rightly named, over half the width of their 95 % intervals."""
    found = []
    for true in key["effects"]:
        named = next((e["parameters"] for e in verdict["effects"] if e["name"] == true["name"]), {})
        for name, parameter in true["parameters"].items():
            low, high = named.get(name, {}).get("ci95") or (0.0, 0.0)
            if high > low:
                found.append(2.0 * abs(parameter["value"] - 0.5 * (low + high)) / (high - low))
    return found


def in_turn(seed: int) -> list[Case]:
    """Of each kind of log one case with nothing missing, with one effect, with wrong parameters: systems by turns."""
    cases, found = plan(nothing=1, single=1, strange=1, seed=seed), []
    for k, noise in enumerate(KINDS):
        for j, kind in enumerate(("nothing", "single", "single")):
            system = SYSTEMS[(k + j) % len(SYSTEMS)]
            case = next(c for c in cases if (c.noise, c.system, c.kind) == (noise, system, kind))
            found.append(case if j < 2 else replace(case, name=f"decoy-{case.name}", kind="decoy", effects=()))
    return found


def put_in(said: str, log: Mapping[str, Any]) -> bool:
    """Whether a fault of the data is one that the logger has: the clock's to half of its error, a tone to 0.1 Hz."""
    number = float((re.search(r"[+-]?\d[\d.e+-]*(?= (%|Hz|ms))", said) or ["nan"])[0])
    channels = [part.partition(":")[0].strip().replace(" ", "_") for part in said.split(";")]
    if "clock is off" in said:
        return abs(abs(number) / 100.0 - abs(log["fast"])) < 0.5 * abs(log["fast"])
    if "straight lines" in said:
        return bool(log["resampled"])
    if "was filtered" in said:
        return said.partition(" was filtered")[0].replace(" ", "_") in log["filtered"]
    if "steady tone" in said:
        line = log["hum"].get(channels[0], (np.nan,))[0]
        return min(abs(number - line), abs(number - 3.0 * line)) < 0.1
    return "drifts" in said and all(channel in log["walk"] for channel in channels)


def faults(rows: Sequence[Mapping[str, Any]]) -> str:
    """How many faults of the data were said, were put in, and were found."""
    answers = [row for row in rows if "put_in" in row]
    said = [right for row in answers for right in row["put_in"]]
    found = sum(row["faulty"] and any(row["put_in"]) for row in answers)
    faulty = sum(row["faulty"] for row in answers)
    return (
        f"faults of the data: {sum(said)} of {len(said)} said were put in; found in {found} of {faulty} faulty logs\n"
    )


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


def calibrated(rows: Sequence[Mapping[str, Any]]) -> str:
    """Where noise was learnt: logit of the share of right names, a line over the logarithm of their log odds.

    By maximum likelihood with Jeffreys' prior (Firth, Biometrika 80 (1993) 27), without which it has no maximum where
    all names are right whose odds are above those of the wrong ones. Logs with physics of no library count as if they
    were `OUTSIDE` of those in which something is missing.
    """
    single, strange = (sum(row["kind"] == kind for row in rows) for kind in ("single", "strange"))
    less = OUTSIDE / (1.0 - OUTSIDE) * single / strange if single and strange else 1.0
    names = [
        (gain, was, less if row["kind"] == "strange" else 1.0)
        for row in rows if row.get("learnt")
        for gain, (_, was) in zip(row["gains"], row["claims"], strict=True)
    ]  # fmt: skip
    if not names:
        return "no effect was named where the noise was learnt"
    gains, right, counts = np.array(names, float).T
    design = np.column_stack([np.ones(len(gains)), np.log(np.maximum(gains, 1.0))])

    def against(line: np.ndarray) -> float:
        logit = design @ line
        share = 1.0 / (1.0 + np.exp(-logit))
        information = design.T @ (design * (counts * share * (1.0 - share))[:, None])
        told = np.sum(counts * (right * logit - np.logaddexp(0.0, logit)))
        return -float(told + 0.5 * np.linalg.slogdet(information + 1e-9 * np.eye(2))[1])

    constant, slope = minimize(against, np.zeros(2), method="Nelder-Mead").x
    return f"logit = {constant:.2f} + {slope:.2f} ln(log odds): {int(right.sum())} of {len(right)} names are right"


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


def wider(rows: Sequence[Mapping[str, Any]]) -> str:
    """By how much intervals would have to be wider to contain 95 % of the true values.

    The split-conformal quantile of the errors over half the intervals' width (Lei, G'Sell, Rinaldo, Tibshirani,
    Wasserman, JASA 113 (2018) 1094): of n errors that which is at (n + 1) 0.95, counted from the smallest.
    """
    every = sorted(error for row in rows for error in row.get("errors", ()))
    place = int(np.ceil(0.95 * (len(every) + 1)))
    if place > len(every):
        return f"{len(every)} values of effects, which are too few to say how wide intervals of 95 % are"
    return f"intervals {every[place - 1]:.2f} times as wide contain 95 % of the true values, of {len(every)}"


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.logs", description=__doc__)
    parser.add_argument("--seed", type=int, default=6, help=f"of the cases; {DEVELOPED_ON} was developed on")
    parser.add_argument("--each", type=int, default=1, help="cases of each kind of log, system and sort of mismatch")
    parser.add_argument("--in-turn", action="store_true", help="42 cases: each kind of log thrice, systems by turns")
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
    every = plan(nothing=each, single=each, strange=each, seed=arguments.seed)
    cases = (in_turn(arguments.seed) if arguments.in_turn else every)[number::parts]
    work = [(case, folder) for case in cases if case.name not in done]
    with get_context("spawn").Pool(arguments.jobs, maxtasksperchild=8) as pool, own.open("a") as out:
        for row in pool.imap_unordered(_one, work):
            out.write(json.dumps(row, default=float) + "\n")
            out.flush()
            print(row["name"], row["noise"], *row["truth"], "->", row["outcome"], *row["answer"], flush=True)
    rows = _read(folder)
    print(f"\n{len(rows)} recordings of seed {arguments.seed}\n")
    print(faults(rows))
    print(outcomes([restored({k: row[k] for k in FIELDS}) for row in rows]))
    print(reliability(claim for row in rows for claim in row["claims"]), "\n")
    print(calibrated(rows), "\n")
    print(coverage(rows), "\n")
    print(wider(rows))


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
