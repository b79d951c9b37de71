"""One wrapped contact: closed forms against numerical solutions, limits, and the numbers of both papers."""

import math

import numpy as np
import pytest

from cable_envs.physics.contact import (
    extrusion_coefficient,
    tension_integral,
    tension_ratio,
    tension_ratio_and_slope,
    tension_ratio_perturbed,
    wrap_in_contact,
)
from tests.reference import contact_reference as reference

POINTS = [(0.3, 0.2, 0.8), (1.5, 0.43, math.pi / 3), (1.5, 1.105, math.pi / 2), (8.0, 0.54, 3.39), (60.0, 0.1, 6.3)]
"""(rho, mu, phi): hole and pulley, little and much friction"""

NINE_CABLES = {  # Table A1, Gu 2024: (delta, mu, K, omega)
    "steel 1 mm": (0.019, 0.283, 1192, 3.53), "steel 2 mm": (0.015, 0.274, 2643, 3.48),
    "steel 3 mm": (0.009, 0.297, 3347, 3.44), "fibre 1 mm": (0.028, 0.425, 3027, 2.02),
    "fibre 2 mm": (0.020, 0.430, 6574, 2.03), "fibre 3 mm": (0.015, 0.427, 9982, 1.99),
    "rubber 1 mm": (0.042, 0.328, 1918, 1.67), "rubber 2 mm": (0.033, 0.334, 4622, 1.66),
    "rubber 3 mm": (0.027, 0.320, 6913, 1.71),
}  # fmt: skip


@pytest.mark.parametrize("point", POINTS)
def test_zou_eq7_ratio_solves_the_balance_of_an_element(point):
    assert tension_ratio(*point) == pytest.approx(reference.tension_ratio_by_ode(*point), rel=1e-8)  # solver 1e-10


@pytest.mark.parametrize(("mu", "phi"), [(0.1, 1.0), (0.54, 3.0), (1.2, 6.0)])
def test_zou_eq12_capstan_limit(mu, phi):
    rho = 1e7
    # ln(lambda) - mu phi is -(mu phi)(1 + mu^2)/rho to first order: below 2e-6 here
    assert tension_ratio(rho, mu, phi) == pytest.approx(math.exp(mu * phi), rel=2e-6)
    for finite in (0.2, 1.0, 10.0, 1e3):
        assert 1.0 < tension_ratio(finite, mu, phi) < math.exp(mu * phi)


def test_zou_eq12_ratio_starts_flat():
    rho, mu, phi = 1.5, 0.43, 1e-3
    # T(0) = 1, T'(0) = 0, T''(0) = rho; the next term is -(1 + rho) rho phi^3 / (6 mu), 1.5e-9
    assert tension_ratio(rho, mu, 0.0) == 1.0
    assert tension_ratio(rho, mu, phi) - 1.0 == pytest.approx(rho * phi**2 / 2, abs=2e-9)


@pytest.mark.parametrize("mu", [0.0, 1e-12, 1e-6])
def test_frictionless_contact_keeps_the_tension(mu):
    # lambda - 1 = rho mu phi / (1 + rho) to first order
    assert tension_ratio(5.0, mu, 2.0) == pytest.approx(1.0, abs=2 * max(mu, 1e-9))
    assert tension_integral(5.0, mu, 2.0) == pytest.approx(2.0, rel=2 * max(mu, 1e-9))


@pytest.mark.parametrize("point", POINTS)
def test_zou_eq16_integral_equals_quadrature(point):
    assert tension_integral(*point) == pytest.approx(reference.tension_integral_by_quadrature(*point), rel=1e-11)


@pytest.mark.parametrize("point", POINTS)
def test_slope_equals_the_complex_step_derivative(point):
    rho, mu, phi = point
    ratio, slope = tension_ratio_and_slope(rho, mu, phi)
    step = 1e-30  # complex step: no cancellation, exact to rounding
    assert slope == pytest.approx(reference.tension_ratio_printed(rho, mu + 1j * step, phi).imag / step, rel=1e-12)
    assert ratio == tension_ratio(rho, mu, phi)


@pytest.mark.parametrize("rho", [0.5, 1.5, 10.0])
@pytest.mark.parametrize("m", [0.43, 1.105])
@pytest.mark.parametrize("phi", [math.pi / 6, math.pi / 2, 3.0])
def test_gu_eq22_agrees_with_the_exact_ratio_and_the_numerical_one(rho, m, phi):
    delta = 0.02
    printed = tension_ratio_perturbed(rho, delta, m, phi)
    assert printed == pytest.approx(tension_ratio(rho * (1 + delta), m, phi), rel=1e-3)  # first order: delta^2 left
    assert printed == pytest.approx(reference.tension_ratio_by_ode(rho * (1 + delta), m, phi), rel=1e-3)


@pytest.mark.parametrize("point", POINTS)
def test_gu_eq19_eq20_perturbation_terms_solve_their_equations(point):
    zeroth, first = reference.perturbation_by_ode(*point)
    assert tension_ratio_perturbed(point[0], 0.0, *point[1:]) == pytest.approx(zeroth, rel=1e-8)  # solver 1e-10
    assert tension_ratio_perturbed(point[0], 1.0, *point[1:]) - zeroth == pytest.approx(first, rel=1e-6, abs=1e-8)


def test_gu_eq22_error_is_second_order_in_delta():
    def error(delta):
        return abs(tension_ratio_perturbed(1.5, delta, 1.1, 1.5) - tension_ratio(1.5 * (1 + delta), 1.1, 1.5))

    assert error(0.04) / error(0.02) == pytest.approx(4.0, rel=0.05)  # 4 (1 + O(delta))


