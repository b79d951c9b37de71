"""Closed forms of the closed circuit, Eqs. (31)-(49) of Zou 2022, against quadratures and root finding."""

import numpy as np
import pytest

from cable_envs.core.errors import ConfigurationError
from cable_envs.plants.circuit.parameters import CIRCUIT
from cable_envs.plants.circuit.statics import Statics, hold_flag, replay
from cable_envs.sim.rigs import load_rig
from tests.reference import circuit_reference as reference

TORQUES = np.linspace(-0.6, 0.6, 13)


def table_2(pretension: float = 50.0, **change) -> Statics:
    return Statics.from_rig({"pretension_top": pretension, "pretension_bottom": pretension, **change})


def test_defaults_are_the_rig_of_table_2():
    rig = load_rig("zou-table2")
    for parameter in CIRCUIT:
        # 1 ulp: the file gives millimetres
        assert rig.values[parameter.name] == pytest.approx(parameter.default, rel=1e-15), parameter.name


def test_zou_table_3_slip_angles_and_ratios():
    statics = table_2()
    angles = [[0.051, 0.129, 0.291, 0.182], [0.051, 0.206, 0.182, 0.290]]
    ratios = [[1.006, 1.047, 1.115, 1.074], [1.006, 1.072, 1.074, 1.114]]
    # half a unit of the last printed digit; 4b (0.290) misses by a further 4e-4: no wrap that rounds to 3.390 gives it
    np.testing.assert_allclose(statics.slip_angle[..., 0], angles, atol=9.5e-4)
    np.testing.assert_allclose(statics.ratio[..., 0], ratios, atol=5.5e-4)
    fixed = table_2(idlers_fixed=1.0)
    printed = [[1.098, 2.130, 4.213, 4.796], [1.098, 2.025, 4.622, 4.739]]
    np.testing.assert_allclose(fixed.ratio[1, 3, 0], 4.730, atol=5e-4)  # 4b prints 4.739
    # half a digit; the wraps 1.571 and 3.141 of Table 2 stand for pi / 2 and pi, and 3b changes by 1.4e-3 with it
    np.testing.assert_allclose(fixed.ratio[..., 0].ravel()[:7], np.ravel(printed)[:7], atol=2e-3)


@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize("torque", [-0.3, 0.0, 0.1, 0.45])
def test_zou_eq42_to_eq45_equal_quadrature_and_root_finding(torque, direction):
    state = table_2().working(torque, direction, strict=True)
    top, bottom, output, elongation = reference.working_state(torque, direction, 50.0)
    # brentq 1e-12 N of about 50 N
    assert state.tension_drive_top[0] == pytest.approx(top, rel=1e-11)
    assert state.tension_drive_bottom[0] == pytest.approx(bottom, rel=1e-11)
    assert state.output_torque[0] == pytest.approx(output, rel=1e-10)
    assert state.elongation_angle[0] == pytest.approx(elongation, rel=1e-9)  # a difference of terms 100 times as large


@pytest.mark.parametrize("direction", [1, -1])
def test_zou_eq36_elongations_cancel(direction):
    statics = table_2()
    state = statics.working(TORQUES[:, None], direction, strict=True)
    kappa_t, kappa_b = statics.kappa[0 if direction > 0 else 1]
    total = state.tension_drive_top * kappa_t + state.tension_drive_bottom * kappa_b - statics.kappa3
    assert np.abs(total).max() < 4e-16 * 50 * statics.kappa3[0]  # rounding of sums near kappa3


