"""One bad record costs its own line: readers name it and go on, and the board says what was left out."""

import copy
import json

import numpy as np
import pytest

from cable_envs.core.errors import ConfigurationError
from cable_envs.core.files import packed
from cablebench.board.board import build_board
from cablebench.cli import main
from cablebench.run import store as store_module
from cablebench.run.schema import wrong_with
from cablebench.run.store import ResultStore
from tests.support.board_records import ENTRANTS, a_record, made_protocol, made_records

ABSENT = object()
MALFORMED = {  # what is changed in a good record -> a word of what is said
    **{f"no {key}": ({key: ABSENT}, key) for key in (
        "schema", "protocol_hash", "run", "env_id", "task", "family", "track", "entrant", "information",
        "training_seed", "seed", "output_unit", "command_unit", "metrics", "versions", "replay", "charged")},
    "metrics is a list": ({"metrics": [1, 2]}, "metrics"),
    "metrics is null": ({"metrics": None}, "metrics"),
    "no rmse": ({"metrics": {"failed": 0.0}}, "rmse"),
    "no failed": ({"metrics": {"rmse": 1.0}}, "failed"),
    "rmse is null though it ended": ({"metrics": {"rmse": None, "failed": 0.0}}, "rmse"),
    "rmse is negative": ({"metrics": {"rmse": -1.0, "failed": 0.0}}, "rmse"),
    "rmse is text": ({"metrics": {"rmse": "0.001", "failed": 0.0}}, "rmse"),
    "rmse is true": ({"metrics": {"rmse": True, "failed": 0.0}}, "rmse"),
    "rmse is infinite": ({"metrics": {"rmse": float("inf"), "failed": 0.0}}, "rmse"),
    "rmse is NaN": ({"metrics": {"rmse": float("nan"), "failed": 0.0}}, "rmse"),
    "rmse is longer than any float": ({"metrics": {"rmse": 10**400, "failed": 0.0}}, ""),
    "another metric is text": ({"metrics": {"rmse": 1.0, "failed": 0.0, "effort": "much"}}, "effort"),
    "failed is 7": ({"metrics": {"rmse": 1.0, "failed": 7.0}}, "failed"),
    "seed is text": ({"seed": "7"}, "seed"),
    "seed is negative": ({"seed": -1}, "seed"),
    "seed is a number with a point": ({"seed": 1.5}, "seed"),
    "training seed is text": ({"training_seed": "first"}, "training_seed"),
    "training seed is a list": ({"training_seed": [1]}, "training_seed"),
    "information is unknown": ({"information": "psychic"}, "information"),
    "entrant is a number": ({"entrant": 7}, "entrant"),
    "entrant is empty": ({"entrant": ""}, "entrant"),
    "entrant is endless": ({"entrant": "x" * 5000}, "entrant"),
    "entrant breaks the line": ({"entrant": "a\n## b"}, "printable"),
    "entrant turns the terminal red": ({"entrant": "\x1b[31mred"}, "printable"),
    "entrant is markup of a page": ({"entrant": "<img src=x onerror=alert(1)>"}, "name"),
    "entrant is markup of a terminal": ({"entrant": "[/b]"}, "name"),
    "entrant is markup of a figure": ({"entrant": "$\\bad{$"}, "name"),
    "entrant ends a cell": ({"entrant": "a|b"}, "name"),
    "entrant turns the writing around": ({"entrant": "\u202eabc"}, "printable"),
    "run leads out of the folder": ({"run": "../../elsewhere"}, "run"),
    "versions is a list": ({"versions": ["numpy"]}, "versions"),
    "a version is a number": ({"versions": {"numpy": 2}}, "versions"),
    "charged is text": ({"charged": "all of it"}, "charged"),
    "charged is negative": ({"charged": {"tuning_trials": -1}}, "tuning_trials"),
    "charged is for something else": ({"charged": {"lunch": 1}}, "lunch"),
    "settings is a list": ({"settings": [1]}, "settings"),
    "options is text": ({"options": "all"}, "options"),
    "sweep without value": ({"sweep": "friction"}, "sweep"),
    "task is another": ({"task": "CableHole-Position-Step"}, "task"),
    "replay is a list": ({"replay": ["rm"]}, "replay"),
    "schema is text": ({"schema": "1"}, "schema"),
    "schema is of the future": ({"schema": 99}, "upgrade"),
}  # fmt: skip
NO_RECORDS = {
    "a number": b"7", "a list": b"[1, 2]", "text": b"not json", "bytes": b"\xff\xfe\x00", "half a record": b'{"a": 1',
    "a well": b"[" * 100_000, "a number of 5000 digits": b'{"seed": ' + b"9" * 5000 + b"}",
}  # fmt: skip
TWO = {name: ENTRANTS[name] for name in ("open-loop", "pid", "oracle")}


def changed(change):
    return {k: v for k, v in {**copy.deepcopy(a_record()), **change}.items() if v is not ABSENT}


