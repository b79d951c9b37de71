"""Effects of one's own that remember: the four examples against scipy, and states that are kept like all others."""

import copy
import pickle
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from cable_envs.core.errors import ConfigurationError
from cable_envs.core.kernels import JIT_DISABLED
from cable_envs.effects import Effect, EffectParameter, EffectState
from cable_envs.plants import plant_for
from cable_envs.plants.own_effects import check_effect, load_effect, with_own_effects
from cable_envs.sim.replay import replay

EXAMPLES = Path(__file__).parents[2] / "examples" / "effects"
PERIOD, STEPS = 0.01, 60
T = PERIOD * (np.arange(STEPS) + 1)


def example(name):
    return load_effect(EXAMPLES / f"{name}.py")


def columns(plant, *changes):
    return np.array([plant.table.pack(change) for change in changes]).T


def _rung(time, dt, late, size):
    """Only one hundredth of a second, and nothing of it where the step's middle lies elsewhere."""
    return size * late if abs(time - 0.105) < 0.005 and dt < 0.01 else 0.0


def _later(late, dt):
    return late + dt


CLOCK = Effect(
    name="clock", seam="load", equation="F = size late where 0.1 < t < 0.11", source="made up", validity="any",
    experiment="wait", parameters=(EffectParameter("size", "N/s", 0.0, -1e6, 1e6, "force over time", 100.0),),
    states=(EffectState("late", "s", 2.0, "time since two seconds before the start"),), advance={"late": _later},
    hooks={"load": _rung},
)  # fmt: skip


@pytest.fixture(scope="module")
def axis():
    """A drive with both frictions with bristles, each in a column of its own, and one without any."""
    plant = with_own_effects(plant_for("linear_drive"), (example("lugre"), example("elasto_plastic"), CLOCK))
    force = 7.0 * np.sin(2 * np.pi * 2.5 * T) + 1.5
    common = {"coulomb": 0.0, "viscous": 20.0}
    values = columns(
        plant, common, {**common, "lugre.level": 4.0}, {**common, "elasto_plastic.level": 4.0},
    )  # fmt: skip
    return plant, values, force


def moved(law, force, start=(0.0, 0.0, 0.0)):
    """Position, speed and deflection (over 0.1 mm) with small steps, of a law (z, v) -> (force, z')."""
    times, forces = np.r_[0.0, T], np.r_[force[0], force]  # the first step has no ramp

    def rates(t, state):
        _, v, z = state
        friction, change = law(z, v)
        return [v, (np.interp(t, times, forces) - 20.0 * v - friction) / 11.0, change]

    run = solve_ivp(rates, (0.0, T[-1]), start, "LSODA", T, rtol=1e-8, atol=1e-11, max_step=2e-4)
    return run.y


def lugre(z, v):
    change = 1e4 * (v - z * abs(v) / (1.0 + 0.5 * np.exp(-((v / 2e-3) ** 2))))
    return 4.0 * (z + 1e-3 * change), change


def elasto_plastic(z, v):
    rising = 0.5 + 0.5 * np.sin(np.pi * (abs(z) - 0.85) / 0.3)
    alpha = 0.0 if z * v < 0.0 or abs(z) < 0.7 else (1.0 if abs(z) > 1.0 else rising)
    change = 1e4 * (v - alpha * abs(v) * z)
    return 4.0 * (z + 1e-3 * change), change


@pytest.mark.parametrize(("column", "law"), [(1, lugre), (2, elasto_plastic)], ids=["lugre", "elasto-plastic"])
def test_friction_with_bristles_against_scipy(axis, column, law):
    plant, values, force = axis
    errors = []
    for substeps in (10, 40):
        out = replay(
            plant, values[:, [column]], force, PERIOD, drive="force", signals=["position", "velocity"],
            substeps=substeps,
        )  # fmt: skip
        y, v, _ = moved(law, force)
        errors.append(max(np.abs(out[:, k, 0] - known).max() / np.ptp(known) for k, known in enumerate((y, v))))
    assert errors[1] < 1e-3  # 0.25 ms, against a friction that turns over within 0.1 mm
    assert errors[1] < 0.4 * errors[0]  # of order 2 but where it begins to slip


def test_at_null_it_is_absent_to_the_bit(axis):
    plant, values, force = axis
    signals = [signal.name for signal in plant.signals]
    out = replay(plant, values, force, PERIOD, drive="force", signals=signals)
    plain = plant_for("linear_drive")
    same = replay(
        plain, columns(plain, {"coulomb": 0.0, "viscous": 20.0}), force, PERIOD, drive="force", signals=signals
    )
    assert np.array_equal(out[:, :, [0]], same)
    assert not np.array_equal(out[:, :, [1]], same)


