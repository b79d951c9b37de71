"""``cablebench blind-test`` from the command line."""

import json

import pytest

from cablebench.cli import main
from cablebench.cli.physics import blind_test as command


def _run(capsys, *arguments):
    with pytest.raises(SystemExit) as ended:
        main(["proof", *arguments])
    return ended.value.code, *capsys.readouterr()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--quick", "--cases", "3"], "exclude each other"),
        (["--no-tool", "--no-baselines"], "nothing to do"),
        (["--no-tool", "--system", "cable_hol"], "did you mean 'cable_hole'?"),
        (["--no-tool", "--kind", "decoys"], "did you mean 'decoy'?"),
        (["--no-tool", "--generator", "c"], "unknown generator 'c'"),
    ],
)
def test_bad_input_is_named(capsys, tmp_path, arguments, message):
    code, out, err = _run(capsys, "--out", str(tmp_path / "p"), *arguments)
    assert (code, out) == (2, "") and message in err
    assert not (tmp_path / "p").exists()


def test_without_the_tool_it_says_so(capsys, tmp_path, monkeypatch):
    from cablebench.cli.app import app

    left = [c for c in app.registered_commands if c.name != "diagnose"]
    monkeypatch.setattr(app, "registered_commands", left)
    code, _, err = _run(capsys, "--out", str(tmp_path / "p"))
    assert code == 2 and "no command 'cablebench diagnose'" in err


def test_baselines_alone_make_a_record_that_goes_on(capsys, tmp_path, monkeypatch):
    """Two cases, scored; the second call does nothing anew; data changed since the sealing are refused."""
    pytest.importorskip("pysindy")
    from cable_envs.proof import cases, run
    from cable_envs.proof.cases import Case

    two = [Case("case-0001", 4, "linear_drive", "nothing"), Case("case-0002", 5, "cable_hole", "decoy")]
    monkeypatch.setattr(cases, "plan", lambda *_, **__: two)
    arguments = ["--no-tool", "--out", str(tmp_path), "--json"]
    code, out, _ = _run(capsys, *arguments)
    record = json.loads(out)
    assert code == 0 and list(record["methods"]) == list(run.BASELINES)
    assert (tmp_path / "proof.html").read_text().startswith("<!doctype html>")
    assert "| only parameters wrong: an effect is named |" in (tmp_path / "proof.md").read_text()
    written = {f: f.stat().st_mtime_ns for f in (tmp_path / "verdicts").rglob("*.json")}
    assert len(written) == 6
    assert json.loads(_run(capsys, *arguments)[1]) == record
    assert {f: f.stat().st_mtime_ns for f in written} == written
    with (tmp_path / "recordings" / "case-0001" / "run_1.csv").open("a") as file:
        file.write("1,2,3,4,5\n")
    code, _, err = _run(capsys, *arguments)
    assert code == 2 and "case-0001 changed since the keys were sealed" in err


def test_the_other_generator_makes_its_own_cases(capsys, tmp_path, monkeypatch):
    pytest.importorskip("pysindy")
    from cable_envs.proof.cases import Case
    from cable_envs.proof.family_b import cases

    one = [Case("case-0001", 4, "linear_drive", "nothing", noise="rows")]
    monkeypatch.setattr(cases, "plan", lambda *_, **__: one)
    _, out, _ = _run(capsys, "--no-tool", "--generator", "b", "--out", str(tmp_path), "--json")
    record = json.loads(out)
    assert "--generator b" in record["command"] and record["plan"]["generator"] == "b"
    assert json.loads((tmp_path / "keys" / "case-0001.json").read_text())["key"]["family"] == "B"
    code, _, err = _run(capsys, "--no-tool", "--out", str(tmp_path), "--first", "1")
    assert code == 2 and ("another proof" in err or "changed" in err)


