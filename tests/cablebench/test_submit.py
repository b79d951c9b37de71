"""From a stranger's file to a row of a board, and from the row back to the same numbers: the commands."""

import io
import json
import shlex
import shutil

import pytest

from cablebench.run.store import ResultStore

HOLE = "CableHole-Position-Sine"
TINY = """
schema: 1
name: tiny
title: One short task
tasks: [{env: cable_envs/CableHole-Position-Sine-v0, options: {duration: 0.5, rig: gu-inferred}}]
tracks: {nominal: {options: {sensor_noise: true}}}
seeds: {train: {first: 0, count: 1000}, tune: {first: 1000, count: 1000}, test: {first: 2000, count: 1000}}
episodes: 2
training_seeds: 1
bootstrap: {resamples: 50}
score: {paper: {CableHole: mrac-g22}}
"""
MINE = """
name = "mine"
information = "model-free"
observe = "output"

def reset():
    global sum_of_errors
    sum_of_errors = 0.0

def act(t, y, ref):
    global sum_of_errors
    sum_of_errors += ref[0] - y["load_position"]
    return 49.0 + 4000.0 * (ref[0] - y["load_position"]) + 20.0 * sum_of_errors
"""


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A folder with the protocol, the controller, and a board of both the references and the controller."""
    folder = tmp_path_factory.mktemp("submit")
    (folder / "tiny.yaml").write_text(TINY)
    (folder / "mine.py").write_text(MINE)
    return folder


@pytest.fixture
def submitted(place, cli):
    """Results with the submission in them (made once)."""
    results = place / "results"
    if not results.exists():
        code, out, err = cli(
            "submit", place / "mine.py", "--protocol", place / "tiny.yaml", "--results", results, "--trust"
        )
        assert code == 0, err
        assert "mine" in out and "place 1 of 1 (model-free)" in err
    return results


def replay(place, results, *more):
    return ("replay", "--results", results, "--protocol", place / "tiny.yaml", "--env", HOLE, "--entrant", *more)


def test_nothing_of_a_strangers_file_runs_before_it_is_trusted(place, cli, tmp_path, monkeypatch):
    trap = tmp_path / "trap.py"
    trap.write_text(f"open({str(tmp_path / 'sprung')!r}, 'w')\n" + MINE)
    monkeypatch.setattr("sys.stdin", io.StringIO())  # no terminal
    code, _, err = cli("submit", trap, "--protocol", place / "tiny.yaml", "--results", tmp_path / "r")
    assert code == 2 and "trap.py will be executed" in err and "--trust" in err and err.count("\n") == 1
    assert [p.name for p in tmp_path.iterdir()] == ["trap.py"]


def test_what_fails_the_check_leaves_nothing(place, cli, tmp_path):
    bad = tmp_path / "bad.py"
    bad.write_text(MINE.replace("return 49.0", "return float('inf')"))
    code, _, err = cli("submit", bad, "--protocol", place / "tiny.yaml", "--results", tmp_path / "r", "--trust")
    assert code == 2 and "the answer is not finite" in err
    assert [p.name for p in tmp_path.iterdir()] == ["bad.py"]


def test_a_submission_brings_the_references_its_score_needs(submitted):
    board = json.loads((submitted / "board.json").read_text())
    rows = {r["entrant"]: r for r in board["tables"][0]["rows"]}
    assert set(rows) == {"mine", "open-loop", "oracle", "mrac-g22"}
    assert rows["mine"]["score"] is not None and (board["board"], board["version"]) == ("tiny", 1)
    assert len(list((submitted / "submissions").glob("*/mine.py"))) == 1


def test_submitting_again_runs_nothing_again(place, submitted, cli):
    before = len(ResultStore(submitted / "records.jsonl").records())
    code, _, _ = cli("submit", place / "mine.py", "--protocol", place / "tiny.yaml", "--results", submitted, "--trust")
    assert code == 0 and len(ResultStore(submitted / "records.jsonl").records()) == before


def test_a_file_that_has_changed_is_said_to_differ_from_the_one_of_its_row(place, submitted, cli, tmp_path):
    changed = tmp_path / "mine.py"
    changed.write_text(MINE.replace("4000.0", "3000.0"))
    arguments = (changed, "--protocol", place / "tiny.yaml", "--results", submitted, "--trust", "--check-only")
    code, _, err = cli("submit", *arguments)
    assert code == 2 and f"'mine' is in {submitted} already, and this file differs from the one that its row was" in err
    assert "(--name mine-2) or another --results folder" in err and "another maker" not in err
    code, _, err = cli("submit", *arguments, "--maker", "me 1")
    assert code == 2 and "its row was submitted with another --maker phrase, or with none" in err
    assert cli("submit", *arguments, "--name", "mine-2")[0] == 0


def test_of_the_published_board_only_the_tables_with_ones_row_are_printed(place, submitted, cli, tmp_path):
    two = TINY.replace("gu-inferred}}]", "gu-inferred}}, {env: cable_envs/CableHole-Position-Step-v0}]")
    (tmp_path / "tiny.yaml").write_text(two.replace("episodes: 2", "episodes: 1"))
    (tmp_path / "mine.py").write_text(MINE + 'tasks = ["CableHole-Position-Sine"]\n')
    flags = ("--protocol", tmp_path / "tiny.yaml", "--results", tmp_path / "r")
    assert cli("evaluate", *flags, "--controller", "pid", "--env", "CableHole-Position-Step")[0] == 0
    code, out, err = cli("submit", tmp_path / "mine.py", *flags, "--trust")
    assert code == 0, err
    assert "CableHole-Position-Sine (nominal track)" in out and "CableHole-Position-Step (nominal track)" not in out
    assert "CableHole-Position-Step" in (tmp_path / "r" / "board.md").read_text()


@pytest.mark.slow  # test_jobs evaluates in jobs in `make test`
def test_submitting_in_jobs_gives_the_serial_numbers(place, submitted, cli, tmp_path):
    arguments = ("submit", place / "mine.py", "--protocol", place / "tiny.yaml", "--results", tmp_path, "--trust")
    code, _, err = cli(*arguments, "--jobs", "2")
    assert code == 0, err

    def numbers(folder):
        found = ResultStore(folder / "records.jsonl").records()
        return {
            (r["entrant"], r["seed"]): {k: v for k, v in r["metrics"].items() if k != "inference_us"} for r in found
        }

    assert len(numbers(tmp_path)) == 8 and numbers(tmp_path) == numbers(submitted)


def test_an_unknown_backend_is_refused(place, cli, tmp_path):
    flags = ("--protocol", place / "tiny.yaml", "--results", tmp_path, "--trust")
    code, _, err = cli("submit", place / "mine.py", *flags, "--backend", "rey")
    assert code == 2 and "did you mean 'ray'" in err


def test_every_row_replays_to_the_last_digit_with_the_command_on_the_board(submitted, cli):
    (said,) = (
        line.split("`")[1] for line in (submitted / "board.md").read_text().splitlines() if "`cablebench" in line
    )
    rows = [(t, r["entrant"]) for t in json.loads((submitted / "board.json").read_text())["tables"] for r in t["rows"]]
    commands = [said.replace("NAME", name).replace("TASK", t["task"]).replace("TRACK", t["track"]) for t, name in rows]
    assert len(commands) == 4
    for command in commands:
        code, out, err = cli(*shlex.split(command)[1:], "--trust")
        assert code == 0, err
        assert "2 episodes: every metric is the same to the last digit" in out


def test_a_board_that_was_moved_and_packed_still_replays(place, submitted, cli, tmp_path):
    moved = tmp_path / "elsewhere"
    shutil.copytree(submitted, moved)
    flags = ("--results", moved, "--protocol", place / "tiny.yaml")
    assert cli("leaderboard", *flags, "--pack")[0] == 0
    assert (moved / "records.jsonl.xz").exists() and not (moved / "records.jsonl").exists()
    page = (moved / "board.html").read_bytes()  # drawn from the trajectories that were kept, as the next time
    assert cli("leaderboard", *flags)[0] == 0 and (moved / "board.html").read_bytes() == page
    shutil.move(submitted, hidden := submitted.with_name("hidden"))
    try:
        code, out, err = cli(*replay(place, moved, "mine", "--trust", "--json"))
    finally:
        shutil.move(hidden, submitted)
    assert code == 0, err
    found = json.loads(out)
    assert found["same"] and found["recorded_score"] == found["replayed_score"]


def test_a_number_that_differs_is_shown(place, submitted, cli, tmp_path):
    other = tmp_path / "other"
    shutil.copytree(submitted, other)
    path = other / "records.jsonl"
    lines = [json.loads(line) for line in path.read_text().splitlines()]
    record = next(r for r in lines if r["entrant"] == "oracle")
    record["metrics"]["rmse"] *= 1 + 2.3e-16  # the last digit
    path.write_text("".join(json.dumps(r) + "\n" for r in lines))
    code, out, _ = cli(*replay(place, other, "oracle"))
    assert code == 1
    assert f"episode {record['seed']} (nominal): rmse recorded {record['metrics']['rmse']!r}" in out
    assert "DIFFERENT: 1 numbers in 1 of 2 episodes" in out


def test_unknown_rows_name_the_nearest(place, submitted, cli):
    code, _, err = cli(*replay(place, submitted, "oracel"))
    assert code == 2 and "did you mean 'oracle'" in err
    code, _, err = cli(*replay(place, submitted, "oracle", "--track", "nominl"))
    assert code == 2 and "did you mean 'nominal'" in err


def test_boards_by_name_lie_in_their_folder(cli, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, _, err = cli("leaderboard", "--board", "quik")
    assert code == 2 and "did you mean 'quick'" in err
    code, _, err = cli("leaderboard")
    assert code == 2 and "--board quick" in err
    from cablebench.cli.bench.leaderboard import results_folder

    (tmp_path / "boards" / "full").mkdir(parents=True)
    folder, flags = results_folder("full", None)
    assert folder.resolve() == (tmp_path / "boards" / "full").resolve() and flags == "--board full"


def test_remarks_are_on_page_and_markdown(place, submitted, cli, tmp_path):
    (submitted / "NOTES.md").write_text("## An honest word\n\nThe *oracle* wins.\n")
    code, _, _ = cli("leaderboard", "--results", submitted, "--protocol", place / "tiny.yaml", "--out", tmp_path)
    assert code == 0
    assert "## An honest word" in (tmp_path / "board.md").read_text()
    assert "<h2>An honest word</h2>" in (tmp_path / "board.html").read_text()


@pytest.fixture
def shipped(place, submitted, monkeypatch):
    """The board of the module stands for the one that comes with the package."""
    store = ResultStore(submitted / "records.jsonl")
    monkeypatch.setattr("cablebench.run.folders.published", lambda name: store if name == "tiny" else None)
    return store


def test_a_submission_is_ranked_against_the_published_board_and_writes_nothing_there(
    place, shipped, cli, tmp_path, monkeypatch
):
    """From an empty folder: the published rows are on its board, and only its own records are new."""
    (tmp_path / "other.py").write_text(MINE.replace('"mine"', '"other"').replace("4000.0", "3000.0"))
    before = {p: p.read_bytes() for p in shipped.path.parent.rglob("*") if p.is_file()}
    monkeypatch.chdir(tmp_path)
    code, _, err = cli("submit", "other.py", "--protocol", place / "tiny.yaml", "--trust")
    assert code == 0, err
    assert "ranked against the published board 'tiny': 8 records, hash " in err and "place 2 of 2 (model-free)" in err
    folder = tmp_path / "results" / "submitted-tiny"
    assert {r["entrant"] for r in ResultStore(folder / "records.jsonl").records()} == {"other"}
    assert {p: p.read_bytes() for p in shipped.path.parent.rglob("*") if p.is_file()} == before
    rows = {r["entrant"] for r in json.loads((folder / "board.json").read_text())["tables"][0]["rows"]}
    assert rows == {"other", "mine", "open-loop", "oracle", "mrac-g22"}
    # the board is made again from its folder alone, and a published row replays from there
    made = (folder / "board.md").read_text()
    code, _, err = cli("leaderboard", "--results", "results/submitted-tiny", "--protocol", place / "tiny.yaml")
    assert code == 0 and (folder / "board.md").read_text() == made
    for name in ("oracle", "mine", "other"):
        code, out, err = cli(*replay(place, folder, name), "--trust")
        assert code == 0 and "the same to the last digit" in out, err


def test_publishing_is_asked_for(place, shipped, cli, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, _, err = cli("submit", place / "mine.py", "--publish", "--results", tmp_path / "r", "--trust")
    assert code == 2 and "--publish writes to boards/NAME, --results to another folder" in err
    code, _, err = cli("submit", place / "mine.py", "--protocol", place / "tiny.yaml", "--publish", "--trust")
    assert code == 0 and {p.parent.name for p in tmp_path.rglob("board.json")} == {"tiny"}


def test_a_published_board_of_another_version_is_no_yardstick(place, shipped, cli, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tiny.yaml").write_text(TINY.replace("episodes: 2", "episodes: 1"))
    code, _, err = cli("submit", place / "mine.py", "--protocol", "tiny.yaml", "--trust")
    assert code == 0 and "is of another version of this protocol" in err and "place 1 of 1" in err


def test_a_mark_that_says_nothing_is_refused(place, cli, tmp_path):
    (tmp_path / "ranked-against.yaml").write_text("schema: cable-ranked-against/2\nboard: quick\n")
    code, _, err = cli("leaderboard", "--results", tmp_path)
    assert code == 2 and "ranked-against.yaml: expected schema 'cable-ranked-against/1'" in err
