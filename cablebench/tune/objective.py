"""What tuning minimises: the mean logarithm of the RMSE over tuning episodes, the same for controllers and agents.

The logarithm weighs a factor alike wherever it comes from, so that one hard episode does not decide alone. Tuning
episodes are seeded from the protocol's ``tune`` range; test seeds are never touched. A failed episode counts as, and
none counts worse than, an RMSE of `WORST` times the scale of the reference in the observation.
"""

import math
from collections.abc import Mapping, Sequence
from contextlib import closing

import gymnasium as gym

from cable_envs.core.errors import ConfigurationError
from cable_envs.sim.setup import Setup
from cable_envs.sim.tasks import REFERENCE
from cablebench.entrants.entrant import Entrant, controller_entrant
from cablebench.jobs import Context
from cablebench.protocol.protocol import Cell, Protocol
from cablebench.run.evaluation import core_of, run_episode
from cablebench.run.records import badness, facts

WORST = 10.0
BEST = 1e-9
"""An RMSE below this share of that scale counts as it: the logarithm of nothing is no number."""


def tuning_cells(protocol: Protocol, env_id: str, track: str) -> tuple[Cell, ...]:
    """The conditions of a task on a track; ConfigurationError with the nearest name where there is none."""
    return protocol.cells((env_id,), (track,))


def tuning_seeds(protocol: Protocol, episodes: int) -> tuple[int, ...]:
    """Seeds of the tuning episodes."""
    return tuple(protocol.tune.seed(i) for i in range(episodes))


def training_seed(protocol: Protocol) -> int:
    """Training seed of agents while they are tuned: far from those of a board, which count from the first."""
    return protocol.train.seed(min(1000, protocol.train.count // 2))


def mean_loss(entrant: Entrant, cells: Sequence[Cell], seeds: Sequence[int], context: Context) -> float:
    """The mean loss of an entrant over the seeds of every cell. Raises ConfigurationError where it does not enter."""
    losses: list[float] = []
    for cell in cells:
        options = entrant.enters(cell.task.env, cell.environment_options())
        if options is None:
            raise ConfigurationError(f"'{entrant.title}' does not apply to {cell.task.env}")
        with closing(gym.make(cell.task.env, disable_env_checker=True, **options)) as env:
            setup = core_of(env).setup
            actor = entrant.make(setup)
            for seed in seeds:
                episode = run_episode(env, actor, seed, cell.reset_options(setup))
                losses.append(loss_of(badness(facts(episode)), setup))
                context.report(len(losses), len(cells) * len(seeds), entrant.title)
    return math.fsum(losses) / len(losses)


def loss_of(rmse: float, setup: Setup) -> float:
    """The loss of an episode with that RMSE (infinite or NaN: it failed)."""
    scale = next(c.scale for c in setup.channels if c.name == REFERENCE)
    share = rmse / scale if math.isfinite(rmse) else WORST
    return math.log(scale * min(max(share, BEST), WORST))


def controller_trial(
    context: Context, controller: str, gains: Mapping[str, float], cells: Sequence[Cell], seeds: Sequence[int]
) -> float:
    """Body of a controller's trial: its mean loss with these gains."""
    return mean_loss(controller_entrant(controller, gains), cells, seeds, context)
