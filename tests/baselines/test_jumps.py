"""Jumps: where the laws wait for one, and that they cross it about as fast as the limits of the drive allow."""

import math

import numpy as np
import pytest

from cable_envs.baselines import make_controller
from cable_envs.baselines.circuit.crossing import Crossing
from cable_envs.baselines.circuit_model import CircuitModel
from cable_envs.baselines.hole_model import HoleModel
from tests.support.baselines_support import ANCHORED, DT, FREE, GRASP, REFERENCES, rmse, simulate, step

SINE = REFERENCES["cable_hole", "tension", "sine"]
OTHER = {**ANCHORED, "friction_coefficient": 0.35, "load_stiffness": 3200.0, "cable_stiffness": 4e4}
"""A rig that the laws are not told."""


def tension(**gains):
    return make_controller("adaptive-inverse", "cable_hole", "tension", "tension", ANCHORED, DT, **gains)


def angle(**gains):
    return make_controller("virtual-jaw", "pulley_circuit", "position", "position", FREE, DT, **gains)


@pytest.mark.parametrize("true", [ANCHORED, OTHER])
def test_search_finds_the_friction_and_hardly_moves_the_load(true):
    """n from the pull at which the load gives way; it is seen late by 20 um of the drive and its filter: 3 %."""
    controller = tension(search=4.0)
    series = simulate(controller, step(0.0, 9.0, 20.0), 6.0, rig=true)
    assert math.exp(controller.fitted[1]) == pytest.approx(HoleModel(true).ratio(0.0, 20.0, 20.0), rel=0.03)
    assert 0.0 < -series["error"][-1] < 0.3
    assert np.ptp(series["u"][400:]) == 0.0  # it waits there


def test_search_ends_with_the_first_motion_of_the_reference():
    controller = tension(search=1.0)
    series = simulate(controller, step(5.0, 2.0, 20.0), 4.0)
    assert series["u"][150] - 20.0 == pytest.approx(1.51, abs=0.02)
    assert abs(series["error"][-1]) < 0.5


@pytest.mark.parametrize("true", [ANCHORED, OTHER])
@pytest.mark.parametrize("jump", [20.0, -12.0])
def test_crossing_takes_little_more_than_the_limits_of_the_drive(true, jump):
    """A path s from rest to rest takes at least v / a + s / v, with its limits. The load moves by jump / k_l; what the
    cable stretches, one sample until the jump is seen and periods of whole steps come on top: five periods."""
    controller = tension(search=4.0, brake=ANCHORED["drive_acceleration_limit"])
    series = simulate(controller, step(jump, 6.0, 30.0), 8.0, rig=true)
    fastest, most = ANCHORED["drive_speed_limit"], ANCHORED["drive_acceleration_limit"]
    least = fastest / most + abs(jump) / true["load_stiffness"] / fastest
    arrived = np.flatnonzero(np.abs(series["error"][600:]) < 0.1 * abs(jump))[0] * DT
    assert arrived < least + 5 * DT
    assert np.abs(series["error"][700:]).max() < 0.08 * abs(jump)


def test_search_and_crossing_pay():
    plain, both = tension(), tension(search=4.0, brake=2.0)
    errors = [rmse(simulate(c, step(20.0, 6.0, 20.0), 12.0, rig=OTHER)) for c in (plain, both)]
    assert errors[1] < 0.95 * errors[0]


@pytest.mark.parametrize("name", ["scheduled-pid", "lqg"])
def test_slew_follows_where_a_jump_is_cut(name):
    """A drive that gains a dt of speed in a period changes T1 by k a dt^2 in the next, 12.6 N. The hold is 27 N."""
    slew = ANCHORED["cable_stiffness"] * ANCHORED["drive_acceleration_limit"] * DT
    plain, slow = (
        simulate(make_controller(name, "cable_hole", "tension", "tension", ANCHORED, DT, slew=value), SINE, 12.0)
        for value in (0.0, slew)
    )
    assert np.abs(np.diff(slow["u"])).max() <= slew * DT * (1.0 + 1e-9)
    turned = int(1.25 / 0.17189 / DT) + 10  # what a first-order lag of 50 ms leaves of 27 N after 0.1 s: over 3 N
    behind = [
        np.abs(s["drive_tension"][turned : turned + 10] - s["u"][turned : turned + 10]).mean() for s in (plain, slow)
    ]
    assert behind[1] < 0.5 * behind[0]
    assert rmse(slow) < 0.75 * rmse(plain)


def test_crossing_of_an_angle_is_as_fast_as_a_drive_without_a_loop():
    """A double integrator with the drive's limits needs 2 sqrt(s / a), or v / a + s / v: 40 ms. The loop told the new
    angle at once takes 80 ms to come as near."""
    crossing, k, d = Crossing(FREE, 1.0, DT), FREE["servo_frequency"] ** 2, 2 * 0.9 * FREE["servo_frequency"]

    def path(command_of):
        a, v, last, seen = 0.0, 0.0, 0.0, []
        for _ in range(20):
            u = command_of(a, v, last)
            for _ in range(100):  # explicit, in small steps
                push = k * (u - a) + d * (min(max((u - last) / DT, -15.0), 15.0) - v)
                new = min(max(v + 1e-4 * min(max(push, -1e3), 1e3), -15.0), 15.0)
                a, v = a + 0.5e-4 * (v + new), new
            last = u
            seen.append(a)
        return np.array(seen)

    def crossed(a, v, last):
        return crossing.command(0.357, a, v, last) if crossing.on else 0.357

    crossing.begin()
    seen, plain = path(crossed), path(lambda a, v, last: 0.357)
    near = [np.flatnonzero(np.abs(s - 0.357) < 0.02)[0] + 1 for s in (seen, plain)]
    assert near[0] * DT <= 15.0 / 1e3 + 0.357 / 15.0 + 2 * DT and near[1] > near[0]
    assert np.abs(seen[near[0] :] - 0.357).max() < 0.02  # and it stays there
    assert not crossing.on


def test_edge_brings_the_drive_back_to_where_the_next_step_begins():
    """A search goes too far, and the drive gives back. Without ``edge`` it then waits on the far side of the hold."""
    found = {"misfit": 0.02, "beyond": 1.1e-3, "walk": 1.3e-5, "turn_time": 0.0227, "kp": 2.5e-3, "kd": 0.01, "ki": 0.3}
    gains = {**found, "search": 3.0, "tolerance": 1e-3}
    far, near = (
        simulate(
            make_controller("virtual-jaw", "pulley_circuit", "torque", "torque", GRASP, DT, **gains, edge=edge),
            step(0.1, 9.0, 0.05),
            9.5,
        )
        for edge in (0.0, 0.8)
    )
    plateau = CircuitModel(GRASP).ccw.drive_torque(0.05)
    assert far["drive_torque"][890] < 0.0 < 0.7 * plateau < near["drive_torque"][890] < plateau
    assert np.ptp(near["output_torque"][600:900]) < 1e-12  # what it holds does not move
    assert np.abs(near["error"][899:904]).sum() < 0.9 * np.abs(far["error"][899:904]).sum()


def test_hurry_pays_on_another_circuit():
    true = {**FREE, "pretension_top": 35.0, "pretension_bottom": 35.0, "tensile_stiffness": 2e4}
    slow, fast = (
        rmse(simulate(angle(turn_time=0.003, hurry=hurry), step(0.5, 6.0), 10.0, rig=true)) for hurry in (0.0, 0.95)
    )
    assert fast < 0.93 * slow  # two samples until the drive has moved are left in both
