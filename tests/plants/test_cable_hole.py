"""Cable-hole plant: tensions of the paper, sticking, slack, energy, hysteresis, convergence, holes in series."""

import math
import os
import subprocess
import sys

import numpy as np
import pytest

from cable_envs.core.errors import ConfigurationError
from cable_envs.core.inputs import INPUTS
from cable_envs.plants.hole.plant import PLANT, cable_hole
from cable_envs.sim.replay import replay
from tests.reference.hole_reference import HoleReference, ratio
from tests.support.inputs import COMMAND, DISTURBANCE, MODE

ROW = {s.name: k for k, s in enumerate(PLANT.signals)}
WEIGHT = 5.0 * 9.81


class Rig:
    """``n`` equal mechanisms on a bench, moved step by step."""

    def __init__(self, n=1, holes=1, position=0.0, **changes):
        self.plant = cable_hole(holes)
        self.values = self.plant.parameters.unpack(self.plant.parameters.pack(changes))
        self.p = self.plant.prepare(np.repeat(self.plant.parameters.pack(changes)[:, None], n, axis=1))
        self.x = self.plant.rest(self.p, np.full(n, position))
        self.u = np.zeros((len(INPUTS), n))

    def move(self, command, mode, seconds, dt=1e-3):
        """Hold a command; returns signals [steps, n_signals] of the first mechanism after every step."""
        self.u[COMMAND], self.u[MODE] = command, mode
        trace = []
        for _ in range(round(seconds / dt)):
            self.plant.advance(self.x, self.p, self.u, 0, self.x.shape[1], 1, dt)
            trace.append(self.x[:, 0].copy())
        return np.array(trace)

    def get(self, name):
        return self.x[self.plant.row(name), 0]


@pytest.mark.parametrize(
    ("changes", "up", "down"),
    [
        ({}, 72.88, 33.01),
        ({"extrusion_gain": 0.0, "extrusion_delta": 0.0}, 61.07, 39.40),
    ],
)
def test_gu_section_5_3_raising_and_lowering_tensions(changes, up, down):
    # printed 73 / 33 N and 62 / 40 N; 0.02 N: the two decimals that section 1 gives at 10.8 mm/s
    rig = Rig(**changes)
    assert rig.move(0.0108, 1.0, 1.0)[-1, ROW["drive_tension"]] == pytest.approx(up, abs=0.02)
    assert rig.move(-0.0108, 1.0, 1.0)[-1, ROW["drive_tension"]] == pytest.approx(down, abs=0.02)
    assert rig.get("load_tension") == pytest.approx(WEIGHT, abs=1e-3)  # the weight, but for a vibration that dies out


def test_hanging_load_hangs_still_for_an_hour():
    rig = Rig()
    rig.move(55.0, 0.0, 1.0)
    before = rig.x.copy()
    rig.plant.advance(rig.x, rig.p, rig.u, 0, 1, 3_600_000, 1e-3)
    assert rig.get("load_position") == before[ROW["load_position"], 0]  # exactly: sticking is no creep
    assert rig.get("load_velocity") == 0.0
    assert rig.get("sliding") == 0.0


@pytest.mark.parametrize("share", [0.02, 0.5, 0.98])
def test_gu_eq28_sticks_inside_the_friction_cone_and_only_there(share):
    n = ratio(1.5 * 1.02, 0.43, math.pi / 3)
    inside = WEIGHT / n + share * (WEIGHT * n - WEIGHT / n)
    rig = Rig()
    assert np.all(rig.move(inside, 0.0, 1.5)[:, ROW["load_velocity"]] == 0.0)
    for outside, direction in ((WEIGHT * n * 1.01, 1), (WEIGHT / n * 0.99, -1)):
        rig = Rig()
        assert direction * rig.move(outside, 0.0, 1.5)[-1, ROW["load_velocity"]] > 0.0


