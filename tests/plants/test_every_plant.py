"""What every plant in the registry keeps, whoever adds it: nothing here names one."""

import gymnasium as gym
import numpy as np
import pytest

from cable_envs.core.errors import ConfigurationError
from cable_envs.plants import families, family_of, plant_for
from cable_envs.plants.base import OUT_OF_RANGE
from cable_envs.sim.replay import replay
from cable_envs.sim.rigs import load_rig
from cable_envs.sim.tasks import TASKS, load_task

PERIOD = 0.01
PLANTS = {
    made.name: made
    for one in families().values()
    for made in (plant_for(one.name, variant) for variant in one.variants)
}
EVERY = pytest.mark.parametrize("plant", PLANTS.values(), ids=PLANTS)
DRIVEN = pytest.mark.parametrize("plant", [p for p in PLANTS.values() if p.action_modes], ids=lambda p: p.name)
"""Those that a command drives; the benches of recordings only follow what was recorded."""
MODES = pytest.mark.parametrize(("plant", "mode"), [
    pytest.param(plant, mode, id=f"{name}-{mode.name}") for name, plant in PLANTS.items() for mode in plant.action_modes
])  # fmt: skip


def rig_of(plant):
    """Values of the rig of a task of the plant [len(table), 1]; of a plant without tasks, its defaults."""
    family = family_of(plant.name)
    rigs = [load_rig(load_task(task).rig) for task in TASKS if task.split("-")[0] == family.tasks]
    return rigs[0].column(plant) if rigs else plant.table.pack({})[:, None]


def place_of(plant, *ends):
    """Name of the position of one end, where it has several; else that of the plant."""
    places = [
        s.name for s in plant.signals if s.unit in ("m", "rad") and s.name.split("_")[-1] in ("position", "angle")
    ]
    return next((n for n in places if n.split("_")[0] in ends), places[0])


def held(plant, mode, values):
    """The command that keeps the plant at rest at zero."""
    x = plant.rest(plant.prepare(values), np.zeros(values.shape[1]))
    return float(x[plant.row(mode.rest_signal), 0]) if mode.rest_signal else 0.0


def moving(plant, mode, values, steps=60):
    """A command that moves it to and fro within a tenth of its range [T]."""
    size = 0.1 * values[plant.table.index(mode.bound), 0]
    return held(plant, mode, values) + size * np.sin(2 * np.pi * 1.5 * np.arange(1, steps + 1) * PERIOD)


def run(plant, mode, values, command, **options):
    names = [s.name for s in plant.signals]
    return replay(plant, values, command, PERIOD, drive=mode.name, hold="step", signals=names, **options)


@MODES
def test_at_rest_it_stays_at_rest(plant, mode):
    values = rig_of(plant)
    start = plant.rest(plant.prepare(values), np.zeros(1))[: len(plant.signals), 0]
    seen = run(plant, mode, values, np.full(30, held(plant, mode, values)))[:, :, 0]
    scale = np.maximum(np.abs(start), 1e-3 * max(np.abs(start).max(), 1.0))
    assert np.abs(seen - start).max(axis=0) == pytest.approx(0.0, abs=0.02 * scale.max())


@MODES
def test_effects_at_null_are_bit_equal_to_none(plant, mode):
    values = rig_of(plant)
    command = moving(plant, mode, values)
    shapes = values.copy()  # of effects that are off, what only shapes them must not matter
    for effect in plant.effects.effects.values():
        for p in effect.parameters:
            if p.shape and not p.alias:
                shapes[plant.table.index(f"{effect.name}.{p.name}")] = 0.5 * (p.low + min(p.high, 4.0))
    assert np.array_equal(run(plant, mode, values, command), run(plant, mode, shapes, command))


@MODES
def test_a_batch_is_its_columns(plant, mode):
    values = np.repeat(rig_of(plant), 5, axis=1)
    values[plant.table.index(mode.bound)] *= np.linspace(1.0, 2.0, 5)
    for k, name in enumerate([p.name for p in plant.parameters][:8]):
        row = plant.table.index(name)
        spread = values[row] * np.linspace(1.0, 1.1 + 0.01 * k, 5)
        values[row] = np.clip(spread, plant.table[name].low, plant.table[name].high)
    command = moving(plant, mode, values[:, :1])
    together = run(plant, mode, values, command)
    for k in range(5):
        assert np.array_equal(together[:, :, k : k + 1], run(plant, mode, values[:, k : k + 1], command))


@MODES
def test_half_the_step_tells_the_same(plant, mode):
    values = rig_of(plant)
    command = moving(plant, mode, values)
    coarse, fine = (run(plant, mode, values, command, substeps=n)[:, :, 0] for n in (20, 40))
    names = [s.name for s in plant.signals]
    for k, signal in enumerate(plant.signals):
        if signal.unit in ("m", "rad") and not signal.name.startswith("slip"):
            size = np.ptp(fine[:, k])
            assert np.abs(coarse[:, k] - fine[:, k]).max() <= 0.02 * size + 1e-9, names[k]


