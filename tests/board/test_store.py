"""The results store survives crashes; results are replaced whole or not at all."""

import json
import os
import stat

import numpy as np
import pytest

from cable_envs.core.errors import ConfigurationError
from cable_envs.core.files import jsonable, write_atomic
from cablebench.run.store import ResultStore, StoreWarning
from tests.support.board_records import a_record as record


def test_records_come_back_in_order_with_their_schema(tmp_path):
    store = ResultStore(tmp_path / "new" / "r.jsonl")
    assert store.records() == []
    store.append(record(1))
    store.append([record(2), record(3)])
    assert [r["seed"] for r in store.records()] == [1, 2, 3]
    assert {r["schema"] for r in store.records()} == {1}


def test_a_torn_last_line_is_skipped_and_does_not_swallow_the_next_record(tmp_path):
    store = ResultStore(tmp_path / "r.jsonl")
    store.append([record(1), record(2)])
    whole = store.path.read_bytes()
    for cut in range(len(whole) - 1, whole.index(b"\n") + 1, -1):  # a crash at any byte of the second record
        store.path.write_bytes(whole[:cut])
        torn = cut == len(whole) - 1  # all of it but the newline: still a whole record
        if torn:
            assert [r["seed"] for r in store.records()] == [1, 2]
        else:
            with pytest.warns(StoreWarning, match="r.jsonl:2"):
                assert [r["seed"] for r in store.records()] == [1]
        store.append(record(9))
        if torn:
            assert [r["seed"] for r in store.records()] == [1, 2, 9]
        else:
            with pytest.warns(StoreWarning):
                assert [r["seed"] for r in store.records()] == [1, 9]


def test_binary_rubbish_in_the_middle_costs_one_line(tmp_path):
    store = ResultStore(tmp_path / "r.jsonl")
    store.append(record(1))
    with store.path.open("ab") as file:
        file.write(b"\xff\xfe\x00\n[1, 2]\n")
    store.append(record(2))
    with pytest.warns(StoreWarning) as caught:
        assert [r["seed"] for r in store.records()] == [1, 2]
    assert len(caught) == 1 and "2 lines" in str(caught[0].message)  # a list is no record either


def test_a_newer_schema_is_left_out_and_strictly_refused(tmp_path):
    store = ResultStore(tmp_path / "r.jsonl")
    store.append(record(1))
    with store.path.open("a") as file:
        file.write(json.dumps({**record(2), "schema": 99}) + "\n")
    with pytest.warns(StoreWarning, match=r"r\.jsonl:2: schema 99.*upgrade"):
        assert [r["seed"] for r in store.records()] == [1]
    with pytest.raises(ConfigurationError, match=r"1 line of the store was refused: .*r\.jsonl:2: schema 99"):
        store.read(strict=True)


def test_appending_never_rewrites_what_is_there(tmp_path):
    store = ResultStore(tmp_path / "r.jsonl")
    store.append(record(1))
    before = store.path.read_bytes()
    store.append(record(2))
    assert store.path.read_bytes().startswith(before)


def test_values_become_json_types(tmp_path):
    values = {"x": np.float32(0.5), "n": np.int64(3), "bad": float("nan"), "inf": np.inf, "v": np.arange(3)}
    values |= {"p": tmp_path, "b": np.bool_(True), 7: None}
    text = json.dumps(jsonable(values), allow_nan=False)
    expected = {"x": 0.5, "n": 3, "bad": None, "inf": None, "v": [0, 1, 2], "p": str(tmp_path), "b": True, "7": None}
    assert json.loads(text) == expected


def test_a_half_written_result_never_replaces_a_good_one(tmp_path, monkeypatch):
    path = write_atomic(tmp_path / "board.json", "good")

    def crash(*_):
        raise OSError("disk full")

    monkeypatch.setattr(os, "fsync", crash)
    with pytest.raises(OSError, match="disk full"):
        write_atomic(path, "half")
    assert path.read_text() == "good"
    assert os.listdir(tmp_path) == ["board.json"]  # and no temporary file is left


def test_written_files_have_the_usual_permissions(tmp_path):
    old = os.umask(0o022)
    try:
        path = write_atomic(tmp_path / "a" / "x.txt", b"bytes")
    finally:
        os.umask(old)
    assert stat.S_IMODE(path.stat().st_mode) == 0o644 and path.read_bytes() == b"bytes"


def test_trajectories_round_trip_and_lie_beside_the_records(tmp_path):
    store = ResultStore(tmp_path / "quick.jsonl")
    arrays = {"time": np.arange(5.0), "output": np.linspace(0, 1, 5, dtype=np.float32)}
    path = store.trajectories.keep("abc", {"median": arrays, "worst": {"time": np.arange(2.0)}})
    assert path == tmp_path / "quick" / "abc.npz"
    found = store.trajectories.of("abc")
    assert set(found) == {"median", "worst"}
    np.testing.assert_array_equal(found["median"]["output"], arrays["output"])
    assert store.trajectories.of("unknown") == {} and store.trajectories.of("") == {}