def test_a_good_record_passes():
    assert wrong_with(a_record()) == "" == wrong_with({**a_record(), "of_a_later_version": 1})


@pytest.mark.parametrize("name", MALFORMED)
def test_what_is_wrong_is_said_in_one_line(name):
    change, word = MALFORMED[name]
    wrong = wrong_with(changed(change))
    assert wrong and word in wrong and wrong.isprintable() and len(wrong) < 300, wrong


def test_all_records_of_the_committed_boards_pass():
    from pathlib import Path

    for name in ("quick", "suite-v1"):
        reading = ResultStore(Path(__file__).parents[2] / "boards" / name / "records.jsonl").read()
        assert len(reading.records) > 3000 and reading.left_out == ()


@pytest.fixture(scope="module")
def protocol():
    return made_protocol(episodes=2, tracks=made_protocol().tracks[:1])


@pytest.fixture
def store(tmp_path, protocol):
    """A store with whole runs of three entrants, and among them one line of each malformed kind."""
    made = ResultStore(tmp_path / "records.jsonl")
    made.append(made_records(protocol, entrants=TWO))
    bad = [json.dumps(changed({"protocol_hash": protocol.hash(), **c})).encode() for c, _ in MALFORMED.values()]
    lines = made.path.read_bytes().splitlines()
    for line in [*bad, *NO_RECORDS.values()]:
        lines.insert(len(lines) // 2, line)
    made.path.write_bytes(b"\n".join(lines) + b"\n")
    return made


def test_the_board_is_made_from_the_good_ones_and_says_what_was_left_out(store, protocol):
    reading = store.read()
    assert len(reading.left_out) == len(MALFORMED) + len(NO_RECORDS)
    board = build_board(protocol, reading.records, left_out=reading.remark)
    assert [len(t.rows) for t in board.tables] == [3, 3, 3, 3]
    assert any(f"{len(reading.left_out)} lines of the store were left out" in note for note in board.notes)
    assert f"{store.path}:" in board.notes[-1] and "; and " in board.notes[-1]


def test_packing_keeps_malformed_records_for_people_to_look_at(store):
    before = store.read()
    store.pack()
    after = store.read()
    assert after.records == before.records
    assert len(after.left_out) == len(before.left_out) - len(NO_RECORDS)


def test_nobody_appends_a_record_that_no_reader_takes(tmp_path):
    store = ResultStore(tmp_path / "records.jsonl")
    with pytest.raises(ConfigurationError, match=r"records\.jsonl: a record that is to be added: seed: .*found 'x'"):
        store.append([a_record(), a_record(seed="x")])
    assert not store.path.exists()


@pytest.mark.parametrize(
    "change", [{"seed": 99}, {"track": "mine"}, {"sweep": "mine", "sweep_value": 1.0}], ids=["seed", "track", "sweep"]
)
def test_an_episode_that_the_protocol_does_not_have_makes_nobody_incomplete(protocol, change):
    records = made_records(protocol, entrants=TWO)
    board = build_board(protocol, [*records, {**records[0], "entrant": "stranger", **change}])
    assert [len(t.rows) for t in board.tables] == [3, 3, 3, 3]
    assert any("1 records of episodes that the protocol does not have" in note for note in board.notes)


def test_a_compressed_bomb_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(store_module, "LARGEST", 10**6)
    store = ResultStore(tmp_path / "records.jsonl")
    store.packed.write_bytes(packed(bytes(10**7)))
    with pytest.raises(ConfigurationError, match=r"records\.jsonl\.xz is damaged: it unpacks to more than 1000000"):
        store.read()


def test_the_command_goes_on_and_strictly_refuses(tmp_path, capsys):
    from cablebench.protocol.files import load_protocol

    store = ResultStore(tmp_path / "records.jsonl")
    store.append(made_records(load_protocol("demo"), entrants=TWO))
    count = len(store.records())
    with store.path.open("a") as file:
        file.write(json.dumps({**a_record(), "metrics": {}}) + "\n")

    def run(*more):
        with pytest.raises(SystemExit) as end:
            main(["leaderboard", "--results", str(tmp_path), "--protocol", "demo", *more])
        return end.value.code or 0, capsys.readouterr().err

    code, err = run()
    assert code == 0 and f"records.jsonl:{count + 1}: metrics.rmse: field required" in err
    assert "1 line of the store was left out" in (tmp_path / "board.md").read_text()
    code, err = run("--strict")
    assert code == 2 and err.count("\n") == 1 and "was refused" in err and f"records.jsonl:{count + 1}" in err


def test_scores_are_what_they_are_without_the_malformed(store, protocol):
    clean = build_board(protocol, made_records(protocol, entrants=TWO))
    beside = build_board(protocol, store.read().records)
    for a, b in zip(clean.tables, beside.tables, strict=True):
        assert np.array_equal([r.score.value for r in a.rows], [r.score.value for r in b.rows])
