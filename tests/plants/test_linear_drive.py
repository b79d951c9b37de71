"""A carriage behind a belt, against an independent solution of its equations of motion."""

import numpy as np
from scipy.integrate import solve_ivp

from cable_envs.plants import plant_for
from cable_envs.sim.replay import replay

PLANT = plant_for("linear_drive")
PERIOD, MASS, MOTOR, STIFFNESS, DAMPING, VISCOUS = 0.01, 10.0, 1.0, 2e4, 50.0, 20.0
FORCE = np.where(np.arange(100) % 40 < 20, 50.0, -40.0)
STATES = ("position", "velocity", "motor_position", "motor_velocity")


def solved():
    """State [T, 4] by SciPy, without dry friction."""

    def rates(t, y, force):
        x, v, xm, vm = y
        belt = STIFFNESS * (xm - x) + DAMPING * (vm - v)
        return [v, (belt - VISCOUS * v) / MASS, vm, (force - belt) / MOTOR]

    y, rows = np.zeros(4), []
    for force in FORCE:
        y = solve_ivp(rates, (0.0, PERIOD), y, args=(force,), rtol=1e-11, atol=1e-13).y[:, -1]
        rows.append(y)
    return np.array(rows)


def errors(substeps, truth):
    """Largest error of each state over its range."""
    values = {"belt_stiffness": STIFFNESS, "belt_damping": DAMPING, "coulomb": 0.0, "viscous": VISCOUS}
    column = PLANT.table.pack({**values, "mass": MASS, "motor_mass": MOTOR})[:, None]
    found = replay(PLANT, column, FORCE, PERIOD, drive="force", hold="step", signals=STATES, substeps=substeps)
    return np.abs(found[:, :, 0] - truth).max(axis=0) / np.ptp(truth, axis=0)


def test_motor_and_carriage_behind_a_belt_are_solved_to_second_order():
    """The belt swings at 150 rad/s: 40 substeps of 0.25 ms."""
    truth = solved()
    coarse, middle, fine = (errors(n, truth) for n in (10, 20, 40))
    np.testing.assert_allclose(coarse / middle, 4.0, rtol=0.05)
    np.testing.assert_allclose(middle / fine, 4.0, rtol=0.05)
    assert fine.max() < 2e-4
