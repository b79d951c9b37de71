"""Where numbers come from: package versions, a hash of the source that decides them, the machine."""

import hashlib
import os
import platform
from collections.abc import Sequence
from functools import cache
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path

from cable_envs.core.config import config_root
from cable_envs.core.errors import ConfigurationError

SIMULATION = ("cable_envs", "baselines")
"""Packages whose source decides the numbers of an episode."""


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
        Top-level packages, whose Python files are hashed; what only draws is left out.
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
        spec = find_spec(package)
        if spec is None or spec.origin is None:
            raise ConfigurationError(f"there is no package '{package}' to hash")
        root = Path(spec.origin).parent
        for path in sorted(p for p in root.rglob("*.py") if not _drawn(p.relative_to(root))):
            digest.update(f"{root.name}/{path.relative_to(root).as_posix()}".encode() + path.read_bytes())
    for kind in configs:
        for path in sorted((config_root() / kind).glob("*.yaml")):
            digest.update(f"{kind}/{path.name}".encode() + path.read_bytes())
    return digest.hexdigest()[:12]


def _drawn(path: Path) -> bool:
    """Whether a source only draws: no number depends on it."""
    return path.name in ("render.py", "scene.py") or path.parts[0] == "drawing"


@cache
def machine() -> str:
    """The kind of machine in words: processor, cores, system. Inference times depend on it, scores do not."""
    model = platform.processor() or platform.machine()
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        model = next((line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), model)
    except OSError:
        pass
    return f"{model}, {os.cpu_count()} cores, {platform.system()}"
