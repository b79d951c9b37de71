"""``cablebench new``: a commented file or folder to begin with, which works as it is."""

from contextlib import suppress
from pathlib import Path
from typing import Annotated

import typer

from cable_envs.core.errors import ConfigurationError
from cablebench.cli.shared.output import console


def new(
    kind: Annotated[
        str, typer.Argument(metavar="KIND", help="controller, effect, plant, recording, sample or examples.")
    ],
    name: Annotated[
        str | None, typer.Argument(help="Its name: letters, digits, - and _. Of examples that of their folder.")
    ] = None,
    out: Annotated[Path, typer.Option(help="Folder to write to; of a plant the checkout it is for.")] = Path(),
) -> None:
    """Write a commented controller, effect, plant or recording to begin with, a sample rig's logs, or the examples.

    All work as they are.
    """
    from cable_envs.core.files import write_atomic
    from cablebench.skeletons import EXAMPLES, skeleton

    if name is None and kind != EXAMPLES:
        raise ConfigurationError(f"give it a name: cablebench new {kind} NAME")
    name = name or EXAMPLES
    files, next_steps = skeleton(kind, name, out)
    taken = [out / path for path in files if (out / path).exists()]
    if taken:
        raise ConfigurationError(f"{taken[0]} is there already: choose another name, or another folder with --out")
    said = console()
    try:
        for path, text in files.items():
            write_atomic(out / path, text)
    except OSError as error:
        for written in files:  # all of it or nothing: none of them was there before
            with suppress(OSError):
                (out / written).unlink()
        raise ConfigurationError(f"cannot write {out / path}: {error.strerror or error}") from error
    for path in files:
        said.print(f"wrote {out / path}", markup=False)
    said.print("next:")
    for line in next_steps:
        said.print(f"  {line}", markup=False)
