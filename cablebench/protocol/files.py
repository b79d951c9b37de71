"""Protocols as YAML files in configs/protocols/: read, and checked key by key."""

import itertools
import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from cable_envs.core.config import config_path, read_yaml
from cable_envs.core.errors import ConfigurationError, require_known
from cable_envs.sim.file_options import check_options_of_file
from cablebench.protocol.protocol import Protocol, SeedRange, Sweep, Task, Track

SCHEMA = 1

SCORE_VERSIONS = (0, 1)
"""Of the score: 0 is that of suite v0 (`cablebench.board.scoring`), 1 has anchors (`cablebench.score.log_score`)."""

_SCORE_KEYS = ("version", "worst", "open_loop", "oracle", "paper", "anchors", "survival")

_KEYS = (
    "schema",
    "name",
    "version",
    "episodes_since",
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
    "seal",
)


def load_protocol(name: str | Path, called: str = "protocol") -> Protocol:
    """A protocol by name, or from a file.

    Parameters
    ----------
    name : str or Path
        Name of a file in configs/protocols (quick, full, demo), or path of a YAML file.
    called : str
        What an error about the name calls it: a board is named like its protocol.

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
    path = protocol_path(name, called)
    return parse_protocol(read_yaml(path), str(path.name))


def protocol_path(name: str | Path, called: str = "protocol") -> Path:
    """The file of a protocol: ``name`` itself, or that name in configs/protocols. Raises ConfigurationError."""
    text = str(name)
    is_path = text.endswith((".yaml", ".yml")) and Path(text).exists()
    return Path(text) if is_path else config_path("protocols", text.removesuffix(".yaml") + ".yaml", called)


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
    score = _section(data, "score", _SCORE_KEYS, source)
    bootstrap = _section(data, "bootstrap", ("resamples", "level", "seed"), source)
    protocol = Protocol(
        name=str(data["name"]),
        title=str(data.get("title", data["name"])),
        version=_count(data.get("version", 1), "version", source),
        episodes_since=_count(data.get("episodes_since", 0), "episodes_since", source, 0),
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
        score_version=_count(score.get("version", 0), "score.version", source, 0),
        anchors=str(score.get("anchors", "")),
        survival=_number(score.get("survival", 0.1), "score.survival", source),
        resamples=_count(bootstrap.get("resamples", 2000), "bootstrap.resamples", source),
        level=_number(bootstrap.get("level", 0.95), "bootstrap.level", source),
        bootstrap_seed=_count(bootstrap.get("seed", 0), "bootstrap.seed", source, 0),
        seal=_seal(data.get("seal"), source),
        secret="",
    )
    return _check(protocol, source)


def _check(protocol: Protocol, source: str) -> Protocol:
    if protocol.worst_score >= 0:
        raise ConfigurationError(f"{source}: score.worst = {protocol.worst_score:g} must be below 0 (the open loop)")
    if protocol.episodes_since > protocol.version:
        raise ConfigurationError(
            f"{source}: episodes_since = {protocol.episodes_since} is later than version {protocol.version}"
        )
    if not 0 < protocol.level < 1:
        raise ConfigurationError(f"{source}: bootstrap.level = {protocol.level:g} must lie between 0 and 1")
    if protocol.score_version not in SCORE_VERSIONS:
        raise ConfigurationError(
            f"{source}: score.version = {protocol.score_version}; there are {' and '.join(map(str, SCORE_VERSIONS))}"
        )
    if bool(protocol.anchors) != (protocol.score_version > 0):
        raise ConfigurationError(
            f"{source}: score.anchors names the frozen anchors of score version 1; this is version "
            f"{protocol.score_version}, and 'anchors' is '{protocol.anchors}'"
        )
    for name in protocol.run:
        protocol.track(name)
    ids = [t.env for t in protocol.tasks]
    for env in ids:
        if ids.count(env) > 1:
            raise ConfigurationError(f"{source}: task '{env}' is listed twice")
    most = max([protocol.episodes, *(t.episodes for t in protocol.tracks)])
    if not protocol.seal:
        protocol.seeds(most)
    return protocol


def _seal(value: Any, source: str) -> str:
    if value is not None and not (isinstance(value, str) and re.fullmatch("[0-9a-f]{64}", value)):
        raise ConfigurationError(f"{source}: seal = {value!r}; expected the 64 hexadecimal digits of a SHA-256")
    return value or ""


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
    require_known(f"key in a task of {source}", data, ("env", "options", "ranked"))
    ranked = data.get("ranked", True)
    if not isinstance(ranked, bool):
        raise ConfigurationError(f"{source}, task '{data['env']}': ranked = {ranked!r}; expected true or false")
    return Task(str(data["env"]), _options(data, f"{source}, task '{data['env']}'"), ranked)


def _options(data: Mapping[str, Any], place: str) -> dict[str, Any]:
    """Environment options of a task or track; none of them may lead to code being run."""
    options = data.get("options") or {}
    check_options_of_file(options, place)
    return dict(options)


def _track(name: str, data: Mapping[str, Any], source: str) -> Track:
    require_known(f"key in track '{name}' of {source}", data, ("options", "episodes", "sweeps"))
    sweeps = tuple(_sweep(n, s, f"{source}, track '{name}'") for n, s in (data.get("sweeps") or {}).items())
    episodes = _count(data.get("episodes", 0), f"tracks.{name}.episodes", source, 0)
    return Track(str(name), _options(data, f"{source}, track '{name}'"), episodes, sweeps)


def _sweep(name: str, data: Mapping[str, Any], source: str) -> Sweep:
    keys = ("from", "to", "points", "scale", "add", "disturb", "option", "integer", "unit")
    require_known(f"key in sweep '{name}' of {source}", data, keys)
    if sum(bool(data.get(key)) for key in ("scale", "add", "disturb", "option")) != 1:
        raise ConfigurationError(
            f"{source}: sweep '{name}' needs one of 'scale', 'add' (rig parameters), 'disturb' (the load) and 'option'"
        )
    if data.get("option"):
        check_options_of_file({data["option"]: None}, f"sweep '{name}' of {source}")
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
        disturb={str(k): _number(v, f"{name}.disturb.{k}", source) for k, v in (data.get("disturb") or {}).items()},
    )
