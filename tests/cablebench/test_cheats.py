"""Every cheat that could be thought of is tried, and each ends as a failed episode or a refusal in one line.

Two kinds: what a file may try and be denied (it is told so by an exception, reports it by its command, and runs on),
and what ends its process. All run in the strongest sandbox of this machine; `SANDBOX` of the environment
(``CABLE_SANDBOX=bwrap``) takes another.
"""

import gc
import os
import re
import socket
import textwrap
import threading
from pathlib import Path

import numpy as np
import pytest

from cable_envs.core.errors import ConfigurationError
from cable_envs.sim.registered import setup_of
from cablebench.entrants import apart
from cablebench.entrants.sandbox import walls
from cablebench.entrants.sandbox.kinds import choose
from cablebench.protocol.protocol import Protocol, SeedRange, Task, Track
from cablebench.run.evaluation import evaluate
from cablebench.run.store import ResultStore

HOLE = "cable_envs/CableHole-Position-Sine-v0"
SANDBOX = os.environ.get("CABLE_SANDBOX", "auto")
WALLED = choose(SANDBOX).kind in ("landlock", "bwrap") and walls.may_filter_calls()
walled = pytest.mark.skipif(not WALLED, reason="this machine has no Landlock, or no filter of system calls")

HEAD = """
import ctypes, gc, json, mmap, os, signal, socket, subprocess, sys, threading, time
name = "cheat"
information = "model-free"
libc = ctypes.CDLL(None, use_errno=True)
PARENT, STORE, SECRET, HIDDEN = {parent}, {store!r}, {secret!r}, {hidden!r}

def reset():
    pass

def succeeded(thing):
    '''What a call to the C library gave, as Python says it.'''
    if thing == -1:
        raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))
"""