def test_a_proof_is_by_one_state_of_the_tool(capsys, tmp_path, monkeypatch):
    pytest.importorskip("pysindy")
    from cable_envs.proof import cases
    from cable_envs.proof.cases import Case

    monkeypatch.setattr(cases, "plan", lambda *_, **__: [Case("case-0001", 4, "linear_drive", "nothing")])
    arguments = ("--no-tool", "--out", str(tmp_path / "p"))
    assert _run(capsys, *arguments)[0] == 0 and _run(capsys, *arguments)[0] == 0
    monkeypatch.setattr(command, "_state", lambda: "another")
    code, _, err = _run(capsys, *arguments)
    assert code == 2 and "the tool changed since the keys were sealed" in err


def test_only_some_kinds_of_cases(capsys, tmp_path, monkeypatch):
    pytest.importorskip("pysindy")
    from cable_envs.proof import cases
    from cable_envs.proof.cases import Case

    two = [Case("case-0001", 4, "linear_drive", "nothing"), Case("case-0002", 5, "linear_drive", "decoy")]
    monkeypatch.setattr(cases, "plan", lambda *_, **__: two)
    _, out, _ = _run(capsys, "--no-tool", "--kind", "decoy", "--first", "1", "--out", str(tmp_path / "p"), "--json")
    record = json.loads(out)
    assert [c["name"] for c in record["methods"]["no refit"]["cases"]] == ["case-0002"]
    assert "--first 1 --kind decoy" in record["command"]
    code, _, err = _run(capsys, "--no-tool", "--kind", "pair", "--out", str(tmp_path / "q"))
    assert code == 2 and "no case of kind pair" in err and not (tmp_path / "q").exists()


def test_parts_join_to_the_whole(capsys, tmp_path, monkeypatch):
    pytest.importorskip("pysindy")
    from cable_envs.proof import cases
    from cable_envs.proof.cases import Case

    two = [Case("case-0001", 4, "linear_drive", "nothing"), Case("case-0002", 5, "linear_drive", "decoy")]
    monkeypatch.setattr(cases, "plan", lambda *_, **__: two)
    found = {}
    for name, part in {"whole": (), "one": ("--first", "1"), "two": ("--after", "1")}.items():
        _, out, _ = _run(capsys, "--no-tool", "--out", str(tmp_path / name), *part, "--json")
        found[name] = json.loads(out)
    files = [str(tmp_path / name / "proof.json.xz") for name in ("one", "two")]
    join = ["--join", files[0], "--join"]
    code, out, _ = _run(capsys, *join, files[1], "--out", str(tmp_path / "all"), "--json")
    joined = json.loads(out)
    assert code == 0 and joined["methods"] == found["whole"]["methods"] and joined["cases_total"] == 2
    assert joined["state"] == found["one"]["state"] == command._state()
    assert joined["command"] == f"{found['one']['command']}; {found['two']['command']}"
    assert f"`{command._state()}`" in (tmp_path / "all" / "proof.md").read_text(encoding="utf-8")

    (tmp_path / "other.json").write_text(json.dumps({**found["two"], "plan": {**found["two"]["plan"], "seed": 9}}))
    (tmp_path / "later.json").write_text(json.dumps({**found["two"], "state": "another"}))
    (tmp_path / "none.json").write_text("{}")
    for file, message in (
        (files[0], "in more than one part: case-0001"),
        (str(tmp_path / "other.json"), "of different plans"),
        (str(tmp_path / "later.json"), "by different states of the tool"),
        (str(tmp_path / "none.json"), "no record of schema"),
        (str(tmp_path / "gone.json"), "cannot be read"),
    ):
        code, _, err = _run(capsys, *join, file, "--out", str(tmp_path / "bad"))
        assert code == 2 and message in err.replace("\n", " ") and not (tmp_path / "bad").exists()
    code, _, err = _run(capsys, *join, files[1], "--after", "1", "--out", str(tmp_path / "bad"))
    assert code == 2 and "only --out and --json" in err.replace("\n", " ")
    code, _, err = _run(capsys, "--no-tool", "--after", "2", "--out", str(tmp_path / "bad"))
    assert code == 2 and "--after 2 leaves none of 2 cases" in err


