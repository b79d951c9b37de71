"""From the selected model to the verdict: effects in canonical names, errors by channel, what could have been seen."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

import cable_envs
from cable_envs.diagnosis.adequacy.bands import Averaged
from cable_envs.diagnosis.adequacy.tests import Adequacy, adequacy
from cable_envs.diagnosis.data.recording import Recording
from cable_envs.diagnosis.fit.confidence import MOST, confidence, highest, interval
from cable_envs.diagnosis.fit.likelihood import Judged, raw_residuals
from cable_envs.diagnosis.fit.refit import Fit
from cable_envs.diagnosis.fit.score_tests import Score
from cable_envs.diagnosis.intake.gate import Quality
from cable_envs.diagnosis.model.hypotheses import Hypothesis, effect_name
from cable_envs.diagnosis.model.model import Free, Model, residuals
from cable_envs.diagnosis.model.noise import jitter
from cable_envs.diagnosis.model.verdict import Diagnosis, EffectGain, Estimate, Trace
from cable_envs.diagnosis.report.fitted_range import fitted_range
from cable_envs.diagnosis.search.limit_cycles import RUNS
from cable_envs.diagnosis.search.places import located, permuted
from cable_envs.diagnosis.search.select import LIKE_ANY
from cable_envs.diagnosis.search.selection import Selection
from cable_envs.diagnosis.systems.question import Question

_STANDS_OUT = 3.6
"""Standard deviations that `cable_envs.diagnosis.fit.score_tests.Score.visible` speaks of."""


TURNED = "; the data ask for the other sign, which it cannot have"


def answer(
    recording: Recording,
    question: Question,
    selection: Selection,
    quality: Quality,
    rng: np.random.Generator,
    about: Mapping[str, Any],
) -> Diagnosis:
    """The verdict. Where what is left is no noise, nothing is named, and the refit stands for the augmented model."""
    stated = any(b.channel in recording.noise for b in question.fit.blocks)
    found = tuple(_found(a, question, selection, stated) for a in selection.accepted)
    verdict = selection.verdict
    named = verdict in ("named", "equivalence_class")
    final = selection.final if named else selection.null
    helped = selection.final if found and not named else None
    floors = _floors(recording, question.fit, selection)
    traces = _traces(question, selection.null, final, floors)
    location, traces = located(question.ways, traces, selection, named, verdict == "no_detectable_mismatch")
    accepted = [a.hypothesis.name for a in selection.accepted] if named else []
    rig = question.rig(final.fit.values, accepted)
    valid = fitted_range(recording, rig["plant"])
    return Diagnosis(
        verdict,
        found if named else (),
        tuple(location),
        _absorbed(question, selection.null, final),
        _errors(_predictable(question, selection), selection.null, final, floors, helped),
        _test(question, selection),
        () if named else found,
        _tried(question, selection),
        tuple(_leftovers(selection)),
        tuple(permuted(question.fit, selection.null, final, rng)),
        quality.visited,
        (
            *question.notes,
            *quality.notes,
            *_drifting(selection),
            *_oscillating(selection),
            *_unfitted(recording, question, selection),
            *_beside_its_effects(selection),
        ),
        {**about, "version": cable_envs.__version__, "rules": vars(selection.rules)},
        steps=selection.steps,
        spectra=() if selection.bands is None else tuple(selection.bands.rows()),
        rig=rig | ({"valid": valid} if valid else {}),
        traces=traces,
    )


def _drifting(selection: Selection) -> list[str]:
    """What a person should know of a drift that is too small to be told from others."""
    if selection.verdict != "unknown":
        return []
    settle = (
        "to settle it, repeat the motion after a rest and see whether it comes back; with a stated noise_std or a "
        "record at rest smaller drifts are visible"
    )
    found = [(name, why) for name, why in selection.refused.items() if why.startswith(LIKE_ANY)]
    return [f"{effect_name(name).replace('_', ' ')}: {why}; {settle}" for name, why in found]


def _oscillating(selection: Selection) -> list[str]:
    """How to read the errors of a model that oscillates by itself."""
    if selection.bands is None:
        return []
    by = " with it" if selection.accepted else ""
    return [
        f"the simulation{by} oscillates by itself, with a phase that cannot be predicted; so spectra were compared, "
        f"and the errors are those of the mean of {RUNS} runs, in which the oscillation averages out"
    ]


def _predictable(question: Question, selection: Selection) -> Question:
    """The question with models that predict what can be predicted, where the simulation oscillates by itself."""
    if selection.bands is None:
        return question
    fit, heldout = (Averaged(model, RUNS) for model in (question.fit, question.heldout))
    return replace(question, fit=fit, heldout=heldout)


def _unfitted(recording: Recording, question: Question, selection: Selection) -> list[str]:
    """What to do where only records that were not fitted show that something is missing."""
    at_rest = any(
        b.noise is not None for b in question.fit.blocks
    )  # else they were not asked (`cable_envs.diagnosis.search.select`)
    shows = selection.verdict == "unknown" and selection.after.p_value < selection.rules.alone_p
    if not at_rest or not shows or selection.accepted:
        return []
    alone = adequacy(question.fit, selection.null, dict(recording.noise))
    if alone.p_value < selection.rules.alone_p or alone.over_noise > selection.rules.over:
        return []
    shown = ", ".join(dict.fromkeys(b.record for b in question.heldout.blocks))
    return [
        f"only the held-out record {shown} shows it; fit a motion like that ('use: fit') and hold another record out"
    ]


def _beside_its_effects(selection: Selection) -> list[str]:
    """What is left of a rig that has effects already, where it is more than noise and too little to be asked about."""
    named_none = selection.verdict == "no_detectable_mismatch" and selection.bands is None and selection.explained > 0.0
    if not named_none or selection.after.p_value >= selection.rules.left_p:
        return []
    share = selection.after.excess / selection.explained
    return [
        f"what is left is {share:.1%} of what the rig's effects explain; two formulations of one physics differ as much"
    ]


def parameter_name(row: str, hypothesis: Hypothesis) -> str:
    """What the effect calls a parameter that the plant may have under a name of its own."""
    for p in hypothesis.effect.parameters if hypothesis.effect else ():
        if row == p.alias:
            return p.name
    return row.partition(".")[2] or row


def _found(accepted: EffectGain, question: Question, selection: Selection, stated: bool) -> EffectGain:
    """An accepted effect with its confidence, its parameters and the names of its alternatives."""
    h, fit, rules = accepted.hypothesis, selection.final.fit, selection.rules
    parameters = {}
    for row, p in zip(h.names, h.free, strict=True):
        gain = accepted.gain if row in h.nulls else 0.0
        low, high = answered_interval(fit, p, h.nulls.get(row, 0.0), gain)
        parameters[parameter_name(row, h)] = Estimate(fit.values[row], low, high, question.units[row], row)
    others = tuple(dict.fromkeys(effect_name(n) for n in accepted.alternatives))
    # where unseen records judge, what is left is known to be no noise, and counts against no answer
    noise = bool(selection.steps) or selection.after.p_value >= rules.left_p
    left = 0.0 if noise else selection.after.excess / selection.explained
    limit = MOST if selection.steps else highest(stated, len(selection.accepted), accepted.gain)
    sure = confidence(accepted.margin, accepted.gain, rules.gain + rules.each * (len(h.free) - 1), left, limit)
    alternatives = tuple(n for n in others if n != h.canonical)
    return EffectGain(
        h, accepted.gain, accepted.heldout_gain, accepted.margin, alternatives, confidence=sure, parameters=parameters
    )  # fmt: skip


def answered_interval(fit: Fit, parameter: Free, null: float, gain: float) -> tuple[float, float]:
    """`confidence.interval` of a parameter, within what it can be."""
    low, high = interval(fit, parameter.name, null, gain)
    return max(low, parameter.low), min(high, parameter.high)


def _floors(recording: Recording, model: Model, selection: Selection) -> dict[str, float]:
    """Standard deviation of each channel's noise, SI: as stated, else as the last model left it.

    Where unseen records judge, what is left is no noise: then from the measured channel's third differences.
    """
    floors = {name: noise.floor for name, noise in selection.final.whitener.noise.items()}
    if selection.steps:
        seen = {n: np.concatenate([b.measured[b.good] for b in model.blocks if b.channel == n]) for n in floors}
        floors = {name: jitter(values) for name, values in seen.items()}
    return {name: recording.noise.get(name, floor) for name, floor in floors.items()}


def _traces(question: Question, null: Judged, final: Judged, floors: Mapping[str, float]) -> tuple[Trace, ...]:
    made = []
    for use, model in (("fit", question.fit), ("heldout", question.heldout)):
        left = [raw_residuals(model, judged.fit) for judged in (null, final)]
        for k, block in enumerate(model.blocks):
            along = {c.name: (c.unit, c.values) for c in block.along}
            before, after = (block.measured - series[k] for series in left)
            made.append(Trace(
                block.record, block.channel, block.unit, use, block.time, block.measured, block.good, before, after,
                floors[block.channel], along,
            ))  # fmt: skip
    return tuple(made)


def _absorbed(question: Question, null: Judged, final: Judged) -> dict[str, dict[str, Any]]:
    starts = {p.name: p.start for p in question.fit.parameters}
    return {
        name: {
            "before": starts[name], "after_refit": null.fit.values[name], "after_model": final.fit.values[name],
            "unit": question.units.get(name, ""), "ci95": list(interval(final.fit, name)),
        }
        for name in question.nominals
        if name not in question.nuisance
    }  # fmt: skip


def _errors(
    question: Question, null: Judged, final: Judged, floors: Mapping[str, float], helped: Judged | None
) -> dict[str, Any]:
    """RMS of every channel; ``helped``: with effects that helped and are not named."""
    found: dict[str, Any] = {}
    for use, model in (("heldout_rmse", question.heldout), ("fit_rmse", question.fit)):
        nominal = np.array([[p.start] for p in model.parameters])
        series = {
            "nominal": [r[:, 0] for r in residuals(model.blocks, model.predict(nominal))],
            "refit": raw_residuals(model, null.fit),
            "augmented": raw_residuals(model, final.fit),
        }
        if helped is not None:
            series["suspected"] = raw_residuals(model, helped.fit)
        for channel in dict.fromkeys(b.channel for b in model.blocks):
            unit = next(b.unit for b in model.blocks if b.channel == channel)
            entry = found.setdefault(channel, {"unit": unit, "noise_floor": floors[channel]})
            entry[use] = {name: _rms(model, values, channel) for name, values in series.items()}
    return found


def _rms(model: Model, series: Sequence[np.ndarray], channel: str) -> float:
    own = [r[b.good] for r, b in zip(series, model.blocks, strict=True) if b.channel == channel]
    return float(np.sqrt(np.mean(np.concatenate(own) ** 2)))


def _test(question: Question, selection: Selection) -> dict[str, Any]:
    first = selection.score_tests[0] if selection.score_tests else None
    return {
        "p_value": selection.before.p_value if first is None else min(first.p_value, 1.0),
        "p_left": selection.after.p_value,
        "rms_over_stated_noise": selection.after.over_noise,
        "minimum_detectable": {h.name: _detectable(h, question, selection) for h in question.hypotheses},
    }


def _detectable(h: Hypothesis, question: Question, selection: Selection) -> str:
    """Size at which the effect would gain what the rules ask for, by the probe that shows it best, with its unit."""
    rules = selection.rules
    asked = np.sqrt(rules.gain + rules.each * (len(h.free) - 1)) / _STANDS_OUT
    scores = [s for tests in selection.score_tests[:1] for s in tests.scores if s.hypothesis is h]
    scores = [s for s in scores if np.isfinite(s.visible)]
    if not selection.score_tests:
        return "not looked for"
    if not scores:
        return "no size: the refit absorbs it"
    lead = next(iter(h.nulls))
    unit = question.units.get(lead, "")
    unit = "" if unit in ("", "1") else f" {unit}"
    bounds = next(p for p in h.free if p.name == lead)
    name = parameter_name(lead, h)
    if lead in h.inverse:
        value = max(_probed(s, lead) / (s.visible * asked) for s in scores)
        return f"{name} below {value:.3g}{unit}" if value > bounds.low else "no size within its bounds"
    size = min(abs(_probed(s, lead) - h.nulls[lead]) * s.visible * asked for s in scores)
    if size > max(abs(bounds.high - h.nulls[lead]), abs(bounds.low - h.nulls[lead])):
        return f"no size within its bounds; it would take {size:.3g}{unit}"
    return f"{size:.3g}{unit}"


def _probed(score: Score, row: str) -> float:
    return score.directions[0].get(row, score.hypothesis.nulls[row])


def _tried(question: Question, selection: Selection) -> tuple[dict[str, Any], ...]:
    """Every hypothesis: what it gained when it was refitted first, and what came of it."""
    taken = {a.hypothesis.name: a for a in selection.accepted}
    first = selection.score_tests[0] if selection.score_tests else None
    refitted: dict[str, float] = {}
    for comparison in selection.tried:
        for candidate in comparison:
            refitted.setdefault(candidate.hypothesis.name, candidate.gain)
    for step in selection.steps:
        refitted = {**step.rivals, **refitted}
    rows = []
    for h in question.hypotheses:
        score = first.best.get(h.name) if first else None
        like = first.class_of(h.name) if first is not None and score is not None and score.gain > 0.0 else ()
        turned = wrong_way(score, question.fit, selection.rules.gain)
        rows.append({
            "name": h.name, "effect": h.canonical, "score": score.gain if score else 0.0,
            "gain": refitted.get(h.name), "absorbability_deg": score.absorbability if score else 0.0,
            "looks_like": list(like), "declared_confusable": list(h.confusable),
            "state": _state(h.name, taken, selection, refitted) + (TURNED if turned else ""),
            "equation": h.equation,
        })  # fmt: skip
    return tuple(sorted(rows, key=lambda r: (r["name"] not in taken, -(r["gain"] or -1.0), -r["score"])))


def wrong_way(score: Score | None, model: Model, least: float) -> bool:
    """Whether the data want an effect on the side of its null where it has no values; least: gain that says so."""
    if score is None:
        return False
    sizes = [n for n in score.directions[0] if n in score.hypothesis.nulls]
    if len(sizes) != 1 or sizes[0] in score.hypothesis.inverse or score.gain < least:
        return False
    row, null = next(p for p in model.parameters if p.name == sizes[0]), score.hypothesis.nulls[sizes[0]]
    return len(score.directions) == 1 and score.amount[0] < 0.0 and null in (row.low, row.high)


def _state(name: str, taken: Mapping[str, EffectGain], selection: Selection, refitted: Mapping[str, float]) -> str:
    if name in taken:
        return "accepted" if selection.verdict != "unknown" else "improves the fit, but does not explain what is left"
    classes = [a.hypothesis.name for a in taken.values() if name in a.alternatives]
    if classes:
        return f"cannot be distinguished from {', '.join(classes)}"
    if name in selection.refused and not taken:
        return f"refused: {selection.refused[name]}"
    if name in refitted:
        return "refitted; another effect fits better" if taken else "refitted; the gain is too small"
    return "not refitted; other effects have higher estimates"


def _leftovers(selection: Selection) -> list[dict[str, Any]]:
    """Smooth maps of what is left, before and after, the smallest p-value first."""

    def rows(adequacy: Adequacy, when: str) -> list[dict[str, Any]]:
        return [
            {
                "when": when, "channel": f.channel, "coordinate": f.coordinate, "unit": f.unit, "gain": f.gain,
                "functions": f.functions, "p_value": f.p_value, "at": list(f.at), "height": list(f.height),
                "error": list(f.error),
            }
            for f in adequacy.leftovers[:12]
        ]  # fmt: skip

    before = rows(selection.before, "after the refit")
    return before if selection.before is selection.after else before + rows(selection.after, "after the model")
