"""Which walls stand around the process of a stranger's file on this machine, and how the process is started.

| sandbox | what it adds |
|---|---|
| limits | memory, CPU time, files written (none), files open; on Linux no privileges; unless root, no further process |
| seccomp | the kernel refuses to start processes and threads, to open sockets, to signal or trace other processes, and to change or make files (Linux on x86-64) |
| landlock | only Python, its packages and this project can be read (Linux 5.13); TCP (Linux 6.7) and signals (6.12) stay within |
| bwrap | namespaces of its own: other files, processes and the network are not there (needs bubblewrap) |

Each has all that stand above it and that this machine has; "auto" takes the last that works, "none" has no walls.
"""  # noqa: E501

import json
import os
import shutil
import site
import subprocess
import sys
import sysconfig
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from cable_envs.core.config import config_root
from cable_envs.core.errors import ConfigurationError, require_known
from cablebench.entrants.sandbox import walls

SANDBOXES = ("auto", "bwrap", "landlock", "seccomp", "limits", "none")

LIMITS = {"AS": 4 * 2**30, "CPU": 86_400, "FSIZE": 0, "NOFILE": 128, "CORE": 0}
"""By the names of `resource`: bytes of address space, s of CPU in all (an answer and an episode have limits of their
own), bytes written to a file, open files, bytes of a core dump."""

_PACKAGES = ("cable_envs", "cablebench")
_SYSTEM = (
    "/lib", "/lib64", "/usr/lib", "/usr/lib64", "/usr/local/lib", "/etc/ld.so.cache", "/etc/localtime",
    "/usr/share/zoneinfo", "/dev/null", "/dev/zero", "/dev/urandom", "/proc/cpuinfo", "/sys/devices/system/cpu",
)  # fmt: skip
_ENVIRONMENT = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")
_BOOT = Path(__file__).with_name("boot.py")


@dataclass(frozen=True)
class Sandbox:
    """What stands around a process: the walls' names, as a record keeps them, and whether each is asked for."""

    kind: str
    walls: tuple[str, ...]

    @property
    def name(self) -> str:
        """As in a record: "landlock 7 + seccomp + limits"."""
        return " + ".join(self.walls) or "none"

    def _has(self, wall: str) -> bool:
        return any(w.startswith(wall) for w in self.walls)

    def command(self, descriptor: int, folder: str) -> list[str]:
        """The command that starts the process: ``folder`` is where it is, ``descriptor`` its connection."""
        readable = _readable()
        plan = {
            "path": _path(), "packages": _packages(), "read": readable, "limits": LIMITS if self.walls else {},
            "privileges": self._has("limits") and sys.platform == "linux", "files": self._has("landlock"),
            "calls": self._has("seccomp"), "last": {"NPROC": 0} if self._has("limits") else {},
        }  # fmt: skip
        python = [sys.executable, "-I", "-B", str(_BOOT), json.dumps(plan), str(descriptor)]
        return [*_bwrap(readable, folder), *python] if self.kind == "bwrap" else python


def statement_of(name: str) -> str:
    """What a sandbox of that name, as in a record, holds back and what not, in words that follow the file's name."""
    if name.startswith(("bwrap", "landlock")):
        left = "" if "seccomp" in name else "; what it may still do: start processes, and send by UDP"
        return f"runs apart in a sandbox ({name}){left}"
    if name.startswith("seccomp"):
        return f"runs apart ({name}): it can write and send nothing, but read what you can"
    return f"runs apart, but in no sandbox ({name}): it can read, change and send whatever you can"


def environment() -> dict[str, str]:
    """The environment of the process: nothing of this one's but what the machine's libraries are found by."""
    kept = {k: os.environ[k] for k in ("LD_LIBRARY_PATH", "DYLD_LIBRARY_PATH", "SYSTEMROOT") if k in os.environ}
    return {**kept, **_ENVIRONMENT, "HOME": "/nowhere", "LANG": "C.UTF-8", "PATH": "/usr/bin:/bin"}


