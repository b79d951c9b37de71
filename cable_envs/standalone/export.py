"""A rig written in one of the formats that other programs read."""

from collections.abc import Callable, Mapping
from pathlib import Path

from cable_envs.core.errors import ConfigurationError, nearest
from cable_envs.core.files import write_atomic
from cable_envs.standalone.c_files import c_files
from cable_envs.standalone.fmu import fmu
from cable_envs.standalone.law import Law
from cable_envs.standalone.mujoco_text import mjcf
from cable_envs.standalone.python_text import python_text

FORMATS: Mapping[str, tuple[str, Callable[[Law], str | bytes | Mapping[str, str]]]] = {
    "python": (".py", python_text), "c": (".c", c_files), "fmu": (".fmu", fmu), "mujoco": (".xml", mjcf),
}  # fmt: skip
"""Format -> ending of its file, and what makes its content: of one file, or of several by their names."""


def check_file(form: str, out: Path) -> None:
    """Refuse an unknown format, or a file with another ending than the format's.

    Parameters
    ----------
    form : str
        One of `FORMATS`.
    out : Path
        The file.

    Raises
    ------
    ConfigurationError
        With the nearest format, or the ending.
    """
    if form not in FORMATS:
        raise ConfigurationError(f"--format: unknown format '{form}'; {nearest(form, FORMATS)}")
    ending = FORMATS[form][0]
    if out.suffix != ending:
        raise ConfigurationError(
            f"--out: a file of the format {form} ends in '{ending}', not '{out.suffix}' ({out.name})"
        )


def export_law(law: Law, form: str, out: Path) -> list[Path]:
    """Write a rig.

    Parameters
    ----------
    law : Law
        The rig.
    form : str
        One of `FORMATS`.
    out : Path
        The file; the header of a C file goes beside it.

    Returns
    -------
    list of Path
        The files.

    Raises
    ------
    ConfigurationError
        For what `check_file` refuses, what the format cannot express, and files that cannot be written.
    """
    check_file(form, out)
    made = FORMATS[form][1](law)
    if isinstance(made, (str, bytes)):
        return [write_atomic(out, made)]
    return [write_atomic(out.with_name(f"{out.stem}{Path(name).suffix}"), text) for name, text in made.items()]
