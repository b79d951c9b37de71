"""Recording format, version 1: what is read, and what a wrong file is told."""

import numpy as np
import pytest
import yaml

from cable_envs.core.errors import ConfigurationError
from cable_envs.diagnosis.data.description import channels_of, parameters_of
from cable_envs.diagnosis.data.recording import load_recording
from cable_envs.plants import families

BASE = {
    "schema": "cable-recording/1",
    "system": "cable_hole",
    "rig": "gu-inferred",
    "known": {"wrap_angle": {"value": 60, "unit": "deg"}, "load_mass": 5},
    "nominal": {
        "friction_coefficient": {"value": 0.43, "std": 0.05},
        "cable_stiffness": {"value": 60, "unit": "N/mm", "std": 2},
    },
    "records": [{"data": "a.csv", "use": "fit"}, {"data": "b.csv", "use": "heldout"}],
    "channels": {
        "time": {"column": "t", "unit": "ms"},
        "drive_position": {"column": "x", "unit": "mm", "scale": 0.5, "offset": 1.0, "noise_std": 0.01},
        "drive_tension": {"column": "F", "unit": "N"},
    },
}
TABLE = "t,x,F,other\n0,0,49,a\n10,2,,b\n20,4,51,c\n"


def write(folder, table=TABLE, **changes):
    """A recording in ``folder``; ``changes`` replace top-level keys, None removes one."""
    content = {k: v for k, v in (BASE | changes).items() if v is not None}
    (folder / "a.csv").write_text(table)
    (folder / "b.csv").write_text(TABLE)
    path = folder / "rig.yaml"
    path.write_text(yaml.safe_dump(content))
    return path


def test_values_arrive_in_si(tmp_path):
    recording = load_recording(write(tmp_path))
    record = recording.used_for("fit")[0]
    assert record.time == pytest.approx([0.0, 0.01, 0.02])
    assert record.data["drive_position"] == pytest.approx([1e-3, 2e-3, 3e-3])  # (0.5 raw + 1) mm
    assert np.isnan(record.data["drive_tension"][1])  # an empty cell is a gap
    assert recording.channels["drive_position"].noise_std == pytest.approx(1e-5)
    assert recording.known["wrap_angle"].value == pytest.approx(np.pi / 3) and recording.known["load_mass"].value == 5.0
    assert recording.nominal["friction_coefficient"].std == 0.05
    assert recording.nominal["cable_stiffness"].std == pytest.approx(2000.0)
    assert recording.value("friction_coefficient") == 0.43 and recording.value("radius_ratio") == 1.5  # from the rig
    assert [r.name for r in recording.used_for("heldout")] == ["b.csv"]


def test_a_folder_and_other_delimiters_are_read(tmp_path):
    write(tmp_path, "\ufefft;x;F\r\n0;1;2\r\n1;2;3\r\n\r\n")
    recording = load_recording(tmp_path)
    assert recording.records[0].data["drive_tension"] == pytest.approx([2.0, 3.0])


def test_parquet_equals_csv(tmp_path):
    pyarrow = pytest.importorskip("pyarrow")
    parquet = pytest.importorskip("pyarrow.parquet")

    table = pyarrow.table({"t": [0, 10, 20], "x": [0.0, 2.0, 4.0], "F": [49.0, None, 51.0], "other": ["a", "b", "c"]})
    parquet.write_table(table, tmp_path / "c.parquet")
    records = [{"data": "a.csv"}, {"data": "c.parquet"}]
    csv_record, parquet_record = load_recording(write(tmp_path, records=records)).records
    for name in BASE["channels"]:
        np.testing.assert_array_equal(csv_record.data[name], parquet_record.data[name])
    bad = BASE["channels"] | {"load_tension": {"column": "other", "unit": "N"}}
    with pytest.raises(
        ConfigurationError, match=r"c.parquet, channel load_tension \(column 'other'\): expected numbers"
    ):
        load_recording(write(tmp_path, records=[{"data": "c.parquet"}], channels=bad))


@pytest.mark.parametrize("system", [name for name, one in families().items() if one.channels])
def test_every_system_has_channels_and_parameters(system):
    assert "time" in channels_of(system) and len(parameters_of(system)) > 5


def test_a_row_that_a_logger_wrote_twice_is_left_out(tmp_path):
    """It is the row before once more, its time and its empty cells included; other rows at one time are refused."""
    table = "t,x,F\n0,0,49\n10,2,\n10,2,\n20,4,51\n20,4,51\n20,4,51\n30,4,51\n"
    record = load_recording(write(tmp_path, table)).records[0]
    assert record.repeated == (3, 5, 6) and len(record.time) == 4
    np.testing.assert_allclose(record.time, [0.0, 0.01, 0.02, 0.03])
    np.testing.assert_allclose(record.data["drive_tension"], [49.0, np.nan, 51.0, 51.0])
    with pytest.raises(ConfigurationError, match="row 5: time must increase"):
        load_recording(write(tmp_path, table.replace("20,4,51\n20,4,51\n20,4,51", "20,4,51\n20,5,51")))


