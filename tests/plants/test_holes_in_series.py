"""Holes in series: energy, the contacts' law, rest, slack, convergence, and the single hole as a limit."""

import functools

import gymnasium as gym
import numpy as np
import pytest

from cable_envs.core.errors import ConfigurationError
from cable_envs.core.inputs import INPUTS
from cable_envs.core.kernels import LANES
from cable_envs.physics.contact import tension_ratio
from cable_envs.plants.hole.plant import cable_hole
from cable_envs.plants.hole.series_stages import NEAR, caught_up, late, scratch
from cable_envs.sim.registered import setup_of
from cable_envs.sim.rigs import load_rig, rig_from_mapping
from cablebench.entrants.named import reference_entrants
from cablebench.protocol.metrics import measure
from cablebench.run.evaluation import run_episode

RIG = dict(load_rig("gu-three-holes").values)
STEP = 5e-4
VARIED = (
    "load_mass", "load_damping", "cable_stiffness", "cable_damping", "span_stiffness", "extrusion_gain", "inner_kp",
    "inner_kd", "drive_speed_limit", "drive_acceleration_limit",
)  # fmt: skip


class Bench:
    """Columns of mechanisms with holes in series, by name."""

    def __init__(self, holes: int, n: int = 1, seed: int = 0, **changes):
        self.plant, rng = cable_hole(holes), np.random.default_rng(seed)
        known = {name: value for name, value in RIG.items() if name in self.plant.parameters.names}
        wraps = {f"wrap_angle_{h}": RIG["wrap_angle"] for h in range(2, holes + 1)}
        table = self.plant.table
        values = np.repeat(table.pack({**known, **wraps, **changes})[:, None], n, axis=1)
        if n > 1:
            of_holes = ("wrap_angle", "radius_ratio", "friction_coefficient")
            for name in (*VARIED, *(p for p in self.plant.parameters.names if p.startswith(of_holes))):
                values[table.index(name)] *= 0.3 * 10.0 ** rng.uniform(0.0, 1.0, n)
            springs = 2600.0 * 0.3 * 10.0 ** rng.uniform(0.0, 1.0, n)
            values[table.index("load_stiffness")] = np.where(rng.random(n) < 0.4, springs, 0.0)
        self.p = self.plant.prepare(values)
        self.x = self.plant.rest(self.p, np.zeros(n))
        self.u = np.zeros((len(INPUTS), n))
        self.C, self.X, self.U = (
            self.plant.coefficient_rows.over(self.p), self.plant.signal_rows.over(self.x), INPUTS.over(self.u),
        )  # fmt: skip
        self.weight = self.X.drive_tension.copy()

    def move(self, substeps: int = 1, dt: float = STEP):
        self.plant.advance(self.x, self.p, self.u, 0, self.x.shape[1], substeps, dt)

    def energy(self):
        ends = np.vstack([self.X.drive_position[None], self.X.slip_position, self.X.load_position[None]])
        stretch = np.maximum(ends[:-1] - ends[1:], 0.0)
        y, c = self.X.load_position, self.C
        stored = 0.5 * c.cable_stiffness * stretch[0] ** 2 + 0.5 * c.span_stiffness * (stretch[1:] ** 2).sum(axis=0)
        return stored + 0.5 * c.load_mass * self.X.load_velocity**2 + c.load_weight * y + 0.5 * c.load_stiffness * y**2

    def first_stretch(self):
        return self.X.drive_position - self.X.slip_position[0]

    def pull(self, before, dt: float = STEP):
        """Tension of the first span within a step, where it acts on the drive and on the first hole, N."""
        k, c, after = self.C.cable_stiffness, self.C.cable_damping, self.first_stretch()
        share = np.maximum(late(dt) - c / (k * dt), 0.5)
        taut = k * (before + share * (after - before)) + c * (after - before) / dt
        return np.maximum(np.where(before > 0.0, taut, (k + c / dt) * after), 0.0)

    def tensions(self):
        return np.vstack([self.X.drive_tension[None], self.X.span_tension, self.X.load_tension[None]])


