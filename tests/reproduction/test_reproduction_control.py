"""Quick parts of the Zou items and of the control figures of Gu against the published digits."""

import math

import numpy as np
import pytest

from cable_envs.core.errors import ConfigurationError
from cable_envs.plants.circuit.statics import Statics
from cable_envs.reproduction.gu import runs as hole_runs
from cable_envs.reproduction.yardstick import EXPLAINED, REPRODUCED
from cable_envs.reproduction.zou import fig6 as zou_fig6
from cable_envs.reproduction.zou import grasp, pretension
from cable_envs.reproduction.zou.data import PRETENSIONS, TABLE_4, UNCOMPENSATED
from cable_envs.reproduction.zou.pretension import BY_NAME, CHOSEN, Reading, errors_of, printed_equations, rig, simulate
from cable_envs.reproduction.zou.pulley import table3 as zou_table3
from cable_envs.reproduction.zou.runs import follow, four_errors, last_cycle, sinusoid

CONDITIONS = {"contact_stiffness": 0.553, "contact_angle": 1.51}
"""what the fit of the chain finds"""


@pytest.fixture(scope="module")
def chain():
    """One cycle at 12.5, 50 and 150 N."""
    return simulate(BY_NAME["chain"], [CONDITIONS], 0.01)


def test_zou_table_3_all_but_two_values_of_4b():
    rows = zou_table3.rows()
    assert [r.quantity for r in rows if r.status is not REPRODUCED] == [
        "P4b slip angle",
        "P4b ratio, fixed",
        "P3t and P3b wrap angle",
    ]
    assert len(rows) == 25 and all(r.status is EXPLAINED for r in rows if r.status is not REPRODUCED)


def test_zou_table_4_implies_one_contact_stiffness():
    ratio = TABLE_4[:, 2] / TABLE_4[:, 0]
    assert np.ptp(ratio) < 0.01  # N m/rad; three digits of 0.2 and 0.3 make 0.6 %


def test_zou_table_4_chain_has_the_minimum_at_50_newton_and_the_printed_equations_do_not(chain):
    found = four_errors(chain, "contact", True)
    assert np.argmin(found[:, 0]) == 1
    assert found[:, 0] == pytest.approx(TABLE_4[:, 0], rel=0.3)  # the fit's own misfit of this column is 26 % at most
    printed = errors_of(BY_NAME["printed"], [CONDITIONS], CHOSEN)[0]
    assert np.all(np.diff(printed[:, 0]) > 0)


def test_zou_eq44_eq45_printed_equations_are_the_plant_where_no_cable_is_slack():
    rigs = [rig(CONDITIONS, 150.0)]
    run = follow("analytic", rigs, sinusoid())
    drive = np.concatenate([[0.0], run["drive_angle"][:, 0]])  # as the servo did it
    plant, printed = last_cycle(run), last_cycle(printed_equations(rigs, drive, 0.01))
    # the plant has damping: 1.2e-3 N m s in contact at 1.7 rad/s, over 2 N m/rad: 1e-3 rad, and
    # a little of the cables; torques: times 2 and 3 N m/rad
    for name, size in (("output_angle", 2e-3), ("output_torque", 4e-3), ("drive_torque", 6e-3)):
        assert np.max(np.abs(printed[name] - plant[name])) < size, name


def test_zou_eq45_pretension_is_in_the_offset_only():
    slopes, offsets = [], []
    for tension in PRETENSIONS:
        statics = Statics.from_rig({"pretension_top": tension, "pretension_bottom": tension})
        at = [statics.inverse(0.0, m, 1).drive_angle[0] for m in (0.0, 0.01)]
        slopes.append((at[1] - at[0]) / 0.01)
        offsets.append(at[0] / tension)
    assert slopes == pytest.approx([slopes[0]] * 3, rel=1e-9)  # differences of numbers near 0.1: 1e-13
    assert offsets == pytest.approx([offsets[0]] * 3, rel=1e-12)  # rounding


def test_expected_torque_from_the_contact_is_its_stiffness_times_the_angle_error(chain):
    inside = (chain["output_angle"] > CONDITIONS["contact_angle"]) & (
        chain.expected_angle > CONDITIONS["contact_angle"]
    )
    ratio = chain.torque_error()[inside] / chain.position_error[inside]
    assert ratio == pytest.approx(CONDITIONS["contact_stiffness"], rel=1e-9)  # quotient of differences
    free = np.maximum(chain["output_angle"], chain.expected_angle) < CONDITIONS["contact_angle"]
    assert np.all(chain.torque_error()[free] == 0.0)


def test_expected_torque_from_the_drive_is_friction_in_free_motion(chain):
    error = np.abs(chain.torque_error("drive"))
    free = np.max(chain["output_angle"], axis=1) < 1.0
    for k, tension in enumerate(PRETENSIONS):
        statics = Statics.from_rig({"pretension_top": tension, "pretension_bottom": tension})
        friction = float(statics.inverse(0.0, 0.0, 1).drive_torque[0]) * 5 / 7
        # at half of the samples or more the cables work one way; the output's damping adds 3e-4 N m
        assert np.median(error[free, k]) == pytest.approx(friction, rel=0.01)
    with pytest.raises(ConfigurationError, match="drive"):
        chain.torque_error("motor")


