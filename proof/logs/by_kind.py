"""Answers by the kind of log that recordings have: what became of each, in Markdown."""

from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from cable_envs.proof.scoring import BANDS, EDGES, Result, calibration

DRAWS = 4000
"""Proofs that are drawn to say by how much right confidences are off by chance."""

WORDS = {
    "none": "no mismatch", "data": "fault of the data", "exact": "exact name", "class": "class that holds it",
    "partly": "one of two", "unknown": "unknown", "wrong": "wrong name", "failed": "no answer",
}  # fmt: skip
"""Outcomes as columns are headed, in this order."""


class Line(NamedTuple):
    """A row of `headline`: recordings of these kinds and bands that have one of these outcomes."""

    name: str
    wanted: str
    kinds: tuple[str, ...]
    bands: tuple[str, ...]
    outcomes: tuple[str, ...]


_RIGHT, _ALL = ("exact", "class"), tuple(BANDS)
HEADLINE = (
    Line("effect adds more than 10 %: exact name", "", ("single",), (">10",), ("exact",)),
    Line(
        "effect adds more than 10 %: exact name or class", "95 %; 85 % of logs as rigs make them", ("single",),
        (">10",), _RIGHT,
    ),
    Line("effect adds more than 10 %: wrong name", "at most 3 %", ("single",), (">10",), ("wrong",)),
    Line("effect adds 3 to 10 %: exact name", "", ("single",), ("3-10",), ("exact",)),
    Line("effect adds 3 to 10 %: exact name or class", "", ("single",), ("3-10",), _RIGHT),
    Line("effect adds 1 to 3 %: exact name", "", ("single",), ("1-3",), ("exact",)),
    Line("effect adds 1 to 3 %: exact name or class", "", ("single",), ("1-3",), _RIGHT),
    Line("effect of any size: wrong name", "", ("single",), _ALL, ("wrong",)),
    Line("two effects at once: exact names of both", "", ("pair",), (), ("exact",)),
    Line("two effects at once: exact names or class of both", "", ("pair",), (), _RIGHT),
    Line(
        'physics outside the library: "unknown"', "85 %; 70 % of logs as rigs make them", ("strange",), (),
        ("unknown",),
    ),
    Line("nothing missing: an effect is named", "at most 5 %", ("nothing",), (), ("wrong",)),
    Line('nothing missing: "unknown"', "at most 10 %", ("nothing",), (), ("unknown",)),
    Line("nothing missing: a fault of the data", "", ("nothing",), (), ("data",)),
    Line("nothing missing: no answer", "", ("nothing",), (), ("failed",)),
    Line("only parameters wrong: an effect is named", "at most 5 %", ("decoy",), (), ("wrong",)),
    Line('only parameters wrong: "unknown"', "at most 10 %", ("decoy",), (), ("unknown",)),
)  # fmt: skip
"""Rows of `headline`; without bands, recordings with whatever is added."""
SURE = 0.95
"""Stated confidence of which `headline` says how often it is right."""


def headline(results: Sequence[Result]) -> str:
    """What a proof with logs as rigs make them says in a dozen lines.

    Parameters
    ----------
    results : sequence of Result
        Of one method.

    Returns
    -------
    str
        `headline_rows` as a Markdown table, and `confidences`.
    """
    head, *rows = headline_rows(results)
    lines = [f"| {' | '.join(head)} |", f"|---|---|{'--:|' * (len(head) - 2)}"]
    lines += [f"| {' | '.join(row)} |" for row in rows]
    return "\n".join([*lines, "", confidences(results)]) + "\n"


def headline_rows(results: Sequence[Result]) -> list[tuple[str, ...]]:
    """The head and the rows of `headline`.

    Parameters
    ----------
    results : sequence of Result
        Of one method.

    Returns
    -------
    list of tuple of str
        What is counted, what was wanted, and counts of all recordings, of those with white noise that is stated, of
        those with a record at rest, and of all other logs.
    """
    groups = {
        "all": list(results),
        "white": [r for r in results if r.noise == "white"],
        "at rest": [r for r in results if r.noise == "rest"],
        "as rigs make them": [r for r in results if r.noise not in ("white", "rest")],
    }
    rows = [("in the recording", "wanted", *groups)]
    for line in HEADLINE:
        cells = [_share([r.outcome in line.outcomes for r in own if _of(line, r)]) for own in groups.values()]
        rows.append((line.name, line.wanted, *cells))
    cells = [_share([hit for r in own for _, hit in r.intervals]) for own in groups.values()]
    return [*rows, ("95 % intervals of parameters that contain the true value", "90 to 99 %", *cells)]


def _of(line: Line, result: Result) -> bool:
    return result.kind in line.kinds and (not line.bands or result.band in line.bands)


def _share(hits: Sequence[bool]) -> str:
    return f"{sum(hits)} of {len(hits)}" if hits else "–"


def confidences(results: Sequence[Result]) -> str:
    """A sentence: how far stated confidences are from the share that is right, and how often the surest are."""
    claims = [claim for r in results for claim in r.claims]
    if not claims:
        return "No confidence is stated."
    sure = [right for stated, right in claims if stated >= SURE]
    bins = calibration(results)
    off = sum(b["answers"] * abs(b["stated"] - b["share"]) for b in bins) / len(claims)
    usual, seldom = by_chance([claim for claim, _ in claims])
    return (
        f"The confidences of {len(claims)} named effects are off by {off:.3f} on average (expected calibration error; "
        f"at most 0.03 was wanted): of {len(sure)} of {SURE:g} and more, {sum(sure)} are right. As few answers whose "
        f"confidences are exactly right would be off by {usual:.3f} on average, and one time in twenty by {seldom:.3f}."
    )


def by_chance(stated: Sequence[float]) -> tuple[float, float]:
    """(mean, 95 % quantile) of the expected calibration error of confidences that are right, in so many answers."""
    rng, confidence = np.random.default_rng(0), np.array(stated)
    places = np.digitize(confidence, EDGES)
    bins = np.array([places == k for k in np.unique(places)])
    missed = (rng.random((DRAWS, len(confidence))) < confidence) - confidence
    off = np.abs(missed @ bins.T).sum(axis=1) / len(confidence)
    return float(off.mean()), float(np.quantile(off, 0.95))


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
