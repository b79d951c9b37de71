"""Strangers' files through every command that reads data: refused in one line or read, never run, never endless."""

import resource
from pathlib import Path

import pytest

from tests.crashes.hostile import MARK, all_of_them
from tests.crashes.killing import command, run

LIMIT, MEMORY = 60.0, 4 * 2**30
"""s, and bytes beyond what the process has, that the reading of a file may take."""
FILES = {hostile.name: hostile for hostile in all_of_them()}


LOADED = (
    "cablebench.cli.app", "cablebench.cli.shared.policies", "cablebench.cli.bench.run", "cablebench.pages.diagnosis",
    "cable_envs.diagnosis.data.first_look", "cable_envs.diagnosis.engine", "cable_envs.diagnosis.readers.writer",
    "scipy.signal", "scipy.io", "pyarrow.parquet", "h5py", "asammdf", "mcap.reader", "rosbags.highlevel",
)  # fmt: skip


@pytest.fixture(scope="module", autouse=True)
def loaded():
    """What the commands import, once for all forks."""
    for module in LOADED:
        pytest.importorskip(module)


def limited(body):
    """The same with no more memory than `MEMORY`."""

    def run_limited(tell):
        size = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (size + MEMORY, size + MEMORY))
        body(tell)

    return run_limited


def test_there_are_many():
    assert len(FILES) >= 60


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.slow] if k % 3 else []) for k, name in enumerate(FILES)]
)
def test_a_hostile_file_is_refused_in_one_line_or_read(tmp_path, name):
    hostile, folder = FILES[name], tmp_path / "work"
    folder.mkdir()
    hostile.make(folder)
    ended = run(limited(command(*hostile.words)), folder, after=LIMIT)
    said = [line for line in ended.err.splitlines() if line.startswith("cablebench: error: ")]
    assert "Traceback" not in ended.err, ended.err[-3000:]
    assert ended.code in (0, 2), (ended.code, ended.err[-1500:])
    assert hostile.safe == (ended.code == 0), ended.out[-500:]
    if ended.code:
        assert len(said) == 1 and len(said[0]) < 3000, ended.err
    assert not list(tmp_path.rglob(MARK)) and not list(tmp_path.rglob("escaped*"))
    assert not list(folder.glob("out/*")), "something was half-written"