def _shaken(bench: Bench, steps: int, seed: int):
    """Waves, jumps and noise, every column its own; yields after each substep."""
    rng, n = np.random.default_rng(seed), bench.x.shape[1]
    kind, frequency = rng.integers(0, 3, n), rng.uniform(0.3, 5.0, n)
    bench.U.mode[:] = np.arange(n) % 2
    for k in range(steps):
        if k % 20 == 0:
            wave = np.sin(2.0 * np.pi * frequency * k * STEP)
            wave = np.where(kind == 0, wave, np.where(kind == 1, np.sign(wave), rng.uniform(-1.0, 1.0, n)))
            pull = np.maximum(bench.weight * (1.0 + wave), 0.0)
            bench.U.command[:] = np.where(bench.U.mode > 0.5, 0.5 * wave * bench.C.speed_limit, pull)
        yield k


def _check_energy(bench: Bench, steps: int, seed: int) -> None:
    energy, worst, passed = bench.energy(), -np.inf, np.zeros(bench.x.shape[1])
    for _ in _shaken(bench, steps, seed):
        before, stretch = bench.X.drive_position.copy(), bench.first_stretch()
        bench.move()
        work = bench.pull(stretch) * (bench.X.drive_position - before)
        after = bench.energy()
        passed += abs(work)
        worst, energy = np.maximum(worst, after - energy - work), after
    assert np.isfinite(bench.x).all()
    # what is left beside rounding is the tolerance of the contacts' law over the distance of a step
    assert (worst <= 1e-9 * np.maximum(passed, 1e-3)).all()


def test_no_substep_of_random_rigs_makes_energy():
    _check_energy(Bench(3, 60, seed=1), 2000, 2)


@pytest.mark.slow
@pytest.mark.parametrize("holes", [2, 3, 10])
def test_no_substep_of_a_thousand_random_rigs_makes_energy(holes):
    _check_energy(Bench(holes, 1000, seed=3), 3000, 4)


@pytest.mark.parametrize("mode", [0.0, 1.0])
def test_a_light_load_on_stiff_spans_makes_no_energy(mode):
    """1.95 kg, spans of 233 kN/m: stepped hole by hole, this rig made 0.51 J where the drive passed 0.22 J."""
    bench = Bench(3, load_mass=1.95, span_stiffness=233e3)
    energy, rng = bench.energy(), np.random.default_rng(0)
    bench.U.mode[:] = mode
    for k in range(4000):
        if k % 20 == 0:
            bench.U.command[:] = rng.uniform(-0.05, 0.05) if mode else rng.uniform(0.0, 40.0)
        before, stretch = bench.X.drive_position.copy(), bench.first_stretch()
        bench.move()
        after, work = bench.energy(), bench.pull(stretch) * (bench.X.drive_position - before)
        assert after - energy - work <= 1e-10
        energy = after


def test_reported_tensions_obey_the_law_of_every_contact():
    bench = Bench(3, 96, seed=5)
    c, worst = bench.C, 0.0
    for _ in _shaken(bench, 1500, 6):
        bench.move()
        tension, speed = bench.tensions(), np.vstack([bench.X.slip_velocity, bench.X.load_velocity[None]])
        assert (tension >= 0.0).all()
        for h in range(3):
            mu = c.friction_coefficient[h] + c.extrusion_gain * abs(speed[h]) ** c.extrusion_exponent
            n = np.array([tension_ratio(*one) for one in zip(c.radius_ratio[h], mu, c.wrap_angle[h], strict=True)])
            above, behind = tension[h], tension[h + 1]
            off = np.where(speed[h] > 0.0, above - n * behind, np.where(speed[h] < 0.0, n * above - behind, 0.0))
            over = np.maximum(above - n * behind, behind - n * above)
            worst = max(worst, (np.maximum(abs(off), over) / (above + behind + 1e-3)).max())
    assert worst < 1e-6


def _hangs(holes: int) -> None:
    bench = Bench(holes)
    bench.U.command[:] = 1.1 * bench.weight
    for _ in range(200):
        bench.move(20)
    before = bench.x.copy()
    assert np.isfinite(before).all()
    bench.move(200_000)
    same = [bench.plant.row(name) for name in ("load_position", "load_velocity", "load_tension")]
    assert np.array_equal(bench.x[same], before[same])
    assert np.array_equal(bench.X.slip_velocity, np.zeros_like(bench.X.slip_velocity))


