"""Entrants by the names that people give them: reference controllers, controller files, .py files."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from cable_envs.core.errors import ConfigurationError, nearest
from cablebench.entrants.apart import submission_entrant
from cablebench.entrants.compositions import composition_entrant, is_composition, shipped_compositions
from cablebench.entrants.controller_files import FOLDER, controller_file_entrant, shipped_files
from cablebench.entrants.entrant import Entrant, controller_entrant
from cablebench.protocol.protocol import Protocol

SUITE = "-suite"
"""How the files of gains for suite v1 end (configs/controllers)."""


def reference_entrants(names: Sequence[str] = ()) -> tuple[Entrant, ...]:
    """The reference controllers with their default gains, or those that `named_entrant` finds for ``names``."""
    from cable_envs.baselines import CONTROLLERS

    return tuple(map(named_entrant, names or CONTROLLERS))


def prepared_entrants(protocol: Protocol) -> tuple[Entrant, ...]:
    """The reference controllers that enter a protocol, with the gains found for suite v1 where its tasks have some."""
    from cable_envs.baselines import CONTROLLERS

    files = [name for name in shipped_files() if name.endswith(SUITE)]
    found = entering(reference_entrants([*CONTROLLERS, *files]), protocol)
    better = {e.name for e in found}
    return tuple(e for e in found if e.name + SUITE not in better)


def entering(
    entrants: Iterable[Entrant], protocol: Protocol, tasks: tuple[str, ...] = (), tracks: tuple[str, ...] = ()
) -> tuple[Entrant, ...]:
    """Those of the entrants that enter at least one of a protocol's tasks."""
    options = {(c.task.env, c.track.name): c.environment_options() for c in protocol.cells(tasks, tracks)}
    return tuple(e for e in entrants if any(e.enters(env, o) is not None for (env, _), o in options.items()))


def named_entrant(name: str, gains: Mapping[str, float] | None = None, sandbox: str = "auto") -> Entrant:
    """What ``--controller NAME`` means: a reference controller, a controller file, a composition, or a .py file.

    A YAML file is named by its path or, in configs/controllers and configs/compositions, by its name; naming a .py
    file executes it, within ``sandbox``. ``gains`` are for reference controllers only. Raises ConfigurationError with
    the nearest name.
    """
    from cable_envs.baselines import CONTROLLERS

    if name in CONTROLLERS:
        return controller_entrant(name, gains)
    suffix = Path(name).suffix
    if suffix not in (".py", ".yaml", ".yml") and name not in (*shipped_files(), *shipped_compositions()):
        known = [*CONTROLLERS, *shipped_files(), *shipped_compositions()]
        raise ConfigurationError(f"unknown controller '{name}'; {nearest(name, known)}; or a file (.yaml, .py)")
    if gains:
        raise ConfigurationError(f"gains of '{name}' belong into its file (configs/{FOLDER} has examples)")
    if suffix == ".py":
        return submission_entrant(name, sandbox)
    if name in shipped_compositions() or is_composition(name):
        return composition_entrant(name)
    return controller_file_entrant(name, sandbox)
