"""What `cablebench tune --algo` searches: settings of an agent on one environment; a trial trains and evaluates it."""

import json
import math
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from cable_envs.agents.settings import load_settings
from cable_envs.core.config import config_path, read_yaml
from cable_envs.core.errors import ConfigurationError
from cable_envs.core.provenance import source_hash
from cablebench.cli.shared.arguments import short_name
from cablebench.jobs import Context, Job, Stopped
from cablebench.protocol.protocol import Protocol
from cablebench.tune.objective import loss_of, mean_loss, training_seed, tuning_cells, tuning_seeds
from cablebench.tune.space import Dimension, nested, parse_space
from cablebench.tune.study import Search

RUN = "run"


def agent_search(
    algo: str,
    env_id: str,
    steps: int,
    folder: Path,
    protocol: Protocol,
    track: str,
    episodes: int,
    seed: int,
    batch: int,
) -> Search:
    """The search over the settings named under ``search`` in the agent's file, from the file's own.

    ``folder``: where trials keep their checkpoints. Raises ConfigurationError for what is wrong in the file.
    """
    base = load_settings(algo, env_id, steps)
    path, data = _read(algo)
    space = parse_space(data.get("search"), path.name)
    start = {d.name: _own_value(d, data, env_id, path.name) for d in space}
    for d in space:
        d.coordinate(start[d.name])
    cells, seeds = tuning_cells(protocol, env_id, track), tuning_seeds(protocol, episodes)

    def job(number: int, values: Mapping[str, Any]) -> Job:
        settings = load_settings(algo, env_id, steps, changes=nested(values))
        arguments = {"settings": settings, "seed": training_seed(protocol), "cells": cells, "seeds": seeds}
        place = folder / f"{short_name(env_id)}-{number}"
        return Job(f"{path.stem} on {short_name(env_id)}, trial {number}", agent_trial, arguments, {RUN: place})

    return Search(
        name=f"{path.stem} on {env_id}",
        space=space,
        start=start,
        job=job,
        about={
            "protocol": protocol.hash(), "track": track, "episodes": episodes, "source": source_hash(),
            "settings": base.hash(), "charged_before": base.tuning_trials,
        },
        seed=seed,
        batch=batch,
    )  # fmt: skip


def tuned_file(algo: str, blocks: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """The agent's settings file with ``blocks`` {environment id: keys} taken over: it stands for itself."""
    path, data = _read(algo)
    data = json.loads(json.dumps(data))  # without what its blocks share, which YAML would write as anchors
    search = data.pop("search")
    name = data.pop("algorithm", None) or path.stem
    for env_id, block in blocks.items():
        data[env_id] = _merged(data.get(env_id) or {}, block)
    return {"algorithm": name, **data, "search": search}


def _read(algo: str) -> tuple[Path, Any]:
    path = Path(algo) if algo.endswith((".yaml", ".yml")) else config_path("agents", f"{algo}.yaml")
    return path, read_yaml(path)


def _merged(old: Mapping[str, Any], new: Mapping[str, Any]) -> dict[str, Any]:
    both = [key for key in new if isinstance(old.get(key), Mapping) and isinstance(new[key], Mapping)]
    return {**old, **new, **{key: _merged(old[key], new[key]) for key in both}}


def _own_value(dimension: Dimension, data: Mapping[str, Any], env_id: str, source: str) -> Any:
    """What the file itself sets for the environment; ConfigurationError where it sets nothing."""
    for part in (data.get(env_id) or {}, data.get("default") or {}):
        place: Any = part
        for key in dimension.name.split("."):
            place = place.get(key) if isinstance(place, Mapping) else None
        if place is not None:
            return place
    raise ConfigurationError(f"{source}: search.{dimension.name} has no value to start from: set it under 'default'")


def agent_trial(context: Context, settings: Any, seed: int, cells: Sequence[Any], seeds: Sequence[int]) -> float:
    """Body of an agent's trial: train with these settings, then the mean loss; checkpoints go when it has ended.

    A training whose numbers stop being finite is a trial with the worst loss there is.
    """
    from cable_envs.agents.train import Interrupted, train
    from cable_envs.sim.registered import setup_of
    from cablebench.cli.shared.policies import policy_entrant

    folder = context.folders[RUN]
    try:
        train(settings, seed, folder, resume="auto", progress=context.report)
        loss = mean_loss(policy_entrant(str(folder)), cells, seeds, context)
    except Interrupted:
        raise Stopped() from None
    except ConfigurationError:
        raise
    except (ValueError, FloatingPointError) as error:  # torch's distributions refuse NaN with a ValueError
        if "nan" not in str(error).lower() and "invalid values" not in str(error):
            raise
        loss = loss_of(math.inf, setup_of(settings.env_id, cells[0].environment_options()))
    shutil.rmtree(folder, ignore_errors=True)
    return loss
