"""A policy for others: without what only training needs."""

import io
import json
import zipfile
from dataclasses import asdict
from pathlib import Path

import torch

from cable_envs.agents import archive
from cable_envs.agents.files import policy_file
from cable_envs.agents.policy import ENTRY, NOT_ACTING, SCHEMA, load_policy, read_policy
from cable_envs.core.errors import ConfigurationError
from cable_envs.core.files import jsonable, write_atomic


def publish_policy(source: str | Path, target: str | Path) -> Path:
    """Write a policy without what only training needs: a few dozen kilobytes.

    It acts as before; it cannot be trained on, and ``PPO.load`` does not read it.

    Parameters
    ----------
    source : str or Path
        As of `load_policy`.
    target : str or Path
        File to write.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    ConfigurationError
        As `load_policy`, and where the training is not complete.
    """
    file = policy_file(source)
    content, metadata = read_policy(file)
    load_policy(file)
    if not metadata.complete:
        raise ConfigurationError(f"{file}: the training is not complete; finish it with `cablebench train --resume`")
    weights = {k: v for k, v in archive.weights(file, content).items() if not k.startswith(NOT_ACTING)}
    packed, buffer = io.BytesIO(), io.BytesIO()
    torch.save(weights, packed)
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as target_zip:
        # dated like the epoch of zip: the same policy gives the same file
        target_zip.writestr(zipfile.ZipInfo("policy.pth"), packed.getvalue(), zipfile.ZIP_DEFLATED)
        text = json.dumps(jsonable({"schema": SCHEMA, **asdict(metadata)}), indent=1)
        target_zip.writestr(zipfile.ZipInfo(ENTRY), text, zipfile.ZIP_DEFLATED)
    return write_atomic(target, buffer.getvalue())