def test_bearing_of_the_driving_pulley_reaches_the_motor_torque_only(chain):
    with_bearing = four_errors(chain, "drive", bearing_arm=1e-4)
    without = four_errors(chain, "drive")
    assert np.all(with_bearing[:, :2] == without[:, :2])
    assert np.all(with_bearing[:, 3] > without[:, 3])
    assert np.all(four_errors(chain, "contact", bearing_arm=1e-4) == four_errors(chain, "contact"))
    assert "drive_arm" not in BY_NAME["bearings"].bounds("contact")


def test_pretension_fit_recovers_the_conditions_it_was_made_from(monkeypatch):
    made = errors_of(BY_NAME["chain"], [{"contact_stiffness": 0.6, "contact_angle": 1.2}], CHOSEN)[0]
    monkeypatch.setattr(pretension, "TABLE_4", made)
    fitted = pretension.fit(BY_NAME["chain"], Reading("contact", True), generations=40)
    assert fitted.misfit < 0.02  # a third of the chain's sensitivity to 0.01 rad of contact angle, and the coarser step
    assert fitted.conditions == pytest.approx({"contact_stiffness": 0.6, "contact_angle": 1.2}, rel=0.03)


def test_zou_fig6_phases_and_dead_band():
    chain = zou_fig6.characteristic("chain")
    stroke = zou_fig6.strokes(chain)[0]
    phases = chain["phase"][stroke, 0]
    assert np.all(np.diff(phases) >= 0) and set(phases) == {1, 2, 3}  # delay, transition, working
    slopes = zou_fig6.slopes(chain, stroke)
    assert abs(slopes["delay"]) < 1e-5 < slopes["transition"] < slopes["working"]
    drive = chain["drive_angle"][stroke, 0]
    held = abs(drive[0] - drive[np.argmax(phases == 3)])
    assert held == pytest.approx(zou_fig6.dead_band(float(chain["output_torque"][stroke[0], 0])), rel=0.05)


def test_zou_fig11_contact_gives_both_uncompensated_errors():
    run = last_cycle(grasp.uncompensated([grasp.contact().parameters()]))
    assert np.degrees(grasp.largest(run.position_error)[0]) == pytest.approx(UNCOMPENSATED.degrees, abs=5e-3)
    assert grasp.largest(run.torque_error())[0] == pytest.approx(UNCOMPENSATED.torque, abs=5e-4)  # printed digits


def test_zou_eq47_estimate_needs_the_right_hold():
    nominal = grasp.contact().parameters()
    run = grasp.uncompensated([nominal])
    late = run.time > 0.26 * 12.5  # the first reversal is at a quarter of the period
    error = {
        h: grasp.largest((grasp.estimate(nominal, run, h).torque - run["output_torque"])[late])[0] for h in grasp.HOLDS
    }
    assert error["band"] < 0.03 < 0.1 < min(error["minus"], error["printed"])


def test_zou_eq49_compensation_reduces_the_error():
    nominal = grasp.contact().parameters()
    reference = grasp.Sine(2.436, 12.5)
    found = {
        name: np.max(
            np.abs(grasp.tracking_errors(grasp.compensated(name, nominal, [nominal], reference, 0.5)).angle[100:])
        )
        for name in ("feedforward-pid", "uncompensated-pid")
    }
    assert found["feedforward-pid"] < 0.25 * found["uncompensated-pid"]


def test_reference_of_the_grasp_has_its_own_derivatives():
    sine, h = grasp.Sine(0.7, 5.0, 0.2), 1e-4
    low, middle, high = (sine.at(1.3 + s * h)[0] for s in (-1, 0, 1))
    assert sine.at(1.3)[1] == pytest.approx((high - low) / (2 * h), abs=1e-8)  # third derivative times h^2 / 6
    assert sine.at(1.3)[2] == pytest.approx((high - 2 * middle + low) / h**2, abs=1e-6)  # rounding over h^2


def test_gu_figs_22_23_order_of_magnitude_and_tensions():
    sine = hole_runs.Sine(0.01, 0.17189)
    runs = hole_runs.run([hole_runs.Case(name, sine, {}, noise=0.0) for name in ("g22", "g9")], 9.0).late(
        1 / 0.17189 / 2
    )
    rms = np.sqrt(np.mean(runs.error**2, axis=0))
    assert rms[1] > 10 * rms[0]
    tension = runs["drive_tension"][:, 0]
    assert (tension.min(), tension.max()) == pytest.approx((33.0, 73.0), rel=0.02)  # section 5.3, whole newtons


def test_chatter_is_the_rms_of_what_is_above_the_cutoff():
    t = 0.01 * np.arange(2000)
    mixed = np.stack(
        [3.0 * np.sin(2 * math.pi * t), 3.0 * np.sin(2 * math.pi * t) + 0.5 * np.sin(2 * math.pi * 20 * t)], axis=1
    )
    assert hole_runs.chatter(mixed) == pytest.approx([0.0, 0.5 / math.sqrt(2)], abs=1e-3)  # leakage of the Hann window
