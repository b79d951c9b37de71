"""The chain circuit plant: spans and friction contacts against slow sweeps, the closed forms, and physics."""

import os
import subprocess
import sys

import numpy as np
import pytest

from cable_envs.physics import chain as side
from cable_envs.plants.circuit import closed_form as pulley_circuit
from cable_envs.plants.circuit.chain import PLANT
from cable_envs.plants.circuit.statics import Statics
from tests.plants.test_pulley_circuit import GEAR, elongation, random_columns
from tests.reference import circuit_reference as reference
from tests.support.circuit_rigs import Run, phase_order, pretension, ramp, sine, symmetric

TENSIONS = [f"tension_{end}_{cable}" for end in ("drive", "output") for cable in ("top", "bottom")]


def random_side(rng, largest_ratio):
    """One side, its lengths and its ratios."""
    length, ratio = rng.uniform(0.03, 0.2, 5), rng.uniform(1.0, largest_ratio, 4)
    small = side.RELEASE * length[:-1] * length[1:] / (length[:-1] + length[1:])
    own = (np.ascontiguousarray(row[:, None]) for row in (length, ratio, 1 / ratio, small))
    ends = (np.zeros(1), np.zeros(1), np.zeros(1))
    made = side.Side(np.zeros((5, 1)), np.zeros((4, 1)), *own, np.zeros((5, 1)), np.zeros((5, 1)), *ends)
    return made, length, ratio


@pytest.mark.parametrize("largest_ratio", [1.15, 5.0])
def test_equilibrium_equals_slow_sweeps_over_random_histories(largest_ratio):
    rng = np.random.default_rng(7)
    slack, swept = 0, 0
    for _ in range(8):
        cable, length, ratio = random_side(rng, largest_ratio)
        force = rng.uniform(1, 50)
        cable.stretch[:, 0] = force * length
        for step in range(30):
            ends = rng.normal(0, 0.3 if step % 3 == 0 else 0.02, 2) * force * length.sum()
            side.stretch_ends(cable, 0, ends[0], ends[1] * (step % 2), 0.0)
            trial = cable.pull[:, 0].copy()
            if all(side.relax(cable, 0) for _ in range(side.PASSES)):
                side.sweep(cable, 0)
                swept += 1
            tension, _ = reference.chain_equilibrium(trial, length, ratio)
            # the sweeps stop at 1e-16 of the stretch and converge linearly, slower the larger the ratios
            np.testing.assert_allclose(cable.tension[:, 0], tension, rtol=0, atol=1e-11 * max(tension.max(), force))
            side.settle(cable, 0, 0.0)
            assert cable.stretch.sum() == pytest.approx(
                trial.sum(), abs=1e-12 * force
            )  # cable is neither lost nor made
            slack += trial.sum() <= 0
    assert slack > 10
    assert swept <= 0.01 * 240  # active sets that run in circles are rare


def test_sweeps_that_back_up_the_active_sets_find_the_same_equilibrium():
    rng = np.random.default_rng(8)
    for _ in range(20):
        cable, length, ratio = random_side(rng, 2.0)
        cable.pull[:, 0] = 30 * length * rng.uniform(0.2, 3.0, 5)
        side.sweep(cable, 0)
        tension, slips = reference.chain_equilibrium(cable.pull[:, 0], length, ratio)
        np.testing.assert_allclose(cable.tension[:, 0], tension, rtol=1e-11)
        np.testing.assert_array_equal(cable.state[:, 0], np.sign(slips))


@pytest.mark.parametrize("newton", [12.5, 50.0, 150.0])
def test_zou_eq44_to_eq46_are_the_chain_in_monotonic_motion(newton):
    rig = pretension(newton, contact_stiffness=0.2, contact_angle=-1.0, cable_damping=0.0)
    statics = Statics.from_rig(rig)
    for start, direction in ((0.0, 1), (1.0, -1)):
        command = lambda t, d=direction, s=start: (s * 5 / 7 + 0.4 * t * d, 0.4 * d)  # noqa: E731
        run = Run(PLANT, rig, start).step(250, command, substeps=40, dt=2.5e-4)
        late = slice(150, 240)
        assert (run["phase"][late] == 3).all()
        closed = statics.working(run["drive_torque"][late], direction)
        np.testing.assert_allclose(closed.output_torque, run["output_torque"][late], atol=1e-12)  # sums of 1e2 N
        # the chain's arcs are exact while they slide; the step's own damping, dt (omega dt)^6 = 3 ns, times 0.1 rad/s
        np.testing.assert_allclose(closed.elongation_angle, elongation(run)[late], atol=2e-9)
        np.testing.assert_allclose(closed.tension_output_top, run["tension_output_top"][late], rtol=1e-10, atol=1e-10)
        np.testing.assert_allclose(closed.tension_output_bottom, run["tension_output_bottom"][late], atol=1e-10)


