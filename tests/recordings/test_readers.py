"""Readers: logs of any rig by a mapping, and what is said of files that are damaged."""

import json
import re
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
import yaml

from cable_envs.core.errors import ConfigurationError
from cable_envs.diagnosis.data.recording import load_recording
from cable_envs.diagnosis.readers import reader
from cable_envs.diagnosis.readers.base import Request
from cable_envs.diagnosis.readers.writer import write_data_set

MAPPING = {
    "schema": "cable-mapping/1",
    "system": "pulley_circuit",
    "channels": {
        "time": {"column": "t", "unit": "s"},
        "drive_angle": {"column": "q", "unit": "deg"},
        "output_angle": {"column": "jaw", "unit": "deg", "scale": 0.09, "sign": -1, "offset_free": "record"},
        "output_torque": {"column": "F", "unit": "N mm"},
    },
}


def signals(rows=2000, ratio=0.9, zero=0.0, seed=0):
    """Columns t, q, jaw (counts), F of a bench that moves to and fro, with sensors' noise."""
    rng = np.random.default_rng(seed)
    t = np.arange(rows) / 500
    q = 30 * np.sin(2 * np.pi * 0.5 * t)
    jaw = np.rint(-(ratio * q + zero) / 0.09)
    force = np.round(100 + 40 * np.sin(2 * np.pi * 0.5 * t + 0.3) + rng.normal(0, 1, rows), 2)
    return {"t": np.round(t, 3), "q": np.round(q, 4), "jaw": jaw, "F": force}


def lines_of(columns, delimiter=",", decimal="."):
    rows = zip(*(c.tolist() for c in columns.values()), strict=True)
    body = [delimiter.join(f"{v:g}".replace(".", decimal) if v == v else "" for v in row) for row in rows]
    return [delimiter.join(columns), *body]


def save(folder, lines, name="run.csv", end="\n", **changes):
    (folder / "logs").mkdir(exist_ok=True)
    (folder / "logs" / name).write_text("\n".join(lines) + end)
    (folder / "map.yaml").write_text(yaml.safe_dump(MAPPING | changes))
    return folder


def take(folder, form="table", path="logs", **options):
    """(recording, what was said) of an import."""
    strict = options.setdefault("strict", True)
    data = reader(form).open_dataset(folder / path, Request(folder / "map.yaml", strict))
    done = write_data_set(data, folder / "out", **options)
    return load_recording(done.path), done


def refused(folder, match, **options):
    with pytest.raises(ConfigurationError, match=match):
        take(folder, **options)
    assert not (folder / "out").exists()  # nothing half-written


def test_a_log_arrives_in_si_with_its_sign(tmp_path):
    columns = signals()
    recording, done = take(save(tmp_path, lines_of(columns)))
    (record,) = recording.records
    np.testing.assert_allclose(record.data["drive_angle"], np.radians(columns["q"]), rtol=1e-5, atol=1e-9)
    np.testing.assert_allclose(record.data["output_angle"], np.radians(-0.09 * columns["jaw"]), atol=1e-12)
    assert recording.channels["output_angle"].note == "sign turned"
    assert recording.offset_groups("output_angle") == {"run.csv": ("run.csv",)}
    assert done.faults == () and recording.offset_groups("drive_angle") == {}
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == ["recording.yaml", "run.csv"]


