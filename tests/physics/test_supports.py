"""The single pulley: supports, slip angle, Table 3, and the stretch of the wrapped part."""

import dataclasses
import math

import numpy as np
import pytest
from scipy.integrate import quad

from cable_envs.core.errors import ConfigurationError
from cable_envs.physics.contact import tension_ratio
from cable_envs.physics.supports import (
    BEARING_FRICTION,
    JOINTS,
    Pulley,
    WrappedPart,
    loaded_shaft_ratio,
    shaft_ratio,
    slip_angle,
    slip_angle_exact,
    support_share,
)
from tests.reference import contact_reference as reference

WRAPS = {"1": 0.279, "2": math.pi / 2, "3": math.pi, "4t": 3.217, "4b": 3.390}
"""Table 2, Zou 2022; 1.571 and 3.141 are read as right and straight angles (cut off to three decimals)"""

TABLE_3 = {  # pulley: (R mm; slip angle rad, ratio rotatable, ratio fixed)
    "1t": (4, 0.051, 1.006, 1.098), "1b": (4, 0.051, 1.006, 1.098), "2t": (8, 0.129, 1.047, 2.130),
    "2b": (5, 0.206, 1.072, 2.025), "3t": (5, 0.291, 1.115, 4.213), "3b": (8, 0.182, 1.074, 4.622),
    "4t": (8, 0.182, 1.074, 4.796), "4b": (5, 0.290, 1.114, 4.739),
}  # fmt: skip


def table_2_pulley(name: str, **change) -> Pulley:
    wrap = WRAPS.get(name, WRAPS.get(name[0]))
    return Pulley(**{"radius": TABLE_3[name][0] * 1e-3, "cable_radius": 0.56e-3, "wrap": wrap, "cable_friction": 0.54,
                     "support_radius": 2.5e-3, "support_friction": 0.157, **change})  # fmt: skip


@pytest.mark.parametrize("name", TABLE_3)
def test_zou_table_3_slip_angles_and_ratios(name):
    pulley = table_2_pulley(name)
    computed = (pulley.slip_angle, pulley.ratio_over_slip, table_2_pulley(name, support="fixed").ratio)
    printed = TABLE_3[name][1:]
    if name == "4b":  # printed 0.290 and 4.739: no wrap that rounds to 3.390 gives either
        assert computed == pytest.approx((0.2891, 1.1140, 4.7300), abs=5e-5)
        return
    # half a unit of the last digit, and 5e-5 for wraps known to three decimals (3b 4.62148, 4t 4.79652)
    assert computed == pytest.approx(printed, abs=5.5e-4)


@pytest.mark.parametrize("wrap", [0.279, math.pi / 2, math.pi, 3.39, 6.0])
@pytest.mark.parametrize(("support_radius", "friction"), [(2.5e-3, 0.157), (1.5e-3, 0.0015), (4e-3, 0.6)])
def test_zou_eq30_idler_balances_its_torque(wrap, support_radius, friction):
    ratio = shaft_ratio(support_share(friction, support_radius, 5e-3), math.cos(wrap))
    expected = reference.turning_by_roots(5e-3, support_radius, friction, wrap)
    assert ratio == pytest.approx(expected, rel=1e-11)  # brentq 1e-14, divided by the slope of the balance
    g, w = support_share(friction, support_radius, 5e-3), math.cos(wrap)
    printed = ((1 - g * w) - math.sqrt((1 - g * w) ** 2 - (1 - g) * (1 - g))) / (1 - g)
    assert 1 / ratio == pytest.approx(printed, rel=1e-9)  # the printed form cancels where g is 2e-7


def test_zou_eq30_without_support_friction_nothing_is_lost():
    assert shaft_ratio(0.0, -1.0) == 1.0
    assert shaft_ratio(0.05, 1.0) == 1.0  # no wrap: no force on the support


@pytest.mark.parametrize("torque", [0.0, 0.02, 0.5])
@pytest.mark.parametrize("wrap", [0.5, math.pi, 5.0])
def test_zou_eq29_loaded_pulley_balances_its_torque(torque, wrap):
    low = 20.0
    k = torque / (low * 5e-3) + 1
    ratio = loaded_shaft_ratio(k, support_share(0.157, 2.5e-3, 5e-3), math.cos(wrap))
    expected = reference.turning_by_roots(5e-3, 2.5e-3, 0.157, wrap, torque, low)
    assert 1 / ratio == pytest.approx(expected, rel=1e-11)  # as above
    assert ratio <= 1 / k


