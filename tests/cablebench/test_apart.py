"""Whatever a newcomer's file does to its process, the evaluation gets an answer, or says that there was none."""

import textwrap

import pytest

from cable_envs.core.errors import ConfigurationError
from cablebench.cli import main
from cablebench.entrants import apart
from cablebench.entrants.apart import submission_entrant
from cablebench.protocol.protocol import Protocol, SeedRange, Task, Track
from cablebench.run.evaluation import evaluate
from cablebench.run.store import ResultStore
from tests.cablebench.test_submit import TINY

HOLE = "cable_envs/CableHole-Position-Sine-v0"
PROTOCOL = Protocol(
    "short", "Short", (Task(HOLE, {"duration": 0.2}),), (Track("nominal"),),
    *(SeedRange(10 * k, 10) for k in range(3)), episodes=2,
)  # fmt: skip
FILE = """
import ctypes, os, signal, sys, time
name = "theirs"
information = "model-free"
calls = 0

def reset():
    {reset}

def act(t, y, ref):
    global calls
    calls += 1
    if calls > 25:  # in the second episode
        {act}
    return 50.0
"""
HOSTILE = {
    "os._exit(0)": r"act\(\) ended its process without an answer \(exit code 0\)",
    "os._exit(3)": "exit code 3",
    "sys.exit(0)": r"act\(\) raised SystemExit",
    "raise KeyboardInterrupt": r"act\(\) raised KeyboardInterrupt",
    "raise GeneratorExit": r"act\(\) raised GeneratorExit",
    "os.kill(os.getpid(), signal.SIGKILL)": "killed by signal 9",
    "ctypes.string_at(0)": r"killed by signal 11 \(SIGSEGV\)",
    "time.sleep(60)": r"act\(\) has not answered within 1 s",
    "signal.pthread_sigmask(signal.SIG_BLOCK, range(1, 32)); time.sleep(60)": "has not answered within 1 s",
    "os.close(int(sys.argv[2])); time.sleep(60)": "without an answer",
    "os.write(int(sys.argv[2]), b'garbage' * 100)": "sent no answer",
    "os.write(int(sys.argv[2]), bytes([0, 0, 0, 9]) + b'[\"ok\", []]'[:9])": "sent no answer",
    "os.write(int(sys.argv[2]), bytes([0, 0, 0, 12]) + b'[\"ok\", true]')": "sent no number",
    "return 10**400": "OverflowError",
    "return [1.0]": "expected one number",
    "return None": "expected one number",
}


def written(folder, act="pass", reset="pass"):
    path = folder / "theirs.py"
    path.write_text(textwrap.dedent(FILE.format(act=act, reset=reset)))
    return path


FEW = ("os._exit(3)", "sys.exit(0)", "ctypes.string_at(0)", "time.sleep(60)", "return None")
"""One of each kind in `make test`: each case starts two processes, and `test_cheats` has the same with one."""


@pytest.mark.parametrize("act", [pytest.param(a, marks=[] if a in FEW else pytest.mark.slow) for a in HOSTILE])
def test_no_answer_is_a_named_refusal_and_no_run(tmp_path, monkeypatch, act):
    monkeypatch.setattr(apart, "ANSWER", 1.0)
    store, path = ResultStore(tmp_path / "records.jsonl"), written(tmp_path, act)
    with pytest.raises(ConfigurationError, match=HOSTILE[act]) as caught:
        evaluate(PROTOCOL, [submission_entrant(path)], store=store)
    assert str(path) in str(caught.value) and "\n" not in str(caught.value)
    assert len(store.records()) == 1  # the episode before it, which no board ranks


@pytest.mark.parametrize(
    "line",
    [
        "import os; os._exit(0)",
        pytest.param("import os; os.kill(os.getpid(), 9)", marks=pytest.mark.slow),
        "raise GeneratorExit",
    ],
)
def test_a_file_that_ends_while_it_is_loaded_is_named(tmp_path, line):
    path = written(tmp_path)
    path.write_text(line + "\n" + path.read_text())
    with pytest.raises(ConfigurationError, match=r"theirs\.py.*load\(\)"):
        submission_entrant(path)


def test_all_answers_of_an_episode_have_a_limit(tmp_path, monkeypatch):
    monkeypatch.setattr(apart, "EPISODE", 0.1)
    with pytest.raises(ConfigurationError, match=r"more than 0\.1 s of one episode"):
        evaluate(PROTOCOL, [submission_entrant(written(tmp_path, "time.sleep(0.03)"))])


PATCH = """
    import cablebench.run.records as records, cablebench.protocol.metrics as metrics
    records.measure = metrics.measure = lambda episode: {"rmse": 0.0, "failed": 0.0}
    frame = sys._getframe()
    while frame is not None:
        assert not any("rig" in name for name in frame.f_locals if name == "true_rig"), "found the true rig"
        frame = frame.f_back
"""


@pytest.mark.slow  # as test_patching_modules_changes_nothing in test_cheats, from reset() and with a look at the frames
def test_the_scorer_is_out_of_reach(tmp_path):
    honest = evaluate(PROTOCOL, [submission_entrant(written(tmp_path))])
    cheat = evaluate(PROTOCOL, [submission_entrant(written(tmp_path, reset=PATCH.strip()))])
    keys = [k for k in honest[0]["metrics"] if k != "inference_us"]
    assert [[r["metrics"][k] for k in keys] for r in honest] == [[r["metrics"][k] for k in keys] for r in cheat]
    assert honest[0]["metrics"]["rmse"] > 1e-4


def test_the_command_does_not_end_as_if_all_were_well(tmp_path, capfd):
    (tmp_path / "tiny.yaml").write_text(TINY)
    # the dry run asks 50 times, each episode of the evaluation 50 times: this one ends in the first episode
    path = written(tmp_path, "os._exit(0)")
    path.write_text(path.read_text().replace("calls > 25", "calls > 40"))
    arguments = ["submit", path, "--protocol", tmp_path / "tiny.yaml", "--results", tmp_path / "r", "--trust"]
    with pytest.raises(SystemExit) as end:
        main([str(a) for a in arguments])
    err = capfd.readouterr().err
    assert end.value.code == 2 and "ended its process without an answer (exit code 0)" in err
    left = tmp_path / "r" / "records.jsonl"
    assert not left.exists() or all(r["entrant"] != "theirs" for r in ResultStore(left).records())
