"""Names and options as they stand on the command line."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import yaml

from cable_envs.core.errors import ConfigurationError, nearest, require_known
from cable_envs.core.files import permit

ENVIRONMENT_OPTIONS = (
    "rig", "effects", "effect_file", "plant", "action_mode", "observe", "reference", "randomize", "sensor_noise",
    "sensor_delay", "action_delay", "disturbance", "posture", "control_period", "substeps", "duration", "split",
    "sensors", "preview",
)  # fmt: skip
"""Options of an environment that ``--option KEY=VALUE`` may set (see `cable_envs.envs.CableEnv`)."""


def resolve_env(name: str, every_version: bool = False) -> str:
    """The full id for a full or short one (``CableHole-Position-Sine``); ConfigurationError with the nearest name.

    A name without a version is one of the ids of boards and tuned entrants, or that of a task that is newer. With
    ``every_version`` a name may also say another version.
    """
    from cable_envs import FIRST_IDS, SUITE_IDS, V1_IDS

    for env_id in (*FIRST_IDS, *SUITE_IDS, *(V1_IDS if every_version else ())):
        if name in (env_id, env_id.split("/")[1], short_name(env_id)):
            return env_id
    if any(name in (env_id, env_id.split("/")[1]) for env_id in V1_IDS):
        raise ConfigurationError(
            f"'{name}': boards, tuned gains and trained agents are for -v0; write {short_name(name)}"
        )
    raise ConfigurationError(f"unknown environment '{name}'; {nearest(name, map(short_name, FIRST_IDS + SUITE_IDS))}")


def resolve_task(protocol: Any, name: str) -> str:
    """The id of a protocol's task by its full or short name, whatever its version; else as `resolve_env`."""
    for task in protocol.tasks:
        if name in (task.env, task.env.split("/")[-1], task.short):
            return str(task.env)
    return resolve_env(name)


def short_name(env_id: str) -> str:
    """The id without namespace and version."""
    return env_id.split("/")[-1].rsplit("-v", 1)[0]


def parse_options(pairs: Sequence[str]) -> dict[str, Any]:
    """``["randomize=true", "rig={load_mass: 4}"]`` as keyword arguments of an environment; values are YAML."""
    options = parse_pairs(pairs, "--option")
    for key, value in options.items():
        option, dot, parameter = key.partition(".")
        if dot and option in ENVIRONMENT_OPTIONS:
            raise ConfigurationError(
                f"--option {key}: write what belongs to '{option}' in braces: -o '{option}={{{parameter}: {value}}}'"
            )
    require_known("environment option", options, ENVIRONMENT_OPTIONS)
    effect = Path(str(options.get("effect_file", "")))
    if effect.is_file():
        permit(effect, effect.read_bytes())  # here, once: the file may be executed in other processes only
    return options


def parse_gains(pairs: Sequence[str]) -> dict[str, float]:
    """``["kp=3000"]`` as numbers by name."""
    gains = parse_pairs(pairs, "--gain")
    for name, value in gains.items():
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            raise ConfigurationError(f"--gain {name}: expected a number, got {value!r}")
    return {name: float(value) for name, value in gains.items()}


def parse_pairs(pairs: Sequence[str], flag: str) -> dict[str, Any]:
    """``KEY=VALUE`` strings as a mapping, each value read as YAML (1e-3 counts as a number)."""
    found: dict[str, Any] = {}
    for pair in pairs:
        key, equals, text = pair.partition("=")
        if not equals or not key:
            raise ConfigurationError(f"{flag} expects KEY=VALUE, got '{pair}'")
        if key in found:
            raise ConfigurationError(f"{flag} {key} is given twice")
        try:
            value = yaml.safe_load(text)
        except yaml.YAMLError as error:
            said = " ".join(str(error).split())
            raise ConfigurationError(f"{flag} {key}: '{text}' is not valid YAML: {said}") from error
        if isinstance(value, str):
            with suppress(ValueError):  # YAML 1.1 takes 1e-3 for a string
                value = float(value)
        found[key] = value
    return found


def options_for(entrant: Any, env_id: str, options: Mapping[str, Any]) -> dict[str, Any]:
    """``options`` and those that the entrant needs. Raises ConfigurationError where it does not apply or they clash."""
    from cable_envs.sim.registered import setup_of

    setup = setup_of(env_id, options)
    needs = entrant.needs(env_id, setup)
    if needs is None:
        mode = setup.action_mode
        if mode.of and entrant.needs(env_id, setup_of(env_id, {**options, "action_mode": mode.of})) is not None:
            raise ConfigurationError(
                f"'{entrant.title}' gives one command, and the action mode {mode.name} takes two; give it "
                f"-o action_mode={mode.of}, where the second stays at rest"
            )
        entered = [short_name(env) for env in entrant.entered()]
        where = (
            "with these options" if short_name(env_id) in entered else f"it enters {', '.join(entered) or 'no task'}"
        )
        raise ConfigurationError(f"'{entrant.title}' does not apply to {short_name(env_id)}: {where}")
    for key, value in needs.items():
        if options.get(key, value) != value:
            raise ConfigurationError(f"'{entrant.title}' needs {key}={value}, not {options[key]}")
    return {**options, **needs}
