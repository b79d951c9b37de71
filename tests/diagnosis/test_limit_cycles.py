"""Oscillations without a phase: found by their spectrum, sized, left alone in a rig that has them, and not invented."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from cable_envs.diagnosis.data.clocks.even import sample_period
from cable_envs.diagnosis.data.recording import load_recording
from cable_envs.diagnosis.engine import examine
from cable_envs.diagnosis.evidence.bands import Averaged, Bands, Spectra
from cable_envs.diagnosis.fit.likelihood import refit_nominals
from cable_envs.diagnosis.model.hypotheses import Hypothesis
from cable_envs.diagnosis.model.model import Block, Free
from cable_envs.diagnosis.search import limit_cycles
from cable_envs.diagnosis.search.select import select
from cable_envs.diagnosis.systems.drive.loop import controller
from cable_envs.proof.cases import Case, make
from cablebench.pages import diagnosis_words as words
from cablebench.pages.diagnosis import render

STD, PERIOD, COUNT = 0.1, 0.01, 3000
SEED = 492877576
PARAMETERS = (
    Free("mass", 10.0, 1.0, 100.0, 10.0, std=1.0),
    Free("pitch", 0.3, 0.05, 0.9, 0.3, std=0.03),
    Free("gap", 0.0, 0.0, 10.0, 1.0),
    Free("lag", 0.0, -1.0, 1.0, 0.1),
)
GAP = Hypothesis("gap", (PARAMETERS[2],), (({"gap": 0.3},), ({"gap": 1.0},)), nulls={"gap": 0.0})
LAG = Hypothesis("lag", (PARAMETERS[3],), (({"lag": 0.1},),), nulls={"lag": 0.0})


class Oscillating:
    """Force of a known motion, and a resonance at ``pitch`` that a chaotic map drives: its start hangs on the mass."""

    parameters = PARAMETERS

    def __init__(self, truth, seed, extra=None):
        rng = np.random.default_rng(seed)
        t = PERIOD * np.arange(COUNT)
        self._motions = [
            np.sin(2 * np.pi * f * t) + 0.5 * np.sin(2 * np.pi * 3.1 * f * t) for f in rng.uniform(0.2, 0.5, 2)
        ]
        values = {p.name: p.start for p in PARAMETERS} | {"mass": 10.5} | truth
        clean = self.predict(np.array([[values[p.name]] for p in PARAMETERS]))
        self.blocks = [
            Block(f"run{k}", "force", t, c[:, 0] + rng.normal(0.0, STD, COUNT) + (extra(t) if extra else 0.0),
                  np.ones(COUNT, dtype=bool), "N")
            for k, c in enumerate(clean)
        ]  # fmt: skip

    def predict(self, values):
        """As the protocol says."""
        mass, pitch, gap, lag = values
        found = []
        for k, motion in enumerate(self._motions):
            x = 0.3 + 0.1 * k + 0.01 * np.sin(1e3 * mass)
            drive = np.empty((COUNT, len(mass)))
            for i in range(COUNT):
                x = 3.99 * x * (1.0 - x)
                drive[i] = x - 0.5
            cycle = np.empty_like(drive)
            for n in range(len(mass)):
                cycle[:, n] = lfilter([1.0], [1.0, -1.96 * np.cos(np.pi * pitch[n]), 0.96], drive[:, n])
            found.append(0.1 * mass * motion[:, None] + lag * np.gradient(motion)[:, None] / PERIOD + 0.1 * gap * cycle)
        return found


def _oscillations(model, held, seed=0):
    spectra, heldout = (Spectra(m, {"force": STD}) for m in (model, held))
    null = refit_nominals(model, ("mass", "pitch"))
    found = limit_cycles.search(spectra, heldout, null.fit, [GAP, LAG], np.random.default_rng(seed))
    return null, found


def test_a_limit_cycle_of_another_phase_is_found_by_its_spectrum():
    for seed, size in ((1, 1.0), (2, 0.5)):
        model, held = (Oscillating({"gap": size}, s) for s in (seed, seed + 100))
        null, found = _oscillations(model, held)
        assert [o.hypothesis.name for o in found] == ["gap"] and found[0].gain > 200.0 and found[0].heldout_gain > 100.0
        assert found[0].values["gap"] == pytest.approx(size, rel=0.12)
        assert found[0].values["gap"] == pytest.approx(size, abs=2.5 * found[0].errors["gap"])
        true = np.array([[10.7], [0.3], [size], [0.0]])  # of another phase: squares cannot see it
        left = [
            float(np.sum((b.measured - p[:, 0]) ** 2)) for b, p in zip(model.blocks, model.predict(true), strict=True)
        ]
        assert sum(left) > 1.2 * sum(float(r @ r) for r in null.raw)


def test_a_pitch_that_the_refit_cannot_know_is_found_along():
    model, held = (Oscillating({"gap": 1.0, "pitch": 0.34}, s) for s in (5, 105))
    _, found = _oscillations(model, held)
    assert found[0].values["pitch"] == pytest.approx(0.34, abs=0.005)


def test_neither_noise_nor_a_hum_is_a_limit_cycle():
    def hum(t):
        return 0.15 * np.sin(2 * np.pi * 7.3 * t)

    for extra in (None, hum):
        _, found = _oscillations(Oscillating({}, 3, extra), Oscillating({}, 103, extra))
        assert not [o for o in found if o.bands.excess < 0.22 * o.gain]
    null = Spectra(Oscillating({}, 3, hum), {"force": STD}).at({"mass": 10.5}, 6)
    assert null.p_value < 1e-9 and null.leftovers()[0].at[0] == pytest.approx(7.3, abs=0.3)


def test_noise_alone_has_the_power_that_is_expected():
    found = [Spectra(Oscillating({}, seed), {"force": STD}).at({"mass": 10.5}, 6) for seed in range(12)]
    assert all(b.expected_gain < 1.0 and b.over_noise == pytest.approx(1.0, abs=0.03) for b in found)
    assert np.mean([b.beyond.mean() for b in found]) == pytest.approx(1.0, abs=0.06)  # chi-square of one each
    assert min(b.p_value for b in found) > 1e-3


def test_the_cost_is_least_where_the_power_is_as_expected():
    rng = np.random.default_rng(0)
    true = np.r_[np.ones(20), 5.0 * np.ones(10)]
    left = true * rng.gamma(16.0, 1.0 / 16.0, 30)
    bands = [
        Bands(("force",) * 30, np.arange(30.0), np.full(30, 16.0), left, np.where(true > 1.0, v, 0.0))
        for v in (0.0, 2.0, 4.0, 8.0)
    ]
    assert min(bands, key=lambda b: b.cost) is bands[2]
    assert bands[2].cost - sum(bands[2].beyond) == pytest.approx(bands[0].cost - sum(bands[0].beyond))
    assert bands[2].without_spread.cost == pytest.approx(bands[0].cost)
    assert bands[0].expected_gain == 0.0 and bands[3].expected_gain > bands[1].expected_gain > 0.0
    joined = bands[2].coarse(10)
    assert joined.expected == pytest.approx([1.0, 1.0, 5.0]) and joined.left == pytest.approx(
        left.reshape(3, 10).mean(axis=1)
    )


def test_the_mean_of_runs_has_what_can_be_predicted():
    model = Oscillating({"gap": 1.0}, 4)
    values = np.array([[10.5], [0.3], [1.0], [0.0]])
    plain = model.predict(np.array([[10.5], [0.3], [0.0], [0.0]]))[0]
    one, mean = (m.predict(values)[0] - plain for m in (model, Averaged(model, 16)))
    assert mean[200:].std() == pytest.approx(one[200:].std() / 4.0, rel=0.35)


def test_a_doubt_about_what_only_delays_a_reading_hides_no_oscillation():
    """Of a corrected rig nothing else is in doubt; runs are apart only where the mechanism itself is nudged."""
    model = Oscillating({"gap": 1.0}, 1)
    read = replace(PARAMETERS[3], name="control.read", std=0.01)
    model.parameters = (*(replace(p, std=None) for p in PARAMETERS[:3]), read)
    assert Spectra(model, {"force": STD}).at({"gap": 1.0}, limit_cycles.RUNS).expected_gain > limit_cycles.GAIN


def test_a_limit_cycle_is_named_and_a_rig_that_has_it_is_left_alone():
    model, held = (Oscillating({"gap": 1.0}, s) for s in (1, 101))
    told = {"stated": {"force": STD}}
    found = select(model, held, ("mass", "pitch"), [GAP, LAG], np.random.default_rng(0), **told)
    assert found.verdict == "named" and found.accepted[0].hypothesis is GAP and found.bands is not None
    assert found.final.fit.interval("gap")[0] < 1.0 < found.final.fit.interval("gap")[1]
    for one in (model, held):
        one.parameters = tuple(replace(p, start=found.final.fit.values[p.name]) for p in PARAMETERS)
    again = select(model, held, ("mass", "pitch"), [LAG], np.random.default_rng(0), **told)
    assert again.verdict == "no_detectable_mismatch" and not again.accepted and again.bands.expected_gain > 40.0
    unknown = select(model, held, ("mass", "pitch"), [LAG], np.random.default_rng(0))  # noise that nobody knows
    assert unknown.bands is None


@pytest.fixture(scope="module")
def oscillating(tmp_path_factory):
    """A drive under control whose belt has a gap of 35 um: a limit cycle at 38 Hz."""
    folder = tmp_path_factory.mktemp("oscillating")
    return folder, make(
        Case("case-1", SEED, "linear_drive", "single", ("backlash",), ">10", "white"), folder / "recording"
    )


@pytest.fixture(scope="module")
def examined(oscillating):
    return examine(oscillating[0] / "recording", effects=["backlash", "actuator_lag", "stribeck_friction"])


@pytest.mark.slow
def test_a_gap_with_a_limit_cycle_is_named(oscillating, examined):
    key = oscillating[1]
    (effect,) = examined.diagnosis.effects
    true = key["effects"][0]["changes"]["backlash.gap"]
    assert effect.name == "backlash" and effect.gain > 1000.0 and effect.heldout_gain > 0.0
    gap = effect.parameters["gap"]
    assert gap.low < true < gap.high and gap.high - gap.low < 0.6 * true
    record = examined.diagnosis.as_json()
    assert "oscillates by itself" in words.cost(record)
    assert any("with a phase that cannot be predicted" in note for note in record["notes"])
    assert "Its spectrum" in render(record, examined.diagnosis.traces)
    held = record["fit"]["force"]["heldout_rmse"]
    assert held["augmented"] < 1.15 * held["refit"]  # not the phase's error twice


@pytest.mark.slow
def test_the_rig_with_the_gap_leaves_nothing_to_find(oscillating, examined):
    folder = oscillating[0]
    examined.diagnosis.write(folder / "out")
    again = examine(
        folder / "recording", rig=folder / "out" / "augmented.yaml", effects=["actuator_lag", "stribeck_friction"]
    )
    assert again.diagnosis.verdict == "no_detectable_mismatch" and again.diagnosis.spectra
    assert "oscillates by itself" in words.headline(again.diagnosis.as_json())


def test_the_controller_is_found_under_noise(oscillating):
    recording = load_recording(oscillating[0] / "recording")
    gains, left = controller(recording, sample_period(recording.records))
    mass = oscillating[1]["true_nominal"]["mass"]
    assert gains["control.kv"] == pytest.approx(gains["control.kd"], rel=0.02)
    assert 25.0 * 1.4 * mass < gains["control.kd"] < 45.0 * 1.4 * mass * 1.5 and left < 1.6


@pytest.mark.parametrize(("turns", "by_itself"), [(0.0, False), (1e6, True)])
def test_runs_that_are_apart_in_proportion_to_a_parameter_do_not_oscillate(turns, by_itself):
    """A long way that is measured well, and an oscillation whose phase the least change of a parameter decides."""

    class Way:
        parameters = (Free("a", 1.0, 0.0, 2.0, 1.0, 0.1),)
        time = np.arange(800) * 0.01
        blocks = (Block("one", "position", time, 10.0 * time, np.ones(800, dtype=bool), "m", sensor="position"),)

        def predict(self, values):
            phase = turns * values[0] + 30.0 * self.time[:, None]
            return [10.0 * self.time[:, None] * values[0] + (turns > 0.0) * np.sin(phase)]

    spectra = Spectra(Way(), {"position": 1e-4})
    assert spectra.at({}, limit_cycles.RUNS).expected_gain >= limit_cycles.GAIN  # the runs are apart in both
    assert limit_cycles.oscillates(spectra) is by_itself
