"""``--seal``: the secret of a sealed exam on the command line (`cablebench.protocol.seal`)."""

from pathlib import Path
from typing import Annotated, Any

import typer

Seal = Annotated[Path | None, typer.Option(help="Secret of a sealed exam: the file that `cablebench seal` wrote.")]


def unsealed(protocol: Any, file: Path | None) -> Any:
    """The protocol with the secret in ``file``, where one is given. Raises ConfigurationError where it is another's."""
    from cablebench.protocol.seal import opened

    return protocol if file is None else opened(protocol, file)