@pytest.mark.parametrize("direction", [1, -1])
def test_zou_eq45_eq46_closed_form_equals_the_step_by_step_one(direction):
    statics = table_2(50.0, pretension_bottom=40.0)
    k1, k2 = statics.kappa[0 if direction > 0 else 1]
    torque = TORQUES[:, None] * 0.8
    pre_t, pre_b = statics.pretension * statics.length
    printed = torque * k1 * k2 / (reference.EA * reference.R0 * reference.R5 * (k1 + k2))
    printed = printed + (pre_b * k1 - pre_t * k2) / (reference.EA * reference.R5 * (k1 + k2))
    elongation = statics.working(torque, direction, strict=True).elongation_angle
    np.testing.assert_allclose(elongation, printed, rtol=0, atol=1e-15)  # both of order 0.1 from terms of order 0.5
    angle = statics.output_angle(0.7, torque, direction)
    np.testing.assert_allclose(angle, 0.7 * 7 / 5 - printed, rtol=0, atol=1e-15)


@pytest.mark.parametrize("direction", [1, -1])
def test_zou_eq44_output_torque_as_printed(direction):
    statics = table_2()
    kt, kb = statics.product
    k1, k2 = statics.kappa[0 if direction > 0 else 1]
    force = TORQUES[:, None] / reference.R0
    if direction > 0:
        printed = reference.R5 * (force * (kt * kb * k1 + k2) + (1 - kt * kb) * statics.kappa3) / (kt * (k1 + k2))
    else:
        printed = reference.R5 * (force * (k1 + kt * kb * k2) - (1 - kt * kb) * statics.kappa3) / (kb * (k1 + k2))
    output = statics.working(TORQUES[:, None], direction, strict=True).output_torque
    np.testing.assert_allclose(output, printed, rtol=0, atol=1e-14)  # rounding of torques below 1 N m


def test_zou_no_slack_limit_at_12_5_newton():
    statics = table_2(12.5)
    low, high = statics.torque_range(1)
    assert 0.18 < high[0] < 0.19  # where T01b of Eq. (43) becomes negative
    assert -0.17 < low[0] < -0.16
    inside, outside = statics.working(0.999 * high, 1), statics.working(1.001 * high, 1)
    assert not inside.out_of_range[0] and inside.tension_drive_bottom[0] > 0
    assert outside.out_of_range[0] and outside.tension_drive_bottom[0] == 0
    with pytest.raises(ConfigurationError, match="slack"):
        statics.working(1.001 * high, 1, strict=True)


@pytest.mark.parametrize("direction", [1, -1])
def test_tensions_are_never_negative_and_continuous_at_the_slack_limit(direction):
    statics = table_2(12.5)
    torque = np.linspace(-1, 1, 2001)
    state = statics.working(torque, direction)
    for tension in state[3:7]:
        assert tension.min() >= 0
        assert np.abs(np.diff(tension)).max() < 0.3  # N for steps of 1 mN m: at most step / R0 times K
    np.testing.assert_allclose(state.drive_torque, torque, atol=1e-15)
    # the stiffness halves when a cable goes limp, nothing jumps: steps of 1 mN m give at most twice 0.37 mrad
    assert np.abs(np.diff(state.elongation_angle)).max() < 8e-4
    assert (np.diff(state.output_torque) > 0).all()


def test_from_elongation_inverts_working_beyond_the_slack_limit_too():
    statics = table_2(12.5)
    for direction in (1, -1):
        state = statics.working(TORQUES, direction)
        again = statics.from_elongation(state.elongation_angle, direction)
        for one, two in zip(state[:-1], again[:-1], strict=True):
            np.testing.assert_allclose(one, two, atol=1e-12)  # N: rounding of tensions of 100 N
        np.testing.assert_array_equal(state.out_of_range, again.out_of_range)


@pytest.mark.parametrize("pretension", [12.5, 50.0, 150.0])
@pytest.mark.parametrize("direction", [1, -1])
def test_zou_eq49_inverse_returns_what_the_drive_must_do(direction, pretension):
    statics = table_2(pretension)
    wanted = np.linspace(-0.5, 0.5, 11)
    inverse = statics.inverse(0.3, wanted, direction)
    np.testing.assert_allclose(statics.working(inverse.drive_torque, direction).output_torque, wanted, atol=1e-13)
    angle = statics.output_angle(inverse.drive_angle, inverse.drive_torque, direction)
    np.testing.assert_allclose(angle, 0.3, rtol=1e-13)
    elongation = statics.working(inverse.drive_torque, direction).elongation_angle
    np.testing.assert_allclose(inverse.compensation, elongation * 5 / 7, atol=1e-14)  # Eq. (49)
    np.testing.assert_allclose(inverse.drive_angle, 0.3 * 5 / 7 + inverse.compensation, rtol=1e-14)


