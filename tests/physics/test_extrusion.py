"""Geometry of the extruded contact, and the nonlinear tension ratio."""

import dataclasses
import math

import numpy as np
import pytest

from cable_envs.core.errors import ConfigurationError
from cable_envs.physics.contact import extrusion_coefficient, tension_ratio
from cable_envs.physics.extrusion import LAWS, ExtrudedContact, nonlinear_tension_profile, nonlinear_tension_ratio
from tests.reference import contact_reference as reference

CONTACT = ExtrudedContact(1.5e-3, 1e-3, 63e6, 0.3)
FORCES = np.array([0.0, 1e-6, 1.0, 30.0, 100.0])
FIBRE = {"mu": 0.43, "gain": 6574.0, "exponent": 2.03, "speed": 0.0108, "wrap": math.pi / 3}
"""Table 2, Gu 2024, at the inferred peak speed"""


def test_gu_eq3_width_is_twice_the_hertz_half_width():
    chi = reference.chi(1.5e-3, 1e-3, 63e6, 0.3)
    assert CONTACT.chi == pytest.approx(chi, rel=1e-14)  # rounding
    assert CONTACT.width(FORCES) == pytest.approx(2 * chi * np.sqrt(FORCES), rel=1e-14)


def test_gu_eq4_compression_is_the_height_of_the_chord():
    eps, width = CONTACT.compression(FORCES), CONTACT.width(FORCES)
    assert (1e-3 - eps) ** 2 + (width / 2) ** 2 == pytest.approx(np.full(5, 1e-6), rel=1e-12)  # Pythagoras
    assert eps[0] == 0.0 and np.all(np.diff(eps) > 0)
    assert CONTACT.compression(CONTACT.largest_line_force) == pytest.approx(1e-3, rel=1e-7)  # root at its branch point


def test_gu_eq5_eq6_arc_and_area():
    expected = reference.extruded_area(FORCES, 1.5e-3, 1e-3, reference.chi(1.5e-3, 1e-3, 63e6, 0.3))
    # the printed form of eps cancels: 1e-16 / (eps / r) with eps / r = 4e-9 at 1e-6 N
    assert CONTACT.area(FORCES) == pytest.approx(expected, rel=1e-7)
    assert CONTACT.arc(FORCES) == pytest.approx(1.5e-3 + CONTACT.compression(FORCES), rel=1e-15)


def test_gu_eq7_taylor_terms_leave_a_third_order_error():
    errors = [CONTACT.area(f) - CONTACT.area_taylor(f) for f in (2.0, 4.0, 8.0)]
    assert errors[1] / errors[0] == pytest.approx(8.0, rel=0.1)  # 8 (1 + O(N'/limit))
    assert errors[2] / errors[1] == pytest.approx(8.0, rel=0.1)


def test_gu_eq7_as_printed_is_twice_the_area():
    force = 1e-3
    printed = (1.5e-3 * CONTACT.chi**2 / 1e-3 + CONTACT.chi**4 * force / 1e-3**2) * force
    assert printed / CONTACT.area(force) == pytest.approx(2.0, rel=1e-4)  # higher terms: N'/limit = 1e-5


def test_compression_measured_on_a_cable_gives_its_contact():
    # braided fibre, 2 mm, 60 degrees: 0.485 mm (Table A1); the line force is about the 49.05 N of the load
    contact = ExtrudedContact.from_compression(1.5e-3, 1e-3, 0.485e-3, 49.05)
    assert contact.compression(49.05) == pytest.approx(0.485e-3, rel=1e-12)
    assert 1e6 < contact.lateral_modulus < 1e9  # a rope across its strands: far below the fibre's 100 GPa


@pytest.mark.parametrize("tension", [1.0, 33.0])
@pytest.mark.parametrize("delta", [0.0, 0.02])
def test_gu_eq13_reduces_to_the_closed_form_without_the_second_area_term(tension, delta):
    closed = tension_ratio(1.5 * (1 + delta), 0.43 + extrusion_coefficient(6574.0, 2.03, 0.0108), math.pi / 3)
    ratio = nonlinear_tension_ratio(CONTACT, **FIBRE, inlet_tension=tension, delta=delta, law="linear")
    assert ratio == pytest.approx(closed, rel=1e-8)  # solver 1e-9


