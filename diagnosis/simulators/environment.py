"""A simulator that is a Gymnasium environment."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from cable_envs.core.errors import ConfigurationError, require_known
from cable_envs.diagnosis.simulators.base import Columns, Simulator, source_of
from cable_envs.diagnosis.simulators.declaration import Declaration, named


@dataclass(frozen=True)
class Action:
    """A component of the action, by its number; what several commands and forces say of one is added."""

    index: int = 0


@dataclass(frozen=True)
class Observation:
    """A component of the observation, by its number."""

    index: int = 0


@dataclass(frozen=True)
class Attribute:
    """An attribute of the bare environment (``env.unwrapped``), with dots for its own attributes.

    index: component of it, where it is a sequence.
    """

    path: str
    index: int | None = None


@dataclass(frozen=True)
class Option:
    """A key of the ``options`` that ``env.reset`` takes."""

    name: str


Read = Observation | Attribute | Callable[[Any], float]
Write = Option | Attribute


class GymSimulator(Simulator):
    """A Gymnasium environment that is stepped, one run at a time.

    Parameters
    ----------
    declaration : Declaration
        What the environment is said to be; ``period`` is that of one step.
    make : str or callable
        Id of a registered environment, or a function without arguments that makes one. It must have no time limit.
    parameters : mapping of str to Option or Attribute
        Where each declared parameter is set, before a reset.
    commands : mapping of str to Action
        Component of the action that each command is.
    outputs : mapping of str to Observation, Attribute or callable
        Where each output is read; a function is given the environment.
    forces : mapping of str to Action or Attribute, optional
        Where the force at each declared port is added; an attribute is set before each step.
    starts : mapping of str to Option or Attribute, optional
        Where outputs that are declared with ``starts`` are set: an option at the reset, an attribute after it.
    workers : int
        As of `Simulator`.

    Raises
    ------
    ConfigurationError
        Where something that is declared has no place, or a place is for something else.

    Examples
    --------
    ::

        GymSimulator(
            declaration, "Pendulum-v1", parameters={"length": Attribute("l")}, commands={"torque": Action(0)},
            outputs={"angle": Attribute("state", 0), "speed": Attribute("state", 1)}, forces={"pivot": Action(0)},
            starts={"angle": Attribute("state", 0), "speed": Attribute("state", 1)},
        )
    """

    def __init__(
        self,
        declaration: Declaration,
        make: str | Callable[[], Any],
        *,
        parameters: Mapping[str, Write],
        commands: Mapping[str, Action],
        outputs: Mapping[str, Read],
        forces: Mapping[str, Action | Attribute] | None = None,
        starts: Mapping[str, Write] | None = None,
        workers: int = 1,
    ):
        super().__init__(declaration, workers)
        d, self._make = declaration, make
        self._env: Any = None
        self.parameters, self.commands, self.outputs = dict(parameters), dict(commands), dict(outputs)
        self.forces, self.starts = dict(forces or {}), dict(starts or {})
        rules: tuple[tuple[str, Mapping[str, Any], list[str], tuple[Any, ...]], ...] = (
            ("parameters", self.parameters, named(d.parameters), (Option, Attribute)),
            ("commands", self.commands, named(d.commands), (Action,)),
            ("outputs", self.outputs, named(d.outputs), (Observation, Attribute, Callable)),
            ("forces", self.forces, named(d.ports), (Action, Attribute)),
            ("starts", self.starts, [o.name for o in d.outputs if o.starts], (Option, Attribute)),
        )
        for what, places, names, kinds in rules:
            require_known(f"{what} of simulator '{d.name}': name", places, names)
            for name in names:
                if not isinstance(places.get(name), kinds):
                    wanted = " or ".join(getattr(kind, "__name__", "a function") for kind in kinds)
                    raise ConfigurationError(
                        f"simulator '{d.name}': {what}: '{name}' is declared and needs {wanted}, "
                        f"got {places.get(name)!r}"
                    )

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_env": None}

    def source(self) -> bytes:
        places = repr((self.parameters, self.commands, self.forces, self.starts, list(self.outputs)))
        return places.encode() + (self._make.encode() if isinstance(self._make, str) else source_of(self._make))

    def environment(self) -> Any:
        """The environment, made when it is first asked for."""
        if self._env is None:
            import gymnasium

            self._env = gymnasium.make(self._make).unwrapped if isinstance(self._make, str) else self._make()
            space = self._env.action_space
            if not isinstance(space, gymnasium.spaces.Box):
                raise ConfigurationError(
                    f"simulator '{self.declaration.name}': its actions must be a Box of numbers, got {space}"
                )
        return self._env

    def begin(self, parameters: Columns, first: Columns) -> "_Session":
        return _Session(self, parameters, first)


class _Session:
    """A run of one environment."""

    def __init__(self, simulator: GymSimulator, parameters: Columns, first: Columns):
        self._simulator, self._env = simulator, simulator.environment()
        given = {name: float(values[0]) for name, values in parameters.items()}
        start = {name: float(values[0]) for name, values in first.items()}
        self._set({simulator.parameters[n]: v for n, v in given.items()})
        options = {
            place.name: value
            for places, values in ((simulator.parameters, given), (simulator.starts, start))
            for name, value in values.items()
            if isinstance(place := places[name], Option)
        }
        seen, _ = self._env.reset(seed=0, options=options or None)
        self._set({simulator.starts[n]: v for n, v in start.items()})
        self.first: Columns = {n: np.array([start.get(n, v)]) for n, v in self._read(seen).items()}

    def _set(self, places: Mapping[Any, float]) -> None:
        for place, value in places.items():
            if isinstance(place, Attribute):
                _write(self._env.unwrapped, place, value)

    def _read(self, seen: Any) -> dict[str, float]:
        flat = np.asarray(seen, dtype=float).ravel() if not isinstance(seen, (dict, tuple)) else np.empty(0)
        found = {}
        for name, place in self._simulator.outputs.items():
            if isinstance(place, Observation):
                found[name] = float(flat[place.index])
            elif isinstance(place, Attribute):
                value = _owner(self._env.unwrapped, place)
                found[name] = float(value if place.index is None else value[place.index])
            else:
                found[name] = float(place(self._env))
        return found

    def run(self, commands: Columns, forces: Columns) -> Columns:
        """As `cable_envs.diagnosis.simulators.base.Session`."""
        simulator = self._simulator
        length = next(iter(commands.values())).shape[1]
        found = {name: np.empty((1, length)) for name in simulator.outputs}
        space = self._env.action_space
        for k in range(length):
            action = np.zeros(space.shape)
            for places, values in ((simulator.commands, commands), (simulator.forces, forces)):
                for name, place in places.items():
                    if isinstance(place, Action):
                        action.flat[place.index] += values[name][0, k]
                    else:
                        _write(self._env.unwrapped, place, float(values[name][0, k]))
            seen, _, terminated, truncated, _ = self._env.step(action.astype(space.dtype))
            if terminated or truncated:
                why = "terminated" if terminated else "truncated: make it without a time limit"
                raise ConfigurationError(f"simulator '{simulator.declaration.name}': its episode ended ({why})")
            for name, value in self._read(seen).items():
                found[name][0, k] = value
        return found


def _owner(env: Any, place: Attribute) -> Any:
    value = env
    for name in place.path.split("."):
        value = getattr(value, name)
    return value


def _write(env: Any, place: Attribute, value: float) -> None:
    path, _, last = place.path.rpartition(".")
    owner = _owner(env, Attribute(path)) if path else env
    if not hasattr(owner, last):
        raise ConfigurationError(f"{type(env).__name__} has no attribute '{place.path}'")
    if place.index is None:
        setattr(owner, last, value)
        return
    now = getattr(owner, last)
    if isinstance(now, tuple):
        setattr(owner, last, tuple(value if k == place.index else v for k, v in enumerate(now)))
    else:
        now[place.index] = value