def test_a_broken_rule_is_exit_code_1(capsys, tmp_path, monkeypatch):
    """A tool that cries wolf: the command runs it on a copy that holds the recording and nothing else."""
    from cable_envs.proof import cases
    from cable_envs.proof.cases import Case

    tool = tmp_path / "tool.py"
    tool.write_text(
        "import json, pathlib, sys\n"
        "folder = pathlib.Path(sys.argv[1])\n"
        "assert sorted(p.name for p in folder.parent.iterdir()) == ['recording'], 'sees more than the recording'\n"
        "print(json.dumps({'schema': 'cable-diagnosis/1', 'verdict': 'named',"
        " 'effects': [{'name': 'backlash', 'confidence': 0.99}]}))\n"
    )
    import sys

    monkeypatch.setattr(cases, "plan", lambda *_, **__: [Case("case-0001", 4, "linear_drive", "nothing")])
    monkeypatch.setattr(command, "_tool_command", lambda _: [sys.executable, str(tool)])
    code, out, _ = _run(capsys, "--no-baselines", "--out", str(tmp_path / "p"), "--json")
    record = json.loads(out)
    assert code == 1 and record["broken_rules"][0].startswith("false alarms: 1 of 1")
    assert record["methods"]["diagnose"]["cases"][0]["answer"] == ["backlash"]


TOOL = """
import json, os, signal, sys, time
from pathlib import Path
if not Path({allowed!r}).exists() and Path({mark!r}).exists() is False:
    Path({mark!r}).touch()
    {end}
print(json.dumps({{"schema": "cable-diagnosis/1", "verdict": "no_detectable_mismatch", "effects": []}}))
"""


@pytest.mark.parametrize(("end", "why"), [
    ("os.kill(os.getpid(), signal.SIGKILL)", "killed by signal 9 (SIGKILL)"),
    ("os.kill(os.getpid(), signal.SIGTERM)", "killed by signal 15 (SIGTERM)"),
    ("sys.exit(130)", "killed by signal 2 (SIGINT)"),
    ("time.sleep(30)", "not ended within 1 s"),
    ("sys.exit(1)", ""),  # it failed by itself: that is a result
])  # fmt: skip
def test_a_killed_tool_is_missing_and_no_wrong_answer(capsys, tmp_path, monkeypatch, end, why):
    import sys

    from cable_envs.proof import cases, run
    from cable_envs.proof.cases import Case

    two = [Case("case-0001", 4, "linear_drive", "nothing"), Case("case-0002", 5, "linear_drive", "nothing")]
    monkeypatch.setattr(cases, "plan", lambda *_, **__: two)
    monkeypatch.setattr(run, "LIMIT", 1.0 if "sleep" in end else 60.0)
    code_of_tool = TOOL.format(mark=str(tmp_path / "mark"), allowed=str(tmp_path / "allowed"), end=end)
    monkeypatch.setattr(command, "_tool_command", lambda _: [sys.executable, "-c", code_of_tool])
    monkeypatch.setattr(command, "open_backend", lambda *_: _Here())
    arguments = ("--no-baselines", "--out", str(tmp_path / "p"), "--json")
    code, out, err = _run(capsys, *arguments)
    record = json.loads(out)
    counted = len(record["methods"]["diagnose"]["cases"])
    page = (tmp_path / "p" / "proof.html").read_text()
    if not why:
        assert counted == 2 and "missing" not in record and "Missing" not in page
        return
    assert code == 1 and counted == record["cases_total"] == 1
    assert record["missing"] == {"diagnose": {"case-0001": why}} and "tries them again" in err
    assert all("Missing, and not counted" in text for text in (page, (tmp_path / "p" / "proof.md").read_text()))
    (tmp_path / "allowed").touch()
    record = json.loads(_run(capsys, *arguments)[1])  # the same command again: now there is a verdict
    assert len(record["methods"]["diagnose"]["cases"]) == 2 and "missing" not in record


class _Here:
    """A backend that runs jobs in this process."""

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass

    def run(self, jobs):
        from cablebench.jobs.work import Context, Done, perform

        for job in jobs:
            yield Done(job, *perform(job, Context(lambda *_: None, {})))
