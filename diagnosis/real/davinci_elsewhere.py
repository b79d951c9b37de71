"""Where each effect of the da Vinci's jaw holds: at other loads and speeds of its series, and in the other series."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from cable_envs.diagnosis.engine import Examined
from cable_envs.diagnosis.evidence.candidates import under_one_noise
from cable_envs.diagnosis.evidence.joint import Joint
from cable_envs.diagnosis.fit.likelihood import refit_nominals
from cable_envs.diagnosis.fit.refit import Start
from cable_envs.diagnosis.fit.weights import reweighted_refit
from cable_envs.diagnosis.real.davinci import load
from cable_envs.diagnosis.real.finding import inside
from cable_envs.diagnosis.search.elsewhere import Group, asked_elsewhere
from cable_envs.diagnosis.systems import prepare


def elsewhere(folder: Path | str, whole: Examined) -> list[dict[str, Any]]:
    """Every effect that was named on one series, asked on records that it was not fitted to.

    Parameters
    ----------
    folder : Path or str
        The imported data set, with all its series.
    whole : Examined
        The diagnosis of one series.

    Returns
    -------
    list of dict
        A row for each effect: log odds of the model with it over the one without it, both fitted to all other records,
        by group; "conditions" of its own series, and "series" with the model refitted to all of them.
    """
    own = {e.hypothesis.name: e for e in whole.diagnosis.effects}
    series = by_series(folder, whole)
    return [
        {"effect": name, "conditions": dict(e.elsewhere), "series": dict(series.get(name, {}))}
        for name, e in own.items()
    ]


def by_series(folder: Path | str, whole: Examined) -> Mapping[str, Mapping[str, float]]:
    """The model refitted to all series, and each effect asked on every series given the others."""
    recording = load(folder, None)
    question = prepare(recording)
    named = inside(whole.diagnosis.steps)
    effects = tuple(h for h in question.hypotheses if h.name in named)
    free = (*question.nominals, *(n for h in effects for n in h.names))
    carried = {n: v for n, v in whole.selection.final.fit.values.items() if n in free and not n.startswith("zero.")}
    fit, _ = reweighted_refit(question.fit, Start("", free, carried))
    joint = Joint(question.fit, question.heldout)
    sizes = joint.left_by(refit_nominals(question.fit, question.nominals).fit)
    (best,) = under_one_noise(question.fit, joint, [(effects, fit)], 0, {}, sizes)
    of: dict[str, set[str]] = {}
    for record in recording.records:
        of.setdefault(str(record.conditions["series"]), set()).add(record.name)
    groups = [Group(name, frozenset(records)) for name, records in of.items()]
    return asked_elsewhere(joint, best, groups, lambda asked: None)
