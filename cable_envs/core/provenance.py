"""Where numbers come from: package versions, a hash of the source that decides them, the machine."""

import hashlib
import os
import platform
from collections.abc import Sequence
from functools import cache
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path, PurePath

from cable_envs.core.config import config_root
from cable_envs.core.errors import ConfigurationError

SIMULATION = ("cable_envs", "cable_envs.baselines")
"""Packages whose source decides the numbers of an episode."""

WITHIN = ("agents", "baselines", "diagnosis", "examples", "identification", "proof", "reproduction")
"""What is installed within `cable_envs` and is not the simulator."""


@cache
def versions() -> dict[str, str]:
    """Versions of what decides the numbers of an episode.

    Returns
    -------
    dict of str
        By name: this distribution ("cable-envs"), `source` (see `source_hash`), python, numpy, numba and gymnasium.
    """
    import cable_envs

    found = {"cable-envs": cable_envs.__version__, "source": source_hash(), "python": platform.python_version()}
    for name in ("numpy", "numba", "gymnasium"):
        found[name] = metadata.version(name)
    return found


def source_hash(packages: Sequence[str] = SIMULATION, configs: Sequence[str] = ("rigs", "tasks")) -> str:
    """Hash of source and configuration: records with the same one were made by the same code, wherever it is installed.

    Parameters
    ----------
    packages : sequence of str
        Packages by import name, whose `sources` are hashed; what only draws is left out.
    configs : sequence of str
        Folders of configs/, whose YAML files are hashed.

    Returns
    -------
    str
        Twelve hex digits of the SHA-256 over names and contents.

    Raises
    ------
    ConfigurationError
        Where a package is not installed.
    """
    digest = hashlib.sha256()
    for package in packages:
        name = package.rpartition(".")[2]
        for path, content in sources(package).items():
            if not _drawn(path):
                digest.update(f"{name}/{path.as_posix()}".encode() + content)
    for kind in configs:
        for path in sorted((config_root() / kind).glob("*.yaml")):
            digest.update(f"{kind}/{path.name}".encode() + path.read_bytes())
    return digest.hexdigest()[:12]


def sources(package: str) -> dict[PurePath, bytes]:
    """The text of a package's Python files, in a checkout the same as when installed.

    Parameters
    ----------
    package : str
        Import name. Of "cable_envs" the packages `WITHIN` it are left out.

    Returns
    -------
    dict of PurePath to bytes
        By path within the package, in order.

    Raises
    ------
    ConfigurationError
        Where the package is not installed.
    """
    try:
        spec = find_spec(package)
    except ModuleNotFoundError:
        spec = None
    if spec is None or spec.origin is None:
        raise ConfigurationError(f"there is no package '{package}' to hash")
    root = Path(spec.origin).parent.resolve()
    found = ((path.relative_to(root), path) for path in root.rglob("*.py"))
    ours = sorted((short, path) for short, path in found if package != "cable_envs" or short.parts[0] not in WITHIN)
    return {short: path.read_bytes() for short, path in ours}


def _drawn(path: PurePath) -> bool:
    """Whether a source only draws: no number depends on it."""
    return path.name in ("render.py", "scene.py") or path.parts[0] == "drawing"


@cache
def machine() -> str:
    """The kind of machine in words: processor, cores, system. Inference times depend on it, scores do not."""
    model = platform.processor() or platform.machine()
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        model = next((line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), model)
    except OSError:
        pass
    return f"{model}, {os.cpu_count()} cores, {platform.system()}"
