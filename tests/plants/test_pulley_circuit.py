"""The analytic circuit plant: Eqs. (32)-(47) of Zou 2022 between two inertias, set-valued friction at the output."""

import os
import subprocess
import sys

import numpy as np
import pytest

from cable_envs.core.errors import ConfigurationError
from cable_envs.core.inputs import INPUTS
from cable_envs.plants.circuit import chain as pulley_chain
from cable_envs.plants.circuit.closed_form import PLANT
from cable_envs.plants.circuit.ends import cosine
from cable_envs.plants.circuit.statics import Statics
from cable_envs.sim.rigs import load_rig
from tests.support.circuit_rigs import Run, phase_order, pretension, ramp, sine, symmetric

GEAR = 7 / 5
GRASP = {"contact_stiffness": 0.2, "contact_angle": -3.0, "cable_damping": 0.0}
"""a spring at the output in both directions of motion; without cable damping, which the closed forms do not have"""


def elongation(run: Run) -> np.ndarray:
    return run["drive_angle"] * GEAR - run["output_angle"]


@pytest.mark.parametrize(("newton", "start"), [(12.5, 0.0), (50.0, 0.0), (150.0, -1.0)])
def test_zou_eq44_to_eq46_hold_in_motion(newton, start):
    rig = pretension(newton, contact_stiffness=0.2, contact_angle=start, cable_damping=0.0)
    small = {"substeps": 40, "dt": 2.5e-4}
    run = Run(PLANT, rig, start).step(250, lambda t: (start * 5 / 7 + 0.4 * t, 0.4), **small)
    back = Run(PLANT, rig, start + 1.5).step(250, lambda t: ((start + 1.5) * 5 / 7 - 0.4 * t, -0.4), **small)
    statics = Statics.from_rig(rig)
    for one, direction in ((run, 1), (back, -1)):
        late = slice(150, 240)
        assert (one["phase"][late] == 3).all()
        closed = statics.working(one["drive_torque"][late], direction)
        np.testing.assert_allclose(closed.output_torque, one["output_torque"][late], atol=1e-14)  # rounding
        # the step's own damping: dt (omega dt)^6 = 0.1 ns, times 0.1 rad/s
        np.testing.assert_allclose(closed.elongation_angle, elongation(one)[late], atol=1e-10)
        np.testing.assert_allclose(closed.tension_output_top, one["tension_output_top"][late], rtol=1e-12, atol=1e-12)
        np.testing.assert_array_equal(closed.out_of_range, one["out_of_range"][late])


def test_hold_after_a_reversal_is_as_long_as_the_closed_forms_say():
    rig = pretension(50.0)
    run = Run(PLANT, rig).step(100, ramp(0.0, 0.2)).step(150, ramp(0.2, -0.2))
    statics = Statics.from_rig(rig)
    ends = [statics.inverse(0.0, 0.0, direction).compensation[0] for direction in (1, -1)]
    phase, angle = run["phase"], run["drive_angle"]
    assert phase_order(phase[60:]) == [3, 1, 3]
    hold = np.flatnonzero(phase[60:] == 1) + 60
    # resolution: a control step of 2 mrad at either end, and the load of 0.1 mN m from the output's own damping
    assert angle[hold[0] - 1 : hold[0] + 1].max() - angle[hold[-1]] == pytest.approx(ends[0] - ends[1], abs=3e-3)
    assert np.ptp(run["output_angle"][hold]) == 0.0  # Eq. (47): output unchanged
    assert np.ptp(run["output_torque"][hold]) < 1e-13


def test_drive_torque_is_continuous_through_the_hold():
    run = Run(PLANT, pretension(50.0)).step(100, ramp(0.0, 0.2)).step(150, ramp(0.2, -0.2))
    assert np.ptp(run["drive_torque"]) > 0.3  # from one working branch to the other
    # in the hold M_in is at most 1.6 times as steep as on a branch, EA R0^2 2 / L = 3.8 N m/rad; damping adds 5 %
    assert np.abs(np.diff(run["drive_torque"]) / np.abs(np.diff(run["drive_angle"])).max()).max() < 6.5


