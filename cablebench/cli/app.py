"""The typer application: one entry for each command."""

from typing import Annotated

import typer

from cablebench.cli.catalogue import COMMANDS

app = typer.Typer(
    name="cablebench",
    help="Simulate cable mechanisms, rank controllers and learning agents on them, and find what a simulator lacks.",
    epilog="`cablebench COMMAND --help` says what a command does and ends with an example.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)


def _version(asked: bool) -> None:
    if asked:
        import cable_envs

        typer.echo(f"cablebench {cable_envs.__version__}")
        raise typer.Exit


@app.callback()
def common(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version and exit.")
    ] = False,
) -> None:
    pass


for _command in COMMANDS:
    app.command(_command.name, rich_help_panel=_command.panel, epilog=f"Example:  {_command.example}")(
        _command.function
    )
    for _name in _command.former:
        app.command(_name, hidden=True, epilog=f"The name is now:  cablebench {_command.name}")(_command.function)
