"""Where the YAML files live: ``cable_envs/configs``, which in a checkout is a link to ``configs/`` at its top."""

import hashlib
import json
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


def config_path(kind: str, name: str) -> Path:
    """Path of a file of configs/.

    Parameters
    ----------
    kind : str
        Its folder, as "rigs".
    name : str
        Its name, with the ending.

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
        known = [p.name for p in folder.glob("*.yaml")] if folder.is_dir() else []
        raise ConfigurationError(f"no {kind} file '{name}'; {nearest(name, known)}")
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
        Where the file cannot be read, is not valid YAML, or holds no mapping.
    """
    import yaml  # only where a file is read: importing the package stays quick

    path = Path(path)
    try:
        data = yaml.safe_load(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigurationError(f"cannot read {path}: {error.strerror or error}") from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise ConfigurationError(f"{path} is not valid YAML: {error}") from error
    if not isinstance(data, dict):
        raise ConfigurationError(f"{path}: expected a mapping at the top level, found {type(data).__name__}")
    return data


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