@pytest.mark.parametrize("rig", [{}, {"payload_mass": 0.2}, {"contact_stiffness": 0.5}, {"pretension_top": 40.0}])
@pytest.mark.parametrize("mode", ["position", "torque"])
def test_sticks_exactly_for_an_hour(rig, mode):
    run = Run(PLANT, rig, 0.3, mode).step(1, substeps=3_600_000)
    first, last = run.states
    np.testing.assert_array_equal(first, last)


def test_hold_rule_of_eq_47_keeps_a_loaded_output_until_the_drive_torque_turns():
    release = {}
    for rule in (0.0, 1.0):
        rig = GRASP | {"contact_angle": -1.0, "hold_rule": rule}
        run = Run(PLANT, rig, 0.0).step(200, ramp(0.0, 0.2)).step(60, ramp(0.4, -0.4))
        held = np.flatnonzero(run["output_angle"][201:] == run["output_angle"][201]) + 201
        assert np.ptp(held) == len(held) - 1  # one uninterrupted hold
        release[rule] = run["drive_torque"][held[-1]]
    assert release[0.0] > 0.2  # friction lets go while the drive still holds against its load
    assert abs(release[1.0]) < 0.02  # Eq. (47): when M_in changes its sign; a control step is 15 mN m


def test_mirrored_circuit_moves_mirrored():
    rig = symmetric(contact_angle=-5.0)
    one, two = Run(PLANT, rig), Run(PLANT, rig)
    one.step(200, sine(0.5, 1.0))
    two.step(200, lambda t: tuple(-v for v in sine(0.5, 1.0)(t)))
    for name in ("drive_angle", "output_angle", "output_velocity", "drive_torque", "output_torque"):
        np.testing.assert_allclose(one[name], -two[name], rtol=0, atol=1e-12)  # sums in another order
    np.testing.assert_allclose(one["tension_drive_top"], two["tension_drive_bottom"], rtol=1e-11)


@pytest.mark.parametrize("newton", [12.5, 50.0])
def test_energy_friction_and_damping_take_never_give(newton):
    rig = pretension(newton, contact_stiffness=0.3, output_damping=0.0)
    run = Run(PLANT, rig).step(6000, sine(0.8, 2.0), substeps=1)
    cycle = slice(2001, 4002)  # from cycle to cycle the stored energy is the same
    work_in = np.trapezoid(run["drive_torque"][cycle], run["drive_angle"][cycle])
    work_out = np.trapezoid(run["output_torque"][cycle], run["output_angle"][cycle])
    assert work_in > 0.01
    assert abs(work_out) < 2e-3 * work_in  # an elastic object; 1 ms steps and the output's inertia
    moving = np.abs(run["output_velocity"]) > 0
    loss = run["drive_torque"] / GEAR * run["output_velocity"] - run["output_torque"] * run["output_velocity"]
    slow = moving & (np.abs(run["drive_velocity"] * GEAR - run["output_velocity"]) < 1e-2)
    assert (loss[slow] > 0).all()  # at constant D all that does not come out is friction


def test_slack_cable_has_no_tension_and_is_reported():
    run = Run(PLANT, pretension(12.5, contact_stiffness=2.0)).step(100, ramp(0.0, 0.5))
    assert run["tension_drive_bottom"][-1] == run["tension_output_bottom"][-1] == 0.0
    assert run["out_of_range"][-1] == 1.0 and run["slack_fraction"][-1] == 1.0
    assert run["drive_torque"][-1] == pytest.approx(7e-3 * run["tension_drive_top"][-1], rel=1e-14)
    names = [f"tension_{end}_{side}" for end in ("drive", "output") for side in ("top", "bottom")]
    assert min(run[name].min() for name in names) >= 0.0
    partly = run["slack_fraction"]
    assert ((partly > 0) & (partly < 1)).sum() == 1  # the one control step in which it went slack
    assert (run["peak_tension"] >= run["tension_drive_top"]).all()


