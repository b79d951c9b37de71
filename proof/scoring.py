"""Verdicts against opened keys: one `Result` for each case, then the proof's tables and limits.

A verdict is JSON of schema "cable-diagnosis/1"; None stands for a tool that gave none. Names that are true of every
recording of a system (`effects.AMBIENT`) are taken out of an answer first.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

from cable_envs.proof.effects import share_class

NAMED = ("named", "equivalence_class", "partly_named")
"""Verdicts with names; the last one says besides that a part is unexplained, and is scored as the first."""
OUTCOMES = ("exact", "class", "partly", "wrong", "unknown", "data", "none", "failed")
"""exact: the names, all and only; class: a truth is among declared alternatives of its class; partly: one of two named,
nothing wrong; wrong: a name that is not there; unknown, data, none: these verdicts; failed: no verdict."""

SEEN = 100.0
"""Gain of knowing the mismatch's shape and the noise from which a tool that knows neither may be expected to see it."""

BANDS = {">10": "more than 10 %", "3-10": "3 to 10 %", "1-3": "1 to 3 %"}
"""What a concealed effect adds to the RMS of the residual, in words."""
LABORATORY = ("white", "ar1", "flicker", "coloured")
"""Noises of proofs without logs as rigs make them: stated, or known from a record at rest."""
LIMITS = {"false_alarms": 0.05, "coverage": 0.90, "claimed_90": 0.85}
"""Most false alarms, least coverage of 95 % intervals, least share right of answers claimed at 90 %."""

ROUNDING = 1e-9
"""Share of a true value by which it may be beyond an end of its interval: by the rounding of either's arithmetic."""


def band_of(added: float) -> str:
    """The band of what an effect really adds to the RMS; "<1" where less than any table asks for."""
    return ">10" if added >= 0.10 else "3-10" if added >= 0.03 else "1-3" if added >= 0.01 else "<1"


@dataclass(frozen=True)
class Result:
    """One case scored; None where a question does not arise."""

    name: str
    system: str
    kind: str
    truth: tuple[str, ...]
    band: str
    noise: str
    concealment: tuple[str, ...]
    verdict: str
    answer: tuple[str, ...]
    outcome: str
    claims: tuple[tuple[float, bool], ...] = ()
    """(stated confidence, whether that name is right) of every named effect"""
    intervals: tuple[tuple[str, bool], ...] = ()
    """("effect.parameter", whether the 95 % interval covers the truth) of effects rightly named"""
    overlap: float | None = None
    stands_out: float = float("inf")
    """gain of whoever knows the mismatch's shape and the noise's spectrum"""
    heldout: float | None = None
    """largest RMSE of the augmented model over the RMS of the noise that is in the channel"""
    offered: bool = False
    """whether a wrong answer has a truth among its alternatives, beside names that are not declared to look like it"""


def restored(case: Mapping[str, Any]) -> Result:
    """A `Result` from its JSON."""
    lists = {name: tuple(map(tuple, case[name])) for name in ("claims", "intervals")}
    names = {name: tuple(case[name]) for name in ("truth", "concealment", "answer")}
    seen = case["stands_out"]
    return Result(**{**case, **lists, **names, "stands_out": float("inf") if seen is None else float(seen)})


def judge(key: Mapping[str, Any], verdict: Mapping[str, Any] | None) -> Result:
    """Score one verdict against its key.

    Parameters
    ----------
    key : Mapping
        Of `cable_envs.proof.cases.make`.
    verdict : Mapping, optional
        Of schema "cable-diagnosis/1"; None: the tool gave none.

    Returns
    -------
    Result
        Whether names, classes, intervals and places are right.
    """
    case = key["case"]
    truth = tuple(e["name"] for e in key["effects"])
    named = [] if verdict is None else [e for e in verdict.get("effects", ()) if e.get("name") not in key["ambient"]]
    kind = "failed" if verdict is None else str(verdict.get("verdict"))
    if kind in NAMED and not named:
        kind = "no_detectable_mismatch"  # it named what is always there, and nothing else
    answers = named if kind in NAMED else []
    right = [_rightness(entry, truth) for entry in answers]
    return Result(
        case["name"],
        case["system"],
        case["kind"],
        truth,
        band_of(key["added"]) if case["kind"] in ("single", "strange") else case["band"],
        case["noise"],
        tuple(key["concealment"]),
        kind,
        tuple(str(e["name"]) for e in answers),
        _outcome(kind, case["kind"], truth, answers, right),
        tuple(
            (float(e["confidence"]), r != "wrong")
            for e, r in zip(answers, right, strict=True)
            if e.get("confidence") is not None
        ),
        tuple(_intervals(key, answers)),
        _overlap(key, verdict) if truth and answers else None,
        float(key.get("stands_out", "inf")),
        _heldout(key, verdict) if answers and truth and "wrong" not in right else None,
        any(r == "wrong" and set(truth) & set(e.get("alternatives", ())) for e, r in zip(answers, right, strict=True)),
    )