@pytest.mark.parametrize("law", LAWS)
def test_gu_eq13_reduces_to_the_closed_form_at_rest_and_for_small_tension(law):
    at_rest = nonlinear_tension_ratio(CONTACT, **{**FIBRE, "speed": 0.0}, inlet_tension=33.0, law=law)
    assert at_rest == pytest.approx(tension_ratio(1.5, 0.43, math.pi / 3), rel=1e-8)  # solver 1e-9
    closed = tension_ratio(1.5, 0.43 + extrusion_coefficient(6574.0, 2.03, 0.0108), math.pi / 3)
    light = nonlinear_tension_ratio(CONTACT, **FIBRE, inlet_tension=1e-4, law=law)
    assert light == pytest.approx(closed, rel=1e-6)  # second term over first: N'/limit = 1e-6


@pytest.mark.parametrize("tension", [5.0, 33.0])
def test_gu_eq13_exact_law_agrees_with_root_finding_at_every_step(tension):
    drag = CONTACT.resistance(6574.0) * 0.0108**2.03
    expected = reference.nonlinear_ratio_by_roots(1.5e-3, 1e-3, CONTACT.chi, 0.43, drag, math.pi / 3, tension)
    assert nonlinear_tension_ratio(CONTACT, **FIBRE, inlet_tension=tension) == pytest.approx(expected, rel=1e-7)


def test_gu_eq13_more_tension_means_more_friction_and_the_taylor_law_lies_between():
    ratios = {law: [nonlinear_tension_ratio(CONTACT, **FIBRE, inlet_tension=t, law=law) for t in (5.0, 33.0)]
              for law in LAWS}  # fmt: skip
    assert ratios["linear"][1] == pytest.approx(ratios["linear"][0], rel=1e-8)  # solver 1e-9
    assert ratios["linear"][1] < ratios["taylor"][1] < ratios["exact"][1]
    assert ratios["exact"][0] < ratios["exact"][1]


@pytest.mark.parametrize("law", LAWS)
def test_gu_eq13_eq14_profile_satisfies_both_equations(law):
    phi, tension, force = nonlinear_tension_profile(CONTACT, **FIBRE, inlet_tension=20.0, law=law, points=2001)
    area = {"exact": CONTACT.area, "taylor": CONTACT.area_taylor, "linear": lambda f: CONTACT.area_coefficient * f}[law]
    drag = CONTACT.resistance(6574.0) * 0.0108**2.03
    slope = np.gradient(tension, phi)[1:-1]
    inner = slice(2, -2)  # second differences: error step^2 T''''/12, about 1e-5 of the tension
    assert 0.43 * force[1:-1] + drag * area(force)[1:-1] == pytest.approx(slope * 2.5 / 1.5, rel=1e-3, abs=1e-3)
    assert tension[1:-1][inner] - np.gradient(slope, phi[1:-1])[inner] / 1.5 == pytest.approx(
        force[1:-1][inner], abs=2e-3
    )


def test_no_wrap_keeps_the_tension():
    assert nonlinear_tension_ratio(CONTACT, **{**FIBRE, "wrap": 0.0}, inlet_tension=20.0) == 1.0


def test_direction_of_motion_does_not_matter():
    back = nonlinear_tension_ratio(CONTACT, **{**FIBRE, "speed": -0.0108}, inlet_tension=20.0)
    assert back == nonlinear_tension_ratio(CONTACT, **FIBRE, inlet_tension=20.0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"hole_radius": 0.0}, "hole_radius"), ({"cable_radius": -1e-3}, "cable_radius"),
        ({"lateral_modulus": math.nan}, "lateral_modulus"), ({"poisson": 0.6}, r"poisson = 0.6 .*\[0, 0.5\]"),
    ],
)  # fmt: skip
def test_non_physical_contacts_are_refused(change, message):
    with pytest.raises(ConfigurationError, match=message):
        dataclasses.replace(CONTACT, **change)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"mu": 0.0}, "mu"), ({"gain": -1.0}, "gain"), ({"exponent": 0.0}, "exponent"), ({"speed": math.inf}, "speed"),
        ({"wrap": -0.1}, "wrap"), ({"inlet_tension": 0.0}, "inlet_tension"), ({"delta": 2.0}, "delta"),
        ({"law": "exct"}, "did you mean 'exact'"), ({"inlet_tension": 500.0}, "flattened beyond its half"),
    ],
)  # fmt: skip
def test_bad_arguments_of_the_nonlinear_ratio_are_refused(change, message):
    with pytest.raises(ConfigurationError, match=message):
        nonlinear_tension_ratio(CONTACT, **{**FIBRE, "inlet_tension": 20.0, **change})


def test_line_forces_outside_the_validity_are_refused():
    for bad in (-1.0, math.nan, 2 * CONTACT.largest_line_force):
        with pytest.raises(ConfigurationError, match="line force outside"):
            CONTACT.area(bad)
    with pytest.raises(ConfigurationError, match="compression"):
        ExtrudedContact.from_compression(1.5e-3, 1e-3, 2e-3, 50.0)