def test_rigid_frictionless_circuit_is_a_gear():
    statics = table_2(50.0, shaft_friction=0.0, tensile_stiffness=1e8)
    assert statics.product == pytest.approx(1.0, abs=1e-12)  # no loss, no slip
    state = statics.working(0.2, 1)
    assert state.output_torque[0] == pytest.approx(0.2 * 5 / 7, rel=1e-12)
    # (M_in / R0) (L / 2) / (EA R5): both cables share; exact for equal lengths, which differ by 0.3 %
    assert state.elongation_angle[0] == pytest.approx(0.2 / 7e-3 * 0.4328 / 2 / (1e8 * 5e-3), rel=3e-3)


def test_columns_are_independent_and_vectorised():
    rng = np.random.default_rng(1)
    values = np.repeat(CIRCUIT.pack({})[:, None], 7, axis=1)
    values[: CIRCUIT.index("shaft_radius")] *= rng.uniform(0.9, 1.1, (CIRCUIT.index("shaft_radius"), 7))
    together = Statics.from_values(values).working(0.1, 1)
    for k in range(7):
        alone = Statics.from_values(values[:, k : k + 1]).working(0.1, 1)
        assert all(a[k] == b[0] for a, b in zip(together[1:], alone[1:], strict=True))


def test_zou_eq47_flag_as_printed_can_never_hold():
    statics = table_2()
    for direction in (1, -1):
        state = statics.working(TORQUES, direction, strict=True)
        args = (direction, TORQUES, state.tension_output_top, state.tension_output_bottom)
        against = direction * TORQUES < 0
        assert not hold_flag(*args, as_printed=True)[against].any()
        np.testing.assert_array_equal(hold_flag(*args)[against], 1.0)  # with the lost minus
        np.testing.assert_array_equal(hold_flag(*args)[direction * TORQUES > 0], 0.0)


def grasp_cycle(statics: Statics, n: int = 400):
    """A loaded drive that goes forth and back: torque proportional to the angle, between -0.1 and 0.4 N m."""
    angle = 0.15 + 0.25 * np.sin(np.linspace(-np.pi / 2, 7 * np.pi / 2, n))
    return angle, angle.copy()


def test_zou_eq47_replay_holds_after_a_reversal_only_with_the_minus():
    statics = table_2()
    angle, torque = grasp_cycle(statics)
    result = replay(statics, angle, torque)
    change = np.diff(angle, prepend=angle[0] - 1e-9)
    held = result.hold == 1
    assert held.sum() > 50
    np.testing.assert_array_equal(held, torque * change < 0)  # with a load, against the drive's own torque
    for series in (result.output_angle, result.output_torque):
        assert (np.diff(series)[held[1:]] == 0).all()
    literal = replay(statics, angle, torque, as_printed=True)
    assert not (literal.hold == 1).any()
    working = statics.working(torque, 1)
    forward = ~held & (change > 0)
    np.testing.assert_allclose(result.output_torque[forward], working.output_torque[forward], rtol=1e-14)


def test_replay_ignores_jitter_within_the_dead_band_and_refuses_unequal_series():
    statics = table_2()
    angle = np.linspace(0.0, 0.4, 200)
    torque = 0.3 + 0.2 * angle
    noisy = angle + 1e-4 * np.where(np.arange(200) % 2, 1, -1)
    assert replay(statics, noisy, torque, deadband=5e-4).hold.max() == 0
    assert replay(statics, noisy[::2] * 0 + 1e-5 * np.resize([1, -1], 100), torque[:100]).hold.max() == 1
    with pytest.raises(ConfigurationError, match="equal"):
        replay(statics, angle, torque[:-1])