DENIED = {
    "read the store": "open(STORE).read()",
    "write to the store": "open(STORE, 'a').write('{}')",
    "replace the store": "os.replace(STORE, STORE + '.old')",
    "delete the store": "os.remove(STORE)",
    "empty the store": "os.truncate(STORE, 0)",
    "link to the store": "os.symlink(STORE, 'link')",
    "list the folder of the store": "os.listdir(os.path.dirname(STORE))",
    "read the secret of the exam": "open(SECRET).read()",
    "read another's home": "os.listdir(os.path.expanduser('~root'))",
    "read /etc/passwd": "open('/etc/passwd').read()",
    "read the environment of the scorer": "open(f'/proc/{PARENT}/environ', 'rb').read()",
    "read the memory of the scorer": "open(f'/proc/{PARENT}/mem', 'rb').read(1)",
    "list the files of the scorer": "os.listdir(f'/proc/{PARENT}/fd')",
    "open a file of the scorer": "open(f'/proc/{PARENT}/fd/1', 'wb')",
    "look into /proc/self": "os.listdir('/proc/self/fd')",
    "look through /proc": "os.listdir('/proc')",
    "trace the scorer": "succeeded(libc.ptrace(16, PARENT, 0, 0))",
    "read the scorer's memory by a call": (
        "b = ctypes.create_string_buffer(16)\n    succeeded(libc.syscall(310, PARENT, b, 1, b, 1, 0))"
    ),
    "take a file descriptor of the scorer": (
        "succeeded(fd := libc.syscall(434, PARENT, 0))\n    succeeded(libc.syscall(438, fd, 1, 0))"
    ),
    "kill the scorer": "os.kill(PARENT, signal.SIGKILL)",
    "stop the scorer": "os.kill(PARENT, signal.SIGSTOP)",
    "kill every process": "os.kill(-1, signal.SIGKILL)",
    "open a TCP socket": "socket.create_connection(('127.0.0.1', {port}), timeout=1).send(b'hello')",
    "open a UDP socket": "socket.socket(socket.AF_INET, socket.SOCK_DGRAM).sendto(b'x', ('127.0.0.1', 9))",
    "open a UNIX socket": "socket.socket(socket.AF_UNIX)",
    "fork": "os.fork()",
    "fork bomb": "[os.fork() for _ in range(1000)]",
    "start a program": "subprocess.run(['true'])",
    "become another program": "os.execv('/bin/true', ['true'])",
    "leave a thread behind": "threading.Thread(target=time.sleep, args=(3600,)).start()",
    "write 10 GB here": "f = open('big', 'wb')\n    [f.write(bytes(2**20)) for _ in range(10_000)]",
    "write 10 GB to memory": "f = os.memfd_create('big')\n    [os.write(f, bytes(2**20)) for _ in range(10_000)]",
    "write to /tmp": "open('/tmp/cheat', 'w')",
    "write to shared memory": "open('/dev/shm/cheat', 'w')",
    "change the installation": "open(os.__file__, 'a')",
    "change the project": "import cablebench; open(cablebench.__path__[0] + '/cheat.py', 'w')",
    "io_uring": "succeeded(libc.syscall(425, 8, ctypes.create_string_buffer(120)))",
    "namespaces of its own": "succeeded(libc.unshare(0x10000000))",
    "raise its limits": "import resource; resource.setrlimit(resource.RLIMIT_NPROC, (100, 100))",
    "mount": "succeeded(libc.mount(b'none', b'/tmp', b'tmpfs', 0, None))",
    "32-bit numbers of calls": "succeeded(libc.syscall(0x40000000 + 57))",
    "a memory bomb": "bytearray(8 * 2**30)",
}
NOT_THERE = {
    "frames of the scorer": (
        "frame, names = sys._getframe(), set()\n"
        "    while frame is not None:\n"
        "        names |= set(frame.f_locals)\n"
        "        frame = frame.f_back\n"
        "    found = sorted(n for n in names if 'true' in n or n in ('env', 'episode', 'seed', 'store', 'record'))"
    ),
    "objects of the scorer": (
        "kinds = ('CableEnv', 'ResultStore', 'Episode', 'Protocol', 'Setup', 'Rig')\n"
        "    found = [type(o).__name__ for o in gc.get_objects() if type(o).__name__ in kinds]"
    ),
    "seeds or paths in its memory": (
        "wanted = {bytes.fromhex(h).decode() for h in HIDDEN}\n"
        "    wanted |= {int(w) for w in wanted if w.isdigit()}\n"
        "    every = [o for o in gc.get_objects() if isinstance(o, (dict, list, tuple, set)) and o is not wanted]\n"
        "    values = [v for o in every for v in (o.values() if isinstance(o, dict) else o)]\n"
        "    found = [str(v) for v in values if isinstance(v, (str, int)) and v in wanted]"
    ),
    "secrets of the environment": "found = sorted(k for k in os.environ if 'SECRET' in k or 'TOKEN' in k)",
    "open files of the scorer": (  # a pipe with both ends here is its own: a library made it
        "seen = []\n    for n in range(3, 128):\n        try:\n            seen.append((n, os.fstat(n).st_ino))\n"
        "        except OSError:\n            pass\n    inodes = [inode for _, inode in seen]\n"
        "    found = [n for n, inode in seen if n != int(sys.argv[2]) and inodes.count(inode) == 1]"
    ),
}
ENDS = {
    "exit": ("sys.exit(0)", r"SystemExit"),
    "exit without a word": ("os._exit(0)", r"ended its process without an answer \(exit code 0\)"),
    "exit of the C library": ("libc.exit(0)", r"exit code 0"),
    "kill itself": ("os.kill(os.getpid(), signal.SIGKILL)", r"killed by signal 9"),
    "crash": ("ctypes.string_at(0)", r"SIGSEGV|exit code 139"),
    "sleep": ("time.sleep(3600)", r"has not answered within 1 s"),
    "hang": ("while True: pass", r"has not answered within 1 s"),
    "sleep with signals blocked": (
        "signal.pthread_sigmask(signal.SIG_BLOCK, range(1, 32)); time.sleep(3600)",
        r"has not answered within 1 s",
    ),
    "close the pipe": ("os.close(int(sys.argv[2])); time.sleep(3600)", r"closed its connection without an answer"),
    "garbage on the pipe": ("os.write(int(sys.argv[2]), b'garbage' * 100)", r"sent no answer but something else"),
    "an answer of 2 GB": (
        "os.write(int(sys.argv[2]), (2**31 - 1).to_bytes(4, 'big')); time.sleep(3600)",
        r"sent no answer",
    ),
    "half an answer": ("os.write(int(sys.argv[2]), bytes([0, 0, 1, 0]) + b'[')\n    time.sleep(3600)", r"not answered"),
    "an answer byte by byte": (
        "os.write(int(sys.argv[2]), bytes([0, 1, 0, 0]))\n    while True:\n"
        "        os.write(int(sys.argv[2]), b'1'); time.sleep(0.2)",
        r"has not answered within 1 s",
    ),
    "a deep answer": (
        "a = b'[' * 100_000; os.write(int(sys.argv[2]), len(a).to_bytes(4, 'big') + a)",
        r"sent no answer",
    ),
    "an answer that is true": (
        "os.write(int(sys.argv[2]), bytes([0, 0, 0, 12]) + b'[\"ok\", true]')",
        r"sent no number",
    ),
    "a gigantic number": ("return 10**400", r"OverflowError"),
    "a gigantic text": ("return 'x' * 10**8", r"expected one number|could not convert|sent no"),
    "no number": ("return None", r"expected one number"),
    "an error without end": ("raise RuntimeError('x\\n' * 10**6)", r"RuntimeError"),
    "recursion": ("return act(t, y, ref)", r"RecursionError"),
    "an endless list": ("x = []\n    while True: x.append(bytearray(2**20))", r"MemoryError|SIGKILL|has not answered"),
}


