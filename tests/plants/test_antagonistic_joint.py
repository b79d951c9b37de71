"""The joint with two tendons: contact law, energy, statics in closed form, backlash, and independent solutions."""

import gymnasium as gym
import numpy as np
import pytest

from cable_envs.core.errors import ConfigurationError
from cable_envs.physics.contact import tension_ratio
from cable_envs.plants import plant_for
from cable_envs.plants.tendon import balanced, series
from cable_envs.sim.replay import replay
from cable_envs.sim.rigs import load_rig
from tests.reference.joint_reference import Joint, Tendon, ratio_of, smooth

PLANT = plant_for("antagonistic_joint")
RIG = load_rig("finger-joint")
PERIOD, START = 0.01, 0.1
NAMES = tuple(s.name for s in PLANT.signals)
ENV = "cable_envs/AntagonistJoint-Position-Sine-v1"


def at_rest(values, start=START):
    return dict(zip(NAMES, PLANT.rest(PLANT.prepare(values), np.array([start]))[:, 0], strict=False))


def run(values, mode, command, second=None, substeps=20, **options):
    options = {"hold": "step", "start": START, **options}
    out = replay(PLANT, values, command, PERIOD, drive=mode, second=second, signals=NAMES, substeps=substeps, **options)
    return {name: out[:, k, 0] for k, name in enumerate(NAMES)}


def values_of(**changes):
    return RIG.replace(changes).column(PLANT)


def swinging(state, mode, steps=35):
    """(command, second command) that swing about those at rest."""
    t = PERIOD * np.arange(1, steps + 1)
    size, held, mean = {
        "position": (0.4, state["drive_angle"], state["pretension"]),
        "torque": (0.15, state["drive_torque"], state["co_contraction"]),
    }[mode]
    return held + size * np.sin(2 * np.pi * 2.3 * t), mean * (1.0 + 0.5 * np.sin(2 * np.pi * 1.1 * t))


# -- the tendon's law -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("hard", [0.0, 0.05])
@pytest.mark.parametrize("ratio", [1.0, 1.3, 4.0])
def test_a_tendon_obeys_the_contact_law_and_slips_no_further_than_it_must(hard, ratio):
    rng, other = np.random.default_rng(2), Tendon(5e3, 0.3, hard, ratio)
    for e, held in rng.uniform(-1e-3, 6e-3, (200, 2)):
        found = balanced(e, held, other.k1, other.k2, hard, ratio)
        assert found == pytest.approx(other.at(e, held), rel=1e-9, abs=1e-12)
        t1, t2, y2 = found
        assert min(t1, t2) >= 0.0 and t1 <= ratio * t2 * (1 + 1e-9) and t2 <= ratio * t1 * (1 + 1e-9)
        assert y2 == held or e <= 0.0 or max(t1 / t2, t2 / t1) == pytest.approx(ratio, rel=1e-9)


def test_the_ratio_of_the_contact_is_that_of_its_equation():
    rig = RIG.values
    n = tension_ratio(rig["radius_ratio"], rig["friction_coefficient"], rig["wrap_angle"])
    assert n == pytest.approx(ratio_of(rig), rel=1e-9) and 1.1 < n < np.exp(0.1 * np.pi / 2)


@pytest.mark.parametrize("mode", ["position", "torque"])
def test_reported_tensions_obey_the_contact_law_of_any_motion(mode):
    rng, rig = np.random.default_rng(5), RIG.replace({"co_contraction": 4.0})
    values = rig.column(PLANT)
    command = np.repeat(rng.uniform(-0.6, 0.6, 60) * (1.0 if mode == "position" else 0.4), 3)
    seen = run(values, mode, command, second=np.repeat(rng.uniform(0.0, 20.0, 60), 3))
    n = ratio_of(rig.values) * (1.0 + 1e-6)
    for k in "ab":
        drive, joint = seen[f"tension_drive_{k}"], seen[f"tension_joint_{k}"]
        assert drive.min() >= 0.0 and joint.min() >= 0.0
        assert np.all(drive <= n * joint) and np.all(joint <= n * drive)
    assert seen["slack_fraction"].max() > 0.0 and np.ptp(seen["joint_angle"]) > 0.3