def final_state(substeps: int) -> np.ndarray:
    """A smooth stretch in torque mode: both pulleys move ccw against a spring and a payload all the time."""
    rig = pretension(100.0, contact_stiffness=0.3, contact_angle=-1.0, payload_mass=0.02, drive_torque_limit=2.0)
    run = Run(PLANT, rig, 0.0, "torque")
    statics = Statics.from_rig(rig)
    wanted = statics.inverse(0.0, 0.3 + 0.02 * 15e-3 * 9.81, 1)
    run.x[PLANT.row("drive_angle")] = wanted.drive_angle
    run.x[PLANT.row("drive_velocity")] = 5.0
    run.x[PLANT.row("output_velocity")] = 7.0
    run.u[0] = wanted.drive_torque + 0.1
    run.step(1, substeps=substeps, dt=0.02 / substeps)
    assert run["output_velocity"][-1] > 1.0 and run["slack_fraction"][-1] == 0.0
    return run.x[:6, 0].copy()


def test_step_halving_is_second_order_where_smooth():
    exact = final_state(20480)
    errors = np.array([np.abs(final_state(n) - exact) for n in (20, 40, 80, 160)])
    order = np.log2(errors[0] / errors[-1]) / 3.0
    assert order[[0, 1, 2, 3, 5]] == pytest.approx(2.0, abs=0.15)
    assert order[4] > 1.5  # the output's speed still rings a little at the end, and its errors pass through zero
    assert (errors[0, [0, 3]] < 2e-5).all()  # rad, at 1 ms: vibrations are in time to order 4


def test_scalar_column_equals_batch_column_bit_by_bit():
    rng = np.random.default_rng(3)
    values, commands = random_columns(rng, 70)
    p, x = PLANT.prepare(values), None
    x = PLANT.rest(p, np.zeros(70))
    alone = [np.ascontiguousarray(x[:, k : k + 1]) for k in range(70)]
    for step in range(30):
        u = np.ascontiguousarray(commands[:, step])
        PLANT.advance(x, p, u, 0, 70, 10, 1e-3)
        for k in range(0, 70, 7):
            columns = (np.ascontiguousarray(a[:, k : k + 1]) for a in (p, u))
            PLANT.advance(alone[k], *columns, 0, 1, 10, 1e-3)
            np.testing.assert_array_equal(alone[k][:, 0], x[:, k])
    assert np.isfinite(x).all()


def random_columns(rng: np.random.Generator, n: int):
    """Rigs scattered by 20 %, some of them grasping, braking, at 12.5 N; commands of both modes [inputs, steps, n]."""
    table = PLANT.parameters
    values = np.repeat(table.pack({"breaking_tension": 1e3})[:, None], n, axis=1)
    values *= rng.uniform(0.8, 1.2, values.shape)
    values[table.index("idlers_fixed")] = 0.0
    values[table.index("contact_stiffness")] = rng.choice([0.0, 0.5, 2.0], n)
    values[table.index("brake_torque")] = rng.choice([0.0, 0.02], n)
    values[table.index("hold_rule")] = rng.choice([0.0, 1.0], n)
    values[table.index("pretension_top")] = values[table.index("pretension_bottom")] = rng.choice([12.5, 50.0], n)
    commands = np.zeros((len(INPUTS), 30, n))
    drawn = rng.uniform(-0.6, 0.6, (4, 30, n))
    commands[0], commands[2], commands[3] = drawn[0], rng.integers(0, 2, n), 0.02 * drawn[3]
    return values, commands


@pytest.mark.parametrize("plant", [PLANT, pulley_chain.PLANT], ids=lambda p: p.name)
@pytest.mark.parametrize("mode", [0.0, 1.0])
def test_a_nan_shows_in_the_peak_tension_and_stays_in_its_column(plant, mode):
    p = plant.prepare(np.repeat(plant.parameters.pack({})[:, None], 3, axis=1))
    x, u = plant.rest(p, np.zeros(3)), np.zeros((len(INPUTS), 3))
    u[2], u[0, 1] = mode, np.nan
    plant.advance(x, p, u, 0, 3, 10, 1e-3)
    np.testing.assert_array_equal(np.isnan(x[plant.row("peak_tension")]), [False, True, False])
    np.testing.assert_array_equal(x[:, 0], x[:, 2])


