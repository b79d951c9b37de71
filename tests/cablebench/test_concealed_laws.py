"""The laws that no library has: each against an integration by SciPy, and absent at null to the bit."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from cable_envs.plants import plant_for
from cable_envs.plants.own_effects import load_effect, with_own_effects
from cable_envs.sim.replay import replay
from cablebench.concealed.mechanism import LAWS

PERIOD, STEPS, MASS, VISCOUS = 0.01, 60, 11.0, 20.0
T = PERIOD * (np.arange(STEPS) + 1)
NAMES = ("rough_spot", "quadratic_drag", "cubic_spring", "ageing_friction")
COMMON = {"coulomb": 0.0, "viscous": VISCOUS}
CHANGES = {
    "rough_spot": {"level": 3.0, "place": 0.004, "width": 0.01, "slow": 0.02},
    "quadratic_drag": {"coefficient": 300.0},
    "cubic_spring": {"stiffness": 4e5, "neutral": 0.002},
    "ageing_friction": {"level": 0.8, "young": 0.05, "way": 0.005, "slow": 0.02},
}


def rough_spot(y, v, age):
    return 3.0 * np.exp(-(((y - 0.004) / 0.01) ** 2)) * np.tanh(v / 0.02)


def quadratic_drag(y, v, age):
    return 300.0 * v * abs(v)


def cubic_spring(y, v, age):
    return 4e5 * (y - 0.002) ** 3


def ageing_friction(y, v, age):
    return 0.8 * np.log(1.0 + age / 0.05) * np.tanh(v / 0.02)


PLAIN = {law.__name__: law for law in (rough_spot, quadratic_drag, cubic_spring, ageing_friction)}


@pytest.fixture(scope="module")
def axis():
    """A drive with all four, each in a column of its own, and one without any."""
    plant = with_own_effects(plant_for("linear_drive"), tuple(load_effect(LAWS / f"{name}.py") for name in NAMES))
    changes = [COMMON, *({**COMMON, **{f"{n}.{k}": v for k, v in CHANGES[n].items()}} for n in NAMES)]
    return plant, np.array([plant.table.pack(change) for change in changes]).T, 9.0 * np.sin(2 * np.pi * 2.0 * T) + 2.0


def test_every_file_is_tested():
    assert sorted(NAMES) == sorted(path.stem for path in LAWS.glob("*.py")) == sorted(PLAIN)


@pytest.mark.parametrize("name", NAMES)
def test_it_moves_a_load_as_its_equation_says(axis, name):
    plant, values, force = axis
    out = replay(
        plant, values, force, PERIOD, drive="force", signals=["position", "velocity"], substeps=40
    )  # fmt: skip
    times, forces = np.r_[0.0, T], np.r_[force[0], force]  # the first step has no ramp

    def rates(t, state):
        y, v, age = state
        push = np.interp(t, times, forces) - VISCOUS * v - PLAIN[name](y, v, age)
        return [v, push / MASS, 1.0 - abs(v) * age / 0.005]

    run = solve_ivp(rates, (0.0, T[-1]), (0.0, 0.0, 0.0), "LSODA", T, rtol=1e-9, atol=1e-12, max_step=1e-3)
    column = 1 + NAMES.index(name)
    for k in range(2):
        assert out[:, k, column] == pytest.approx(run.y[k], abs=2e-3 * np.ptp(run.y[k]))
    assert np.abs(out[:, 0, column] - out[:, 0, 0]).max() > 0.05 * np.ptp(out[:, 0, 0])  # it does something


def test_at_null_it_is_absent_to_the_bit(axis):
    plant, values, force = axis
    plain = plant_for("linear_drive")
    column = np.array([plain.table.pack(COMMON)]).T
    signals = [signal.name for signal in plant.signals]
    same = replay(plain, column, force, PERIOD, drive="force", signals=signals)
    assert np.array_equal(replay(plant, values, force, PERIOD, drive="force", signals=signals)[:, :, [0]], same)
