"""`python -m benchmarks.misses PART ...`: what the data say of the truth where a proof gave no right name.

For recordings of a proof in which effects of the library were concealed and the answer was neither their names nor a
class that holds them, the model with the concealed effects and that of the answer are refitted to all records, and
compared with the one without effects: all three under one noise, by the evidence with which the diagnosis decides. Its
laws are not those of the generator, and it does not know the noise. So it is a second look at the same data, not what
they hold at most: that is `cable_envs.proof.family_b.odds`, which `--separable` asks (a minute or two each) for every
single effect of more than 10 % that was not named exactly.

Each is a line of the results file as soon as it is done, so that the same command goes on from there.
"""

import argparse
import json
import warnings
from collections.abc import Collection, Iterator, Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Any

from cable_envs.core.errors import ConfigurationError
from cable_envs.core.files import read_json
from cable_envs.diagnosis.asked import ask, request_of
from cable_envs.diagnosis.data.clocks.one_clock import on_one_clock
from cable_envs.diagnosis.data.recording import load_recording
from cable_envs.diagnosis.engine import averaged_if_long
from cable_envs.diagnosis.experiment.rivals import rivals
from cable_envs.diagnosis.intake.converged import converged
from cable_envs.diagnosis.model.hypotheses import effect_name
from cable_envs.diagnosis.search.known.noise import told_at_rest
from cable_envs.proof.family_b.cases import plan as plan_of_b
from cable_envs.proof.family_b.cases import rivals as rivals_in_b
from cable_envs.proof.family_b.odds import separable

RIGHT = ("exact", "class")
MOST = 8
"""Models of the concealed effects, where they have several hypotheses."""


def results(parts: Sequence[Path]) -> Iterator[tuple[Path, Mapping[str, Any]]]:
    """(folder, scored case) of all parts of a proof, in the order of its plan."""
    for part in parts:
        for case in read_json(part / "proof.json.xz")["methods"]["diagnose"]["cases"]:
            yield part, case


def missed(parts: Sequence[Path]) -> list[tuple[Path, Mapping[str, Any]]]:
    """Those in which effects of the library were concealed and not rightly named."""
    return [(p, c) for p, c in results(parts) if c["kind"] in ("single", "pair") and c["outcome"] not in RIGHT]


def evidence(part: Path, case: Mapping[str, Any]) -> dict[str, Any]:
    """Log odds of the concealed effects and of the answer over no effect: a line of the results file."""
    warnings.simplefilter("ignore")
    key = read_json(part / "keys" / f"{case['name']}.json")["key"]
    answer = read_json(part / "verdicts" / "diagnose" / f"{case['name']}.json")
    line = {
        "case": case["name"], "system": case["system"], "noise": case["noise"], "truth": case["truth"],
        "added": key["added"], "verdict": case["verdict"], "outcome": case["outcome"], "answer": case["answer"],
    }  # fmt: skip
    recording, _ = averaged_if_long(on_one_clock(load_recording(part / "recordings" / case["name"]))[0])
    try:
        question = converged(told_at_rest(recording, ask(recording, request_of(recording))))
    except ConfigurationError as error:
        return {**line, "refused": str(error)}
    known = [h.name for h in question.hypotheses]
    named = tuple(_row(e) for e in _verdict(answer).get("effects", ()) if _row(e) in known)
    wanted = [_laws(e, known) for e in key["effects"]]
    true = [tuple(t) for t in product(*wanted)][:MOST]
    if not all(wanted):
        return {**line, "refused": "the question has no hypothesis of the concealed effect: a parameter does the same"}
    models = list(dict.fromkeys([(), *true, named]))
    channels = {b.channel for b in question.fit.blocks}
    found = rivals(question, models, {n: s for n, s in recording.noise.items() if n in channels})
    behind = {rival.name: rival.behind for rival in found}
    over = {names: behind[""] - behind[" + ".join(names)] for names in models}
    best = max(true, key=lambda names: over[names])
    return {**line, "true_model": best, "of_truth": over[best], "answered": named, "of_answer": over[named]}


