"""``cablebench seal``: a protocol as a sealed exam, whose test episodes nobody can know before the deadline."""

import os
from pathlib import Path
from typing import Annotated

import typer
import yaml

from cable_envs.core.config import read_yaml
from cable_envs.core.errors import ConfigurationError
from cable_envs.core.files import write_atomic
from cablebench.cli.shared.output import console

SECRET, EXAM = "exam.secret", "exam.yaml"


def seal(
    out: Annotated[Path, typer.Option(help=f"Folder for {EXAM} (to publish now) and {SECRET} (after the deadline).")],
    protocol: Annotated[str, typer.Option(help="Protocol: a name in configs/protocols, or a YAML file.")] = "full",
    name: Annotated[str | None, typer.Option(help="Name of the exam; default: PROTOCOL-sealed.")] = None,
) -> None:
    """Draw a secret and write a protocol that is sealed with it.

    Publish the protocol: it holds the secret's SHA-256. Keep the secret until the deadline, then publish it, too.
    """
    from cablebench.protocol.files import parse_protocol, protocol_path
    from cablebench.protocol.seal import commitment, draw_secret

    data = read_yaml(protocol_path(protocol))
    if data.get("seal"):
        raise ConfigurationError(f"{protocol} is sealed already")
    secret = draw_secret()
    exam = {**data, "name": name or f"{data.get('name')}-sealed", "seal": commitment(secret)}
    text = yaml.safe_dump(exam, sort_keys=False, allow_unicode=True)
    parse_protocol(yaml.safe_load(text), EXAM)
    if (out / EXAM).exists():
        raise ConfigurationError(f"{out / EXAM} is there already: name another folder")
    try:
        out.mkdir(parents=True, exist_ok=True)
        with open(os.open(out / SECRET, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w", encoding="ascii") as file:
            file.write(f"{secret}\n")
        write_atomic(out / EXAM, text)
    except FileExistsError:
        raise ConfigurationError(f"{out / SECRET} is there already: name another folder") from None
    except OSError as error:
        raise ConfigurationError(f"cannot write to {out}: {error.strerror or error}") from error
    say = console()
    say.print(f"{out / EXAM}: publish it now; its seal is {exam['seal']}", markup=False)
    say.print(f"{out / SECRET}: keep it until the deadline, then publish it; sha256sum prints the seal", markup=False)
