"""`python -m benchmarks.experiments`: how many names become exact by one computed experiment.

Rigs of the blind proof's generator (`cable_envs.proof.cases`, white noise, one effect that adds more than 10 %) are
recorded and diagnosed. Where the answer is not the exact name, `cable_envs.diagnosis.experiment` computes a motion, the
concealed rig runs it, and its record joins the others for a second diagnosis. The same is done once more where the
bench can also set its pretension or hang another weight on (`SETTINGS`, whose values the new record states); that
record joins the first ones instead. The key is opened for judging alone.
Every case is a line of the results file as soon as it is done, so that the same command goes on from there.
"""

import argparse
import json
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import yaml

from cable_envs.core.errors import ConfigurationError
from cable_envs.core.files import write_atomic
from cable_envs.core.text import between_marks
from cable_envs.diagnosis.data.recording import load_recording
from cable_envs.diagnosis.engine import diagnose
from cable_envs.diagnosis.experiment.design import next_experiment
from cable_envs.diagnosis.experiment.plan import Plan
from cable_envs.diagnosis.model.verdict import Diagnosis
from cable_envs.proof.cases import PERIOD, Case, make, plan
from cable_envs.proof.effects import find
from cable_envs.proof.rigs import CLOCK, TrueRig, observe, random_rig
from cable_envs.proof.scoring import judge, limits
from cable_envs.proof.sensors import quantise, stamps

RECORDING = "recording.yaml"
EXACT, CLASS, REFUSED = "exact", "class", "refused"
SETTINGS: Mapping[str, tuple[dict[str, float], ...]] = {
    "pulley_circuit": tuple({"pretension_top": n, "pretension_bottom": n} for n in (25.0, 120.0)),
    "cable_hole": tuple({"load_mass": kg} for kg in (2.5, 12.0)),
}
"""What a bench can be set to, SI: round numbers that are the same for every rig of a system. Rigs of the generator have
35 to 90 N and 3 to 8 kg."""
IN_WORDS = {"data": "a fault of the data", "none": "nothing missing", "wrong": "a wrong name, or one too many"}
SHOWN_IN = {"mm": 1e3, "mm/s": 1e3}
BEGIN, END = "<!-- begin: python -m benchmarks.experiments -->", "<!-- end: experiments -->"


def cases(seed: int) -> list[Case]:
    """All recordings with one effect that adds more than 10 %, and white noise, in the order of the proof's plan."""
    return [c for c in plan(seed=seed) if (c.kind, c.band, c.noise) == ("single", ">10", "white")]


def tried(case: Case) -> dict[str, Any]:
    """One case before and after its experiment: a line of the results file."""
    warnings.simplefilter("ignore")
    with TemporaryDirectory() as place:
        folder = Path(place) / case.name
        key = make(case, folder)
        found = diagnose(folder)
        first = judge(key, found.as_json())
        line = {"case": case.name, "system": case.system, "effect": case.effects[0], "before": first.outcome,
                "named": list(first.answer)}  # fmt: skip
        if first.outcome == EXACT:
            return {**line, **dict.fromkeys(("after", "after_set"), first.outcome), "motion": ""}
        line |= _once_more(folder, case, key, found, ())
        settings = SETTINGS.get(case.system, ())
        own = _once_more(folder, case, key, found, settings) if settings else line
        return {**line, "after_set": own["after"], "set": own if settings else {}}


def _once_more(
    folder: Path, case: Case, key: Mapping[str, Any], found: Diagnosis, settings: Sequence[Mapping[str, float]]
) -> dict[str, Any]:
    """What an experiment makes of an answer; the folder is left as it was."""
    try:
        motion = next_experiment(load_recording(folder), found, settings=settings, seed=case.seed)
    except ConfigurationError as error:
        return {"after": judge(key, found.as_json()).outcome, "motion": "", "refused": str(error)}
    before = (folder / RECORDING).read_text(encoding="utf-8")
    added(folder, case, key, motion)
    line = {"motion": motion.family, "settings": {n: value for n, (value, _) in motion.settings.items()},
            "expected": motion.least, "rivals": list(motion.rivals)}  # fmt: skip
    try:
        second = judge(key, diagnose(folder).as_json())
    except ConfigurationError as error:
        return {"after": REFUSED, **line, "refused": str(error)}
    finally:
        (folder / RECORDING).write_text(before, encoding="utf-8")
    return {"after": second.outcome, **line, "named_after": list(second.answer)}