CHANGES = [
    ({"schema": "cable-recording/2"}, "'schema' must be 'cable-recording/1'"),
    ({"system": "cablehole"}, "unknown system 'cablehole'; did you mean 'cable_hole'"),
    ({"rig": "zou-table2"}, "rig 'zou-table2' belongs to pulley_circuit"),
    ({"rig": "gu-infered"}, "did you mean 'gu-inferred'"),
    ({"recrods": []}, "unknown key in rig.yaml 'recrods'; did you mean 'records'"),
    ({"records": []}, "'records' must be a list"),
    ({"records": [{"data": "a.csv", "use": "train"}]}, "record 1: use 'train' is unknown"),
    ({"records": [{"data": "a.csv", "use": "heldout"}]}, "no record has 'use: fit'"),
    ({"records": [{"data": "a.csv"}, {"data": "a.csv"}]}, "listed twice"),
    ({"records": [{"data": "no.csv"}]}, "cannot read .*no.csv"),
    ({"records": [{"data": "a.mat"}]}, "a.mat: expected a CSV"),
    ({"known": {"load_mas": 5}}, "unknown parameter in rig.yaml: known 'load_mas'; did you mean 'load_mass'"),
    ({"known": {"load_mass": {"value": 5, "unit": "m"}}}, "rig.yaml: known: load_mass: unit 'm' does not fit"),
    ({"known": {"friction_coefficient": 0.4}}, "'friction_coefficient' is both known and nominal"),
    ({"nominal": {"friction_coefficient": {"value": 0.4, "std": 0}}}, "std of friction_coefficient: must be positive"),
    ({"channels": {"drive_tension": {"column": "F", "unit": "N"}}}, "and hold 'time'"),
]


def _channel(**entry):
    return {"channels": BASE["channels"] | {"drive_tension": entry}}


CHANGES += [
    (_channel(column="F"), "channel drive_tension: expected {column: NAME, unit: N}"),
    (_channel(column="F", unit="bar"), "channel drive_tension: unit 'bar' does not fit"),
    (_channel(column="F", unit="N", scale=0), "scale 0"),
    (_channel(column="F", unit="N", noise_std=-1), "noise_std must be positive"),
    (_channel(column="F", unit="N", gain=2), "unknown key in rig.yaml: channel drive_tension 'gain'"),
    (_channel(column="f", unit="N"), "a.csv, channel drive_tension: no column 'f'"),
    (
        _channel(column="other", unit="N"),
        r"a.csv, channel drive_tension \(column 'other'\), row 1: 'a' is not a number",
    ),
    (
        {"channels": BASE["channels"] | {"tension": {"column": "F", "unit": "N"}}},
        "unknown channel in rig.yaml 'tension'",
    ),
]


@pytest.mark.parametrize(("changes", "message"), CHANGES)
def test_bad_descriptions_are_refused(tmp_path, changes, message):
    with pytest.raises(ConfigurationError, match=message):
        load_recording(write(tmp_path, **changes))


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ("", "a.csv: the file is empty"),
        ("t,x,F\n0,0,49\n", "at least two samples, found 1"),
        ("t,x,F\n0,0,49\n10,2\n", "a.csv, row 2: 2 cells where the header has 3"),
        ("t,x,F\n0,0,49\n10,2,5e\n", r"a.csv, channel drive_tension \(column 'F'\), row 2: '5e' is not a number"),
        ("t;x;F\n0;0;49\n1;2;49,5\n", r"row 2: '49,5' is not a number \(decimal comma\?\)"),
        ("t,x,F\n0,0,49\n10,2,inf\n", r"channel drive_tension .* row 2: not a finite number"),
        ("t,x,F\n0,0,49\n,2,50\n", r"channel time \(column 't'\), row 2: no time"),
        ("t,x,F\n0,0,49\n10,2,50\n10,3,51\n", r"channel time \(column 't'\), row 3: time must increase"),
        ("t,x,F\n0,0,\n10,2,nan\n", r"channel drive_tension \(column 'F'\): no values"),
        ("t,x,F,F\n0,0,1,1\n10,2,1,1\n", "column 'F' appears twice"),
    ],
)
def test_bad_tables_are_refused(tmp_path, table, message):
    with pytest.raises(ConfigurationError, match=message):
        load_recording(write(tmp_path, table))


def test_a_folder_needs_exactly_one_description(tmp_path):
    with pytest.raises(ConfigurationError, match="exactly one YAML file, found none"):
        load_recording(tmp_path)
    write(tmp_path)
    (tmp_path / "second.yml").write_text("{}")
    with pytest.raises(ConfigurationError, match=r"found rig.yaml, second.yml"):
        load_recording(tmp_path)


def test_binary_files_are_refused(tmp_path):
    path = write(tmp_path)
    (tmp_path / "a.csv").write_bytes(b"\xff\xfe\x00\x81")
    with pytest.raises(ConfigurationError, match=r"a.csv is not a text table"):
        load_recording(path)


def test_missing_channels_are_named(tmp_path):
    with pytest.raises(ConfigurationError, match="identification needs the channels load_tension, wrap_angle"):
        load_recording(write(tmp_path)).require("load_tension", "wrap_angle", purpose="identification")