def _rightness(entry: Mapping[str, Any], truth: Sequence[str]) -> str:
    """exact, class or wrong. A class answer must hold a truth, and nothing that is not declared confusable with it."""
    name, others = str(entry["name"]), [str(a) for a in entry.get("alternatives", ())]
    if name in truth:
        return "exact"
    for true in truth:
        if true in others and all(share_class(true, n) for n in (name, *others)):
            return "class"
    return "wrong"


def _outcome(
    kind: str, case: str, truth: Sequence[str], answers: Sequence[Mapping[str, Any]], right: Sequence[str]
) -> str:
    without = {"failed": "failed", "unknown": "unknown", "data_fault": "data", "no_detectable_mismatch": "none"}
    if kind in without:
        return without[kind]
    if "wrong" in right or not truth or case == "strange":
        return "wrong"
    met = {t for t in truth for e in answers if t == e["name"] or t in e.get("alternatives", ())}
    if len(met) < len(truth):
        return "partly"
    exact = kind != "equivalence_class" and set(right) == {"exact"} and len(answers) == len(truth)
    return "exact" if exact else "class"


def _intervals(key: Mapping[str, Any], answers: Iterable[Mapping[str, Any]]) -> Iterable[tuple[str, bool]]:
    for true in key["effects"]:
        entry = next((e for e in answers if e["name"] == true["name"]), None)
        for name, parameter in true["parameters"].items():
            stated = (entry or {}).get("parameters", {}).get(name)
            if stated and stated.get("ci95"):
                low, high = stated["ci95"]
                slack = ROUNDING * abs(parameter["value"])
                yield f"{true['name']}.{name}", low - slack <= parameter["value"] <= high + slack


def _overlap(key: Mapping[str, Any], verdict: Mapping[str, Any] | None) -> float | None:
    """Share of the true mismatch's energy inside the intervals of the verdict's location, by bins."""
    spans = [tuple(i) for place in (verdict or {}).get("location", ()) for i in place.get("intervals_s", ())]
    if not spans or not key["mismatch"]:
        return None
    width = 0.5
    inside = 0.0
    for start, share in key["mismatch"]:
        # intervals of several channels may overlap: the part of the bin that any of them covers
        edges = sorted((max(a, start), min(b, start + width)) for a, b in spans if a < start + width and b > start)
        covered, reached = 0.0, start
        for a, b in edges:
            covered += max(0.0, b - max(a, reached))
            reached = max(reached, b)
        inside += share * covered / width
    return inside


def _heldout(key: Mapping[str, Any], verdict: Mapping[str, Any] | None) -> float | None:
    ratios = []
    for channel, fit in (verdict or {}).get("fit", {}).items():
        rmse = (fit.get("heldout_rmse") or {}).get("augmented")
        if rmse is not None and channel in key["noise_floor"]:
            ratios.append(float(rmse) / key["noise_floor"][channel])
    return max(ratios, default=None)


def limits(count: int, total: int, level: float = 0.95) -> tuple[float, float]:
    """Clopper-Pearson limits of a share.

    Parameters
    ----------
    count, total : int
        So many of so many.
    level : float
        Of confidence.

    Returns
    -------
    tuple of float
        (low, high); (0, 1) without cases.
    """
    from scipy.stats import beta

    if total == 0:
        return 0.0, 1.0
    tail = 0.5 * (1.0 - level)
    low = 0.0 if count == 0 else float(beta.ppf(tail, count, total - count + 1))
    high = 1.0 if count == total else float(beta.ppf(1.0 - tail, count + 1, total - count))
    return low, high


