"""The program ``cablebench``: starts the command line and turns every expected error into one line and exit code 2."""

import sys
from collections.abc import Sequence

from cable_envs.errors import ConfigurationError

USAGE_ERROR = 2
"""Exit code for input that cannot be used (also argparse's and typer's)."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Run ``cablebench``; ``arguments`` default to those of the process. Ends by SystemExit."""
    try:
        try:
            from cablebench.commands.app import app
        except ModuleNotFoundError as error:
            raise missing_extra(error, "bench") from error
        app(args=None if arguments is None else list(arguments), prog_name="cablebench")
    except ConfigurationError as error:
        print(f"cablebench: error: {error}", file=sys.stderr)
        raise SystemExit(USAGE_ERROR) from None


def missing_extra(error: ModuleNotFoundError, extra: str) -> ConfigurationError:
    """How to install what is missing, in one line; import errors of our own packages are raised again."""
    own = ("cable_envs", "cablebench", "baselines", "agents")
    if (error.name or "").split(".")[0] in own:
        raise error
    return ConfigurationError(f"this command needs {error.name}: pip install 'cable-envs[{extra}]'")


if __name__ == "__main__":
    main()
