"""What `cablebench tune --controller` searches: the gains of one controller on one environment."""

from collections.abc import Mapping
from typing import Any

from cable_envs.baselines import controller_class
from cable_envs.core.errors import ConfigurationError
from cable_envs.core.provenance import source_hash
from cable_envs.sim.registered import setup_of
from cablebench.cli.shared.arguments import short_name
from cablebench.jobs import Job
from cablebench.protocol.protocol import Protocol
from cablebench.tune.objective import controller_trial, tuning_cells, tuning_seeds
from cablebench.tune.space import gain_space
from cablebench.tune.study import Search


def controller_search(
    controller: str, env_id: str, protocol: Protocol, track: str, episodes: int, seed: int, batch: int
) -> Search:
    """The search over a controller's gains, from its defaults.

    Raises ConfigurationError for unknown names, and where the controller does not apply or has no gains.
    """
    kind = controller_class(controller)
    cells = tuning_cells(protocol, env_id, track)
    setup = setup_of(env_id, cells[0].environment_options())
    table = kind.parameters_for(setup.plant.name, setup.action_mode.name, setup.task.kind)
    if not len(table):
        raise ConfigurationError(f"'{controller}' has no gains for {short_name(env_id)}")
    seeds = tuning_seeds(protocol, episodes)

    def job(number: int, gains: Mapping[str, Any]) -> Job:
        arguments = {"controller": controller, "gains": dict(gains), "cells": cells, "seeds": seeds}
        return Job(f"{controller} on {short_name(env_id)}, trial {number}", controller_trial, arguments)

    return Search(
        name=f"{controller} on {env_id}",
        space=gain_space(table),
        start={p.name: p.default for p in table},
        job=job,
        about={"protocol": protocol.hash(), "track": track, "episodes": episodes, "source": source_hash()},
        seed=seed,
        batch=batch,
    )
