"""What other systems than Linux lack must not be needed: run here with the modules of Windows' absence gone."""

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


def _as_windows(code: str, folder) -> subprocess.CompletedProcess:
    return subprocess.run(
        [sys.executable, "-c", LIKE_WINDOWS + code], capture_output=True, text=True, timeout=300, cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )  # fmt: skip


@pytest.mark.parametrize(
    "code",
    [
        "import cable_envs\n"
        "env = gymnasium.make('cable_envs/CableHole-Position-Sine-v0', duration=0.1)\n"
        "env.reset(seed=0); env.step(env.action_space.sample())",
        "from cablebench.cli import main\n"
        "main(['run', 'CableHole-Position-Sine', '--controller', 'pid', '-o', 'duration=0.1'])",
        "from cablebench.cli import main\n"
        "try: main(['new', 'recording', 'cart'])\nexcept SystemExit as end: assert not end.code\n"
        "main(['inspect', 'cart'])",
        "from cable_envs.diagnosis import diagnose\nimport cablebench.jobs.local, cablebench.tune.study",
        "from cablebench.cli import main\nmain(['submit', '--help'])",
    ],
    ids=["environment", "run", "inspect", "diagnosis and jobs", "submit"],
)
def test_nothing_needs_what_windows_lacks(code, tmp_path):
    done = _as_windows(code, tmp_path)
    assert done.returncode == 0, done.stderr


def test_a_strangers_file_is_refused_where_there_is_no_sandbox(monkeypatch):
    from cablebench.entrants.sandbox import kinds

    monkeypatch.setattr(kinds.os, "name", "nt")
    monkeypatch.setattr(kinds.sys, "platform", "win32")
    for kind in ("auto", "none"):
        with pytest.raises(ConfigurationError, match="win32 has no sandbox for it: use Linux or macOS"):
            kinds.choose(kind)
