"""The plants in continuous time: rest, sticking, the motion of the kernel with fine steps, slopes, refusals."""

import doctest
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import brentq

from cable_envs import ConfigurationError, load_rig, model
from cable_envs.continuous.numbers import NUMBERS
from cable_envs.continuous.ways import asked, told
from cable_envs.core.compiling.templates import interpreted
from cable_envs.physics.contact import tension_ratio, wrap_in_contact
from cable_envs.plants import families
from cable_envs.plants.hole import series_continuous
from cable_envs.sim.replay import replay
from tests.continuous.cases import BRAKE, DRIVEN, EVERY, TRANSMISSION, followed, moved, point, sampled
from tests.support.tree import ROOT

CASES = pytest.mark.parametrize("case", EVERY.values(), ids=EVERY)
COMMANDED = pytest.mark.parametrize("case", DRIVEN.values(), ids=DRIVEN)
LONG = {
    "series-tension", "series-speed", "series-stiff-cable", "series-motor-force", "series-motor-speed",
    "series-motor-no-extrusion", "hole-motor-force", "hole-motor-speed", "contacts-position", "contacts-tension",
    "contacts-motor-force", "contacts-motor-position", "chain-torque", "chain-motor-position", "sheath-motor-force",
    "joint-motor-torque", "joint-motor-position", "wrist-motor",
}  # fmt: skip
"""Of those commanded, whose motion in fine steps takes up to minutes to integrate or to compile."""
FINELY = pytest.mark.parametrize(
    "case", [pytest.param(c, id=n, marks=[pytest.mark.slow] if n in LONG else []) for n, c in DRIVEN.items()]
)
PERIOD = 0.01
FINE = {"rtol": 1e-9, "atol": 1e-13}
"""Where a contact starts or stops to slide no event ends a step of the integration: its tolerances must."""


@CASES
def test_at_rest_nothing_moves(case):
    m = case.made
    x, u = m.rest(case.position)
    at = m.f(x, u)
    largest = np.abs(m.f(x + 1e-4, u, 1)).max()
    assert np.abs(at).max() <= 1e-9 * max(largest, 1.0)


@COMMANDED
def test_friction_holds_within_its_limits_and_not_beyond(case):
    m = case.made
    x, u = m.rest(case.position)
    top, bottom = (m.rest(case.position, way) for way in (1, -1))
    assert m.sliding(x, u) == told(asked(m.equations, 0))
    for (xv, uv), way in ((top, 1), (bottom, -1)):
        inside, outside = ((x + s * (xv - x), u + s * (uv - u)) for s in (0.99, 1.01))
        assert (m.sliding(*inside), m.sliding(*outside)) == tuple(told(asked(m.equations, w)) for w in (0, way))
        for place, slides in zip(m.places, asked(m.equations, way)):
            assert m.f(*inside)[place] == 0.0 and slides * m.f(*outside)[place] > 0.0


@FINELY
def test_the_kernel_with_fine_steps_moves_as_the_integrated_equations(case):
    """Substeps of 10 us. The largest difference seen is 2.0e-4 of the range, with a servo read every 10 us 5.1e-4."""
    m = case.made
    x0, u0 = m.rest(case.position)
    u, given = moved(m, case, u0, 100, PERIOD)
    names = [s.name for s in (*m.states, *m.outputs)]
    seen = replay(
        m.plant, m.rig.column(m.plant), period=PERIOD, drive=m.action_mode, hold="step", signals=names,
        start=case.position, substeps=1000, **given,
    )[:, :, 0]  # fmt: skip
    motion = m.simulate(np.arange(101) * PERIOD, u, x0, **FINE)
    assert all({0, 1, -1} <= set(each) for each in np.atleast_2d(motion.sliding.T))
    shown = [m.h(motion.x[k + 1], u[k], motion.sliding[k + 1]) for k in range(100)]
    size = np.ptp(seen, axis=0)
    apart = np.abs(np.hstack([motion.x[1:], shown]) - seen) / size
    n = len(m.states)
    assert apart[:, :n].max() < case.within
    # an output that a jump of the command moves is compared where nothing has just stopped or broken away
    assert np.quantile(apart[:, n:], 0.95, axis=0).max() < max(1e-3, 3.0 * case.within)