# -- statics --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("changes", [
    {}, {"tendon_hardening": 0.0}, {"moment_arm_growth": 0.002}, {"moment_arm_growth": -0.004, "weight_torque": 0.1},
], ids=str)  # fmt: skip
def test_stiffness_is_the_closed_form_and_the_slope_of_the_torque(changes):
    """K = r_a^2 k_a + r_b^2 k_b - g (T_a + T_b) + M_w cos q, and what a pushed joint without friction does."""
    q = 0.25
    for tension in (5.0, 15.0, 30.0):
        rig = RIG.replace({**changes, "co_contraction": tension, "friction_coefficient": 0.0, "joint_damping": 0.05})
        values, v = rig.column(PLANT), rig.values
        x = at_rest(values, q)
        g, k, c = v["moment_arm_growth"], v["tendon_stiffness"], v["tendon_hardening"]
        a, b = x["tension_joint_a"], x["tension_joint_b"]
        arm_a, arm_b = v["moment_arm"] + g * q, v["moment_arm"] - g * q
        closed = arm_a**2 * k * np.sqrt(1 + 2 * c * a) + arm_b**2 * k * np.sqrt(1 + 2 * c * b) - g * (a + b)
        closed += v["weight_torque"] * np.cos(q)
        push = 1e-3 * closed
        seen = run(values, "position", np.full(300, x["drive_angle"]), start=q, disturbance=np.full(300, push))
        assert x["joint_stiffness"] == pytest.approx(closed, rel=1e-9)
        assert seen["joint_stiffness"][-1] == pytest.approx(closed, rel=2e-3)
        assert push / (seen["joint_angle"][-1] - q) == pytest.approx(closed, rel=2e-3)


def test_co_contraction_stiffens_a_joint_whose_tendons_harden_and_no_other():
    def stiffness(tension, hard):
        return at_rest(values_of(co_contraction=tension, tendon_hardening=hard, weight_torque=0.0))["joint_stiffness"]

    assert stiffness(30.0, 0.0) == pytest.approx(stiffness(5.0, 0.0), rel=1e-9)
    for hard in (0.02, 0.05):
        ratio = stiffness(30.0, hard) / stiffness(5.0, hard)
        assert ratio == pytest.approx(np.sqrt((1 + 60 * hard) / (1 + 10 * hard)), rel=1e-9) and ratio > 1.3


def test_a_gap_does_not_keep_drives_that_are_told_their_force_moving():
    """A constant torque after a push comes to rest; drives that felt their tendons within the gap swung by 0.35 mm."""
    command = np.r_[np.full(20, 0.15), np.full(780, 0.1)]
    seen = run(values_of(spring_stiffness=1.0, **{"backlash.gap": 0.1}), "torque", command)
    plain = run(values_of(spring_stiffness=1.0), "torque", command)
    assert np.ptp(seen["drive_a_position"][:100]) > 1e-4 and np.ptp(seen["drive_a_position"][-200:]) < 1e-9
    assert np.array_equal(seen["joint_angle"], plain["joint_angle"])


def test_too_little_co_contraction_leaves_backlash():
    """Tendons that are 1 mm too long, and a weight that goes over the top: the drives' angle there, to and fro.

    A take-up of more than 1 mm leaves nothing; with less, the joint falls through 2 (1 mm - take-up) over the arm.
    """
    slow = np.concatenate([np.linspace(0.0, 0.3, 300), np.linspace(0.3, -0.3, 600), np.linspace(-0.3, 0.3, 600)])
    long = {"slack.length": 0.1, "weight_torque": -0.03, "friction_coefficient": 0.0, "joint_damping": 0.01}

    def lost(tension):
        values = RIG.replace({**long, "co_contraction": tension}).column(PLANT)
        seen = run(values, "position", slow, start=0.0, hold="ramp")
        there, back = slice(350, 850), slice(950, 1450)  # going down, going up
        drive_there = np.interp(0.0, -seen["joint_angle"][there], seen["drive_angle"][there])
        drive_back = np.interp(0.0, seen["joint_angle"][back], seen["drive_angle"][back])
        return drive_back - drive_there, seen["slack_fraction"].max()

    taut, none = lost(25.0)
    assert none == 0.0 and abs(taut) < 2.5e-3  # twice 0.1 rad/s of damping over the stiffness that is left
    for tension in (0.5, 2.0):
        loose, some = lost(tension)
        line = 2.0 * tension / (1.0 + np.sqrt(1.0 + 2.0 * 0.05 * tension))  # of the linear law
        gap = 2.0 * (1e-3 - line / 6e3) / 0.01
        assert some == 1.0 and loose == pytest.approx(gap, rel=0.05) and gap > 0.12


