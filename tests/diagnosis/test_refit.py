"""Refits end where another optimiser does, with the slopes that are there."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from cable_envs.diagnosis.fit.refit import SETTLED, STEP, Start, look, refit
from cable_envs.diagnosis.model.model import Block, Free, Whitener
from cable_envs.diagnosis.model.noise import Noise

STD = 0.02
WHITE = Whitener({"y": Noise(np.empty(0), STD)})


class Counted:
    """A model of functions of parameters [samples, n] that counts the columns it is asked for."""

    def __init__(self, parameters, predicted, measured):
        self.parameters, self._predicted, self.columns = parameters, predicted, 0
        t = 0.02 * np.arange(len(measured))
        self.blocks = [Block("one", "y", t, measured, np.ones(len(t), dtype=bool))]

    def predict(self, values):
        """As `cable_envs.diagnosis.model.model.Model`."""
        self.columns += values.shape[1]
        return [self._predicted(values)]


WAVES = 10
RINGING = (
    Free("height", 1.0, 0.1, 9.0, 0.5), Free("decay", 0.1, 0.0, 9.0, 0.5), Free("rate", 3.0, 0.1, 9.0, 0.5),
    *(Free(f"wave_{k}", 0.0, -5.0, 5.0, 0.5) for k in range(WAVES)),
)  # fmt: skip
TRUE = np.array([1.3, 0.3, 3.15, *0.1 * np.cos(np.arange(WAVES))])
NAMES = tuple(p.name for p in RINGING)


def ringing(values):
    t = 0.02 * np.arange(400)[:, None]
    height, decay, rate = values[:3]
    waves = np.cos(0.7 * np.arange(WAVES) * t) @ values[3:]
    return height * np.exp(-decay * t) * np.cos(rate * t) + waves


def rings():
    noise = STD * np.random.default_rng(3).normal(size=400)
    return Counted(RINGING, ringing, ringing(TRUE[:, None])[:, 0] + noise)


def test_a_refit_ends_where_another_optimiser_does():
    model = rings()
    fit = refit(model, WHITE, [Start("", NAMES, {})], central=False)[0]
    measured = model.blocks[0].measured
    other = least_squares(
        lambda v: (measured - ringing(v[:, None])[:, 0]) / STD, [p.start for p in RINGING], xtol=1e-12
    )
    assert fit.cost - 2.0 * other.cost < SETTLED
    found = np.array([fit.values[name] for name in NAMES])
    assert np.all(np.abs(found - other.x) < 0.3 * np.sqrt(np.diag(fit.covariance)))


@pytest.mark.parametrize("central", [False, True])
def test_the_slopes_of_a_result_are_those_where_it_is(central):
    fit = refit(rings(), WHITE, [Start("", NAMES, {})], central=central)[0]
    values = np.array([fit.values[name] for name in NAMES])
    for k, p in enumerate(RINGING):
        ends = [values.copy(), values.copy()]
        step = STEP * max(abs(values[k]), p.scale)
        ends[0][k], ends[1][k] = values[k] - (step if central else 0.0), values[k] + step
        low, high = (ringing(end[:, None])[:, 0] for end in ends)
        slope = (high - low) / (ends[1][k] - ends[0][k]) / STD
        assert np.allclose(fit.jacobian[:, k], slope, rtol=0.0, atol=1e-8 * np.abs(slope).max())


def test_a_bent_valley_is_followed():
    """Rosenbrock's."""
    x, y = Free("x", -1.2, -5.0, 5.0, 0.1), Free("y", 1.0, -5.0, 5.0, 0.1)
    model = Counted((x, y), lambda v: np.stack([10.0 * (v[1] - v[0] ** 2), v[0]]), np.array([0.0, 1.0]))
    start, white = Start("", ("x", "y"), {}), Whitener({"y": Noise(np.empty(0), 1e-3)})
    (found,) = look(model, white, [start], 60)
    assert abs(found.values["x"] - 1.0) < 1e-3 and abs(found.values["y"] - 1.0) < 1e-3


def test_steps_that_are_too_short_grow_longer():
    """Kinks make slopes noisy, and a valley seem steeper along its floor than it is: full steps are too short."""
    a, b = Free("a", 1.0, -9.0, 9.0, 1.0), Free("b", 1.0, -9.0, 9.0, 1.0)
    kinks = np.random.default_rng(1).uniform(size=(400, 1))

    def predicted(v):
        return np.vstack([0.3 * np.floor((v[0] + v[1]) / 0.03 + kinks), 30.0 * v[0]])

    model = Counted((a, b), predicted, predicted(np.array([[0.2], [1.8]]))[:, 0])
    (found,) = look(model, Whitener({"y": Noise(np.empty(0), 1.0)}), [Start("", ("a", "b"), {})], 20)
    assert abs(found.values["a"] - 0.2) < 0.07  # 0.12 with steps that are not longer


def test_a_step_that_a_bound_cuts_off_is_no_end():
    """The best step leaves the bounds, and cut off it would be a loss: smaller ones are tried."""
    a, b = Free("a", 0.0, -9.0, 0.05, 1.0), Free("b", 0.0, -9.0, 9.0, 1.0)
    model = Counted(
        (a, b), lambda v: np.stack([v[0] + 0.99 * v[1], v[0] + v[1], 0.1 * v[1]]), np.array([1.0, 1.0, -1.0])
    )
    fit = refit(model, Whitener({"y": Noise(np.empty(0), 1.0)}), [Start("", ("a", "b"), {})], 40)[0]
    free = np.linalg.lstsq(np.array([[0.99], [1.0], [0.1]]), np.array([1.0 - 0.05, 1.0 - 0.05, -1.0]), rcond=None)[0][0]
    assert fit.values["a"] == 0.05 and abs(fit.values["b"] - free) < 0.01


def test_what_lies_between_bounds_is_no_wider_than_these():
    """Two latencies that only their sum shows: the one between bounds leaves the other open by no more than these."""
    late, hold = Free("late", 1.0, 0.0, 1e4, 1.0), Free("hold", 0.05, 0.0, 0.1, 0.1)
    model = Counted((late, hold), lambda v: np.repeat(v[:1] + v[1:], 50, axis=0), np.full(50, 3.0))
    fit = refit(model, WHITE, [Start("", ("late", "hold"), {})])[0]
    low, high = fit.interval("late")
    assert 2.9 - 1e-6 < fit.values["late"] <= 3.0
    assert high - low == pytest.approx(2.0 * 1.96 * np.hypot(0.1 / np.sqrt(12.0), STD / np.sqrt(50.0)), rel=0.01)


def test_a_look_never_ends_worse_than_it_began():
    model = rings()
    begun = [Start(f"{k}", NAMES, {"rate": rate, "decay": 0.1}) for k, rate in enumerate((0.5, 2.5, 3.1, 6.0))]
    before = [look(model, WHITE, [start], 0)[0] for start in begun]
    ended = look(model, WHITE, begun, 4)
    left = [np.sum(((model.blocks[0].measured - ringing(_column(one)[:, None])[:, 0]) / STD) ** 2) for one in before]
    assert all(one.cost <= start * (1.0 + 1e-12) for one, start in zip(ended, left, strict=True))
    assert min(ended, key=lambda one: one.cost).label == "2"


def _column(one):
    return np.array([one.values[name] for name in NAMES])
