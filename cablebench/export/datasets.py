"""Data sets of the tasks of a protocol for offline learning: of random commands, of a reference, and of an expert.

The expert's commands are those that `cablebench.bound.upper_bound` finds for an episode with its true rig and its whole
reference, played in the environment with the sensors of the task. It sees what no controller sees, so that whoever
copies it from observations alone has to guess a part of it.
"""

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

from cable_envs.core.errors import ConfigurationError, require_known
from cable_envs.core.provenance import versions
from cable_envs.sim.tasks import action_of
from cablebench.bound import upper_bound
from cablebench.entrants.entrant import Entrant
from cablebench.entrants.named import named_entrant
from cablebench.export.minari import check_dataset_id, write_dataset
from cablebench.export.trace import Trace, random_entrant, record
from cablebench.protocol.failures import scored_error
from cablebench.protocol.metrics import measure
from cablebench.protocol.protocol import Protocol, Task
from cablebench.protocol.units import shown, unit_of
from cablebench.run.evaluation import core_of

SPLIT: Mapping[str, Any] = {"split": "train"}
"""Options of the environment: the rigs of training. No data set holds a rig or a seed of the test."""

REFERENCE = "suite-references"
"""Who plays the reference by default: the shipped composition of the suite."""

ROUNDS = 6
"""Rounds of the search for the expert's commands by default."""

INFOS = ("time", "reference", "output", "error", "command")
"""Infos that are kept: what the error was. All others follow from seed and actions, by the environment."""

CARD, SUMS = "README.md", "SHA256SUMS"
"""Files beside a data set's own: its card, and the checksums of all its files."""


@dataclass(frozen=True)
class Written:
    """One data set that was made.

    Attributes
    ----------
    dataset_id : str
        As ``minari.load_dataset`` takes it.
    folder : Path
    episodes, steps : int
    failed : int
        Episodes that were cut short.
    error : float
        Median over the episodes of the error that the task is scored by, SI.
    returns : float
        Mean sum of rewards.
    size : int
        Bytes of all files.
    """

    dataset_id: str
    folder: Path
    episodes: int
    steps: int
    failed: int
    error: float
    returns: float
    size: int


class Played:
    """Commands that were found beforehand for each seed of an episode, given as the drive's encoder counts them."""

    def __init__(self, commands: Mapping[int, np.ndarray]) -> None:
        self._commands = commands

    def start(self, env: Any) -> None:
        """Take the plan of this episode; a commanded position is told from the encoder's unknown zero."""
        setup, buffers = env.setup, env.simulation.buffers
        zero = float(buffers.common[0].shifted * buffers.named.zero[0])
        told = self._commands[int(env.np_random_seed)] + zero
        self._plan = action_of(told, setup.low, setup.high).astype(np.float32)
        self._step = 0

    def act(self, observation: np.ndarray, t: float) -> np.ndarray:
        """The next command; the last one again where the plan has ended."""
        action = self._plan[min(self._step, len(self._plan) - 1)]
        self._step += 1
        return np.array([action], dtype=np.float32)


@dataclass(frozen=True)
class Behaviour:
    """Who makes the episodes of a data set.

    words: for the card; entrant: from the environment's id and options, the seeds, and rounds of the expert's search.
    """

    words: str
    entrant: Callable[[str, Mapping[str, Any], Sequence[int], int], Entrant]


def _expert(env_id: str, options: Mapping[str, Any], seeds: Sequence[int], rounds: int) -> Entrant:
    """The best commands that a search with the true rig found for each seed."""
    commands = {b.seed: b.command for b in upper_bound(env_id, seeds, options, rounds=rounds)}
    settings = {"rounds of the search": rounds}
    return Entrant(
        "expert", "oracle", lambda _: Played(commands), lambda env_id, setup: {}, "upper-bound", settings=settings
    )


BEHAVIOURS: Mapping[str, Behaviour] = {
    "random": Behaviour("uniform random commands", lambda *_: random_entrant()),
    "reference": Behaviour("the shipped reference controllers", lambda *_: named_entrant(REFERENCE)),
    "expert": Behaviour("the best commands that a search with the true rig found", _expert),
}
"""By the name in the data set's id."""


def dataset_id(task: Task, behaviour: str, version: int = 0) -> str:
    """The id of a data set, as ``cable/CableHole-Track-Easy/expert-v0``."""
    return f"cable/{task.short}/{behaviour}-v{version}"


def options_of(task: Task) -> dict[str, Any]:
    """Options of the environment of all data sets of a task: training rigs, and what the reference needs besides."""
    own = {**task.options, **SPLIT}
    return named_entrant(REFERENCE).enters(task.env, own) or own


