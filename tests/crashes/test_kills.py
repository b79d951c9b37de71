"""A sample of the kills of `tests.crashes.kills`, and all of them for whoever has half an hour."""

import importlib
import json
import os
import random
import subprocess
import sys
from pathlib import Path

import pytest

from tests.crashes.commands import CASES
from tests.crashes.kills import Whole, chain

ROOT = Path(__file__).parents[2]
SAMPLE = ("evaluate", "import", "tune")
LOADED = ("cablebench.cli.app", "cablebench.run.jobs", "cablebench.tune.study", "cable_envs.diagnosis.readers.writer",
          "cablebench.cli.learn.tune_controllers", "optuna.storages", "alembic.command", "rich.table")  # fmt: skip
"""Cases of a second; evaluate's changes of files are its records and trajectories."""


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """The sample's cases without a kill, in a process that has imported what they need."""
    for module in LOADED:
        importlib.import_module(module)
    return Whole(tmp_path_factory.mktemp("kills"), [case for case in CASES if case.name in SAMPLE])


@pytest.mark.parametrize("name", SAMPLE)
def test_nothing_is_lost_where_a_command_is_killed_as_it_writes(whole, name):
    case, rng = next(c for c in CASES if c.name == name), random.Random(name)
    chains = [chain(case, whole, rng, f"chain-{k}", first="change") for k in range(2)]
    assert sum(len(c["kills"]) for c in chains) >= 2
    assert [c["wrong"] for c in chains] == [[], []]


@pytest.mark.slow
@pytest.mark.timeout(7200)
def test_two_hundred_kills_lose_nothing(tmp_path):
    out = tmp_path / "kills.jsonl"
    words = [sys.executable, "-m", "tests.crashes.kills", "--kills", "200", "--out", str(out)]
    done = subprocess.run(words, cwd=ROOT, env={**os.environ, "PYTHONPATH": str(ROOT)}, check=False)
    found = [json.loads(line) for line in out.read_text().splitlines()]
    assert done.returncode == 0 and sum(len(f["kills"]) for f in found) >= 200
    assert [f for f in found if f["wrong"]] == []
