"""The score of one episode: the protocol's references run on the same episode, and the board's law of the score."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from cable_envs.core.errors import ConfigurationError
from cablebench.cli.shared.arguments import options_for

PROTOCOL = "quick"
"""Whose references and worst score count; those of all protocols are the same."""

_OF_THE_ENTRANT = ("observe", "action_mode")
"""What an entrant chooses for itself: the references take the task's own, as on the boards."""


@dataclass(frozen=True)
class EpisodeScore:
    """0 is the open loop, 1 the oracle, both on the same episode."""

    value: float
    open_loop: float
    """RMSE, SI"""
    oracle: float
    """RMSE, SI"""

    def as_json(self) -> dict[str, float]:
        """For ``--json``."""
        return {"value": self.value, "rmse_open_loop": self.open_loop, "rmse_oracle": self.oracle}

    def said(self, episode: Any) -> str:
        """One line for people; ``episode`` says the unit."""
        from cablebench.protocol.units import shown, unit_of

        ends = [f"{shown(rmse, 'rmse', episode)} {unit_of('rmse', episode)}" for rmse in (self.open_loop, self.oracle)]
        return (
            f"score {self.value:.3g} on this episode (0: open loop, RMSE {ends[0]}; 1: oracle, which knows the true "
            f"rig, RMSE {ends[1]})"
        )


def episode_score(env_id: str, options: Mapping[str, Any], seed: int, episode: Any) -> EpisodeScore | None:
    """The score of an episode that was run; None where a reference does not apply or is no better than the other."""
    import math

    from cablebench.board.scoring import score_episodes
    from cablebench.entrants.named import reference_entrants
    from cablebench.protocol.files import load_protocol
    from cablebench.protocol.metrics import measure

    protocol = load_protocol(PROTOCOL)
    names = (protocol.open_loop, protocol.oracle)
    common = {key: value for key, value in options.items() if key not in _OF_THE_ENTRANT}
    try:
        runs = {entrant.name: _played(env_id, common, entrant, seed) for entrant in reference_entrants(names)}
    except ConfigurationError:
        return None  # a plant of one's own that no reference knows
    runs[""] = episode
    condition = {"env_id": env_id, "track": "", "seed": seed}
    records: list[Mapping[str, Any]] = [
        {**condition, "entrant": name, "metrics": measure(run)} for name, run in runs.items()
    ]
    value = score_episodes(records, protocol)[-1]
    if math.isnan(value):
        return None
    open_loop, oracle = (measure(runs[name])["rmse"] for name in names)
    return EpisodeScore(value, open_loop, oracle)


def _played(env_id: str, options: Mapping[str, Any], entrant: Any, seed: int) -> Any:
    import gymnasium as gym

    from cablebench.run.evaluation import core_of, run_episode

    env = gym.make(env_id, disable_env_checker=True, **options_for(entrant, env_id, dict(options)))
    try:
        return run_episode(env, entrant.make(core_of(env).setup), seed)
    finally:
        env.close()
