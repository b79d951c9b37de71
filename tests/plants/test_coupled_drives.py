"""Two motors, a belt, a sprung pulley: against an independent solution, limits, and energy."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from cable_envs.plants.coupled_drives.plant import PLANT, SIGNALS
from cable_envs.sim.replay import replay

PERIOD, STEPS = 0.02, 200
NAMES = [s.name for s in SIGNALS]
VOLTAGE = np.where(np.arange(STEPS) % 70 < 35, 2.0, -1.5)


def run(voltage=VOLTAGE, substeps=20, **values):
    """Every signal [T, k] of a rig with the defaults besides ``values``."""
    column = PLANT.table.pack(values)[:, None]
    return replay(
        PLANT, column, voltage, PERIOD, drive="voltage", hold="step", signals=NAMES, substeps=substeps,
        rate=np.diff(voltage, prepend=0.0) / PERIOD,
    )[:, :, 0]  # fmt: skip


def signal(found, name):
    return found[:, NAMES.index(name)]


def solved(mass=10.0, pulley=0.5, k=150.0, c=3.0, viscous=50.0, gain=20.0, voltage=VOLTAGE):
    """State [T, 4] by SciPy: the equations of motion alone, without dry friction."""

    def rates(t, y):
        x, v, xp, vp = y
        belt = k * (x - xp) + c * (v - vp)
        u = voltage[min(int(t / PERIOD), len(voltage) - 1)]
        return [v, (gain * u - viscous * v - belt) / mass, vp, belt / pulley]

    y, rows = np.zeros(4), []
    for n in range(len(voltage)):
        span = ((n + 1e-9) * PERIOD, (n + 1 - 1e-9) * PERIOD)
        y = solve_ivp(rates, span, y, rtol=1e-10, atol=1e-12).y[:, -1]
        rows.append(y)
    return np.array(rows)


def test_it_is_what_scipy_integrates():
    truth, found = solved(), run(substeps=40)
    for k, name in enumerate(["motor_position", "motor_velocity", "pulley_position", "pulley_velocity"]):
        assert np.abs(signal(found, name) - truth[:, k]).max() < 1e-5 * np.ptp(truth[:, k]), name
    np.testing.assert_allclose(signal(found, "speed_reading"), 10.0 * signal(found, "pulley_velocity"), rtol=1e-12)


def test_the_step_is_of_second_order():
    truth = solved()[:, 3]
    errors = [np.abs(signal(run(substeps=n), "pulley_velocity") - truth).max() for n in (5, 10, 20)]
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.15) and errors[1] / errors[2] == pytest.approx(
        4.0, rel=0.15
    )


def test_dry_friction_holds_what_is_below_it_and_takes_its_share_of_the_force():
    still = run(np.full(STEPS, 0.9), coulomb=20.0)
    assert np.all(signal(still, "pulley_velocity") == 0.0)
    sliding = run(np.full(2000, 2.0), coulomb=20.0)
    assert signal(sliding, "motor_velocity")[-1] == pytest.approx((2.0 * 20.0 - 20.0) / 50.0, rel=1e-6)


def test_a_detector_cuts_off_or_turns_round_and_is_curved():
    plain = run()
    speed = signal(plain, "speed_reading")
    assert speed.min() < -1.0
    for share, shown in ((1.0, np.maximum(speed, 0.0)), (2.0, np.abs(speed))):
        got = signal(run(**{"sensor_rectification.share": share}), "speed_reading")
        np.testing.assert_allclose(got, shown, atol=1e-12)
    curved = signal(run(reading_zero=0.3, **{"detector_power.power": 1.5}), "speed_reading")
    np.testing.assert_allclose(curved, 0.3 + np.sign(speed) * np.abs(speed) ** 1.5, atol=1e-9)


def test_a_lag_is_a_first_order_one_from_the_first_sample_on():
    """Behind a light pulley on a stiff belt the motors' speed is two first-order lags in series."""
    lag, time = 0.08, 10.001 / 50.0
    rig = {"pulley_mass": 1e-3, "belt_stiffness": 1e3, "actuator_lag.time": lag}
    found = signal(run(np.full(STEPS, 1.0), 40, **rig), "motor_velocity")
    t = PERIOD * np.arange(1, STEPS + 1)
    exact = 20.0 / 50.0 * (1.0 - (time * np.exp(-t / time) - lag * np.exp(-t / lag)) / (time - lag))
    np.testing.assert_allclose(found, exact, atol=5e-4 * exact[-1])


def test_what_friction_takes_is_what_the_motors_give():
    found = run(viscous=0.0, belt_damping=0.0, substeps=80)
    x, v, xp, vp = (
        signal(found, n) for n in ("motor_position", "motor_velocity", "pulley_position", "pulley_velocity")
    )
    energy = 5.0 * v**2 + 0.25 * vp**2 + 75.0 * (x - xp) ** 2
    work = np.cumsum(20.0 * VOLTAGE * np.diff(x, prepend=0.0))
    np.testing.assert_allclose(energy, work, atol=1e-3 * energy.max())
