"""From the selected model to the verdict: effects in canonical names, errors by channel, what could have been seen."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

import cable_envs
from cable_envs.diagnosis.data.recording import Recording
from cable_envs.diagnosis.evidence.bands import Averaged
from cable_envs.diagnosis.evidence.candidates import prior_width
from cable_envs.diagnosis.evidence.joint import Joint
from cable_envs.diagnosis.fit.likelihood import Judged, raw_residuals
from cable_envs.diagnosis.fit.refit import Fit
from cable_envs.diagnosis.fit.score_tests import Score
from cable_envs.diagnosis.intake.after import Suspicion, after_fit
from cable_envs.diagnosis.intake.gate import Quality
from cable_envs.diagnosis.model.hypotheses import LOGGER, Hypothesis, effect_name
from cable_envs.diagnosis.model.leftover import Left
from cable_envs.diagnosis.model.model import Free, Model, residuals
from cable_envs.diagnosis.model.verdict import NAMED, SURE, Diagnosis, EffectGain, Estimate, Trace
from cable_envs.diagnosis.report.fitted_range import fitted_range
from cable_envs.diagnosis.report.notes import (
    constant,
    faulty,
    in_words,
    on_bounds,
    oscillating,
    since_it_began,
    unpredicted,
    unseen,
)
from cable_envs.diagnosis.report.products import products
from cable_envs.diagnosis.search.limit_cycles import RUNS
from cable_envs.diagnosis.search.places import located, permuted
from cable_envs.diagnosis.search.selection import Selection
from cable_envs.diagnosis.systems.question import Question
from cable_envs.diagnosis.systems.stated.limits import untorn
from cable_envs.plants import family

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
    """The verdict. Where nothing is named, the refit stands for the augmented model.

    Where the last model brings to light that the data are to be mended first, nothing is named either.
    """
    found = tuple(with_estimates(a, question, selection) for a in selection.accepted)
    faults = (*selection.left_out, *(with_estimates(a, question, selection) for a in selection.faults))
    seen = () if selection.bands else after_fit(question, selection.final.fit, selection.null.fit)
    to_mend = [one for one in seen if one.fatal]
    verdict = "data_fault" if to_mend else selection.verdict
    named = verdict in NAMED
    mended = verdict == "data_fault" and not found
    final = selection.final if named or mended else selection.null
    helped = selection.final if found and not named else None
    floors = _floors(recording, question, selection)
    traces = _traces(question, selection.null, final, floors)
    location, traces = located(question.ways, traces, selection, named or mended, verdict == "no_detectable_mismatch")
    constants = [with_estimates(a, question, selection) for a in selection.constants] if named else []
    accepted = [a.hypothesis.name for a in (*selection.accepted, *constants)] if named else []
    rig = question.rig(final.fit.values, accepted)
    rig = untorn(recording, rig) if "plant" in rig else rig
    valid = fitted_range(recording, rig["plant"]) if "plant" in rig else {}
    return Diagnosis(
        verdict,
        found if named else (),
        tuple(location),
        _absorbed(question, selection.null, final),
        _errors(_predictable(question, selection), selection.null, final, floors, helped),
        _test(question, selection, faults, to_mend),
        () if named else found,
        faults,
        _tried(question, selection, verdict),
        tuple(_leftovers(selection)),
        tuple(permuted(question.fit, selection.null, final, rng)),
        quality.visited,
        (
            *question.notes,
            *quality.notes,
            *oscillating(selection),
            *faulty(selection, faults, seen),
            *constant(constants),
            *since_it_began(question.fit.blocks, found),
            *unpredicted(selection),
            *on_bounds(question, final.fit),
            *unseen(selection),
        ),
        {
            **about,
            "version": cable_envs.__version__,
            "environment": bool("plant" in rig and family(rig["plant"]).tasks),
        },
        steps=tuple(_with_units(step, question) for step in selection.steps),
        spectra=() if selection.bands is None else tuple(selection.bands.rows()),
        products=tuple(_products(question, selection)),
        rig=rig | ({"valid": valid} if valid else {}),
        traces=traces,
        not_asked=dict(question.not_asked),
        parameters=tuple(vars(origin) for origin in question.origins),
    )


def _predictable(question: Question, selection: Selection) -> Question:
    """The question with models that predict what can be predicted, where the simulation oscillates by itself."""
    if selection.bands is None:
        return question
    fit, heldout = (Averaged(model, RUNS) for model in (question.fit, question.heldout))
    return replace(question, fit=fit, heldout=heldout)


def parameter_name(row: str, hypothesis: Hypothesis) -> str:
    """What the effect calls a parameter that the plant may have under a name of its own."""
    for p in hypothesis.effect.parameters if hypothesis.effect else ():
        if row == p.alias:
            return p.name
    return row.partition(".")[2] or row


def with_estimates(accepted: EffectGain, question: Question, selection: Selection) -> EffectGain:
    """An accepted effect with its parameters and the names of its alternatives."""
    h, fit = accepted.hypothesis, selection.final.fit
    parameters = {}
    for row, p in zip(h.names, h.free, strict=True):
        low, high = answered_interval(fit, p)
        parameters[parameter_name(row, h)] = Estimate(fit.values[row], low, high, question.units[row], row)
    others = tuple(dict.fromkeys(effect_name(n) for n in accepted.alternatives))
    return replace(accepted, alternatives=tuple(n for n in others if n != h.canonical), parameters=parameters)


def _products(question: Question, selection: Selection) -> list[dict[str, Any]]:
    """What the last model knows as products only, of all records; not of one that was compared by spectra."""
    if selection.bands is not None:
        return []
    effects = [e.hypothesis for e in selection.taken]
    nulls = {name: null for h in effects for name, null in h.nulls.items() if name not in h.inverse}
    phases = [h.wave[1] for h in effects if h.wave]
    joint, final = Joint(question.fit, question.heldout), selection.final
    found = products(joint, final.whitener, final.fit, nulls, (*question.nuisance, *phases))
    return [one.as_json(question.units) for one in found]


def _with_units(step: EffectGain, question: Question) -> EffectGain:
    return replace(step, parameters={n: replace(e, unit=question.units.get(n, "")) for n, e in step.parameters.items()})


def answered_interval(fit: Fit, parameter: Free) -> tuple[float, float]:
    """95 % interval of a parameter, within what it can be."""
    low, high = fit.interval(parameter.name)
    return max(low, parameter.low), min(high, parameter.high)


def _floors(recording: Recording, question: Question, selection: Selection) -> dict[str, float]:
    """Standard deviation of each channel's noise in a record, SI: as stated, else as the last model left it.

    It is no more than all that this left, as where no noise limits the model.
    """
    longest = max(len(r.time) for r in recording.records)
    left = raw_residuals(question.fit, selection.final.fit)
    noises = selection.final.whitener.noise
    floors = {name: min(noise.within(longest), _rms(question.fit, left, name)) for name, noise in noises.items()}
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
            "unit": question.units.get(name, ""), "ci95": list(final.fit.interval(name)),
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


def _test(
    question: Question, selection: Selection, faults: Sequence[EffectGain], to_mend: Sequence[Suspicion] = ()
) -> dict[str, Any]:
    scored, after = selection.score_tests, selection.after
    most = max([selection.before.log_odds, *selection.tried.values()])
    causes = [*(one.text for one in to_mend), *map(in_words, faults)]
    if after.cause and selection.more:
        causes.append(after.cause)
    return {
        "p_value": None if scored is None else min(scored.p_value, 1.0),
        "log_odds": most, "log_odds_left": after.log_odds, "share_left": after.share,
        "cause": "; ".join(causes),
        "cause_left": after.cause if selection.more else "", "sure": float(np.log(SURE)),
        "worse_than_claim": selection.worse,
        "minimum_detectable": {h.name: _detectable(h, question, selection) for h in question.hypotheses},
    }  # fmt: skip


def _detectable(h: Hypothesis, question: Question, selection: Selection) -> str:
    """Size from which the effect would have odds above `SURE`, by the probe that shows it best, with its unit.

    A size of r standard errors has the log odds r^2 / 2 - ln(prior's spread over the standard error), by Laplace.
    """
    if selection.score_tests is None:
        return "not looked for"
    scores = [s for s in selection.score_tests.scores if s.hypothesis is h and np.isfinite(s.visible)]
    if not scores:
        return "no size: the refit absorbs it"
    lead = next(iter(h.nulls))
    unit = question.units.get(lead, "")
    unit = "" if unit in ("", "1") else f" {unit}"
    bounds = next(p for p in h.free if p.name == lead)
    name = parameter_name(lead, h)
    count = len(question.hypotheses)
    if lead in h.inverse:
        value = max(_probed(s, lead) / _multiple(s, 1.0, count) for s in scores)
        return f"{name} below {value:.3g}{unit}" if value > bounds.low else "no size within its bounds"
    sizes = []
    for s in scores:
        probe = abs(_probed(s, lead) - h.nulls[lead])
        sizes.append(probe * _multiple(s, prior_width(bounds, probe) / max(probe, 1e-300), count))
    size = min(sizes)
    if size > max(abs(bounds.high - h.nulls[lead]), abs(bounds.low - h.nulls[lead])):
        return f"no size within its bounds; it would take {size:.3g}{unit}"
    return f"{size:.3g}{unit}"


def _multiple(score: Score, spread: float, count: int) -> float:
    """Multiple of a probe from which it is preferred; spread: of its prior, in probes; count: of hypotheses."""
    error = score.visible / _STANDS_OUT
    price = float(np.log(max(spread / error, 1.0)) + np.log(SURE) + np.log(count))
    return error * float(np.sqrt(2.0 * price))


def _probed(score: Score, row: str) -> float:
    return score.directions[0].get(row, score.hypothesis.nulls[row])


def _tried(question: Question, selection: Selection, verdict: str) -> tuple[dict[str, Any], ...]:
    """Every hypothesis: the log odds of the model with it, and what came of it."""
    taken = {a.hypothesis.name: a for a in selection.taken}
    first = selection.score_tests
    rows = []
    for h in question.hypotheses:
        score = first.best.get(h.name) if first else None
        like = first.class_of(h.name) if first is not None and score is not None and score.gain > 0.0 else ()
        turned = wrong_way(score, question.fit, 2.0 * np.log(SURE))
        rows.append({
            "name": h.name, "effect": h.canonical, "score": 0.5 * score.gain if score else 0.0,
            "log_odds": selection.tried.get(h.name), "absorbability_deg": score.absorbability if score else 0.0,
            "looks_like": list(like), "declared_confusable": list(h.confusable),
            "state": _state(h.name, taken, selection, verdict) + (TURNED if turned else ""), "equation": h.equation,
        })  # fmt: skip
    return tuple(sorted(rows, key=_order(taken)))


def _order(taken: Mapping[str, EffectGain]):
    """Accepted ones first, then by odds, then by score."""
    return lambda r: (r["name"] not in taken, -np.inf if r["log_odds"] is None else -r["log_odds"], -r["score"])


def wrong_way(score: Score | None, model: Model, least: float) -> bool:
    """Whether the data want an effect on the side of its null where it has no values; least: gain that says so."""
    if score is None:
        return False
    sizes = [n for n in score.directions[0] if n in score.hypothesis.nulls]
    if len(sizes) != 1 or sizes[0] in score.hypothesis.inverse or score.gain < least:
        return False
    row, null = next(p for p in model.parameters if p.name == sizes[0]), score.hypothesis.nulls[sizes[0]]
    return len(score.directions) == 1 and score.amount[0] < 0.0 and null in (row.low, row.high)


def _state(name: str, taken: Mapping[str, EffectGain], selection: Selection, verdict: str) -> str:
    if name in taken:
        return (
            "accepted"
            if verdict in NAMED or name.startswith(LOGGER)
            else "improves the fit, but does not explain what is left"
        )
    classes = [a.hypothesis.name for a in taken.values() if name in a.alternatives]
    if classes:
        return f"cannot be distinguished from {', '.join(classes)}"
    if name in selection.refused and not taken:
        return f"refused: {selection.refused[name]}"
    if name in selection.tried:
        return "refitted; another effect has more evidence" if taken else "refitted; the evidence is too small"
    return "not refitted; other effects have higher estimates"


def _leftovers(selection: Selection) -> list[dict[str, Any]]:
    """What is left of every kind, before and after, the surest first."""

    def rows(left: Left, when: str) -> list[dict[str, Any]]:
        return [{"when": when, **vars(kind)} for kind in left.kinds[:12]]

    before = rows(selection.before, "after the refit")
    return before if selection.before is selection.after else before + rows(selection.after, "after the model")