REFUSALS = (
    "PermissionError|OSError|FileNotFoundError|MemoryError|RuntimeError: can't start new thread|ProcessLookupError|"
    "ValueError: not allowed to raise"
)


@pytest.fixture(scope="module")
def lair(tmp_path_factory):
    """A folder with a store, a secret, and where the cheat's file is written; a listening socket; the environment."""
    folder = tmp_path_factory.mktemp("lair")
    (folder / "results").mkdir()
    (folder / "results" / "records.jsonl").write_text("{}\n")
    (folder / "exam.secret").write_text("0" * 64 + "\n")
    with socket.create_server(("127.0.0.1", 0)) as server, pytest.MonkeyPatch.context() as patch:
        patch.setenv("MY_TOKEN", "hidden")
        yield folder, server.getsockname()[1]


def cheat(folder, port, body, name="cheat.py", seeds=()):
    """A file with the cheat; where ``seeds`` are given it looks for them, and knows no path but in a hidden form."""
    store, secret = str(folder / "results" / "records.jsonl"), str(folder / "exam.secret")
    hidden = [str(w).encode().hex() for w in (store, secret, *seeds)]
    given = {"parent": os.getpid(), "store": store, "secret": secret, "hidden": hidden}
    given |= {"store": "", "secret": ""} if seeds else {}
    text = (
        HEAD.format(**given) + "\ndef act(t, y, ref):\n    " + body.replace("{port}", str(port)) + "\n    return 1.0\n"
    )
    (folder / name).write_text(text)
    return folder / name


def controller_of(path):
    return apart.controller_kind(path, SANDBOX).made_for(setup_of(HOLE, {}))


def tried(folder, port, cases, sandbox=SANDBOX, seeds=()):
    """What came of each case, all tried by one process: {name: how it was denied, or what it gave}."""
    body = "".join(
        f"\ndef try_{i}():\n    {code.replace('{port}', str(port))}\n" for i, code in enumerate(cases.values())
    )
    path = cheat(folder, port, "reset()", "all.py", seeds)
    text = path.read_text().split("\ndef act")[0] + body
    text += textwrap.dedent("""
        def act(t, y, ref):
            try:
                found = globals()[f"try_{int(t)}"]()
            except BaseException as error:
                found = f"denied {type(error).__name__}: {error}"
            raise ValueError(f"FOUND {found}")
    """)
    path.write_text(text)
    controller, found = apart.controller_kind(path, sandbox).made_for(setup_of(HOLE, {})), {}
    for i, key in enumerate(cases):
        with pytest.raises(ConfigurationError) as caught:
            controller.act(float(i), {}, (0.0, 0.0, 0.0))
        found[key] = str(caught.value)
    return found


@pytest.fixture(scope="module")
def all_tried(lair):
    """What came of every denied cheat and every search, in the sandbox."""
    searches = {k: f"{code}\n    if found: return ('done', found)\n    return None" for k, code in NOT_THERE.items()}
    denied = {k: f"{code}\n    return 'done'" for k, code in DENIED.items()} if WALLED else {}
    return tried(*lair, denied) | tried(*lair, searches, seeds=(2_000_000, 2_000_001))


