"""Constants of records under the noise of their channels."""

from types import SimpleNamespace

import numpy as np

from cable_envs.diagnosis.model.constants import constants_of, with_constants
from cable_envs.diagnosis.model.model import Block, Whitener
from cable_envs.diagnosis.model.noise import Noise

COUNT = 400


def _two_places():
    """Two records of two places that begin together, of which the first one's noise is slow."""
    time = 0.01 * np.arange(COUNT)
    blocks = [
        Block(record, channel, time, np.zeros(COUNT), np.ones(COUNT, dtype=bool))
        for record in ("one", "two")
        for channel in ("a", "b")
    ]
    together = np.ones((COUNT, 2, 1))
    return blocks, [(together, np.zeros((1, 1)))] * 2


def test_a_level_of_a_slow_sensor_is_not_believed_as_white_noise_has_it():
    blocks, constants = _two_places()
    keep = 0.98
    whitener = Whitener({"a": Noise(np.array([keep]), 1.0), "b": Noise(np.empty(0), 1.0)})
    levels = [np.full(COUNT, level) for level in (0.0, 0.5, 0.0, -0.3)]  # of b, off by what a's level was believed
    left = whitener.flat(blocks, levels)
    found = with_constants(blocks, constants, whitener, left)
    weight = (COUNT - 1) * (1.0 - keep) ** 2  # of a's level; that of b is COUNT
    rows = [slice(k * COUNT, (k + 1) * COUNT) for k in range(4)]
    for k, level in ((0, 0.5), (2, -0.3)):
        moved = level * COUNT / (COUNT + weight)
        assert np.allclose(found[rows[k + 1]], level - moved)
        assert np.allclose(found[rows[k]][1:], -moved * (1.0 - keep))
    assert found @ found < 1e-3 * (left @ left)


def test_what_is_known_beforehand_of_a_constant_counts():
    blocks, constants = _two_places()
    whitener = Whitener({c: Noise(np.empty(0), 1.0) for c in ("a", "b")})
    left = np.ones(4 * COUNT)
    known = [(changes, np.full((1, 1), 2.0 * COUNT)) for changes, _ in constants]  # as much as the record tells
    assert np.allclose(with_constants(blocks, known, whitener, left), 0.5)
    assert np.allclose(with_constants(blocks, constants, whitener, left), 0.0)


def test_a_model_without_constants_has_none():
    assert constants_of(SimpleNamespace()) == []
    blocks, _ = _two_places()
    left = np.arange(4.0 * COUNT)
    none = [(np.empty((COUNT, 2, 0)), np.zeros((0, 0)))] * 2
    assert np.array_equal(with_constants(blocks, none, Whitener(), left), left)
