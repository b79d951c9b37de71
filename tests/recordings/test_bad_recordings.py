"""Damaged copies of the published drive and brake sets: named by file and place, not diagnosed away.

The jaw's are in test_real_recordings.py, a rig's own tables in test_readers.py.
"""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from cable_envs.core.errors import ConfigurationError
from cable_envs.diagnosis.data.recording import load_recording
from cable_envs.diagnosis.intake.gate import gate
from cable_envs.diagnosis.readers import reader
from cable_envs.diagnosis.readers.base import Request
from cable_envs.diagnosis.readers.writer import write_data_set

SETS = Path(__file__).parents[3] / "shared" / "recordings"
needs = {
    name: pytest.mark.skipif(not (SETS / name).is_dir(), reason=f"the published set {name} is not at {SETS / name}")
    for name in ("band_brake", "emps", "coupled_drives", "davinci_tool")
}
BRAKE = "dataset2_0.5Hz30lbtension1amplitude.json"


def take(form, tmp_path, name, text, strict=True):
    folder = tmp_path / "set"
    folder.mkdir(exist_ok=True)
    (folder / name).write_text(text)
    out = tmp_path / f"out_{len(list(tmp_path.iterdir()))}"
    done = write_data_set(reader(form).open_dataset(folder, Request(None, strict)), out, strict=strict)
    return load_recording(done.path), done


def lines_of(name):
    return (SETS / name).read_text().splitlines()


def with_commas(lines):
    return "\n".join(";".join(cell.replace(".", ",") for cell in line.split(",")) for line in lines) + "\n"


@needs["emps"]
def test_an_axis_log_that_was_cut_off_is_said_to_be(tmp_path):
    text = (SETS / "emps" / "EMPS_est.csv").read_text()
    cut = text[: text.index("\n", 300_000) - 3]  # in the middle of the last number
    _, done = take("emps", tmp_path, "EMPS_est.csv", cut)
    assert done.faults == ("EMPS_est.csv: 18607 rows, 24841 are published: cut off?",)
    assert any("the last line has no end: its last number may be cut off" in remark for remark in done.remarks)


@needs["emps"]
def test_an_axis_with_its_columns_swapped_or_its_encoder_stuck_is_named(tmp_path):
    lines = lines_of("emps/EMPS_est.csv")
    swapped = "\n".join(",".join(reversed(line.split(","))) for line in lines) + "\n"
    _, done = take("emps", tmp_path, "EMPS_est.csv", swapped)
    assert (
        len(done.faults) == 1 and "moves over 8.46 m and the voltage over 0.246 V: columns swapped?" in done.faults[0]
    )
    held = [line.split(",") for line in lines]
    for row in held[7000:8500]:
        row[1] = held[7000][1]
    recording, done = take("emps", tmp_path, "EMPS_est.csv", "\n".join(map(",".join, held)) + "\n")
    record = recording.records[0]
    assert [d.kind for d in record.quality] == ["stuck"]
    assert not record.usable("position")[7000:8500].any() and record.usable("position")[:7000].all()


@needs["emps"]
@needs["coupled_drives"]
def test_decimal_commas_are_read_as_such_and_said(tmp_path):
    lines = lines_of("emps/EMPS_est.csv")[:2000]
    recording, done = take("emps", tmp_path, "EMPS_est.csv", with_commas(lines))
    np.testing.assert_allclose(recording.records[0].data["voltage"], [float(line.split(",")[0]) for line in lines])
    assert any("decimal commas (detected)" in remark for remark in done.remarks)
    drives = lines_of("coupled_drives/DATAUNIF.csv")
    again = tmp_path / "drives"
    again.mkdir()
    recording, _ = take("coupled-drives", again, "DATAUNIF.csv", with_commas(drives))
    column = drives[0].replace('"', "").split(",").index("z11")
    wanted = [float(line.split(",")[column]) for line in drives[1:401]]
    np.testing.assert_allclose(recording.records[0].data["speed_reading"], wanted)


@needs["davinci_tool"]
def test_a_jaw_file_saved_with_decimal_commas_is_read_the_same(tmp_path):
    name = "Tool_4_Maryland_L_4_20.TXT"
    lines = lines_of(f"davinci_tool/{name}")[:4000]
    commas = [line if line.startswith("%") else with_commas([line]).strip() for line in lines]
    plain, _ = take("da-vinci-jaw", tmp_path, name, "\n".join(lines) + "\n")
    (tmp_path / "again").mkdir()
    other, _ = take("da-vinci-jaw", tmp_path / "again", name, "\n".join(commas) + "\n")
    for channel, values in plain.records[0].data.items():
        np.testing.assert_array_equal(other.records[0].data[channel], values)


@needs["coupled_drives"]
@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda t: t[:9000], "line 286: 1 cells where there should be 5; the file ends here, in the middle of a row"),
        (lambda t: t.replace("\n", "\n" + t.split("\n")[0] + "\n", 3), "line 4: a header or remark among the rows"),
    ],
)
def test_damage_of_the_coupled_drives_file_is_refused_by_line(tmp_path, spoil, said):
    text = (SETS / "coupled_drives" / "DATAUNIF.csv").read_text()
    with pytest.raises(ConfigurationError, match=said):
        take("coupled-drives", tmp_path, "DATAUNIF.csv", spoil(text))