def test_decimal_commas_preamble_units_and_encoding_are_detected_and_said(tmp_path):
    columns = signals(100)
    lines = lines_of(columns, ";", ",")
    text = "\r\n".join(["Prüfstand 3", "", *lines[:1], "s;Grad;Ink;Nmm", *lines[1:]])
    save(tmp_path, [])
    (tmp_path / "logs" / "run.csv").write_bytes(text.encode("latin-1"))
    recording, done = take(tmp_path)
    expected = np.array([float(f"{v:g}") for v in columns["F"]]) * 1e-3
    np.testing.assert_allclose(recording.records[0].data["output_torque"], expected, rtol=1e-12)
    said = " ".join(done.remarks)
    for words in ("';' (detected)", "decimal commas (detected)", "latin-1", "row of units", "before the header"):
        assert words in said


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda s: s.insert(50, s[0]), r"run.csv, line 51: a header or remark among the rows"),
        (lambda s: s.__setitem__(50, "0.1,2"), r"run.csv, line 51: 2 cells where there should be 4"),
        (lambda s: s.__setitem__(-1, s[-1][:6]), r"line 101: \d cells .*the file ends here, in the middle of a row"),
        (lambda s: s.__setitem__(50, "0.098,1,2x,3"), r"line 51, channel output_angle: '2x' in column 'jaw'"),
        (lambda s: s.__setitem__(50, s[49]), r"line 51, channel time: time 0.096 s again"),
        (lambda s: s.__setitem__(50, "0.001,1,2,3"), r"line 51, channel time: time goes back from 0.096 s to 0.001 s"),
        (lambda s: s.__setitem__(50, ",1,2,3"), r"line 51, channel time: no time"),
    ],
)
def test_damage_is_refused_by_line_or_left_out_and_told(tmp_path, spoil, message):
    lines = lines_of(signals(100))
    spoil(lines)
    save(tmp_path, lines)
    refused(tmp_path, message)
    recording, done = take(tmp_path, strict=False)
    assert any(re.search(message, fault) for fault in done.faults)
    record = recording.records[0]
    lost = len(lines) - 1 - len(record.time) + int(np.isnan(record.data["output_angle"]).sum())
    assert lost == 1 and record.quality


def test_decimal_commas_between_commas_cannot_be_told_apart(tmp_path):
    lines = lines_of(signals(50))
    refused(
        save(tmp_path, [lines[0], *(line.replace(".", ",") + ",0,0,0" for line in lines[1:])]),
        "decimal commas in a file",
    )


def test_a_command_may_be_held(tmp_path):
    entries = {n: e for n, e in MAPPING["channels"].items() if n != "drive_angle"}
    command = {"drive_angle_command": {"column": "q", "unit": "deg", "hold": "step"}}
    recording, _ = take(save(tmp_path, lines_of(signals()), channels=entries | command))
    assert (
        recording.channels["drive_angle_command"].hold == "step" and recording.channels["output_angle"].hold == "line"
    )
    (tmp_path / "wrong").mkdir()
    command["drive_angle_command"]["hold"] = "steps"
    refused(save(tmp_path / "wrong", lines_of(signals()), channels=entries | command), "hold.*'steps'.*step")


def test_a_missing_column_and_a_missing_mapping_are_named(tmp_path):
    save(tmp_path, ["t,q,jaws,F", "0,1,2,3", "1,1,2,3"])
    refused(tmp_path, "run.csv: no column 'jaw'; did you mean 'jaws'")
    with pytest.raises(ConfigurationError, match="table needs --mapping"):
        reader("table").open_dataset(tmp_path / "logs", Request())
    with pytest.raises(ConfigurationError, match="unknown format 'tabel'; did you mean 'table'"):
        reader("tabel")


def test_a_stuck_encoder_is_noted_and_not_used_but_a_dead_band_is_not(tmp_path):
    columns = signals()
    columns["jaw"][600:800] = columns["jaw"][600]  # 0.4 s of a 2 s cycle
    recording, done = take(save(tmp_path, lines_of(columns)))
    (doubt,) = recording.records[0].quality
    assert (doubt.kind, doubt.channel) == ("stuck", "output_angle")
    assert (doubt.start, doubt.end) == pytest.approx((1.2, 1.598), abs=0.01)
    assert "run.csv, rows 601 to 800, channel output_angle" in done.faults[0]
    usable = recording.records[0].usable("output_angle")
    assert not usable[600:800].any() and usable[:590].all() and recording.records[0].usable("drive_angle").all()


def test_a_dead_band_at_reversals_is_no_stuck_encoder(tmp_path):
    columns = signals()
    play, jaw = 1.5, np.empty(len(columns["q"]))  # deg to either side, of a travel of 60
    at = 0.0
    for k, q in enumerate(columns["q"]):
        at = min(max(at, q - play), q + play)
        jaw[k] = np.rint(-at / 0.09)
    recording, done = take(save(tmp_path, lines_of(columns | {"jaw": jaw})))
    assert done.faults == () and len(recording.records[0].time) == 2000