@pytest.mark.parametrize(("rig", "mode", "size", "reaches"), [
    ("bowden-1m", "position", 0.03, {"drive_velocity": 0.2}),
    ("bowden-1m", "tension", 70.0, {"drive_velocity": 0.2}),
    ("zou-table2", "position", 2.0, {"drive_velocity": 15.0}),
    ("zou-table2", "torque", 0.55, {"drive_velocity": 15.0}),
    ({"plant": "linear_drive"}, "position", 0.5, {}),
    ("finger-joint", "position", 1.2, {"drive_a_velocity": 0.2}),
    ("finger-joint", "torque", 0.4, {}),
], ids=str)  # fmt: skip
def test_limits_and_slack_are_those_of_the_kernel(rig, mode, size, reaches):
    """A jump that takes the drive to its limits, and one back that slackens the sheath's tendon; substeps of 5 us.

    The largest difference seen is 5.4e-5 of the range.
    """
    m = model(rig, mode)
    x0, u0 = m.rest()
    command = u0[0] + size * np.where(np.arange(60) < 30, 1.0, -0.5)
    names = [s.name for s in m.states]
    seen = replay(
        m.plant, m.rig.column(m.plant), command, PERIOD, drive=mode, hold="step", rate=0.0 * command, substeps=2000,
        signals=[*names, "slack_fraction"],
    )[:, :, 0]  # fmt: skip
    u = np.zeros((60, len(m.inputs)))
    u[:], u[:, 0] = u0, command
    motion = m.simulate(np.arange(61) * PERIOD, u, x0)
    assert (np.abs(motion.x[1:] - seen[:, :-1]) / np.ptp(seen[:, :-1], axis=0)).max() < 2e-4
    assert all(np.abs(seen[:, names.index(name)]).max() == pytest.approx(most) for name, most in reaches.items())
    slackens = rig == "bowden-1m" or (rig, mode) == ("finger-joint", "position")
    assert (seen[:, -1].max() > 0.5) == slackens


def test_a_chain_that_slackens_moves_as_that_of_the_kernel():
    """Angles and speeds agree to 7e-7 of their range; what a slack cable's spans share takes the damping time here."""
    m = model(load_rig("zou-table2").replace({"pretension_top": 5.0, "pretension_bottom": 5.0}), "torque", "chain")
    x0, u0 = m.rest()
    command = u0[0] + 0.55 * np.where(np.arange(40) < 20, 1.0, -0.5)
    names = [s.name for s in m.states]
    seen = replay(
        m.plant, m.rig.column(m.plant), command, PERIOD, drive="torque", hold="step", rate=0.0 * command, substeps=2000,
        signals=[*names, "slack_fraction"],
    )[:, :, 0]  # fmt: skip
    motion = m.simulate(np.arange(41) * PERIOD, np.column_stack([command, 0.0 * command]), x0, **FINE)
    apart = np.abs(motion.x[1:] - seen[:, :-1]) / np.ptp(seen[:, :-1], axis=0)
    taut = seen[:, -1] == 0.0
    assert apart[:, :4].max() < 1e-5 and seen[:, -1].max() > 0.3 and 10 < taut.sum() < 40
    assert apart[taut].max() < 1e-3


