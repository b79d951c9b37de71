"""One rig: the corrected rig, loaded from its file and driven by the recording's input, predicts what the answer does.

The answers are made, not searched for: the models of a recording at values of effects that it may have. Each is written
as augmented.yaml is, loaded as ``diagnose --rig augmented.yaml`` does, and both predict the same record.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from cable_envs.diagnosis.asked import request_of
from cable_envs.diagnosis.data.recording import load_recording
from cable_envs.diagnosis.real.sets import imported
from cable_envs.diagnosis.systems import plant_of, prepare
from cable_envs.diagnosis.systems.question import Request
from cable_envs.diagnosis.systems.replayed import ReplayModel
from cable_envs.plants import plant_for
from cable_envs.proof.cases import Case, make
from cable_envs.sim.rigs import load_rig
from tests.support.drive_recording import write as write_drive

EXACT = 1e-9
"""Difference over the range of the channel."""


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    """A short recording of each system, with nothing wrong."""
    found = {}
    for system, seed in (("cable_hole", 4711), ("pulley_circuit", 4712)):
        folder = tmp_path_factory.mktemp(system)
        make(Case("plain", seed, system, "nothing"), folder)
        found[system] = load_recording(folder)
    folder = tmp_path_factory.mktemp("linear_drive")
    write_drive(folder)
    found["linear_drive"] = load_recording(folder)
    return {system: short(recording) for system, recording in found.items()}


def short(recording, seconds=4.0):
    """The beginning of one record to fit and of one that is held out."""
    records = []
    for use in ("fit", "heldout"):
        record = recording.used_for(use)[0]
        first = record.time - record.time[0] <= seconds
        records.append(replace(record, data={name: values[first] for name, values in record.data.items()}))
    return replace(recording, records=tuple(records))


def answered(question, effects, place=-1, part=1.0):
    """Value of every parameter: its start, and with each effect a ``part`` of the way to a ``place`` of its probes."""
    values = {p.name: p.start for p in question.fit.parameters}
    known, starts = {h.name: h for h in question.hypotheses}, dict(values)
    for name in effects:
        sizes = {row: v for direction in known[name].probes[place] for row, v in direction.items()}
        values |= {row: starts[row] + part * (v - starts[row]) for row, v in sizes.items()}
    return values


def written(content, folder):
    """The file of a rig's content."""
    path = folder / "augmented.yaml"
    path.write_text(yaml.safe_dump(content, sort_keys=False))
    return path


def predicted(model, values):
    """What the simulation of every channel gives, [T] each.

    From what the first sample shows, without the constants of a record's start, which are no part of a rig: they are
    solved for at the values where a model starts and by slopes there, and these differ between the plain rig and the
    corrected one (a hole with backlash: 7e-5 of a channel's range).
    """
    if isinstance(model, ReplayModel):
        model._shifts = [np.empty(0) for _ in model.runs]
        model.runs = tuple(replace(run, start=float(run.blocks[0].measured[0])) for run in model.runs)
    return [p[:, 0] for p in model.predict(np.array([[values[p.name]] for p in model.parameters]))]


def apart(question, values, path, recording):
    """Largest difference of any channel over its range, between an answer and the rig that was written of it."""
    again = prepare(recording, request_of(recording, rig=path))
    mine = predicted(question.fit, values)
    its = predicted(again.fit, {p.name: p.start for p in again.fit.parameters})
    return max(float(np.abs(a - b).max() / np.ptp(a)) for a, b in zip(mine, its, strict=True))


@pytest.mark.parametrize(
    ("system", "variant", "effects"),
    [
        ("cable_hole", "", ("coulomb_friction", "backlash")),
        ("pulley_circuit", "analytic", ("stribeck_friction", "backlash")),
        ("pulley_circuit", "chain", ("stribeck_friction", "stiffness_hardening")),
        ("linear_drive", "", ("stribeck_friction", "position_dependent_load")),
    ],
)
def test_the_corrected_rig_predicts_what_the_answer_predicts(recordings, tmp_path, system, variant, effects):
    recording = recordings[system]
    question = prepare(recording, Request(variant=variant))
    values = answered(question, effects)
    path = written(question.rig(values, list(effects)), tmp_path)
    assert set(effects) <= {*load_rig(path).simulated_by().effects.present(whole(path))}
    assert load_rig(path).simulated_by().name == question.fit.plant.name
    assert apart(question, values, path, recording) < EXACT


def whole(path):
    """Every number of a rig's plant, by name."""
    rig = load_rig(path)
    plant = rig.simulated_by()
    return plant.table.unpack(rig.column(plant)[:, 0])


SHARED = Path(__file__).parents[3] / "shared"
TIME = np.arange(0.0, 6.0, 0.02)


def jaw(k):
    """Drive angle and torque, output angle and torque [T, 4] of a made jaw; what is recorded need not be exact."""
    x = 0.5 * np.sin(2.0 * np.pi * (0.3 + 0.1 * k) * TIME)
    torque = -0.1 - 0.03 * k + 0.05 * np.cos(2.0 * np.pi * 0.4 * TIME)
    return np.column_stack([x, torque, 0.9 * x - 0.2, torque / 0.9])