def test_gu_eq17_gain_and_exponent():
    assert extrusion_coefficient(6574.0, 2.03, 0.0108) == pytest.approx(6574 * 0.0108**2.03, rel=1e-14)  # rounding
    assert extrusion_coefficient(6574.0, 2.03, -0.0108) == extrusion_coefficient(6574.0, 2.03, 0.0108)
    assert extrusion_coefficient(6574.0, 2.03, 0.0) == 0.0
    assert extrusion_coefficient(0.0, 2.03, 0.5) == 0.0


def test_gu_section_5_3_tensions_of_raising_and_lowering():
    """40-62 N and 33-73 N are printed ranges; load, rho and speed are inferred from them (docs/physics.md)."""
    weight, rho, mu, wrap = 49.05, 1.5, 0.43, math.pi / 3
    without = tension_ratio(rho, mu, wrap)
    assert weight * without == pytest.approx(61.1, abs=0.05)  # one decimal
    assert weight / without == pytest.approx(39.4, abs=0.05)
    m = mu + extrusion_coefficient(6574.0, 2.03, 0.0108)
    for with_extrusion in (tension_ratio(rho * 1.02, m, wrap), tension_ratio_perturbed(rho, 0.02, m, wrap)):
        # 10.8 mm/s is rounded from 10.845, where mu + C = 1.105; at 10.8 the tensions are 72.88 and 33.01 N
        assert weight * with_extrusion == pytest.approx(73.0, abs=0.15)
        assert weight / with_extrusion == pytest.approx(33.0, abs=0.05)
    assert mu + extrusion_coefficient(6574.0, 2.03, 0.010845) == pytest.approx(1.105, abs=5e-4)  # three decimals


def test_gu_eq2_printed_radius_ratio_cannot_reach_the_measured_ratio():
    measured = math.sqrt(62 / 40)
    assert measured == pytest.approx(1.245, abs=5e-4)
    printed = [tension_ratio(r_over_R, 0.43, math.pi / 3) for r_over_R in np.linspace(0.01, 1.0, 100)]
    assert max(printed) == pytest.approx(1.190, abs=5e-4)  # r = R, the largest cable that fits
    assert tension_ratio(1.5, 0.43, math.pi / 3) == pytest.approx(measured, abs=1e-3)


def test_gu_eq2_printed_radius_ratio_has_no_capstan_limit():
    assert tension_ratio(1e-6, 0.43, 3.0) == pytest.approx(1.0, abs=1e-5)  # r / R -> 0: no friction at all


def test_gu_eq17_delta_and_rho0_enter_as_a_product_only():
    for rho0, delta in ((1.5, 0.02), (1.53, 0.0), (1.2, 0.275)):
        assert tension_ratio(rho0 * (1 + delta), 1.1, 1.0) == pytest.approx(tension_ratio(1.53, 1.1, 1.0), rel=1e-14)
    # and the ratio hardly feels it: 2 % more rho give half a per cent
    grown = tension_ratio(1.5 * 1.02, 1.1, 1.0) / tension_ratio(1.5, 1.1, 1.0) - 1
    assert 0.002 < grown < 0.006


@pytest.mark.parametrize("cable", NINE_CABLES)
def test_gu_table_a1_ratio_grows_with_wrap_and_speed(cable):
    delta, mu, gain, exponent = NINE_CABLES[cable]
    wraps, speeds = np.radians([30, 45, 60, 75, 90]), np.linspace(0, 0.015, 15)  # 75 pairs as in section 4.2
    ratios = np.array(
        [
            [tension_ratio(1.5 * (1 + delta), mu + extrusion_coefficient(gain, exponent, v), wrap) for v in speeds]
            for wrap in wraps
        ]
    )
    assert np.all(np.diff(ratios, axis=0) > 0) and np.all(np.diff(ratios, axis=1) > 0)
    assert ratios.min() > 1.0 and ratios.max() < math.exp((mu + gain * 0.015**exponent) * math.pi / 2)


def test_gu_eq1_no_rigidity_keeps_the_wrap_and_much_takes_all():
    assert wrap_in_contact(1.0, 0.0, 5e-3, 10.0, 20.0) == 1.0
    assert wrap_in_contact(1.0, 1.0, 5e-3, 10.0, 20.0) == 0.0
    assert math.isfinite(wrap_in_contact(1.0, 1e-6, 5e-3, 0.0, 0.0))  # slack sides
    stiff, tense = wrap_in_contact(1.0, 1e-5, 5e-3, 10.0, 20.0), wrap_in_contact(1.0, 1e-5, 5e-3, 100.0, 200.0)
    assert 0.0 < stiff < tense < 1.0


def test_gu_eq1_takes_half_of_what_the_elastica_gives():
    """Eq. (A11) halves omega = sqrt(B/T)/R of Eq. (A8) without a reason given; bending theory has all of it."""
    rigidity, tension, radius = 1e-5, 20.0, 5e-3
    lost = 1.0 - wrap_in_contact(1.0, rigidity, radius, tension, tension)  # both ends
    assert lost == pytest.approx(math.sqrt(rigidity / tension) / radius, rel=1e-12)
    turned = reference.lift_off_turn_by_elastica(rigidity, tension, radius)  # one end
    assert turned == pytest.approx(2 * math.asin(math.sqrt(rigidity / tension) / (2 * radius)), rel=1e-5)  # solve_bvp
    assert turned == pytest.approx(lost, rel=2e-3)  # asin x = x to x^2/6