def test_a_drive_that_cannot_follow_its_command_is_left_out_of_the_hole():
    """The acceleration limit of the hole's drive, which the equations leave out: what it does to the preset."""
    m = model("gu-inferred")
    x0, u0 = m.rest()
    command = u0[0] + sampled(20.0, 100, PERIOD)
    rate = np.concatenate([[0.0], np.diff(command) / PERIOD])
    names = [s.name for s in m.states]
    seen = replay(
        m.plant, m.rig.column(m.plant), command, PERIOD, drive="tension", hold="step", rate=rate, signals=names,
        substeps=1000,
    )[:, :, 0]  # fmt: skip
    motion = m.simulate(np.arange(101) * PERIOD, np.column_stack([command, rate, 0.0 * rate]), x0)
    apart = (np.abs(motion.x[1:] - seen) / np.ptp(seen, axis=0)).max(axis=0)
    assert 3e-4 < apart[1] < 3e-3


def test_the_clock_of_a_servo_is_all_that_is_left_out_of_it():
    """The load's position with the servo read every 1, 0.1 ms: 2.6e-3 and 2.6e-4 of its range."""
    case, apart = EVERY["sheath-motor-position"], []
    for period in (1e-3, 1e-4):
        m = model(load_rig(case.rig).replace({"encoder_counts": 0.0, "encoder_period": period}), case.mode)
        x0, u0 = m.rest(case.position)
        u, given = moved(m, case, u0, 100, PERIOD)
        seen = replay(
            m.plant, m.rig.column(m.plant), period=PERIOD, drive=case.mode, hold="step", signals=["load_position"],
            start=case.position, substeps=1000, sensors=False, **given,
        )[:, 0, 0]  # fmt: skip
        motion = m.simulate(np.arange(101) * PERIOD, u, x0)
        apart.append(np.abs(motion.x[1:, 2] - seen).max() / np.ptp(seen))
    assert 1e-3 < apart[0] < 4e-3 and 8.0 < apart[0] / apart[1] < 12.0


@pytest.mark.parametrize("given", [
    {}, {"extrusion_gain": 0.0}, {"extrusion_exponent": 0.5}, {"wrap_angle": 0.0}, {"bending_rigidity": 3e-6},
], ids=str)  # fmt: skip
def test_a_slip_is_as_fast_as_the_tensions_of_both_spans_make_it(given):
    """Against a bracketing solver, with dampers too that make the span above slack but for the slip."""
    p, rng, slack = model(load_rig("gu-three-holes").replace(given)).rows([0.0] * 3).p, np.random.default_rng(2), 0
    slip = interpreted(series_continuous.slip, **NUMBERS)
    for _ in range(100):
        above, behind, drop = rng.choice([-0.2, 1.0, 1.0]) * rng.uniform(5.0, 80.0), *rng.uniform(5.0, 300.0, 2)

        def left(w, above=above, behind=behind, drop=drop):
            a, b = max(above - drop * w, 1e-9), behind
            wrap = wrap_in_contact(p.wrap_angle[0, 0], p.bending_rigidity[0], p.edge_radius[0, 0], a, b)
            mu = p.friction_coefficient[0, 0] + p.extrusion_gain[0] * abs(w) ** p.extrusion_exponent[0]
            ratio = np.log(tension_ratio(p.radius_ratio[0, 0], mu, wrap)) + series_continuous.DRAG * abs(w)
            return np.log(a / b) - np.sign(w) * ratio

        speeds = {way: left(way * 1e-14) for way in (1, -1)}
        ways = [way for way, force in speeds.items() if way * force > 0.0]
        found = slip(p, 0, above, drop, behind)
        assert found == (pytest.approx(brentq(left, *sorted((ways[0] * 1e-14, ways[0] * 50.0)), xtol=1e-15), rel=1e-6)
                         if ways else 0.0)  # fmt: skip
        slack += above < 0.0 and above - drop * found > 1.0
    assert slack > 20