def choose(kind: str = "auto") -> Sandbox:
    """The sandbox of that kind on this machine; "auto": the strongest there is.

    Raises ConfigurationError for an unknown kind, with the nearest, for one that this machine does not have, and on
    Windows for every kind.
    """
    require_known("sandbox", [kind], SANDBOXES)
    if os.name != "posix":
        raise ConfigurationError(
            f"a .py file runs in a process of its own, and {sys.platform} has no sandbox for it: use Linux or macOS "
            "(on Windows the Windows Subsystem for Linux), or a controller of the package"
        )
    there = _there()
    if kind == "auto":
        kind = next(name for name in SANDBOXES[1:] if name in there)
    if kind not in there:
        raise ConfigurationError(f"this machine has no sandbox '{kind}'; it has {', '.join(there)}")
    order = ("bwrap", "landlock", "seccomp", "limits")
    names = [there[name] for name in order[order.index(kind) :] if name in there] if kind in order else []
    return Sandbox(kind, tuple(names))


@cache
def _there() -> Mapping[str, str]:
    """The kinds that work here, strongest first, and what a record calls them."""
    found = {}
    if _bwrap_works():
        found["bwrap"] = "bwrap"
    if version := walls.landlock_version():
        found["landlock"] = f"landlock {version}"
    if walls.may_filter_calls():
        found["seccomp"] = "seccomp"
    return {**found, "limits": "limits", "none": "none"}


def _bwrap_works() -> bool:
    """Whether bubblewrap is installed and may make namespaces: in some containers it may not."""
    if shutil.which("bwrap") is None:
        return False
    with tempfile.TemporaryDirectory(prefix="cablebench-") as folder:
        command = [*_bwrap(_readable(), folder), sys.executable, "-I", "-c", "pass"]
        return subprocess.run(command, capture_output=True, timeout=60, check=False).returncode == 0


def _bwrap(readable: list[str], folder: str) -> list[str]:
    binds = [
        word for path in readable if not path.startswith(("/dev/", "/proc/")) for word in ("--ro-bind-try", path, path)
    ]
    return [
        str(shutil.which("bwrap")), "--unshare-all", "--die-with-parent", "--cap-drop", "ALL", "--dev", "/dev", *binds,
        "--dir", folder, "--remount-ro", "/", "--chdir", folder, "--",
    ]  # fmt: skip


def _path() -> list[str]:
    """Of the places that Python imports from, those of its installation: no folder that merely is the present one."""
    roots = _roots()
    return [p for p in sys.path if p and any(Path(p).is_relative_to(root) for root in roots)]


def _roots() -> list[str]:
    """Folders of the Python installation and of installed packages."""
    packages = [p for p in sys.path if Path(p).name in ("site-packages", "dist-packages")]
    schemes = [sysconfig.get_path(name) for name in ("stdlib", "platstdlib", "purelib", "platlib")]
    prefixes = {sys.prefix, sys.base_prefix, sys.exec_prefix} - {"/usr", "/", "/usr/local"}
    return sorted({*prefixes, *schemes, *packages, *(p for p in site.getsitepackages() if Path(p).is_dir())})


@cache
def _packages() -> dict[str, str]:
    """The project's packages by name, and their folders."""
    found = {}
    for name in _PACKAGES:
        spec = find_spec(name)
        if spec is not None and spec.submodule_search_locations:
            found[name] = str(Path(next(iter(spec.submodule_search_locations))))
    return found


@cache
def _readable() -> list[str]:
    """What the process may read, outer folders first: Python, packages, the project, the system's libraries."""
    ours = [Path(folder) for folder in _packages().values()]
    links = (path for folder in ours for path in folder.iterdir() if path.is_symlink())
    linked = [path.resolve() for path in links if (path / "__init__.py").is_file()]  # no folder of boards
    program = Path(sys.executable)
    places: list[Any] = [
        *_SYSTEM, *_roots(), program, program.resolve(), Path(sys.base_prefix) / "bin", *ours, *linked, config_root(),
    ]  # fmt: skip
    found: list[str] = []
    for place in sorted({str(p) for p in places if Path(p).exists()}, key=lambda p: (p.count("/"), p)):
        if not any(Path(place).is_relative_to(outer) for outer in found):
            found.append(place)
    return found
