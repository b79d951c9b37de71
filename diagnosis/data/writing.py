"""How a recording's folder is written: tables, the YAML file, its rig; complete, or the folder is as it was."""

import contextlib
import json
import os
import shutil
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from cable_envs.core.errors import ConfigurationError, nearest
from cable_envs.core.files import CannotWrite, flush_folder, held
from cable_envs.plants import family
from cable_envs.sim.rigs import SCHEMA as RIG_SCHEMA
from cable_envs.sim.rigs import Rig, load_rig

SCHEMA = "cable-recording/1"
FILE = "recording.yaml"
RIG_FILE = "rig/rig.yaml"
TABLES = ("csv", "parquet")
STAGE, MOVING = ".writing-", ".moving"
"""Folder that a recording is written to before it takes its place, and the list in it of what is being moved."""


@contextlib.contextmanager
def staging(out: Path) -> Iterator[Path]:
    """A folder within ``out``, made where it is missing, whose files `move` puts into place; it is gone afterwards.

    Raises ConfigurationError where nothing can be written.
    """
    made = [p for p in (out, *out.parents) if not p.exists()]
    try:
        out.mkdir(parents=True, exist_ok=True)
        stage = Path(tempfile.mkdtemp(prefix=STAGE, dir=out))
    except OSError as error:
        raise CannotWrite(f"cannot write to {out}: {error.strerror or error}") from error
    try:
        with held(stage):
            yield stage
    except CannotWrite:
        raise
    except OSError as error:
        raise CannotWrite(f"cannot write to {out}: {error.strerror or error}") from error
    finally:
        shutil.rmtree(stage, ignore_errors=True)
        for folder in made:  # only those that are still empty: after a failure
            with contextlib.suppress(OSError):
                folder.rmdir()


def move(stage: Path, out: Path) -> None:
    """All that stands in ``stage`` to ``out``, the YAML file last; where that fails, nothing of it stays.

    What is about to be moved is written down first, so that `undo` takes it back where the process is killed.
    """
    files = sorted(stage.iterdir(), key=lambda p: p.name == FILE)
    (stage / MOVING).write_text(json.dumps([file.name for file in files if file.name != FILE]), encoding="utf-8")
    moved: list[Path] = []
    try:
        for file in files:
            os.replace(file, out / file.name)
            moved.append(out / file.name)
    except BaseException:
        for path in moved:
            _remove(path)
        raise
    flush_folder(out)


def undo(out: Path) -> None:
    """Take back what a killed process had begun to write to ``out``; what it had finished stays."""
    for stage in out.glob(f"{STAGE}*") if out.is_dir() else ():
        with held(stage) as abandoned:
            if not abandoned:
                continue
            with contextlib.suppress(OSError, ValueError):  # no list, or not all of it: nothing was moved yet
                begun = json.loads((stage / MOVING).read_text(encoding="utf-8"))
                for name in begun if (stage / FILE).exists() else ():
                    if not (stage / name).exists():
                        _remove(out / name)
            shutil.rmtree(stage, ignore_errors=True)


def _remove(path: Path) -> None:
    if path.is_dir():
        shutil.rmtree(path, ignore_errors=True)
    else:
        path.unlink(missing_ok=True)


class Table:
    """A CSV or Parquet file that grows by chunks. CSV: the shortest decimals that read back as the same number."""

    def __init__(self, path: Path, headers: Mapping[str, str]) -> None:
        self.path, self._headers, self.rows = path, headers, 0
        self._parquet = path.suffix == ".parquet"

    def __enter__(self) -> "Table":
        if self._parquet:
            try:
                import pyarrow
                import pyarrow.parquet as parquet
            except ModuleNotFoundError as error:
                raise ConfigurationError("Parquet needs pyarrow: pip install 'cable-envs[parquet]'") from error
            self._arrow = pyarrow
            schema = pyarrow.schema([(header, pyarrow.float64()) for header in self._headers.values()])
            self._file = parquet.ParquetWriter(self.path, schema)
        else:
            self._file = self.path.open("w", encoding="utf-8", newline="")
            self._file.write(",".join(map(_quoted, self._headers.values())) + "\n")
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def write(self, columns: Mapping[str, np.ndarray]) -> None:
        """Append rows; NaN becomes an empty cell."""
        rows = len(columns["time"])
        if not rows:
            return
        if self._parquet:
            self._file.write_table(self._arrow.table({h: columns[n] for n, h in self._headers.items()}))
        else:
            cells = [_texts(columns[name]) for name in self._headers]
            self._file.write("\n".join(map(",".join, zip(*cells))) + "\n")
        self.rows += rows