def test_a_saturating_torque_sensor_is_noted_where_it_is_flat(tmp_path):
    columns = signals()
    columns["F"] = np.minimum(columns["F"], 125.0)
    recording, _ = take(save(tmp_path, lines_of(columns)))
    doubts = recording.records[0].quality
    assert doubts and {(d.kind, d.channel) for d in doubts} == {("saturated", "output_torque")}
    flat = columns["F"] == 125.0
    usable = recording.records[0].usable("output_torque")
    assert usable[~flat].all() and (~usable[flat]).mean() > 0.8


def test_gaps_and_short_records_are_noted(tmp_path):
    columns = signals()
    save(tmp_path, lines_of({n: np.delete(v, slice(500, 550)) for n, v in columns.items()}), "a.csv")
    save(tmp_path, lines_of(columns), "b.csv")
    save(tmp_path, lines_of({n: v[:300] for n, v in columns.items()}), "c.csv")
    _, done = take(tmp_path)
    assert any(re.search(r"a.csv, line 502, channel time: 0.102 s without a row after 0.998 s", f) for f in done.faults)
    assert any(re.search(r"c.csv: lasts 0.598 s where the others last 3.998 s", f) for f in done.faults)
    assert len(done.faults) == 2


def test_records_swapped_between_tools_are_named(tmp_path):
    files = {"a1": ("A", 0.9), "a2": ("A", 0.9), "a3": ("A", 0.9), "b1": ("B", 0.7), "b2": ("B", 0.7), "b3": ("B", 0.7)}
    tools = {name: tool for name, (tool, _) in files.items()} | {"a2": "B", "b2": "A"}  # what the mapping believes
    listed = [{"file": f"{name}.csv", "conditions": {"tool": tool}} for name, tool in tools.items()]
    for k, (name, (_, ratio)) in enumerate(files.items()):
        save(tmp_path, lines_of(signals(ratio=ratio, seed=k)), f"{name}.csv", records=listed, group="tool")
    recording, done = take(tmp_path)
    assert [f.split(":")[0] for f in done.faults] == ["a2.csv", "b2.csv"]
    assert re.search(r"ratio of output to drive is 0.9\S*, in the others of tool B 0.[67]", done.faults[0])
    assert [r.name for r in recording.records if r.quality] == ["a2.csv", "b2.csv"]


def test_splits_by_condition_and_by_time(tmp_path):
    listed = [{"file": f"{k}.csv", "conditions": {"load": k}} for k in (1, 2, 3)]
    for k in (1, 2, 3):
        save(tmp_path, lines_of(signals(seed=k)), f"{k}.csv", records=listed)
    recording, _ = take(tmp_path, chosen=["load<3"], heldout=["load=2"], after=3.0)
    assert {r.name: r.use for r in recording.records} == {
        "1.csv": "fit", "1_after.csv": "heldout", "2.csv": "heldout", "2_after.csv": "heldout",
    }  # fmt: skip
    first, rest = recording.records[:2]
    assert first.time[-1] < 3.0 == rest.time[0] and rest.conditions == {"load": 1.0, "continues": "1.csv"}
    with pytest.raises(ConfigurationError, match=r"holds 1.csv: choose another folder"):
        take(tmp_path)
    with pytest.raises(ConfigurationError, match="every record is held out"):
        write_data_set(
            reader("table").open_dataset(tmp_path / "logs", Request(tmp_path / "map.yaml")),
            tmp_path / "o",
            heldout=["*"],
        )
    assert not (tmp_path / "o").exists()


def test_parquet_in_and_out_and_a_counted_clock(tmp_path):
    pyarrow = pytest.importorskip("pyarrow")
    parquet = pytest.importorskip("pyarrow.parquet")
    columns = signals()
    save(tmp_path, [], channels=MAPPING["channels"] | {"time": {"sample_rate": 500}})
    (tmp_path / "logs" / "run.csv").unlink()
    parquet.write_table(pyarrow.table(columns), tmp_path / "logs" / "run.parquet")
    recording, _ = take(tmp_path, table="parquet")
    (record,) = recording.records
    np.testing.assert_allclose(record.time, columns["t"], atol=1e-12)
    np.testing.assert_array_equal(record.data["output_torque"], columns["F"] * 1e-3)
    (tmp_path / "logs" / "run.parquet").write_bytes((tmp_path / "logs" / "run.parquet").read_bytes()[:-100])
    with pytest.raises(ConfigurationError, match=r"run.parquet is not whole"):
        write_data_set(reader("table").open_dataset(tmp_path / "logs", Request(tmp_path / "map.yaml")), tmp_path / "p")


