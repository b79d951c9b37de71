"""One law of a late sensor: for a sample in a kernel and for a whole record, to the bit; whole delays shift."""

import numpy as np
import pytest

from cable_envs.effects.sensor_delay import between, delayed, seen_at


@pytest.mark.parametrize("late", [0.0, 0.3, 1.0, 2.7, 40.0])
def test_a_record_and_its_samples_agree_to_the_bit(late):
    series = np.random.default_rng(1).normal(size=30)
    found = []
    for step in range(len(series)):
        before, part = seen_at(float(step), late)
        found.append(between(series[before], series[min(before + 1, len(series) - 1)], part))
    assert np.array_equal(delayed(series, late), found)


def test_whole_delays_shift_and_hold_the_first_sample():
    series = np.random.default_rng(2).normal(size=(12, 2))
    shown = delayed(series, np.array([0.0, 3.0]))
    assert np.array_equal(shown[:, 0], series[:, 0])
    assert np.array_equal(shown[3:, 1], series[:-3, 1])
    assert np.all(shown[:3, 1] == series[0, 1])


def test_a_force_that_is_seen_late_looks_like_viscous_friction_at_one_frequency():
    """F = m a of a sine, seen d late, is m cos(w d) a + m w sin(w d) v; two frequencies leave a rest."""
    t, mass, late = np.linspace(0.0, 20.0, 20001), 2.0, 0.01

    def fitted(*frequencies):
        rates = np.array(frequencies)[:, None]
        speed, acceleration = (rates * np.cos(rates * t)).sum(0), (-(rates**2) * np.sin(rates * t)).sum(0)
        force = mass * (-(rates**2) * np.sin(rates * (t - late))).sum(0)
        shapes = np.column_stack([acceleration, speed])
        numbers, (rest,), *_ = np.linalg.lstsq(shapes, force, rcond=None)
        return numbers, np.sqrt(rest / np.sum(force**2))

    (seen, viscous), rest = fitted(5.0)
    assert rest < 1e-9 and seen == pytest.approx(mass * np.cos(5.0 * late))
    assert viscous == pytest.approx(mass * 5.0 * np.sin(5.0 * late))
    assert fitted(5.0, 20.0)[1] > 0.02
