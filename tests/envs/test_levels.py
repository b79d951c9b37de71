"""What lasts for a whole record, and what lasts for one sample: neither may pass for the other's noise."""

import numpy as np
import pytest
from scipy.signal import lfilter

from cable_envs.diagnosis.asked import ask, request_of
from cable_envs.diagnosis.data.recording import load_recording
from cable_envs.diagnosis.model.noise import LONG, Noise, learn_noise
from cable_envs.diagnosis.search.select import select
from cable_envs.diagnosis.systems.drive.loop import EXPLAINED, controller
from tests.support import drive_recording as drive
from tests.support.diagnosis_toy import HYPOTHESES, NOMINALS, Toy


def _sensor(rng, count=2500):
    """Half white, half with a memory of 20 samples; standard deviation 1."""
    slow = lfilter([1.0], [1.0, -0.95], rng.normal(0.0, np.sqrt(0.5 * (1.0 - 0.95**2)), count + 500))[500:]
    return slow + rng.normal(0.0, np.sqrt(0.5), count)


def test_whitening_is_the_autoregression_of_every_lag():
    noise = Noise(np.array([0.4, 0.2]), 0.7, 4, np.array([0.2, 0.1]))
    assert noise.order == LONG[1] and len(noise.coefficients) == LONG[1]
    series = np.random.default_rng(0).normal(size=(300, 2)).cumsum(axis=0)
    plain = lfilter(np.r_[1.0, -noise.coefficients], [1.0], series, axis=0) / noise.std
    np.testing.assert_allclose(noise.whiten(series)[noise.order :], plain[noise.order :], rtol=1e-9, atol=1e-9)
    assert not noise.whiten(series)[: noise.order].any()
    np.testing.assert_array_equal(noise.whiten(series[:, 0]), noise.whiten(series)[:, 0])


def test_a_level_is_held_against_the_slowest_waves():
    biased = learn_noise([_sensor(np.random.default_rng(k)) + 1.5 for k in range(2)])
    assert biased.mean_deviance > 60.0 and biased.lift > 0.0
    # the means of two records, whose noise has a density of 0.5 + 0.5 * 1.95 / 0.05 at frequency 0: no one sees more
    assert biased.mean_deviance < 2.0 * 2500 * 1.5**2 / 20.0
    quiet = [learn_noise([_sensor(np.random.default_rng([k, j])) for j in range(2)]).mean_deviance for k in range(60)]
    assert max(quiet) < 15.0  # half of what a hypothesis must gain where no noise is stated


def test_a_bias_in_coloured_noise_is_named_and_no_noise_is():
    biased = Toy({"bias": 0.9}, 3, colour=0.9, count=2500), Toy({"bias": 0.9}, 53, 1, colour=0.9, count=2500)
    found = select(*biased, NOMINALS, HYPOTHESES, np.random.default_rng(0))
    assert {found.accepted[0].hypothesis.name, *found.accepted[0].alternatives} >= {"bias_effect"}
    assert found.accepted[0].gain > 20.0
    right = Toy({}, 3, colour=0.9, count=2500), Toy({}, 53, 1, colour=0.9, count=2500)
    assert select(*right, NOMINALS, HYPOTHESES, np.random.default_rng(0)).verdict == "no_detectable_mismatch"


@pytest.fixture(scope="module")
def coloured(tmp_path_factory):
    """A drive's recording with nothing wrong, its position in slow noise that no one states."""

    def slow(k, table):
        table[:, 2] += 2e-4 * _sensor(np.random.default_rng([k, 9]), len(table))
        return table

    return drive.write(tmp_path_factory.mktemp("coloured"), change=slow)


def test_a_loop_is_replayed_in_slow_noise(coloured):
    recording = load_recording(coloured)
    left = controller(recording, 0.01)[1]
    assert 1.2 < left < EXPLAINED  # the jitter between samples is the smaller part of such noise
    assert ask(recording, request_of(recording)).fit.closed


def test_a_belt_that_may_be_missing_has_its_damping_free(coloured):
    text = (coloured / "recording.yaml").read_text()
    known = "  motor_mass: {value: 0.6, unit: kg}\n  belt_stiffness: {value: 0.0, unit: N/m}\n"
    for extra, freed in (("", True), ("  belt_damping: {value: 40.0, unit: N s/m}\n", False)):
        (coloured / "recording.yaml").write_text(text.replace("known:\n", f"known:\n{known}{extra}"))
        recording = load_recording(coloured)
        belt = next(h for h in ask(recording, request_of(recording)).hypotheses if h.name == "cable_elongation")
        assert ("belt_damping" in belt.names) is freed and set(belt.nulls) == {"belt_stiffness"}
        if freed:  # a fifth of critical, of both masses against each other
            reduced = 2.3 * 0.6 / 2.9
            for (probe,) in belt.probes:
                assert probe["belt_damping"] == pytest.approx(0.4 * np.sqrt(probe["belt_stiffness"] * reduced))
    (coloured / "recording.yaml").write_text(text)