def test_bristles_that_no_step_resolves_are_stable(axis):
    """1e9 N/m with 11 kg: 9500 rad/s, of which a step of 1 ms sees nothing. The axis holds, then moves as it should."""
    plant, _, _ = axis
    force = np.where(T < 0.3, 3.0, 6.0)
    for effect in ("lugre", "elasto_plastic"):
        change = {f"{effect}.level": 4.0, f"{effect}.displacement": 4e-9, "lugre.excess": 0.0}
        values = columns(plant, {"coulomb": 0.0, "viscous": 20.0, **change})
        y = replay(
            plant, values, force, PERIOD, drive="force", signals=["position"], substeps=10, hold="step"
        )[:, 0, 0]  # fmt: skip
        assert np.abs(y[T < 0.295]).max() < 1e-4  # what no step resolves rings
        late = T[T >= 0.295] - 0.29  # 6 N less 4 N of friction against 20 N s/m, on 11 kg
        free = 0.1 * (late - 11.0 / 20.0 * (1.0 - np.exp(-20.0 / 11.0 * late)))
        assert y[T >= 0.295] == pytest.approx(free, abs=2e-4)


def test_small_swings_below_breakaway_do_not_creep_with_the_elasto_plastic_law_alone(axis):
    """What its authors made it for: LuGre drifts under a force that swings below the friction."""
    plant, values, _ = axis
    t = PERIOD * (np.arange(300) + 1)
    force = 1.6 + 1.0 * np.sin(2 * np.pi * 5.0 * t)
    y = replay(plant, values[:, 1:], force, PERIOD, drive="force", signals=["position"])[:, 0]
    drift = y[-20:].mean(axis=0) - y[20:40].mean(axis=0)
    assert drift[0] > 1e-6 and abs(drift[1]) < 0.02 * drift[0]


@pytest.fixture(scope="module")
def sheath():
    plant = with_own_effects(plant_for("tendon_sheath"), (example("wear"), example("temperature")))
    common = {"load_friction": 0.0, "drive_speed_limit": 10.0}
    values = columns(
        plant, common, {**common, "wear.growth": 1.0},
        {**common, "temperature.slope": -0.01, "temperature.resistance": 20.0, "temperature.constant": 0.5},
    )  # fmt: skip
    return plant, values, 0.02 * (1.0 - np.cos(2 * np.pi * 1.5 * T))


def pulled(plant, path, column, friction, memory):
    """Load and drive tension with the capstan law of the module, its sign a steep tanh; memory(v, T1, T2, state)."""
    value = plant.table.unpack(column)
    k = 1.0 / (1.0 / value["tendon_stiffness"] + 1.0 / value["sheath_stiffness"])
    bend, mu0 = value["bend_angle"], value["friction_coefficient"]
    times = np.r_[0.0, T]
    rate = np.gradient(np.r_[path], PERIOD)
    start = value["load_preload"] / k

    from scipy.interpolate import CubicHermiteSpline

    way = CubicHermiteSpline(times, np.r_[start, path], np.r_[0.0, rate])

    def tensions(t, state):
        y, v, m = state
        r = (mu0 + friction(m)) * bend * np.tanh(v / 1e-6)
        mean = max(k * (way(t) - y) + value["tendon_damping"] * (way(t, 1) - v), 0.0)
        behind = mean * (r / np.expm1(r) if abs(r) > 1e-9 else 1.0)
        return behind + r * mean, behind

    def rates(t, state):
        y, v, m = state
        before, behind = tensions(t, state)
        force = behind - value["load_preload"] - value["load_stiffness"] * y - value["load_damping"] * v
        return [v, force / value["load_mass"], memory(v, before, behind, m)]

    run = solve_ivp(rates, (0.0, T[-1]), (0.0, 0.0, 0.0), "Radau", T, rtol=1e-7, atol=1e-10, max_step=1e-3)
    return run.y, np.array([tensions(t, state)[0] for t, state in zip(T, run.y.T, strict=True)])


