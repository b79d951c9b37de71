"""The tendon in a sheath: capstan law, its limits, energy, and two independent solutions."""

import math

import numpy as np
import pytest
from scipy.integrate import quad

from cable_envs.core.errors import ConfigurationError
from cable_envs.plants import plant_for
from cable_envs.plants.sheath.capstan import leaving, leaving_slope, mobilised, stuck_growth
from cable_envs.sim.replay import replay
from cable_envs.sim.rigs import load_rig
from tests.reference.sheath_reference import Sheath, distributed, nut_in_a_gap

PLANT = plant_for("tendon_sheath")
PERIOD = 0.01
NAMES = tuple(s.name for s in PLANT.signals)
START = 0.005


def values_of(**changes):
    return PLANT.table.pack({name.replace("__", "."): value for name, value in changes.items()})[:, None]


def wave(mode, frequency, steps):
    """A cosine that begins at rest: positions from 5 to 25 mm, tensions from 17.5 to 47.5 N."""
    turn = np.cos(2 * np.pi * frequency * np.arange(1, steps + 1) * PERIOD)
    return 0.015 - 0.01 * turn if mode == "position" else 32.5 - 15.0 * turn


def run(values, mode="position", frequency=1.3, steps=120, substeps=20, command=None, **options):
    command = wave(mode, frequency, steps) if command is None else command
    options = {"drive": mode, "start": START, "hold": "step", **options}
    out = replay(PLANT, values, command, PERIOD, signals=NAMES, substeps=substeps, **options)
    return {name: out[:, k, 0] for k, name in enumerate(NAMES)}


# -- the capstan law ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("r", [-2.0, -0.3, -1e-7, 0.0, 1e-7, 0.3, 1.0, 4.0])
def test_mean_tension_is_the_integral_of_the_exponential_profile(r):
    mean = quad(lambda s: math.exp(-r * s), 0.0, 1.0)[0]  # of T / T1
    assert leaving(-r) == pytest.approx(1.0 / mean, rel=1e-12)
    assert leaving(r) == pytest.approx(math.exp(-r) / mean, rel=1e-12)
    assert leaving(-r) == pytest.approx(leaving(r) + r, rel=1e-12)
    assert leaving_slope(r) == pytest.approx((leaving(r + 1e-6) - leaving(r - 1e-6)) / 2e-6, rel=1e-6)
    assert mobilised(leaving(r), 5.0) == pytest.approx(r, abs=1e-10)
    held = 10.0  # T2; T1 = T2 e^r has this mean
    means = [held / leaving(r + d) for d in (-1e-5, 1e-5)]
    growth = held * (math.exp(r + 1e-5) - math.exp(r - 1e-5)) / (means[1] - means[0])
    assert stuck_growth(r) == pytest.approx(growth, rel=1e-6)


@pytest.mark.parametrize("mode", ["position", "tension"])
def test_sliding_tensions_are_in_the_capstan_ratio_and_stuck_ones_within_it(mode):
    seen = run(values_of(), mode, 0.5, 400)
    ratio, limit = np.log(seen["drive_tension"] / seen["load_tension"]), 0.1 * math.pi
    for way in (1.0, -1.0):
        sliding = seen["sliding"] == way
        assert sliding.sum() > 50
        assert ratio[sliding] == pytest.approx(way * limit, abs=1e-9)
    stuck = seen["sliding"] == 0.0
    assert stuck.sum() > 20 and np.all(np.abs(ratio[stuck]) <= limit + 1e-9)
    assert seen["mobilised"] == pytest.approx(ratio, abs=1e-8)


def test_stuck_load_is_in_balance():
    seen = run(values_of(), "position", 0.5, 400)
    stuck = seen["sliding"] == 0.0
    assert seen["load_tension"][stuck] == pytest.approx(10.0 + 1500.0 * seen["load_position"][stuck], abs=1e-6)


def test_without_friction_both_ends_carry_the_same_and_only_the_stretch_is_between():
    seen = run(values_of(friction_coefficient=0.0), "position", 0.1, 1000)
    assert seen["drive_tension"] == pytest.approx(seen["load_tension"], rel=1e-12)
    stiffness = 1.0 / (1.0 / 14.4e3 + 1.0 / 60e3)
    stretch = seen["drive_position"] - seen["load_position"]
    assert stretch == pytest.approx(seen["drive_tension"] / stiffness, abs=2e-5)  # 0.1 N of damping is 9 um