def test_thinned_trajectories_keep_the_signals_that_are_asked_for(tmp_path):
    store = ResultStore(tmp_path / "quick.jsonl")
    arrays = {"time": np.arange(5.0), "effort": np.ones(5)}
    kept, other = (store.trajectories.keep(run, {"median": arrays, "worst": arrays}) for run in ("abc", "other"))
    before = other.read_bytes()
    store.trajectories.thin(["abc", "never run"], lambda name: name == "time", 1000)
    assert {kind: list(found) for kind, found in store.trajectories.of("abc").items()} == {
        "median": ["time"],
        "worst": ["time"],
    }
    assert other.read_bytes() == before
    thinned = kept.read_bytes()
    store.trajectories.thin(["abc"], lambda name: name == "time", 1000)
    assert kept.read_bytes() == thinned  # nothing for version control to see


def test_thinned_trajectories_keep_their_course_and_their_end(tmp_path):
    store = ResultStore(tmp_path / "quick.jsonl")
    store.trajectories.keep("abc", {"worst": {"time": np.arange(1000.0), "failed": np.array([False])}})
    store.trajectories.thin(["abc"], lambda name: True, 200)
    found = store.trajectories.of("abc")["worst"]
    assert len(found["time"]) == 201 and found["time"][-1] == 999.0 and found["time"][1] == 5.0
    assert found["failed"].shape == (1,)


def test_thinned_trajectories_are_rounded_by_their_range_and_not_by_their_size(tmp_path):
    store = ResultStore(tmp_path / "quick.jsonl")
    place = 0.5 + 0.01 * np.sin(np.linspace(0.0, 9.0, 200))
    path = store.trajectories.keep("abc", {"worst": {"output": np.append(place, np.nan)}})
    store.trajectories.thin(["abc"], lambda name: True, 200)
    once, found = path.read_bytes(), store.trajectories.of("abc")["worst"]["output"]
    assert 0.0 < np.abs(found[:-1] - place).max() <= np.ptp(place) / 2048 and np.isnan(found[-1])
    store.trajectories.thin(["abc"], lambda name: True, 200)
    assert path.read_bytes() == once


def test_packed_trajectories_are_the_same_numbers_in_one_file(tmp_path):
    store, rng = ResultStore(tmp_path / "quick.jsonl"), np.random.default_rng(1)
    runs = {f"run{i}": {"worst": {"time": np.arange(50.0), "output": rng.normal(size=50)}} for i in range(6)}
    for run, episodes in runs.items():
        store.trajectories.keep(run, episodes)
    apart = sum(path.stat().st_size for path in (tmp_path / "quick").iterdir())
    path = store.trajectories.pack()
    first = path.read_bytes()
    assert [p.name for p in tmp_path.iterdir()] == ["quick.npz.xz"] and len(first) < apart / 1.5
    for run, episodes in runs.items():
        np.testing.assert_array_equal(store.trajectories.of(run)["worst"]["output"], episodes["worst"]["output"])
    store.trajectories.pack()
    assert path.read_bytes() == first  # nothing for version control to see
    # a run that is done again replaces its own alone; what is forgotten is gone; a store on top of this one reads it
    store.trajectories.keep("run1", {"worst": {"time": np.zeros(3)}})
    assert store.trajectories.of("run1")["worst"]["time"].size == 3
    store.trajectories.pack()
    assert store.trajectories.forget({"run1", "run2"}) == 4
    again = ResultStore(tmp_path / "own.jsonl", ResultStore(store.path))
    assert [len(again.trajectories.of(f"run{i}")) for i in range(6)] == [0, 1, 1, 0, 0, 0]
    assert again.trajectories.of("run1")["worst"]["time"].size == 3
    path.write_bytes(b"damaged")
    assert ResultStore(store.path).trajectories.of("run1") == {}


def test_packing_keeps_every_record_and_appending_goes_on_beside_it(tmp_path):
    store = ResultStore(tmp_path / "r.jsonl")
    store.append([record(1), record(2)])
    before = store.records()
    assert store.pack() == tmp_path / "r.jsonl.xz" and not store.path.exists()
    first = store.packed.read_bytes()
    assert store.records() == before
    store.append(record(3))
    assert [r["seed"] for r in store.records()] == [1, 2, 3] and store.packed.read_bytes() == first
    store.pack()
    assert [r["seed"] for r in ResultStore(tmp_path / "r.jsonl").records()] == [1, 2, 3]
    store.pack()  # the same records, the same bytes: nothing for version control to see
    again = store.packed.read_bytes()
    store.pack()
    assert store.packed.read_bytes() == again


def test_a_crash_while_packing_loses_and_repeats_nothing(tmp_path, monkeypatch):
    store = ResultStore(tmp_path / "r.jsonl")
    store.append([record(1, x=0.1 + 0.2), record(2)])
    with monkeypatch.context() as patch:
        patch.setattr(os, "replace", lambda *_: (_ for _ in ()).throw(OSError("disk full")))
        with pytest.raises(OSError, match="disk full"):
            store.pack()
    assert [r["seed"] for r in store.records()] == [1, 2]
    plain = store.path.read_bytes()
    store.pack()
    store.path.write_bytes(plain)  # the crash came between writing the one and removing the other
    store.pack()
    assert [r["seed"] for r in store.records()] == [1, 2] and store.records()[0]["x"] == 0.1 + 0.2


def test_a_damaged_compressed_part_is_named(tmp_path):
    store = ResultStore(tmp_path / "r.jsonl")
    store.append(record(1))
    store.pack()
    store.packed.write_bytes(store.packed.read_bytes()[:-6])
    with pytest.raises(ConfigurationError, match=r"r\.jsonl\.xz is damaged"):
        store.records()
