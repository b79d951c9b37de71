"""One policy for all Python files of others that are executed: agreed to once, and asked for again if they change.

A file is known by the SHA-256 of its content, so another content of the same name is another file. What was agreed to
is kept for the user in ``$XDG_CONFIG_HOME/cable-envs/trusted.yaml`` (without that variable ``~/.config``). Files of the
project itself never ask; a program of the user's own that names a file (``gymnasium.make(..., effect_file=...)``) is
trusted as that program is (`cable_envs.core.files.guarded`).
"""

import hashlib
import os
import re
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

import yaml
from filelock import FileLock

from cable_envs.core.config import read_yaml
from cable_envs.core.errors import ConfigurationError
from cable_envs.core.files import write_atomic

SCHEMA = "cable-trusted/1"
SHOWN = 12
"""Digits of a SHA-256 that people are shown."""

_PACKAGE = Path(__file__).parents[1]
_SHIPPED = tuple((_PACKAGE.parent / name).resolve() for name in ("cablebench", "cable_envs", "cable_envs/baselines"))


class Trust:
    """What may be executed: asked as a gate of `cable_envs.core.files.guarded`.

    Parameters
    ----------
    question : callable, optional
        Puts a question to a person and says whether the answer was yes; None where nobody can be asked.
    """

    def __init__(self, question: Callable[[str], bool] | None = None):
        self.agreed = False
        """whether all files were agreed to beforehand (``--trust``)"""
        self._question = question
        self._known: set[str] = set()

    def __call__(self, path: Path, content: bytes) -> None:
        """Return where a file with that content may be executed.

        Raises ConfigurationError that names the file, its hash, and what to say.
        """
        digest = hashlib.sha256(content).hexdigest()
        if digest in self._known or is_shipped(path) or digest in remembered():
            return
        if not self.agreed:
            text = f"{path} will be executed (SHA-256 {digest[:SHOWN]})"
            if self._question is None:
                raise ConfigurationError(f"{text}: read it, then add --trust, which is remembered for this content")
            if not self._question(text):
                raise ConfigurationError(f"{path} (SHA-256 {digest[:SHOWN]}) was not run")
        self._known.add(digest)
        remember(digest, path)


def is_shipped(path: Path) -> bool:
    """Whether a file is the project's own."""
    place = path.resolve()
    return any(place.is_relative_to(folder) for folder in _SHIPPED)


def memory() -> Path:
    """The user's file of what was agreed to."""
    base = os.environ.get("XDG_CONFIG_HOME") or Path.home() / ".config"
    return Path(base) / "cable-envs" / "trusted.yaml"


def remembered() -> dict[str, dict[str, str]]:
    """What was agreed to: by SHA-256, name of the file and when.

    Raises ConfigurationError where the file of it is damaged.
    """
    path = memory()
    if not path.is_file():
        return {}
    data = read_yaml(path)
    files = data.get("files") or {}
    hashes = isinstance(files, dict) and all(re.fullmatch("[0-9a-f]{64}", str(key)) for key in files)
    if data.get("schema") != SCHEMA or not hashes:
        raise ConfigurationError(f"{path}: expected the files trusted (schema {SCHEMA}): repair or delete it")
    return files


def remember(digest: str, path: Path) -> None:
    """Keep for next time that a file was agreed to; where that cannot be written, it is asked again next time."""
    place = memory()
    try:
        place.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        with FileLock(place.with_name(place.name + ".lock"), timeout=10.0):
            about = {"file": str(path.resolve()), "when": datetime.now(UTC).isoformat(timespec="seconds")}
            data = {"schema": SCHEMA, "files": {**remembered(), digest: about}}
            write_atomic(place, yaml.safe_dump(data, sort_keys=False))
    except (OSError, TimeoutError):
        return