def test_at_rest_the_tensions_hold_the_joint_with_what_the_drives_take_up():
    for tension in (0.5, 5.0, 40.0):
        for weight, start in ((0.3, 0.7), (-0.3, 0.7), (0.05, -1.0)):
            x = at_rest(values_of(co_contraction=tension, weight_torque=weight, moment_arm_growth=0.002), start)
            assert x["joint_torque"] == pytest.approx(weight * np.sin(start), abs=1e-9)
            assert min(x["tension_drive_a"], x["tension_drive_b"]) >= 0.0
            assert x["pretension"] == tension


# -- energy ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("changes", [
    {}, {"friction_coefficient": 0.0}, {"friction_coefficient": 0.5}, {"co_contraction": 1.0}, {"joint_friction": 0.03},
], ids=str)  # fmt: skip
def test_no_energy_comes_from_nowhere(changes):
    """What both drives have put in is at no time less than what joint, weight and tendons hold, in random motion."""
    rng, rig = np.random.default_rng(3), RIG.replace({**changes, "joint_damping": 0.0})
    values, v, k = rig.column(PLANT), rig.values, 40
    command = np.repeat(rng.uniform(-0.5, 0.5, 30), 8 * k)
    second = np.repeat(rng.uniform(0.3, 2.0, 30) * v["co_contraction"], 8 * k)
    state = PLANT.rest(PLANT.prepare(values), np.full(1, START))
    first = at_rest(values)
    out = replay(
        PLANT, values, command, PERIOD / k, drive="position", second=second, hold="step", signals=NAMES, state=state,
        substeps=1,
    )[:, :, 0]  # fmt: skip
    seen = {name: np.r_[first[name], out[:, j]] for j, name in enumerate(NAMES)}

    def middle(y):
        return 0.5 * (y[1:] + y[:-1])

    ends = "ab"
    work = sum(
        np.cumsum(middle(seen[f"tension_drive_{s}"]) * np.diff(seen[f"drive_{s}_position"])) for s in ends
    )  # fmt: skip
    other = Tendon(v["tendon_stiffness"], v["drive_share"], v["tendon_hardening"], 1.0)

    def stored(force, stiffness):  # integral of the law over the stretch
        line = 2.0 * force / (1.0 + np.sqrt(1.0 + 2.0 * other.c * force))
        return (0.5 * line**2 + other.c * line**3 / 6.0) / stiffness

    held = 0.5 * v["joint_inertia"] * seen["joint_velocity"] ** 2 - v["weight_torque"] * np.cos(seen["joint_angle"])
    for s in ends:
        held = held + stored(seen[f"tension_drive_{s}"], other.k1) + stored(seen[f"tension_joint_{s}"], other.k2)
    lost = work - (held[1:] - held[0])
    size = np.abs(work).max()
    assert np.diff(lost).min() > -2e-3 * size and lost.min() > -2e-3 * size
    if changes == {"friction_coefficient": 0.0}:
        assert np.abs(lost).max() < 0.01 * size
    else:
        assert lost[-1] > 0.05 * size


# -- against independent solutions ----------------------------------------------------------------------------------

SEEN = ("joint_angle", "drive_angle", "tension_drive_a", "tension_joint_a", "tension_drive_b", "tension_joint_b")
CASES = {
    "finger-joint": {},
    "growing arms, a spring": {"moment_arm_growth": 0.003, "spring_stiffness": 0.3},
    "dry joint": {"joint_friction": 0.02},
    "slack at times": {"co_contraction": 1.0, "weight_torque": 0.2},
}


