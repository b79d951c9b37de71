"""Processes that write and pack one store at the same time: what was acknowledged is there afterwards, once."""

import subprocess
import sys
import time
from pathlib import Path

import pytest
from filelock import FileLock

from cable_envs.core.errors import ConfigurationError
from cablebench.run import store as store_module
from cablebench.run.store import ResultStore
from tests.support.board_records import a_record

ROOT = Path(__file__).parents[2]
WRITER = """
import sys
from cablebench.run.store import ResultStore
from tests.support.board_records import a_record
store, first, count = ResultStore(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])
for seed in range(first, first + count):
    store.append(a_record(seed))
    print(seed, flush=True)  # acknowledged
"""
PACKER = """
import sys, time
from cablebench.run.store import ResultStore
store = ResultStore(sys.argv[1])
print("ready", flush=True)
while True:
    store.pack()
    time.sleep(0.02)
"""


def started(code, *arguments):
    return subprocess.Popen(
        [sys.executable, "-c", code, *map(str, arguments)], cwd=ROOT, stdout=subprocess.PIPE, text=True
    )


def test_nothing_acknowledged_is_lost_to_a_packer_or_another_writer(tmp_path):
    store, each = ResultStore(tmp_path / "records.jsonl"), 100
    store.append([a_record(seed) for seed in range(1000)])  # a store that takes a while to pack
    packer = started(PACKER, store.path)
    try:
        assert packer.stdout.readline() == "ready\n"
        writers = [started(WRITER, store.path, first, each) for first in (10_000, 20_000)]
        acknowledged = [int(line) for w in writers for line in w.communicate(timeout=120)[0].split()]
        assert packer.poll() is None  # it packed all the while
    finally:
        packer.kill()
        packer.communicate()
    assert len(acknowledged) == 2 * each
    reading = store.read()
    assert reading.left_out == ()
    assert {r["seed"] for r in reading.records} == {*range(1000), *acknowledged}
    store.pack()
    assert len(store.records()) == 1000 + 2 * each and not store.path.exists()


def test_a_writer_that_was_killed_leaves_no_lock(tmp_path):
    store = ResultStore(tmp_path / "records.jsonl")
    writer = started(WRITER, store.path, 0, 10**6)
    while store.path.exists() is False:
        time.sleep(0.01)
    writer.kill()
    acknowledged = [int(line) for line in writer.communicate()[0].split("\n")[:-1]]
    store.append(a_record(10**7))
    seeds = {r["seed"] for r in store.read().records}
    assert {10**7, *acknowledged} <= seeds


def test_who_waits_too_long_is_told(tmp_path, monkeypatch):
    monkeypatch.setattr(store_module, "PATIENCE", 0.05)
    store = ResultStore(tmp_path / "records.jsonl")
    with FileLock(tmp_path / "records.jsonl.lock"), pytest.raises(ConfigurationError, match="another process"):
        store.append(a_record())
    store.append(a_record())
    assert len(store.records()) == 1