def test_slack_cable_carries_no_tension_and_the_load_falls():
    rig = Rig(drive_speed_limit=1.0, drive_acceleration_limit=50.0)
    trace = rig.move(-1.0, 1.0, 0.2)
    slack = trace[:, ROW["drive_tension"]] == 0.0
    assert slack.any()
    assert np.all(trace[:, ROW["drive_tension"]] >= 0.0)
    falling = np.flatnonzero(slack)
    first = falling[falling > 5][:20]
    accelerations = np.diff(trace[first, ROW["load_velocity"]]) / 1e-3
    # free fall: no cable force at all, so friction (proportional to it) vanishes too
    assert accelerations == pytest.approx(-9.81, abs=1e-9)
    rig = Rig(drive_speed_limit=1.0, drive_acceleration_limit=50.0)
    rig.move(-1.0, 1.0, 0.05)
    rig.plant.advance(rig.x, rig.p, rig.u, 0, 1, 10, 1e-3)
    assert rig.get("slack_fraction") == 1.0


def _energy(trace, rig):
    v = rig.values
    stretch = np.maximum(trace[:, ROW["drive_position"]] - trace[:, ROW["load_position"]], 0.0)
    speed = trace[:, ROW["load_velocity"]]
    return (
        0.5 * v["load_mass"] * speed**2
        + v["load_mass"] * v["gravity"] * v["load_gravity"] * trace[:, ROW["load_position"]]
        + 0.5 * v["load_stiffness"] * trace[:, ROW["load_position"]] ** 2
        + 0.5 * v["cable_stiffness"] * stretch**2
    )


def _works(dt):
    """(work of the drive, friction loss, damper loss, growth of stored energy) over a cycle up and down."""
    rig = Rig(cable_damping=100.0)
    start = rig.x[:, 0].copy()
    trace = [start]
    for command in (0.01, -0.01, 0.01):
        trace.extend(rig.move(command, 1.0, 1.0, dt))
    trace = np.array(trace)
    middle = 0.5 * (trace[1:] + trace[:-1])
    v, t1, t2 = middle[:, ROW["load_velocity"]], middle[:, ROW["drive_tension"]], middle[:, ROW["load_tension"]]
    vx = middle[:, ROW["drive_velocity"]]
    drive = np.sum(t1 * vx) * dt
    friction = (t1 - t2) * v * dt
    damper = 100.0 * (vx - v) ** 2 * dt
    energy = _energy(trace, rig)
    return drive, friction, np.sum(damper), energy[-1] - energy[0]


def test_energy_balance_closes_and_friction_only_takes():
    errors = []
    for dt in (1e-3, 2.5e-4):
        drive, friction, damper, stored = _works(dt)
        errors.append(abs(drive - friction.sum() - damper - stored) / drive)
        # the mean of two steps straddles a reversal once or twice: nothing beyond rounding of the largest loss
        assert friction.min() >= -1e-6 * friction.max()
        assert damper >= 0.0
    assert errors[0] < 5e-3  # a thousandth of a second resolves the transients at the three starts only roughly
    assert errors[1] < 0.5 * errors[0]  # and the rest vanishes with the step


def test_hysteresis_loop_closes_and_its_area_is_the_friction_work():
    rig = Rig()
    speed, half = 0.008, 2.0
    rig.move(speed, 1.0, half)  # reach the loop
    rig.move(-speed, 1.0, half)
    loop = np.vstack([rig.move(speed, 1.0, half), rig.move(-speed, 1.0, half)])
    again = np.vstack([rig.move(speed, 1.0, half), rig.move(-speed, 1.0, half)])
    position, tension = loop[:, ROW["load_position"]], loop[:, ROW["drive_tension"]]
    assert again[:, ROW["drive_tension"]] == pytest.approx(tension, abs=1e-6)  # N: the loop repeats
    assert position[-1] == pytest.approx(again[-1, ROW["load_position"]], abs=1e-9)
    closed = np.append(position, position[0]), np.append(tension, tension[0])
    area = -np.sum(0.5 * (closed[1][1:] + closed[1][:-1]) * np.diff(closed[0])) * -1.0
    travel = position.max() - position.min()
    c = rig.values["extrusion_gain"] * speed ** rig.values["extrusion_exponent"]
    n = ratio(1.5 * 1.02, 0.43 + c, math.pi / 3)
    # up costs G n, down returns G / n; 2 %: the corners, where the cable stretches by the difference
    assert area == pytest.approx(WEIGHT * (n - 1 / n) * travel, rel=0.02)


