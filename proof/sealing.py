"""Sealed keys: a manifest with salted hashes is written before the tool runs; keys that do not match are refused."""

import hashlib
import json
import secrets
from collections.abc import Mapping
from pathlib import Path
from types import ModuleType
from typing import Any

from cable_envs.core.errors import ConfigurationError

MANIFEST_SCHEMA = "cable-proof-manifest/1"


def canonical(key: Mapping[str, Any]) -> str:
    """The one text of a key that is hashed."""
    return json.dumps(key, sort_keys=True, separators=(",", ":"), allow_nan=False)


def seal(key: Mapping[str, Any], salt: str | None = None) -> tuple[str, str]:
    """Seal a key.

    Parameters
    ----------
    key : Mapping
        JSON types only.
    salt : str, optional
        By default drawn: it keeps the few possible keys from being tried out against the hash.

    Returns
    -------
    tuple of str
        (hash, content of the key's file).
    """
    salt = secrets.token_hex(16) if salt is None else salt
    text = canonical(key)
    digest = hashlib.sha256((salt + text).encode()).hexdigest()
    return digest, json.dumps({"salt": salt, "key": key}, indent=1, sort_keys=True, allow_nan=False) + "\n"


def state_of(*packages: ModuleType) -> str:
    """Hash of the sources of packages: what a proof is by. The same on every machine that has them."""
    total = hashlib.sha256()
    for package in packages:
        root = Path(package.__path__[0])
        for file in sorted(root.rglob("*.py")):
            total.update(f"{package.__name__}/{file.relative_to(root).as_posix()}".encode() + b"\0" + file.read_bytes())
    return total.hexdigest()[:12]


def opened(path: Path, digest: str) -> dict[str, Any]:
    """The key in a file.

    Raises
    ------
    ConfigurationError
        Where it is not the one that was sealed.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        found = seal(content["key"], content["salt"])[0]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ConfigurationError(f"{path} is no sealed key: {error}") from error
    if found != digest:
        raise ConfigurationError(
            f"{path} is not the key that was sealed: its hash is {found[:12]}..., the manifest's {digest[:12]}..."
        )
    return content["key"]
