"""The CasADi functions against the exact equations: away from rest, slack, at rest, and their slopes."""

import sys
from itertools import product

import numpy as np
import pytest

from cable_envs import ConfigurationError, load_rig, model
from cable_envs.continuous.ways import asked
from tests.continuous.cases import BRAKE, EVERY, point, tangents

casadi = pytest.importorskip("casadi", reason="CasADi functions need it: pip install 'cable-envs[casadi]'")

CASES = pytest.mark.parametrize("case", EVERY.values(), ids=EVERY)
LONG = {name for name in EVERY if name.startswith("series")} - {"series-tension"}
"""Functions of three holes take ten seconds each."""
SLIDING = pytest.mark.parametrize(
    "case",
    [pytest.param(c, id=n, marks=[pytest.mark.slow] if n in LONG else []) for n, c in EVERY.items() if c is not BRAKE],
)


def both(m, smooth, x, u, way=None):
    """(exact, smooth) of rates and outputs together."""
    exact = np.concatenate([m.f(x, u, way), m.h(x, u, way)])
    return exact, np.concatenate([np.array(one(x, u)).ravel() for one in (smooth.f, smooth.h)])


def every(m):
    """All directions in which a plant can slide."""
    return list(product((1, -1), repeat=len(m.frictions)))


@SLIDING
@pytest.mark.parametrize("way", [1, -1])
def test_away_from_rest_the_smooth_equations_are_the_exact_ones(case, way):
    """At 5 v_s the law of the other direction still has a share of 1 / (1 + e^10) = 4.5e-5; |v| is 2e-4 too large,

    which the exponent 2 of the extrusion doubles.
    """
    m, smooth, rng = case.made, case.smooth, np.random.default_rng(5)
    for _ in range(10):
        x, u = point(m, case, way, rng)
        exact, found = both(m, smooth, x, u)
        others = [np.concatenate([m.f(x, u, ways), m.h(x, u, ways)]) for ways in every(m)]
        apart, size = sum(np.abs(other - exact) for other in others), np.abs(exact)
        if m.equations.verge:  # the damping of a contact makes a rate of what is left of tensions
            units = [(s.unit, k < len(x)) for k, s in enumerate((*m.states, *m.outputs))]
            size = np.array([max(a for a, other in zip(size, units) if other == unit) for unit in units])
        assert np.all(np.abs(found - exact) <= 4.6e-5 * apart + 4.1e-4 * size + 1e-9)


@CASES
def test_a_smaller_smoothing_is_nearer(case):
    m, rng = case.made, np.random.default_rng(6)
    x, u = point(m, case, 1, rng)
    apart = []
    for speed, tension in ((1.0, 1.0), (0.25, 0.25)):
        exact, found = both(m, m.casadi(speed * m.equations.speed * 3.0, tension), x, u)
        apart.append(np.abs(found - exact).max())
    assert apart[1] <= apart[0] + 1e-12


@pytest.mark.parametrize(("rig", "mode", "place"), [
    ("gu-inferred", "speed", "drive_position"), ("zou-table2", "torque", "drive_angle"),
    ("bowden-1m", "tension", "drive_position"),
])  # fmt: skip
def test_slack_is_rounded_off_within_the_stated_tension(rig, mode, place):
    """max(0, T) becomes T_s ln(1 + e^(T / T_s)): at most T_s ln 2 too much, where the cable just slackens."""
    m, tension = model(rig, mode), 0.5
    smooth, (x, u) = m.casadi(tension=tension), m.rest(0.01)
    x[m.held] = 10.0 * m.equations.speed
    k = [s.name for s in m.states].index(place)
    tensions = [j for j, s in enumerate(m.outputs) if s.unit == "N"]
    seen, x0 = [], x[k]
    for away in np.linspace(-2.0, 1.0, 60):
        x[k] = x0 + away * (2e-3 if m.states[k].unit == "m" else 2.0)
        seen.append((m.h(x, u)[tensions], np.array(smooth.h(x, u)).ravel()[tensions]))
    exact, found = np.array(seen).swapaxes(0, 1)
    assert (exact == 0.0).any() and (exact > 10.0).any()
    # tensions at the other end of a cable are larger by its tension ratio
    assert 0.0 <= (found - exact).max() <= 2.0 * np.log(2.0) * tension
    assert np.all(found >= 0.0)


@SLIDING
def test_slopes_are_those_of_the_exact_equations(case):
    m, smooth, rng = case.made, case.smooth, np.random.default_rng(7)
    x, u = point(m, case, 1, rng)
    for place, way in zip(m.places, asked(m.equations, 1)):
        if place >= 0:
            x[place] = 20.0 * way * m.equations.speed
    linear, along = m.linearise(1, at=(x, u)), tangents(m, x, u, asked(m.equations, 1))
    for function, over_x, over_u in ((smooth.f, linear.A, linear.B), (smooth.h, linear.C, linear.D)):
        exact = np.hstack([over_x, over_u])
        found = np.hstack([np.array(part) for part in function.jacobian()(x, u, 0.0)])
        size = np.abs(exact).max(axis=1, keepdims=True)
        assert np.abs((found - exact) @ along).max() <= np.max(1e-4 * size) + 1e-9


@pytest.mark.parametrize("name", ["hole-tension", "circuit-torque", "sheath-tension", "drive-belt", "coupled"])
def test_slopes_are_finite_at_rest(name):
    m = EVERY[name].made
    smooth, (x, u) = EVERY[name].smooth, m.rest(EVERY[name].position)
    assert all(np.isfinite(np.array(part)).all() for part in smooth.f.jacobian()(x, u, 0.0))


def test_a_smooth_load_creeps_where_the_real_one_is_held():
    """Half of the friction is mobilised: v = v_s artanh(1/2), less the little that damping takes."""
    m = model("gu-inferred")
    (x0, u0), (x1, u1) = m.rest(), m.rest(0.0, 1)
    at, forces = 0.5 * (x0 + x1), 0.5 * (u0 + u1)
    assert m.sliding(at, forces) == 0
    smooth = m.casadi(speed=1e-3)
    rates = casadi.integrator("r", "cvodes", _ode(smooth, forces), 0.0, 0.2)
    end = np.array(rates(x0=at)["xf"]).ravel()
    assert 1e-4 < end[2] < 1e-3


def _ode(smooth, u):
    x = casadi.SX.sym("x", 3)
    return {"x": x, "ode": smooth.f(x, u)}


def test_the_functions_have_named_arguments():
    smooth = model("gu-inferred").casadi(speed=2e-3)
    assert smooth.f.name_in() == ["x", "u"] and smooth.f.name_out() == ["f"] and smooth.speed == 2e-3
    assert smooth.f.size_out(0) == (3, 1) and smooth.h.size_out(0) == (6, 1)


@pytest.mark.parametrize("given", [{"speed": 0.0}, {"tension": -1.0}, {"speed": float("nan")}])
def test_a_smoothing_must_be_above_zero(given):
    with pytest.raises(ConfigurationError, match="expected a smoothing above 0"):
        model("gu-inferred").casadi(**given)


def test_without_casadi_it_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "casadi", None)
    with pytest.raises(ConfigurationError, match=r"pip install 'cable-envs\[casadi\]'"):
        model(load_rig("gu-inferred")).casadi()
