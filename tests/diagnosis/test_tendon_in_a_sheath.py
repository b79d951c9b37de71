"""Recordings of a tendon in a sheath, made by the capstan law along all of it (`benchmarks.unlike.sheath`)."""

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import yaml

from benchmarks.unlike.sheath import Tendon, catheter, worn_catheter
from cable_envs.diagnosis import diagnose, load_recording
from cable_envs.diagnosis.asked import request_of
from cable_envs.diagnosis.intake.gate import gate
from cable_envs.diagnosis.systems import prepare, simulator_of
from cable_envs.diagnosis.systems.common import Sampled, augmented_rig
from cable_envs.diagnosis.systems.starts import begin
from cable_envs.plants import family, plant_for
from cable_envs.sim.replay import replay
from cable_envs.sim.rigs import load_rig

drawn = cache(catheter)
STIFFNESS, FRICTION, SPRING, PRELOAD, GAP = 5900.0, 0.43, 1270.0, 4.9, 6e-4
PERIOD = 0.01
VALUES = {"bend_angle": 2.5, "sheath_stiffness": 60e3}
COLUMNS = {"Draht_mm": "drive_position", "Kraft_Antrieb_N": "drive_tension", "Kraft_Spitze_N": "load_tension"}


def moved(gap=0.0, seconds=16.0):
    """Drive, both tensions and the tip's place of a slow motion, without noise."""
    time = np.arange(0.0, seconds, PERIOD)
    drive = 5.5e-3 - 3.5e-3 * np.cos(2 * np.pi * 0.2 * time) - 1e-3 * np.cos(2 * np.pi * 0.53 * time)
    nut, seen, tendon = drive[0], [], Tendon(STIFFNESS, FRICTION, SPRING, PRELOAD, drive[0])
    for place in drive:
        nut = float(np.clip(nut, place - 0.5 * gap, place + 0.5 * gap))
        seen.append(tendon.move(nut))
    first, second, tip = np.array(seen).T
    return {"drive_position": drive, "drive_tension": first, "load_tension": second, "load_position": tip}


@pytest.mark.parametrize("gap", [0.0, GAP])
@pytest.mark.parametrize("left_out", ["", "load_position", "load_tension", "drive_tension"])
def test_what_slides_tells_friction_stiffness_and_load(gap, left_out):
    series = [{n: Sampled(v, np.ones(len(v), dtype=bool)) for n, v in moved(gap).items() if n != left_out}]
    found = begin(plant_for("tendon_sheath"), series, VALUES, PERIOD)
    own = 1.0 / (1.0 / STIFFNESS - 1.0 / VALUES["sheath_stiffness"])
    wanted = {
        "friction_coefficient": FRICTION / VALUES["bend_angle"], "tendon_stiffness": own, "load_stiffness": SPRING,
        "load_preload": PRELOAD,
    }  # fmt: skip
    assert found == pytest.approx(wanted, rel=1e-4)  # exact but for the parts that the tendon is cut into


@pytest.mark.parametrize("kept", [("load_tension",), ("drive_tension",), ("load_position",)])
def test_one_channel_beside_the_drive_tells_nothing(kept):
    series = [{n: Sampled(moved()[n], np.ones(1600, dtype=bool)) for n in ("drive_position", *kept)}]
    assert begin(plant_for("tendon_sheath"), series, VALUES, PERIOD) == {}
    assert begin(plant_for("cable_hole"), series, VALUES, PERIOD) == {}


def test_the_contacts_of_the_simulator_are_the_capstan_law_but_for_their_number():
    """Friction that is taken all together is off by 24 % of the tension between reversals, forty contacts by 1.1 %."""
    seen = moved()
    off = {}
    for contacts in (0, family("tendon_sheath").replayed.contacts):
        plant = plant_for("tendon_sheath", contacts=contacts)
        values = {p.name: p.default for p in plant.table} | {
            "friction_coefficient": FRICTION / np.pi, "load_stiffness": SPRING, "load_preload": PRELOAD,
            "tendon_stiffness": 1.0 / (1.0 / STIFFNESS - 1.0 / 60e3), "load_damping": 0.0, "tendon_damping": 0.0,
            "load_mass": 1e-3,
        }  # fmt: skip
        out = replay(
            plant, plant.table.pack(values)[:, None], seen["drive_position"], PERIOD, drive="follow",
            signals=("drive_tension", "load_tension"), start=float(seen["load_position"][0]), substeps=20,
        )[:, :, 0]  # fmt: skip
        drive, load = out[:, 0], out[:, 1]
        assert np.max(np.abs(load - seen["load_tension"])) < 0.02 * np.max(seen["load_tension"])
        off[contacts] = np.max(np.abs(drive - seen["drive_tension"])[100:] / seen["drive_tension"][100:])
    assert off[0] > 0.2 and off[40] < 0.012