@pytest.mark.parametrize("plant", [PLANT, pulley_chain.PLANT], ids=lambda p: p.name)
def test_stiff_light_and_nearly_undamped_rigs_stay_bounded(plant):
    rng, n = np.random.default_rng(2), 128
    index = plant.parameters.index
    values = np.repeat(plant.parameters.pack({"breaking_tension": 1e5})[:, None], n, axis=1)
    for name, low, high in (
        ("output_inertia", 1e-6, 1e-3), ("drive_inertia", 1e-5, 1e-2), ("tensile_stiffness", 2e3, 2e5),
        ("contact_stiffness", 0.01, 50), ("cable_damping", 0.01, 50), ("pretension_top", 1, 150),
        ("pretension_bottom", 1, 150), ("shaft_friction", 1e-3, 0.5), ("output_damping", 1e-6, 1e-2),
    ):  # fmt: skip
        values[index(name)] = np.exp(rng.uniform(np.log(low), np.log(high), n))
    commands = rng.uniform(-1, 1, (10, n))
    mode = rng.choice([0.0, 1.0], n)
    peaks = []
    for substeps in (10, 100):
        p = plant.prepare(values)
        plant.raise_to(p, 0.01 / substeps)
        x, u, peak = plant.rest(p, np.zeros(n)), np.zeros((len(INPUTS), n)), np.zeros(n)
        u[2] = mode
        for step in range(300):
            u[0] = commands[step // 10 % 10] * np.where(mode > 0, 0.6, 1.5)
            plant.advance(x, p, u, 0, n, substeps, 0.01 / substeps)
            peak = np.maximum(peak, x[plant.row("peak_tension")])
        peaks.append(peak)
    # rattling cables of 1 N are resolved only by the finer steps; what feeds energy grows by orders of magnitude
    ratio = peaks[0] / peaks[1]
    assert ratio.max() < 12 and np.quantile(ratio, 0.9) < 1.2 and np.median(ratio) == pytest.approx(1.0, abs=0.01)


def test_the_rigs_of_the_paper_keep_their_own_inertias_and_dampings():
    for name in ("zou-table2", "zou-instrument", "zou-grasp"):
        values = PLANT.parameters.pack(load_rig(name).values)[:, None]
        for plant in (PLANT, pulley_chain.PLANT):
            p = plant.prepare(values)
            plant.raise_to(p, 1e-3)
            np.testing.assert_array_equal(p, plant.prepare(values))


@pytest.mark.nojit
def test_plain_python_agrees_with_the_compiled_kernel():
    code = (
        "import numpy as np\n"
        "from cable_envs.plants.circuit.closed_form import PLANT\n"
        "from tests.plants.test_pulley_circuit import random_columns\n"
        "v, c = random_columns(np.random.default_rng(4), 3)\n"
        "p = PLANT.prepare(v); x = PLANT.rest(p, np.zeros(3))\n"
        "for k in range(5): PLANT.advance(x, p, np.ascontiguousarray(c[:, k]), 0, 3, 10, 1e-3)\n"
        "print(x.ravel().tolist())\n"
    )
    plain, compiled = (
        np.array(eval(subprocess.run([sys.executable, "-c", code], env=os.environ | {"NUMBA_DISABLE_JIT": flag},
                                     check=True, capture_output=True, text=True).stdout))
        for flag in ("1", "0")
    )  # fmt: skip
    np.testing.assert_allclose(plain, compiled, rtol=1e-10, atol=1e-12)  # fused multiply-adds in exp and log only


def test_cosine_and_senseless_rigs():
    x = np.linspace(-100, 100, 4001)
    assert max(abs(cosine(v) - np.cos(v)) for v in x) < 2e-14  # 1e-16 times 16 turns to be removed
    with pytest.raises(ConfigurationError, match="breaking_tension"):
        PLANT.prepare(PLANT.parameters.pack({"tension_limit": 300.0})[:, None])
    with pytest.raises(ConfigurationError, match="pretension"):
        PLANT.prepare(PLANT.parameters.pack({"pretension_top": 250.0})[:, None])


def test_drive_respects_its_limits():
    run = Run(PLANT, {}).step(60, lambda t: (3.0, 0.0), substeps=1)
    assert np.abs(np.diff(run["drive_velocity"])).max() <= 1000.0 * 1e-3 * (1 + 1e-12)
    run.step(200)
    assert run["drive_velocity"].max() <= 15.0
    assert run["drive_angle"][-1] == pytest.approx(3.0, abs=1e-6) and run["drive_angle"].max() < 3.02
    fast = Run(PLANT, {}, mode="torque").step(100, lambda t: (9.0, 0.0))
    assert fast["drive_velocity"].max() <= 15.0
