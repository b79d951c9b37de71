"""Controller files: gains that somebody tuned for a controller, with what the tuning cost; one YAML file each.

```yaml
schema: cable-controller/1
name: pid-tuned               # as on the board
controller: pid               # a reference controller, or a .py file beside this one
information: model-free       # optional; not less than what the controller declares
charged: {tuning_trials: 40}
gains:
  cable_envs/CableHole-Position-Step-v0: {kp: 3000.0, ki: 20000.0}
made_by: cablebench tune --controller pid --env CableHole-Position-Step --trials 40
```

A controller enters only the tasks that it has gains for; without ``gains``, which only a .py file may leave out, those
that the .py file enters.
"""

import shlex
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from cable_envs.core.config import config_path, config_root, read_yaml
from cable_envs.core.errors import ConfigurationError, nearest, require_known
from cable_envs.core.params import is_number
from cable_envs.sim.setup import Setup
from cablebench.entrants.entrant import BUDGETS, INFORMATION, Entrant
from cablebench.protocol.actors import Actor, ControllerActor
from cablebench.protocol.protocol import Task

SCHEMA = "cable-controller/1"
FOLDER = "controllers"
_KEYS = ("schema", "name", "controller", "information", "charged", "gains", "made_by", "note")


@dataclass(frozen=True)
class ControllerFile:
    """The checked content of a controller file."""

    name: str
    controller: str
    gains: Mapping[str, Mapping[str, float]]
    """environment id -> gain -> value"""
    information: str = ""
    """empty: what the controller declares"""
    charged: Mapping[str, float] = field(default_factory=dict)
    made_by: str = ""


def shipped_files() -> tuple[str, ...]:
    """Names of the controller files in configs/controllers/."""
    return tuple(sorted(p.stem for p in (config_root() / FOLDER).glob("*.yaml")))


def find_controller_file(name: str | Path) -> Path:
    """The file at a path, or configs/controllers/<name>.yaml; ConfigurationError with the nearest name."""
    path = Path(name)
    if path.suffix in (".yaml", ".yml"):
        if not path.is_file():
            raise ConfigurationError(f"no controller file at {path}")
        return path
    return config_path(FOLDER, f"{name}.yaml")


def load_controller_file(path: str | Path) -> ControllerFile:
    """Read and check a controller file; gains are checked by name when the controller is made.

    Raises ConfigurationError that names the file and the key.
    """
    import cable_envs

    path = Path(path)
    data = read_yaml(path)
    require_known(f"key in {path}", data, _KEYS)
    if data.get("schema") != SCHEMA:
        raise ConfigurationError(f"{path}: schema {data.get('schema')!r}; expected '{SCHEMA}'")
    for key in ("name", "controller"):
        if not isinstance(data.get(key), str) or not data[key].strip():
            raise ConfigurationError(f"{path}: '{key}' must be a text, found {data.get(key)!r}")
    gains = data.get("gains")
    if gains is None and data["controller"].endswith(".py"):
        gains = {}
    elif not isinstance(gains, Mapping) or not gains:
        raise ConfigurationError(f"{path}: 'gains' must map environment ids to gains, found {gains!r}")
    known = cable_envs.ENV_IDS + cable_envs.SUITE_IDS
    by_short = {Task(env).short: env for env in known}
    resolved = {by_short.get(str(env), str(env)): _gains(path, str(env), values) for env, values in gains.items()}
    require_known(f"environment under 'gains' in {path}", resolved, known)
    information = str(data.get("information") or "")
    require_known(f"information class in {path}", [information] if information else [], INFORMATION)
    charged = data.get("charged") or {}
    if not isinstance(charged, Mapping):
        raise ConfigurationError(f"{path}: 'charged' must map {', '.join(BUDGETS)} to numbers, found {charged!r}")
    require_known(f"budget in {path}", charged, BUDGETS)
    for key, value in charged.items():
        if not is_number(value) or value < 0:
            raise ConfigurationError(f"{path}: charged.{key} = {value!r}; expected a number of at least 0")
    made_by = str(data.get("made_by", ""))
    return ControllerFile(data["name"].strip(), data["controller"], resolved, information, dict(charged), made_by)


def _gains(path: Path, env: str, values: Any) -> dict[str, float]:
    if values is None:
        return {}
    if not isinstance(values, Mapping):
        raise ConfigurationError(f"{path}: gains of {env} must map names to numbers, found {values!r}")
    for name, value in values.items():
        if not is_number(value):
            raise ConfigurationError(f"{path}: gain {name} of {env} = {value!r}; expected a number")
    return {str(k): float(v) for k, v in values.items()}


