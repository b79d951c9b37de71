"""Entrants by the names that people give them: reference controllers, controller files, .py files."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from cable_envs.core.errors import ConfigurationError, nearest
from cablebench.entrants.apart import submission_entrant
from cablebench.entrants.controller_files import FOLDER, controller_file_entrant, shipped_files
from cablebench.entrants.entrant import Entrant, controller_entrant
from cablebench.protocol.protocol import Protocol


def reference_entrants(names: Sequence[str] = (), protocol: Protocol | None = None) -> tuple[Entrant, ...]:
    """The reference controllers with their default gains, or those that `named_entrant` finds for ``names``.

    With a protocol, and without names, only those that enter one of its tasks: some are made for the sensors of a few.
    """
    from cable_envs.baselines import CONTROLLERS

    found = tuple(map(named_entrant, names or CONTROLLERS))
    if names or protocol is None:
        return found
    cells = protocol.cells((), ())
    return tuple(e for e in found if any(e.enters(c.task.env, c.environment_options()) is not None for c in cells))


def named_entrant(name: str, gains: Mapping[str, float] | None = None, sandbox: str = "auto") -> Entrant:
    """What ``--controller NAME`` means: a reference controller, a controller file, or a .py file.

    A controller file is named by its path or, in configs/controllers/, without folder and suffix; naming a .py file
    executes it, within ``sandbox``. ``gains`` are for reference controllers only. Raises ConfigurationError with the
    nearest name.
    """
    from cable_envs.baselines import CONTROLLERS

    if name in CONTROLLERS:
        return controller_entrant(name, gains)
    suffix = Path(name).suffix
    if suffix not in (".py", ".yaml", ".yml") and name not in shipped_files():
        known = [*CONTROLLERS, *shipped_files()]
        raise ConfigurationError(f"unknown controller '{name}'; {nearest(name, known)}; or a file (.yaml, .py)")
    if gains:
        raise ConfigurationError(f"gains of '{name}' belong into its file (configs/{FOLDER} has examples)")
    if suffix == ".py":
        return submission_entrant(name, sandbox)
    return controller_file_entrant(name, sandbox)
