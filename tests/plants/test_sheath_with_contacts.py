"""The sheath with contacts: three independent solutions, the limits, energy, the contacts' law, the posture."""

import math

import gymnasium as gym
import numpy as np
import pytest

from cable_envs.continuous.models import model
from cable_envs.core.errors import ConfigurationError
from cable_envs.core.inputs import INPUTS
from cable_envs.plants import plant_for
from cable_envs.sim.replay import replay
from cable_envs.sim.rigs import load_rig, rig_from_mapping
from tests.reference.sheath_chain_reference import Chain
from tests.reference.sheath_reference import distributed

PERIOD, STEP, START, CONTACTS = 0.01, 5e-4, 0.005, 20
PLANT = plant_for("tendon_sheath", contacts=CONTACTS)
RIG = dict(load_rig("bowden-1m").values)
MODES = pytest.mark.parametrize("mode", ["position", "tension"])
VARIED = (
    "load_mass", "load_stiffness", "load_preload", "load_damping", "bend_angle", "friction_coefficient",
    "tendon_stiffness", "sheath_stiffness", "tendon_damping", "drive_mass", "drive_damping", "drive_speed_limit",
    "drive_acceleration_limit", "servo_frequency",
)  # fmt: skip


def values_of(plant=PLANT, **changes):
    return plant.table.pack({**RIG, **{name.replace("__", "."): v for name, v in changes.items()}})[:, None]


def wave(mode, frequency, steps):
    turn = np.cos(2 * np.pi * frequency * np.arange(1, steps + 1) * PERIOD)
    return 0.015 - 0.01 * turn if mode == "position" else 32.5 - 15.0 * turn


def run(values, mode="position", frequency=0.5, steps=300, command=None, plant=PLANT, **options):
    command = wave(mode, frequency, steps) if command is None else command
    names = [s.name for s in plant.signals]
    options = {"drive": mode, "start": START, "hold": "step", **options}
    out = replay(plant, values, command, PERIOD, signals=names, **options)
    return {name: out[:, k, 0] for k, name in enumerate(names)}


def tensions(seen, contacts=CONTACTS):
    inner = [seen[f"span_tension_{j}"] for j in range(1, contacts)]
    return np.array([seen["drive_tension"], *inner, seen["load_tension"]])


# -- against other solutions ------------------------------------------------------------------------------------------


@pytest.mark.slow
@MODES
def test_moves_as_thirty_contacts_integrated_by_scipy_while_the_posture_changes(mode):
    """Smoothed friction, LSODA, another number of contacts: all that is common is the physics."""
    steps = 60
    command, turn = wave(mode, 0.9, steps), np.arange(1, steps + 1) * PERIOD
    posture = 1.2 * np.sin(2 * np.pi * 0.7 * turn)
    rig = {**RIG, "tendon_damping": 0.0}
    seen = run(values_of(tendon_damping=0.0), mode, command=command, rate=np.zeros(steps), posture=posture)
    t0, tn, y = Chain(rig, 30, START, mode).run(command, RIG["bend_angle"] + posture, PERIOD)
    assert np.abs(seen["drive_tension"] - t0).max() < 0.02 * t0.max()
    assert np.abs(seen["load_tension"] - tn).max() < 0.02 * tn.max()
    assert np.abs(seen["load_position"] - y).max() < 0.02 * np.ptp(y)  # the reference's 0.15 N are 1 % of it
    assert seen["bend"] == pytest.approx(RIG["bend_angle"] + posture, abs=1e-12)


def test_is_a_distributed_tendon_within_reversals_too():
    """At rest in every moment, 400 elements: what one contact misses by 7 N, twenty miss by less than 0.1 N."""
    quiet = values_of(load_damping=0.0)
    seen = run(quiet, "position", 0.05, 4000, hold="ramp")
    every = slice(19, None, 20)
    y, t1, t2 = distributed(PLANT.table.unpack(quiet[:, 0]), seen["drive_position"][every], START)
    assert seen["load_position"][every] == pytest.approx(y, abs=2e-5)  # of 17 mm
    assert seen["load_tension"][every] == pytest.approx(t2, abs=0.05)
    # of 56 N; it begins with a jump of the drive's speed, which is over after a second
    assert np.abs(seen["drive_tension"][every] - t1)[5:].max() < 0.1


