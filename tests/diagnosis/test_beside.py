"""A discrepancy that is found with the noise beside it, where noise that is learnt from all of it has taken it in."""

import numpy as np
import pytest

from cable_envs.diagnosis.evidence.beside import beside_noise
from cable_envs.diagnosis.evidence.marginal import Frame, Remainder
from cable_envs.diagnosis.model.features import families
from cable_envs.diagnosis.model.model import Block, Coordinate, learn_whitener
from cable_envs.diagnosis.model.noise import Noise

RECORDS, COUNT = 2, 2000
WHITE = Noise(np.empty(0), 1.0)
COLOURED = Noise(np.array([0.95]), 0.3)


def _records(noise, seed, height=0.0):
    """(blocks, what is left of each): noise, and what a place adds to it."""
    rng, blocks, left = np.random.default_rng(seed), [], []
    time = 0.01 * np.arange(COUNT)
    for k in range(RECORDS):
        place = np.sin(2.0 * np.pi * (0.2 + 0.03 * k) * time)
        along = (Coordinate("position", "m", place), Coordinate("direction", "1", np.gradient(place)))
        raw = noise.simulate(COUNT, rng) + height * np.where(np.abs(place) < 0.3, 1.0, -0.5)
        blocks.append(Block(f"record_{k}", "pull", time, raw, np.ones(COUNT, dtype=bool), "N", along))
        left.append(raw)
    return blocks, left


def _asked(blocks, left):
    zero = [np.zeros(COUNT)] * len(blocks)
    found = beside_noise(blocks, list(families(blocks, zero)), left, {"pull": float(np.std(left))}, ["pull"])
    return {k.coordinate: k for k in found}


@pytest.mark.parametrize("seed", [0, 1])
def test_what_a_place_adds_is_found_though_the_noise_of_all_that_is_left_has_it(seed):
    blocks, left = _records(WHITE, seed, height=0.6)
    sizes = {"pull": float(np.std(left))}
    kinds = list(families(blocks, [np.zeros(COUNT)] * RECORDS))
    frame = Frame(blocks, learn_whitener(blocks, left), kinds)
    rest = Remainder(white := frame.whitener.flat(blocks, left), 0.0, sizes, frame.products(white))
    place = next(k for k, f in enumerate(kinds) if f.name == "position")
    seen = max(frame.marginal(rest, scale, (place,)).log for scale in (0.01, 0.1, 1.0)) - frame.marginal(rest, 0.0).log
    found = _asked(blocks, left)["position"]
    assert found.log_odds > max(50.0, 2.0 * seen)
    assert np.interp(0.0, found.at, found.height) == pytest.approx(0.6, abs=0.25)
    assert np.interp(0.9, found.at, found.height) == pytest.approx(-0.3, abs=0.25)


@pytest.mark.parametrize("noise", [WHITE, COLOURED], ids=["white", "coloured"])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_nothing_is_found_beside_noise(noise, seed):
    assert max(k.log_odds for k in _asked(*_records(noise, seed)).values()) < 3.0


def test_only_channels_whose_noise_is_learnt_are_asked():
    blocks, left = _records(WHITE, 0)
    assert not list(beside_noise(blocks, list(families(blocks, left)), left, {"pull": 1.0}, []))
