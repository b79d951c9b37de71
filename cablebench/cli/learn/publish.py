"""``cablebench publish``: policies small enough to commit and to hand to others."""

from pathlib import Path
from typing import Annotated

import typer

from cable_envs.agents.files import policy_file
from cable_envs.core.errors import ConfigurationError
from cable_envs.core.files import require_writable
from cablebench.cli.shared.arguments import short_name
from cablebench.cli.shared.output import console


def publish(
    policies: Annotated[list[Path], typer.Argument(help="Finished trainings: their folders or policy.zip files.")],
    out: Annotated[Path, typer.Option(help="Folder for ALGO-ENV-SEED.zip.")],
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace files of that name.")] = False,
) -> None:
    """Copy trained policies without what only training needs. They act as before and run no code when loaded."""
    from cable_envs.agents.policy import read_policy
    from cable_envs.agents.publish import publish_policy

    require_writable(out)
    targets: dict[Path, Path] = {}
    for path in policies:
        file = policy_file(path)
        _, m = read_policy(file)
        target = out / f"{m.name}-{short_name(m.env_id)}-{m.seed}.zip"
        if target in targets:
            raise ConfigurationError(f"{path} and {targets[target]} are both {target.stem}")
        if target.exists() and not overwrite:
            raise ConfigurationError(f"{target} exists; --overwrite replaces it")
        targets[target] = path
    for target, path in targets.items():
        publish_policy(path, target)
    size = sum(t.stat().st_size for t in targets)
    console().print(f"{len(targets)} policies in {out}, {size / 1000:.0f} kB", markup=False)