@pytest.mark.parametrize("contacts", [CONTACTS, *(pytest.param(n, marks=pytest.mark.slow) for n in (1, 2, 3, 50))])
def test_sliding_throughout_the_ends_are_in_the_capstan_ratio_for_any_number_of_contacts(contacts):
    plant = plant_for("tendon_sheath", contacts=contacts)
    seen = run(values_of(plant), "position", command=np.linspace(0.006, 0.03, 150), plant=plant)
    assert seen["mobilised"][-30:] == pytest.approx(RIG["friction_coefficient"] * RIG["bend_angle"], abs=1e-9)


def test_backlash_has_the_width_of_the_closed_form():
    """From sliding in to sliding out, T_N held by the load F: F / k (e^r + e^-r - 2) / r of the drive's travel."""
    free = values_of(load_stiffness=0.0, load_preload=30.0)
    path = np.concatenate([np.linspace(0.004, 0.012, 300), np.linspace(0.012, 0.004, 600)])
    seen = run(free, "position", command=path)
    turn = seen["drive_position"].argmax() + 5
    back = np.flatnonzero(seen["load_velocity"][turn:] < -1e-3)[0] + turn
    travel = seen["drive_position"].max() - seen["drive_position"][back]
    r, k = RIG["friction_coefficient"] * RIG["bend_angle"], 1 / (1 / 14.4e3 + 1 / 60e3)
    assert travel == pytest.approx(30.0 / k * (math.exp(r) + math.exp(-r) - 2.0) / r, rel=0.02)  # a sample is 1.6 %


@MODES
def test_the_step_is_within_a_thousandth_of_a_hundred_times_shorter_ones(mode):
    coarse, fine = (run(values_of(), mode, 0.5, 200, substeps=n) for n in (20, 2000))
    for name in ("load_position", "load_tension", "drive_tension", "span_tension_10"):
        size = np.ptp(fine[name])
        assert np.sqrt(np.mean((coarse[name] - fine[name]) ** 2)) < 1e-3 * size


# -- what holds for every rig ------------------------------------------------------------------------------------------


class Bench:
    """Random rigs, shaken; every column has its own command, the odd ones by tension."""

    def __init__(self, n, seed):
        self.rng = rng = np.random.default_rng(seed)
        values = np.repeat(values_of()[: len(PLANT.parameters)], n, axis=1)
        for name in VARIED:
            values[PLANT.parameters.index(name)] *= 0.3 * 10.0 ** rng.uniform(0.0, 1.0, n)
        rubs = np.where(rng.random(n) < 0.4, rng.uniform(0.0, 5.0, n), 0.0)
        values[PLANT.parameters.index("load_friction")] = rubs
        self.p = PLANT.prepare(values)
        self.x = PLANT.rest(self.p, np.full(n, 0.01))
        self.X, self.C = PLANT.signal_rows.over(self.x), PLANT.coefficient_rows.over(self.p)
        self.U = INPUTS.zeros(n)
        self.U.mode[:] = np.arange(n) % 2
        self.pull, self.place = self.X.drive_tension.copy(), self.X.drive_position.copy()
        self.frequency, self.kind = rng.uniform(0.2, 4.0, n), rng.integers(0, 3, n)

    def shaken(self, steps):
        for k in range(steps):
            if k % 20 == 0:
                w = np.sin(2 * np.pi * self.frequency * k * STEP)
                w = np.where(self.kind == 0, w, np.where(self.kind == 1, np.sign(w), self.rng.uniform(-1, 1, len(w))))
                forces, places = np.maximum(self.pull * (1.0 + 1.2 * w), 0.0), self.place + 0.012 * w
                self.U.command[:] = np.where(self.U.mode > 0.5, forces, places)
            if k % 100 == 0:
                self.U.posture[:] = self.rng.uniform(-2.0, 4.0, len(self.pull))
            PLANT.advance(self.x, self.p, self.U.rows, 0, self.x.shape[1], 1, STEP)
            yield k

    def tensions(self):
        return np.vstack([self.X.drive_tension[None], self.X.span_tension, self.X.load_tension[None]])

    def energy(self):
        x, c = self.X, self.C
        stretch = np.maximum(
            -np.diff(np.vstack([x.drive_position[None], x.slip_position, x.load_position[None]]), axis=0), 0
        )
        stretch[[0, -1]] *= math.sqrt(2.0)  # half as long, twice as stiff
        y = x.load_position
        stored = 0.5 * CONTACTS * c.stiffness * (stretch**2).sum(axis=0) + 0.5 * c.load_mass * x.load_velocity**2
        return stored + c.load_preload * y + 0.5 * c.load_stiffness * y**2


