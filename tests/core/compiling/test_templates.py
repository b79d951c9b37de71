"""Kernels as plain Python, with other numbers than floats."""

import math

import numpy as np

from cable_envs.continuous.numbers import NUMBERS, STEP
from cable_envs.core.compiling.templates import interpreted
from cable_envs.physics.contact import tension_ratio, tension_ratio_and_slope


def test_a_piece_as_plain_python_gives_what_the_kernel_gives():
    plain = interpreted(tension_ratio, **NUMBERS)
    for mu in (0.0, 0.1, 0.43, 2.0):
        assert math.isclose(plain(1.5, mu, 1.1), tension_ratio(1.5, mu, 1.1), rel_tol=1e-14)


def test_a_complex_step_gives_the_slope_that_was_derived_by_hand():
    plain = interpreted(tension_ratio, **NUMBERS)
    for mu in (0.05, 0.43, 2.0):
        slope = plain(1.5, np.complex128(mu + 1j * STEP), 1.1).imag / STEP
        assert math.isclose(slope, tension_ratio_and_slope(1.5, mu, 1.1)[1], rel_tol=1e-12)


def test_what_is_interpreted_is_left_as_it_is():
    before = tension_ratio(1.5, 0.43, 1.1)
    interpreted(tension_ratio, **{**NUMBERS, "sqrt": lambda x: 0.0 * x})
    assert tension_ratio(1.5, 0.43, 1.1) == before