def _verdict(answer: Mapping[str, Any]) -> Mapping[str, Any]:
    inner = answer.get("verdict")
    return inner if isinstance(inner, Mapping) else answer


def _row(effect: Mapping[str, Any]) -> str:
    """Name of the hypothesis that an effect of an answer is: of a sensor's with its channel."""
    rows = {str(p["row"]) for p in effect.get("parameters", {}).values() if isinstance(p, Mapping) and p.get("row")}
    sensors = [row for row in rows if row.startswith("sensor_")]
    return sensors[0] if sensors else str(effect["name"])


def _laws(effect: Mapping[str, Any], known: Sequence[str]) -> list[str]:
    """Hypotheses of a concealed effect: of its channel where it has one, else all formulations of its law."""
    own = [n for n in known if effect_name(n) == effect["name"]]
    return [n for n in own if n.endswith(f".{effect['channel']}")] if effect.get("channel") else own


def told_apart(parts: Sequence[Path], done: Collection[str]) -> Iterator[dict[str, Any]]:
    """For every single effect above 10 % that was not named exactly: whether the recording can tell it at all.

    done: names of recordings that have been asked.
    """
    cases = {}
    for part in parts:
        about = read_json(part / "proof.json.xz")["plan"]
        if about["generator"] != "b":
            raise ConfigurationError(f"{part}: only generator b knows what its recordings can separate")
        cases |= {c.name: c for c in plan_of_b(seed=int(about["seed"]))}
    for _, result in results(parts):
        asked = (result["kind"], result["band"]) == ("single", ">10") and result["outcome"] != "exact"
        if asked and result["name"] not in done:
            odds = rivals_in_b(cases[result["name"]])
            least = min(odds, key=lambda name: odds[name])
            yield {
                "separable": bool(separable(odds)), "case": result["name"], "outcome": result["outcome"],
                "truth": result["truth"], "nearest": least, "least": odds[least],
            }  # fmt: skip


def table(lines: Sequence[Mapping[str, Any]]) -> str:
    """Log odds over no effect, of the truth and of the answer."""
    found = [
        "| recording | log | concealed | adds | answer | log odds of the concealed | of the answer |",
        "|---|---|---|--:|---|--:|--:|",
    ]
    for line in lines:
        true, named = (" + ".join(line.get(k, ())) for k in ("true_model", "answered"))
        if "refused" in line:
            odds = f"{line['refused']} | –"
        else:
            odds = f"{line['of_truth']:.1f} | " + (f"{line['of_answer']:.1f}" if named else "–")
        found.append(
            f"| {line['case']} | {line['noise']} | {true or ' + '.join(line['truth'])} | {100.0 * line['added']:.1f} % "
            f"| {line['verdict']}{f': {named}' if named else ''} | {odds} |"
        )
    return "\n".join(found)


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.misses", description=__doc__)
    parser.add_argument("parts", type=Path, nargs="+", help="folders of `cablebench blind-test --out`")
    parser.add_argument("--results", type=Path, required=True, help="file of the results, a line a case")
    parser.add_argument("--cases", type=int, default=10, help="how many, the first of the plan")
    parser.add_argument("--separable", action="store_true", help="what the recordings can tell, instead")
    arguments = parser.parse_args()
    path = arguments.results
    lines = [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []
    done = {line["case"] for line in lines}
    if arguments.separable:
        new: Iterator[dict[str, Any]] = told_apart(arguments.parts, done)
    else:
        new = (evidence(p, c) for p, c in missed(arguments.parts)[: arguments.cases] if c["name"] not in done)
    for line in new:
        lines.append(line)
        with path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(line) + "\n")
        print(line, flush=True)
    if arguments.separable:
        print(f"{sum(line['separable'] for line in lines)} of {len(lines)} can be told from all others")
    else:
        print(table(lines))


if __name__ == "__main__":
    main()
