"""Results folders: the boards that come with the package, and folders of users that are ranked against them."""

from pathlib import Path

import yaml

from cable_envs.core.config import config_root, read_yaml
from cable_envs.core.errors import ConfigurationError, require_known
from cable_envs.core.files import write_atomic
from cablebench.run.store import ResultStore

RECORDS = "records.jsonl"
"""The results store in a results folder."""

BOARDS = "boards"
"""Folder of the boards that are kept under version control: one folder for each, named like its protocol."""

MARK = "ranked-against.yaml"
"""In a results folder: which published board its rows are ranked against."""

SCHEMA = "cable-ranked-against/1"


def published(name: str) -> ResultStore | None:
    """The board that comes with the package: in a checkout ``boards/NAME``, in an installation its records only.

    Parameters
    ----------
    name : str
        Of the board, which is its protocol's.

    Returns
    -------
    ResultStore or None
        To be read, never written; None where no board of this name is published.
    """
    store = ResultStore(config_root().parent / BOARDS / name / RECORDS)
    return store if store.packed.is_file() or store.path.is_file() else None


def board_folder(name: str) -> Path:
    """``boards/NAME`` here, or that of the checkout the program runs from, where it has one."""
    here, root = Path(BOARDS) / name, config_root().parent
    checkout = root / BOARDS / name
    return checkout if (root / "pyproject.toml").is_file() and checkout.is_dir() and not here.is_dir() else here


def open_store(folder: Path, board: str | None = None) -> ResultStore:
    """The store of a results folder.

    Parameters
    ----------
    folder : Path
    board : str, optional
        Published board whose records are read along with the folder's own; default: the one that the folder was ranked
        against before (`rank_against`), if any.

    Returns
    -------
    ResultStore
        Whose `base` is the published board.

    Raises
    ------
    ConfigurationError
        Where the folder's mark cannot be used.
    """
    base = published(board or _marked(folder))
    path = folder / RECORDS
    if base is not None and base.path.resolve() == path.resolve():
        base = None
    return ResultStore(path, base)


def rank_against(folder: Path, name: str) -> None:
    """From now on a results folder is ranked against the published board of this name."""
    text = yaml.safe_dump({"schema": SCHEMA, "board": name}, sort_keys=False)
    write_atomic(folder / MARK, f"# boards made of this folder hold the rows of the published board too\n{text}")


def _marked(folder: Path) -> str:
    path = folder / MARK
    if not path.is_file():
        return ""
    data = read_yaml(path)
    require_known(f"key in {path}", data, ("schema", "board"))
    if data.get("schema") != SCHEMA or not isinstance(data.get("board"), str):
        raise ConfigurationError(f"{path}: expected schema '{SCHEMA}' and the name of a board; remove the file")
    return data["board"]
