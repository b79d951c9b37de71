"""The rows that are always on the concealed track, and entrants from files.

A row's ``prepare(given)`` makes, from what is given of a hidden rig, what decides in an episode. An entrant from a file
is the same: a Python file with ``name`` and ``prepare(given)``, and with ``episodes``, the number that it runs on the
hidden rig, where it runs any.

    from cablebench.concealed.learners import controller

    name = "my-first"

    def prepare(given):
        return controller(given, "lqg", "lqg-suite", given.believed)
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from cable_envs.core.errors import ConfigurationError
from cable_envs.core.files import read_python, run_python
from cablebench.concealed import learners
from cablebench.concealed.given import Given, MakeActor
from cablebench.entrants.entrant import is_name

ON_THE_RIG = (2, 4, 8, 16, 32)
"""Numbers of episodes on the hidden rig of the rows that are tuned there."""


@dataclass(frozen=True)
class Row:
    """One row of the track.

    Attributes
    ----------
    name : str
        On the page.
    about : str
        What it does, in a sentence.
    prepare : callable
        From what is given to the actor's maker.
    told : str
        What it uses: "nothing" of the hidden rig, its "recordings", "episodes" on it, or "truth".
    episodes : int
        On the hidden rig.
    """

    name: str
    about: str
    prepare: Callable[[Given], MakeActor]
    told: str = "nothing"
    episodes: int = 0


def _tuned_on_the_rig(count: int) -> Row:
    return Row(
        f"tuned-on-the-rig-{count}",
        f"the nominal controller, gains chosen by {count} episodes on the hidden rig itself",
        lambda given: learners.tuned_on_the_rig(given, count), "episodes", count,
    )  # fmt: skip


ROWS: Mapping[str, Row] = {
    row.name: row
    for row in (
        Row("nominal-controller", "a model-based controller that takes the believed rig for the true one",
            learners.nominal_controller),
        Row("adaptive-controller", "a controller that estimates friction and weight while it runs",
            learners.adaptive_controller),
        Row("nominal-agent", "PPO, trained on the believed rig", learners.nominal_agent),
        Row("randomised-agent", "PPO, trained on rigs and effects drawn anew for every episode",
            learners.randomised_agent),
        Row("memory-agent", "PPO with an LSTM, trained on rigs and effects drawn anew for every episode",
            learners.memory_agent),
        Row("diagnosed-controller", "the nominal controller, which takes the diagnosed rig for the true one; its gains "
            "are tuned on the corrected simulator", learners.diagnosed_controller, "recordings"),
        Row("diagnosed-agent", "PPO, trained on the corrected simulator", learners.diagnosed_agent, "recordings"),
        *map(_tuned_on_the_rig, ON_THE_RIG),
        Row("oracle-controller", "the nominal controller, told the true rig and tuned on its simulator",
            learners.oracle_controller, "truth"),
        Row("oracle-agent", "PPO, trained on the true simulator", learners.oracle_agent, "truth"),
    )
}  # fmt: skip
"""Rows by name."""


def row_from_file(path: Path) -> Row:
    """The row of a Python file, which is run.

    Parameters
    ----------
    path : Path
        With ``prepare(given)``; ``name`` (by default the file's) and ``episodes`` (by default none).

    Returns
    -------
    Row

    Raises
    ------
    ConfigurationError
        Where it cannot be run, or what it defines is no entrant.
    """
    module = run_python(path, f"entrant_{path.stem}", read_python(path))
    name, prepare, episodes = getattr(module, "name", path.stem), getattr(module, "prepare", None), 0
    if not callable(prepare):
        raise ConfigurationError(f"{path}: it must define prepare(given), which makes an actor for a setup")
    if not isinstance(name, str) or not is_name(name) or name in ROWS:
        raise ConfigurationError(f"{path}: name = {name!r}; expected a name that no row has")
    episodes = getattr(module, "episodes", 0)
    if not isinstance(episodes, int) or isinstance(episodes, bool) or episodes < 0:
        raise ConfigurationError(f"{path}: episodes = {episodes!r}; expected a whole number of at least 0")
    about = " ".join((module.__doc__ or "an entrant from a file").split())
    return Row(name, about, prepare, "episodes" if episodes else "recordings", episodes)