@DRIVEN
def test_left_alone_it_comes_to_rest(plant):
    """Pushed for 0.1 s and then left with its drive held, it never gets faster than it was then."""
    values = rig_of(plant)
    p = plant.prepare(values)
    start = plant.rest(p, np.zeros(1))
    at = start[plant.row(place_of(plant, "drive", "motor")), 0]
    load = [s.name for s in plant.signals if s.unit in ("m/s", "rad/s")]
    push = np.zeros(600)
    push[:10] = 0.1 * values[plant.table.index(plant.action_modes[-1].bound), 0]
    seen = replay(plant, values, np.full(600, at), PERIOD, drive="follow", disturbance=push, signals=load)[:, :, 0]
    speed = np.abs(seen).max(axis=1)
    assert speed[10:].max() <= 1.5 * max(speed[:12].max(), 1e-9)
    assert speed[-50:].max() <= 0.05 * speed.max() + 1e-6


@pytest.mark.parametrize("task", TASKS)
def test_replay_is_step(task):
    env = gym.make(f"cable_envs/{task}-Sine-v1", duration=0.6)
    setup = env.unwrapped.setup
    _, first = env.reset(seed=3)
    rng, commands, seen = np.random.default_rng(1), [], []
    for _ in range(40):
        _, _, _, _, info = env.step(rng.uniform(-0.2, 0.5, 1).astype(np.float32))
        commands.append(info["command"])
        seen.append([info[s.name] for s in setup.plant.signals if s.name != OUT_OF_RANGE.name])
    rows = [s.name for s in setup.plant.signals if s.name != OUT_OF_RANGE.name]  # of the rig, which a replay knows not
    again = replay(
        setup.plant, setup.rig.column(setup.plant), np.array(commands), setup.control_period,
        drive=setup.action_mode.name, hold="step", signals=rows,
        start=first[place_of(setup.plant, "load", "output")], substeps=setup.substeps,
        rate=np.diff(np.r_[first["command"], commands]) / setup.control_period,
    )[:, :, 0]  # fmt: skip
    assert again == pytest.approx(np.array(seen), rel=1e-12, abs=1e-12)


def moved(plant):
    """Signals [T, k] of a plant that its command moves, or of one that follows a motion."""
    values = rig_of(plant)
    if plant.action_modes:
        return run(plant, plant.action_modes[0], values, moving(plant, plant.action_modes[0], values))[:, :, 0]
    path = 0.01 * np.sin(2 * np.pi * np.arange(1, 61) * PERIOD)
    names = [s.name for s in plant.signals]
    return replay(plant, values, path, PERIOD, drive="follow", signals=names, disturbance=np.cos(path))[:, :, 0]


@EVERY
def test_it_is_drawn_or_refused_by_name(plant):
    pytest.importorskip("matplotlib")
    from cable_envs.render import Renderer

    family = family_of(plant.name)
    if not family.scene:
        with pytest.raises(ConfigurationError, match=f"{family.name} has no scene"):
            Renderer(plant.name, {})
        return
    unit = next(iter({s.unit for s in plant.signals} & {"m", "rad"}))
    renderer = Renderer(plant.name, plant.parameters.unpack(rig_of(plant)[: len(plant.parameters), 0]), "a task", unit)
    before = renderer.frame()
    seen = moved(plant)[-1]
    renderer.push({s.name: float(v) for s, v in zip(plant.signals, seen, strict=True)}, 0.6, 0.0, 0.0)
    after = renderer.frame()
    assert after.shape == (640, 960, 3) and np.count_nonzero((before != after).any(axis=-1)) > 500


@pytest.mark.parametrize("family", families().values(), ids=list(families()))
def test_a_family_says_only_what_its_plants_have(family):
    for variant in family.variants:
        plant = plant_for(family.name, variant)
        signals = {s.name: s.unit for s in plant.signals}
        assert set(family.shown) <= set(signals) and set(family.known + family.nominal) - {
            p.name for p in family.beside
        } <= set(plant.parameters.names)
        for channel, signal in family.signals.items():
            assert family.channels[channel] == signals[signal]
        for channel, unit in family.channels.items():
            assert signals.get(channel, unit) == unit
        assert set(family.commands) <= {m.name for m in plant.action_modes}
        for mode, channel in family.commands.items():
            assert family.channels[channel] == next(m.unit for m in plant.action_modes if m.name == mode)
        for output in family.outputs.values():
            assert output.reference in family.channels or not family.channels
            assert set(output.needs) <= set(plant.parameters.names)