def _quoted(name: str) -> str:
    return '"' + name.replace('"', '""') + '"' if any(c in name for c in ',"\n') else name


def _texts(values: np.ndarray) -> list[str]:
    if np.isfinite(values).all() and (values == np.rint(values)).all() and np.abs(values).max() < 2**53:
        return list(map(str, values.astype(np.int64).tolist()))
    return [repr(v) if v == v else "" for v in values.tolist()]


def yaml_text(content: Mapping[str, Any]) -> str:
    """Blocks at the top, one line for each channel and record where it fits."""
    return yaml.safe_dump(dict(content), sort_keys=False, default_flow_style=None, width=120, allow_unicode=True)


def check_table(table: str) -> str:
    """``table`` if it is a known kind. Raises ConfigurationError."""
    if table not in TABLES:
        raise ConfigurationError(f"--table: unknown format '{table}'; {nearest(table, TABLES)}")
    return table


def rig_entry(rig: Rig) -> tuple[str, str | None]:
    """(entry for "rig", content of the rig's file): a preset's name where nothing was changed, else `RIG_FILE`.

    Raises ConfigurationError for a rig with effects of the user's own, which a file cannot hold.
    """
    if rig.own:
        named = ", ".join(effect.name for effect in rig.own)
        raise ConfigurationError(f"rig '{rig.name}' has effects of your own ({named}), which no rig file can hold")
    try:
        preset = load_rig(rig.name)
    except ConfigurationError:
        preset = None
    told = ("plant", "variant", "holes", "contacts", "drive", "values", "effects")
    if preset is not None and all(getattr(preset, key) == getattr(rig, key) for key in told):
        return rig.name, None
    parameters = {}
    for p in rig.simulated_by().parameters:
        parameters[p.name] = {"value": float(rig.values[p.name]), "unit": p.unit}
        if preset is not None and p.name in rig.sources and preset.values.get(p.name) == rig.values[p.name]:
            parameters[p.name]["source"] = rig.sources[p.name]
    content: dict[str, Any] = {"schema": RIG_SCHEMA, "name": rig.name, "plant": rig.plant, "parameters": parameters}
    if family(rig.plant).series:
        content["holes"] = rig.holes
    usual = {"variant": "", "contacts": 0, "drive": "ideal"}
    content |= {key: getattr(rig, key) for key, none in usual.items() if getattr(rig, key) != none}
    if rig.effects:
        content["effects"] = {name: float(value) for name, value in rig.effects.items()}
    return RIG_FILE, yaml.safe_dump(content, sort_keys=False, default_flow_style=None, width=120)


def write_folder(
    folder: Path, content: Mapping[str, Any], tables: Mapping[str, Mapping[str, np.ndarray]], rig: str | None
) -> Path:
    """A recording's YAML file, its tables (file -> column -> numbers [rows]) and its rig's file, into a folder.

    Raises ConfigurationError where the folder holds a YAML file or one of the tables; then nothing is written.
    """
    if folder.exists() and not folder.is_dir():
        raise ConfigurationError(f"{folder} is a file; name a folder")
    undo(folder)
    taken = [*tables, *([Path(RIG_FILE).parts[0]] if rig is not None else [])]
    found = sorted(p.name for p in folder.iterdir() if _in_the_way(p, taken)) if folder.is_dir() else []
    if found:
        raise ConfigurationError(f"{folder} holds {found[0]}: choose another folder, nothing is overwritten")
    with staging(folder) as stage:
        for name, columns in tables.items():
            with Table(stage / name, {column: column for column in columns}) as table:
                table.write(columns)
        if rig is not None:
            (stage / RIG_FILE).parent.mkdir()
            (stage / RIG_FILE).write_text(rig, encoding="utf-8")
        (stage / FILE).write_text(yaml_text(content), encoding="utf-8")
        move(stage, folder)
    return folder / FILE


def table_name(record: str, table: str) -> str:
    """Name of a record's file: without folders, and with the ending of its table."""
    stem, dot, ending = record.replace("\\", "/").replace("/", "_").rpartition(".")
    kept = stem if dot and ending.lower() in ("csv", "tsv", "txt", "parquet", "pq") else stem + dot + ending
    return f"{kept}.{table}"


def _in_the_way(path: Path, names: Sequence[str]) -> bool:
    return path.suffix in (".yaml", ".yml") or path.name in names