@needs["coupled_drives"]
def test_a_short_record_and_files_under_each_others_names_are_named(tmp_path):
    lines = lines_of("coupled_drives/DATAUNIF.csv")
    recording, done = take("coupled-drives", tmp_path, "DATAUNIF.csv", "\n".join(lines[:300]) + "\n")
    assert {str(fault).split(": ", 1)[1] for fault in done.faults} == {"299 rows, 500 are published: cut off?"}
    assert not recording.used_for("heldout")
    (tmp_path / "set" / "DATAUNIF.csv").unlink()
    with pytest.raises(ConfigurationError, match=r"DATAPRBS.csv: no column 'u1'; did you mean 'u12'"):
        take("coupled-drives", tmp_path, "DATAPRBS.csv", "\n".join(lines) + "\n")


def spoiled(change):
    content = json.loads((SETS / "band_brake" / BRAKE).read_text())
    content["data"] = content["data"][:8000]
    change(content["data"])
    return json.dumps(content)


def _stick(rows):
    for row in rows[6000:6600]:
        row[1] = rows[6000][1]


def _saturate(rows):
    for row in rows:
        row[2] = min(max(row[2], -2.1), 2.1)


def _swap(rows):
    for row in rows:
        row[4], row[5] = row[5], row[4]


@needs["band_brake"]
@pytest.mark.parametrize(
    ("change", "kind", "channel", "said"),
    [
        (_stick, "stuck", "position", "stays at .* for 600 rows, .* while velocity makes a way of"),
        (_saturate, "saturated", "force", "flat at its limit 2.1 for"),
        (_swap, "label", "band_tension_1", "the first end of the band is tight where the force is positive"),
    ],
)
def test_faults_of_the_brakes_sensors_are_noted_with_their_place(tmp_path, change, kind, channel, said):
    recording, done = take("band-brake", tmp_path, BRAKE, spoiled(change))
    assert {(d.kind, d.channel) for d in recording.records[0].quality} == {(kind, channel)}
    assert re.search(said, done.faults[0])


@needs["band_brake"]
@pytest.mark.parametrize("row", [["time", "d", "f", "v", "a", "b"], [0.4, 0.1, "0,73", 0.3, 1.0, 2.0], [0.4, 0.1]])
def test_a_row_of_the_brake_that_is_no_row_is_refused_by_number(tmp_path, row):
    with pytest.raises(ConfigurationError, match=r"amplitude.json, row 401: expected 6 numbers, found"):
        take("band-brake", tmp_path, BRAKE, spoiled(lambda rows: rows.insert(400, row)))


@needs["band_brake"]
def test_brake_records_under_each_others_names_are_named(tmp_path):
    names = sorted(p.name for p in (SETS / "band_brake").glob("*.json"))
    folder = tmp_path / "set"
    folder.mkdir()
    (folder / names[1]).write_text((SETS / "band_brake" / names[0]).read_text())
    _, done = take("band-brake", tmp_path, names[0], (SETS / "band_brake" / names[1]).read_text())
    assert len(done.faults) == 2 and all("files swapped?" in fault for fault in done.faults)


def _constant(values):
    values[:] = 0.31


def _held(values):
    values[7000:8500] = values[7000]


def _clipped(values):
    np.clip(values, -2.0, 2.0, out=values)


@needs["emps"]
@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (_constant, "channel voltage, row 1: constant at 0.31: nothing drives the rig, or the wrong column"),
        (_held, "channel voltage, row 7001: 1500 equal samples in a row, .*: stuck"),
        (_clipped, None),  # an amplifier's limit is what the drive was told: no fault
    ],
)
def test_an_axis_whose_voltage_does_not_move_is_refused_before_any_physics(tmp_path, spoil, said):
    table = np.array([[float(cell) for cell in line.split(",")] for line in lines_of("emps/EMPS_est.csv")[:10_000]])
    spoil(table[:, 0])
    text = "\n".join(f"{u:.9g},{x:.9g}" for u, x in table) + "\n"
    recording, _ = take("emps", tmp_path, "EMPS_est.csv", text)
    if said is None:
        gate(recording).require_usable()
        return
    with pytest.raises(ConfigurationError, match=said):
        gate(recording).require_usable()


@needs["coupled_drives"]
@pytest.mark.parametrize(
    ("first", "last", "value", "said"),
    [
        (0, 500, 2.0, "speed_reading, row 1: constant at 2"),
        (100, 180, 0.7, "speed_reading, row 1..: .* in a row, 0.7: stuck"),
    ],
)
def test_a_reading_that_does_not_move_is_refused_before_any_physics(tmp_path, first, last, value, said):
    lines = lines_of("coupled_drives/DATAUNIF.csv")
    column = lines[0].replace('"', "").split(",").index("z11")
    rows = [line.split(",") for line in lines[1:]]
    for row in rows[first:last]:
        row[column] = str(value)
    text = "\n".join([lines[0], *(",".join(row) for row in rows)]) + "\n"
    recording, _ = take("coupled-drives", tmp_path, "DATAUNIF.csv", text)
    with pytest.raises(ConfigurationError, match=said):
        gate(recording).require_usable()