@dataclass(frozen=True)
class Row:
    """One line of the table: ``count`` of ``total`` with 95 % limits, against ``reach`` (direction >= or <=)."""

    name: str
    count: int
    total: int
    direction: str
    reach: float
    note: str = ""
    low: float = field(init=False)
    high: float = field(init=False)

    def __post_init__(self) -> None:
        low, high = limits(self.count, self.total)
        object.__setattr__(self, "low", low)
        object.__setattr__(self, "high", high)

    @property
    def share(self) -> float | None:
        """count / total, None without cases."""
        return self.count / self.total if self.total else None

    @property
    def reached(self) -> bool | None:
        """Whether the share is on the wanted side of ``reach``; None without cases or where nothing is asked."""
        if self.share is None or not self.direction:
            return None
        return self.share >= self.reach if self.direction == ">=" else self.share <= self.reach


def _row(name: str, hits: Iterable[bool], direction: str = "", reach: float = 0.0, note: str = "") -> Row:
    found = list(hits)
    return Row(name, sum(found), len(found), direction, reach, note)


def table(results: Sequence[Result]) -> list[Row]:
    """The proof's rows."""
    single = [r for r in results if r.kind == "single"]
    nothing = [r for r in results if r.kind == "nothing"]
    decoys = [r for r in results if r.kind == "decoy"]
    right = ("exact", "class")
    rows = []
    for (band, words), reach in zip(BANDS.items(), (0.95, 0.0, 0.75), strict=True):
        own, adds = [r for r in single if r.band == band], f"effect adds {words}"
        rows.append(_row(f"{adds}: exact name", _in(own, ("exact",))))
        rows.append(_row(f"{adds}: exact name or class", _in(own, right), ">=" if reach else "", reach))
        rows += _by_noise(f"{adds}: exact name or class", own, right)
        clear = [r for r in own if r.stands_out >= SEEN]
        rows.append(_row(f"{adds}, possible gain of {SEEN:g} or more: exact name or class", _in(clear, right)))
        limit = ("<=", 0.03) if band == "1-3" else ("", 0.0)
        rows.append(_row(f"{adds}: wrong name", _in(own, ("wrong",)), *limit))
        offered = (r.outcome == "wrong" and r.offered for r in own)
        rows.append(_row(f"{adds}: wrong name, with the right one among its alternatives", offered))
    for noise in ("white", "coloured"):
        own = [r for r in nothing if (r.noise == "white") == (noise == "white")]
        rows.append(_row(f"nothing missing, {noise} noise: something is reported", (alarm(r) for r in own), "<=", 0.05))
    rows.append(_row("only parameters wrong: an effect is named", _in(decoys, ("wrong",)), "<=", 0.05))
    strange = [r for r in results if r.kind == "strange"]
    rows.append(_row('physics outside the library: "unknown"', _in(strange, ("unknown",)), ">=", 0.90))
    rows += _by_noise('physics outside the library: "unknown"', strange, ("unknown",))
    seen = [r for r in strange if r.stands_out >= SEEN]
    rows.append(
        _row(f'physics outside the library, possible gain of {SEEN:g} or more: "unknown"', _in(seen, ("unknown",)))
    )
    pairs = [r for r in results if r.kind == "pair"]
    rows.append(_row("two effects at once: exact name or class of both", _in(pairs, right), ">=", 0.70))
    rows += _by_noise("two effects at once: exact name or class of both", pairs, right)
    covered = [hit for r in results for _, hit in r.intervals]
    rows.append(_row("95 % intervals of parameters that contain the true value", covered, ">=", 0.90, "90-98 % wanted"))
    held = [r.heldout for r in single if r.heldout is not None]
    rows.append(_row("held-out RMS at most 1.15 times the noise, where named", (h <= 1.15 for h in held), ">=", 0.95))
    overlaps = [r.overlap for r in single if r.overlap is not None]
    rows.append(_row("stated regime holds at least 80 % of the mismatch", (o >= 0.8 for o in overlaps), ">=", 0.8))
    for kind in ("absorbed_by_refit", "masked_by_loop", "brief", "small_in_rms", "behind_another_effect"):
        own = [r for r in results if kind in r.concealment and r.kind in ("single", "pair")]
        rows.append(_row(f"effect that is {kind.replace('_', ' ')}: exact name or class", _in(own, right)))
    rows.append(_row("no answer at all", _in(results, ("failed",)), "<=", 0.0))
    return rows


