"""Recordings of arrays and data frames: the same as the same numbers in files, and refused for the same reasons."""

import json
from dataclasses import replace

import numpy as np
import pytest
import yaml

from cable_envs.core.errors import ConfigurationError
from cable_envs.diagnosis import Recording, diagnose, load_recording
from cable_envs.diagnosis.asked import request_of
from cable_envs.diagnosis.readers.base import ChannelSpec, DataSet, RecordSpec, whole
from cable_envs.diagnosis.readers.writer import write_data_set
from cable_envs.diagnosis.search.steps import FOLDER, digest
from cable_envs.sim.rigs import load_rig
from tests.support import drive_recording as drive

TOLD = {
    "noise": drive.NOISE,
    "known": {"coulomb": 0.0},
    "nominal": {"mass": {"value": 2.3, "std": 0.4, "unit": "kg"}, "viscous": {"value": 10.0, "std": 4.0}},
}
NAMES = ("time", "position_reference", "position", "velocity", "force")


def spring(y, v, t):
    return 60.0 * y


def _half(k, table):
    return table[:400]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return drive.write(tmp_path_factory.mktemp("memory") / "recording", spring, ("fit", "heldout"), _half)


@pytest.fixture(scope="module")
def arrays(folder):
    """The numbers of the folder's files."""
    tables = {f"run_{k}.csv": np.loadtxt(folder / f"run_{k}.csv", delimiter=",", skiprows=1) for k in (1, 2)}
    return {name: dict(zip(NAMES, table.T)) for name, table in tables.items()}


@pytest.fixture(scope="module")
def memory(arrays):
    return Recording.from_arrays("linear_drive", arrays, **TOLD, heldout="run_2.csv")


def small(n=50):
    t = np.linspace(0.0, 1.0, n)
    return {"time": t, "position": np.sin(t), "force": np.cos(t)}


def same(a, b):
    """Whether two recordings say the same of the same numbers, bit by bit."""
    assert (a.system, a.known, a.nominal, a.noise, a.description) == (
        b.system, b.known, b.nominal, b.noise, b.description,
    )  # fmt: skip
    assert [replace(r, data={}, offsets={}) for r in a.records] == [replace(r, data={}, offsets={}) for r in b.records]
    for one, other in zip(a.records, b.records, strict=True):
        assert one.data.keys() == other.data.keys()
        for name, values in one.data.items():
            np.testing.assert_array_equal(values, other.data[name])


def answer(found):
    """The answer without what says where the data came from and how long it took."""
    record = found.as_json()
    return json.dumps(record | {"about": {**record["about"], "recording": "", "rig": "", "seconds": 0}})


def test_arrays_are_what_files_are(folder, memory):
    same(memory, load_recording(folder))


def test_the_answer_is_that_of_the_files_to_the_digit(folder, memory, tmp_path):
    from_files = diagnose(folder, effects=["position_dependent_load"])
    from_memory = diagnose(memory, effects=["position_dependent_load"], out=tmp_path / "memory")
    assert from_memory.verdict == "named" and answer(from_memory) == answer(from_files)
    assert from_memory.about["recording"] == "memory"
    from_files.write(tmp_path / "files")
    from_memory.write(tmp_path / "memory")
    assert not (tmp_path / "memory" / FOLDER).exists()
    rigs = [yaml.safe_load((tmp_path / name / "augmented.yaml").read_text()) for name in ("files", "memory")]
    assert {**rigs[0], "name": "", "description": ""} == {**rigs[1], "name": "", "description": ""}
    read = request_of(load_recording(folder), rig=tmp_path / "files" / "augmented.yaml")
    held = request_of(memory, rig=from_memory.rig)  # nothing on disk
    assert held.rig["position_dependent_load.stiffness"] > 0.0 and held == read


def test_steps_belong_to_the_numbers(arrays, memory):
    other = {name: {**table, "force": table["force"] + 1e-12} for name, table in arrays.items()}
    changed = Recording.from_arrays("linear_drive", other, **TOLD, heldout="run_2.csv")
    again = Recording.from_arrays("linear_drive", arrays, **TOLD, heldout=["run_2.csv"])
    assert digest(memory, ()) == digest(again, ()) != digest(changed, ())