def test_zou_eq30_is_eq29_without_a_load():
    for wrap in (0.279, math.pi, 5.0):
        assert loaded_shaft_ratio(1.0, 0.006, math.cos(wrap)) == pytest.approx(
            1 / shaft_ratio(0.006, math.cos(wrap)), rel=1e-14
        )  # rounding


@pytest.mark.parametrize("name", TABLE_3)
def test_zou_eq22_loss_is_the_smaller_friction(name):
    fixed, shaft = table_2_pulley(name, support="fixed"), table_2_pulley(name)
    bearing = table_2_pulley(name, support="bearing", support_friction=None)
    assert bearing.support_friction == BEARING_FRICTION
    assert 0 < bearing.loss(10.0) < shaft.loss(10.0) < fixed.loss(10.0)
    assert shaft.loss(10.0) == pytest.approx(10.0 * (shaft.turning_ratio - 1), rel=1e-14)
    jammed = table_2_pulley(name, support_friction=1.2)  # turns harder than the cable slides
    assert jammed.turning_ratio > jammed.sliding_ratio or jammed.loss(10.0) < fixed.loss(10.0)
    assert jammed.loss(10.0) <= fixed.loss(10.0)


def test_zou_eq22_stiff_support_makes_the_cable_slide():
    pulley = Pulley(4e-3, 0.56e-3, 0.279, 0.2, "shaft", 3.5e-3, 1.0)
    assert pulley.ratio == pulley.sliding_ratio < pulley.turning_ratio
    assert pulley.slip_angle == pulley.wrap  # limited by the wrap


def test_slip_angle_follows_the_capstan_within_the_wrap():
    assert slip_angle(math.exp(0.54 * 0.3), 0.54, 3.0) == pytest.approx(0.3, rel=1e-14)  # rounding
    assert slip_angle(10.0, 0.54, 0.279) == 0.279
    assert slip_angle(1.0, 0.54, 3.0) == 0.0
    assert slip_angle(1.1, 0.0, 3.0) == 3.0


@pytest.mark.parametrize(("rho", "mu"), [(0.2, 1e-3), (1.5, 0.43), (8.0, 0.54), (1e5, 2.0)])
@pytest.mark.parametrize("angle", [1e-4, 0.05, 1.0, 6.0])
def test_slip_angle_exact_inverts_zou_eq12(rho, mu, angle):
    ratio = tension_ratio(rho, mu, angle)
    slope = (tension_ratio(rho, mu, angle * 1.001) - ratio) / (0.001 * angle)
    # one rounding of the ratio (2e-16, a few times over) moves the angle by that over the slope
    assert slip_angle_exact(rho, mu, ratio) == pytest.approx(angle, rel=1e-12, abs=2e-15 * ratio / slope)
    assert slip_angle_exact(rho, mu, 1.0) == 0.0


def test_zou_slip_angle_is_less_than_eq12_needs_for_the_support_friction():
    """Angle from the capstan, ratio from Eq. (12): a rotating idler of Table 3 loses less than its shaft takes."""
    pulley = table_2_pulley("1t")
    assert pulley.turning_ratio == pytest.approx(1.0278, abs=5e-5)  # four decimals
    assert pulley.ratio_over_slip == pytest.approx(1.0064, abs=5e-5)
    consistent = slip_angle_exact(pulley.radius_ratio, 0.54, pulley.turning_ratio)
    assert tension_ratio(pulley.radius_ratio, 0.54, consistent) == pytest.approx(pulley.turning_ratio, rel=1e-12)
    assert 2.0 < consistent / pulley.slip_angle < 2.6


PART = WrappedPart(rho=7.93, mu=0.54, slip=0.291, radius=5e-3, axial_stiffness=16840.0, pretension=50.0)
"""Pulley 3t of Table 3"""


def _quadrature(part, tension):
    def stretch(angle):
        return (tension(angle) - part.pretension) * part.radius / part.axial_stiffness

    return quad(stretch, 0, part.slip, epsabs=0, epsrel=1e-11, limit=200)[0]


@pytest.mark.parametrize("rising", [True, False])
def test_zou_eq16_loading_elongation_equals_quadrature_of_the_tension(rising):
    def tension(angle):
        if rising:
            return 60.0 * reference.tension_ratio_printed(7.93, 0.54, angle)
        low = 60.0 / reference.tension_ratio_printed(7.93, 0.54, 0.291)
        return low * reference.tension_ratio_printed(7.93, 0.54, 0.291 - angle)  # Eq. (12) counts from the low end

    assert PART.loading(60.0, rising) == pytest.approx(_quadrature(PART, tension), rel=1e-9)  # quadrature 1e-11


