"""Effects on the cable-hole and circuit plants: statics and limits worked out by hand, against plain formulas."""

import math

import numpy as np
import pytest

from cable_envs.plants import plant_for
from cable_envs.sim.replay import replay
from tests.reference.hole_reference import ratio

HOLE, CIRCUIT, CHAIN = plant_for("cable_hole"), plant_for("pulley_circuit"), plant_for("pulley_circuit", "chain")
WEIGHT = 5.0 * 9.81
STATIC = {"extrusion_gain": 0.0, "extrusion_delta": 0.0}
N = ratio(1.5, 0.43, math.pi / 3)


def _hole(speed, seconds, signals, start=0.0, **changes):
    """A drive at constant speeds, one after the other; signals [steps, k]."""
    command = np.repeat(np.atleast_1d(speed), round(seconds / 0.01))
    values = HOLE.table.pack({**STATIC, **changes})[:, None]
    out = replay(HOLE, values, command, 0.01, drive="speed", hold="step", signals=signals, start=start, substeps=10)
    return out[:, :, 0]


HOLE_TENSIONS = {  # tension that raises and lowers the load steadily at 5 mm/s, by the plain formula
    "coulomb_friction": ({"coulomb_friction.level": 4.0}, (WEIGHT + 4.0) * N, (WEIGHT - 4.0) / N),
    "viscous_friction": ({"viscous_friction.coefficient": 400.0}, (WEIGHT + 2.0) * N, (WEIGHT - 2.0) / N),
    "asymmetric_friction": ({"asymmetric_friction.difference": 3.0}, (WEIGHT + 3.0) * N, WEIGHT / N),
    "asymmetric_friction, contact": (
        {"asymmetric_friction.contact": 0.3}, WEIGHT * ratio(1.5, 0.43 * 1.3, math.pi / 3),
        WEIGHT / ratio(1.5, 0.43 * 0.7, math.pi / 3),
    ),
    "load_dependent_friction": (
        {"load_dependent_friction.coefficient": 0.1}, WEIGHT / (1 / N - 0.1), WEIGHT / (N + 0.1)
    ),
    "stribeck_friction": (
        {"stribeck_friction.excess": 6.0, "stribeck_friction.velocity": 0.005},
        (WEIGHT + 6.0 / math.e) * N, (WEIGHT - 6.0 / math.e) / N,
    ),
    "stribeck_friction, contact": (
        {"stribeck_friction.contact": 0.2, "stribeck_friction.velocity": 0.005},
        WEIGHT * ratio(1.5, 0.43 + 0.2 / math.e, math.pi / 3), WEIGHT / ratio(1.5, 0.43 + 0.2 / math.e, math.pi / 3),
    ),
    "presliding_hysteresis": ({"presliding_hysteresis.displacement": 3e-4}, WEIGHT * N, WEIGHT / N),
    "friction_drift": (
        {"friction_drift.change": 0.5, "friction_drift.time": 0.05},
        WEIGHT * ratio(1.5, 0.645, math.pi / 3), WEIGHT / ratio(1.5, 0.645, math.pi / 3),
    ),
    "lateral_extrusion": (
        {"lateral_extrusion.gain": 6574.0}, WEIGHT * ratio(1.5, 0.43 + 6574 * 0.005**2.03, math.pi / 3),
        WEIGHT / ratio(1.5, 0.43 + 6574 * 0.005**2.03, math.pi / 3),
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", HOLE_TENSIONS)
def test_hole_tensions_in_steady_motion(case):
    changes, up, down = HOLE_TENSIONS[case]
    changes = {**changes, "cable_damping": 2000.0}  # the vibration of the start dies out within the run
    rows = ["drive_tension", "load_velocity"]
    for speed, tension in ((0.005, up), (-0.005, down)):
        end = _hole(speed, 0.6, rows, **changes)[-1]
        assert end[1] == pytest.approx(speed, rel=1e-3)
        assert end[0] == pytest.approx(tension, rel=2e-3)  # what is left of the start


@pytest.mark.parametrize("contact", [0.3, -0.3])
def test_hole_at_rest_gives_way_at_the_friction_of_the_way_it_goes(contact):
    """Slowly hauled in or paid out from rest, the load stays until the tension is what moves it that way."""
    changes = {"asymmetric_friction.contact": contact, "cable_damping": 2000.0}
    up = WEIGHT * ratio(1.5, 0.43 * (1 + contact), math.pi / 3)
    down = WEIGHT / ratio(1.5, 0.43 * (1 - contact), math.pi / 3)
    for speed, tension in ((2e-4, up), (-2e-4, down)):
        pull, moved = _hole(speed, 4.0, ["drive_tension", "load_position"], **changes).T
        goes = int(np.argmax(moved != 0.0))
        off, limit = np.abs(pull[: goes + 1] - WEIGHT), abs(tension - WEIGHT)
        assert off[-2] < limit < off[-1] < 1.02 * limit  # a sample's pull is 0.12 N


def test_hole_friction_builds_up_as_a_growing_coefficient():
    """Slowly from rest: elements half bent, T1 = W n^(2 s - 1), the load where the mean element has the share s."""
    width = 4e-4
    changes = {"presliding_hysteresis.displacement": width, "cable_damping": 2000.0}
    for speed in (1e-4, -1e-4):
        pull, moved = _hole(speed, 8.0, ["drive_tension", "load_position"], **changes).T
        elements = [np.clip(0.5 + 4.0 * moved / (k * width), 0.0, 1.0) for k in (1, 2, 3, 4)]
        share = np.mean(elements, axis=0)
        assert np.ptp(share) > 0.49  # nearly all of it
        assert pull == pytest.approx(WEIGHT * N ** (2.0 * share - 1.0), rel=3e-3)  # half of that is the start's swing


def test_hole_cable_law_of_hardening_slack_and_creep():
    """At rest under the weight: stretch of T = k s (1 + c k s / 2), the surplus, and the creep that has settled."""
    plain = 2 * WEIGHT / (1 + math.sqrt(1 + 2 * 0.02 * WEIGHT)) / 60e3
    for changes, stretch in (
        ({"stiffness_hardening.coefficient": 0.02}, plain),
        ({"slack.length": 2e-3}, WEIGHT / 60e3 + 2e-3),
        ({"viscoelastic_creep.share": 0.5}, 1.5 * WEIGHT / 60e3),
        ({"viscoelastic_creep.share": 0.5, "slow_creep.share": 0.25}, 1.75 * WEIGHT / 60e3),
    ):
        out = _hole(0.0, 0.1, ["drive_position", "load_position", "drive_tension"], **changes)
        assert out[:, 0] - out[:, 1] == pytest.approx(stretch, rel=1e-9)
        assert out[:, 2] == pytest.approx(WEIGHT, rel=1e-9)


def test_hole_creep_is_a_standard_linear_solid():
    """The load held by friction, the drive hauls in a little and stops: tension relaxes to k / (1 + share)."""
    share, time = 0.6, 0.1
    changes = {"viscoelastic_creep.share": share, "viscoelastic_creep.time": time, "friction_coefficient": 2.0}
    speeds = [1e-3, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    out = _hole(speeds, 0.1, ["drive_tension", "load_position", "drive_position"], **changes)
    assert np.all(out[:, 1] == 0.0)
    hauled = out[-1, 2] - (1 + share) * WEIGHT / 60e3  # it was settled before
    assert out[-1, 0] - WEIGHT == pytest.approx(60e3 * hauled / (1 + share), rel=5e-3)  # 7 time constants
    relaxing = out[12:40, 0] - out[-1, 0]
    rate = -np.polyfit(np.arange(28) * 0.01, np.log(relaxing), 1)[0]
    assert rate == pytest.approx((1 + share) / time, rel=0.05)  # at a fixed stretch it is faster by 1 + share


def test_two_elements_creep_by_two_exponentials_under_a_constant_tension():
    """The head of `effects.slow_creep`: T / k (1 + sum of share (1 - e^(-t / time))), the load held by friction.

    The cable's tension at the drive jumps from the weight to 1.2 times that, and the drive tells the stretch.
    """
    shares, times = (0.6, 0.4), (0.3, 4.0)
    changes = {
        "viscoelastic_creep.share": shares[0], "viscoelastic_creep.time": times[0], "slow_creep.share": shares[1],
        "slow_creep.time": times[1], "friction_coefficient": 2.0,
    }  # fmt: skip
    values = HOLE.table.pack({**STATIC, **changes})[:, None]
    names = ["drive_position", "load_position", "drive_tension"]
    told = np.full(1000, 1.2 * WEIGHT)
    out = replay(HOLE, values, told, 0.01, drive="imposed", hold="step", signals=names, substeps=10)[:, :, 0]
    assert np.all(out[:, 1] == 0.0) and out[:, 2] == pytest.approx(1.2 * WEIGHT, rel=1e-12)
    time = np.arange(1, 1001) * 0.01
    grown = sum(s * (1.0 - np.exp(-time / t)) for s, t in zip(shares, times, strict=True))
    before = (1.0 + sum(shares)) * WEIGHT / 60e3  # it was settled under the weight
    elastic = 0.2 * WEIGHT / 60e3
    # the creep of a step of 1 ms is that of the stretch before it, which matters where the tension jumps
    assert out[:, 0] == pytest.approx(before + elastic * (1.0 + grown), abs=2e-3 * elastic)


def test_hole_ripple_of_an_eccentric_spool():
    """Behind a stiff cable the load does what the spool's circumference says."""
    a, period, phase = 3e-4, 5e-3, 0.4
    changes = {"position_ripple.amplitude": a, "position_ripple.period": period, "position_ripple.phase": phase}
    out = _hole(0.004, 1.5, ["drive_position", "load_position", "drive_tension"], cable_stiffness=1e7, **changes)
    x, y, tension = out[50:].T
    end = x + a * np.sin(2 * math.pi * x / period + phase)
    assert y == pytest.approx(end - tension / 1e7, abs=2e-6)


def _turn(plant, path, signals, effects, **options):
    values = np.array([plant.table.pack(e) for e in effects]).T
    return replay(plant, values, path, 0.01, drive="follow", signals=signals, substeps=5, **options)


@pytest.mark.parametrize("plant", [CIRCUIT, CHAIN], ids=["analytic", "chain"])
def test_circuit_output_torques_in_steady_motion(plant):
    """The output turns steadily: its torque is the load's, by the plain sum of what loads it."""
    path = 0.3 * 0.01 * np.r_[np.arange(1, 61), 60 - np.arange(1, 61)]
    names = ["output_torque", "output_velocity", "tension_output_top", "tension_output_bottom", "output_angle"]
    effects = [
        {"coulomb_friction.level": 0.02}, {"viscous_friction.coefficient": 0.05},
        {"asymmetric_friction.difference": 0.02}, {"load_dependent_friction.coefficient": 0.05},
        # falling friction makes the output stick and slip unless something resists more
        {"stribeck_friction.excess": 0.02, "stribeck_friction.velocity": 0.42, "viscous_friction.coefficient": 0.05},
        {"position_dependent_load.stiffness": 0.05, "position_dependent_load.neutral": 0.1},
        {"presliding_hysteresis.displacement": 0.02, "coulomb_friction.level": 0.02},
        {"coulomb_friction.level": 0.02, "friction_drift.change": 1.0, "friction_drift.time": 0.05,
         "shaft_friction": 0.0},
    ]  # fmt: skip
    out = _turn(plant, path, names, effects)
    for at, sign in ((58, 1.0), (118, -1.0)):
        torque, v, top, bottom, angle = out[at]
        assert v == pytest.approx(0.42 * sign, rel=0.06)  # the cables' vibration of the reversal
        damping = np.where(np.isin(np.arange(8), (1, 4)), 0.05, 2e-4) * v
        dry = np.array([
            0.02 * sign, 0.0, 0.02 if sign > 0 else 0.0, 0.05 * 5e-3 * (top[3] + bottom[3]) * sign,
            0.02 * math.exp(-((v[4] / 0.42) ** 2)) * sign, 0.05 * (angle[5] - 0.1), 0.02 * sign, 0.04 * sign,
        ])  # fmt: skip
        assert torque == pytest.approx(dry + damping, abs=6e-4)  # J dv/dt of what is left of the start


@pytest.mark.parametrize("plant", [CIRCUIT, CHAIN], ids=["analytic", "chain"])
def test_circuit_cable_laws_at_rest(plant):
    """Slack takes EA s / L of the tension; hardening and creep leave the pretension as it is."""
    names = ["tension_drive_top", "tension_drive_bottom", "drive_angle", "out_of_range"]
    effects = [{}, {"slack.length": 5e-4}, {"slack.length": 3e-3}, {"stiffness_hardening.coefficient": 0.05},
               {"viscoelastic_creep.share": 0.5}]  # fmt: skip
    out = _turn(plant, np.zeros(3), names, effects)[-1]
    length = 0.4334 + 0.002  # the spans and the slip arcs, about
    assert out[:2, 1] == pytest.approx(50.0 - 1.684e4 * 5e-4 / length, abs=0.5)
    assert np.all(out[:2, 2] == 0.0) and out[3, 2] == 1.0
    assert out[:2, [0, 3, 4]] == pytest.approx(50.0, abs=0.1)  # the two cables are not quite of one length


@pytest.mark.parametrize("plant", [CIRCUIT, CHAIN], ids=["analytic", "chain"])
def test_circuit_creep_and_hardening_against_a_grasped_object(plant):
    """A stiff object holds the output; the drive turns and stops. Creep relaxes the torque, hardening raises it."""
    path = np.concatenate([np.linspace(-0.07, 0.05, 20), np.full(80, 0.05)])
    held = {"contact_angle": -0.1, "contact_stiffness": 50.0, "contact_damping": 0.1}
    held |= {"cable_friction": 1e-4, "shaft_friction": 1e-4}
    effects = [held, {**held, "viscoelastic_creep.share": 0.5, "viscoelastic_creep.time": 0.1},
               {**held, "stiffness_hardening.coefficient": 0.02},
               {**held, "viscoelastic_creep.share": 0.2, "viscoelastic_creep.time": 0.02, "slow_creep.share": 0.3,
                "slow_creep.time": 0.1}]  # fmt: skip
    out = _turn(plant, path, ["drive_torque", "output_angle"], effects, start=-0.1)
    plain, crept, hard, both = out[-1, 0]
    cables, rise = 2 * 1.684e4 * 5e-3**2 / 0.4351, math.sqrt(1 + 2 * 0.02 * 50.0)  # N m/rad at the output; k(T) / k(0)

    def together(stiffness):
        return 1.0 / (1.0 / stiffness + 1.0 / 50.0)

    assert crept / plain == pytest.approx(together(cables / 1.5) / together(cables), rel=0.02)
    assert both / plain == pytest.approx(together(cables / 1.5) / together(cables), rel=0.02)
    assert hard / plain == pytest.approx(together(cables * rise) / together(cables), rel=0.02)


def test_partial_slip_turns_the_friction_round_over_its_angle():
    """The share of the idlers' friction is a play of the output's motion; with none of it, it jumps."""
    path = 0.01 * np.r_[np.arange(1, 61), 60 - np.arange(1, 61)]
    loaded = {"position_dependent_load.stiffness": 0.3}
    angle = 0.1
    names = ["output_angle", "tension_output_top", "tension_drive_top", "output_velocity"]
    out = _turn(CIRCUIT, path, names, [loaded, {**loaded, "partial_slip.angle": angle}])
    gain = out[:, 1] / out[:, 2]  # T45 / T01 of cable t: 1 / K moving ccw, K moving cw
    low, high = gain[55, 0], gain[115, 0]
    assert gain[55, 1] == pytest.approx(low, rel=1e-3) and gain[115, 1] == pytest.approx(high, rel=1e-3)
    y = out[:, 0, 1]
    top = y.argmax()
    travelled = y[top] - y[top:]
    turning = (travelled > 0.0) & (travelled < angle)
    assert turning.sum() > 5
    middle = gain[top:, 1][turning]
    assert (
        np.all(np.diff(middle) > 0.0) and middle[0] < low + 0.3 * (high - low) and middle[-1] > low + 0.7 * (high - low)
    )


@pytest.mark.parametrize("plant", [CIRCUIT, CHAIN], ids=["analytic", "chain"])
def test_circuit_ripple_and_drift(plant):
    """An eccentric pulley moves the output by R0 / R5 of its error; drifted friction is the final coefficients'."""
    path = 1.2 * np.arange(1, 91) * 0.01
    a, period = 0.02, 0.5
    final = {"cable_friction": 0.54 * 1.3, "shaft_friction": 0.157 * 1.3}
    effects = [
        {}, {"position_ripple.amplitude": a, "position_ripple.period": period},
        {"friction_drift.change": 0.3, "friction_drift.time": 0.01}, final,
    ]  # fmt: skip
    out = _turn(plant, path, ["output_angle", "drive_torque"], effects)
    error = out[30:, 0, 1] - out[30:, 0, 0]
    assert error == pytest.approx(1.4 * a * np.sin(2 * math.pi * path[30:] / period), abs=3e-3)
    assert out[80:, 1, 2] == pytest.approx(out[80:, 1, 3], rel=1e-3)
    assert abs(out[80, 1, 2] / out[80, 1, 0] - 1.0) > 0.05
