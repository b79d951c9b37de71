"""Taking a newcomer's files into a results folder, so that its row can be replayed from there.

``<results>/submissions/<hash>/`` gets a copy of the one file, or of the YAML file and the file it names; the hash is
over their names and contents.
"""

import shlex
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any

import yaml

from cable_envs.core.config import configuration_hash, read_yaml
from cable_envs.core.errors import ConfigurationError
from cable_envs.core.files import write_atomic
from cablebench.entrants import controller_files, onnx_policies, policy_files
from cablebench.entrants.submission import source_hash

FOLDER = "submissions"

HASH = 12
"""Digits of a `Submission.hash`, which is the maker of a row where no phrase was given; a phrase's key has more."""


@dataclass(frozen=True)
class Submission:
    """What was handed in: the files by name, which of them is named on the command line, and by which flag."""

    files: Mapping[str, bytes]
    main: str
    flag: str
    """"--controller" or "--policy" """
    executes: str = ""
    """the .py file that is executed by loading this; empty where nothing is"""

    def hash(self) -> str:
        """Twelve hex digits over names and contents."""
        return configuration_hash({"main": self.main, **{n: source_hash(c) for n, c in self.files.items()}})

    def keep(self, results: Path) -> Path:
        """Copy the files to their place in a results folder; the path of the main one."""
        folder = results / FOLDER / self.hash()
        for name, content in self.files.items():
            path = folder / name
            if not path.is_file() or path.read_bytes() != content:
                write_atomic(path, content)
        return folder / self.main


def read_submission(path: str | Path, name: str = "") -> Submission:
    """The submission in a .py file, a .zip (or the folder of a training), an .onnx, or a YAML file that names one.

    ``name`` replaces the name on the board. Nothing is executed. Raises ConfigurationError that says what can be handed
    in.
    """
    path = Path(path)
    if path.is_dir():
        path = path / "policy.zip"
    if not path.is_file():
        raise ConfigurationError(f"no file at {path}")
    if path.suffix in (".yaml", ".yml"):
        return _from_yaml(path, name)
    if path.suffix == ".py":
        found = Submission({path.name: path.read_bytes()}, path.name, "--controller", path.name)
        extra = {"schema": controller_files.SCHEMA, "name": name, "controller": path.name}
    elif path.suffix in (".zip", onnx_policies.SUFFIX):
        found = Submission({path.name: path.read_bytes()}, path.name, "--policy")
        extra = {"schema": policy_files.SCHEMA, "name": name, "policy": path.name}
    else:
        raise ConfigurationError(
            f"{path}: hand in a .py file with reset() and act(t, y, ref) or act_observation(obs), a policy .zip of "
            f"`cablebench train`, a network as {onnx_policies.SUFFIX}, or a "
            f"YAML file (schema {controller_files.SCHEMA} or {policy_files.SCHEMA})"
        )
    if not name:
        return found
    text = yaml.safe_dump(extra, sort_keys=False).encode()
    return Submission({**found.files, "submission.yaml": text}, "submission.yaml", found.flag, found.executes)


def _from_yaml(path: Path, name: str) -> Submission:
    data = read_yaml(path)
    kinds = {controller_files.SCHEMA: ("controller", "--controller"), policy_files.SCHEMA: ("policy", "--policy")}
    if data.get("schema") not in kinds:
        raise ConfigurationError(f"{path}: schema {data.get('schema')!r}; expected {' or '.join(map(repr, kinds))}")
    key, flag = kinds[data["schema"]]
    # what is wrong in the file is named before anything is copied
    (controller_files.load_controller_file if key == "controller" else policy_files.load_policy_file)(path)
    files, changes = {}, {"name": name} if name else {}
    named = str(data[key])
    executes = named.endswith(".py")
    if key == "policy" or executes:
        other = path.parent / named
        if not other.is_file():
            raise ConfigurationError(f"{path}: no file at {other}")
        files[other.name] = other.read_bytes()
        if named != other.name:
            changes[key] = other.name
    text = path.read_bytes()
    if changes:
        text = yaml.safe_dump({**data, **changes}, sort_keys=False).encode()
    return Submission({**files, path.name: text}, path.name, flag, Path(named).name if executes else "")


def check_name(
    entrant: Any,
    records: Sequence[Mapping[str, Any]],
    reserved: tuple[str, ...],
    own: Collection[Mapping[str, Any]] = (),
    folder: Path | None = None,
) -> None:
    """Refuse a name that is a reference's, or under which the records know somebody else.

    A name belongs to its maker (`Entrant.maker`). The same maker may hand in further training seeds of the same name,
    and, under another name, other settings. ``own`` are the records of the user's own results ``folder``: there the
    other maker is the same person with a file that has changed since.
    """
    if entrant.name in reserved:
        raise ConfigurationError(f"'{entrant.name}' is the name of a reference controller: choose another with --name")
    again = f"choose another name (--name {shlex.quote(_next_name(entrant.name, records))})"
    for r in own:
        if r["entrant"] == entrant.name and r.get("maker", "") != entrant.maker:
            why = (
                "its row was submitted with another --maker phrase, or with none"
                if len(entrant.maker) != HASH else
                "its row was submitted with --maker: say the same phrase"
                if len(r.get("maker", "")) > HASH else
                "this file differs from the one that its row was made with"
            )  # fmt: skip
            raise ConfigurationError(
                f"'{entrant.title}' is in {folder} already, and {why}; {again} or another --results folder"
            )
    for r in records:
        if r["entrant"] == entrant.name and r.get("maker", "") != entrant.maker:
            raise ConfigurationError(
                f"'{entrant.name}' is on the board already, by another maker: {again}, or say --maker with the phrase "
                "that it was submitted with"
            )
        same = (r["entrant"], r["training_seed"]) == (entrant.name, entrant.training_seed)
        if same and (r.get("settings") or {}) != dict(entrant.settings) and _enters(entrant, r["env_id"]):
            raise ConfigurationError(
                f"'{entrant.title}' is on the board already, with other settings: {again} or another --results folder"
            )


def check_training(entrant: Any, protocol: Any) -> None:
    """Refuse a policy that was trained from seeds that the protocol keeps for tuning or for testing."""
    for use, kept in (("tuning", protocol.tune), ("testing", protocol.test)):
        taken = [seed for seed in entrant.trained_on if seed in kept]
        if taken:
            raise ConfigurationError(
                f"'{entrant.title}' was trained on environments with the seeds {entrant.trained_on.start} to "
                f"{entrant.trained_on.stop - 1}; {protocol.name} keeps {kept.first} to {kept.first + kept.count - 1} "
                f"for {use}: train with a smaller --seed"
            )


def _next_name(name: str, records: Sequence[Mapping[str, Any]]) -> str:
    """The name with the first number behind it that no record has."""
    taken = {r["entrant"] for r in records}
    return next(f"{name}-{n}" for n in count(2) if f"{name}-{n}" not in taken)


def _enters(entrant: Any, env_id: str) -> bool:
    from cable_envs.sim.registered import setup_of

    return entrant.needs(env_id, setup_of(env_id, {})) is not None