def test_trajectory_against_event_driven_solver():
    accelerate = 0.05

    def drive(t):
        return x0 + 0.5 * accelerate * t * t, accelerate * t

    rig = Rig(drive_acceleration_limit=accelerate, drive_speed_limit=1.0)
    x0 = rig.get("drive_position")
    dt = 2.5e-4
    trace = rig.move(1.0, 1.0, 0.6, dt)  # the limits make the drive accelerate evenly
    times = np.arange(1, len(trace) + 1) * dt
    y, v = HoleReference(rig.values, drive).solve(0.0, 0.0, np.concatenate([[0.0], times]))
    # the step sees the break-away and the stick-slip after it up to one dt late: dt times the speed reached
    assert trace[:, ROW["load_position"]] == pytest.approx(y[1:], abs=1e-5)
    assert trace[-1, ROW["load_velocity"]] == pytest.approx(v[-1], rel=2e-3)


def _errors_where_smooth(steps, **changes):
    """Of the load's position and speed after 20 ms of sliding, with steps of these lengths; [steps, 2]."""

    def end(dt):
        rig = Rig(drive_speed_limit=0.05, **changes)
        rig.move(0.02, 1.0, 0.5, 1e-4)  # sliding up from here on
        return rig.move(0.05, 1.0, 0.02, dt)[-1, [ROW["load_position"], ROW["load_velocity"]]]

    exact = end(1e-5)
    return np.array([np.abs(end(dt) - exact) for dt in steps])


@pytest.mark.parametrize(("stronger", "dt"), [(1.0, 5e-4), (30.0, 1e-3)], ids=["usual", "steep"])
def test_second_order_where_smooth(stronger, dt):
    """With 30 times the extrusion friction is steep for both steps: its law is met at the end of each."""
    gain = stronger * PLANT.parameters["extrusion_gain"].default
    coarse, fine = _errors_where_smooth((dt, 0.5 * dt), extrusion_gain=gain)
    assert np.all(np.log2(coarse / fine) > 1.7)  # 2 but for the next order of the error


def test_where_friction_becomes_steep_for_the_step_it_is_no_further_off():
    """Of order 2 with the constant of shorter steps, where friction is not steep, 1 ms would be 4 times 0.5 ms off.

    The two lengths are on either side of where friction is steep, so that their ratio is no order: there are two
    constants. Without the law met at the end of the step it is 4.0 in both; with it 2.1 in position and 0.9 in speed.
    """
    longer, coarse = _errors_where_smooth((1e-3, 5e-4))
    assert np.all(longer < 3.0 * coarse)


def test_anchored_spring_needs_the_spring_force():
    rig = Rig(load_mass=1.0, load_gravity=0.0, load_stiffness=2600.0, load_damping=5.0)
    end = rig.move(40.0, 0.0, 3.0)[-1]
    assert end[ROW["drive_tension"]] == pytest.approx(40.0, abs=1e-3)  # the inner loop holds what is asked for
    assert end[ROW["load_tension"]] == pytest.approx(2600.0 * end[ROW["load_position"]], abs=1e-3)
    n = ratio(1.5 * 1.02, 0.43, math.pi / 3)
    assert 40.0 / n - 0.2 <= end[ROW["load_tension"]] <= 40.0  # at rest at, or inside, the friction limit


def test_load_without_support_is_refused():
    table = PLANT.parameters
    with pytest.raises(ConfigurationError, match="load_gravity > 0 or load_stiffness > 0"):
        PLANT.prepare(table.pack({"load_gravity": 0.0})[:, None])
    with pytest.raises(ConfigurationError, match="breaking_tension"):
        PLANT.prepare(table.pack({"breaking_tension": 50.0})[:, None])


