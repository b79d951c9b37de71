"""Where the YAML files live: ``cable_envs/configs``, which in a checkout is a link to ``configs/`` at its top."""

import hashlib
import json
import math
import stat
from pathlib import Path
from typing import Any

from cable_envs.core.errors import ConfigurationError, nearest

_PACKAGE = Path(__file__).parents[1]


def config_root() -> Path:
    """The folder that holds rigs/, tasks/, agents/, protocols/ and controllers/."""
    folder = (_PACKAGE / "configs").resolve()
    if not folder.is_dir():
        raise ConfigurationError(
            f"there is no folder {folder}: in a checkout it is a symbolic link, which git makes after "
            "`git config core.symlinks true` and `git checkout -- cable_envs`"
        )
    return folder


def config_names(kind: str) -> tuple[str, ...]:
    """Names of the YAML files of a kind.

    Parameters
    ----------
    kind : str
        A folder of configs/, as "rigs".

    Returns
    -------
    tuple of str
        Without their ending, in alphabetical order; empty where there is no such folder.

    Examples
    --------
    >>> "gu-inferred" in config_names("rigs")
    True
    """
    return tuple(sorted(path.stem for path in (config_root() / kind).glob("*.yaml")))


def config_path(kind: str, name: str, called: str = "") -> Path:
    """Path of a file of configs/.

    Parameters
    ----------
    kind : str
        Its folder, as "rigs".
    name : str
        Its name, with the ending.
    called : str
        What the error calls such a file; default: the folder's name in the singular.

    Returns
    -------
    Path
        A file that is there.

    Raises
    ------
    ConfigurationError
        Where there is none, with the nearest one.

    Examples
    --------
    >>> config_path("rigs", "gu-inferred.yaml").name
    'gu-inferred.yaml'
    """
    folder = config_root() / kind
    path = folder / name
    if not path.is_file():
        stem = name.removesuffix(".yaml")
        raise ConfigurationError(
            f"unknown {called or kind.removesuffix('s')} '{stem}'; {nearest(stem, config_names(kind))}"
        )
    return path


def read_yaml(path: Path | str) -> dict[str, Any]:
    """The mapping in a YAML file.

    Parameters
    ----------
    path : str or Path
        The file, in UTF-8.

    Returns
    -------
    dict
        Its content.

    Raises
    ------
    ConfigurationError
        Where the file cannot be read, is no ordinary file, is not valid YAML, or holds no mapping, and where its
        aliases stand for more than `MOST_ENTRIES`.
    """
    import yaml  # only where a file is read: importing the package stays quick

    path = require_file(path, LARGEST_YAML)
    try:
        data = yaml.safe_load(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigurationError(f"cannot read {path}: {error.strerror or error}") from error
    except (yaml.YAMLError, ValueError, TypeError, OverflowError) as error:  # ValueError: a date that is none, no UTF-8
        raise ConfigurationError(f"{path} is not valid YAML: {' '.join(str(error).split())}") from error
    except RecursionError:
        raise ConfigurationError(f"{path} is not valid YAML: it is nested too deep") from None
    if not isinstance(data, dict):
        raise ConfigurationError(f"{path}: expected a mapping at the top level, found {type(data).__name__}")
    if _size(data, {}) > MOST_ENTRIES:
        raise ConfigurationError(f"{path}: its aliases (*name) or numbers stand for more than {MOST_ENTRIES} entries")
    return data


LARGEST_YAML, MOST_ENTRIES, LONGEST_NUMBER = 64 * 2**20, 10_000_000, 4096
"""Bytes of a YAML file; entries that it has with every alias written out; bits of a whole number. A few
lines of aliases that name each other stand for billions."""


def _size(value: Any, known: dict[int, float]) -> float:
    """How many entries a value has where every alias counts as what it names; infinite where one names itself."""
    if isinstance(value, int) and value.bit_length() > LONGEST_NUMBER:
        return math.inf  # Python itself refuses to print it
    if not isinstance(value, (dict, list, set, tuple)):
        return 1.0
    if id(value) not in known:
        known[id(value)] = math.inf
        parts = [*value, *value.values()] if isinstance(value, dict) else value
        known[id(value)] = 1.0 + sum(_size(part, known) for part in parts)
    return known[id(value)]


def require_file(path: Path | str, largest: float = math.inf) -> Path:
    """Check that a path is an ordinary file: to read a pipe or a device may never end.

    Parameters
    ----------
    path : str or Path
        What is to be read.
    largest : float
        Bytes that it may have.

    Returns
    -------
    Path
        The same.

    Raises
    ------
    ConfigurationError
        Where there is no file, it is something else, or it is too large.

    Examples
    --------
    >>> require_file("/dev/null")
    Traceback (most recent call last):
        ...
    cable_envs.core.errors.ConfigurationError: cannot read /dev/null: it is no ordinary file
    """
    path = Path(path)
    try:
        found = path.stat()
    except (OSError, ValueError) as error:  # ValueError: a zero byte in the name
        raise ConfigurationError(
            f"cannot read {str(path)[:300]!r}: {getattr(error, 'strerror', None) or error}"
        ) from None
    if stat.S_ISDIR(found.st_mode):
        raise ConfigurationError(f"cannot read {path}: it is a folder")
    if not stat.S_ISREG(found.st_mode):
        raise ConfigurationError(f"cannot read {path}: it is no ordinary file")
    if found.st_size > largest:
        raise ConfigurationError(f"cannot read {path}: it has {found.st_size} bytes, more than {largest:g}")
    return path


def configuration_hash(data: Any) -> str:
    """Hash of a configuration: the same for the same content, whatever the order of its keys.

    Parameters
    ----------
    data : Any
        Mappings, sequences, numbers and texts; what JSON does not know counts as its text.

    Returns
    -------
    str
        Twelve hex digits of the SHA-256 of the canonical JSON text.

    Examples
    --------
    >>> configuration_hash({"a": 1, "b": 2}) == configuration_hash({"b": 2, "a": 1})
    True
    """
    text = json.dumps(data, sort_keys=True, separators=(",", ":"), default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:12]
