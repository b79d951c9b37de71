"""The proof as one JSON record and as a table in Markdown."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from itertools import pairwise
from pathlib import Path
from typing import Any

from cable_envs.core.errors import ConfigurationError
from cable_envs.core.files import read_json
from cable_envs.core.text import markdown_code, markdown_text
from cable_envs.proof.logs.by_kind import headline, outcomes
from cable_envs.proof.scoring import (
    LIMITS,
    Result,
    Row,
    calibration,
    confusion,
    failures,
    of_laboratory,
    restored,
    table,
)

SCHEMA = "cable-proof/1"

WORDS = {
    "effect adds 10 %": "the concealed effect raises the RMS of the residual by 10 % above the noise, after the "
    "nominal parameters have been refitted",
    "exact name": "the answer is the concealed effect and no other",
    "exact name or class": "the answer is the exact name, or several effects that the recording cannot tell apart; the "
    "concealed effect is one of them, and all of them are declared to look like it",
    "possible gain of 100 or more": "a method that knew the shape of the mismatch and the spectrum of the noise would "
    "gain 100 or more in twice the log likelihood; the diagnosis knows neither",
    "only parameters wrong": "the recording has wrong nominal parameters and no missing effect",
    "physics outside the library": "physics that the diagnosis has no equation for",
    "absorbed by refit, masked by loop, brief, small in rms, behind another effect": "why an effect is hard to see: a "
    "parameter can imitate it, a control loop hides it, it acts for a short time, it is small in the RMS, or it stands "
    "beside a larger one",
}
"""Terms of the rows, for a reader who sees them for the first time."""
INTRODUCTION = (
    "Simulators that share no integrator and no friction law with the diagnosis made recordings with concealed "
    "effects. The keys to them were sealed by salted hashes before the diagnosis ran. The columns after the first "
    "method are simpler methods on the same recordings. The terms are explained below the table."
)
SMALL_PRINT = (
    "Shares are given with 95 % Clopper-Pearson intervals in brackets, and as counts. A dash: there is no such case, "
    "or the method makes no such statement."
)


def record(results: Mapping[str, Sequence[Result]], about: Mapping[str, Any]) -> dict[str, Any]:
    """Everything that was measured: ``results`` by method; the limits apply to the first one."""
    first = next(iter(results.values()), ())
    methods = {
        method: {
            "rows": [asdict(row) | {"share": row.share, "reached": row.reached} for row in table(own)],
            "confusion": confusion(own),
            "calibration": calibration(own),
            "cases": [asdict(r) for r in own],
        }
        for method, own in results.items()
    }
    return {"schema": SCHEMA, **about, "broken_rules": failures(first, bool(about.get("sample"))), "methods": methods}


_AFTER = re.compile(r" --after (?:(\d+)|K, with K = (?:(\d+) to (\d+) by (\d+)|([\d, ]+)))")
"""Where a part begins, or several that were joined do, in the words of `one_command`."""


def parts_of(files: Sequence[Path]) -> list[dict[str, Any]]:
    """Records of the parts of one proof. Raises ConfigurationError where they are none, or not of one plan."""
    found: list[dict[str, Any]] = []
    for file in files:
        try:
            content = read_json(file)
        except (OSError, ValueError) as problem:
            raise ConfigurationError(f"{file} cannot be read as a proof's record: {problem}") from None
        if not isinstance(content, dict) or content.get("schema") != SCHEMA or "plan" not in content:
            raise ConfigurationError(f"{file} is no record of schema {SCHEMA} that says its plan")
        if found and (content["plan"], [*content["methods"]]) != (found[0]["plan"], [*found[0]["methods"]]):
            raise ConfigurationError(
                f"{file} and {files[0]} are of different plans or methods: parts of one proof join"
            )
        if found and content.get("state") != found[0].get("state"):
            raise ConfigurationError(f"{file} and {files[0]} are by different states of the tool: no one proof")
        found.append(content)
    names = [case["name"] for record in found for case in next(iter(record["methods"].values()))["cases"]]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ConfigurationError(f"in more than one part: {', '.join(twice[:3])}")
    return found


def one_command(commands: Sequence[str]) -> str:
    """Commands of parts as one text; those that differ by where they begin alone are said once.

    Parts may be parts together, so that a proof is joined as it grows.

    Examples
    --------
    >>> some = one_command(["blind-test --first 5 --seed 1", "blind-test --first 5 --after 5 --seed 1"])
    >>> some
    'blind-test --first 5 --seed 1 --after K, with K = 0, 5'
    >>> one_command(["blind-test --first 5 --after 10 --seed 1", some])
    'blind-test --first 5 --seed 1 --after K, with K = 0 to 10 by 5'
    """
    begins = sorted(begin for command in commands for begin in _begins(command))
    alike = {_AFTER.sub("", command) for command in commands}
    if len(commands) < 2 or len(alike) > 1:
        return "; ".join(commands)
    steps = {after - before for before, after in pairwise(begins)}
    even = len(begins) > 2 and len(steps) == 1
    said = f"{begins[0]} to {begins[-1]} by {steps.pop()}" if even else ", ".join(map(str, begins))
    return f"{alike.pop()} --after K, with K = {said}"


def _begins(command: str) -> list[int]:
    """Where the parts of a command begin, of one or of several that were joined."""
    found = _AFTER.search(command)
    if found is None:
        return [0]
    one, first, last, step, several = found.groups()
    if one:
        return [int(one)]
    return list(range(int(first), int(last) + 1, int(step))) if first else [int(k) for k in several.split(", ")]


def together(parts: Sequence[Mapping[str, Any]]) -> dict[str, list[Result]]:
    """Results of all parts by method."""
    return {
        method: [restored(c) for part in parts for c in part["methods"][method]["cases"]]
        for method in parts[0]["methods"]
    }


def missing_words(about: Mapping[str, Any]) -> list[str]:
    """A sentence for each method that was killed on some cases, from ``about["missing"]``: method -> case -> how."""
    lines = []
    for method, cases in about.get("missing", {}).items():
        if cases:
            named = "; ".join(f"{name}: {why}" for name, why in list(cases.items())[:5])
            lines.append(f"Missing, and not counted, because {method} was killed: {len(cases)} cases ({named}).")
    return lines


def markdown(results: Mapping[str, Sequence[Result]], about: Mapping[str, Any]) -> str:
    """One table: a line for each row of the proof, a column for each method."""
    columns = {method: table(own) for method, own in results.items()}
    names = [row.name for row in next(iter(columns.values()), [])]
    lines = [f"# Blind proof: {about['cases_total']} cases", "", INTRODUCTION, "", markdown_code(about["command"]), ""]
    lines += (
        [f"State of the tool (hash of its sources): {markdown_code(about['state'])}", ""] if "state" in about else []
    )
    lines += [f"{markdown_text(line)}\n" for line in missing_words(about)]
    lines += ["| measured | wanted | " + " | ".join(columns) + " |", "|---" * (2 + len(columns)) + "|"]
    for k, name in enumerate(names):
        row = next(iter(columns.values()))[k]
        lines.append(
            f"| {name} | {wanted(asdict(row))} | " + " | ".join(cell(own[k]) for own in columns.values()) + " |"
        )
    first = next(iter(results), "nobody")
    broken = failures(results.get(first, ()), bool(about.get("sample")))
    if about.get("sample"):
        lines += ["", "This is a sample: a limit counts as exceeded where the 95 % interval of the share is beyond it."]
    lines += ["", *(f"- *{word}*: {meaning}" for word, meaning in WORDS.items())]
    lines += ["", SMALL_PRINT, "", limits_kept(first, broken)]
    if not of_laboratory(results.get(first, ())):
        lines += ["", "## In short", "", headline(results[first]), "## By kind of log", "", outcomes(results[first])]
    return "\n".join(lines) + "\n"


def wanted(row: Mapping[str, Any]) -> str:
    """What was asked of a row before the proof: ``at least 95 %``; empty where nothing was."""
    if not row["direction"]:
        return ""
    return f"{'at most' if row['direction'] == '<=' else 'at least'} {100 * row['reach']:g} %"


def limits_kept(method: str, broken: Sequence[str]) -> str:
    """A sentence: which of the three limits of `failures` a method exceeds."""
    if broken:
        return f"Limits exceeded by {method}: {'; '.join(broken)}."
    return (
        f"{method} keeps all three limits: at most {100 * LIMITS['false_alarms']:g} % false alarms; at least "
        f"{100 * LIMITS['coverage']:g} % of the 95 % intervals contain the true value; at least "
        f"{100 * LIMITS['claimed_90']:g} % of the answers with a confidence of 0.9 or more are right."
    )


def cell(row: Row) -> str:
    """A row's value in words: ``96 % (91-99), 48/50``."""
    if row.share is None:
        return "–"
    return f"{100 * row.share:.0f} % ({100 * row.low:.0f}-{100 * row.high:.0f}), {row.count}/{row.total}"