def added(folder: Path, case: Case, key: Mapping[str, Any], motion: Plan) -> None:
    """Run a motion on the concealed rig, set as it asks, and put its record to the others of the folder."""
    missing = tuple(find(case.system, name) for name in case.effects)
    rig = random_rig(case.system, np.random.default_rng([case.seed, 7]), missing)
    rig = replace(rig, values={**rig.values, **{name: value for name, (value, _) in motion.settings.items()}})
    changes = {name: value for entry in key["effects"] for name, value in entry["changes"].items()}
    rng = np.random.default_rng([case.seed, 13])
    ticks = np.arange(round(motion.time[-1] / CLOCK)) * CLOCK
    at = stamps(rng, 0.0, float(motion.time[-1]) - CLOCK, PERIOD, 0.02)
    path = folder / RECORDING
    content = yaml.safe_load(path.read_text())
    columns = {"time": at + 600.0, **observe(rig, changes, places(rig, motion, ticks), at)}
    for name, std in rig.noise.items():
        columns[name] = quantise(columns[name] + std * rng.standard_normal(len(at)), 0.5 * std)
    channels = content["channels"]
    table = np.column_stack([values * SHOWN_IN.get(channels[name]["unit"], 1.0) for name, values in columns.items()])
    np.savetxt(folder / "run_9.csv", table, delimiter=",", header=",".join(columns), comments="", fmt="%.8g")
    conditions = {name: {"value": value, "unit": unit} for name, (value, unit) in motion.settings.items()}
    content["records"].append({"data": "run_9.csv", "use": "fit"} | ({"conditions": conditions} if conditions else {}))
    path.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")


def places(rig: TrueRig, motion: Plan, ticks: np.ndarray) -> np.ndarray:
    """The motion as the rig's drive is told it: a place at every tick; a speed is summed up from the centre."""
    told = np.interp(ticks, motion.time, motion.values)
    if not motion.channel.name.startswith("drive_velocity"):
        return told
    return rig.centre + np.concatenate([[0.0], np.cumsum(0.5 * (told[1:] + told[:-1])) * CLOCK])


def table(found: Sequence[Mapping[str, Any]]) -> str:
    """Shares of answers before and after."""
    total = len(found)
    columns = ("before", "after", "after_set")
    lines = ["| answer | before | after a motion | after a motion under a setting |", "|---|--:|--:|--:|"]
    kinds = {"exact name": (EXACT,), "exact name or class": (EXACT, CLASS), "a class": (CLASS,)}
    rest = tuple(sorted({r[k] for r in found for k in columns} - {EXACT, CLASS}))
    for title, outcomes in {**kinds, **{IN_WORDS.get(one, one): (one,) for one in rest}}.items():
        counts = [sum(r[k] in outcomes for r in found) for k in columns]
        lines.append(f"| {title} | " + " | ".join(_share(c, total) for c in counts) + " |")
    planned = [r for r in found if r["motion"]]
    under = sum(bool((r.get("set") or {}).get("settings")) for r in found)
    said = f"{total} recordings; for {len(planned)} an experiment was computed and run"
    lines += ["", f"{said}. Where the bench could be set, another setting was asked for in {under}."]
    return "\n".join(lines)


def _share(count: int, total: int) -> str:
    low, high = limits(count, total)
    return f"{count} of {total}, {count / total:.0%} ({100 * low:.0f}-{100 * high:.0f})"


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.experiments", description=__doc__)
    parser.add_argument("--results", type=Path, required=True, help="file of the results, a line a case")
    parser.add_argument("--cases", type=int, default=100, help="how many of the plan")
    parser.add_argument("--seed", type=int, default=97, help="of the plan")
    parser.add_argument("--page", type=Path, help="a page whose marked part gets the table")
    arguments = parser.parse_args()
    path = arguments.results
    found = [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []
    done = {r["case"] for r in found}
    for case in cases(arguments.seed)[: arguments.cases]:
        if case.name not in done:
            found.append(tried(case))
            with path.open("a", encoding="utf-8") as file:
                file.write(json.dumps(found[-1]) + "\n")
            print(found[-1], flush=True)
    text = table(found)
    print(text)
    if arguments.page:
        page = arguments.page.read_text(encoding="utf-8")
        write_atomic(arguments.page, between_marks(page, BEGIN, END, text))


if __name__ == "__main__":
    main()
