"""What a record says about its origin: package versions, a hash of the source that decides numbers, the machine."""

import hashlib
import os
import platform
from functools import cache
from importlib import metadata
from pathlib import Path


@cache
def versions() -> dict[str, str]:
    """Versions of what decides the numbers, and `source`: a hash of simulator, controllers and their configuration."""
    import cable_envs

    found = {"cable-envs": cable_envs.__version__, "source": source_hash(), "python": platform.python_version()}
    for name in ("numpy", "numba", "gymnasium"):
        found[name] = metadata.version(name)
    return found


def source_hash() -> str:
    """Twelve hex digits of the SHA-256 over cable_envs/ and baselines/ (Python) and configs/rigs, configs/tasks (YAML).

    Two records with the same hash were made by the same code, whether it was installed or run from a checkout.
    """
    import baselines
    import cable_envs
    from cable_envs.core.config import config_root

    digest = hashlib.sha256()
    for package in (cable_envs, baselines):
        root = Path(package.__file__).parent
        for path in sorted(p for p in root.rglob("*.py") if not _drawn(p.relative_to(root))):
            digest.update(f"{root.name}/{path.relative_to(root).as_posix()}".encode() + path.read_bytes())
    for kind in ("rigs", "tasks"):
        for path in sorted((config_root() / kind).glob("*.yaml")):
            digest.update(f"{kind}/{path.name}".encode() + path.read_bytes())
    return digest.hexdigest()[:12]


def _drawn(path: Path) -> bool:
    """Whether a source only draws: no number depends on it."""
    return path.name in ("render.py", "scene.py") or path.parts[0] == "drawing"


@cache
def machine() -> str:
    """The kind of machine, in words; inference times depend on it, scores do not."""
    model = platform.processor() or platform.machine()
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        model = next((line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), model)
    except OSError:
        pass
    return f"{model}, {os.cpu_count()} cores, {platform.system()}"