def brake(k):
    """Position, force and both tensions [T, 4] of a made band brake."""
    x = 0.02 * np.sin(2.0 * np.pi * (0.5 + 0.2 * k) * TIME)
    grip = 5e3 * np.tanh(200.0 * np.gradient(x, TIME))
    return np.column_stack([x, 8e3 * np.sign(grip) + grip, 4e3 - 0.5 * grip, 4e3 + 0.5 * grip])


def drives(k):
    """Voltage and reading [T, 2] of made coupled drives."""
    voltage = np.sign(np.sin(2.0 * np.pi * (0.3 + 0.1 * k) * TIME))
    return np.column_stack([voltage, np.abs(2.0 * np.sin(2.0 * np.pi * 0.5 * TIME))])


SIZES = {"coupled_drives": (0, 1e-3)}
"""Place of an effect's probes and part of the way there, where all the dry friction there would hold the drive still,
or the last place is where a refit ended."""
BENCHES = {
    "transmission": (
        "pulley_circuit", jaw,
        {"drive_angle": "rad", "drive_torque": "N m", "output_angle": "rad", "output_torque": "N m"},
    ),
    "band_brake": (
        "linear_drive", brake,
        {"position": "m", "force": "N", "band_tension_1": "N", "band_tension_2": "N"},
    ),
    "coupled_drives": ("linear_drive", drives, {"voltage": "V", "speed_reading": "V"}),
}  # fmt: skip


def bench(plant, folder):
    """A made recording of a lumped bench."""
    system, data, units = BENCHES[plant]
    for k, _ in enumerate(("fit", "fit", "heldout")):
        table = np.column_stack([TIME, data(k)])
        np.savetxt(folder / f"{k}.csv", table, delimiter=",", header=",".join(["time", *units]), comments="")
    columns = {name: {"column": name, "unit": unit} for name, unit in {"time": "s", **units}.items()}
    records = [{"data": f"{k}.csv", "use": use} for k, use in enumerate(("fit", "fit", "heldout"))]
    content = {"schema": "cable-recording/1", "system": system, "channels": columns, "records": records}
    (folder / "recording.yaml").write_text(yaml.safe_dump(content, sort_keys=False))
    return load_recording(folder)


@pytest.mark.parametrize("plant", BENCHES)
def test_the_corrected_rig_of_a_lumped_bench_has_every_effect_that_was_fitted(tmp_path, plant):
    """All effects of the bench at once, each parameter a little off its null."""
    recording = bench(plant, tmp_path)
    question = prepare(recording)
    effects = [h.name for h in question.hypotheses]
    values = answered(question, effects, *SIZES.get(plant, ()))
    path = written(question.rig(values, effects), tmp_path)
    assert plant_of(recording) == load_rig(path).plant == plant
    there = load_rig(path).simulated_by().effects.present(whole(path))
    assert {name.split(".")[0] for name in effects} <= set(there)
    assert apart(question, values, path, recording) < EXACT


@pytest.mark.parametrize("plant", BENCHES)
def test_the_equation_of_an_answer_is_that_of_its_plant(tmp_path, plant):
    """What the report prints of a bench's effect is the law of the plant that was fitted."""
    told = plant_for(plant).effects.effects
    for h in prepare(bench(plant, tmp_path)).hypotheses:
        assert h.equation == told[h.canonical].equation
        assert told[h.canonical].parameters


def test_the_corrected_rig_of_a_bench_lacks_nothing_that_it_has(tmp_path):
    """``--rig``: an effect that the rig has is not looked for again, and stays at the rig's value."""
    recording = bench("transmission", tmp_path)
    question = prepare(recording)
    values = answered(question, ["coulomb_friction", "cable_elongation"])
    path = written(question.rig(values, ["coulomb_friction"]), tmp_path)
    again = prepare(recording, request_of(recording, rig=path))
    assert {h.name for h in question.hypotheses} - {h.name for h in again.hypotheses} == {
        "coulomb_friction", "cable_elongation",
    }  # fmt: skip
    starts = {p.name: p.start for p in again.fit.parameters}
    assert starts["coulomb_friction.level"] == values["coulomb_friction.level"]


@pytest.mark.parametrize(("form", "folder"), [
    ("da-vinci-jaw", "davinci_tool"), ("band-brake", "band_brake"), ("coupled-drives", "coupled_drives"),
])  # fmt: skip
def test_the_corrected_rig_of_a_real_bench_predicts_what_the_answer_predicts(tmp_path, form, folder):
    if not (SHARED / "recordings" / folder).is_dir():
        pytest.skip(f"the published set {folder} is not at {SHARED / 'recordings' / folder}")
    recording = imported(form, SHARED / "recordings", tmp_path)
    question = prepare(recording)
    effects = [h.name for h in question.hypotheses]
    values = answered(question, effects, *SIZES.get(plant_of(recording), ()))
    path = written(question.rig(values, effects), tmp_path)
    if sum(name.startswith("zero.") for name in values) > 1:
        # each series has an encoder's zero of its own: the rig says so, and the refit of --rig finds them
        assert "zero of the output angle" in load_rig(path).description
        values = {name: 0.0 if name.startswith("zero.") else v for name, v in values.items()}
    assert apart(question, values, path, recording) < EXACT
