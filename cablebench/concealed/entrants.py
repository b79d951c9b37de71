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
from functools import partial
from pathlib import Path

from cable_envs.core.errors import ConfigurationError
from cable_envs.core.files import read_python, run_python
from cablebench.concealed import learners
from cablebench.concealed.given import Given, MakeActor
from cablebench.concealed.mechanism import Mechanism
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
    prepare : callable
        From what is given to the actor's maker.
    told : str
        What it uses: "nothing" of the hidden rig, its "recordings", "episodes" on it, or "truth".
    episodes : int
        On the hidden rig.
    enters : callable
        Whether it plays a mechanism.
    """

    name: str
    prepare: Callable[[Given], MakeActor]
    told: str = "nothing"
    episodes: int = 0
    enters: Callable[[Mechanism], bool] = lambda mechanism: True


def tuned_row(count: int) -> str:
    """Name of the row whose gains are chosen by so many episodes on the hidden rig."""
    return f"tuned-on-the-rig-{count}"


ROWS: Mapping[str, Row] = {
    row.name: row
    for row in (
        Row("nominal-controller", learners.nominal_controller),
        Row("adaptive-controller", learners.adaptive_controller, enters=lambda mechanism: bool(mechanism.adaptive)),
        Row("nominal-agent", learners.nominal_agent),
        Row("randomised-agent", learners.randomised_agent),
        Row("memory-agent", learners.memory_agent),
        Row("diagnosed-controller", learners.diagnosed_controller, "recordings"),
        Row("diagnosed-agent", learners.diagnosed_agent, "recordings"),
        *(Row(tuned_row(n), partial(learners.tuned_on_the_rig, count=n), "episodes", n) for n in ON_THE_RIG),
        Row("oracle-controller", learners.oracle_controller, "truth"),
        Row("oracle-agent", learners.oracle_agent, "truth"),
    )
}
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
    name, prepare = getattr(module, "name", path.stem), getattr(module, "prepare", None)
    if not callable(prepare):
        raise ConfigurationError(f"{path}: it must define prepare(given), which makes an actor for a setup")
    if not isinstance(name, str) or not is_name(name) or name in ROWS:
        raise ConfigurationError(f"{path}: name = {name!r}; expected a name that no row has")
    episodes = getattr(module, "episodes", 0)
    if not isinstance(episodes, int) or isinstance(episodes, bool) or episodes < 0:
        raise ConfigurationError(f"{path}: episodes = {episodes!r}; expected a whole number of at least 0")
    return Row(name, prepare, "episodes" if episodes else "recordings", episodes)