def test_dead_band_after_a_reversal_is_what_statics_and_sweeps_predict():
    run = Run(PLANT, pretension(50.0)).step(150, ramp(0.0, 0.2)).step(200, ramp(0.3, -0.1))
    phase, drive, d = run["phase"][100:], run["drive_angle"][100:], elongation(run)[100:]
    assert phase_order(phase) == [3, 1, 2, 3]
    turn = int(np.argmax(drive))
    working = int(np.flatnonzero(phase[turn + 3 :] == 3)[0]) + turn + 3
    statics = Statics.from_rig(pretension(50.0))
    ends = [statics.inverse(0.0, 0.0, direction).compensation[0] * GEAR for direction in (1, -1)]
    # output free: from working one way to working the other way D changes by the closed forms' dead band;
    # a control step is 1.4 mrad of it, and the output's inertia rings a little
    assert d[turn] - d[working] == pytest.approx(ends[0] - ends[1], abs=3e-3)

    chain = reference.Chain(50.0)  # delay: until the slip front reaches the output on one side, which holds
    chain.slide(*reference.working_state(float(statics.inverse(0.0, 0.0, 1).drive_torque[0]), 1, 50.0)[:2], 1)
    travel, slips = 0.0, {"t": np.zeros(4), "b": np.zeros(4)}
    while slips["t"][3] == slips["b"][3] == 0.0:
        slips = chain.move(-5e-4, 0.0)
        travel += 5e-4
    delay = np.flatnonzero(phase[turn:] == 2)[0] + turn
    assert drive[turn] - drive[delay] == pytest.approx(travel, abs=2.5e-3)  # two control steps of 1 mrad
    assert np.ptp(run["output_angle"][100:][turn + 3 : delay]) < 1e-5  # the output holds


def test_slip_front_travels_from_idler_to_idler():
    run = Run(PLANT, pretension(50.0)).step(150, ramp(0.0, 0.2)).step(120, ramp(0.3, -0.1))
    first = [int(np.flatnonzero(run[f"slip_bottom_{k}"][155:] != 0)[0]) for k in range(1, 5)]
    assert first == sorted(first) and first[3] > first[1] + 10
    assert {run[f"slip_bottom_{k}"][-1] for k in range(1, 5)} == {1.0}  # cable b is hauled in
    assert {run[f"slip_top_{k}"][-1] for k in range(1, 5)} == {-1.0}


def test_chain_and_closed_form_plants_agree_through_a_grasp():
    rig = pretension(50.0, contact_stiffness=0.3)
    chain = Run(PLANT, rig).step(500, sine(0.6, 2.5))
    closed = Run(pulley_circuit.PLANT, rig).step(500, sine(0.6, 2.5))
    working = (chain["phase"] == 3) & (closed["phase"] == 3)
    working &= np.convolve(working, np.ones(21), "same") > 20.5  # ten control steps away from any hold
    assert working.sum() > 250
    assert np.abs(chain["output_angle"] - closed["output_angle"])[working].max() < 1e-3  # of 0.7 rad
    assert np.abs(chain["output_torque"] - closed["output_torque"])[working].max() < 1e-3  # of 0.2 N m


def test_mirrored_circuit_moves_mirrored():
    rig = symmetric(contact_angle=-5.0)
    one, two = Run(PLANT, rig), Run(PLANT, rig)
    one.step(200, sine(0.5, 1.0))
    two.step(200, lambda t: tuple(-v for v in sine(0.5, 1.0)(t)))
    for name in ("drive_angle", "output_angle", "output_velocity", "drive_torque", "output_torque"):
        np.testing.assert_allclose(one[name], -two[name], rtol=0, atol=1e-10)  # rounding grows while it rings
    np.testing.assert_array_equal(one["phase"], two["phase"])


@pytest.mark.parametrize("rig", [{}, {"contact_stiffness": 2.0}, {"cable_damping": 0.0, "brake_torque": 0.02}])
@pytest.mark.parametrize("newton", [12.5, 50.0])
def test_energy_balance_friction_and_damping_take_never_give(newton, rig):
    run = Run(PLANT, pretension(newton, **rig)).step(4000, sine(0.6, 2.0), substeps=1, dt=5e-4)
    p = run.p[:, 0]
    states = np.array(run.states)
    stored = np.zeros(len(states))
    for first, rows in ((PLANT.row("stretch_top_0"), "top"), (PLANT.row("stretch_bottom_0"), "bottom")):
        length = p[[PLANT.coefficients.index(f"length_{rows}_{j}") for j in range(5)]]
        stored += (np.maximum(states[:, first : first + 5], 0) ** 2 / (2 * reference.EA * length)).sum(axis=1)
    mean = lambda name: 0.5 * (run[name][1:] + run[name][:-1])  # noqa: E731
    work = mean("drive_torque") * np.diff(run["drive_angle"]) - mean("output_torque") * np.diff(run["output_angle"])
    lost = work - np.diff(stored)
    assert lost.sum() > 1e-3 * np.abs(work).sum()
    # trapezoid over a step: exact for springs, wrong where a contact lets go within it, by a share of that step's work
    assert lost.min() > -0.02 * np.abs(work).max()
    assert (np.add.reduceat(lost, np.arange(0, 4000, 20)) > -1e-7).all()  # J, over every 10 ms


