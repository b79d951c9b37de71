"""Functions of the motion on what is left: channels together, single places, what drifts, a channel's own noise."""

from dataclasses import replace
from itertools import product
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lfilter, savgol_filter

from cable_envs.diagnosis.adequacy.functions import Regression
from cable_envs.diagnosis.adequacy.spectra import coherences
from cable_envs.diagnosis.adequacy.tests import adequacy
from cable_envs.diagnosis.fit.confidence import interval
from cable_envs.diagnosis.fit.likelihood import refit_and_learn
from cable_envs.diagnosis.fit.refit import Fit, Start
from cable_envs.diagnosis.model.leftover import ALL
from cable_envs.diagnosis.model.model import Block, Coordinate, learn_whitener
from cable_envs.diagnosis.model.rest import noise_at_rest
from cable_envs.diagnosis.report.answer import _unfitted
from cable_envs.diagnosis.search.objections import BEYOND_DOUBT, objection
from cable_envs.diagnosis.search.rules import Rules
from cable_envs.diagnosis.search.select import select
from cable_envs.effects import EFFECTS
from tests.support.diagnosis_toy import HYPOTHESES, NOMINALS, PARAMETERS, Toy


def _coloured(rng, count, std, memory=0.9):
    return lfilter([1.0], [1.0, -memory], rng.normal(0.0, std * np.sqrt(1.0 - memory**2), count))


class Sensors(Toy):
    """The toy's force as ``count`` sensors see it, each in coloured noise of its own; ``seen(t, y, v)`` is in all."""

    def __init__(self, seed, seen=None, sensors=3, shared=False):
        super().__init__({}, seed, std=1e-3, count=2400)
        rng, blocks = np.random.default_rng([seed, 5]), []
        self._sensors = sensors
        for block, (t, y, v, _) in zip(self.blocks, self._motion, strict=True):
            along = tuple(
                Coordinate(name, unit, values)
                for name, unit, values in (("position", "m", y), ("direction", "1", np.sign(v)), ("speed", "m/s", v))
            )
            noise = _coloured(rng, len(t), 0.3)
            for k in range(sensors):
                own = noise if shared else _coloured(rng, len(t), 0.3)
                measured = block.measured + own + rng.normal(0.0, 0.1, len(t))
                measured = measured if seen is None else measured + seen(t, y, v)
                blocks.append(replace(block, channel=f"force_{k}", measured=measured, along=along, sensor=""))
        self.blocks = blocks

    def predict(self, values):
        """As the protocol says."""
        return [p for p in super().predict(values) for _ in range(self._sensors)]


def _refitted(model):
    return refit_and_learn(model, [Start("", NOMINALS, {})])


def _pawl(t, y, v):
    """Half a newton within a few per cent of the travel, on the way up only."""
    return 0.3 * np.exp(-(((y - 0.02) / 0.004) ** 2)) * (v > 0)


def test_a_pawl_that_no_channel_shows_by_itself_is_found_in_all_together():
    model = Sensors(2, _pawl)
    found = adequacy(model, _refitted(model))
    best = found.leftovers[0]
    assert found.p_value < Rules().hidden_p
    assert (best.channel, best.coordinate) == (ALL, "one place of the position")
    assert best.at[0] == pytest.approx(0.02, abs=0.006)
    alone = min(f.p_value for f in found.leftovers if f.channel != ALL)
    assert best.p_value < 1e-3 * alone


@pytest.mark.parametrize("shared", [pytest.param(False, marks=pytest.mark.slow), True])
def test_channels_of_one_noise_are_not_taken_together(shared):
    for seed in range(4):
        model = Sensors(seed, shared=shared)
        judged = _refitted(model)
        assert len(Regression(model.blocks, judged).apart) == (1 if shared else 3)
        assert adequacy(model, judged).p_value > Rules().hidden_p


@pytest.mark.parametrize("memory", [0.0, 0.9, 0.99])
def test_coherence_of_independent_channels_is_as_rare_as_it_says(memory):
    p_values, gains = [], []
    for seed in range(80):
        rng, blocks = np.random.default_rng(seed), []
        t = 0.01 * np.arange(2000)
        for record, channel in product(("one", "two"), "abc"):
            noise = lfilter([1.0], [1.0, -memory], rng.normal(size=len(t)))
            blocks.append(Block(record, channel, t, noise, np.ones(len(t), dtype=bool), sensor=channel))
        raw = [b.measured for b in blocks]
        found = coherences(blocks, learn_whitener(blocks, raw).flat(blocks, raw))
        gains += [f.gain / f.functions for f in found if f.coordinate == "frequency"]
        p_values += [f.p_value for f in found if f.channel == ALL]
    assert np.mean(gains) == pytest.approx(1.0, abs=0.05)
    assert np.mean(np.array(p_values) < 0.05) < 0.1 and min(p_values) > 1e-4


def test_a_drag_that_drifts_is_left_over():
    """Grease warms up: 6 % of the drag, up and down, in noise whose colour hides what is slow."""

    def warm(t, y, v):
        return 0.06 * 20.0 * v * np.cos(np.pi * t / t[-1])

    least = {}
    for seen in (warm, None):
        model = Sensors(3, seen, sensors=1)
        found = adequacy(model, _refitted(model)).leftovers
        least[seen] = min(f.p_value for f in found if f.coordinate.endswith("with elapsed time"))
    assert least[warm] < 1e-5 and least[None] > 1e-2


