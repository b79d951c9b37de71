"""Entrants that can travel: how one was named on the command line, with the content of the files it was named by."""

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from cable_envs.agents.files import POLICY
from cable_envs.core.config import read_yaml
from cable_envs.core.errors import ConfigurationError
from cablebench.cli.shared.arguments import parse_gains


@dataclass(frozen=True)
class NamedEntrant:
    """Called, it makes the entrant that ``--controller`` or ``--policy`` NAME means (`cablebench.run.jobs.Recipe`).

    Where the files it was named by are not there, or are others, as on another machine, they are put into a temporary
    folder first; what a .py file imports beside itself is not among them.
    """

    kind: str
    """controller | policy"""
    name: str
    gains: tuple[tuple[str, float], ...] = ()
    files: tuple[tuple[str, bytes], ...] = ()
    """(path, content)"""
    maker: str = ""
    """as of `cablebench.entrants.entrant.Entrant`"""
    sandbox: str = "auto"
    """what stands around a .py file"""

    def __call__(self) -> Any:
        return replace(self._found(), maker=self.maker)

    def _found(self) -> Any:
        if all(_holds(Path(path), content) for path, content in self.files):
            return self._make(self.name)
        base = Path(self.files[0][0]).parent
        with tempfile.TemporaryDirectory(prefix="cablebench-") as folder:
            for path, content in self.files:
                (Path(folder) / Path(path).relative_to(base)).write_bytes(content)
            return self._make(str(Path(folder) / Path(self.files[0][0]).name))

    def _make(self, name: str) -> Any:
        if self.kind == "policy":
            from cablebench.cli.shared.policies import policy_entrant

            return policy_entrant(name)
        from cablebench.entrants.named import named_entrant

        return named_entrant(name, dict(self.gains), self.sandbox)


def named(kind: str, name: str, gains: Mapping[str, float] | None = None, sandbox: str = "auto") -> NamedEntrant:
    """The recipe for a name, with its files where it names any."""
    files = tuple((str(p), p.read_bytes()) for p in _files(name))
    return NamedEntrant(kind, name, tuple((gains or {}).items()), files, sandbox=sandbox)


def entrant_recipes(
    controllers: Sequence[str], gains: Sequence[str], policies: Sequence[str], sandbox: str = "auto"
) -> tuple[NamedEntrant, ...]:
    """The recipes of what the flags name: of all reference controllers when they name none.

    Raises ConfigurationError where gains are given without exactly one controller.
    """
    from cable_envs.baselines import CONTROLLERS

    names = list(controllers) or ([] if policies else list(CONTROLLERS))
    if gains and len(controllers) != 1:
        raise ConfigurationError("--gain needs exactly one --controller")
    chosen = parse_gains(gains)
    return (*(named("controller", n, chosen, sandbox) for n in names), *(named("policy", p) for p in policies))


def _files(name: str) -> list[Path]:
    """The file that ``name`` is a path of, and the one that it refers to where it is a YAML file."""
    path = Path(name)
    if path.is_dir():
        path = path / POLICY
    if not path.is_file():
        return []  # a name, or a mistake that making the entrant will tell
    found = [path]
    if path.suffix in (".yaml", ".yml"):
        data = read_yaml(path)
        for key in ("controller", "policy"):
            beside = path.parent / str(data.get(key) or "")
            if beside.is_file() and beside != path:
                found.append(beside)
    return found


def _holds(path: Path, content: bytes) -> bool:
    return path.is_file() and path.read_bytes() == content
