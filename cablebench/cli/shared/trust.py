"""Asking before a stranger's Python file is executed."""

import sys

import typer

from cable_envs.core.errors import ConfigurationError
from cablebench.cli.shared.output import console


def ask(file: str, trust: bool) -> None:
    """Go on only where executing ``file`` was agreed to: by ``--trust``, or on the terminal.

    Raises ConfigurationError where it was not.
    """
    warning = f"{file} will be executed: it can read, change and send whatever your account can"
    if trust:
        return
    if not sys.stdin.isatty():
        raise ConfigurationError(f"{warning}. Read it, then add --trust")
    console(stderr=True).print(f"{warning}.", markup=False)
    if not typer.confirm("Have you read it, and shall it run?", err=True):
        raise ConfigurationError(f"{file} was not run")
