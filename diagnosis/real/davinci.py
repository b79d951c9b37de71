"""The da Vinci jaw: what the rigid, frictionless transmission lacks, found step by step, and ablations of it.

The records of one series (15: five loads at three frequencies) are split so that the judge sees unseen loads and an
unseen frequency: held out are 30 and 70 % load and everything at 0.3 Hz. Numbers are degrees and mN m, as published.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from cable_envs.diagnosis.data.recording import Record, Recording, load_recording
from cable_envs.diagnosis.engine import Examined, examine
from cable_envs.diagnosis.evidence.candidates import under_one_noise
from cable_envs.diagnosis.evidence.joint import Joint, sizes_of
from cable_envs.diagnosis.fit.likelihood import Judged, raw_residuals
from cable_envs.diagnosis.fit.refit import Fit, Start, refit
from cable_envs.diagnosis.fit.weights import reweighted_refit, rmse
from cable_envs.diagnosis.model.model import Model, residuals
from cable_envs.diagnosis.model.verdict import EffectGain
from cable_envs.diagnosis.real.finding import inside
from cable_envs.diagnosis.search.effects import Search
from cable_envs.diagnosis.search.selection import Found
from cable_envs.diagnosis.systems.transmission import models
from cable_envs.diagnosis.systems.transmission_effects import LIMITS, candidates

SERIES = "Tool_4_Maryland_L_4"
ABLATED = (
    "cable_elongation", "stiffness_hardening", "coulomb_friction", "load_dependent_friction", "presliding_hysteresis",
)  # fmt: skip
"""Taken out of the full model one at a time."""
LEVELS = ("coulomb_friction.level", "stribeck_friction.excess")
"""Friction that no load makes, by whichever law has been named."""
DEG, MNM = 180 / np.pi, 1e3
BINS = 12
Tell = Callable[[str], None]


def load(folder: Path | str, series: str | None = SERIES, heldout: Callable[[Record], bool] | None = None) -> Recording:
    """The records of a series (None: all) of an imported recording, split by ``heldout`` (default: `unseen`).

    Raises ConfigurationError where the folder holds no recording.
    """
    recording = load_recording(folder)
    chosen = [r for r in recording.records if series is None or r.conditions.get("series") == series]
    return split(replace(recording, records=tuple(chosen)), heldout or unseen)


def split(recording: Recording, heldout: Callable[[Record], bool]) -> Recording:
    """The recording with every record's use set anew."""
    records = tuple(replace(r, use="heldout" if heldout(r) else "fit") for r in recording.records)
    return replace(recording, records=records)


def load_of(record: Record) -> int:
    """Load of the brake, per cent."""
    return round(float(record.conditions["load_percent"]))


def unseen(record: Record) -> bool:
    """Held out for the selection: two of the loads, and one of the frequencies."""
    return load_of(record) in (30, 70) or round(float(record.conditions["frequency"]), 1) == 0.3


def diagnosed(recording: Recording, tell: Tell = lambda text: None) -> Examined:
    """`cablebench diagnose` from the rigid, frictionless transmission up."""
    return examine(recording, tell=tell)


def steps_table(model: Model, steps: Sequence[EffectGain]) -> list[dict[str, Any]]:
    """The steps of the search for a page: each accepted effect with what it bought on the held-out records."""
    rows, before = [], steps[0]
    for step in steps:
        now, was = in_units(step.heldout), in_units(before.heldout)
        values = {n: e.value for n, e in step.parameters.items()}
        rows.append({
            "effect": step.hypothesis.name, "class": list(step.alternatives), "log_odds": step.gain,
            "heldout_deg": now["deg"], "heldout_mnm": now["mnm"],
            "fit_deg": in_units(step.fit)["deg"], "fit_mnm": in_units(step.fit)["mnm"],
            "gain_deg": was["deg"] - now["deg"], "gain_mnm": was["mnm"] - now["mnm"],
            "located": located(model, {**{p.name: p.start for p in model.parameters}, **values}),
            "dropped": list(step.dropped), "parameters": values,
        })  # fmt: skip
        before = step
    return rows


def in_units(errors: Mapping[str, float]) -> dict[str, float]:
    """{"deg", "mnm"} of root mean squares by channel in SI."""
    return {"deg": DEG * errors["output_angle"], "mnm": MNM * errors["output_torque"]}


def located(model: Model, values: Mapping[str, float]) -> dict[str, dict[str, float]]:
    """Channel -> coordinate -> share of the residual's squares that it explains.

    "direction" by itself (the mean level with it); of others, what their means over `BINS` bins of equal counts in each
    direction of motion explain beyond it.
    """
    column = np.array([[values[p.name]] for p in model.parameters])
    left = [r[:, 0] for r in residuals(model.blocks, model.predict(column))]
    found: dict[str, dict[str, float]] = {}
    for channel in dict.fromkeys(b.channel for b in model.blocks):
        mine = [(b, r) for b, r in zip(model.blocks, left, strict=True) if b.channel == channel]
        residual = np.concatenate([r[b.good] for b, r in mine])
        names = [c.name for c in mine[0][0].along]
        along = {n: np.concatenate([b.along[k].values[b.good] for b, _ in mine]) for k, n in enumerate(names)}
        way = (along.pop("direction") > 0).astype(int)
        alone = _between(residual, way)
        shares = {"direction": alone}
        for name, place in along.items():
            edges = np.quantile(place, np.linspace(0, 1, BINS + 1)[1:-1])
            shares[name] = _between(residual, np.searchsorted(edges, place) + BINS * way) - alone
        found[channel] = dict(sorted(shares.items(), key=lambda item: -item[1]))
    return found


