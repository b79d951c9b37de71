"""Answers by the kind of log that recordings have: what became of each, in Markdown."""

from collections import Counter
from collections.abc import Sequence

from cable_envs.proof.scoring import BANDS, Result

LABORATORY = ("white", "coloured")
"""Noises of generator A's proof, which knows no other kinds of logs."""
WORDS = {
    "none": "no mismatch", "data": "fault of the data", "exact": "exact name", "class": "class that holds it",
    "partly": "one of two", "unknown": "unknown", "wrong": "wrong name", "failed": "no answer",
}  # fmt: skip
"""Outcomes as columns are headed, in this order."""


def outcomes(results: Sequence[Result]) -> str:
    """Outcomes by what is missing and by kind of log.

    Parameters
    ----------
    results : sequence of Result
        Of one method.

    Returns
    -------
    str
        A table for each: nothing missing, one effect by how much it adds, two, physics outside the library. The exact
        name and a class that holds it have columns of their own.
    """
    parts = {
        "nothing missing": [r for r in results if r.kind == "nothing"],
        "only parameters wrong": [r for r in results if r.kind == "decoy"],
        **{
            f"effect adds {words}": [r for r in results if r.kind == "single" and r.band == band]
            for band, words in BANDS.items()
        },
        "two effects at once": [r for r in results if r.kind == "pair"],
        "physics outside the library": [r for r in results if r.kind == "strange"],
    }
    return "\n".join(_table(name, own) for name, own in parts.items() if own)


def _table(name: str, results: Sequence[Result]) -> str:
    seen = [outcome for outcome in WORDS if any(r.outcome == outcome for r in results)]
    lines = [f"| {name} | {' | '.join(WORDS[o] for o in seen)} | recordings |", f"|---|{'--:|' * (len(seen) + 1)}"]
    for noise in (*sorted({r.noise for r in results}), "all"):
        counts = Counter(r.outcome for r in results if noise in ("all", r.noise))
        lines.append(f"| {noise} | {' | '.join(str(counts[o]) for o in seen)} | {sum(counts.values())} |")
    return "\n".join([*lines, ""])
