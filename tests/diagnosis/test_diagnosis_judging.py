"""What decides an answer: probes near the size, noise stated or learnt anew, refusals, the start of a record."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from cable_envs.diagnosis.adequacy.tests import adequacy
from cable_envs.diagnosis.fit.likelihood import refit_and_learn, refit_nominals
from cable_envs.diagnosis.fit.refit import Start
from cable_envs.diagnosis.fit.score_tests import score_tests
from cable_envs.diagnosis.model.hypotheses import Hypothesis
from cable_envs.diagnosis.model.model import Block, Coordinate, Free
from cable_envs.diagnosis.report import answer
from cable_envs.diagnosis.search.rules import Rules
from cable_envs.diagnosis.search.select import select
from cable_envs.diagnosis.systems.common import LEFT, SETTLING, at_first
from tests.support.diagnosis_toy import HYPOTHESES, NOMINALS, PARAMETERS, Toy


class Root(Toy):
    """A toy with an effect whose force grows with the root of its size, nearly all of which the mass can hide."""

    def __init__(self, size, seed):
        self._size = size
        super().__init__({}, seed)
        self.parameters = (*PARAMETERS, Free("root", 0.0, 0.0, 1e3, 1.0))
        for block, seen in zip(self.blocks, self._extra(np.array([size])), strict=True):
            block.measured[:] += seen[:, 0]

    def _extra(self, root):
        return [np.sqrt(root) * (0.5 * a + 4.0 * y)[:, None] for _, y, _, a in self._motion]

    def predict(self, values):
        plain = super().predict(values)
        return [p + e for p, e in zip(plain, self._extra(values[-1]), strict=True)]


def _white(model):
    model.blocks = [replace(b, memory=0) for b in model.blocks]
    return model


class Swing:
    """sin(rate t): from a claim that is half a turn off by the end, the nearest minimum is another."""

    def __init__(self):
        t = 0.01 * np.arange(1500)
        seen = np.sin(5.5 * t) + np.random.default_rng(0).normal(0.0, 0.1, len(t))
        self.parameters = (Free("rate", 5.0, 0.1, 50.0, 5.0, std=0.4),)
        self.blocks = [Block("run", "angle", t, seen, np.ones(len(t), dtype=bool))]

    def predict(self, values):
        return [np.sin(values[0] * block.time[:, None]) for block in self.blocks]


def test_nominals_are_refitted_from_several_starts():
    model = Swing()
    near = refit_and_learn(model, [Start("as claimed", ("rate",), {})])
    best = refit_nominals(model, ("rate",))
    assert abs(near.fit.values["rate"] - 5.5) > 0.1
    assert best.fit.values["rate"] == pytest.approx(5.5, abs=5e-3)
    assert best.deviance < near.deviance - 100.0


def test_probes_go_nearer_to_the_size_and_along_what_hides_them():
    model = _white(Root(1.0, 1))
    null = refit_and_learn(model, [Start("", NOMINALS, {})])
    far = Hypothesis("root_effect", (model.parameters[-1],), (({"root": 300.0},),), nulls={"root": 0.0})
    found = score_tests(model, null, [far], np.random.default_rng(0))
    sizes = [s.directions[0]["root"] for s in found.scores]
    assert sizes[0] == 300.0 and min(abs(np.log(s)) for s in sizes) < np.log(3.0)
    nearest = min(found.scores, key=lambda s: abs(np.log(s.directions[0]["root"])))
    assert nearest.directions[0]["mass"] < null.fit.values["mass"]  # the mass had taken most of it
    assert 0.5 < nearest.amount[0] < 2.0
    truth = refit_and_learn(model, [Start("", (*NOMINALS, "root"), {"root": 1.0})])
    assert found.best["root_effect"].gain == pytest.approx(null.deviance - truth.deviance, rel=0.3)


def test_where_noise_is_stated_a_bias_is_no_memory_of_it():
    gains = []
    for treat in (lambda m: m, _white):
        found = select(
            treat(Toy({"bias": 0.2}, 3)), treat(Toy({"bias": 0.2}, 53, 1)), NOMINALS,
            [h for h in HYPOTHESES if h.name == "bias_effect"], np.random.default_rng(0),
        )  # fmt: skip
        gains.append(found.null.deviance - found.final.deviance)
    # 3000 samples at 0.2 / 0.3 of the noise, of which Coulomb's level with the direction's mean takes next to nothing
    assert gains[1] > 900.0 > gains[0]


def test_a_vibration_is_no_resonance_of_the_noise():
    vibrating = Toy({}, 5, colour=0.7, extra=lambda t, y, v: 0.25 * np.sin(2 * np.pi * 4.0 * t))
    left = adequacy(vibrating, refit_and_learn(vibrating, [Start("", NOMINALS, {})]))
    line = next(f for f in left.leftovers if f.coordinate == "frequency")
    assert left.p_value < 1e-3 and line.at[0] == pytest.approx(4.0, abs=0.1)
    quiet = [Toy({}, 60 + seed, colour=0.7) for seed in range(6)]
    clean = [adequacy(m, refit_and_learn(m, [Start("", NOMINALS, {})])).p_value for m in quiet]
    assert min(clean) > 1e-3


def test_rounding_at_rest_is_no_coordinate():
    """A speed that is measured less what is left is one number at rest but for rounding, which follows the noise."""
    model = Toy({}, 8, std=0.3)
    judged = refit_and_learn(model, [Start("", NOMINALS, {})])
    for k, (block, raw) in enumerate(zip(model.blocks, judged.raw, strict=True)):
        rest = np.sin(2 * np.pi * 0.3 * block.time) > -0.8
        speed = np.where(rest, (0.7 + raw) - raw, 0.7 + np.cos(block.time))
        model.blocks[k] = replace(block, along=(Coordinate("speed", "m/s", speed),))
    assert adequacy(model, judged).p_value > 1e-3


def test_a_refused_hypothesis_hides_no_other():
    """One that fits these records only gains most, and is refused by the held-out one; the true one is found then."""
    truth = {"stiffness": 9.0}
    fit, heldout = Toy(truth, 2), Toy(truth, 52, 1)
    special = np.random.default_rng(4).normal(0.0, 1.0, 1500)
    for model, sign in ((fit, 1.0), (heldout, -1.0)):
        model.parameters = (*PARAMETERS, Free("own", 0.0, -10.0, 10.0, 1.0))
        plain = model.predict
        model.predict = lambda v, plain=plain, sign=sign: [p + sign * v[-1] * special[:, None] for p in plain(v)]
    for block in fit.blocks:
        block.measured[:] += special
    for block in heldout.blocks:
        block.measured[:] += special
    own = Hypothesis("own_effect", (fit.parameters[-1],), (({"own": 1.0},),), nulls={"own": 0.0})
    found = select(fit, heldout, NOMINALS, [*HYPOTHESES, own], np.random.default_rng(0), rules=Rules(left=1e9))
    assert "held-out" in found.refused["own_effect"]
    assert [a.hypothesis.name for a in found.accepted][:1] == ["stiffness_effect"]


def test_a_record_counts_once_it_has_moved():
    time = 0.01 * np.arange(1000)
    position = np.where(time < 2.0, 0.0, 0.1 * np.sin(time - 2.0))
    early = at_first(time, position + 1e-4 * np.random.default_rng(0).standard_normal(1000))
    left = time[~early][0]
    assert left == pytest.approx(2.0 + LEFT * 2.0, abs=0.03) and not early[int(left / 0.01) + 1 :].any()
    assert time[~at_first(time, np.zeros(1000))][0] == pytest.approx(SETTLING, abs=0.02)


class Twice(Toy):
    """The toy with two sensors of its force, each with a coloured noise of its own; ``shared`` N: both see a wave."""

    def __init__(self, seed, shared=0.0):
        super().__init__({}, seed, colour=0.0, std=0.01, count=2700)
        rng, blocks = np.random.default_rng(seed), []
        for block in self.blocks:
            wave = shared * lfilter([1.0], [1.0, -0.98], rng.normal(0.0, np.sqrt(1.0 - 0.98**2), len(block.time)))
            for channel in ("force", "tension"):
                drive = rng.normal(0.0, 0.3 * np.sqrt(1.0 - 0.95**2), len(block.time))
                noise = lfilter([1.0], [1.0, -0.95], drive) + rng.normal(0.0, 0.1, len(block.time))
                blocks.append(replace(block, channel=channel, measured=block.measured + noise + wave, sensor=channel))
        self.blocks = blocks

    def predict(self, values):
        """As the protocol says."""
        return [p for p in super().predict(values) for _ in range(2)]


@pytest.mark.parametrize(("shared", "left"), [(0.0, False), (0.3, True)])
def test_noises_of_two_sensors_know_nothing_of_each_other(shared, left):
    """What both see is no noise, though each channel by itself is a fine autoregression."""
    p_values = []
    for seed in range(3):
        model = Twice(seed, shared)
        p_values.append(adequacy(model, refit_and_learn(model, [Start("", NOMINALS, {})])).p_value)
    if left:
        assert max(p_values) < Rules().hidden_p
        model.blocks = [replace(b, sensor="one") for b in model.blocks]  # a speed from the position's own encoder
        assert adequacy(model, refit_and_learn(model, [Start("", NOMINALS, {})])).p_value > Rules().hidden_p
    else:
        assert min(p_values) > Rules().hidden_p


def test_a_line_is_held_against_the_spectrum_about_it():
    """A vibration within the slope of a coloured noise."""

    def vibration(t, y, v):
        return 0.12 * np.sin(2.0 * np.pi * 2.3 * t)

    for extra, left in ((vibration, True), (None, False)):
        model = Toy({}, 9, colour=0.9, extra=extra, count=2700)
        found = adequacy(model, refit_and_learn(model, [Start("", NOMINALS, {})]))
        assert (found.p_value < 1e-6) is left
        if left:
            line = next(f for f in found.leftovers if f.coordinate == "frequency")
            assert line.at[0] == pytest.approx(2.3, abs=0.05)


def test_functions_are_held_against_other_times_where_a_colour_was_learnt():
    """1/f noise is no autoregression: slow functions gain in it what chi-square does not allow."""
    p_values = []
    for seed in range(6):
        model = Toy({}, seed, std=1e-3, count=2700)
        rng = np.random.default_rng(seed)
        f = np.fft.rfftfreq(2 * 2700)
        f[0] = np.inf
        for k, block in enumerate(model.blocks):
            slow = np.fft.irfft((rng.standard_normal(len(f)) + 1j * rng.standard_normal(len(f))) / np.sqrt(f))[:2700]
            motion = Coordinate("position", "m", model._motion[k][1])
            model.blocks[k] = replace(block, measured=block.measured + 0.3 * slow / slow.std(), along=(motion,))
        p_values.append(adequacy(model, refit_and_learn(model, [Start("", NOMINALS, {})])).p_value)
    assert min(p_values) > Rules().hidden_p


def test_an_effect_that_the_data_want_with_the_other_sign_is_said_to_be_so():
    """Its size is bounded by its null; a spring that pulls the other way has the shape that the residual has."""
    model = _white(Toy({"stiffness": 40.0}, 4))
    null = refit_and_learn(model, [Start("", NOMINALS, {})])
    turned = Hypothesis("turned", (Free("stiffness", 0.0, -1e5, 0.0, 100.0),), (({"stiffness": -10.0},),))
    turned = replace(turned, nulls={"stiffness": 0.0})
    model.parameters = tuple(replace(p, low=-1e5, high=0.0) if p.name == "stiffness" else p for p in PARAMETERS)
    score = score_tests(model, null, [turned], np.random.default_rng(0)).best["turned"]
    assert score.amount[0] < 0.0 and answer.wrong_way(score, model, Rules().gain)
    right = replace(score, amount=(1.0,))
    assert not answer.wrong_way(right, model, Rules().gain)
    assert not answer.wrong_way(score, model, 2.0 * score.gain)
