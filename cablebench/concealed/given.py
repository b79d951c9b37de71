"""What an entrant of the concealed track is given, and the few episodes that it may run on the hidden rig."""

from collections.abc import Callable, Mapping
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import gymnasium as gym

from cable_envs.core.errors import ConfigurationError
from cable_envs.sim.registered import setup_of
from cable_envs.sim.setup import Setup
from cablebench.concealed.hidden import HiddenRig
from cablebench.concealed.mechanism import PROTOCOL, Mechanism
from cablebench.protocol.actors import Actor
from cablebench.protocol.files import load_protocol
from cablebench.protocol.metrics import measure
from cablebench.run.evaluation import core_of, run_episode

MakeActor = Callable[[Setup], Actor]
"""An actor for the environment of a setup."""


def episode_metrics(env_id: str, options: Mapping[str, Any], actor: MakeActor, seeds: Any) -> list[dict[str, Any]]:
    """The metrics of an episode of each seed, as `cablebench.protocol.metrics.measure` gives them."""
    with closing(gym.make(env_id, disable_env_checker=True, **options)) as env:
        acting = actor(core_of(env).setup)
        return [measure(run_episode(env, acting, seed)) for seed in seeds]


class Episodes:
    """The episodes that an entrant may run on the hidden rig, counted.

    Parameters
    ----------
    env_id : str
        The task's environment.
    options : mapping
        Of the hidden rig.
    most : int
        How many there may be.
    """

    def __init__(self, env_id: str, options: Mapping[str, Any], most: int):
        self._env_id, self.true_options, self.most, self.used = env_id, dict(options), most, 0

    def run(self, actor: MakeActor, seed: int = 0) -> dict[str, Any]:
        """The metrics of one episode on the hidden rig.

        Parameters
        ----------
        actor : callable
            Makes the actor for the environment's setup, which states the rig that everybody believes in.
        seed : int
            Which of the episodes for tuning: the same one has the same reference.

        Returns
        -------
        dict
            Metrics by name, SI.

        Raises
        ------
        ConfigurationError
            Where none is left.
        """
        if self.used >= self.most:
            raise ConfigurationError(f"all {self.most} episodes on the hidden rig are used")
        self.used += 1
        return episode_metrics(self._env_id, self.true_options, actor, [load_protocol(PROTOCOL).tune.seed(seed)])[0]


@dataclass(frozen=True)
class Given:
    """What an entrant knows of a hidden rig.

    Attributes
    ----------
    mechanism : Mechanism
        The task, and the rig that everybody believes in.
    recording : Path
        Folder of recordings of the hidden rig (`cablebench diagnose`).
    folder : Path
        Where it may keep what it makes for this rig.
    shared : Path
        Where it may keep what serves all rigs of the mechanism: a policy that is trained once.
    episodes : Episodes
        On the hidden rig.
    seed : int
        Of everything that it draws.
    """

    mechanism: Mechanism
    recording: Path
    folder: Path
    shared: Path
    episodes: Episodes
    seed: int = 0
    tell: Callable[[str], None] = field(default=lambda text: None, compare=False)

    @property
    def believed(self) -> dict[str, Any]:
        """Environment options of the simulator that everybody has."""
        return {"rig": self.mechanism.preset}

    def setup(self, options: Mapping[str, Any] | None = None) -> Setup:
        """The setup of the task under options, by default those of the believed rig."""
        return setup_of(self.mechanism.env, {**self.believed, **(options or {})})


def folder_of(hidden: HiddenRig, root: Path) -> Path:
    """Where the recording of a hidden rig is, and what is made for it; ``root``: the mechanism's folder."""
    return root / f"rig-{hidden.number:02d}"


def given(
    hidden: HiddenRig, mechanism: Mechanism, root: Path, episodes: int, seed: int, tell: Callable[[str], None]
) -> Given:
    """What an entrant is given of a hidden rig of the mechanism's folder ``root``."""
    folder = folder_of(hidden, root)
    allowed = Episodes(mechanism.env, hidden.options(mechanism), episodes)
    return Given(mechanism, folder / "recording", folder, root / "shared", allowed, seed, tell)