@pytest.mark.parametrize("way", [1, -1])
@pytest.mark.parametrize("given", [
    {}, {"load_stiffness": 2e3, "load_damping": 10.0}, {"extrusion_gain": 0.0},
    {"wrap_angle_2": 0.0}, {"bending_rigidity": 1e-5},
], ids=str)  # fmt: skip
def test_on_the_verge_holes_in_series_pull_as_one_spring(given, way):
    """Contacts at their limits: T_j is a share of T_0, and the drive's motion stretches all spans at once:

    1 / stiffness = 1 / (k + c s) + sum of share_j / k_s,   load = stiffness share_N (drive - load).
    """
    m = model(load_rig("gu-three-holes").replace(given), "speed")
    at = 0.01
    x, u = m.rest(at, way)
    linear = m.linearise(way, at=at)
    p = m.rows(u).p
    behind = p.load_weight[0] + p.load_stiffness[0] * at
    tensions = [*(p.span_stiffness[0] * (a - b) for a, b in ((x[3], x[4]), (x[4], at))), behind]
    above = m.h(x, u, way)[2]
    shares = np.array([1.0, *tensions]) / [1.0, above, above, above]
    limits = [
        tension_ratio(
            p.radius_ratio[h, 0], p.friction_coefficient[h, 0],
            wrap_in_contact(p.wrap_angle[h, 0], p.bending_rigidity[0], p.edge_radius[h, 0], *pair),
        )
        for h, pair in enumerate(pairwise([above, *tensions]))
    ]  # fmt: skip
    assert shares[1:] == pytest.approx(np.cumprod(np.array(limits) ** -way), rel=1e-9)
    if given.get("bending_rigidity"):
        return
    for s in 1j * np.array([1.0, 30.0, 100.0, 1e3]):
        spring = 1.0 / (1.0 / (p.cable_stiffness[0] + p.cable_damping[0] * s) + shares[1:3].sum() / p.span_stiffness[0])
        load = (p.load_mass[0] * s + p.load_damping[0]) * s + p.load_stiffness[0] + spring * shares[3]
        row = np.linalg.solve(s * np.eye(len(x)) - linear.A, linear.B[:, 0])
        assert row[1] == pytest.approx(spring * shares[3] / load / s, rel=1e-4)


@pytest.mark.parametrize("way", [1, -1])
def test_a_motor_that_is_told_more_than_its_saturator_takes_no_more(way):
    m = model("bowden-1m-motor", "tension")
    x, _ = m.rest(0.0)
    limit = m.command_range[1]
    most, more = (m.f(x, [way * s * limit, 0.0], way) for s in (1.0, 5.0))
    assert np.array_equal(most, more) and way * most[1] > 0.0


@pytest.mark.parametrize("way", [1, -1])
def test_the_transmission_is_that_of_its_kernel(way):
    m = TRANSMISSION.made
    k = np.arange(1, 21)
    torque = 0.3 * np.sin(0.7 * k)
    path = way * 0.01 * k
    names = ["drive_angle", *(s.name for s in m.outputs)]
    seen = replay(
        m.plant, m.rig.column(m.plant), path, PERIOD, drive="follow", rate=np.full(20, way * 1.0), disturbance=torque,
        signals=names,
    )[:, :, 0]  # fmt: skip
    ours = np.array([m.h([seen[j, 0]], [way * 1.0, torque[j]]) for j in range(20)])
    assert np.abs(ours - seen[:, 1:]).max() < 1e-12  # the same pieces, but for the rounding of exp


def test_the_band_slips_as_in_its_kernel():
    m = BRAKE.made
    t = np.arange(401) * PERIOD
    path, speed = 0.02 * np.sin(3.0 * t), 0.06 * np.cos(3.0 * t)
    seen = replay(
        m.plant, m.rig.column(m.plant), path[1:], PERIOD, drive="follow", rate=speed[1:], substeps=50,
        signals=["position", "slip", "force", "band_tension_difference"],
    )[:, :, 0]  # fmt: skip
    motion = m.simulate(t, lambda s: [0.06 * np.cos(3.0 * s)], max_step=1e-3)
    apart = np.abs(np.hstack([motion.x, motion.y])[1:] - seen).max(axis=0) / np.ptp(seen, axis=0)
    assert apart.max() < 2e-3  # the kernel's path goes from rest to its speed within the first step


