"""Compositions: several controller files that take part as one entrant, so that it can enter all tasks of a suite.

```yaml
schema: cable-composition/1
name: suite-references        # as on the board
of: [adaptive-inverse-suite, camera-jaw-suite]     # names in configs/controllers, or YAML files beside this one
```

A task is played by the first of the files that has gains for it. In each episode this is one controller with its own
gains; which one it is depends on the task alone. The entrant is charged with, and told, the most that one of its files
is.
"""

import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from cable_envs.core.config import config_path, config_root, read_yaml
from cable_envs.core.errors import ConfigurationError, require_known
from cable_envs.sim.registered import setup_of
from cable_envs.sim.setup import Setup
from cablebench.entrants.controller_files import case_of, controller_file_entrant, load_controller_file
from cablebench.entrants.controller_files import find_controller_file as find
from cablebench.entrants.entrant import INFORMATION, Entrant
from cablebench.protocol.actors import Actor

SCHEMA = "cable-composition/1"
FOLDER = "compositions"
_KEYS = ("schema", "name", "of", "note")


def shipped_compositions() -> tuple[str, ...]:
    """Names of the files in configs/compositions/."""
    return tuple(sorted(p.stem for p in (config_root() / FOLDER).glob("*.yaml")))


def is_composition(path: str | Path) -> bool:
    """Whether a YAML file, if there is one at this path, says that it is a composition."""
    return Path(path).is_file() and read_yaml(path).get("schema") == SCHEMA


def composition_entrant(path_or_name: str | Path) -> Entrant:
    """The entrant of a composition.

    Parameters
    ----------
    path_or_name : str or Path
        A YAML file, or a name in configs/compositions.

    Returns
    -------
    Entrant

    Raises
    ------
    ConfigurationError
        For unknown keys and names, for a file without gains, and for one that is not the first of any task.

    Examples
    --------
    >>> entrant = composition_entrant("suite-references")
    >>> entrant.enters("cable_envs/PulleyCircuit-Grasp-Medium-v1", {"split": "test"})["observe"]
    'drive'
    """
    shipped = str(path_or_name) in shipped_compositions()
    path = config_path(FOLDER, f"{path_or_name}.yaml") if shipped else Path(path_or_name)
    data = read_yaml(path)
    require_known(f"key in {path}", data, _KEYS)
    name, of = data.get("name"), data.get("of")
    if data.get("schema") != SCHEMA or not isinstance(name, str) or not name.strip():
        found = f"{data.get('schema')!r} and {name!r}"
        raise ConfigurationError(f"{path}: expected schema '{SCHEMA}' and a 'name', found {found}")
    if not isinstance(of, list) or not of or not all(isinstance(one, str) for one in of):
        raise ConfigurationError(f"{path}: 'of' must list controller files, found {of!r}")
    parts = {one: _part(path, one) for one in of}
    by_env: dict[str, str] = {}
    for one in of:
        for env in load_controller_file(_file(path, one)).gains:
            by_env.setdefault(env, one)
    if idle := [one for one in of if one not in by_env.values()]:
        raise ConfigurationError(f"{path}: {', '.join(idle)} plays no task: the files before have gains for all of its")
    by_case = {case_of(setup_of(env, {})): one for env, one in by_env.items()}

    def needs(env_id: str, setup: Setup) -> Mapping[str, Any] | None:
        return parts[by_env[env_id]].needs(env_id, setup) if env_id in by_env else None

    def make(setup: Setup) -> Actor:
        case = case_of(setup)
        if case not in by_case:
            raise ConfigurationError(f"'{name}' does not enter {' '.join(case)}; it enters {', '.join(sorted(by_env))}")
        return parts[by_case[case]].make(setup)

    charged: dict[str, float] = {}
    for part in parts.values():
        charged |= {budget: max(amount, charged.get(budget, 0)) for budget, amount in part.charged.items()}
    return Entrant(
        name.strip(), max((part.information for part in parts.values()), key=INFORMATION.index), make, needs,
        f"--controller {shlex.quote(str(path_or_name if shipped else path))}",
        charged=charged,
        settings={"of": {one: dict(part.settings) for one, part in parts.items()}},
    )  # fmt: skip


def _file(path: Path, name: str) -> Path:
    return find(path.parent / name if Path(name).suffix else name)


def _part(path: Path, name: str) -> Entrant:
    """The entrant of one of the files, which may not be a .py file: that is run in a process of its own."""
    file = load_controller_file(_file(path, name))
    if not file.gains or file.controller.endswith(".py"):
        raise ConfigurationError(f"{path}: {name} must be gains of a reference controller, found {file.controller}")
    return controller_file_entrant(_file(path, name))
