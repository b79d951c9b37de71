"""What takes long to make is kept in build/site-cache, under a name that changes with every source it may depend on."""

import hashlib
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
FOLDER = ROOT / "build" / "site-cache"
SOURCES = ("cable_envs", "cablebench", "baselines", "configs", "diagnosis", "proof", "reproduction", "docs/site")
SUFFIXES = (".py", ".yaml", ".j2", ".css", ".js")


@cache
def _state() -> str:
    """Hash of all code and settings: a change of any of them makes everything again."""
    files = {p for folder in SOURCES for p in (ROOT / folder).rglob("*") if p.suffix in SUFFIXES}
    return _hash(sorted(files))


def _hash(files: Sequence[Path]) -> str:
    digest = hashlib.sha256()
    for path in files:
        digest.update(f"{path.relative_to(ROOT)}\n".encode() + path.read_bytes())
    return digest.hexdigest()[:16]


def kept(name: str, make: Callable[[], bytes], inputs: Sequence[Path] = ()) -> bytes:
    """A product, made only if it is not there yet.

    Parameters
    ----------
    name : str
        File name; what is kept has a hash before the suffix.
    make : callable
        Makes the content.
    inputs : sequence of Path
        Data files that it is made from, besides the sources.

    Returns
    -------
    bytes
        The content.
    """
    stem, _, suffix = name.rpartition(".")
    path = FOLDER / f"{stem}-{_state()[:8]}{_hash(inputs)[:8]}.{suffix}"
    if not path.is_file():
        FOLDER.mkdir(parents=True, exist_ok=True)
        for old in FOLDER.glob(f"{stem}-{'?' * 16}.{suffix}"):
            old.unlink()
        path.write_bytes(make())
    return path.read_bytes()