def test_zou_eq16_nothing_stretches_under_pretension_without_friction():
    free = dataclasses.replace(PART, mu=1e-9)
    assert free.loading(50.0) == pytest.approx(0.0, abs=1e-9 * 50 * 5e-3 * 0.291 / 16840)  # mu itself
    assert free.loading(60.0) == pytest.approx(10 * 5e-3 * 0.291 / 16840, rel=1e-7)  # 1e-9 of 60 N in 10 N


def _profile(part, inlet, alpha, rising):
    """(tension along the part, outlet) after the slip has reversed over ``alpha``, from Eq. (12) and the joint."""
    ratio = lambda angle: reference.tension_ratio_printed(part.rho, part.mu, angle)  # noqa: E731
    slip, rest = part.slip, part.slip - alpha
    if rising:
        at_joint = inlet * ratio(slip) / ratio(alpha) if part.joint == "printed" else inlet * ratio(rest)
        outlet = at_joint / ratio(alpha)
        return lambda a: inlet * ratio(a) if a < rest else outlet * ratio(slip - a), outlet
    trough = inlet / ratio(slip)
    low = inlet / ratio(rest) if part.joint == "printed" else None
    still = lambda a: trough * ratio(slip - a) if low is None else low * ratio(rest - a)  # noqa: E731
    return lambda a: still(a) if a < rest else trough * ratio(alpha) * ratio(a - rest), trough * ratio(alpha) ** 2


@pytest.mark.parametrize("rising", [True, False])
@pytest.mark.parametrize("share", [0.2, 0.7])
@pytest.mark.parametrize("joint", JOINTS)
def test_zou_eq21_unloading_elongation_equals_quadrature_of_the_tension(joint, share, rising):
    part = dataclasses.replace(PART, joint=joint)
    alpha = share * part.slip
    tension, outlet = _profile(part, 60.0, alpha, rising)
    assert part.reversed_angle(60.0, outlet, rising) == pytest.approx(alpha, rel=1e-9)  # root of a ratio near 1
    expected = sum(
        quad(lambda a: (tension(a) - 50.0) * 5e-3 / 16840, *limits, epsabs=0, epsrel=1e-11)[0]
        for limits in ((0, part.slip - alpha), (part.slip - alpha, part.slip))
    )
    assert part.unloading(60.0, outlet, rising) == pytest.approx(expected, rel=1e-7)  # alpha 1e-9


@pytest.mark.parametrize("rising", [True, False])
def test_zou_eq17_printed_joint_jumps_unless_it_is_a_capstan(rising):
    def jump(**change):
        part = dataclasses.replace(PART, **change)
        joint = 0.7 * part.slip  # alpha = 0.3 slip
        tension, _ = _profile(part, 60.0, 0.3 * part.slip, rising)
        return abs(tension(joint * (1 + 1e-12)) / tension(joint * (1 - 1e-12)) - 1)

    assert jump() < 1e-11  # continuous: the step of 2e-12 times the slope
    assert 0.01 < jump(joint="printed") < 0.05  # of 60 N: the size to know
    assert jump(joint="printed", rho=1e8) < 1e-7  # mu slip (1 + mu^2) / rho


@pytest.mark.parametrize("rising", [True, False])
@pytest.mark.parametrize("joint", JOINTS)
def test_zou_eq21_starts_where_loading_ended_and_ends_where_loading_back_starts(joint, rising):
    part = dataclasses.replace(PART, joint=joint)
    turning = part.turning_outlet(60.0, rising)
    assert part.unloading(60.0, turning, rising) == pytest.approx(part.loading(60.0, rising), rel=1e-7)  # as above
    end = part.turning_outlet(60.0, not rising)  # lambda^2 away: the front has reached the inlet
    assert part.reversed_angle(60.0, end, rising) == pytest.approx(part.slip, rel=1e-9)
    assert part.unloading(60.0, end, rising) == pytest.approx(part.loading(60.0, not rising), rel=1e-9)


def test_joints_agree_in_the_capstan_limit():
    parts = [dataclasses.replace(PART, rho=1e8, joint=joint) for joint in JOINTS]
    for rising, outlet in ((True, 62.0), (False, 58.0)):
        values = [part.unloading(60.0, outlet, rising) for part in parts]
        assert values[0] == pytest.approx(values[1], rel=1e-6)  # mu slip (1 + mu^2) / rho, times 60 N / 10 N