@CASES
@pytest.mark.parametrize("way", [1, -1])
def test_the_linear_system_is_the_slope_of_the_equations(case, way):
    """Contacts without a mass follow to their limits: where they do not, they hold, and the equations are others."""
    m, rng = case.made, np.random.default_rng(3)
    ways = asked(m.equations, way)
    for _ in range(3):
        x, u = point(m, case, way, rng)
        linear = m.linearise(way, at=(x, u))
        exact, n = np.block([[linear.A, linear.B], [linear.C, linear.D]]), len(x)
        for k, value in enumerate((*x, *u)):
            step = 2e-7 * max(1e-3, abs(value))
            pairs, places = [], []
            for s in (1.0, -1.0):
                z = np.concatenate([x, u])
                z[k] += s * step
                z[:n] = followed(m, z[:n], z[n:], ways)
                pairs.append(np.concatenate([m.f(z[:n], z[n:], way), m.h(z[:n], z[n:], way)]))
                places.append(z)
            slope, along = (pairs[0] - pairs[1]) / (2.0 * step), (places[0] - places[1]) / (2.0 * step)
            size = np.abs(exact) @ np.abs(along) + np.abs(exact).max(axis=1) + np.abs(pairs[0]) * 1e-6 / step
            apart = np.abs(slope - exact @ along)
            assert apart.max() <= 1e-4 * size.max() and np.all(apart <= 1e-5 * size + 1e-9)


def test_linear_systems_know_what_their_rows_are():
    linear = model("gu-inferred").linearise(sliding=-1, at=0.01)
    assert linear.states == ("drive_position", "load_position", "load_velocity")
    assert linear.inputs == ("command", "command_rate", "disturbance") and linear.outputs[2] == "drive_tension"
    assert linear.sliding == -1 and np.abs(linear.rates).max() < 1e-9
    assert linear.A[1].tolist() == [0.0, 0.0, 1.0] and linear.B[2, 2] == pytest.approx(1.0 / 5.0)


def test_a_held_load_does_not_move_in_the_linear_system():
    linear = model("gu-inferred").linearise(sliding=0)
    assert not linear.A[2].any() and not linear.B[2].any()


@pytest.mark.parametrize(("given", "said"), [
    (lambda: model("gu-inferrd"), "gu-inferred"),
    (lambda: model("gu-inferred", "torque"), "unknown action mode 'torque'"),
    (lambda: model(load_rig("zou-table2").replace({"cable_damping": 0.0}), variant="chain"), "a cable_damping above 0"),
    (lambda: model(load_rig("zou-table2").replace({"hold_rule": 1.0})), "hold_rule"),
    (lambda: model(load_rig("gu-inferred").replace({"backlash.gap": 1e-4})), "leave out the effect 'backlash'"),
    (lambda: model("gu-inferred").f([0.0], [0.0] * 3), "x: expected 3 numbers"),
    (lambda: model("gu-inferred").f([0.0] * 3, [0.0] * 3, 2), "sliding: expected 1, -1 or 0"),
    (lambda: model("gu-inferred").simulate([0.0, 0.0], [0.0] * 3), "times that grow"),
    (lambda: model("gu-inferred").simulate([0.0, 1.0], [0.0] * 2), "u: expected"),
    (lambda: model("gu-inferred").simulate([0.0, 1.0], [0.0] * 3, rtoll=1.0), "did you mean 'rtol'"),
])  # fmt: skip
def test_what_cannot_be_is_refused_with_the_reason(given, said):
    with pytest.raises(ConfigurationError, match=said):
        given()


def test_a_plant_without_equations_says_so():
    with pytest.raises(ConfigurationError, match="has no equations in continuous time"):
        replace(families()["cable_hole"], continuous="").moves()


