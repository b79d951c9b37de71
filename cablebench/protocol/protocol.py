"""The benchmark protocol as data: tasks, tracks, seeds, episodes, budgets."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from cable_envs.core.config import configuration_hash
from cable_envs.core.errors import ConfigurationError, nearest
from cable_envs.sim.registered import setup_of
from cable_envs.sim.setup import Setup
from cable_envs.sim.stepsize import substeps_for
from cablebench.protocol.seal import drawn_seeds

PUSH: Mapping[str, Any] = {"kind": "random_steps", "hold": 1.0}
"""Signal of a swept disturbance: a force or torque on the load, drawn anew every second, between its amplitudes."""


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
    ranked: bool = True
    """whether it counts in the tables over all tasks; else it is shown beside the ranking"""

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
    and what one unit of the value adds, SI), or pushes the load (`disturb`: by mechanism, amplitude for one unit of the
    value, in N or N m), or sets an environment option (`option`). A mechanism that is not named under `scale`, `add` or
    `disturb` is not swept.
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
    disturb: Mapping[str, float] = field(default_factory=dict)

    def concerns(self, family: str) -> bool:
        """Whether a mechanism is swept."""
        return bool(self.option) or any(family in names for names in (self.scale, self.add, self.disturb))

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
        """The environment's options: the task's, the track's, the swept one, and substeps if its rig needs more."""
        options = {**self.task.options, **self.track.options}
        if self.sweep is None:
            return options
        if self.sweep.option:
            options[self.sweep.option] = int(self.level) if self.sweep.integer else self.level
            return options
        setup = setup_of(self.task.env, options)
        changed = (self.reset_options(setup) or {}).get("rig")
        if changed:
            column = setup.rig.replace(changed).column(setup.plant)
            needed = substeps_for(setup.plant, column, setup.randomize, setup.control_period, None, setup.task.substeps)
            if needed > setup.substeps:
                options["substeps"] = needed
        return options

    def reset_options(self, setup: Setup) -> dict[str, Any] | None:
        """Options of every reset: rig parameters or disturbance as the sweep changes them; None where it changes none.

        Scaled parameters are held within their bounds. The entrant keeps the nominal ones.
        """
        if self.sweep is None or self.sweep.option:
            return None
        if self.sweep.disturb:
            return {"disturbance": {**PUSH, "amplitude": self.sweep.disturb[self.task.family] * self.level}}
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
    """raised when the same name comes to mean other episodes or scores"""
    episodes_since: int = 0
    """the version from which on the episodes are the same, so that records since then are ranked; 0: this one. Later
    versions differ in what is made of records, as their anchors"""
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
    score_version: int = 0
    """0: linear between the references' errors on the same episode; 1: logarithmic between frozen anchors"""
    anchors: str = ""
    """of score version 1: name of a file in configs/anchors, or path of a YAML file"""
    survival: float = 0.1
    """of score version 1: a sweep's value is survived where no failure rule is broken and the score is above this"""
    resamples: int = 2000
    level: float = 0.95
    bootstrap_seed: int = 0
    seal: str = ""
    """commitment of a sealed exam (`cablebench.protocol.seal`): its test seeds are drawn from the secret alone"""
    secret: str = field(default="", repr=False)
    """of a sealed exam, where it is known"""

    def hash(self) -> str:
        """Twelve hex digits of the SHA-256 over everything above that changes a number.

        Title, note and a sealed exam's secret are left out, and where the score is of version 0 what only later
        versions have. Of versions with the same episodes the first counts.
        """
        out = ("title", "note", "secret", *(() if self.seal else ("seal",)))
        if self.score_version == 0:
            out += ("score_version", "anchors", "survival")
        decides = {k: v for k, v in asdict(self).items() if k not in out}
        decides["version"] = decides.pop("episodes_since") or self.version
        for task in decides["tasks"]:
            del task["ranked"]  # no episode and no score depends on it
        for sweep in (sweep for track in decides["tracks"] for sweep in track["sweeps"]):
            if not sweep["disturb"]:
                del sweep["disturb"]
        return configuration_hash(decides)

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
        """The test seeds of a cell: the same for every policy, task and track.

        Raises ConfigurationError where they are sealed and the secret is not known.
        """
        if not self.seal:
            return tuple(self.test.seed(i) for i in range(episodes))
        if not self.secret:
            raise ConfigurationError(
                f"'{self.name}' is sealed: its test episodes are drawn from a secret (--seal FILE), which is published "
                "after the deadline"
            )
        taken = (self.train, self.tune, self.test)
        return drawn_seeds(self.secret, self.hash(), episodes, lambda seed: any(seed in range_ for range_ in taken))

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
                    if sweep.concerns(task.family):
                        cells.extend(Cell(task, track, episodes, sweep, v) for v in sweep.values())
        return tuple(cells)