@pytest.mark.parametrize("version", ["5", "7.3"])
def test_matlab_variables_by_path(tmp_path, version):
    columns, names = signals(300), {"t": "log.t", "q": "log.m.q", "jaw": "X(:,2)", "F": "F"}
    save(tmp_path, [], channels={n: e | {"column": names[e["column"]]} for n, e in MAPPING["channels"].items()})
    file, matrix = tmp_path / "run.mat", np.column_stack([columns["t"], columns["jaw"]])
    if version == "5":
        from scipy.io import savemat

        savemat(file, {"log": {"t": columns["t"], "m": {"q": columns["q"]}}, "X": matrix, "F": columns["F"][:, None]})
    else:
        h5py = pytest.importorskip("h5py")
        with h5py.File(file, "w", userblock_size=512) as h5:
            h5["log/t"], h5["log/m/q"], h5["X"], h5["F"] = (
                columns["t"][None],
                columns["q"][:, None],
                matrix.T,
                columns["F"][None],
            )
        with file.open("r+b") as raw:  # what MATLAB writes before the HDF5 part
            raw.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")
    recording, _ = take(tmp_path, "mat", "run.mat")
    np.testing.assert_array_equal(recording.records[0].data["output_torque"], columns["F"] * 1e-3)
    np.testing.assert_allclose(recording.records[0].data["output_angle"], np.radians(-0.09 * columns["jaw"]))
    file.write_bytes(file.read_bytes()[:900])
    with pytest.raises(ConfigurationError, match=r"run.mat is not whole, or no MATLAB file"):
        write_data_set(reader("mat").open_dataset(file, Request(tmp_path / "map.yaml")), tmp_path / "o")


@pytest.mark.parametrize("kind", ["bag", "sqlite3", "mcap"])
def test_bags_without_ros(tmp_path, kind):
    pytest.importorskip("rosbags")
    columns = signals(400)
    bag = tmp_path / ("run.bag" if kind == "bag" else "run")
    _write_bag(bag, kind, columns)
    state = {"topic": "/joints"}
    save(tmp_path, [], channels={
        "time": state, "drive_angle": {**state, "field": "position[0]", "unit": "rad"},
        "output_angle": {**state, "field": "position[1]", "unit": "rad"},
        "output_torque": {"topic": "/wrench", "field": "wrench.torque.z", "unit": "N m"},
    })  # fmt: skip
    recording, done = take(tmp_path, "rosbag", bag.name)
    record = recording.records[0]
    np.testing.assert_allclose(record.time, columns["t"], atol=1e-6)
    np.testing.assert_allclose(record.data["drive_angle"], columns["q"], atol=1e-9)
    inner = slice(2, -2)  # every second message carries a torque; between them it is a straight line
    np.testing.assert_allclose(record.data["output_torque"][inner][::2], columns["F"][inner][::2], atol=1e-3)
    assert any("/wrench interpolated onto the times of /joints" in r for r in done.remarks)
    (tmp_path / "map.yaml").write_text((tmp_path / "map.yaml").read_text().replace("/wrench", "/wrenches"))
    with pytest.raises(ConfigurationError, match="no topic '/wrenches'; did you mean '/wrench'"):
        write_data_set(reader("rosbag").open_dataset(bag, Request(tmp_path / "map.yaml")), tmp_path / "o")