@walled
@pytest.mark.parametrize("what", DENIED)
def test_denied(all_tried, lair, what):
    assert re.search(rf"FOUND denied ({REFUSALS})", all_tried[what]), all_tried[what]
    folder, _ = lair
    assert sorted(p.name for p in (folder / "results").iterdir()) == ["records.jsonl"]
    assert (folder / "results" / "records.jsonl").read_text() == "{}\n"
    assert not Path("/tmp/cheat").exists() and not Path("/dev/shm/cheat").exists()


HARMLESS = (
    "read the store", "list the folder of the store", "read the secret of the exam", "read /etc/passwd",
    "look into /proc/self", "open a TCP socket", "open a UNIX socket", "start a program",
)  # fmt: skip


@pytest.mark.skipif(not Path("/proc/self").exists(), reason="these cheats are for Linux")
def test_the_same_cheats_succeed_without_a_sandbox(lair):
    """So that what is counted as denied was a cheat: those that do no harm, without walls."""
    done = tried(*lair, {k: f"{DENIED[k]}\n    return 'done'" for k in HARMLESS}, "none")
    assert [k for k, text in done.items() if "FOUND done" not in text] == []


@pytest.mark.parametrize("what", NOT_THERE)
def test_not_there(all_tried, what):
    assert "FOUND None" in all_tried[what], all_tried[what]


@pytest.mark.parametrize("what", ENDS)
def test_named_refusal(lair, monkeypatch, what):
    monkeypatch.setattr(apart, "ANSWER", 1.0)
    code, message = ENDS[what]
    path = cheat(*lair, code)
    controller = controller_of(path)
    before = threading.active_count()
    with pytest.raises(ConfigurationError, match=message) as caught:
        controller.act(0.0, {}, (0.0, 0.0, 0.0))
    text = str(caught.value)
    assert str(path) in text and "\n" not in text and len(text) < 2000 + len(str(path))
    assert threading.active_count() <= before


def test_a_flood_of_print_is_cut_and_cleaned(lair, capsys):
    path = cheat(*lair, "print('\\x1b[2J', 'x' * 10**6, flush=True)")
    assert controller_of(path).act(0.0, {}, (0.0, 0.0, 0.0)) == 1.0
    gc.collect()
    err = capsys.readouterr().err
    assert "\x1b" not in err and len(err) <= apart.PRINTED


@pytest.mark.parametrize(("code", "word"), [("float('nan')", "nan"), ("float('inf')", "inf"), ("-1e308 * 10", "inf")])
def test_no_finite_answer_is_a_failed_episode(lair, tmp_path, code, word):
    protocol = Protocol(
        "short", "Short", (Task(HOLE, {"duration": 0.2}),), (Track("nominal"),),
        *(SeedRange(10 * k, 10) for k in range(3)), episodes=1,
    )  # fmt: skip
    store = ResultStore(tmp_path / "records.jsonl")
    (record,) = evaluate(protocol, [apart.submission_entrant(cheat(*lair, f"return {code}"), SANDBOX)], store=store)
    assert record["metrics"]["failed"] == 1.0 and record["sandbox"] == choose(SANDBOX).name


def test_the_seeds_of_a_running_episode_are_not_in_its_memory(lair):
    protocol = Protocol(
        "short", "Short", (Task(HOLE, {"duration": 0.05}),), (Track("nominal"),),
        *(SeedRange(10 * k, 10) for k in range(3)), episodes=1, seal="ab" * 32, secret="cd" * 32,
    )  # fmt: skip
    code = NOT_THERE["seeds or paths in its memory"] + "\n    assert not found, found"
    path = cheat(*lair, code, seeds=protocol.seeds(1))
    assert len(evaluate(protocol, [apart.submission_entrant(path, SANDBOX)])) == 1
    path = cheat(*lair, code, seeds=("model-free",))  # what is there is found by this search
    with pytest.raises(ConfigurationError, match=r"AssertionError: \['model-free'"):
        evaluate(protocol, [apart.submission_entrant(path, SANDBOX)])


PATCH = """import cablebench.run.records as records, cablebench.protocol.metrics as metrics
    import cable_envs.envs as envs
    records.measure = metrics.measure = lambda episode: {"rmse": 0.0, "failed": 0.0}
    envs.CableEnv.step = lambda self, action: (None, 1.0, False, True, {})"""