def controller_file_entrant(path_or_name: str | Path, sandbox: str = "auto") -> Entrant:
    """The entrant of a controller file: a path, or a name in configs/controllers/.

    Raises ConfigurationError for whatever is wrong in the file: keys, gains by name and bounds (the nearest named), a
    controller that does not apply to a task, an information class better than the controller's own.
    """
    path = find_controller_file(path_or_name)
    file = load_controller_file(path)
    kind = _kind(path, file.controller, file.gains, sandbox)
    derived = getattr(kind, "derived", True)  # from `baselines.Controller`
    information = file.information or kind.information
    if INFORMATION.index(information) < INFORMATION.index(kind.information):
        raise ConfigurationError(
            f"{path}: information '{information}', but {file.controller} is told more: '{kind.information}'"
        )
    gains = {_case_of(env): values for env, values in file.gains.items()}
    for env in file.gains:
        _check(path, kind, env, gains)

    def needs(env_id: str, setup: Setup) -> Mapping[str, Any] | None:
        if not file.gains:
            return kind.needs(env_id, setup)
        if env_id not in file.gains:
            return None
        return {"observe": kind.levels[setup.plant.name]} if derived else kind.choices(setup)

    def make(setup: Setup) -> Actor:
        case = (setup.plant.name, setup.action_mode.name, setup.task.kind)
        controller = kind(*case, setup.rig.values, setup.control_period, **_chosen(gains, setup))
        return ControllerActor(controller, setup) if derived else kind.actor(controller, setup)

    shipped = str(path_or_name) in shipped_files()
    settings = {"controller": file.controller, "gains": dict(file.gains)}
    if source := getattr(kind, "source_hash", ""):
        settings["source"] = source
    return Entrant(
        file.name, information, make, needs,
        f"--controller {shlex.quote(str(path_or_name if shipped else path))}",
        charged={**getattr(kind, "charged", {}), **file.charged},
        settings=settings,
        sandbox=getattr(kind, "sandbox", ""),
    )  # fmt: skip


def _kind(path: Path, controller: str, gains: Mapping[str, Any], sandbox: str) -> Any:
    """The controller's class: by name among the references, or from a .py file beside the YAML file."""
    from cable_envs.baselines import CONTROLLERS

    if controller.endswith(".py"):
        from cablebench.entrants.apart import controller_kind

        kind = controller_kind(path.parent / controller, sandbox)
        if not gains and kind.derived:
            raise ConfigurationError(f"{path}: 'gains' must say which environments {controller} enters")
        return kind
    if controller not in CONTROLLERS:
        raise ConfigurationError(f"{path}: unknown controller '{controller}'; {nearest(controller, CONTROLLERS)}")
    return CONTROLLERS[controller]


def _check(path: Path, kind: Any, env: str, gains: Mapping[tuple[str, str], Mapping[str, float]]) -> None:
    """Make the controller once for ``env``: it says itself what does not fit."""
    from cable_envs.sim.registered import setup_of

    setup = setup_of(env, {})
    case = (setup.plant.name, setup.action_mode.name, setup.task.kind)
    try:
        kind(*case, setup.rig.values, setup.control_period, **gains[_case_of(env)])
    except ConfigurationError as error:
        raise ConfigurationError(f"{path}, {env}: {error}") from None


def _case_of(env: str) -> tuple[str, str]:
    """`case_of` an environment id."""
    from cable_envs.sim.registered import setup_of

    return case_of(setup_of(env, {}))


def case_of(setup: Setup) -> tuple[str, str]:
    """What a setup shows of its environment id: the task, and its level or whether the reference is a step."""
    if setup.conditions is not None:
        return setup.task.name, setup.conditions.level
    return setup.task.name, "step" if setup.reference.get("kind") == "step" else ""


def _chosen(gains: Mapping[tuple[str, str], Mapping[str, float]], setup: Setup) -> Mapping[str, float]:
    """The gains for a setup; under another kind of reference than tuned for, those of the same task."""
    if not gains:
        return {}
    case = case_of(setup)
    same_task = [values for (task, _), values in gains.items() if task == setup.task.name]
    if case not in gains and not same_task:
        raise ConfigurationError(f"no gains for {setup.task.name}; there are gains for {sorted({t for t, _ in gains})}")
    return gains.get(case) or same_task[0]
