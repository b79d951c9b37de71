"""The rotary joint: against SciPy's integration of its equations, limits, gear, supply, heat, and what it is told."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from cable_envs.plants import plant_for
from cable_envs.sim.replay import replay

PLANT = plant_for("rotary_joint")
NAMES = [s.name for s in PLANT.signals]
PERIOD, STEPS = 0.01, 150
TIME = PERIOD * np.arange(1, STEPS + 1)
WAVE = np.sin(2.0 * np.pi * 0.7 * TIME)
FRICTIONLESS = {"coulomb": 0.0, "viscous": 0.0}


def run(command=WAVE, drive="position", substeps=20, start=0.0, hold="ramp", second=None, **values):
    """Every signal [T] by name, of a joint with the defaults besides ``values``."""
    column = PLANT.table.pack({name.replace("__", "."): v for name, v in values.items()})[:, None]
    found = replay(
        PLANT, column, command, PERIOD, drive=drive, hold=hold, signals=NAMES, substeps=substeps, start=start,
        second=second,
    )  # fmt: skip
    return dict(zip(NAMES, found[:, :, 0].T, strict=True))


def solved(
    command=WAVE, start=0.0, gain=1.0, driving=0.0, backdriving=0.0, sag=0.0, coulomb=0.0, growth=0.0, cool=20.0,
    drop=0.0,
):  # fmt: skip
    """(angle, warming) [T, 2] by SciPy: the printed equations by cases, a friction that is a steep function at rest."""
    rotor, load, weight, k, ohm, volts = 2e-3, 0.5 * 0.1**2, 0.5 * 9.81 * 0.1, 0.4, 3.0, 7.4

    def rates(t, state, asked, before):
        q, v, h = state
        now = before + (asked - before) * (t % PERIOD if t % PERIOD > 1e-12 else 0.0) / PERIOD
        u = min(max(gain * (now - q), -1.0), 1.0)
        i = (u * volts - k * v) / (ohm * (1.0 + h) + sag * abs(u))
        way = np.tanh(v / 1e-4)
        net, needs = k * i / (1.0 + drop * abs(i)) - 5e-3 * v - coulomb * way, weight * np.sin(q)
        # the gear: T' = T (1 + driving) where T v > 0, T (1 - backdriving) where T v < 0, T what the load takes
        a = (net - needs) / (rotor + load)
        for _ in range(50):  # a loss that follows the motion, by iteration
            passed = needs + load * a
            lost = way * (driving if passed * v > 0.0 else backdriving) * abs(passed)
            new = (net - needs - lost) / (rotor + load)
            if abs(new - a) < 1e-12:
                break
            a = new
        return [v, a, growth * ohm * (1.0 + h) * i * i - h / cool]

    state, rows, before = np.array([start, 0.0, 0.0]), [], command[0]
    for n, asked in enumerate(command):
        span = (n * PERIOD, (n + 1) * PERIOD)

        def of(t, y, at=span[0], asked=asked, before=before):
            return rates(t - at, y, asked, before)

        state = solve_ivp(of, span, state, method="LSODA", rtol=1e-8, atol=1e-10).y[:, -1]
        rows.append(state)
        before = asked
    return np.array(rows)


@pytest.mark.parametrize(("changes", "own", "within"), [
    ({}, {}, 1e-4),
    ({"supply_sag__resistance": 1.5}, {"sag": 1.5}, 1e-4),
    ({"torque_saturation__drop": 0.4}, {"drop": 0.4}, 1e-4),
    ({"winding_heating__growth": 0.3}, {"growth": 0.3}, 1e-4),
    # friction: SciPy's is not set-valued but turns round within 0.1 mrad/s
    ({"coulomb": 0.03, "gear_friction__driving": 0.4, "gear_friction__backdriving": 0.3},
     {"coulomb": 0.03, "driving": 0.4, "backdriving": 0.3}, 3e-3),
])  # fmt: skip
def test_it_is_what_scipy_integrates(changes, own, within):
    found, truth = run(substeps=60, **{"coulomb": 0.0, **changes}), solved(**own)
    assert np.abs(found["position"] - truth[:, 0]).max() < within * np.ptp(truth[:, 0])
    np.testing.assert_allclose(found["warming"], truth[:, 2], atol=1e-3 * max(truth[:, 2].max(), 1e-9))


def test_the_step_is_of_second_order():
    changes = {
        "coulomb": 0.0, "gear_friction__driving": 0.0, "supply_sag__resistance": 1.0, "torque_saturation__drop": 0.4,
    }  # fmt: skip
    truth = run(substeps=640, **changes)["position"]
    errors = [np.abs(run(substeps=n, **changes)["position"] - truth).max() for n in (10, 20, 40)]
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.2) and errors[1] / errors[2] == pytest.approx(4.0, rel=0.2)


def test_small_swings_of_a_released_joint_are_those_of_a_pendulum():
    off = np.ones(STEPS)
    found = run(np.zeros(STEPS), start=0.05, second=off, **FRICTIONLESS)
    assert np.all(found["current"] == 0.0) and np.all(found["duty"] == 0.0)
    w = np.sqrt(0.5 * 9.81 * 0.1 / (2e-3 + 5e-3))
    # a swing of 0.05 rad is slower by 0.05^2 / 16
    np.testing.assert_allclose(found["position"], 0.05 * np.cos(w * TIME), atol=0.05 * 3e-3)


def test_at_rest_the_motor_holds_the_load_with_the_printed_duty():
    angle = 0.6
    rig = PLANT.table.pack({"supply_sag.resistance": 1.0, "torque_saturation.drop": 0.4})
    x = PLANT.rest(PLANT.prepare(rig[:, None]), np.array([angle]))[:, 0]
    torque = 0.5 * 9.81 * 0.1 * np.sin(angle)
    duty, current = x[PLANT.row("duty")], x[PLANT.row("current")]
    assert 0.4 * current / (1.0 + 0.4 * current) == pytest.approx(torque, rel=1e-12)
    assert duty * 7.4 == pytest.approx(current * (3.0 + 1.0 * duty), rel=1e-12)
    reference = x[PLANT.row("held_reference")]
    motor = {"supply_sag__resistance": 1.0, "torque_saturation__drop": 0.4}
    still = run(np.full(STEPS, reference), start=angle, coulomb=0.0, **motor)
    np.testing.assert_allclose(still["position"], angle, atol=1e-12)


def test_where_no_current_holds_the_load_all_that_the_amplifier_gives_is_reported():
    """0.4 N m / A with half of the torque lost at 0.2 A make 0.08 N m at most, and the load takes 0.28 N m."""
    rig = PLANT.table.pack({"torque_saturation.drop": 5.0, "current_limit": 2.0})
    x = PLANT.rest(PLANT.prepare(rig[:, None]), np.array([0.6]))[:, 0]
    assert x[PLANT.row("current")] == 2.0 and x[PLANT.row("duty")] == pytest.approx(2.0 * 3.0 / 7.4)


def test_a_gear_lifts_with_more_and_lets_down_with_less_and_holds_between():
    """Constant slow motion: the torque is load (1 + driving) up and load (1 - backdriving) down."""
    slow = {"position_gain": 10.0, "coulomb": 0.0, "viscous": 0.05}
    losses = {"gear_friction__driving": 0.5, "gear_friction__backdriving": 0.25}
    ramp = 0.3 + 0.1 * TIME
    for path, share in ((ramp, 1.5), (ramp[::-1], 0.75)):
        found = run(path, start=path[0], **slow, **losses)
        lifted = found["torque"] - 0.05 * found["velocity"]
        # the speed still changes by 1 % of a second's gravity
        np.testing.assert_allclose(lifted[-30:], share * found["load_torque"][-30:], rtol=5e-3)
    load = 0.5 * 9.81 * 0.1 * np.sin(0.4)
    for share, moves in ((1.45, 0), (1.55, 1), (0.8, 0), (0.7, -1)):
        duty = np.full(STEPS, share * load / 0.4 * 3.0 / 7.4)
        found = run(duty, "duty", start=0.4, hold="step", coulomb=0.0, **losses)
        assert np.sign(found["position"][-1] - 0.4) == moves


def test_a_gear_only_takes_energy():
    """Released and without any other friction, the sum of both energies never grows, with losses of each kind."""
    off = np.ones(STEPS)
    for losses in ((0.6, 0.0), (0.0, 0.6), (0.4, 0.4)):
        found = run(
            np.zeros(STEPS), start=1.2, second=off, substeps=200, gear_friction__driving=losses[0],
            gear_friction__backdriving=losses[1], **FRICTIONLESS,
        )  # fmt: skip
        energy = 0.5 * 7e-3 * found["velocity"] ** 2 + 0.4905 * (1.0 - np.cos(found["position"]))
        assert np.diff(energy).max() < 1e-6 * energy[0] and energy[-1] < 0.9 * energy[0]


def test_limits_of_duty_and_current_hold():
    found = run(np.full(STEPS, 3.0), gear_friction__driving=0.2, current_limit=1.2, duty_limit=0.8)
    assert found["duty"].max() == 0.8 and found["current"].max() <= 1.2
    assert run(np.full(STEPS, 3.0))["duty"].max() == 1.0


def test_dead_band_and_steps_act_on_the_duty_and_a_delay_on_the_command():
    plain = run(WAVE, "duty", hold="step", coulomb=0.0)
    band = run(WAVE, "duty", hold="step", coulomb=0.0, dead_band__width=0.2)
    np.testing.assert_allclose(band["duty"], np.sign(WAVE) * np.maximum(np.abs(WAVE) - 0.2, 0.0), atol=1e-12)
    steps = run(WAVE, "duty", hold="step", coulomb=0.0, quantised_command__steps=10.0)
    np.testing.assert_allclose(steps["duty"], np.round(10.0 * WAVE) / 10.0, atol=1e-12)
    late = run(WAVE, "duty", hold="step", coulomb=0.0, command_delay__time=3 * PERIOD)
    np.testing.assert_allclose(late["position"][3:], run(np.r_[[WAVE[0]] * 3, WAVE[:-3]], "duty", hold="step",
                               coulomb=0.0)["position"][3:], atol=1e-12)  # fmt: skip
    assert np.abs(late["position"] - plain["position"]).max() > 0.01


def test_a_spring_and_gravity_are_balanced_where_their_torques_are_equal():
    found = run(
        np.zeros(4 * STEPS), start=0.5, second=np.ones(4 * STEPS), position_dependent_load__stiffness=0.4,
        position_dependent_load__neutral=1.0, coulomb=0.0, viscous=0.05,
    )  # fmt: skip
    rest = found["position"][-1]
    assert 0.4905 * np.sin(rest) == pytest.approx(0.4 * (1.0 - rest), abs=1e-4)


def test_a_gear_that_loses_all_of_a_load_that_drives_holds_it():
    """Self-locking: backdriving (1 + rise) is above 1 at standstill, so no load moves a released joint."""
    for losses in ({"gear_friction__backdriving": 0.99, "gear_friction__rise": 0.5}, {}):
        found = run(np.zeros(STEPS), start=1.0, second=np.ones(STEPS), coulomb=0.0, **losses)
        assert (found["position"][-1] == 1.0) == bool(losses)
