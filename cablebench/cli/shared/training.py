"""Trainings as jobs: what a worker does, and where the folders of several seeds lie."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from cable_envs.core.errors import ConfigurationError
from cablebench.cli.shared.arguments import short_name
from cablebench.cli.shared.output import console
from cablebench.jobs import Context, Job, Stopped

RUN, LOGS = "run", "tensorboard"
"""Names of a training's folders."""

BOARDS = ("quick", "full")


def training_job(
    settings: Any,
    seed: int,
    folder: Path,
    *,
    resume: bool | str = False,
    overwrite: bool = False,
    checkpoint_every: float = 60.0,
    tensorboard: Path | None = None,
) -> Job:
    """The training of one seed as a `Job`; arguments as of `agents.train.train`. Its result is `summary`'s."""
    name = f"{settings.algo} on {short_name(settings.env_id)} seed {seed}"
    arguments = {
        "settings": settings, "seed": seed, "resume": resume, "overwrite": overwrite,
        "checkpoint_every": checkpoint_every,
    }  # fmt: skip
    folders = {RUN: folder} if tensorboard is None else {RUN: folder, LOGS: tensorboard}
    return Job(name, train_here, arguments, folders)


def train_here(
    context: Context, settings: Any, seed: int, resume: bool | str, overwrite: bool, checkpoint_every: float
) -> dict[str, Any]:
    """Body of a training's job. After a worker's death it goes on from the checkpoint, or anew where there is none."""
    from cable_envs.agents.train import Interrupted, train

    if context.attempt > 1:
        resume, overwrite = "auto", False
    try:
        policy = train(
            settings, seed, context.folders[RUN], resume=resume, overwrite=overwrite, progress=context.report,
            checkpoint_every=checkpoint_every, tensorboard=context.folders.get(LOGS),
        )  # fmt: skip
    except Interrupted as stopped:
        raise Stopped(summary(stopped.policy)) from None
    return summary(policy)


def summary(policy: Any) -> dict[str, Any]:
    """What a training has come to, as plain data."""
    m = policy.metadata
    return {
        "digest": policy.digest, "env_id": m.env_id, "algo": m.name, "seed": m.seed, "steps": m.steps,
        "complete": m.complete, "configuration": m.settings_hash, "curve": m.curve,
    }  # fmt: skip


def say_seeds(settings: Any, seeds: Sequence[int]) -> None:
    """Say on standard error where a training starts environments from seeds that the boards do not train on."""
    from cablebench.protocol.files import load_protocol

    for seed in seeds:
        used = settings.env_seeds(seed)
        out = [p.name for p in map(load_protocol, BOARDS) if not (used.start in p.train and used.stop - 1 in p.train)]
        if out:
            train = load_protocol(out[0]).train
            console(stderr=True).print(
                f"warning: --seed {seed} starts the {settings.n_envs} environments from the seeds {used.start} to "
                f"{used.stop - 1}; the range for training of the boards {' and '.join(out)} is {train.first} to "
                f"{train.first + train.count - 1}, and `cablebench submit` refuses seeds for tuning or testing",
                markup=False,
            )
            return


def chosen_seeds(seeds: Sequence[int], ranges: Sequence[str]) -> tuple[int, ...]:
    """The seeds of ``--seed`` and ``--seeds FIRST:COUNT``, each once; 0 where none is named."""
    found = list(seeds)
    for text in ranges:
        first, colon, count = text.partition(":")
        if not (colon and first.isdecimal() and count.isdecimal() and int(count) > 0):
            raise ConfigurationError(f"--seeds expects FIRST:COUNT, two whole numbers as in 0:3, got '{text}'")
        found += range(int(first), int(first) + int(count))
    if len(set(found)) < len(found):
        raise ConfigurationError(f"seeds are given twice: {', '.join(map(str, found))}")
    return tuple(found) or (0,)
