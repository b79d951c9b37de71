"""The proof as one JSON record and as a table in Markdown."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from cable_envs.core.errors import ConfigurationError
from cable_envs.core.files import read_json
from cable_envs.core.text import markdown_code, markdown_text
from cable_envs.proof.scoring import Result, Row, calibration, confusion, failures, restored, table

SCHEMA = "cable-proof/1"

WORDS = {
    "adds 10 %": "the concealed effect raises the RMS of the residual by 10 % above the noise, after the nominal "
    "parameters have been refitted",
    "right name exactly": "the answer is the concealed effect and no other",
    "right name or class": "that, or several effects that the recording cannot tell apart, the concealed one among "
    "them and none that is not declared to look like it",
    "stand out (gain 100)": "whoever knew the shape of the mismatch and the spectrum of the noise would gain 100 or "
    "more in twice the log likelihood; the diagnosis knows neither",
    "decoy": "a recording with wrong parameters and nothing else",
    "effect in no library": "physics that the diagnosis has no equation for",
    "absorbed, masked, brief, small, behind another": "why the effect is hard to see: a parameter can imitate it, a "
    "control loop hides it, it acts for a short time, it is small in the RMS, or it stands beside a larger one",
}
"""Terms of the rows, for a reader who sees them for the first time."""


def record(results: Mapping[str, Sequence[Result]], about: Mapping[str, Any]) -> dict[str, Any]:
    """Everything that was measured: ``results`` by method; the fail rules apply to the first one."""
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
    lines = [f"# Blind proof: {about['cases_total']} cases", "", markdown_code(about["command"]), ""]
    lines += (
        [f"State of the tool (hash of its sources): {markdown_code(about['state'])}", ""] if "state" in about else []
    )
    lines += [f"{markdown_text(line)}\n" for line in missing_words(about)]
    lines += ["| measured | wanted | " + " | ".join(columns) + " |", "|---" * (2 + len(columns)) + "|"]
    for k, name in enumerate(names):
        row = next(iter(columns.values()))[k]
        wanted = f"{row.direction} {100 * row.reach:g} %" if row.direction else "reported"
        lines.append(f"| {name} | {wanted} | " + " | ".join(cell(own[k]) for own in columns.values()) + " |")
    first = next(iter(results), "nobody")
    broken = failures(results.get(first, ()), bool(about.get("sample")))
    if about.get("sample"):
        lines += ["", "A sample: a fail rule is broken where the 95 % limit of its share is beyond it."]
    lines += ["", *(f"- *{word}*: {meaning}" for word, meaning in WORDS.items())]
    lines += ["", "Shares with 95 % Clopper-Pearson limits, and counts. A dash: no such case, or no such statement."]
    lines += ["", f"Fail rules broken by {first}: {'; '.join(broken)}." if broken else f"{first} breaks no fail rule."]
    return "\n".join(lines) + "\n"


def cell(row: Row) -> str:
    """A row's value in words: ``96 % (91-99), 48/50``."""
    if row.share is None:
        return "–"
    return f"{100 * row.share:.0f} % ({100 * row.low:.0f}-{100 * row.high:.0f}), {row.count}/{row.total}"
