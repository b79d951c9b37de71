"""Data sets as their authors publish them, turned into recordings: one module for each format.

A format is a module with

    SUMMARY: str                                      one line for the help text
    open_dataset(path: Path, asked: Request) -> DataSet

(`base` has the classes, `sets.emps` is the shortest example). Every file in ``sets`` and ``formats`` is one, and so is
a file of a user's own that is given to `cablebench import`.
"""

import importlib
from pathlib import Path
from pkgutil import iter_modules
from types import ModuleType

from cable_envs.core.errors import ConfigurationError, nearest
from cable_envs.core.files import run_python

FORMATS = {
    module.name.replace("_", "-"): f"{folder}.{module.name}"
    for folder in ("sets", "formats")
    for module in iter_modules([str(Path(__file__).parent / folder)])
}
"""Format -> module in this package: every file of ``sets`` (published data) and ``formats``, a hyphen for a bar."""


def reader(name: str) -> ModuleType:
    """The module of a format: one of `FORMATS`, or a user's ``.py`` file, which is executed.

    Raises ConfigurationError.
    """
    if name.endswith(".py"):
        module = _from_file(Path(name))
    elif name in FORMATS:
        module = importlib.import_module(f"{__name__}.{FORMATS[name]}")
    else:
        raise ConfigurationError(f"unknown format '{name}'; {nearest(name, FORMATS)}, or a .py file")
    if not callable(getattr(module, "open_dataset", None)):
        raise ConfigurationError(f"{name} has no function open_dataset(path, asked)")
    return module


def _from_file(path: Path) -> ModuleType:
    if not path.is_file():
        raise ConfigurationError(f"cannot read {path}: no such file")
    return run_python(path, f"cable_format_{path.stem}")
