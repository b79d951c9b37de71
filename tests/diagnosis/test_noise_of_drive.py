"""The noise of a recorded position that drives the simulator: what it makes of a spring, and that it is no mismatch."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import savgol_coeffs, savgol_filter

from cable_envs.diagnosis.model.driven import (
    DENSITIES,
    Recorded,
    best_width,
    error_density,
    noise_of_samples,
    passed_on,
    with_input,
)
from cable_envs.diagnosis.model.model import Block
from cable_envs.diagnosis.model.noise import learn_noise

PERIOD, COUNT, NOISE, STIFFNESS, SENSOR = 0.01, 4000, 5e-6, 6e4, 0.1
TIME = PERIOD * np.arange(COUNT)
SLOW = 0.01 * np.sin(2.0 * np.pi * 0.1 * TIME)


class Spring:
    """A linear spring between the drive and the ground, beside a damper."""

    period = PERIOD

    def __init__(self, drives, damping=0.0):
        self._drives, self._damping = drives, damping
        good = np.ones(COUNT, dtype=bool)
        self.blocks = [Block(str(k), "force", TIME, d.values, good, "N") for k, d in enumerate(drives)]

    def driven_by(self):
        return self._drives

    def answers(self, values, errors, rates):
        return [values["stiffness"] * e + self._damping * r for e, r in zip(errors, rates, strict=True)]


def _drives(rng, motion=SLOW, records=3, width=11):
    return [Recorded("drive", motion + rng.normal(0.0, NOISE, COUNT), NOISE, width) for _ in range(records)]


def test_of_a_spring_it_is_the_smoothed_noise_times_the_stiffness():
    """The plain solution: lag by lag the filter's autocorrelation times the square of k s."""
    rng = np.random.default_rng(1)
    drives = _drives(rng)
    passed = passed_on(Spring(drives), {"stiffness": STIFFNESS}, error_density(drives, NOISE), rng)["force"]
    taps = savgol_coeffs(11, 3)
    theory = (STIFFNESS * NOISE) ** 2 * np.correlate(taps, taps, "full")[10:]
    assert passed[:11] == pytest.approx(theory, abs=0.06 * theory[0])
    assert np.abs(passed[11:]).max() < 0.1 * theory[0]


def test_of_a_damper_it_is_the_noise_of_the_speed():
    rng = np.random.default_rng(2)
    drives = _drives(rng)
    density = error_density(drives, NOISE)
    passed = passed_on(Spring(drives, damping=1.0), {"stiffness": 0.0}, density, rng)["force"]
    turns = np.pi * np.linspace(0.0, 1.0, DENSITIES) / PERIOD
    assert passed[0] == pytest.approx(float(np.mean(density * turns**2)), rel=0.1)


def test_what_a_right_spring_leaves_is_white_by_it_and_of_size_one():
    rng = np.random.default_rng(3)
    drives = _drives(rng)
    passed = passed_on(Spring(drives), {"stiffness": STIFFNESS}, error_density(drives, NOISE), rng)["force"]
    noise = with_input(SENSOR, passed)
    left = [
        STIFFNESS * (SLOW - d.smoothed(PERIOD)[0]) + rng.normal(0.0, SENSOR, COUNT) for d in _drives(rng, records=6)
    ]
    assert noise.sized(left).std == pytest.approx(1.0, abs=0.03)
    power = np.mean([np.abs(np.fft.rfft(noise.whiten(series))) ** 2 / COUNT for series in left], axis=0)
    for low, high in ((3, 100), (100, 400), (400, 800), (800, 2000)):
        assert power[low:high].mean() == pytest.approx(1.0, abs=0.12)
    assert np.std(left[0]) > 1.5 * SENSOR  # that it would not be so without


def test_what_smoothing_loses_of_a_fast_motion_is_in_the_error():
    """White motion of 3 s, of which smoothing takes away what it takes of the noise."""
    rng = np.random.default_rng(4)
    motion = SLOW + rng.normal(0.0, 3.0 * NOISE, COUNT)
    drives = [replace(d, noise=4.0 * NOISE) for d in _drives(rng, motion)]
    density = error_density(drives, NOISE)
    error = np.concatenate([d.smoothed(PERIOD)[0] - motion for d in drives])
    assert density.mean() == pytest.approx(np.var(error), rel=0.1)


def test_the_width_leaves_the_least_error():
    rng = np.random.default_rng(5)
    for frequency in (0.1, 3.0, 8.0):
        motion = 0.001 * np.sin(2.0 * np.pi * frequency * TIME)
        parts = [motion + rng.normal(0.0, NOISE, COUNT) for _ in range(2)]
        true = {w: np.std(savgol_filter(parts[0], w, 3) - motion) for w in (5, 7, 11, 21, 41)}
        width = best_width(parts, NOISE)
        assert np.std(savgol_filter(parts[0], width, 3) - motion) < 1.1 * min(true.values())


def test_a_sudden_start_does_not_count_and_noise_alone_does():
    rng = np.random.default_rng(6)
    motion = np.where(TIME > 20.0, 0.05 * (TIME - 20.0), 0.0)
    (still,), (start,) = _drives(rng, 0.0 * TIME, 1), _drives(rng, motion, 1)
    assert still.sudden().mean() < 0.02
    assert start.sudden()[1990:2012].all() and start.sudden().mean() < 0.04


def test_noise_is_stated_with_its_steps_or_seen():
    rng = np.random.default_rng(7)
    (drive,) = _drives(rng, records=1)
    assert noise_of_samples([drive.values], None) == pytest.approx(NOISE, rel=0.1)
    coarse = np.round(drive.values / 1e-4) * 1e-4
    assert noise_of_samples([coarse], NOISE) == pytest.approx(np.hypot(NOISE, 1e-4 / np.sqrt(12.0)))


def test_its_colour_would_be_taken_for_a_mismatch_by_white_noise():
    """Slow waves of the output have more power than white noise of the same size has."""
    rng = np.random.default_rng(8)
    drives = _drives(rng)
    passed = passed_on(Spring(drives), {"stiffness": STIFFNESS}, error_density(drives, NOISE), rng)["force"]
    coloured = with_input(SENSOR, passed)
    series = coloured.simulate(COUNT, rng)
    assert coloured.density(DENSITIES)[:200].mean() > 1.5 * np.var(series)
    assert learn_noise([series]).numbers > 0