@pytest.mark.parametrize("holes", [3, pytest.param(2, marks=pytest.mark.slow)])
def test_holes_in_series_multiply_their_ratios(holes):
    rig = Rig(holes=holes, wrap_angle=0.35, **{f"wrap_angle_{h}": 0.35 for h in range(2, holes + 1)})
    rig.move(0.0108, 1.0, 2.0)
    c = rig.values["extrusion_gain"] * 0.0108 ** rig.values["extrusion_exponent"]
    n = ratio(1.5 * 1.02, 0.43 + c, 0.35)
    # 1e-4: two seconds leave the inner slips that close to the speed of the load
    assert rig.get("drive_tension") == pytest.approx(WEIGHT * n**holes, rel=1e-4)
    for h in range(1, holes):
        assert rig.get(f"span_tension_{h}") == pytest.approx(WEIGHT * n ** (holes - h), rel=1e-4)


def test_a_hole_without_wrap_changes_nothing_in_steady_motion():
    one, three = Rig(), Rig(holes=3, wrap_angle=0.0, wrap_angle_2=0.0)
    a = one.move(0.0108, 1.0, 1.5)[-1, ROW["drive_tension"]]
    b = three.move(0.0108, 1.0, 1.5)[-1, ROW["drive_tension"]]
    assert b == pytest.approx(a, rel=1e-5)


@pytest.mark.parametrize("holes", [1, 3])
def test_columns_of_a_batch_equal_single_runs_bit_for_bit(holes):
    rng = np.random.default_rng(3)
    n = 70  # more than one tile, and a remainder
    plant = cable_hole(holes)
    values = np.repeat(plant.parameters.pack({})[:, None], n, axis=1)
    values[plant.parameters.index("friction_coefficient")] = rng.uniform(0.2, 0.6, n)
    values[plant.parameters.index("bending_rigidity")] = rng.choice([0.0, 1e-6], n)
    p = plant.prepare(values)
    x = plant.rest(p, rng.uniform(-0.01, 0.01, n))
    singles = [np.ascontiguousarray(x[:, k : k + 1]) for k in range(n)]
    commands = rng.uniform(20.0, 90.0, (40, n))
    u = np.zeros((len(INPUTS), n))
    for command in commands:
        u[COMMAND] = command
        plant.advance(x, p, u, 0, n, 10, 1e-3)
    for k in range(n):
        single, column = singles[k], np.ascontiguousarray(p[:, k : k + 1])
        v = np.zeros((len(INPUTS), 1))
        for command in commands:
            v[COMMAND] = command[k]
            plant.advance(single, column, v, 0, 1, 10, 1e-3)
        assert np.array_equal(single[:, 0], x[:, k])


@pytest.mark.parametrize("dt", [1e-3, 2e-3])
def test_gu_eq1_bending_stiffness_takes_wrap_away(dt):
    rig = Rig(bending_rigidity=1e-5)
    rig.move(0.01, 1.0, 2.0, dt)
    t1, t2 = rig.get("drive_tension"), rig.get("load_tension")
    lost = math.sqrt(1e-5) / (2 * 1.5e-3) * (1 / math.sqrt(t1) + 1 / math.sqrt(t2))
    m = 0.43 + 6574.0 * 0.01**2.03
    # 1e-9: steady motion, so the tensions of the last step are those of the present one whatever the step
    assert t1 / t2 == pytest.approx(ratio(1.5 * 1.02, m, math.pi / 3 - lost), rel=1e-9)
    assert t1 / t2 < ratio(1.5 * 1.02, m, math.pi / 3)