def test_patching_modules_changes_nothing(lair):
    protocol = Protocol(
        "short", "Short", (Task(HOLE, {"duration": 0.2}),), (Track("nominal"),),
        *(SeedRange(10 * k, 10) for k in range(3)), episodes=1,
    )  # fmt: skip
    rows = [
        evaluate(protocol, [apart.submission_entrant(cheat(*lair, code), SANDBOX)])[0]["metrics"]
        for code in ("pass", PATCH)
    ]
    honest, cheated = ({k: v for k, v in row.items() if k != "inference_us"} for row in rows)
    assert honest == cheated and honest["rmse"] > 1e-4


AHEAD = """
import numpy as np
name = "ahead"
information = "model-free"
observe = "output"
tasks = ["CableHole-Position-Sine"]
SEEDS = {seeds}
known = None

def reset():
    global known
    known = None

def act(t, y, ref):
    # the first noisy measurements tell the episode, as its seed is public: simulate it beside and look
    global known
    if known is None:
        import gymnasium as gym, cable_envs
        env = gym.make("{hole}", observe="output", sensor_noise=True, duration=0.2)
        names = [c.name for c in env.unwrapped.setup.channels]
        scales = np.array([c.scale for c in env.unwrapped.setup.channels])
        known = 0.0
        for seed in SEEDS:
            seen = dict(zip(names, (env.reset(seed=seed)[0] * scales).tolist()))
            if all(abs(seen[k] - y[k]) < 1e-9 for k in y):
                known = 60.0  # this is the episode: from here on all of it is known
    return known
"""


@pytest.mark.parametrize("sealed", [False, True])
def test_simulating_ahead_works_with_public_seeds_and_never_with_sealed_ones(tmp_path, sealed):
    protocol = Protocol(
        "short", "Short", (Task(HOLE, {"duration": 0.2}),), (Track("nominal", {"sensor_noise": True}),),
        *(SeedRange(10 * k, 10) for k in range(3)), episodes=1,
        **({"seal": "ab" * 32, "secret": "cd" * 32} if sealed else {}),
    )  # fmt: skip
    path = tmp_path / "ahead.py"
    path.write_text(AHEAD.format(seeds="range(20, 30)", hole=HOLE))
    from cablebench.run.evaluation import run_episode

    entrant, commands = apart.submission_entrant(path, SANDBOX), []
    import gymnasium as gym

    env = gym.make(HOLE, observe="output", sensor_noise=True, duration=0.2)
    for seed in protocol.seeds(1):
        episode = run_episode(env, entrant.make(env.unwrapped.setup), seed)
        commands.append(float(np.max(episode.command)))
    assert commands == ([0.0] if sealed else [60.0])  # unsealed, a file can know its episode: the docs say so


def test_a_process_that_ended_is_not_waited_for_though_others_hold_its_pipe(lair, monkeypatch):
    """Where there is no filter of calls, a fork may hold the pipe: the answer is not waited for then."""
    body = "os.fork() and os._exit(3)\n    time.sleep(3)"
    kind = apart.controller_kind(cheat(*lair, body), "none")
    controller = kind.made_for(setup_of(HOLE, {}))
    with pytest.raises(ConfigurationError, match="exit code 3"):
        controller.act(0.0, {}, (0.0, 0.0, 0.0))
    assert not kind._process.alive


@pytest.mark.parametrize("sandbox", ["limits", "none"])
def test_it_works_where_the_platform_has_no_walls_and_says_so(lair, sandbox):
    from cablebench.entrants.sandbox.kinds import statement_of

    entrant = apart.submission_entrant(cheat(*lair, "pass"), sandbox)
    assert entrant.sandbox == sandbox and "no sandbox" in statement_of(sandbox)
    assert entrant.make(setup_of(HOLE, {})).controller.act(0.0, {}, (0.0, 0.0, 0.0)) == 1.0


def test_limits_alone_hold_memory_and_files(lair):
    code = {
        "bytearray(8 * 2**30)": "MemoryError",
        "os.write(os.open('x', os.O_WRONLY | os.O_CREAT), b'x')": "OSError",
    }
    for body, error in code.items():
        controller = apart.controller_kind(cheat(*lair, body), "limits").made_for(setup_of(HOLE, {}))
        with pytest.raises(ConfigurationError, match=error):
            controller.act(0.0, {}, (0.0, 0.0, 0.0))


def test_an_unknown_sandbox_names_the_nearest():
    with pytest.raises(ConfigurationError, match="did you mean 'landlock'"):
        choose("landlok")
