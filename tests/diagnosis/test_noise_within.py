"""How large a coloured noise is within one record: far smaller than over all time where it wanders."""

import numpy as np
import pytest

from cable_envs.diagnosis.model.noise import Noise


def exactly(keep, count):
    """Of e(t) = keep e(t - 1) + w(t), by its covariance."""
    lags = np.arange(1, count)
    shared = keep ** np.arange(count) / (1.0 - keep**2)
    mean = (shared[0] + 2.0 * np.sum((1.0 - lags / count) * shared[1:])) / count
    return np.sqrt(shared[0] - mean)


@pytest.mark.parametrize("count", [200, 2000])
@pytest.mark.parametrize("keep", [0.0, 0.9, 0.999, 0.99999])
def test_it_is_what_samples_have_about_their_own_mean(keep, count):
    assert Noise(np.array([keep]), 1.0).within(count) == pytest.approx(exactly(keep, count), rel=5e-3)


def test_white_noise_is_as_large_as_over_all_time_and_a_walk_grows_with_the_record():
    white, walk = Noise(np.empty(0), 0.3), Noise(np.array([1.0]), 0.3)
    assert white.within(3000) == pytest.approx(white.floor, rel=1e-3)
    assert walk.within(4000) == pytest.approx(0.3 * np.sqrt(4000 / 6), rel=0.01)  # a walk about its mean
    assert walk.floor > 10.0
