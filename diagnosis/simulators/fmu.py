"""A simulator that is a functional mock-up unit (FMI 2 or 3, co-simulation), through FMPy."""

import shutil
import tempfile
import weakref
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from cable_envs.core.errors import ConfigurationError, require_known
from cable_envs.diagnosis.simulators.base import Columns, Simulator
from cable_envs.diagnosis.simulators.declaration import Declaration, named

_VERSIONS = ("2.0", "3.0")


class FmuSimulator(Simulator):
    """A co-simulation unit that is stepped, one run at a time. It is a program that is executed with your rights.

    Parameters
    ----------
    declaration : Declaration
        What the unit is said to be; ``period`` is the step that it is asked to make.
    path : Path or str
        The ``.fmu`` file.
    variables : mapping of str to str, optional
        Declared parameter, command, output or port -> name of the unit's variable; those that are missing are called
        as declared.
    starts : mapping of str to str, optional
        Output that is declared with ``starts`` -> variable that is set before a run begins; by default its own name
        with ``_start`` behind.
    workers : int
        As of `Simulator`.

    Raises
    ------
    ConfigurationError
        Without FMPy (``pip install 'cable-envs[fmi]'``), for a unit without co-simulation, and for variables that it
        does not have.

    Examples
    --------
    ::

        FmuSimulator(declaration, "cart.fmu", variables={"force": "F", "slide": "F_added", "position": "x"})
    """

    def __init__(
        self,
        declaration: Declaration,
        path: Path | str,
        *,
        variables: Mapping[str, str] | None = None,
        starts: Mapping[str, str] | None = None,
        workers: int = 1,
    ):
        super().__init__(declaration, workers)
        d, self.path = declaration, Path(path)
        self._unit: Any = None
        self._description = _described(self.path)
        declared = named(d.parameters, d.commands, d.outputs, d.ports)
        require_known(f"variables of simulator '{d.name}': name", variables or {}, declared)
        begins = [o.name for o in d.outputs if o.starts]
        require_known(f"starts of simulator '{d.name}': output", starts or {}, begins)
        own = {name: name for name in declared} | dict(variables or {})
        starting = {name: f"{own[name]}_start" for name in begins} | dict(starts or {})
        there = {v.name: v.valueReference for v in self._description.modelVariables}
        require_known(f"variable of {self.path.name}", [*own.values(), *starting.values()], there)
        self._places = {name: there[variable] for name, variable in own.items()}
        self._starts = {name: there[variable] for name, variable in starting.items()}

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_unit": None}

    def source(self) -> bytes:
        return self.path.read_bytes() + repr((self._places, self._starts)).encode()

    def begin(self, parameters: Columns, first: Columns) -> "_Session":
        return _Session(self, parameters, first)

    def unit(self) -> "_Unit":
        """The unit, unpacked and loaded when it is first asked for."""
        if self._unit is None:
            self._unit = _Unit(self.path, self._description)
        return self._unit


def _fmpy() -> Any:
    try:
        import fmpy
    except ModuleNotFoundError as error:
        raise ConfigurationError("an FMU needs FMPy: pip install 'cable-envs[fmi]'") from error
    return fmpy


def _described(path: Path) -> Any:
    if not path.is_file():
        raise ConfigurationError(f"{path}: there is no such FMU")
    try:
        found = _fmpy().read_model_description(str(path))
    except ConfigurationError:
        raise
    except Exception as error:
        raise ConfigurationError(f"{path}: cannot be read as an FMU: {error}") from error
    if found.fmiVersion not in _VERSIONS or found.coSimulation is None:
        raise ConfigurationError(f"{path}: expected FMI 2.0 or 3.0 with co-simulation, found FMI {found.fmiVersion}")
    return found


class _Unit:
    """A loaded unit: the same few calls for both versions."""

    def __init__(self, path: Path, description: Any):
        from fmpy.fmi2 import FMU2Slave
        from fmpy.fmi3 import FMU3Slave

        folder = tempfile.mkdtemp(prefix="fmu-")
        weakref.finalize(self, shutil.rmtree, folder, True)
        _fmpy().extract(str(path), unzipdir=folder)
        self._third = description.fmiVersion == "3.0"
        kind = FMU3Slave if self._third else FMU2Slave
        self._slave = kind(
            guid=description.guid, unzipDirectory=folder, instanceName=path.stem,
            modelIdentifier=description.coSimulation.modelIdentifier,
        )  # fmt: skip
        self._slave.instantiate()
        self._fresh = True

    def begin(self, values: Mapping[int, float]) -> None:
        """From the start, with these values of variables."""
        if not self._fresh:
            self._slave.reset()
        self._fresh = False
        if not self._third:
            self._slave.setupExperiment(startTime=0.0)
        self.write(values)
        self._slave.enterInitializationMode(**({"startTime": 0.0} if self._third else {}))
        self._slave.exitInitializationMode()

    def write(self, values: Mapping[int, float]) -> None:
        """Set variables."""
        if values:
            put = self._slave.setFloat64 if self._third else self._slave.setReal
            put(list(values), list(values.values()))

    def read(self, references: list[int]) -> list[float]:
        """Values of variables."""
        return list((self._slave.getFloat64 if self._third else self._slave.getReal)(references))

    def step(self, now: float, period: float) -> None:
        """One step."""
        self._slave.doStep(now, period)


class _Session:
    """A run of one unit."""

    def __init__(self, simulator: FmuSimulator, parameters: Columns, first: Columns):
        self._unit, self._period, self._steps = simulator.unit(), simulator.declaration.period, 0
        d, places = simulator.declaration, simulator._places
        self._outputs = {o.name: places[o.name] for o in d.outputs}
        self._inputs = {name: places[name] for name in named(d.commands, d.ports)}
        values = {places[name]: float(column[0]) for name, column in parameters.items()}
        values |= {simulator._starts[name]: float(column[0]) for name, column in first.items()}
        self._unit.begin(values)
        self.first: Columns = {name: np.array([value]) for name, value in self._read().items()}

    def _read(self) -> dict[str, float]:
        return dict(zip(self._outputs, self._unit.read(list(self._outputs.values())), strict=True))

    def run(self, commands: Columns, forces: Columns) -> Columns:
        """As `cable_envs.diagnosis.simulators.base.Session`."""
        given = {**commands, **forces}
        length = next(iter(commands.values())).shape[1]
        found = {name: np.empty((1, length)) for name in self._outputs}
        for k in range(length):
            self._unit.write({self._inputs[name]: float(column[0, k]) for name, column in given.items()})
            self._unit.step(self._steps * self._period, self._period)
            self._steps += 1
            for name, value in self._read().items():
                found[name][0, k] = value
        return found
