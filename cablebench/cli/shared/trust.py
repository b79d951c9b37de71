"""How the command line asks before a Python file of somebody's is executed (`cablebench.entrants.trust`)."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer

from cable_envs.core.files import guarded
from cablebench.cli.shared.output import console

_policies: list["_Policy"] = []


class _Policy:
    """The policy of one command; what it needs is imported when the first file comes (``--help`` stays quick)."""

    agreed = False
    _trust: Any = None

    def __call__(self, path: Path, content: bytes) -> None:
        from cablebench.entrants.trust import Trust

        if self._trust is None:
            self._trust = Trust(_question if sys.stdin is not None and sys.stdin.isatty() else None)
        self._trust.agreed = self.agreed
        self._trust(path, content)


@contextmanager
def asking() -> Iterator[None]:
    """Within the block nothing of a stranger's is executed unasked: on the terminal, or else only after ``--trust``."""
    policy = _Policy()
    _policies.append(policy)
    try:
        with guarded(policy):
            yield
    finally:
        _policies.remove(policy)


def _question(text: str) -> bool:
    console(stderr=True).print(f"{text}: unless a sandbox holds it, it can do whatever you can.", markup=False)
    return typer.confirm("Have you read it, and shall it run?", err=True)


def _agree(agreed: bool) -> bool:
    for policy in _policies:
        policy.agreed = policy.agreed or agreed
    return agreed


Trusted = Annotated[
    bool,
    typer.Option(
        "--trust", "--yes", callback=_agree, help="Execute the Python files named here without asking, and remember it."
    ),
]
"""``--trust`` of every command that may execute a file."""

Walls = Annotated[
    str, typer.Option("--sandbox", help="Sandbox of a .py file: auto, bwrap, landlock, seccomp, limits, none.")
]
"""``--sandbox`` of every command that evaluates controllers' files."""


def say_sandboxes(entrants: Any) -> None:
    """Say on standard error what stands around the entrants that are files, once for each of their sandboxes."""
    from cablebench.entrants.sandbox.kinds import statement_of

    for name in dict.fromkeys(entrant.sandbox for entrant in entrants if entrant.sandbox):
        who = ", ".join(dict.fromkeys(entrant.name for entrant in entrants if entrant.sandbox == name))
        console(stderr=True).print(f"{who} {statement_of(name)}", markup=False)
        for entrant in entrants:
            if entrant.sandbox == name and entrant.information == "oracle":
                console(stderr=True).print(f"{entrant.name} is of class oracle: it is told the true rig", markup=False)
