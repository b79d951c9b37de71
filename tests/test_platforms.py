"""What other systems than Linux lack must not be needed: run here with the modules of Windows' absence gone."""

import json
import os
import subprocess
import sys

import pytest

from cable_envs.core.errors import ConfigurationError
from tests.support.tree import ROOT

LIKE_WINDOWS = """
import os, signal, sys

import numba, numpy, scipy.signal, typer, rich.table, yaml, gymnasium  # libraries know their own system

class Absent:
    def find_spec(self, name, path=None, target=None):
        if name in ("fcntl", "resource", "termios", "pwd", "grp", "pty"):
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

for name in ("fcntl", "resource", "termios", "pwd", "grp", "pty"):
    sys.modules.pop(name, None)
sys.meta_path.insert(0, Absent())
for name in ("pthread_sigmask", "SIGKILL", "SIGALRM", "setitimer"):
    delattr(signal, name)
for name in ("fork", "setpgid", "killpg", "setsid", "sched_getaffinity", "geteuid", "getuid"):
    delattr(os, name)
"""


TRIED = {
    "environment": (
        "import cable_envs\n"
        "env = gymnasium.make('cable_envs/CableHole-Position-Sine-v0', duration=0.1)\n"
        "env.reset(seed=0); env.step(env.action_space.sample())"
    ),
    "run": (
        "from cablebench.cli import main\n"
        "main(['run', 'CableHole-Position-Sine', '--controller', 'pid', '-o', 'duration=0.1'])"
    ),
    "new recording": "from cablebench.cli import main\nmain(['new', 'recording', 'cart'])",
    "inspect": "from cablebench.cli import main\nmain(['inspect', 'cart'])",
    "diagnosis and jobs": (
        "from cable_envs.diagnosis import diagnose\nimport cablebench.jobs.local, cablebench.tune.study"
    ),
    "submit": "from cablebench.cli import main\nmain(['submit', '--help'])",
}
ONE_AFTER_THE_OTHER = """
import json, traceback

failed = {}
for name, code in json.loads(sys.argv[1]).items():
    try:
        exec(code)
    except SystemExit as end:
        if end.code:
            failed[name] = f"exit code {end.code}"
    except BaseException:
        failed[name] = traceback.format_exc()
print("FAILED", json.dumps(failed))
"""


@pytest.fixture(scope="module")
def failed(tmp_path_factory):
    """What failed of `TRIED`, all in one process in this order, by name."""
    done = subprocess.run(
        [sys.executable, "-c", LIKE_WINDOWS + ONE_AFTER_THE_OTHER, json.dumps(TRIED)], capture_output=True, text=True,
        timeout=600, cwd=tmp_path_factory.mktemp("windows"), env={**os.environ, "PYTHONPATH": str(ROOT)},
    )  # fmt: skip
    assert done.returncode == 0 and "FAILED " in done.stdout, done.stderr
    return json.loads(done.stdout.split("FAILED ")[-1])


@pytest.mark.parametrize("name", TRIED)
def test_nothing_needs_what_windows_lacks(failed, name):
    assert name not in failed, failed[name]


def test_a_strangers_file_is_refused_where_there_is_no_sandbox(monkeypatch):
    from cablebench.entrants.sandbox import kinds

    monkeypatch.setattr(kinds.os, "name", "nt")
    monkeypatch.setattr(kinds.sys, "platform", "win32")
    for kind in ("auto", "none"):
        with pytest.raises(ConfigurationError, match="win32 has no sandbox for it: use Linux or macOS"):
            kinds.choose(kind)
