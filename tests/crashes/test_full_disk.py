"""A full disk and a folder that may not be written to: one line that names it, exit code 2, what was there stays.

A limit on the size of files stands for the full disk: the system then refuses the write as it does there (EFBIG for
ENOSPC), and no rights are needed. Root is refused by no
folder, so a file stands in the folder's way.
"""

import os
import resource
from pathlib import Path

import pytest

from cable_envs.core.errors import ConfigurationError
from cable_envs.core.files import CannotWrite, require_writable, write_atomic
from cablebench.run.store import ResultStore
from tests.crashes.commands import BOARD, DIAGNOSE, EVALUATE, EXPORT, HOLE, IMPORT, PROOF, TUNE, make_stock
from tests.crashes.killing import command, leftovers, run
from tests.support.board_records import a_record

TRAIN = ("train", "--env", HOLE, "--algo", "ppo-tiny.yaml", "--out", "p")
COMMANDS = {
    "evaluate": (EVALUATE, "r"), "train": (TRAIN, "p"), "tune": (TUNE, "s"), "diagnose": (DIAGNOSE, "d"),
    "proof": (PROOF, "proof"), "import": (IMPORT, "o"), "export": ((*EXPORT, "--format", "recording"), "e"),
    "export minari": ((*EXPORT, "--format", "minari"), "e"), "publish": (("publish", "trained", "--out", "z"), "z"),
    "leaderboard": ((*BOARD, "--out", "b"), "b"),
    "demo": (("demo", "--protocol", "tiny.yaml", "--out", "demo"), "demo"),
    "run": (("run", HOLE, "--controller", "pid", "--option", "duration=0.5", "--save", "x/e.npz"), "x"),
    "recordings": (("recordings", "--shared", "logs", "--out", "w"), "w"),
    "reproduce": (("reproduce", "gu-table2", "--out", "rep"), "rep"),
}  # fmt: skip


@pytest.fixture(scope="module")
def stock(tmp_path_factory):
    """What the commands read."""
    folder = tmp_path_factory.mktemp("stock") / "work"
    make_stock(folder)
    store = ResultStore(folder / "r" / "records.jsonl")
    store.append(a_record())
    return folder


def files_of(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def small(body, size=256):
    """The same where no file can grow beyond ``size`` bytes."""

    def limited(tell):
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))
        body(tell)

    return limited


def unlogged(ended):
    """The one line of the error."""
    assert ended.code == 2 and "Traceback" not in ended.err, ended.err[-2000:]
    said = [line for line in ended.err.splitlines() if line.startswith("cablebench: error: ")]
    assert len(said) == 1, ended.err[-2000:]
    return said[0]


# publish needs a policy and leaderboard a board's records: their writing is covered by `write_atomic` below
@pytest.mark.parametrize("name", [n for n in COMMANDS if n not in ("publish", "leaderboard", "reproduce")])
def test_a_full_disk_is_said_before_the_work(stock, name):
    words, place = COMMANDS[name]
    before = files_of(stock)
    said = unlogged(run(small(command(*words)), stock, after=120.0))
    assert (place in said or str(stock) in said) and os.strerror(27) in said, said
    assert files_of(stock) == before and not leftovers(stock)


@pytest.mark.parametrize("name", [n for n in COMMANDS if n not in ("publish", "leaderboard", "evaluate")])
def test_a_folder_that_cannot_be_is_said_before_the_work(stock, name):
    words, place = COMMANDS[name]
    (stock / place).write_text("in the way")
    try:
        assert place in unlogged(run(command(*words), stock, after=120.0))
        assert (stock / place).read_text() == "in the way"
    finally:
        (stock / place).unlink()


def test_a_store_on_a_full_disk_keeps_what_it_has_and_nothing_half(tmp_path):
    store = ResultStore(tmp_path / "records.jsonl")
    store.append([a_record(seed) for seed in range(3)])
    whole = store.path.read_bytes()

    def body(tell):
        try:
            store.append([a_record(seed) for seed in range(3, 40)])
        except CannotWrite as error:
            print(error)

    (tmp_path / "work").mkdir()
    ended = run(small(body, len(whole) + 700), tmp_path / "work")
    assert ended.out.startswith(f"cannot write {store.path}: ") and ended.out.count("\n") == 1
    assert store.path.read_bytes() == whole


def test_a_write_that_fails_leaves_the_old_file_and_nothing_beside_it(tmp_path):
    path = write_atomic(tmp_path / "work" / "a.txt", "old")

    def body(tell):
        with pytest.raises(CannotWrite, match=r"cannot write a\.txt: File too large"):
            write_atomic("a.txt", "new" * 1000)
        assert issubclass(CannotWrite, ConfigurationError) and issubclass(CannotWrite, OSError)

    assert run(small(body), tmp_path / "work").code == 0
    assert files_of(tmp_path / "work") == {"a.txt": b"old"} and path.read_text() == "old"


def test_what_a_killed_writer_left_is_removed_and_what_a_living_one_writes_stays(tmp_path):
    part = ".b.txt.abcd1234.cable.tmp"
    (tmp_path / part).write_text("half")
    (tmp_path / ".other.tmp").write_text("of another program")
    with open(tmp_path / ".c.txt.abcd1234.cable.tmp", "w") as held:
        import fcntl

        fcntl.flock(held, fcntl.LOCK_EX)
        write_atomic(tmp_path / "a.txt", "x")
        assert sorted(files_of(tmp_path)) == [".c.txt.abcd1234.cable.tmp", ".other.tmp", "a.txt"]
    write_atomic(tmp_path / "a.txt", "y")
    assert sorted(files_of(tmp_path)) == [".other.tmp", "a.txt"]


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_without_rights_is_refused(tmp_path):
    tmp_path.chmod(0o500)
    try:
        with pytest.raises(CannotWrite, match="Permission denied"):
            require_writable(tmp_path / "new")
    finally:
        tmp_path.chmod(0o700)