def _between(residual: np.ndarray, cells: np.ndarray) -> float:
    """Share of the squares that the means of the cells explain."""
    counts, sums = np.bincount(cells), np.bincount(cells, residual)
    return float(np.sum(sums[counts > 0] ** 2 / counts[counts > 0]) / np.sum(residual**2))


def parameters(fit: Fit, samples: float) -> dict[str, dict[str, Any]]:
    """Values of the free parameters with 95 % intervals (`evidence.marginal.Posterior`), units as in `LIMITS`.

    ``samples``: effective sample size of the held-out records, which the committed file calls "stretches".
    """
    return {
        name: {
            "value": fit.values[name], "ci95": list(fit.interval(name)), "stretches": samples,
            "unit": "rad" if name.startswith("zero.") else LIMITS[name].unit,
        }
        for name in fit.free
    }  # fmt: skip


def ablations(whole: Examined, tell: Tell = lambda text: None) -> list[dict[str, Any]]:
    """Each of `ABLATED` taken out of the full model, all else refitted, and the rest diagnosed.

    What is left is judged as that of a rig with effects, and refitted with the weights of the full model: a discrepancy
    is counted in what a model without any leaves.
    """
    fit, heldout, whole_steps = whole.question.fit, whole.question.heldout, whole.diagnosis.steps
    full, there = whole.selection.final.fit, inside(whole_steps)
    known = {h.name: h for h in candidates().asked}
    joint = Joint(fit, heldout)
    bare = sizes_of(joint.blocks, joint.raw(whole.selection.null.fit))
    (model,) = under_one_noise(fit, joint, [((), full)], 0, {}, bare)
    weights = model.frame.whitener
    rows = []
    for name in (n for n in ABLATED if n in there):
        gone = known[name].names
        if name == "cable_elongation":  # a spring that is not there cannot stiffen
            gone += known["stiffness_hardening"].names
        free = tuple(n for n in full.free if n not in gone)
        start = Start("", free, {**full.values, **{n: LIMITS[n].null for n in gone}})
        missing = [h for h in candidates().asked if not set(h.names) & set(free)]
        alone = refit(fit, weights, [start])[0]
        null = Judged(alone, tuple(raw_residuals(fit, alone)), weights, 0.0)
        found = Search(fit, heldout, (), missing, np.random.default_rng(0), without=bare, most=1).run(null)
        rows.append(_ablated(name, whole, alone, found))
        tell(f"without {name}: {rows[-1]['found'] or 'nothing'} ({rows[-1]['log_odds']:.1f})")
    return rows


def _ablated(name: str, whole: Examined, refitted: Fit, found: Found) -> dict[str, Any]:
    """A row of `ablations`: what was found in the place of ``name``."""
    question = whole.question
    best = found.best.effects[0] if found.best.effects else None
    alike = found.alternatives(best.name) if best else ()
    answer = (best.name, *alike) if best else ()
    return {
        "removed": name, "found": best.name if best else "", "class": list(alike),
        "right": bool(answer) and answer[0] == name, "in_class": name in answer,
        "log_odds": found.without[best.name] if best else 0.0, "experiment": best.experiment if best else "",
        "full": in_units(whole.diagnosis.steps[-1].heldout), "refit": in_units(rmse(question.heldout, refitted)),
        "augmented": in_units(rmse(question.heldout, found.best.fit)),
        "located": located(question.fit, refitted.values), "rivals": dict(found.rounds[0].odds),
        "refused": dict(found.rounds[0].bounded),
    }  # fmt: skip


def pitch(folder: Path | str, free: Sequence[str], values: dict[str, float]) -> list[dict[str, Any]]:
    """Each series of the wrist's pitch: as the full model predicts it, and with its friction refitted.

    Only the angle's zero is its own in the first: an incremental encoder's. With one session at each pitch, another
    friction may be the session's or the pitch's.
    """
    recording = load_recording(folder)
    names = dict.fromkeys(str(r.conditions["series"]) for r in recording.records)
    level = next((n for n in LEVELS if n in free), LEVELS[0])
    moved = (level, "load_dependent_friction.exponent", "torque_zero")
    rows = []
    for series in names:
        model, _ = models(load(folder, series, lambda record: False))
        zero = tuple(p.name for p in model.parameters if p.name.startswith("zero."))
        carried = {n: v for n, v in values.items() if n in free and not n.startswith("zero.")}
        as_is = reweighted_refit(model, Start("", zero, carried))[0]
        own = reweighted_refit(model, Start("", (*zero, *(n for n in moved if n in free)), as_is.values))[0]
        angles = [r.conditions.get("pitch") for r in recording.records if r.conditions["series"] == series]
        rows.append({
            "series": series, "pitch_deg": None if angles[0] is None else DEG * float(angles[0]),
            "carried": in_units(rmse(model, as_is)), "refitted": in_units(rmse(model, own)),
            "level_mnm": MNM * own.values[level],
            "exponent": own.values["load_dependent_friction.exponent"], "zero_mnm": MNM * own.values["torque_zero"],
        })  # fmt: skip
    return rows