def test_a_straight_sheath_has_no_friction():
    bent, straight = run(values_of(friction_coefficient=0.0)), run(values_of(bend_angle=0.0))
    assert all(np.array_equal(bent[name], straight[name]) for name in NAMES)


def test_a_rigid_tendon_moves_the_load_as_the_drive():
    rigid = values_of(tendon_stiffness=1e6, sheath_stiffness=1e8, tendon_damping=200.0)
    seen = run(rigid, "position", 0.5, 400, substeps=100)
    assert seen["load_position"] == pytest.approx(seen["drive_position"], abs=8e-5)  # 65 N over 1e6 N/m


def test_lost_motion_is_what_the_stretch_changes_between_pulling_and_paying_out():
    """At one load position: x is larger by T2 (1 / leaving(a) - 1 / leaving(-a)) / k where the tendon was pulled in."""
    seen = run(values_of(load_damping=0.0, tendon_damping=0.0), "position", 0.05, 4000)
    x, y, way = seen["drive_position"], seen["load_position"], seen["sliding"]
    at, a, k = 0.014, 0.1 * math.pi, 1.0 / (1.0 / 14.4e3 + 1.0 / 60e3)
    up, down = (np.interp(at, *zip(*sorted(zip(y[way == w], x[way == w], strict=True)), strict=True)) for w in (1, -1))
    tension = 10.0 + 1500.0 * at
    assert up - down == pytest.approx(tension * (1.0 / leaving(a) - 1.0 / leaving(-a)) / k, rel=0.01)


def test_slack_tendon_carries_nothing_and_comes_back():
    command = np.concatenate([np.linspace(0.005, -0.02, 100), np.full(200, -0.02), np.linspace(-0.02, 0.01, 200)])
    seen = run(values_of(), command=command)
    slack = seen["drive_tension"] == 0.0
    assert slack[150:300].all() and not slack[-100:].any() and not slack[:40].any()
    assert np.all(seen["load_tension"][slack] == 0.0) and np.all(seen["slack_fraction"][150:300] == 1.0)
    assert seen["load_position"][290] == pytest.approx(-10.0 / 1500.0, abs=1e-3)  # where the return spring is relaxed


def test_what_nothing_pulls_back_is_refused():
    with pytest.raises(ConfigurationError, match="nothing pulls the tendon back"):
        PLANT.prepare(values_of(load_stiffness=0.0, load_preload=0.0))
    with pytest.raises(ConfigurationError, match="breaking_tension must not be below"):
        PLANT.prepare(values_of(breaking_tension=50.0))


# -- energy -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("changes", [{}, {"friction_coefficient": 0.0}, {"bend_angle": 9.0}, {"load_friction": 2.0}])
def test_no_energy_comes_from_nowhere(changes):
    """What the drive has put in is at no time less than what load, spring and tendon hold, of any random motion."""
    rng = np.random.default_rng(3)
    command = np.repeat(rng.uniform(0.004, 0.025, 40), 10)
    values = values_of(load_damping=0.0, tendon_damping=0.0, **changes)
    state = PLANT.rest(PLANT.prepare(values), np.full(1, START))
    x0, t0 = state[PLANT.row("drive_position"), 0], state[PLANT.row("drive_tension"), 0]
    out = replay(
        PLANT, values, np.repeat(command, 80), PERIOD / 80, drive="position", hold="step", signals=NAMES, state=state,
        substeps=1,
    )[:, :, 0]  # fmt: skip
    x, v, t1, t2 = (out[:, PLANT.row(n)] for n in ("drive_position", "load_velocity", "drive_tension", "load_tension"))
    y, r = out[:, PLANT.row("load_position")], out[:, PLANT.row("mobilised")]
    work = np.cumsum(0.5 * (t1 + np.r_[t0, t1[:-1]]) * np.diff(x, prepend=x0))
    k = 1.0 / (1.0 / 14.4e3 + 1.0 / 60e3)
    mean = np.where(t1 > 0.0, t2 / [leaving(q) for q in r], 0.0)
    held = 0.25 * v**2 + 10.0 * (y - START) + 750.0 * (y**2 - START**2) + 0.5 * (mean**2 - t0**2) / k
    lost = work - held
    assert lost.min() > -1e-3 * np.abs(work).max()
    if changes.get("friction_coefficient") == 0.0:
        assert np.abs(lost).max() < 0.01 * np.abs(work).max()
    else:
        assert lost[-1] > 0.1 * np.abs(work).max()