def _cycle(part, inlet, points=801):
    """(outlet tensions from high to low, elongation on the way down, elongation on the way up at the same tensions)."""
    outlets = np.geomspace(part.turning_outlet(inlet, True), part.turning_outlet(inlet, False), points)
    down = np.array([part.unloading(inlet, t, rising=True) for t in outlets])
    return outlets, down, np.array([part.unloading(inlet, t, rising=False) for t in outlets])


@pytest.mark.parametrize("rho", [0.8, 7.93, 1e7])
def test_load_unload_cycle_closes_and_takes_energy(rho):
    outlets, down, up = _cycle(dataclasses.replace(PART, rho=rho), 60.0, 201)
    assert down[[0, -1]] == pytest.approx(up[[0, -1]], rel=1e-7)  # angles found to 1e-9
    assert np.all(down[1:-1] > up[1:-1])  # the part comes back longer than it went
    assert np.all(np.diff(down) < 0) and np.all(np.diff(up) < 0)
    work = np.trapezoid(up, outlets) - np.trapezoid(down, outlets)  # closed integral of T_2 dL
    assert work > 0


def test_zou_eq21_as_printed_lengthens_the_part_while_the_outlet_lets_go():
    """Why the joint is continuous by default."""
    _, down, _ = _cycle(dataclasses.replace(PART, joint="printed"), 60.0, 201)
    assert down.max() > down[0] * 1.0005 and np.argmax(down) > 0
    _, down, up = _cycle(dataclasses.replace(PART, joint="printed", rho=0.8), 60.0, 201)
    assert np.any(down < up)  # and with a thick cable the branches cross


def test_cycle_work_equals_the_friction_work_in_the_capstan_limit():
    part = dataclasses.replace(PART, rho=1e8)
    outlets, down, _ = _cycle(part, 60.0)
    friction = reference.capstan_friction_work(0.54, 0.291, 5e-3 / 16840, 60.0, outlets)
    stored = lambda end: 5e-3 / (2 * 16840) * 60.0**2 * (math.exp(end * 2 * 0.54 * 0.291) - 1) / (end * 2 * 0.54)  # noqa: E731
    given = np.sum(0.5 * (outlets[1:] + outlets[:-1]) * np.diff(down))  # by the outlet, negative
    # released elastic energy = work given back + friction; second-order grids of 800 and 4000 steps
    assert stored(1) - stored(-1) == pytest.approx(-given + friction.sum(), rel=1e-5)
    assert np.all(friction > 0)


@pytest.mark.parametrize("outlet", [30.0, 100.0])
def test_outlets_beyond_the_reversal_are_refused(outlet):
    with pytest.raises(ConfigurationError, match=r"passed the inlet|still loading"):
        PART.unloading(60.0, outlet, rising=True)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"support": "ball"}, "unknown pulley support 'ball'"), ({"support": "bearng"}, "did you mean 'bearing'"),
        ({"radius": 0.5e-3}, "expected more than the cable's"), ({"radius": -1.0}, "radius"),
        ({"wrap": -0.1}, "wrap"), ({"cable_friction": math.nan}, "cable_friction"),
        ({"support_radius": None}, "support_radius = None"), ({"support_friction": None}, "support_friction = None"),
        ({"support_friction": -0.1}, "support_friction"), ({"support_radius": 40e-3}, "jams"),
    ],
)  # fmt: skip
def test_bad_pulleys_are_refused(change, message):
    with pytest.raises(ConfigurationError, match=message):
        table_2_pulley("3t", **change)


@pytest.mark.parametrize("change", [{"rho": 0.0}, {"mu": -0.1}, {"slip": 0.0}, {"radius": math.inf},
                                    {"axial_stiffness": 0.0}, {"pretension": -1.0}])  # fmt: skip
def test_bad_wrapped_parts_are_refused(change):
    with pytest.raises(ConfigurationError, match=next(iter(change))):
        dataclasses.replace(PART, **change)


def test_bad_ratios_are_refused():
    with pytest.raises(ConfigurationError, match="at least 1"):
        slip_angle_exact(8.0, 0.54, 0.9)
    with pytest.raises(ConfigurationError, match="mu"):
        slip_angle_exact(8.0, 0.0, 1.1)
    with pytest.raises(ConfigurationError, match="inlet"):
        PART.loading(-1.0)
