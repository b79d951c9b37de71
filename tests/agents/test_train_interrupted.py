"""Ctrl-C of `cablebench train`, as a process of its own: work is kept, and what is said about going on is true."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from cable_envs.agents import train
from cablebench.cli import main

HOLE = "CableHole-Position-Sine"
START = 180.0
"""s that a process may take until it trains: it imports torch and may have to compile kernels."""


def command(folder, *more):
    return ["train", "--env", HOLE, "--steps", "50000000", "--out", str(folder), "-o", "duration=0.5", *more]


def started(*arguments):
    words = [sys.executable, "-m", "cablebench.cli", *arguments]
    return subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True)


def wait_for(process, condition):
    """Until ``condition()`` holds, while the process runs."""
    end = time.monotonic() + START
    while not condition():
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < end
        time.sleep(0.05)


def pressed(process):
    """SIGINT to the process alone, as `kill` sends it; (exit code, standard output, standard error)."""
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=120)
    return process.returncode, out, err


@pytest.mark.slow
def test_ctrl_c_keeps_the_work_and_the_same_command_goes_on(tmp_path):
    """TensorBoard's file shows that the training has begun: then the first rollout is on its way."""
    steps = []
    for n, more in enumerate(([], ["--resume"])):
        logs = tmp_path / f"logs{n}"
        run = started(*command(tmp_path / "run", "--json", "--tensorboard", str(logs), *more))
        wait_for(run, lambda logs=logs: any(logs.rglob("events*")))
        time.sleep(1.0)
        code, out, err = pressed(run)
        assert code == 130, err
        result = json.loads(out)
        steps.append(result["steps"])
        assert not result["complete"] and f"seed 0: stopped after {steps[-1]} steps; saved\n" in err
        assert "The same command with --resume goes on." in err if not more else "The same command goes on." in err
        assert {p.name for p in (tmp_path / "run").iterdir()} == {"policy.zip", "checkpoint.pt"}
    assert 0 < steps[0] < steps[1]


@pytest.mark.slow
def test_ctrl_c_while_workers_are_starting_claims_nothing(tmp_path):
    run = started(*command(tmp_path / "runs", "--seeds", "0:2", "--jobs", "2"))
    children = Path(f"/proc/{run.pid}/task/{run.pid}/children")
    wait_for(run, lambda: len(children.read_text().split()) >= 3)  # two workers and multiprocessing's tracker
    code, _, err = pressed(run)
    assert code == 130, err
    assert "seed 0: nothing was saved\nseed 1: nothing was saved\nThe same command begins anew.\n" in err
    assert "--resume" not in err and not list(tmp_path.rglob("*.zip"))


def said(capsys, *arguments):
    with pytest.raises(SystemExit) as end:
        main([str(a) for a in arguments])
    return end.value.code, capsys.readouterr().err


def test_ctrl_c_before_anything_is_saved_claims_nothing(tmp_path, capsys, monkeypatch):
    """An older training's checkpoint is none of this one's; with --resume it is what one goes on from."""

    def stop(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(train, "train", stop)
    code, err = said(capsys, *command(tmp_path))
    assert code == 130 and err == "seed 0: nothing was saved\nThe same command begins anew.\n"
    (tmp_path / "checkpoint.pt").write_text("of yesterday")
    yesterday = time.time() - 86_400.0
    os.utime(tmp_path / "checkpoint.pt", (yesterday, yesterday))
    code, err = said(capsys, *command(tmp_path, "--overwrite"))
    assert code == 130 and err == "seed 0: nothing was saved\nThe same command begins anew.\n"
    code, err = said(capsys, *command(tmp_path, "--resume"))
    assert code == 130 and err == "seed 0: stopped; its last checkpoint is kept\nThe same command goes on.\n"


def test_resuming_several_seeds_finishes_what_is_missing(tmp_path, capsys):
    small = ["train", "--env", HOLE, "--steps", "8192", "-o", "duration=0.5", "--out"]
    first = tmp_path / f"ppo-{HOLE}-0"
    assert said(capsys, *small, first, "--seed", 0)[0] == 0
    before = (first / "policy.zip").read_bytes()
    code, err = said(capsys, *small, tmp_path, "--seeds", "0:2", "--resume")
    assert code == 0, err
    assert (first / "policy.zip").read_bytes() == before and (tmp_path / f"ppo-{HOLE}-1" / "policy.zip").exists()
    code, err = said(capsys, *small, tmp_path / "none", "--seeds", "0:2", "--resume")
    assert code == 2 and "no policy at" in err