@pytest.mark.parametrize("table", ["csv", "parquet"])
def test_what_is_written_reads_back_to_the_bit(tmp_path, table):
    pytest.importorskip("pyarrow") if table == "parquet" else None
    runs = {"a": small(), "b": small(), "still": small()}
    runs["a"]["force"][3] = np.nan
    rig = load_rig({"plant": "linear_drive", "parameters": {"mass": 90.0}, "effects": {"backlash.gap": 1e-4}})
    recording = Recording.from_arrays(
        "linear_drive", runs, units={"position": "mm", "time": "ms"}, noise={"position": 0.01}, heldout=("b",),
        rest="still", rig=rig, nominal={"viscous": {"value": 200.0, "std": 20.0}}, source={"cite": "ours"},
        channels={"position": {"offset_free": "tool", "scale": 0.3, "note": "a count is 0.3 mm"}},
        about={"a": {"conditions": {"tool": "A", "load": {"value": 5, "unit": "kN"}}, "offsets": {"position": 2.0},
                     "quality": [{"channel": "force", "kind": "stuck", "from_s": 1e-4, "note": "it hung"}]}},
        description="a bench",
    )  # fmt: skip
    found = load_recording(recording.write(tmp_path / "out", table).parent)
    assert [r.name for r in found.records] == [f"{name}.{table}" for name in runs]
    same(replace(found, records=tuple(replace(r, name=r.name.split(".")[0]) for r in found.records)), recording)
    assert (found.rig.values, found.rig.effects) == (rig.values, {"backlash.gap": 1e-4})
    assert found.channels["position"].offset_free == "tool" and found.source == {"cite": "ours"}
    assert found.records[0].conditions == {"tool": "A", "load": 5000.0}
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(ConfigurationError, match=r"holds .*nothing is overwritten"):
        recording.write(tmp_path / "out", table)
    with pytest.raises(ConfigurationError, match="unknown format 'cvs'; did you mean 'csv'"):
        recording.write(tmp_path / "other", "cvs")
    assert sorted(tmp_path.rglob("*")) == before


def test_a_preset_is_written_by_its_name(tmp_path):
    columns = {"time": small()["time"], "drive_position": small()["position"], "drive_tension": small()["force"]}
    recording = Recording.from_arrays("cable_hole", columns, rig="gu-inferred")
    assert yaml.safe_load(recording.write(tmp_path).read_text())["rig"] == "gu-inferred"
    assert load_recording(tmp_path).rig == recording.rig


def test_the_end_of_records_is_held_out_as_an_import_does(tmp_path):
    columns = small(101)
    recording = Recording.from_arrays("linear_drive", {"run": columns, "rest": small()}, after=0.7, rest="rest")
    spec = [RecordSpec("run", "run", whole(columns)), RecordSpec("rest", "rest", whole(small()), use="rest")]
    channels = tuple(ChannelSpec(name, unit) for name, unit in zip(columns, ("s", "m", "N")))
    done = write_data_set(DataSet("linear_drive", "", channels, tuple(spec)), tmp_path / "out", after=0.7)
    found = load_recording(done.path)
    plain = [replace(r, name=r.name.split(".")[0], conditions={}, quality=()) for r in found.records]
    same(replace(found, records=tuple(plain)), replace(
        recording, records=tuple(replace(r, conditions={}) for r in recording.records)))  # fmt: skip
    assert [r.use for r in recording.records] == ["fit", "heldout", "rest"]
    assert recording.records[1].conditions == {"continues": "run"} and recording.records[1].time[0] == pytest.approx(
        0.7
    )
    with pytest.raises(ConfigurationError, match="after: nothing lies 5 s behind"):
        Recording.from_arrays("linear_drive", columns, after=5.0)