def _write_bag(path, kind, columns):
    from rosbags import rosbag1, rosbag2
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC if kind == "bag" else Stores.ROS2_HUMBLE)
    types = store.types
    if kind == "bag":
        writer, encode = rosbag1.Writer(path), store.serialize_ros1
    else:
        plugin = rosbag2.StoragePlugin.MCAP if kind == "mcap" else rosbag2.StoragePlugin.SQLITE3
        writer, encode = rosbag2.Writer(path, version=9, storage_plugin=plugin), store.serialize_cdr
    vector = types["geometry_msgs/msg/Vector3"]
    with writer:
        joints = writer.add_connection("/joints", "sensor_msgs/msg/JointState", typestore=store)
        wrench = writer.add_connection("/wrench", "geometry_msgs/msg/WrenchStamped", typestore=store)
        for k, (t, q, jaw, force) in enumerate(zip(*columns.values(), strict=True)):
            nanoseconds = 1_780_000_000_000_000_000 + round(t * 1e9)
            stamp = types["builtin_interfaces/msg/Time"](sec=nanoseconds // 10**9, nanosec=nanoseconds % 10**9)
            seq = {"seq": k} if kind == "bag" else {}
            header = types["std_msgs/msg/Header"](stamp=stamp, frame_id="", **seq)
            state = types["sensor_msgs/msg/JointState"](
                header, ["m", "j"], np.array([q, jaw]), np.zeros(0), np.zeros(0)
            )
            writer.write(joints, nanoseconds, encode(state, "sensor_msgs/msg/JointState"))
            if k % 2 == 0:
                both = types["geometry_msgs/msg/Wrench"](vector(0.0, 0.0, 0.0), vector(0.0, 0.0, float(force)))
                message = types["geometry_msgs/msg/WrenchStamped"](header, both)
                writer.write(wrench, nanoseconds, encode(message, "geometry_msgs/msg/WrenchStamped"))


def test_a_format_of_ones_own_is_one_file(tmp_path):
    (tmp_path / "mine.py").write_text(
        "import numpy as np\n"
        "from cable_envs.diagnosis.readers.base import ChannelSpec, DataSet, RecordSpec, whole\n"
        "SUMMARY = 'mine'\n"
        "def open_dataset(path, asked):\n"
        "    columns = {'time': np.arange(9.0), 'force': np.arange(9.0) ** 2}\n"
        "    channels = (ChannelSpec('time', 's'), ChannelSpec('force', 'kN'))\n"
        "    return DataSet('linear_drive', 'mine', channels, (RecordSpec('one', path.name, whole(columns)),))\n"
    )
    data = reader(str(tmp_path / "mine.py")).open_dataset(tmp_path, Request())
    recording = load_recording(write_data_set(data, tmp_path / "out").path)
    np.testing.assert_allclose(recording.records[0].data["force"], 1000.0 * np.arange(9.0) ** 2)


def _long(path: Path, rows: int) -> None:
    with path.open("w") as file:
        file.write("t,q,jaw,F\n")
        for first in range(0, rows, 100_000):
            t = np.arange(first, min(first + 100_000, rows)) * 1e-3
            q = 30 * np.sin(t)
            np.savetxt(file, np.column_stack([t, q, np.rint(-10 * q), 100 + q % 7]), delimiter=",", fmt="%.7g")


@pytest.mark.parametrize("rows", [200_000, pytest.param(10_000_000, marks=pytest.mark.slow)])
def test_memory_does_not_grow_with_the_log(tmp_path, rows):
    """A log of 200 000 rows is 13 MB as numbers of Python; what is held is some chunks of 65 536 rows."""
    save(tmp_path, [], channels=MAPPING["channels"] | {"time": {"sample_rate": 1000}})
    _long(tmp_path / "logs" / "run.csv", rows)
    data = reader("table").open_dataset(tmp_path / "logs", Request(tmp_path / "map.yaml"))
    tracemalloc.start()
    try:
        done = write_data_set(data, tmp_path / "out", table="parquet")
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert done.rows == {"run.parquet": rows}
    assert peak < 100e6  # two chunks as text, one as numbers


def test_a_wrong_mapping_is_told_what_would_be_right(tmp_path):
    save(tmp_path, lines_of(signals(50)))
    for change, message in (
        ({"system": "pulley"}, "unknown system 'pulley'; did you mean 'pulley_circuit'"),
        ({"chanels": {}}, "unknown key in map.yaml 'chanels'; did you mean 'channels'"),
        ({"channels": {"time": {"column": "t", "unit": "s"}, "jaw": {}}}, "unknown channel in map.yaml 'jaw'"),
        ({"channels": MAPPING["channels"] | {"time": {"column": "t", "unit": "N"}}}, "unit 'N' does not fit"),
        ({"channels": MAPPING["channels"] | {"time": {"column": "t", "unit": "s", "sign": 2}}}, "sign must be 1 or -1"),
        ({"layout": {"delimiter": "x"}}, "unknown delimiter in map.yaml 'x'"),
        ({"records": [{"file": "run.csv", "use": "test"}]}, "unknown use in map.yaml: record 1 'test'"),
    ):
        (tmp_path / "map.yaml").write_text(json.dumps(MAPPING | change))
        refused(tmp_path, message)
