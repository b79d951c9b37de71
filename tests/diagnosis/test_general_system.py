"""Recordings of plants that only their family describes: read, replayed, diagnosed. Nothing here is made for one."""

import numpy as np
import pytest
import yaml

from cable_envs.core.errors import ConfigurationError
from cable_envs.diagnosis import diagnose, load_recording
from cable_envs.diagnosis.systems import prepare
from cable_envs.plants import families, plant_for
from cable_envs.sim.replay import replay
from cable_envs.sim.rigs import load_rig
from cable_envs.sim.tasks import TASKS, load_task

GENERAL = [one for one in families().values() if one.replayed]
PERIOD = 0.01


def record(folder, family, mode, changes, seconds=12.0, seed=1, **content):
    """A recording of a rig with ``changes``, made in ``mode`` ("": no command is written); its YAML file."""
    task = load_task(next(t for t in TASKS if t.split("-")[0] == family.tasks))
    plant = plant_for(family.name)
    rig = load_rig(task.rig)
    told = next(m for m in plant.action_modes if m.name == (mode or plant.action_modes[0].name))
    values = rig.replace(changes).column(plant)
    steps = round(seconds / PERIOD)
    time = np.arange(1, steps + 1) * PERIOD
    rest = plant.rest(plant.prepare(values), np.full(1, task.references["sine"]["offset"]))[:, 0]
    held, rng = rest[plant.row(told.rest_signal)], np.random.default_rng(seed)
    wave = 0.6 * np.sin(2 * np.pi * 0.4 * time) + 0.3 * np.sin(2 * np.pi * 1.1 * time + 0.4) - 0.3 * np.sin(0.4)
    command = held * (1.0 + 0.5 * wave)
    signals = [s.name for s in plant.signals]
    start = task.references["sine"]["offset"]
    seen = replay(plant, values, command, PERIOD, drive=told.name, hold="step", signals=signals, start=start)[:, :, 0]
    seen = np.vstack([rest[: len(signals)], seen])
    channels = {"time": {"column": "time", "unit": "s"}}
    columns = {"time": np.r_[0.0, time]}
    for channel in family.replayed.predicted:
        signal = family.signals.get(channel, channel)
        noise = task.sensor_noise[signal]
        columns[channel] = seen[:, plant.row(signal)] + noise * rng.standard_normal(steps + 1)
        channels[channel] = {"column": channel, "unit": family.channels[channel], "noise_std": noise}
    if mode:
        channel = family.commands[mode]
        columns[channel] = np.r_[command, command[-1]]
        channels[channel] = {"column": channel, "unit": family.channels[channel], "hold": "step"}
    table = np.column_stack(list(columns.values()))
    np.savetxt(folder / "run.csv", table, delimiter=",", header=",".join(columns), comments="", fmt="%.10g")
    known = {name: rig.values[name] for name in family.known if name in rig.values}
    content = {
        "schema": "cable-recording/1", "system": family.name, "rig": task.rig, "known": known,
        "nominal": {name: {"value": rig.values[name]} for name in family.replayed.refitted if name not in known},
        "records": [{"data": "run.csv", "use": "fit"}], "channels": channels,
    } | content  # fmt: skip
    path = folder / "recording.yaml"
    path.write_text(yaml.safe_dump(content, sort_keys=False))
    return path


@pytest.mark.parametrize(
    ("family", "mode"),
    [(one, mode) for one in GENERAL for mode in (*one.commands, "")],
    ids=lambda v: getattr(v, "name", v),
)
def test_a_right_rig_leaves_the_noise(family, mode, tmp_path):
    question = prepare(load_recording(record(tmp_path, family, mode, {})))
    model = question.fit
    values = np.array([[p.start] for p in model.parameters])
    for block, predicted in zip(model.blocks, model.predict(values), strict=True):
        left = (block.measured - predicted[:, 0])[block.good]
        noise = load_task(next(t for t in TASKS if t.split("-")[0] == family.tasks)).sensor_noise[block.channel]
        # a followed drive's own noise, times the stiffness, is in all of them
        assert np.std(left) < (1.15 if mode else 4.0) * noise + (0.0 if mode else 0.02 * np.ptp(block.measured))
    assert question.ways == family.ways and set(question.nominals) >= set(family.replayed.refitted) - set(family.known)


@pytest.mark.parametrize("family", GENERAL, ids=lambda v: v.name)
def test_what_is_not_recorded_is_named(family, tmp_path):
    path = record(tmp_path, family, "", {})
    content = yaml.safe_load(path.read_text())
    del content["channels"][family.replayed.drive]
    path.write_text(yaml.safe_dump(content))
    with pytest.raises(ConfigurationError, match=family.replayed.drive):
        prepare(load_recording(path))


@pytest.mark.parametrize("family", GENERAL, ids=lambda v: v.name)
def test_a_missing_effect_is_found_and_nothing_where_nothing_is(family, tmp_path):
    looked_for = ["viscoelastic_creep", "backlash", "coulomb_friction"]
    mode = next(iter(family.commands))
    (tmp_path / "right").mkdir()
    (tmp_path / "other").mkdir()
    right = diagnose(record(tmp_path / "right", family, mode, {}), effects=looked_for)
    assert right.verdict == "no_detectable_mismatch"
    effect = {"viscoelastic_creep": {"share": 0.5, "time": 1.0}}
    found = diagnose(record(tmp_path / "other", family, mode, effect), effects=looked_for)
    assert [effect.name for effect in found.effects] == ["viscoelastic_creep"], found.verdict