@pytest.mark.parametrize("holes", [3, pytest.param(2, marks=pytest.mark.slow)])
def test_hangs_still_to_the_bit(holes):
    _hangs(holes)


@pytest.mark.slow
@pytest.mark.parametrize("holes", [10, 50])
def test_many_holes_run_and_hang_still_to_the_bit(holes):
    _hangs(holes)
    bench = Bench(holes, 40, seed=8)
    for _ in _shaken(bench, 400, 9):
        bench.move()
    assert np.isfinite(bench.x).all()
    assert (bench.tensions() >= 0.0).all()


def test_columns_of_a_batch_equal_single_runs_and_calls_may_be_split():
    bench = Bench(3, 40, seed=10)
    start, commands = bench.x.copy(), []
    for _ in _shaken(bench, 600, 11):
        commands.append(bench.u.copy())
        bench.move()
    for k in (0, 7, 31, 39):
        x, p = np.ascontiguousarray(start[:, k : k + 1]), np.ascontiguousarray(bench.p[:, k : k + 1])
        for step in range(0, 600, 20):
            bench.plant.advance(x, p, np.ascontiguousarray(commands[step][:, k : k + 1]), 0, 1, 20, STEP)
        rows = [
            bench.plant.row(s.name) for s in bench.plant.signals if s.name not in ("slack_fraction", "peak_tension")
        ]
        assert np.array_equal(x[rows, 0], bench.x[rows, k])


def test_slack_and_taut_again():
    bench = Bench(3)
    bench.U.mode[:] = 1.0
    bench.U.command[:] = -0.1
    bench.U.disturbance[:] = 45.0  # N: the load hardly weighs anything, and does not follow
    for _ in range(60):
        bench.move(20)
    assert bench.X.drive_tension[0] == 0.0 and bench.X.slack_fraction[0] == 1.0
    assert (bench.tensions() >= 0.0).all()
    bench.U.disturbance[:], bench.U.command[:] = 0.0, 0.05
    for _ in range(400):
        bench.move(20)
    assert bench.X.load_velocity[0] == pytest.approx(0.05, rel=1e-3)
    assert bench.tensions()[-1, 0] == pytest.approx(bench.weight[0], rel=1e-3)
    assert np.all(np.diff(bench.tensions()[:, 0]) < 0.0)


def _chases(old, line, rise, most, parts=20_000):
    """(mean speed, speed at the end) of a drive that gets to a line at its limit of acceleration, in small parts."""
    at, total = old, 0.0
    for k in range(parts):
        goal = line + rise * ((k + 0.5) / parts - 0.5)
        at += np.clip(goal - at, -most / parts, most / parts)
        total += at / parts
    return total, at


def test_a_drive_leaves_its_limit_of_acceleration_within_a_step():
    """Stopped at the limit's mean, as by a clip, it would be off by an eighth of what it may change in a step."""
    rng, most = np.random.default_rng(15), 2e-3
    w = scratch(3).zeros(LANES)
    w.most[:], w.fastest[:], w.alone[:] = most, 1.0, 0.3
    w.rise[:], w.old[:] = rng.uniform(-0.9, 0.9, LANES) * most, rng.uniform(-0.1, 0.1, LANES)
    far = rng.uniform(-1.5, 1.5, LANES) * most
    for i in range(LANES):
        mean, ends = caught_up(w, i, 0.3 * (w.old[i] + far[i]), 0.3)
        exact, last = _chases(w.old[i], w.old[i] + far[i], w.rise[i], most)
        assert mean == pytest.approx(exact, abs=0.03 * most)
        assert ends == pytest.approx(last, abs=2.0 * NEAR * most)