def test_a_cycle_costs_what_the_capstan_takes():
    """Of a slow closed cycle: work of the drive = integral of a Tm over the mean slip of both ends, while sliding."""
    seen = run(values_of(load_damping=0.0, tendon_damping=0.0), "position", 0.1, 3000)
    whole = slice(1000, 2000)
    x, t1, t2, y = (seen[n][1000:2001] for n in ("drive_position", "drive_tension", "load_tension", "load_position"))
    spent = np.sum(0.5 * (t1[1:] + t1[:-1]) * np.diff(x))
    sliding = seen["sliding"][whole] != 0.0
    force = np.abs(0.5 * (t1 - t2)[1:] + 0.5 * (t1 - t2)[:-1])
    rubbed = np.sum((force * 0.5 * np.abs(np.diff(x) + np.diff(y)))[sliding])
    assert spent == pytest.approx(rubbed, rel=0.03) and spent > 0.1


# -- against independent solutions --------------------------------------------------------------------------------

CASES = {
    "nothing": {},
    "much friction": {"friction_coefficient": 0.15},
    "coulomb_friction": {"coulomb_friction.level": 3.0},
    "viscous_friction": {"viscous_friction.coefficient": 40.0},
    "stribeck_friction": {"stribeck_friction.excess": 4.0, "stribeck_friction.velocity": 0.05},
    "stribeck_friction, contact": {"stribeck_friction.contact": 0.05, "stribeck_friction.velocity": 0.05},
    "asymmetric_friction": {"asymmetric_friction.difference": 3.0},
    "asymmetric_friction, contact": {"asymmetric_friction.contact": 0.3},
    "friction_drift": {"friction_drift.change": 1.0, "friction_drift.time": 0.5},
    "backlash": {"backlash.gap": 0.002},
    "slack": {"slack.length": 0.003},
    "cable_elongation": {"cable_elongation.stiffness": 6e3},
    "stiffness_hardening": {"stiffness_hardening.coefficient": 0.02},
    "viscoelastic_creep": {"viscoelastic_creep.share": 2.0, "viscoelastic_creep.time": 0.2},
    "position_dependent_load": {"position_dependent_load.stiffness": 1000.0},
    "actuator_lag": {"actuator_lag.time": 0.03},
}
CHECKED = ("drive_position", "load_position", "drive_tension", "load_tension")


@pytest.mark.parametrize("mode", ["position", "tension"])
@pytest.mark.parametrize("case", CASES)
def test_plant_and_effects_against_small_explicit_steps(case, mode):
    values = PLANT.table.pack(CASES[case])[:, None]
    seen = run(values, mode, steps=90)
    reference, last, expected = Sheath(PLANT.table.unpack(values[:, 0]), START, step=2e-5), None, []
    for command in map(float, wave(mode, 1.3, 90)):
        reference.advance(command, 0.0 if last is None else (command - last) / PERIOD, mode, PERIOD)
        last = command
        expected.append((reference.x, reference.y, reference.t1, reference.t2))
    size = [0.02, 0.02, 40.0, 30.0]
    found = np.column_stack([seen[name] for name in CHECKED])
    most = 0.02 if "stribeck" in case else 5e-3  # falling friction amplifies what differs where it breaks away
    assert np.abs((found - expected) / size).max() < most
    assert np.ptp(found[:, 1]) > 0.004  # it moves
    if (case, mode) == ("backlash", "tension"):  # the tendon's pull keeps it taken up
        plain = run(values_of(), mode, steps=90)
        assert all(np.array_equal(seen[name], plain[name]) for name in CHECKED)
    elif case != "nothing":
        plain = run(values_of(), mode, steps=90)
        other = np.column_stack([plain[name] for name in CHECKED])
        assert np.abs((found - other) / size).max() > 0.02  # and the effect is seen