@pytest.mark.parametrize("dt", [pytest.param(2e-3, marks=pytest.mark.slow), 1e-3])
def test_series_of_stiff_spans_is_steady_whatever_the_step(dt):
    """The spans' vibration is far above what the step resolves: it must die out, not ring."""
    rig = Rig(holes=3, span_stiffness=1e6)
    rig.move(0.01, 1.0, 3.0, dt)
    n = ratio(1.5 * 1.02, 0.43 + 6574.0 * 0.01**2.03, math.pi / 3)
    # three seconds leave a ten-thousandth of the slow approach that the speed-dependent friction of three holes makes
    assert rig.get("drive_tension") == pytest.approx(WEIGHT * n**3, rel=2e-4)
    assert [rig.get(f"slip_velocity_{h}") for h in (1, 2)] == pytest.approx([0.01] * 2, rel=2e-4)


def test_disturbance_lifts_the_load():
    rig = Rig()
    rig.u[DISTURBANCE] = 40.0  # N, more than friction holds
    rig.move(0.0, 1.0, 0.5)
    assert rig.get("load_position") > 0.0


def test_drive_keeps_its_limits():
    rig = Rig(drive_speed_limit=0.05, drive_acceleration_limit=1.0)
    speed = rig.move(10.0, 1.0, 0.2)[:, ROW["drive_velocity"]]
    assert np.diff(speed).max() <= 1e-3 * (1 + 1e-12)  # rounding of a sum
    assert speed.max() == 0.05


@pytest.mark.parametrize("holes", [1, 3])
@pytest.mark.parametrize("substeps", [2, 15])
def test_a_drive_goes_where_straight_lines_between_commanded_speeds_lead(holes, substeps):
    """Whatever the step: half a step too early was found as a lag of 0.2 to 0.5 ms in recordings without one."""
    plant, period, time = cable_hole(holes), 0.01, 0.01 * np.arange(1, 301)
    speed = 0.01 * np.sin(4.0 * time)
    out = replay(
        plant, plant.table.pack({})[:, None], speed, period, drive="speed", substeps=substeps,
        signals=("drive_position", "drive_velocity"),
    )[..., 0]  # fmt: skip
    way = np.cumsum(0.5 * period * (speed + np.r_[0.0, speed[:-1]]))
    assert out[:, 0] - out[0, 0] == pytest.approx(way - way[0], abs=1e-12)
    assert out[:, 1] == pytest.approx(speed, abs=1e-12)


def test_gu_eq35_inner_loop_has_the_time_constant_of_its_gains():
    rig = Rig()
    trace = rig.move(55.0, 0.0, 1.0)[:, ROW["drive_tension"]]  # within the friction cone: only the span stretches
    k, kp, kd = (rig.values[name] for name in ("cable_stiffness", "inner_kp", "inner_kd"))
    rate = kp * k / (1 + kd * k)  # T' = k v, v = kp (F - T) - kd T'
    times = np.arange(1, 1001) * 1e-3
    expected = 55.0 + (WEIGHT - 55.0) * np.exp(-rate * times)
    # the span's damper and the drive's limited acceleration delay the start by a few ms: 6 N * 20 / s * 5 ms
    assert np.abs(trace - expected).max() < 0.6
    assert trace[-1] == pytest.approx(55.0, abs=1e-6)


_WITHOUT_JIT = """
import numpy as np
from cable_envs.core.inputs import INPUTS
from cable_envs.plants.hole.plant import PLANT
p = PLANT.prepare(PLANT.parameters.pack({})[:, None]); x = PLANT.rest(p, np.zeros(1)); u = np.zeros((len(INPUTS), 1))
for command in (49.0, 75.0, 30.0):
    u[0] = command
    for _ in range(4): PLANT.advance(x, p, u, 0, 1, 10, 1e-3)
print(*x[:, 0].tolist())
"""


@pytest.mark.nojit
def test_kernel_without_jit_agrees():
    runs = []
    for flag in ("0", "1"):
        out = subprocess.run(
            [sys.executable, "-W", "error", "-c", _WITHOUT_JIT],
            env={**os.environ, "NUMBA_DISABLE_JIT": flag}, capture_output=True, text=True, check=True,
        )  # fmt: skip
        runs.append(np.array([float(v) for v in out.stdout.split()]))
    # plain Python has no fused multiply-add: last digits differ
    assert runs[1] == pytest.approx(runs[0], rel=1e-9, abs=1e-12)
