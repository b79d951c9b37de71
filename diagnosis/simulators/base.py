"""What every simulator can do: begin a run, take steps, and name itself; and how one is loaded from a file."""

import inspect
import sys
from collections.abc import Mapping
from functools import partial
from hashlib import sha256
from importlib import import_module
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from cable_envs.core.errors import ConfigurationError, nearest, require_known
from cable_envs.core.files import run_python
from cable_envs.diagnosis.simulators.declaration import Declaration

Columns = Mapping[str, np.ndarray]
"""Name -> array: [n] of parameters, [n, T] of what changes from step to step."""


class Session(Protocol):
    """A run of n columns that has begun."""

    first: Columns
    """outputs [n] when it begins"""

    def run(self, commands: Columns, forces: Columns) -> Columns:
        """Outputs [n, T] at the ends of the next T steps, with commands and forces [n, T] that act over each."""
        ...


class Simulator:
    """A simulator that can be diagnosed.

    Parameters
    ----------
    declaration : Declaration
        What it says of itself.
    workers : int
        Processes among which trials of parameters are shared. More than one needs a simulator that can be pickled: its
        functions lie in a file that can be imported.

    Attributes
    ----------
    terms : mapping of str to float
        Physics that was added at its ports, by row (`cable_envs.diagnosis.simulators.corrected`); empty by default.
    together : bool
        Whether a run takes many columns at once.
    """

    together = False

    def __init__(self, declaration: Declaration, workers: int = 1):
        if not isinstance(declaration, Declaration):
            raise ConfigurationError(f"a simulator needs a Declaration, got {type(declaration).__name__}")
        if not isinstance(workers, int) or workers < 1:
            raise ConfigurationError(f"workers must be a whole number from 1, got {workers!r}")
        self.declaration, self.workers = declaration, workers
        self.terms: Mapping[str, float] = {}

    def begin(self, parameters: Columns, first: Columns) -> Session:
        """Begin a run.

        Parameters
        ----------
        parameters : mapping of str to ndarray
            Every declared parameter [n], SI.
        first : mapping of str to ndarray
            Outputs that may be given at the start (`Output.starts`) [n], SI; those that are missing are the
            simulator's own.

        Returns
        -------
        Session
            At the start.
        """
        raise NotImplementedError(f"{type(self).__name__} does not say how a run begins")

    @property
    def inner(self) -> "Simulator":
        """The simulator without what was added at its ports."""
        return self

    def corrected(self, found: Any) -> "Simulator":
        """The simulator with what a diagnosis has named (`cable_envs.diagnosis.simulators.corrected.corrected`)."""
        made: Simulator = import_module("cable_envs.diagnosis.simulators.corrected").corrected(self, found)
        return made

    def plain(self) -> "Simulator":
        """The same without what was added at its ports, with its parameters."""
        return self

    def source(self) -> bytes:
        """What tells this simulator from another one with the same declaration."""
        return source_of(type(self))

    def digest(self) -> str:
        """Of its declaration, its terms and its text."""
        about = repr((type(self).__qualname__, self.declaration, sorted(self.terms.items())))
        return sha256(about.encode() + self.source()).hexdigest()[:16]

    def simulate(
        self,
        commands: Mapping[str, Any],
        parameters: Mapping[str, Any] | None = None,
        first: Mapping[str, Any] | None = None,
        forces: Mapping[str, Any] | None = None,
    ) -> dict[str, np.ndarray]:
        """Outputs of whole runs.

        Parameters
        ----------
        commands : mapping of str to array_like
            Every declared command, [T] or [n, T], SI: what acts over each step.
        parameters : mapping of str to array_like, optional
            Scalars or [n]; those that are missing are nominal.
        first : mapping of str to array_like, optional
            Scalars or [n]: outputs at the start.
        forces : mapping of str to array_like, optional
            Port -> [T] or [n, T], N or N m: what is added there.

        Returns
        -------
        dict of str to ndarray
            Every output [n, 1 + T], the first column at the start; [1 + T] where nothing that was given has columns.

        Raises
        ------
        ConfigurationError
            For names that are not declared, and for lengths that differ.

        Examples
        --------
        ::

            seen = cart.simulate({"force": np.ones(200)}, {"mass": 2.1}, {"position": 0.0})
            seen["position"]  # [201], m
        """
        plain, given = self.arranged(commands, parameters, first, forces)
        found = self.whole(*given)
        return {name: values[0] if plain else values for name, values in found.items()}

    def arranged(
        self, commands: Mapping[str, Any], parameters: Mapping[str, Any] | None, first: Mapping[str, Any] | None,
        forces: Mapping[str, Any] | None,
    ) -> tuple[bool, tuple[Columns, Columns, Columns, Columns]]:  # fmt: skip
        """(whether nothing has columns, commands, parameters, first and forces as columns)."""
        d = self.declaration
        parts = [dict(part or {}) for part in (commands, parameters, first, forces)]
        known = (
            [c.name for c in d.commands], [p.name for p in d.parameters], [o.name for o in d.outputs if o.starts],
            [p.name for p in d.ports],
        )  # fmt: skip
        for part, names, what in zip(
            parts, known, ("command", "parameter", "output at the start", "port"), strict=True
        ):
            require_known(f"{what} of {d.name}", part, names)
        lacking = [name for name in known[0] if name not in parts[0]]
        if lacking:
            raise ConfigurationError(f"{d.name} needs the command{'s' * (len(lacking) > 1)} {', '.join(lacking)}")
        series = {**parts[0], **{f"force {k}": v for k, v in parts[3].items()}}
        arrays = {k: np.asarray(v, dtype=float) for k, v in {**series, **parts[1], **parts[2]}.items()}
        plain = all(a.ndim == (1 if k in series else 0) for k, a in arrays.items())
        count = max((a.shape[0] for k, a in arrays.items() if a.ndim == (2 if k in series else 1)), default=1)
        steps = {arrays[k].shape[-1] for k in series if arrays[k].ndim}
        if len(steps) != 1:
            raise ConfigurationError(f"{d.name}: commands and forces must have one number of steps, got {steps}")
        (length,) = steps

        def wide(part: Mapping[str, Any], shape: tuple[int, ...], prefix: str = "") -> dict[str, np.ndarray]:
            return {k: np.broadcast_to(arrays[prefix + k], shape).copy() for k in part}

        numbers = {name: np.full(count, value) for name, value in d.nominal.items()} | wide(parts[1], (count,))
        runs, added = wide(parts[0], (count, length)), wide(parts[3], (count, length), "force ")
        return plain, (runs, numbers, wide(parts[2], (count,)), added)

    def whole(self, commands: Columns, parameters: Columns, first: Columns, forces: Columns) -> dict[str, np.ndarray]:
        """`simulate` of columns."""
        count, length = next(iter(commands.values())).shape
        full = {port.name: forces.get(port.name, np.zeros((count, length))) for port in self.declaration.ports}
        parts = [slice(0, count)] if self.together else [slice(k, k + 1) for k in range(count)]
        found: list[dict[str, np.ndarray]] = []
        for part in parts:
            session = self.begin(_cut(parameters, part), _cut(first, part))
            seen = session.run(_cut(commands, part), _cut(full, part))
            found.append({k: np.column_stack([session.first[k], seen[k]]) for k in seen})
        return {name: np.concatenate([one[name] for one in found]) for name in found[0]}