CASES = {
    "wear": (1, lambda m: m, lambda v, t1, t2, m: abs(v)),
    "temperature": (2, lambda m: -0.01 * m, lambda v, t1, t2, m: (20.0 * abs(t1 - t2) * abs(v) - m) / 0.5),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_friction_that_changes_against_scipy(sheath, name):
    plant, values, path = sheath
    column, friction, memory = CASES[name]
    value = plant.table.unpack(values[:, column])
    k = 1.0 / (1.0 / value["tendon_stiffness"] + 1.0 / value["sheath_stiffness"])
    path = path + value["load_preload"] / k
    chosen = values[:, [0, column]]
    state = plant.rest(plant.prepare(chosen), np.zeros(2))
    out = replay(
        plant, chosen, path, PERIOD, drive="follow", signals=["load_position", "drive_tension"], substeps=40,
        rate=np.gradient(path, PERIOD), state=state,
    )  # fmt: skip
    (y, _, m), tension = pulled(plant, path, values[:, column], friction, memory)
    assert out[:, 0, 1] == pytest.approx(y, abs=2e-3 * np.ptp(y))
    assert np.abs(out[:, 1, 1] - tension).max() < 0.02 * np.ptp(tension)
    assert np.abs(out[:, 1, 1] - out[:, 1, 0]).max() > 0.05 * np.ptp(tension)  # it is there
    kept = plant.effects.states.over(state[len(plant.signals) :])
    now = kept.own_wear_way if name == "wear" else kept.own_temperature_excess
    assert now[1] == pytest.approx(m[-1], rel=0.01)
    assert kept.own_time == pytest.approx(T[-1])


def test_a_run_that_goes_on_and_a_column_alone_are_the_same_to_the_bit(axis):
    plant, values, force = axis
    options = {"drive": "force", "signals": ["position", "velocity"], "substeps": 10, "hold": "step"}
    rate = np.r_[0.0, np.diff(force)] / PERIOD
    whole = replay(plant, values, force, PERIOD, rate=rate, **options)
    state = plant.rest(plant.prepare(values), np.zeros(3))
    half = STEPS // 2
    parts = [
        replay(plant, values, force[cut], PERIOD, rate=rate[cut], state=state, **options)
        for cut in (slice(0, half), slice(half, None))
    ]
    assert np.array_equal(np.concatenate(parts), whole)
    assert state[plant.effects.states.row("own_lugre_bent") + len(plant.signals), 1] != 0.0
    alone = [replay(plant, values[:, [k]], force, PERIOD, rate=rate, **options) for k in range(3)]
    assert np.array_equal(np.concatenate(alone, axis=2), whole)


def test_time_and_states_are_those_of_the_middle_of_the_step(axis):
    check_effect(CLOCK, "here")
    plant, _, _ = axis
    values = columns(plant, {"coulomb": 0.0, "viscous": 0.0, "clock.size": -11.0})
    v = replay(plant, values, np.zeros(20), PERIOD, drive="force", signals=["velocity"], substeps=4)[:, 0, 0]
    assert np.array_equal(v[:10], np.zeros(10))
    assert v[10:] == pytest.approx(2.105 * PERIOD)  # 11 N/s on 11 kg for 10 ms: the midpoint rule is exact here


def test_where_a_plant_has_several_contacts_a_memory_of_one_is_refused():
    wear = example("wear")
    for plant, message in (
        (plant_for("cable_hole", "analytic", 3), "'contact' at several"),
        (plant_for("pulley_circuit"), "no seam"),
    ):
        with pytest.raises(ConfigurationError, match=message):
            with_own_effects(plant, (wear,))
    one = plant_for("cable_hole")
    assert with_own_effects(one, (wear,)).effects.states.count == one.effects.states.count + 5


@pytest.mark.slow  # compiles the kernels of an environment and of a batch
@pytest.mark.skipif(JIT_DISABLED, reason="takes minutes")
@pytest.mark.parametrize(("name", "effect"), [("TendonSheath", "temperature"), ("CableHole", "wear")])
def test_states_are_the_environments(name, effect):
    env_id = f"cable_envs/{name}-Position-Sine-v1"
    sizes = {"temperature": {"slope": -0.1, "constant": 1.0}, "wear": {"growth": 5.0}}
    options = {"duration": 2.0, "effect_file": EXAMPLES / f"{effect}.py", "effects": {effect: sizes[effect]}}
    env = gym.make(env_id, **options)
    plain = gym.make(env_id, duration=2.0)
    actions = np.sin(0.2 * np.arange(100))[:, None].astype(np.float32)

    def seen(env, actions):
        return np.array([env.step(action)[0] for action in actions])

    env.reset(seed=1), plain.reset(seed=1)
    first, without = seen(env, actions), seen(plain, actions)
    assert not np.array_equal(first, without)
    env.reset(seed=1)
    assert np.array_equal(seen(env, actions), first)  # reset begins with the start values
    env.reset(seed=1)
    begun = seen(env, actions[:40])
    kept, pickled, copied = env.unwrapped.state(), pickle.dumps(env), copy.deepcopy(env)
    rest = seen(env, actions[40:])
    assert np.array_equal(np.concatenate([begun, rest]), first)
    assert np.array_equal(seen(pickle.loads(pickled), actions[40:]), rest)
    assert np.array_equal(seen(copied, actions[40:]), rest)
    env.unwrapped.restore(kept)
    assert np.array_equal(seen(env, actions[40:]), rest)
    batch = gym.make_vec(env_id, num_envs=3, vectorization_mode="vector_entry_point", threads=1, **options)
    batch.reset(seed=[1, 2, 3])
    together = np.array([batch.step(np.repeat(action[None], 3, axis=0))[0] for action in actions])
    assert np.array_equal(together[:, 0], first)