def test_what_only_the_held_out_records_show_is_left_over():
    model = Toy({}, 6, std=0.3)
    quiet, pushed = (Toy({}, 7, records=1, std=0.3, extra=extra) for extra in (None, lambda t, y, v: 2.0 * np.abs(v)))
    judged = _refitted(model)
    alone, with_quiet, with_pushed = (adequacy(model, judged, None, other) for other in (None, quiet, pushed))
    assert alone.p_value > 1e-2 and with_quiet.p_value > 1e-2
    assert with_pushed.p_value < 1e-6
    assert {f.coordinate for f in with_quiet.leftovers} >= {"elapsed time of run0", "elapsed time of run0, held out"}


@pytest.mark.parametrize(("rest", "p_value", "notes"), [(True, 1e-9, 1), (True, 0.5, 0), (False, 1e-9, 0)])
def test_a_note_says_so_where_only_held_out_records_show_it(rest, p_value, notes):
    """Not where nothing is left (a drift that is too small is unknown, too), nor where they were not asked."""
    model, heldout = Toy({}, 6, std=0.3), Toy({}, 7, records=1, std=0.3)
    known = noise_at_rest(np.random.default_rng(0).normal(0.0, 0.3, 3000)) if rest else None
    model.blocks = [replace(b, noise=known) for b in model.blocks]
    heldout.blocks = [replace(b, record="run9", noise=known) for b in heldout.blocks]
    found = SimpleNamespace(
        verdict="unknown", accepted=(), null=_refitted(model), after=SimpleNamespace(p_value=p_value),
        rules=Rules(alone_p=1e-3),
    )  # fmt: skip
    said = _unfitted(SimpleNamespace(noise={}), SimpleNamespace(fit=model, heldout=heldout), found)
    assert len(said) == notes and all("only the held-out record run9 shows it" in text for text in said)


def test_what_the_parameters_are_unsure_of_is_not_left_over_in_held_out_records():
    """One slow record tells little of the drag: on fast ones its error is no mismatch."""
    p_values = []
    for seed in range(6):
        model, heldout = Toy({}, seed, records=1, count=600), Toy({}, 50 + seed, records=2)
        for block, (_, y, v, a) in zip(model.blocks, model._motion, strict=True):
            for slow in (y, v, a):
                slow *= 0.2
            block.measured[:] = model.predict(_truth())[0][:, 0] + np.random.default_rng(seed).normal(0.0, 0.3, 600)
        judged = _refitted(model)
        sure = replace(judged, fit=replace(judged.fit, free=(), jacobian=judged.fit.jacobian[:, :0]))
        p_values.append([adequacy(model, j, None, heldout).p_value for j in (judged, sure)])
    least = np.min(p_values, axis=0)
    assert least[0] > 1e-2 and least[1] < 1e-20


def _truth():
    values = {"mass": 11.0, "viscous": 20.0, "coulomb": 5.0}
    return np.array([[values.get(p.name, p.start)] for p in PARAMETERS])


def test_a_weak_channel_is_not_held_against_its_own_noise():
    """A torque that is all noise, smoothed, is no coordinate for that torque: its prediction is."""
    p_values = {}
    for channel in ("", "force"):
        model = Toy({}, 4, std=20.0)
        for k, block in enumerate(model.blocks):
            own = Coordinate("torque", "N", savgol_filter(block.measured, 11, 3), channel)
            model.blocks[k] = replace(block, along=(own,))
        p_values[channel] = adequacy(model, _refitted(model)).p_value
    assert p_values[""] < 1e-6 and p_values["force"] > Rules().hidden_p


@pytest.mark.parametrize(("drift", "verdict"), [(0.25, "unknown"), (0.9, "named")])
def test_a_small_drift_is_unknown_and_a_large_one_named(drift, verdict):
    """What changes with the elapsed time alone looks like all else that does, unless it is sure."""
    declared = replace(EFFECTS["friction_drift"], name="drift_effect")
    hypotheses = [replace(h, effect=declared) if h.name == "drift_effect" else h for h in HYPOTHESES]
    truth = {"drift": drift}
    fit, heldout = (Toy(truth, seed, records, std=2.5) for seed, records in ((5, 2), (55, 1)))
    found = select(fit, heldout, NOMINALS, hypotheses, np.random.default_rng(0))
    gained = max(c.gain for comparison in found.tried for c in comparison if c.hypothesis.name == "drift_effect")
    assert found.verdict == verdict
    assert (Rules().coloured < gained < Rules().drifts) is (verdict == "unknown")
    if verdict == "unknown":
        assert "drifts with the elapsed time" in found.refused["drift_effect"]
    else:
        assert [a.hypothesis.name for a in found.accepted] == ["drift_effect"]


def test_a_sure_gain_counts_for_more_than_the_interval_of_a_slope():
    drift = next(h for h in HYPOTHESES if h.name == "drift_effect")
    one = np.ones(1)
    fit = Fit("", ("drift",), {"drift": 0.1}, 0.0, one, one[:, None], np.array([[0.1**2]]), (), 1)
    assert "holds the null" in objection(drift, fit, 0.0, BEYOND_DOUBT)
    assert objection(drift, fit, 0.0, BEYOND_DOUBT + 1.0) == ""
    low, high = interval(fit, "drift", 0.0)
    assert low < 0.0 < high
    low, high = interval(fit, "drift", 0.0, 144.0)  # 12 standard deviations from its null
    assert low == pytest.approx(0.1 - 1.96 * np.hypot(1.4 * 0.1 / 12.0, 0.04 * 0.1)) and high > 0.1 > low