@CASES
def test_the_equations_name_signals_of_the_plant(case):
    m = case.made
    assert len(m.f(*m.rest(case.position))) == len(m.states)
    assert len(m.h(*m.rest(case.position))) == len(m.outputs) == len(m.equations.outputs)
    assert all(s.unit for s in (*m.states, *m.inputs, *m.outputs))


def test_the_page_about_it_holds():
    """Its examples run, and its table names the states of every plant."""
    page = ROOT / "docs" / "without-gymnasium.md"
    failed, tried = doctest.testfile(str(page), module_relative=False)
    assert failed == 0 and tried > 10
    rows = {row.split("`")[1]: row for row in page.read_text(encoding="utf-8").splitlines() if row.startswith("| `")}
    models = [case.made for case in EVERY.values()]
    assert {m.rig.plant for m in models} == {name for name, one in families().items() if one.continuous} == set(rows)
    said = {plant: row.split("|")[2] for plant, row in rows.items()}
    assert [
        s.name
        for m in models
        for s in m.states
        if not (s.name in said[m.rig.plant] or s.name[:-1] + "1 to" in said[m.rig.plant])
    ] == []


def test_the_range_of_the_command_is_that_of_the_action_mode():
    assert model("gu-inferred", "tension").command_range == (0.0, 120.0)
    assert model("gu-inferred", "speed").command_range == (-0.1, 0.1)
    assert TRANSMISSION.made.command_range == (-np.inf, np.inf)


@pytest.mark.parametrize(("name", "speed", "ahead"), [
    ("joint-position", 1.0, 0.0), ("joint-motor-torque", 0.0, 0.1), ("wrist", 2.0, 0.0), ("chain-position", 2.0, 0.0),
    ("circuit-motor-position", 1.0, 0.0), ("sheath-motor-force", 100.0, 5.0),
    pytest.param("contacts-position", 0.03, 0.0, marks=pytest.mark.slow),
    ("hole-motor-force", 0.0, 5.0),
])  # fmt: skip
def test_a_small_change_of_the_command_grows_in_the_kernel_as_in_the_linear_system(name, speed, ahead):
    """On a motion that goes on one way for 150 ms, for 10 ms from there: what a change of the command adds."""
    case = EVERY[name]
    m, ms, steps = case.made, 1e-3, 150
    _, u = m.rest(case.position, 1)
    names, rows, change = [s.name for s in m.states], [i.row for i in m.equations.inputs], 1e-5 * case.size
    command = u[0] + ahead + speed * ms * np.arange(1, steps + 11)
    rate = np.full(steps + 10, speed)
    given = {"drive": m.action_mode, "hold": "step", "signals": names, "substeps": 100, "sensors": False}
    state, ends = m.plant.rest(m.plant.prepare(m.rig.column(m.plant)), np.array([case.position])), []
    replay(m.plant, m.rig.column(m.plant), command[:steps], ms, rate=rate[:steps], state=state, **given)
    x = np.array([state[m.plant.row(s), 0] for s in names])
    for more in (0.0, change):
        commands = command[steps:] + more
        seen = replay(m.plant, m.rig.column(m.plant), commands, ms, rate=rate[steps:], state=state.copy(), **given)
        ends.append(seen[-1, :, 0])
    u[0] = command[steps]
    if "command_rate" in rows:
        u[rows.index("command_rate")] = speed
    ways, n = m.sliding(x, u), len(x)
    assert np.ravel(ways)[0] == 1
    linear = m.linearise(ways, at=(x, u))
    whole = np.zeros((n + 1, n + 1))
    whole[:n, :n], whole[:n, n] = linear.A, linear.B[:, 0]
    grown = change * expm(10 * ms * whole)[:n, n]
    assert np.abs(ends[1] - ends[0] - grown).max() <= 0.02 * np.abs(grown).max()
    assert np.all(np.abs(ends[1] - ends[0] - grown) <= 0.05 * np.abs(grown) + 1e-3 * np.abs(grown).max())
