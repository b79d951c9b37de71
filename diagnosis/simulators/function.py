"""A simulator that is a Python function over batches of columns."""

from collections.abc import Callable, Mapping
from typing import Any

from cable_envs.core.errors import ConfigurationError
from cable_envs.diagnosis.simulators.base import Columns, Simulator, checked, source_of
from cable_envs.diagnosis.simulators.declaration import Declaration


class FunctionSimulator(Simulator):
    """A simulator of two functions: one begins runs, the other takes steps.

    Parameters
    ----------
    declaration : Declaration
        What the simulator says of itself.
    start : callable
        ``start(parameters, first) -> (state, outputs)``. parameters: name -> [n]; first: output -> [n], of those that
        are declared with ``starts`` and given. state: anything; outputs: name -> [n].
    run : callable
        ``run(state, commands, forces, parameters) -> (state, outputs)``. commands: name -> [n, T], what acts over each
        step; forces: port -> [n, T], what is added there; outputs: name -> [n, T] at the ends of the steps. T is 1
        where a force depends on the outputs, so that ``run`` goes on from its own state.
    workers : int
        As of `Simulator`.

    Examples
    --------
    A mass that is pushed, by the trapezoidal rule:

    >>> import numpy as np
    >>> from cable_envs.diagnosis.simulators import Command, ForcePort, Output, SimulatorParameter
    >>> def start(parameters, first):
    ...     state = first["position"], first["velocity"]
    ...     return state, {"position": state[0], "velocity": state[1]}
    >>> def run(state, commands, forces, parameters):
    ...     push = (commands["force"] + forces["slide"]) / parameters["mass"][:, None]
    ...     v = state[1][:, None] + 0.01 * np.cumsum(push, axis=1)
    ...     before = np.column_stack([state[1], v[:, :-1]])
    ...     x = state[0][:, None] + 0.005 * np.cumsum(before + v, axis=1)
    ...     return (x[:, -1], v[:, -1]), {"position": x, "velocity": v}
    >>> cart = FunctionSimulator(
    ...     Declaration(
    ...         "cart", 0.01, (SimulatorParameter("mass", "kg", 2.0, 0.1, 10.0),), (Command("force", "N"),),
    ...         (Output("position", "m", starts=True), Output("velocity", "m/s", starts=True)),
    ...         (ForcePort("slide", "velocity", "position"),),
    ...     ),
    ...     start, run,
    ... )
    >>> cart.simulate({"force": np.ones(100)}, first={"position": 0.0, "velocity": 0.0})["velocity"][-1].round(6)
    np.float64(0.5)
    """

    together = True

    def __init__(
        self,
        declaration: Declaration,
        start: Callable[[Columns, Columns], tuple[Any, Mapping[str, Any]]],
        run: Callable[[Any, Columns, Columns, Columns], tuple[Any, Mapping[str, Any]]],
        workers: int = 1,
    ):
        super().__init__(declaration, workers)
        for what, function in (("start", start), ("run", run)):
            if not callable(function):
                raise ConfigurationError(f"simulator '{declaration.name}': {what} must be a function, got {function!r}")
        self._start, self._run = start, run

    def begin(self, parameters: Columns, first: Columns) -> "_Session":
        return _Session(self, parameters, first)

    def source(self) -> bytes:
        return source_of(self._start) + source_of(self._run)


class _Session:
    """A run of the two functions."""

    def __init__(self, simulator: FunctionSimulator, parameters: Columns, first: Columns):
        self._simulator, self._parameters = simulator, dict(parameters)
        self._count = len(next(iter(parameters.values())))
        found = _pair(simulator._start(dict(parameters), dict(first)), self._called("start"))
        self._state = found[0]
        self.first: Columns = checked(found[1], simulator.declaration, (self._count,), self._called("start"))

    def _called(self, what: str) -> str:
        return f"{what} of simulator '{self._simulator.declaration.name}'"

    def run(self, commands: Columns, forces: Columns) -> Columns:
        """As `cable_envs.diagnosis.simulators.base.Session`."""
        length = next(iter(commands.values())).shape[1]
        given = self._simulator._run(self._state, dict(commands), dict(forces), dict(self._parameters))
        self._state, outputs = _pair(given, self._called("run"))
        return checked(outputs, self._simulator.declaration, (self._count, length), self._called("run"))


def _pair(given: Any, where: str) -> tuple[Any, Any]:
    if not isinstance(given, tuple) or len(given) != 2:
        raise ConfigurationError(f"{where} must give (state, outputs), got {type(given).__name__}")
    return given
