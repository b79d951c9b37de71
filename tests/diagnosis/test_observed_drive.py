"""A drive on a belt whose controller is not recorded, made by classical Runge-Kutta steps, against its observer."""

import numpy as np
import pytest

from cable_envs.diagnosis import Recording
from cable_envs.diagnosis.systems import prepare

MASS, MOTOR, VISCOUS = 4.0, 0.8, 15.0
STEP, EVERY = 1e-4, 100


def _run(stiffness, damping, seconds=6.0):
    """Columns of a drive whose controller feels the motor, without noise."""

    def slope(t, s):
        x, v, xm, vm = s
        path = 0.03 * np.sin(4.0 * t) + 0.01 * np.sin(11.0 * t)
        rate = 0.12 * np.cos(4.0 * t) + 0.11 * np.cos(11.0 * t)
        force = 6000.0 * (path - xm) + 250.0 * (rate - vm)
        belt = stiffness * (xm - x) + damping * (vm - v)
        return np.array([v, (belt - VISCOUS * v) / MASS, vm, (force - belt) / MOTOR]), force

    s, rows = np.zeros(4), []
    for k in range(round(seconds / STEP)):
        t = k * STEP
        first, force = slope(t, s)
        if k % EVERY == 0:
            rows.append((t, s[0], force))
        second = slope(t + 0.5 * STEP, s + 0.5 * STEP * first)[0]
        third = slope(t + 0.5 * STEP, s + 0.5 * STEP * second)[0]
        last = slope(t + STEP, s + STEP * third)[0]
        s = s + STEP / 6.0 * (first + 2.0 * second + 2.0 * third + last)
    return dict(zip(("time", "position", "force"), np.array(rows).T, strict=True))


@pytest.mark.parametrize("damping", [5.0, 100.0])
def test_a_belt_drive_is_followed_whatever_its_damping(damping):
    """A servo on the motor gains 21 1/s; the belt loses 3.8 or 75."""
    recording = Recording.from_arrays(
        "linear_drive", {"one": _run(3e4, damping), "two": _run(3e4, damping)}, heldout="two", noise={"position": 1e-5},
        known={"motor_mass": MOTOR, "belt_stiffness": 3e4, "belt_damping": damping, "coulomb": 0.0},
        nominal={"mass": MASS, "viscous": VISCOUS},
    )  # fmt: skip
    model = prepare(recording).fit
    (predicted,) = model.predict(np.array([[p.start] for p in model.parameters]))
    left = (model.blocks[0].measured - predicted[:, 0])[model.blocks[0].good]
    assert np.sqrt(np.mean(left**2)) < 1e-5  # of a motion of 30 mm