def test_one_record_or_a_list_and_a_shared_clock():
    columns = small()
    time = columns.pop("time")
    one = Recording.from_arrays("linear_drive", columns, time=time)
    two = Recording.from_arrays("linear_drive", [columns, columns], time=time, heldout=["record_2"])
    assert [r.name for r in one.records] == ["record_1"]
    assert [(r.name, r.use) for r in two.records] == [("record_1", "fit"), ("record_2", "heldout")]
    numbered = Recording.from_arrays(
        "linear_drive", {1: columns, 2: columns}, time=time, heldout=[2], about={1: {"conditions": {"load": 5}}}
    )
    assert [(r.name, r.use, dict(r.conditions)) for r in numbered.records] == [
        ("1", "fit", {"load": 5.0}),
        ("2", "heldout", {}),
    ]
    columns["position"][:] = 7.0
    assert two.records[0].data["position"].max() < 1.0  # a recording keeps its own copy


def _with(**arrays):
    return {"records": small() | arrays}


REFUSED = [
    ({"system": "linear_drve"}, "unknown system 'linear_drve'; did you mean 'linear_drive'"),
    (_with(positon=np.zeros(50)), "record 'record_1' 'positon'; did you mean 'position'"),
    ({"units": {"positon": "mm"}}, "channel in memory: units 'positon'; did you mean 'position'"),
    ({"units": {"position": "N"}}, "memory: channel position: unit 'N' does not fit; expected m or mm"),
    ({"noise": {"velocity": 0.1}}, "channel in memory: noise 'velocity'"),
    ({"noise": {"force": 0.0}}, "channel force: noise_std must be positive"),
    ({"noise": [0.1]}, r"memory: noise: expected a mapping, got \[0.1\]"),
    ({"channels": {"force": {"unit": "N"}}}, "channels: force: 'unit' is said by units and noise"),
    ({"channels": {"force": {"scael": 2.0}}}, "channel force 'scael'; did you mean 'scale'"),
    ({"system": ["linear_drive"]}, "unknown system"),
    ({"heldout": 1}, "heldout: expected names of records, got 1"),
    ({"heldout": "record_3"}, "record in memory: heldout 'record_3'; did you mean 'record_1'"),
    ({"heldout": "record_1"}, "memory: no record has 'use: fit'"),
    ({"rest": "record_1", "heldout": "record_1"}, "both held out and at rest"),
    ({"about": {"record_1": {"condition": {}}}}, "about: record_1 'condition'; did you mean 'conditions'"),
    ({"known": {"mas": 2.0}}, "memory: known 'mas'; did you mean 'mass'"),
    ({"known": {"mass": 2.0}, "nominal": {"mass": 2.0}}, "'mass' is both known and nominal"),
    ({"rig": "gu-inferred"}, "rig 'gu-inferred' belongs to cable_hole, the recording to linear_drive"),
    ({"rig": {"plant": "linear_drive", "parameters": {"mas": 1.0}}}, "did you mean 'mass'"),
    ({"rig": 3}, "'rig' must be a preset's name or a file"),
    (_with(time=np.r_[np.nan, np.arange(49.0)]), "record_1, channel time, row 1: no time"),
    (_with(time=np.r_[0.0, 1.0, 1.0, np.arange(2.0, 49.0)]), "row 3: time must increase, 1 s is followed by 1 s"),
    (_with(force=np.zeros(49)), "arrays of different lengths: time 50, position 50, force 49"),
    (_with(force=np.full(50, np.nan)), "record_1, channel force: no values"),
    (_with(force=np.r_[np.zeros(49), np.inf]), "channel force, row 50: not a finite number"),
    (_with(force=np.zeros((50, 2))), r"channel force: expected one number a sample, found .* shape \(50, 2\)"),
    (_with(force=["1"] * 50), "channel force: expected numbers"),
    (_with(force=np.zeros(50, bool)), "channel force: expected numbers .* found bool"),
    (_with(force=[[1.0], [1.0, 2.0]]), "channel force: no array of numbers"),
    (_with(force=5.0), "channel force: expected one number a sample"),
    ({"records": {n: v[:1] for n, v in small().items()}}, "at least two samples, found 1"),
    ({"records": {"force": np.zeros(5)}}, "there is no channel 'time'"),
    ({"records": []}, "there is no record"),
    ({"records": {}}, "there is no record"),
    ({"records": 5}, "expected a mapping of channel: array .*, or several by name, got int"),
    ({"records": [small(), 5]}, "record 'record_2': expected a mapping of channel: array .*, got int"),
    ({"records": {"a/b": small()}}, "a name is a text without slashes"),
    ({"records": [small(), {n: v for n, v in small().items() if n != "force"}]}, "must have the same channels: force"),
    ({"after": -1.0}, "after: expected seconds, more than 0"),
]