def _check(n, steps, seed):
    bench = Bench(n, seed)
    first = bench.energy()
    work, passed, x, t = np.zeros(n), np.zeros(n), bench.X.drive_position.copy(), bench.X.drive_tension.copy()
    for _ in bench.shaken(steps):
        step = 0.5 * (t + bench.X.drive_tension) * (bench.X.drive_position - x)
        work, passed = work + step, passed + np.abs(step)
        x, t = bench.X.drive_position.copy(), bench.X.drive_tension.copy()
        assert (bench.energy() - first <= work + 1e-9 * np.maximum(passed, 1e-3)).all()
        all_ = bench.tensions()
        limit = np.exp(bench.C.friction_coefficient * bench.X.bend / CONTACTS)
        over = np.maximum(all_[:-1] - limit * all_[1:], all_[1:] - limit * all_[:-1])
        assert (all_ >= 0.0).all() and (over <= 1e-9 * all_.max(axis=0) + 1e-9).all()
    assert np.isfinite(bench.x).all()


def test_random_rigs_make_no_energy_and_obey_the_law_of_every_contact():
    _check(64, 1500, 1)


@pytest.mark.slow
def test_a_thousand_random_rigs_make_no_energy_and_obey_the_law_of_every_contact():
    _check(1000, 4000, 2)


def test_columns_of_a_batch_equal_single_runs_and_calls_may_be_split():
    bench = Bench(40, 5)
    start = bench.x.copy()
    told = [bench.U.rows.copy() for _ in bench.shaken(400)]
    skip = ("slack_fraction", "peak_tension")
    rows = [PLANT.row(s.name) for s in PLANT.signals if s.name not in skip]
    for k in (0, 7, 31, 39):
        x, p = (np.ascontiguousarray(a[:, k : k + 1]) for a in (start, bench.p))
        for step in range(0, 400, 20):
            PLANT.advance(x, p, np.ascontiguousarray(told[step][:, k : k + 1]), 0, 1, 20, STEP)
        assert np.array_equal(x[rows, 0], bench.x[rows, k])


@MODES
def test_rests_where_it_is_told_to(mode):
    values = values_of()
    x = PLANT.rest(PLANT.prepare(values), np.full(1, START))
    at = x[PLANT.row("drive_position" if mode == "position" else "drive_tension"), 0]
    seen = run(values, mode, command=np.full(3000, at))
    assert np.abs(seen["load_position"] - START).max() < 1e-12


def test_slack_and_taut_again():
    path = np.concatenate([np.full(100, -0.02), np.linspace(-0.02, 0.01, 200), np.full(100, 0.01)])
    seen = run(values_of(load_stiffness=0.0, load_damping=400.0), "position", command=path)
    assert seen["slack_fraction"][20:60].min() == 1.0 and tensions(seen).min() == 0.0
    assert np.all(np.diff(tensions(seen)[:, 285]) < 0.0)  # pulled in again, every contact slips
    assert seen["load_tension"][-1] == pytest.approx(RIG["load_preload"], rel=1e-6)


# -- effects ----------------------------------------------------------------------------------------------------------

EFFECTS = {
    "dry": {"coulomb_friction__level": 2.0}, "asymmetric": {"asymmetric_friction__contact": 0.3},
    "hardening": {"stiffness_hardening__coefficient": 0.05},
    "creep": {"viscoelastic_creep__share": 0.5}, "drift": {"friction_drift__change": 0.5},
    "gap": {"backlash__gap": 2e-3}, "slack": {"slack__length": 1e-3},
    "spring": {"position_dependent_load__stiffness": 3000.0},
    "lag": {"actuator_lag__time": 0.05},
}  # fmt: skip