@pytest.mark.parametrize("contacts", [None, 20], ids=["", "contacts"])
def test_a_drive_that_is_told_its_force_feels_the_tendon_through_the_nut(contacts):
    """Against a nut between springs at both edges of the gap: pulled, let go until it is slack, pulled again."""
    plant = plant_for("tendon_sheath", contacts=contacts) if contacts else PLANT
    rig = dict(load_rig("bowden-1m").values) | {"friction_coefficient": 0.0, "drive_speed_limit": 10.0}
    command = np.r_[np.full(25, 32.5), np.full(25, 45.0), np.full(12, 0.0), np.full(38, 30.0)]
    gap, names = 2e-3, ["drive_position", "load_position", "drive_tension", "slack_fraction"]
    values = plant.table.pack({**rig, "backlash.gap": gap})[:, None]
    out = replay(
        plant, values, command, PERIOD, drive="tension", start=START, hold="step", signals=names, substeps=100,
        rate=np.zeros(len(command)),
    )[:, :, 0]  # fmt: skip
    x, y, tension = nut_in_a_gap(rig, gap, command, START, PERIOD)
    assert np.abs(out[:, 0] + 0.5 * gap - x).max() < 0.01 * np.ptp(x)  # it counts from the edge
    assert np.abs(out[:, 1] - y).max() < 0.01 * np.ptp(y)
    assert np.abs(out[:, 2] - tension).max() < 0.02 * np.ptp(tension)
    assert out[:, 3].max() == 1.0 and (tension == 0.0).any()  # slack for a whole period


@pytest.mark.parametrize("contacts", [None, 20], ids=["", "contacts"])
def test_a_gap_does_not_keep_a_drive_that_is_told_its_force_moving(contacts):
    """A constant force after a push comes to rest; with energy from the gap it swung by 5 mm for ever."""
    plant = plant_for("tendon_sheath", contacts=contacts) if contacts else PLANT
    values = plant.table.pack({**load_rig("bowden-1m").values, "backlash.gap": 2e-3})[:, None]
    command = np.r_[np.full(20, 40.0), np.full(480, 32.5)]
    x = replay(
        plant, values, command, PERIOD, drive="tension", start=START, hold="step", signals=["drive_position"]
    )[:, 0, 0]  # fmt: skip
    assert np.ptp(x[:100]) > 1e-4 and np.ptp(x[-100:]) < 1e-9


def test_load_moves_as_that_of_a_distributed_tendon():
    """At rest in every moment, 400 elements: the same way of the load; T1 differs within reversals only."""
    quiet = values_of(load_damping=0.0)
    seen = run(quiet, "position", 0.05, 4000, hold="ramp")
    rig = PLANT.table.unpack(quiet[:, 0])
    every = slice(19, None, 20)
    y, t1, t2 = distributed(rig, seen["drive_position"][every], START)
    assert seen["load_position"][every] == pytest.approx(y, abs=2e-5)  # of 17 mm
    assert seen["load_tension"][every] == pytest.approx(t2, abs=0.05)
    sliding = seen["sliding"][every] != 0.0
    assert seen["drive_tension"][every][sliding] == pytest.approx(t1[sliding], abs=0.1)
    passing = np.abs(seen["drive_tension"][every] - t1).max()
    assert 0.1 < passing < 0.15 * t1.max()  # the documented approximation: 7.0 N of 56 N


@pytest.mark.parametrize("mode", ["position", "tension"])
def test_steps_converge_in_the_second_order(mode):
    gentle = {"friction_coefficient": 0.05, "load_damping": 30.0}
    fine = run(values_of(**gentle), mode, substeps=640)

    def error(substeps):
        seen = run(values_of(**gentle), mode, substeps=substeps)
        return np.sqrt(np.mean((seen["load_position"] - fine["load_position"]) ** 2))

    assert error(20) < 2e-6
    assert error(80) < error(20) / 6.0  # 16 in the second order; steps in which the load stops are of the first


def test_presliding_becomes_the_sticking_of_a_short_displacement():
    plain = run(values_of(), "position", 0.5, 300)
    soft = run(values_of(presliding_hysteresis__displacement=1e-5), "position", 0.5, 300, substeps=100)
    far = run(values_of(presliding_hysteresis__displacement=5e-3), "position", 0.5, 300)
    assert soft["load_position"] == pytest.approx(plain["load_position"], abs=1e-4)
    assert np.abs(far["load_position"] - plain["load_position"]).max() > 3e-4
    bound = 0.1 * math.pi + 1e-9
    assert all(np.all(np.abs(seen["mobilised"]) <= bound) for seen in (soft, far))


def test_a_tension_cannot_be_imposed():
    with pytest.raises(ConfigurationError, match="tendon_sheath cannot be replayed with its drive 'imposed'"):
        run(values_of(), "imposed", command=np.full(5, 20.0))


def test_rig_file_loads_with_sources_and_its_breaking_tension_is_above_the_limit():
    rig = load_rig("bowden-1m")
    assert rig.plant == "tendon_sheath" and set(rig.sources) == {*PLANT.parameters.names, *rig.valid}