@pytest.mark.parametrize(("change", "message"), REFUSED, ids=[message[:40] for _, message in REFUSED])
def test_what_cannot_be_meant_is_refused(change, message):
    given = {"system": "linear_drive", "records": small()} | change
    with pytest.raises(ConfigurationError, match=message):
        Recording.from_arrays(**given)


def test_gaps_may_be_masked():
    columns = small() | {"force": np.ma.masked_greater(np.arange(50), 40)}
    record = Recording.from_arrays("linear_drive", columns).records[0]
    assert np.isnan(record.data["force"]).sum() == 9 and record.data["force"][:41].tolist() == list(range(41))


def test_data_frames_are_what_arrays_are(arrays, memory):
    pandas = pytest.importorskip("pandas")
    frames = {name: pandas.DataFrame(table) for name, table in arrays.items()}
    same(Recording.from_dataframe("linear_drive", frames, **TOLD, heldout="run_2.csv"), memory)
    columns = {"time": "t", "position": "x", "force": "F", "velocity": "v", "position_reference": "r"}
    renamed = [f.rename(columns=columns).assign(other="text") for f in frames.values()]
    found = Recording.from_dataframe("linear_drive", renamed, columns, **TOLD, heldout="record_2")
    for one, other in zip(found.records, memory.records, strict=True):
        for name in NAMES:
            np.testing.assert_array_equal(one.data[name], other.data[name])


def test_a_frames_index_may_be_its_clock():
    pandas = pytest.importorskip("pandas")
    frame = pandas.DataFrame(small()).set_index("time")
    dates = frame.set_index(pandas.Timestamp("2026-06-14 10:12", tz="Europe/Berlin") + pandas.to_timedelta(
        np.arange(50) * 20, unit="ms"))  # fmt: skip
    counted = Recording.from_dataframe("linear_drive", frame).records[0]
    np.testing.assert_array_equal(counted.time, small()["time"])
    dated = Recording.from_dataframe("linear_drive", dates).records[0]
    np.testing.assert_allclose(dated.time, np.arange(50) * 0.02, rtol=0, atol=1e-9)
    with pytest.raises(ConfigurationError, match="dates and durations are read in s"):
        Recording.from_dataframe("linear_drive", dates, units={"time": "ms"})
    with pytest.raises(ConfigurationError, match="neither a column 'time' nor an index of times"):
        Recording.from_dataframe("linear_drive", frame.reset_index(drop=True))


def test_frames_that_cannot_be_meant_are_refused():
    pandas = pytest.importorskip("pandas")
    frame = pandas.DataFrame(small())
    for frames, columns, message in (
        (
            frame.rename(columns={"position": "positon"}),
            None,
            "column 'positon' is no channel .*did you mean 'position'",
        ),
        (frame, {"time": "time", "positon": "position"}, "columns 'positon'; did you mean 'position'"),
        (frame, {"time": "time", "position": "x"}, "channel position: no column 'x'"),
        (frame.assign(force="much"), None, "channel force: expected numbers, found"),
        (frame.assign(force=True), None, "channel force: expected numbers, found bool"),
        (pandas.concat([frame, frame[["force"]]], axis=1), None, "column 'force' appears twice"),
        (small(), None, "record 'time': expected a pandas DataFrame, got ndarray"),
        ([], None, "there is no record"),
    ):
        with pytest.raises(ConfigurationError, match=message):
            Recording.from_dataframe("linear_drive", frames, columns)
    gaps = frame.assign(force=pandas.array([pandas.NA, *range(49)], dtype="Int64"))
    assert np.isnan(Recording.from_dataframe("linear_drive", gaps).records[0].data["force"][0])