@pytest.mark.parametrize("name", EFFECTS)
def test_effects_of_the_sheath_act_here_as_there(name):
    """Against the sheath as one contact, whose load moves alike: what the effect changes is the same within 5 %.

    Not Stribeck's friction: the load sticks and slips, at other moments.
    """
    lumped = plant_for("tendon_sheath")
    plain, one = (run(values_of(lumped, **e), plant=lumped, substeps=200)["load_position"] for e in ({}, EFFECTS[name]))
    bare, many = (run(values_of(PLANT, **e), substeps=200)["load_position"] for e in ({}, EFFECTS[name]))
    changed = one - plain
    assert np.abs(changed).max() > 1e-5
    assert np.sqrt(np.mean((many - bare - changed) ** 2)) < 0.05 * np.sqrt(np.mean(changed**2)) + 5e-6


def test_a_gap_is_the_same_for_one_contact_and_twenty_by_tension_too():
    """0.68 mm lay between them with 2 mm of gap, of a drive that rattled in it."""
    lumped = plant_for("tendon_sheath")
    one = run(values_of(lumped, backlash__gap=2e-3), "tension", plant=lumped, substeps=200)["load_position"]
    many = run(values_of(PLANT, backlash__gap=2e-3), "tension", substeps=200)["load_position"]
    assert np.ptp(many) > 5e-3 and np.sqrt(np.mean((one - many) ** 2)) < 1e-5


@MODES
def test_effects_at_null_change_no_bit(mode):
    values = values_of()
    command, base, x = wave(mode, 1.0, 60), PLANT.prepare(values[: len(PLANT.parameters)]), []
    for p, kernel in ((base, 0), (PLANT.prepare(values), 1)):
        state, u = PLANT.rest(p, np.full(1, START)), INPUTS.zeros(1)
        u.mode[:] = ("position", "tension").index(mode)
        for k, told in enumerate(command):
            u.command[:], u.posture[:], u.mode[:] = told, math.sin(0.1 * k), ("position", "tension").index(mode)
            PLANT.kernels[kernel](state, p, u.rows, 0, 1, 20, STEP)
        x.append(state[: len(PLANT.signals)])
    assert np.array_equal(*x)


# -- as an environment ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("task", ["Position", "Tension"])
def test_a_posture_bends_the_sheath_of_both_tasks(task):
    posture = {"kind": "sine", "amplitude": 0.5, "offset": 0.2, "frequency": 1.0}
    env = gym.make(f"cable_envs/TendonSheath-{task}-Sine-v1", rig="bowden-1m-20", posture=posture)
    _, info = env.reset(seed=0)
    assert info["bend"] == pytest.approx(math.pi + 0.2)
    for k in range(30):
        _, _, _, _, info = env.step(np.array([0.0], np.float32))
        assert info["bend"] == pytest.approx(math.pi + 0.2 + 0.5 * math.sin(2 * math.pi * 0.01 * k), abs=1e-12)
    _, info = env.reset(seed=0, options={"posture": {"kind": "constant", "offset": -9.0}})
    assert info["bend"] == 0.0  # no sheath bends by less than nothing


def test_what_does_not_fit_is_refused_by_name():
    rig = load_rig("bowden-1m-20")
    for effect in ("presliding_hysteresis.displacement", "lugre_friction.displacement"):
        with pytest.raises(ConfigurationError, match="does not act on tendon_sheath"):
            rig.replace({effect: 1e-4})
    with pytest.raises(ConfigurationError, match="has no posture"):
        gym.make("cable_envs/TendonSheath-Position-Sine-v1", rig="bowden-1m", posture={"kind": "constant"})
    with pytest.raises(ConfigurationError, match="contacts belong to the ids -v1"):
        gym.make("cable_envs/TendonSheath-Position-Sine-v0", rig="bowden-1m-20")
    for contacts, message in ((51, "expected 1 to 50"), (2.5, "whole number"), (-1, "expected 1 to 50")):
        with pytest.raises(ConfigurationError, match=message):
            rig_from_mapping({"plant": "tendon_sheath", "contacts": contacts})
    with pytest.raises(ConfigurationError, match="'contacts' belongs to tendon_sheath rigs only"):
        rig_from_mapping({"plant": "cable_hole", "contacts": 3})
    with pytest.raises(ConfigurationError, match="a sheath with contacts needs a tendon_damping above 0"):
        model(load_rig("bowden-1m-20").replace({"tendon_damping": 0.0}))