@pytest.mark.parametrize("mode", ["position", "torque"])
@pytest.mark.parametrize("case", CASES)
def test_plant_against_tiny_explicit_steps(case, mode):
    """20 us of a first-order scheme: at 200 substeps within 1e-3 of the motion, at the task's 20 within 5e-3."""
    rig = RIG.replace(CASES[case])
    values = rig.column(PLANT)
    state = at_rest(values)
    command, second = swinging(state, mode)
    rate, second_rate = (np.diff(np.r_[y[0], y]) / PERIOD for y in (command, second))
    other, expected = Joint(rig.values, state, 2e-5), []
    for told in zip(command, second, rate, second_rate, strict=True):
        other.advance(mode, *told, PERIOD)
        angle = 0.5 * (other.x[0] - other.x[1]) / rig.values["moment_arm"]
        expected.append((other.q, angle, *other.tensions[0], *other.tensions[1]))
    expected = np.array(expected)
    size = np.r_[np.ptp(expected[:, :2], axis=0), np.full(4, np.ptp(expected[:, 2:]))]
    for substeps, most in ((200, 1e-3), (20, 5e-3)):
        seen = run(values, mode, command, second, substeps)
        found = np.column_stack([seen[name] for name in SEEN])
        assert (np.abs(found - expected) / size).max() < most


@pytest.mark.parametrize("mode", ["position", "torque"])
@pytest.mark.parametrize("case", CASES)
def test_the_default_step_is_within_one_per_cent_of_a_hundred_times_finer_ones(case, mode):
    values = values_of(**CASES[case])
    command, second = swinging(at_rest(values), mode, 100)
    coarse, fine = (run(values, mode, command, second, substeps) for substeps in (20, 2000))
    for name in SEEN:
        assert np.abs(coarse[name] - fine[name]).max() < 0.01 * np.ptp(fine[name])


def test_without_friction_the_motion_is_that_of_an_adaptive_integrator():
    rig = RIG.replace({"friction_coefficient": 0.0, "spring_stiffness": 0.2, "moment_arm_growth": 0.002})
    values = rig.column(PLANT)
    state = at_rest(values)
    command, _ = swinging(state, "position", 60)
    expected = smooth(rig.values, state, PERIOD, command)
    seen = run(values, "position", command, substeps=200)
    assert seen["joint_angle"] == pytest.approx(expected[:, 0], abs=2e-5 * np.ptp(expected[:, 0]))
    assert seen["joint_velocity"] == pytest.approx(expected[:, 1], abs=1e-4 * np.ptp(expected[:, 1]))


# -- the step, and what is refused ------------------------------------------------------------------------------------


def test_the_step_fits_a_light_joint_or_the_rig_is_refused():
    # a drive on its span, whose stiffness is that at the tension limit, is the quickest: 0.0875 rad in a step
    turns = np.sqrt(6000.0 / 0.7 * np.sqrt(1.0 + 2.0 * 0.05 * 75.0) / 0.3 - (60.0 / (2.0 * 0.3)) ** 2)
    assert gym.make(ENV).unwrapped.setup.substeps == np.ceil(0.01 * turns / 0.0875) == 31
    light = gym.make(ENV, rig={"joint_inertia": 2e-6}).unwrapped.setup.substeps
    assert 100 < light < 400
    with pytest.raises(ConfigurationError, match=f"substeps={light} or more"):
        gym.make(ENV, rig={"joint_inertia": 2e-6}, substeps=20)
    with pytest.raises(ConfigurationError, match="too quick"):
        gym.make(ENV, rig={"joint_inertia": 1e-9, "tendon_stiffness": 1e8})


@pytest.mark.parametrize(("rig", "message"), [
    ({"breaking_tension": 50.0}, "breaking_tension must not be below"),
    ({"co_contraction": 45.0}, "co_contraction must not be above"),
    ({"moment_arm_growth": 0.007}, "cannot pass the axis"),
])  # fmt: skip
def test_rigs_that_cannot_be_are_refused(rig, message):
    with pytest.raises(ConfigurationError, match=message):
        gym.make(ENV, rig=rig)


def test_a_slack_tendon_has_no_stiffness():
    assert series(1e4, 1e4, 0.0, 0.0, 0.1) == 0.0 and series(1e4, 1e4, 10.0, 10.0, 0.0) == 5e3
