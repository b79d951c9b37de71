"""A process of its own that counts what numba compiles in it."""

import os
import subprocess
import sys
import textwrap
from pathlib import Path

from tests.support.tree import ROOT

COUNTED = """
import sys
import numba.core.event as event

class Count(event.Listener):
    compiled = 0
    def on_start(self, event): Count.compiled += 1
    def on_end(self, event): pass

event.register("numba:compile", Count())
"""


def run(code: str, folder: Path, *arguments: str | Path, **variables: str) -> str:
    """What code prints that keeps its kernels in a folder; ``Count.compiled`` is there for it."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(folder), "PYTHONPATH": str(ROOT), **variables}
    done = subprocess.run(
        [sys.executable, "-c", COUNTED + textwrap.dedent(code), *map(str, arguments)],
        capture_output=True, text=True, env=environment, timeout=300,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout
