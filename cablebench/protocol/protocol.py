"""The benchmark protocol as data: tasks, tracks, seeds, episodes, budgets; one YAML file in configs/protocols/ each."""

import itertools
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from cable_envs.core.config import config_path, configuration_hash, read_yaml
from cable_envs.core.errors import ConfigurationError, nearest, require_known
from cable_envs.sim.setup import Setup

SCHEMA = 1


@dataclass(frozen=True)
class SeedRange:
    """Seeds first .. first + count - 1."""

    first: int
    count: int

    def __contains__(self, seed: int) -> bool:
        return self.first <= seed < self.first + self.count

    def seed(self, index: int) -> int:
        """The index-th seed of the range; ConfigurationError when the range is used up."""
        if not 0 <= index < self.count:
            raise ConfigurationError(f"seed number {index}: the range from {self.first} holds {self.count} seeds")
        return self.first + index


@dataclass(frozen=True)
class Task:
    """One environment id with the options every track passes to it."""

    env: str
    options: Mapping[str, Any] = field(default_factory=dict)

    @property
    def short(self) -> str:
        """The id without namespace and version, for tables."""
        return self.env.split("/")[-1].rsplit("-v", 1)[0]

    @property
    def family(self) -> str:
        """The mechanism: the id's first word, "CableHole" or "PulleyCircuit"."""
        return self.short.split("-")[0]


@dataclass(frozen=True)
class Sweep:
    """One disturbing quantity varied alone over `points` evenly spaced values from `low` to `high`.

    It scales rig parameters (`scale`: parameter names by mechanism), or adds to them (`add`: by mechanism, parameter
    and what one unit of the value adds, SI), or sets an environment option (`option`). A mechanism that is not named
    under `scale` or `add` is not swept.
    """

    name: str
    low: float
    high: float
    points: int = 21
    scale: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    add: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    option: str = ""
    integer: bool = False
    unit: str = "1"

    def values(self) -> tuple[float, ...]:
        """The swept values, rounded to whole numbers (each once) when `integer`."""
        step = (self.high - self.low) / max(self.points - 1, 1)
        raw = [self.low + i * step for i in range(self.points)]
        return tuple(dict.fromkeys(float(round(v)) for v in raw)) if self.integer else tuple(raw)


@dataclass(frozen=True)
class Track:
    """A condition under which every task is run. `episodes` 0 takes the protocol's number."""

    name: str
    options: Mapping[str, Any] = field(default_factory=dict)
    episodes: int = 0
    sweeps: tuple[Sweep, ...] = ()


@dataclass(frozen=True)
class Cell:
    """One condition to evaluate: a task on a track, at one value of one sweep where the track has sweeps."""

    task: Task
    track: Track
    episodes: int
    sweep: Sweep | None = None
    value: float | None = None

    @property
    def level(self) -> float:
        """`value`, where there is a sweep."""
        assert self.value is not None, f"{self.key} has no sweep"
        return self.value

    @property
    def key(self) -> str:
        """A readable unique name within the protocol."""
        at = f" {self.sweep.name}={self.value:g}" if self.sweep else ""
        return f"{self.task.short} {self.track.name}{at}"

    def environment_options(self) -> dict[str, Any]:
        """The environment's options: the task's, the track's, and the swept one."""
        options = {**self.task.options, **self.track.options}
        if self.sweep is not None and self.sweep.option:
            options[self.sweep.option] = int(self.level) if self.sweep.integer else self.level
        return options

    def reset_options(self, setup: Setup) -> dict[str, Any] | None:
        """Options of every reset: rig parameters as the sweep changes them; None where it changes none.

        Scaled parameters are held within their bounds. The entrant keeps the nominal ones.
        """
        if self.sweep is None or self.sweep.option:
            return None
        table = setup.plant.parameters
        changed = {}
        for name in self.sweep.scale.get(self.task.family, ()):
            declared = table[name]
            changed[name] = min(max(setup.rig.values[name] * self.level, declared.low), declared.high)
        for name, size in self.sweep.add.get(self.task.family, {}).items():
            # an effect's parameter is absent where it is 0
            changed[name] = setup.rig.values.get(name, 0.0) + size * self.level
        return {"rig": changed}


@dataclass(frozen=True)
class Protocol:
    """Everything that decides which episodes are run and how they are scored. See docs/protocol.md."""

    name: str
    title: str
    tasks: tuple[Task, ...]
    tracks: tuple[Track, ...]
    train: SeedRange
    tune: SeedRange
    test: SeedRange
    version: int = 1
    """raised when the same name comes to mean other episodes or scores; boards rank one version only"""
    note: str = ""
    run: tuple[str, ...] = ()
    """tracks that a board runs unless asked otherwise; empty: all"""
    episodes: int = 10
    training_seeds: int = 3
    environment_steps: int = 0
    tuning_trials: int = 0
    worst_score: float = -1.0
    open_loop: str = "open-loop"
    oracle: str = "oracle"
    paper: Mapping[str, str] = field(default_factory=dict)
    """the papers' controller by mechanism, that the probability of improvement is taken over"""
    resamples: int = 2000
    level: float = 0.95
    bootstrap_seed: int = 0

    def hash(self) -> str:
        """Twelve hex digits of the SHA-256 over everything above (title and note left out: they change no number)."""
        return configuration_hash({k: v for k, v in asdict(self).items() if k not in ("title", "note")})

    def track(self, name: str) -> Track:
        """The track of that name; ConfigurationError with the nearest name when there is none."""
        for track in self.tracks:
            if track.name == name:
                return track
        raise ConfigurationError(f"unknown track '{name}'; {nearest(name, [t.name for t in self.tracks])}")

    def task(self, env: str) -> Task:
        """The task by its full id or its short name; ConfigurationError with the nearest name when there is none."""
        for task in self.tasks:
            if env in (task.env, task.short):
                return task
        raise ConfigurationError(f"the protocol has no task '{env}'; {nearest(env, [t.env for t in self.tasks])}")

    def seeds(self, episodes: int) -> tuple[int, ...]:
        """The test seeds of a cell: the same for every policy, task and track."""
        return tuple(self.test.seed(i) for i in range(episodes))

    def cells(self, tasks: tuple[str, ...] = (), tracks: tuple[str, ...] = ()) -> tuple[Cell, ...]:
        """Every condition to evaluate.

        Parameters
        ----------
        tasks : tuple of str
            Ids or short names; empty: all tasks.
        tracks : tuple of str
            Names; empty: the tracks that the protocol runs unless asked otherwise.

        Returns
        -------
        tuple of Cell
            Track by track; a track with sweeps has one cell for each swept value.

        Raises
        ------
        ConfigurationError
            For a task or track that the protocol does not have, with the nearest name.
        """
        chosen = [self.task(t) for t in tasks] or list(self.tasks)
        names = tracks or self.run or tuple(t.name for t in self.tracks)
        cells = []
        for track in map(self.track, names):
            episodes = track.episodes or self.episodes
            for task in chosen:
                if not track.sweeps:
                    cells.append(Cell(task, track, episodes))
                for sweep in track.sweeps:
                    if sweep.option or task.family in sweep.scale or task.family in sweep.add:
                        cells.extend(Cell(task, track, episodes, sweep, v) for v in sweep.values())
        return tuple(cells)


_KEYS = (
    "schema",
    "name",
    "version",
    "title",
    "note",
    "tasks",
    "tracks",
    "run",
    "seeds",
    "episodes",
    "training_seeds",
    "budgets",
    "score",
    "bootstrap",
)


def load_protocol(name: str | Path) -> Protocol:
    """A protocol by name, or from a file.

    Parameters
    ----------
    name : str or Path
        Name of a file in configs/protocols (quick, full, demo), or path of a YAML file.

    Returns
    -------
    Protocol

    Raises
    ------
    ConfigurationError
        For unknown names and keys (with the nearest), wrong values and overlapping ranges of seeds.

    Examples
    --------
    >>> protocol = load_protocol("quick")
    >>> protocol.episodes, len(protocol.cells(tracks=("nominal",)))
    (10, 8)
    """
    text = str(name)
    is_path = text.endswith((".yaml", ".yml")) and Path(text).exists()
    path = Path(text) if is_path else config_path("protocols", text.removesuffix(".yaml") + ".yaml")
    return parse_protocol(read_yaml(path), str(path.name))


def parse_protocol(data: Mapping[str, Any], source: str = "protocol") -> Protocol:
    """A checked protocol from the mapping of its YAML file.

    Parameters
    ----------
    data : mapping
        Content of the file; docs/read-the-board.md says what the keys mean.
    source : str
        What errors call it.

    Returns
    -------
    Protocol

    Raises
    ------
    ConfigurationError
        As `load_protocol`.
    """
    require_known(f"key in {source}", data, _KEYS)
    if data.get("schema") != SCHEMA:
        raise ConfigurationError(f"{source}: schema {data.get('schema')!r}; this version reads schema {SCHEMA}")
    for key in ("name", "tasks", "tracks", "seeds"):
        if not data.get(key):
            raise ConfigurationError(f"{source}: '{key}' is missing")
    budgets = _section(data, "budgets", ("environment_steps", "tuning_trials"), source)
    score = _section(data, "score", ("worst", "open_loop", "oracle", "paper"), source)
    bootstrap = _section(data, "bootstrap", ("resamples", "level", "seed"), source)
    protocol = Protocol(
        name=str(data["name"]),
        title=str(data.get("title", data["name"])),
        version=_count(data.get("version", 1), "version", source),
        note=" ".join(str(data.get("note", "")).split()),
        tasks=tuple(_task(t, source) for t in data["tasks"]),
        tracks=tuple(_track(n, t or {}, source) for n, t in data["tracks"].items()),
        run=tuple(data.get("run", ())),
        **_seeds(data["seeds"], source),
        episodes=_count(data.get("episodes", 10), "episodes", source),
        training_seeds=_count(data.get("training_seeds", 3), "training_seeds", source),
        environment_steps=_count(budgets.get("environment_steps", 0), "environment_steps", source, 0),
        tuning_trials=_count(budgets.get("tuning_trials", 0), "tuning_trials", source, 0),
        worst_score=_number(score.get("worst", -1.0), "score.worst", source),
        open_loop=str(score.get("open_loop", "open-loop")),
        oracle=str(score.get("oracle", "oracle")),
        paper=dict(score.get("paper", {})),
        resamples=_count(bootstrap.get("resamples", 2000), "bootstrap.resamples", source),
        level=_number(bootstrap.get("level", 0.95), "bootstrap.level", source),
        bootstrap_seed=_count(bootstrap.get("seed", 0), "bootstrap.seed", source, 0),
    )
    return _check(protocol, source)


def _check(protocol: Protocol, source: str) -> Protocol:
    if protocol.worst_score >= 0:
        raise ConfigurationError(f"{source}: score.worst = {protocol.worst_score:g} must be below 0 (the open loop)")
    if not 0 < protocol.level < 1:
        raise ConfigurationError(f"{source}: bootstrap.level = {protocol.level:g} must lie between 0 and 1")
    for name in protocol.run:
        protocol.track(name)
    ids = [t.env for t in protocol.tasks]
    for env in ids:
        if ids.count(env) > 1:
            raise ConfigurationError(f"{source}: task '{env}' is listed twice")
    most = max([protocol.episodes, *(t.episodes for t in protocol.tracks)])
    protocol.seeds(most)
    return protocol


def _section(data: Mapping[str, Any], name: str, keys: tuple[str, ...], source: str) -> Mapping[str, Any]:
    section = data.get(name) or {}
    if not isinstance(section, Mapping):
        raise ConfigurationError(f"{source}: '{name}' must be a mapping with keys {', '.join(keys)}")
    require_known(f"key under '{name}' in {source}", section, keys)
    return section


def _count(value: Any, name: str, source: str, least: int = 1) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or value < least:
        raise ConfigurationError(f"{source}: {name} = {value!r}; expected a whole number of at least {least}")
    return value


def _number(value: Any, name: str, source: str) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        raise ConfigurationError(f"{source}: {name} = {value!r}; expected a number")
    return float(value)


def _seeds(data: Mapping[str, Any], source: str) -> dict[str, SeedRange]:
    kinds = ("train", "tune", "test")
    require_known(f"key under 'seeds' in {source}", data, kinds)
    ranges = {}
    for kind in kinds:
        given = data.get(kind)
        if not isinstance(given, Mapping):
            raise ConfigurationError(f"{source}: seeds.{kind} must be a mapping with 'first' and 'count'")
        require_known(f"key under 'seeds.{kind}' in {source}", given, ("first", "count"))
        first = _count(given.get("first"), f"seeds.{kind}.first", source, 0)
        ranges[kind] = SeedRange(first, _count(given.get("count"), f"seeds.{kind}.count", source))
    ordered = sorted(ranges.items(), key=lambda item: item[1].first)
    for (name, a), (other, b) in itertools.pairwise(ordered):
        if b.first in a:
            raise ConfigurationError(f"{source}: seeds.{name} and seeds.{other} overlap; they must be disjoint")
    return ranges


def _task(data: Any, source: str) -> Task:
    if isinstance(data, str):
        return Task(data)
    if not isinstance(data, Mapping) or "env" not in data:
        raise ConfigurationError(f"{source}: a task is an environment id or a mapping with 'env', not {data!r}")
    require_known(f"key in a task of {source}", data, ("env", "options"))
    return Task(str(data["env"]), dict(data.get("options") or {}))


def _track(name: str, data: Mapping[str, Any], source: str) -> Track:
    require_known(f"key in track '{name}' of {source}", data, ("options", "episodes", "sweeps"))
    sweeps = tuple(_sweep(n, s, f"{source}, track '{name}'") for n, s in (data.get("sweeps") or {}).items())
    episodes = _count(data.get("episodes", 0), f"tracks.{name}.episodes", source, 0)
    return Track(str(name), dict(data.get("options") or {}), episodes, sweeps)


def _sweep(name: str, data: Mapping[str, Any], source: str) -> Sweep:
    keys = ("from", "to", "points", "scale", "add", "option", "integer", "unit")
    require_known(f"key in sweep '{name}' of {source}", data, keys)
    if sum(bool(data.get(key)) for key in ("scale", "add", "option")) != 1:
        raise ConfigurationError(f"{source}: sweep '{name}' needs one of 'scale', 'add' (rig parameters) and 'option'")
    add = {
        str(mechanism): {n: _number(v, f"{name}.add.{mechanism}.{n}", source) for n, v in sizes.items()}
        for mechanism, sizes in (data.get("add") or {}).items()
    }
    return Sweep(
        name=str(name),
        low=_number(data.get("from"), f"{name}.from", source),
        high=_number(data.get("to"), f"{name}.to", source),
        points=_count(data.get("points", 21), f"{name}.points", source, 2),
        scale={str(k): tuple(v) for k, v in (data.get("scale") or {}).items()},
        add=add,
        option=str(data.get("option", "")),
        integer=bool(data.get("integer", False)),
        unit=str(data.get("unit", "1")),
    )