def _cut(columns: Columns, part: slice) -> dict[str, np.ndarray]:
    return {name: values[part] for name, values in columns.items()}


def source_of(thing: Any) -> bytes:
    """Text of the file in which a function or class is defined; its name where there is none."""
    while isinstance(thing, partial):
        thing = thing.func
    try:
        return Path(inspect.getfile(inspect.unwrap(thing))).read_bytes()
    except (TypeError, OSError):
        return repr(getattr(thing, "__qualname__", type(thing).__qualname__)).encode()


def checked(outputs: Any, declaration: Declaration, shape: tuple[int, ...], where: str) -> dict[str, np.ndarray]:
    """What a simulator has returned, as arrays of the declared outputs; ConfigurationError for any other shape."""
    if not isinstance(outputs, Mapping):
        raise ConfigurationError(f"{where} must give a mapping of outputs, got {type(outputs).__name__}")
    found = {}
    for output in declaration.outputs:
        if output.name not in outputs:
            raise ConfigurationError(
                f"{where} gives no output '{output.name}'; it gives {', '.join(map(str, outputs))}"
            )
        values = np.asarray(outputs[output.name], dtype=float)
        if values.shape != shape:
            raise ConfigurationError(f"{where}: output '{output.name}' has shape {values.shape}, expected {shape}")
        found[output.name] = values
    return found


def load_simulator(place: str) -> Simulator:
    """The simulator that ``file.py:name`` says. The file is executed with your rights.

    Parameters
    ----------
    place : str
        File, a colon, and the name of a `Simulator`, or of a function without arguments that returns one.

    Returns
    -------
    Simulator
        Ready to be diagnosed.

    Raises
    ------
    ConfigurationError
        Where there is no such file or name, or it is something else.

    Examples
    --------
    ::

        load_simulator("pendulum.py:make")
    """
    file, colon, name = place.rpartition(":")
    if not colon or not file or not name.isidentifier():
        raise ConfigurationError(f"simulator '{place}': expected FILE.py:NAME, the name of a simulator in the file")
    path = Path(file).resolve()
    if getattr(sys.modules.get(path.stem), "__file__", str(path)) != str(path):
        raise ConfigurationError(f"{path}: a module '{path.stem}' is in use already; give the file another name")
    module = run_python(path, path.stem)
    sys.modules[path.stem] = module
    if str(path.parent) not in sys.path:  # worker processes import the file by its name
        sys.path.append(str(path.parent))
    if not hasattr(module, name):
        raise ConfigurationError(f"{path} has no '{name}'; {nearest(name, [n for n in vars(module) if n[0] != '_'])}")
    found = getattr(module, name)
    found = found() if callable(found) and not isinstance(found, Simulator) else found
    if not isinstance(found, Simulator):
        raise ConfigurationError(f"{path}: '{name}' gives a {type(found).__name__}, expected a Simulator")
    return found