def make_dataset(
    protocol: Protocol,
    task: Task,
    behaviour: str,
    root: Path,
    episodes: int = 10,
    rounds: int = ROUNDS,
    progress: Callable[[int], None] | None = None,
) -> Written:
    """Play episodes of a task and write them as a Minari data set with a card and checksums.

    Parameters
    ----------
    protocol : Protocol
        Says the seeds of training, of which the first are taken.
    task : Task
        Of the protocol.
    behaviour : str
        One of `BEHAVIOURS`.
    root : Path
        Minari's folder of data sets.
    episodes : int
        Number of episodes.
    rounds : int
        Most rounds of the expert's search.
    progress : callable, optional
        Called with the number of episodes that are done.

    Returns
    -------
    Written
        What was made.

    Raises
    ------
    ConfigurationError
        For an unknown behaviour, where the data set exists, and where the behaviour does not enter the task.
    """
    require_known("behaviour", [behaviour], BEHAVIOURS)
    name, options = dataset_id(task, behaviour), options_of(task)
    check_dataset_id(name, root)
    seeds = [protocol.train.seed(k) for k in range(episodes)]
    entrant = BEHAVIOURS[behaviour].entrant(task.env, options, seeds, rounds)
    if entrant.enters(task.env, options) is None and entrant.information != "oracle":
        raise ConfigurationError(f"'{entrant.title}' does not enter {task.env}: there is no {behaviour} data set of it")
    with gym.make(task.env, disable_env_checker=True, **options) as env:
        kept = [replace(t, infos={n: t.infos[n] for n in INFOS}) for t in record(env, entrant, seeds, progress)]
        told = {"protocol": f"{protocol.name} version {protocol.version}", "made by": entrant.title}
        if behaviour == "expert":
            told |= entrant.settings
        folder = write_dataset(
            kept, env, entrant, root, name, beside=lambda place: _card(place, name, behaviour, env, kept, told)
        )
    metrics = [measure(t.episode) for t in kept]
    return Written(
        name, folder, len(kept), sum(len(t.actions) for t in kept), sum(not t.episode.complete for t in kept),
        float(np.median([scored_error(m) for m in metrics])), float(np.mean([np.sum(t.episode.reward) for t in kept])),
        sum(file.stat().st_size for file in folder.rglob("*") if file.is_file()),
    )  # fmt: skip


def wrong_files(folder: Path) -> list[str]:
    """Files of a data set that differ from its `SUMS`, are missing, or are not listed.

    Parameters
    ----------
    folder : Path
        Of one data set.

    Returns
    -------
    list of str
        A sentence for each; empty where all is as it was written.

    Raises
    ------
    ConfigurationError
        Where there are no checksums.
    """
    sums = folder / SUMS
    if not sums.is_file():
        raise ConfigurationError(f"{sums} is missing: nothing says what the files of this data set should be")
    listed = {name: digest for digest, name in (line.split("  ", 1) for line in sums.read_text("utf-8").splitlines())}
    found = _digests(folder)
    return [
        *(f"{folder / name} is missing" for name in listed if name not in found),
        *(f"{folder / name} has changed" for name in listed if found.get(name, listed[name]) != listed[name]),
        *(f"{folder / name} is not listed" for name in found if name not in listed),
    ]


def _digests(folder: Path) -> dict[str, str]:
    files = sorted(f for f in folder.rglob("*") if f.is_file() and f.name != SUMS)
    return {f.relative_to(folder).as_posix(): hashlib.sha256(f.read_bytes()).hexdigest() for f in files}


def _card(
    folder: Path, name: str, behaviour: str, env: gym.Env, traces: Sequence[Trace], told: Mapping[str, Any]
) -> None:
    """The card and the checksums of a data set, beside its files."""
    text = card(name, behaviour, env, traces, told)
    (folder / CARD).write_text(text, encoding="utf-8")
    lines = [f"{digest}  {file}\n" for file, digest in _digests(folder).items()]
    (folder / SUMS).write_text("".join(lines), encoding="utf-8")


def card(name: str, behaviour: str, env: gym.Env, traces: Sequence[Trace], told: Mapping[str, Any]) -> str:
    """What whoever learns from a data set should know, as Markdown.

    Parameters
    ----------
    name : str
        Id of the data set.
    behaviour : str
        One of `BEHAVIOURS`.
    env : gymnasium.Env
        Its environment.
    traces : sequence of Trace
        Its episodes.
    told : mapping
        Facts about how they were made, by what they are.

    Returns
    -------
    str
    """
    setup, first = core_of(env).setup, traces[0].episode
    errors = np.array([scored_error(measure(t.episode)) for t in traces])
    returns = np.array([np.sum(t.episode.reward) for t in traces])
    unit = unit_of("rmse", first)
    low, mid, high = (shown(float(q), "rmse", first) for q in np.quantile(errors, (0.0, 0.5, 1.0)))
    channels = "\n".join(f"| {k} | `{c.name}` | {c.unit} | {c.scale:g} |" for k, c in enumerate(setup.channels))
    facts = "\n".join(f"- {key}: {value}" for key, value in {**told, **versions()}.items())
    steps = sum(len(t.actions) for t in traces)
    assert env.spec is not None
    return f"""# {name}

{len(traces)} episodes of `{env.spec.id}` ({steps} steps of {setup.control_period:g} s),
made by {BEHAVIOURS[behaviour].words}. The rigs are drawn from the ranges for training,
and the seeds are {traces[0].seed} to {traces[-1].seed}: no rig and no seed of the test is among them.

| | least | median | most |
|---|--:|--:|--:|
| error that the task is scored by [{unit}] | {low} | {mid} | {high} |
| sum of rewards | {returns.min():.4g} | {np.median(returns):.4g} | {returns.max():.4g} |

{sum(not t.episode.complete for t in traces)} episodes ended early, because a rule of the task was broken.

An observation is a vector of SI values over the scale of their channel:

| index | channel | unit | scale |
|--:|---|---|--:|
{channels}

An action is a number from -1 to 1, linear over the range of the command:
{setup.low:g} to {setup.high:g} {setup.action_mode.unit}.
The infos hold the true {", ".join(INFOS)} in SI units, without noise.
Each episode's metadata hold its seed and the true parameters of its rig; reset with the seed and given the actions,
`recover_environment()` repeats the episode to the bit.

    MINARI_DATASETS_PATH=. python -c "import minari; print(minari.load_dataset('{name}').total_steps)"
    sha256sum --check {SUMS}

{facts}
"""
