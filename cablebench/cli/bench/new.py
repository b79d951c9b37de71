"""``cablebench new``: a commented file or folder to begin with, which works as it is."""

from pathlib import Path
from typing import Annotated

import typer

from cable_envs.core.errors import ConfigurationError
from cablebench.cli.shared.output import console


def new(
    kind: Annotated[str, typer.Argument(metavar="KIND", help="controller, effect, plant or recording.")],
    name: Annotated[str, typer.Argument(help="Its name: letters, digits, - and _.")],
    out: Annotated[Path, typer.Option(help="Folder to write to; of a plant the checkout it is for.")] = Path(),
) -> None:
    """Write a commented controller, effect, plant or recording to begin with: it works as it is."""
    from cable_envs.core.files import write_atomic
    from cablebench.skeletons import skeleton

    files, next_steps = skeleton(kind, name, out)
    taken = [out / path for path in files if (out / path).exists()]
    if taken:
        raise ConfigurationError(f"{taken[0]} is there already: choose another name, or another folder with --out")
    said = console()
    for path, text in files.items():
        try:
            write_atomic(out / path, text)
        except OSError as error:
            raise ConfigurationError(f"cannot write {out / path}: {error.strerror or error}") from error
        said.print(f"wrote {out / path}", markup=False)
    said.print("next:")
    for line in next_steps:
        said.print(f"  {line}", markup=False)