def test_slack_side_has_no_tension_and_comes_back():
    rig = pretension(12.5, contact_stiffness=2.0)
    run = Run(PLANT, rig).step(100, ramp(0.0, 0.5)).step(150, ramp(0.5, -0.5))
    assert run["tension_drive_bottom"][100] == run["tension_output_bottom"][100] == 0.0
    assert run["out_of_range"][100] == 1.0 and run["slack_fraction"][100] == 1.0
    assert min(run[name].min() for name in TENSIONS) >= 0.0
    assert run["tension_drive_bottom"][-1] > 10.0 and run["out_of_range"][-1] == 0.0
    total = sum(run[f"stretch_{s}_{j}"] for s in ("top", "bottom") for j in range(5))
    np.testing.assert_allclose(total, Statics.from_rig(rig).kappa3[0], rtol=1e-12)  # Eq. (36), slack or not


@pytest.mark.parametrize("rig", [{}, {"payload_mass": 0.2}, {"contact_stiffness": 0.5}, {"brake_torque": 0.01}])
def test_rests_for_an_hour(rig):
    run = Run(PLANT, rig, 0.3).step(1, substeps=3_600_000)
    first, last = run.states
    chain = slice(PLANT.row("stretch_top_0"), None)
    np.testing.assert_allclose(last[chain], first[chain], rtol=4e-16)  # the first balance may round once
    assert abs(last[PLANT.row("output_velocity")]) < 1e-12
    # spans hold exactly; the output may find its balance within the rounding of the tensions, 1e-14 N over 21 N m/rad
    assert last[PLANT.row("output_angle")] == pytest.approx(0.3, abs=1e-15)


def test_brake_holds_exactly():
    run = Run(PLANT, {"brake_torque": 0.05, "payload_mass": 0.05}, 0.2)
    run.step(200, lambda t, a=run.x[0, 0]: (a + 0.01, 0.0))
    assert np.ptp(run["output_angle"]) == 0.0
    assert np.ptp(run["drive_angle"]) > 0.0099


def final_state(substeps: int, damping: float) -> np.ndarray:
    """All contacts slide all the time; torque mode against a spring."""
    rig = pretension(100.0, contact_stiffness=0.3, contact_angle=-1.0, drive_torque_limit=2.0, cable_damping=damping)
    run = Run(PLANT, rig, 0.0, "torque")
    run.step(1, lambda t: (1.0, 0.0), substeps=2000, dt=2e-5)  # off to a running start
    assert (np.abs(run.x[[PLANT.row(f"slip_{s}_{k}") for s in ("top", "bottom") for k in range(1, 5)]]) == 1).all()
    run.step(1, substeps=substeps, dt=0.016 / substeps)
    assert run["phase"][-1] == 3 and run["output_velocity"][-1] > 1.0
    return run.x[:6, 0].copy()


@pytest.mark.parametrize(("damping", "order"), [(0.0, 2.0), (8.0, 2.0)])
def test_step_halving_where_smooth(damping, order):
    exact = final_state(8192, damping)
    errors = np.array([np.abs(final_state(n, damping) - exact)[[0, 3]].max() for n in (32, 64, 128, 256)])
    assert errors[0] < 3e-4  # rad at 0.5 ms
    assert np.log2(errors[0] / errors[-1]) / 3 == pytest.approx(order, abs=0.15)


def test_scalar_column_equals_batch_column_bit_by_bit():
    values, commands = random_columns(np.random.default_rng(5), 70)
    p = PLANT.prepare(values)
    x = PLANT.rest(p, np.zeros(70))
    alone = [np.ascontiguousarray(x[:, k : k + 1]) for k in range(70)]
    for step in range(30):
        u = np.ascontiguousarray(commands[:, step])
        PLANT.advance(x, p, u, 0, 70, 10, 1e-3)
        for k in range(0, 70, 3):
            columns = (np.ascontiguousarray(a[:, k : k + 1]) for a in (p, u))
            PLANT.advance(alone[k], *columns, 0, 1, 10, 1e-3)
            np.testing.assert_array_equal(alone[k][:, 0], x[:, k])
    assert np.isfinite(x).all()


@pytest.mark.nojit
def test_plain_python_agrees_with_the_compiled_kernel():
    code = (
        "import numpy as np\n"
        "from cable_envs.plants.circuit.chain import PLANT\n"
        "from tests.plants.test_pulley_circuit import random_columns\n"
        "v, c = random_columns(np.random.default_rng(4), 3)\n"
        "p = PLANT.prepare(v); x = PLANT.rest(p, np.zeros(3))\n"
        "for k in range(3): PLANT.advance(x, p, np.ascontiguousarray(c[:, k]), 0, 3, 10, 1e-3)\n"
        "print(x.ravel().tolist())\n"
    )
    plain, compiled = (
        np.array(eval(subprocess.run([sys.executable, "-c", code], env=os.environ | {"NUMBA_DISABLE_JIT": flag},
                                     check=True, capture_output=True, text=True).stdout))
        for flag in ("1", "0")
    )  # fmt: skip
    np.testing.assert_allclose(plain, compiled, rtol=1e-9, atol=1e-11)  # fused multiply-adds in exp and log only