def of_laboratory(results: Iterable[Result]) -> bool:
    """Whether no recording has a log as rigs make them."""
    return all(r.noise in LABORATORY for r in results)


def _by_noise(name: str, results: Sequence[Result], outcomes: Sequence[str]) -> list[Row]:
    """White noise, which recordings state, and all other, of which those of generator A have a record at rest."""
    white = [r for r in results if r.noise == "white"]
    others = [r for r in results if r.noise != "white"]
    at_rest = of_laboratory(others)
    return [
        _row(f"{name} (white noise, stated)", _in(white, outcomes)),
        _row(f"{name} ({'coloured noise, recorded at rest' if at_rest else 'all other logs'})", _in(others, outcomes)),
    ]


def _in(results: Iterable[Result], outcomes: Sequence[str]) -> list[bool]:
    return [r.outcome in outcomes for r in results]


def alarm(result: Result) -> bool:
    """Whether a recording with nothing wrong was answered with anything but that."""
    return result.outcome != "none"


def confusion(results: Iterable[Result]) -> dict[str, dict[str, int]]:
    """True name -> answer -> count, of single effects, strange ones and recordings without any.

    An answer is the first name, or the verdict. A case with two effects is in the table, not here.
    """
    found: dict[str, dict[str, int]] = {}
    for r in results:
        if r.kind == "pair":
            continue
        true = r.truth[0] if r.kind == "single" else "strange" if r.kind == "strange" else r.kind
        answer = {
            "unknown": "unknown",
            "data": "fault of the data",
            "none": "no mismatch",
            "failed": "no verdict",
        }.get(r.outcome)
        if answer is None:
            answer = r.truth[0] if r.outcome in ("exact", "class") else r.answer[0]
            if r.outcome == "class" and r.answer[0] != r.truth[0]:
                answer = f"class of {r.truth[0]}"
        row = found.setdefault(true, {})
        row[answer] = row.get(answer, 0) + 1
    return found


EDGES = (0.0, 0.5, 0.7, 0.8, 0.9, 0.95, 1.0001)
"""Confidences between which answers are put together, to see what share of them is right."""


def calibration(results: Iterable[Result], edges: Sequence[float] = EDGES) -> list[dict]:
    """Stated confidence against the share that is right, in bins that hold answers."""
    claims = [claim for r in results for claim in r.claims]
    bins = []
    for low, high in pairwise(edges):
        own = [(c, ok) for c, ok in claims if low <= c < high]
        if own:
            hits = sum(ok for _, ok in own)
            bins.append({
                "from": low, "to": min(high, 1.0), "answers": len(own), "right": hits,
                "stated": sum(c for c, _ in own) / len(own), "share": hits / len(own),
                "limits": limits(hits, len(own)),
            })  # fmt: skip
    return bins


def failures(results: Sequence[Result], sample: bool = False) -> list[str]:
    """The limits that results exceed, in words; a limit without cases is not exceeded.

    Parameters
    ----------
    results : sequence of Result
        Of one method.
    sample : bool
        A few dozen cases, of which one more or less means nothing: a limit is exceeded where the 95 % interval of the
        share is beyond it, not the share itself.

    Returns
    -------
    list of str
        Empty where none is exceeded.
    """
    without = [r for r in results if r.kind in ("nothing", "decoy")]
    alarms = sum(alarm(r) if r.kind == "nothing" else r.outcome == "wrong" for r in without)
    covered = [hit for r in results for _, hit in r.intervals]
    claimed = [ok for r in results for c, ok in r.claims if c >= 0.9]

    def share(count: int, total: int, least: bool) -> float:
        return limits(count, total)[1 if least else 0] if sample else count / total

    broken = []
    if without and share(alarms, len(without), False) > LIMITS["false_alarms"]:
        broken.append(f"false alarms: {alarms} of {len(without)}, more than 5 %")
    if covered and share(sum(covered), len(covered), True) < LIMITS["coverage"]:
        broken.append(f"95 % intervals that contain the true value: {sum(covered)} of {len(covered)}, less than 90 %")
    if claimed and share(sum(claimed), len(claimed), True) < LIMITS["claimed_90"]:
        broken.append(
            f"answers with a confidence of 0.9 or more: {sum(claimed)} of {len(claimed)} right, less than 85 %"
        )
    return broken