def recording(folder, log, rows=900, **content):
    """What the log's first rows are as a recording, of which the owner states the bend alone."""
    folder.mkdir()
    records = []
    for name, text in log.files.items():
        kept = "".join(text.splitlines(keepends=True)[: 1 + rows])
        (folder / name).write_text(kept.replace(",", ".").replace(";", ","))
        records.append({"data": name, "use": "heldout" if name == log.heldout else "fit"})
    channels = {"time": {"column": "Zeit", "unit": "s"}}
    for column, channel in COLUMNS.items():
        channels[channel] = {"column": column, "unit": "mm" if channel == "drive_position" else "N"}
    known = {name: {"value": value, "unit": unit} for name, (value, unit, _) in log.owner.items()}
    path = folder / "recording.yaml"
    whole = {
        "schema": "cable-recording/1", "system": "tendon_sheath", "known": known, "records": records,
        "channels": channels,
    }  # fmt: skip
    path.write_text(yaml.safe_dump(whole | content))
    return path


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    return recording(tmp_path_factory.mktemp("catheter") / "plain", drawn(3))


def test_a_rig_says_at_how_many_places_it_rubs_and_else_it_is_along_all_of_the_sheath(made, tmp_path):
    plain = load_recording(made)
    assert simulator_of(plain, request_of(plain)).contacts == 40
    assert simulator_of(plain, request_of(plain, rig="bowden-1m")).contacts == 0
    lumped = load_recording(recording(tmp_path / "lumped", drawn(3), rig="bowden-1m"))
    assert simulator_of(lumped, request_of(lumped)).contacts == 0
    assert simulator_of(lumped, request_of(lumped, rig="bowden-1m-20")).contacts == 20
    question = prepare(plain)
    rig = question.rig({p.name: p.start for p in question.fit.parameters}, ())
    assert rig["contacts"] == 40 and load_rig(json.loads(json.dumps(rig))).simulated_by().contacts == 40
    assert "contacts" not in augmented_rig(plant_for("tendon_sheath"), {}, ())


def test_nothing_is_missing_where_a_tendon_rubs_along_all_of_its_sheath(made):
    log, found = drawn(3), diagnose(load_recording(made))
    assert (found.verdict, found.effects) == ("no_detectable_mismatch", ())
    true = {name: value for name, (value, _) in log.truth.items()}
    for name in ("friction_coefficient", "load_stiffness", "load_preload"):
        assert found.absorbed[name]["after_model"] == pytest.approx(true[name], rel=0.005)  # 0.1 % is usual
    assert found.fit["drive_tension"]["heldout_rmse"]["augmented"] < 0.04  # its noise is 0.03 N


@pytest.mark.slow
def test_a_gap_at_its_drive_is_named(tmp_path):
    log = worn_catheter(3)
    asked = ["backlash", "stiffness_hardening", "sensor_bias", "viscoelastic_creep"]  # what was named in its place
    found = diagnose(load_recording(recording(tmp_path / "worn", log)), effects=asked)
    assert [e.name for e in found.effects] == ["backlash"]
    gap, errors = found.effects[0].parameters["gap"], found.fit["drive_tension"]["heldout_rmse"]
    assert gap.low < log.truth["backlash"][0] < gap.high
    assert errors["augmented"] < 0.2 * errors["refit"]  # 0.10 N of 1.17 N; the noise is 0.03 N


def other(text, change):
    """A log with its columns of drive, tension there and tension at the tip changed, row by row."""
    head, *rows = text.splitlines()
    changed = [change(*(float(v.replace(",", ".")) for v in row.split(";"))) for row in rows]
    return "\n".join([head, *(";".join(f"{v:.4f}".replace(".", ",") for v in row) for row in changed)]) + "\n"


@pytest.mark.parametrize(
    ("change", "channel", "said"),
    [
        (lambda t, x, drive, tip: (t, x, tip, drive), "load_tension", "exchange the two"),
        (lambda t, x, drive, tip: (t, x, drive / 9.81, tip), "drive_tension", "kilograms and newtons"),
        (lambda t, x, drive, tip: (t, x, drive, 1e3 * tip), "load_tension", "the unit of one of them is wrong"),
        (lambda t, x, drive, tip: (t, -x, drive, tip), "drive_tension", "turn the sign"),
        (lambda t, x, drive, tip: (t, x, drive, -tip), "load_tension", "turn its sign"),
        (lambda t, x, drive, tip: (t, x, drive, tip), "", ""),
        (lambda t, x, drive, tip: (t, x, 1.2 * drive, 0.9 * tip), "", ""),
    ],
)
def test_columns_that_cannot_be_right_are_refused(change, channel, said, tmp_path):
    log = drawn(3)
    log = replace(log, files={name: other(text, change) for name, text in log.files.items()})
    faults = gate(load_recording(recording(tmp_path / "other", log, rows=2000))).faults
    assert [fault.channel for fault in faults[:1]] == ([channel] if channel else [])
    assert any(said in fault.text for fault in faults) or not channel