def test_what_a_drive_makes_of_its_loop_does_not_jump_where_a_contact_starts_to_slip():
    """Asked for the same, in two ways to say it: alone, and with the share of its own speed that comes back to it."""
    rng, w = np.random.default_rng(16), scratch(3).zeros(LANES)
    w.most[:], w.fastest[:], w.alone[:] = 2e-3, 1.0, rng.uniform(0.1, 1.0, LANES)
    w.rise[:], w.old[:] = rng.uniform(-1e-3, 1e-3, LANES), rng.uniform(-0.1, 0.1, LANES)
    for i in range(LANES):
        share = rng.uniform(0.05, 1.0)
        asked = w.old[i] + rng.uniform(-3e-3, 3e-3)
        alone, _ = caught_up(w, i, asked, 1.0)
        slipping, _ = caught_up(w, i, asked - (1.0 - share) * alone, share)
        assert slipping == pytest.approx(alone, abs=1e-12)


EFFECTS = {
    "none": {}, "dry": {"coulomb_friction.level": 3.0}, "stribeck": {"stribeck_friction.excess": 2.0},
    "asymmetric": {"asymmetric_friction.contact": 0.2, "asymmetric_friction.difference": 2.0},
    "elastic": {"presliding_hysteresis.displacement": 5e-4}, "hardening": {"stiffness_hardening.coefficient": 0.01},
    "creep": {"viscoelastic_creep.share": 0.5, "viscoelastic_creep.time": 1.0},
    "slow creep": {"viscoelastic_creep.share": 0.5, "slow_creep.share": 0.5, "slow_creep.time": 2.0},
    "slack": {"slack.length": 1e-3},
    "drift": {"friction_drift.change": 0.2, "friction_drift.time": 2.0}, "backlash": {"backlash.gap": 5e-4},
    "ripple": {"position_ripple.amplitude": 2e-4}, "lag": {"actuator_lag.time": 0.02},
}  # fmt: skip


def _path(plant, changes, substeps=20):
    p = plant.prepare(plant.table.pack(changes)[:, None])
    x, u = plant.rest(p, np.zeros(1)), np.zeros((len(INPUTS), 1))
    U, rows, path = INPUTS.over(u), [plant.row(k) for k in ("drive_tension", "load_position")], []
    U.mode[:] = 1.0
    for k in range(200):
        U.command[:] = 0.012 * np.sin(2.0 * np.pi * k / 130.0)
        plant.advance(x, p, u, 0, 1, substeps, 0.01 / substeps)
        path.append(x[rows, 0].copy())
    return np.array(path)


@pytest.mark.slow
@pytest.mark.parametrize("case", EFFECTS)
def test_a_hole_without_wrap_before_the_only_one_changes_nothing_with_any_effect(case):
    straight = {"wrap_angle": 0.0, "wrap_angle_2": np.pi / 3, "span_stiffness": 1e8}
    one, two = _path(cable_hole(1), EFFECTS[case]), _path(cable_hole(2), {**straight, **EFFECTS[case]})
    assert (np.sqrt(((one - two) ** 2).mean(axis=0)) < 2e-3 * np.ptp(one, axis=0)).all()


@functools.cache
def _rmse(name: str, mode: str, substeps: int) -> float:
    env_id, options = "cable_envs/CableHole-Position-Sine-v1", {"rig": "gu-three-holes", "action_mode": mode}
    entrant = {e.name: e for e in reference_entrants()}[name]
    needs = entrant.needs(env_id, setup_of(env_id, options)) or {}
    env = gym.make(env_id, **options, substeps=substeps, **needs)
    return measure(run_episode(env, entrant.make(env.unwrapped.setup), seed=1))["rmse"]


@pytest.mark.parametrize("mode", ["tension", "speed"])
def test_closed_loop_error_is_within_one_percent_of_steps_a_hundred_times_finer(mode):
    """The rig asks for 44 steps."""
    assert _rmse("pid", mode, 44) == pytest.approx(_rmse("pid", mode, 4400), rel=0.01)


def test_a_rig_with_the_mass_that_has_gone_is_told_so():
    content = load_rig("gu-three-holes").content()
    content["parameters"]["guide_mass"] = {"value": 0.02, "unit": "kg"}
    with pytest.raises(ConfigurationError, match="'guide_mass' has gone: the cable between holes has no mass"):
        rig_from_mapping(content)
