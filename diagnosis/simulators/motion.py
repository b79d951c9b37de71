"""Whole runs of a simulator with physics at its ports, in many columns at once.

A force that depends on the outputs needs them step by step. What it has to move is found by trying: a run is begun
with and without a small force at the port, and a step of each is compared; likewise what a command does there within a
step. What else acts on the place is taken from the last two steps, in a straight line.

An error of the simulator, or a number that is not finite, costs the column in which it happens: that is NaN.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from cable_envs.core.errors import ConfigurationError
from cable_envs.diagnosis.simulators.base import Session, Simulator
from cable_envs.diagnosis.simulators.declaration import ForcePort
from cable_envs.diagnosis.simulators.ports import Rubbing, layout, rubbing
from cable_envs.diagnosis.simulators.signals import sent

Arrays = Mapping[str, np.ndarray]
FIRST = "first "
"""How the names of values begin that are outputs at the start."""
SMALLEST, LARGEST = 1e-9, 1e12
"""Forces and commands, N, N m or the command's unit, between which one is looked for that moves a port."""
SEEN = 1e-5
"""Share of the velocity at the start, or m/s or rad/s of `AT_REST`, by which a step must change it."""
AT_REST = 1e-3
_HALF, _WHOLE = 5.0, 10.0
"""Times the smallest force that is seen, between which a port's inertia is measured: friction that the simulator has
itself is overcome by both."""


@dataclass(frozen=True)
class Course:
    """One run.

    Parameters
    ----------
    commands : mapping of str to ndarray
        Command -> [T] or [n, T], what was asked for over each step.
    given : mapping of str to float
        Parameters that only this run has.
    forces : mapping of str to ndarray
        Port -> [T] or [n, T], what is added there besides the laws.
    """

    commands: Arrays
    given: Mapping[str, float] = field(default_factory=dict)
    forces: Arrays = field(default_factory=dict)

    def column(self, k: int) -> "Course":
        """The course of one column."""
        parts = (
            {n: c[k : k + 1] if c.ndim == 2 else c for n, c in part.items()} for part in (self.commands, self.forces)
        )
        commands, forces = parts
        return Course(commands, self.given, forces)

    @property
    def steps(self) -> int:
        """T."""
        return next(iter(self.commands.values())).shape[-1]


def steps_of(simulator: Simulator, course: Course, values: Mapping[str, float]) -> dict[str, float]:
    """Smallest force at each port, and change of each command ("port command"), that is seen within a step.

    values: every parameter, and outputs at the start. Raises ConfigurationError where a force does not move its port.
    """
    columns = {n: np.array([float(v)]) for n, v in {**values, **course.given}.items()}
    found: dict[str, float] = {}
    for port in simulator.declaration.ports:
        base = _after(simulator, columns, course, port, {}, {})
        start = float(np.abs(_begun(simulator, columns).first[port.velocity][0]))
        least = SEEN * max(start, AT_REST)
        size = _first_seen(
            lambda by, port=port, base=base: _after(simulator, columns, course, port, {port.name: by}, {}) - base, least
        )
        if size is None:
            raise ConfigurationError(
                f"simulator '{simulator.declaration.name}': no force at port '{port.name}' changes {port.velocity} "
                "within a step: another output must be the velocity there, or the port does not act"
            )
        found[port.name] = size
        for command in simulator.declaration.commands:
            size = _first_seen(
                lambda by, port=port, base=base, name=command.name: _after(
                    simulator, columns, course, port, {}, {name: by}
                ) - base,
                least,
            )  # fmt: skip
            if size is not None:
                found[f"{port.name} {command.name}"] = size
    return found


def _first_seen(change, least: float) -> float | None:
    size = SMALLEST
    while size <= LARGEST:
        try:
            moved = float(np.abs(change(size)[0]))
        except Exception:  # beyond what the simulator takes
            return None
        if moved > least:
            return size
        size *= 10.0
    return None


def _after(
    simulator: Simulator, values: Arrays, course: Course, port: ForcePort, force: Mapping[str, float],
    command: Mapping[str, float],
) -> np.ndarray:  # fmt: skip
    """Velocity [n] at a port after the first step, with a force and a command more."""
    count = len(next(iter(values.values())))
    session = _begun(simulator, values)
    commands = {
        n: np.broadcast_to(c, (count, course.steps))[:, :1] + command.get(n, 0.0) for n, c in course.commands.items()
    }
    forces = {p.name: np.full((count, 1), force.get(p.name, 0.0)) for p in simulator.declaration.ports}
    return np.array(session.run(commands, forces)[port.velocity][:, 0])


def _slope(
    simulator: Simulator, values: Arrays, course: Course, port: ForcePort, size: float, command: str = ""
) -> np.ndarray:
    """Change [n] of the velocity at a port within a step, over that of the force there, or of a command."""
    ends = []
    for by in (_HALF, _WHOLE):
        force, asked = ({}, {command: by * size}) if command else ({port.name: by * size}, {})
        ends.append(_after(simulator, values, course, port, force, asked))
    return (ends[1] - ends[0]) / ((_WHOLE - _HALF) * size)


def inertia(
    simulator: Simulator, values: Arrays, course: Course, port: ForcePort, small: Mapping[str, float]
) -> np.ndarray:
    """What a force at a port has to move when a run begins, kg or kg m^2 [n]; arguments as of `moved`."""
    return simulator.declaration.period / _slope(simulator, values, course, port, small[port.name])


def _begun(simulator: Simulator, values: Arrays) -> Session:
    first = {n.removeprefix(FIRST): np.array(v, dtype=float) for n, v in values.items() if n.startswith(FIRST)}
    names = [p.name for p in simulator.declaration.parameters]
    return simulator.begin({name: np.array(values[name], dtype=float) for name in names}, first)


def moved(simulator: Simulator, course: Course, values: Arrays, small: Mapping[str, float]) -> dict[str, np.ndarray]:
    """Outputs [n, 1 + T] of a run, the first column at the start; a column of the simulator's errors is NaN.

    values: every parameter, outputs at the start (`FIRST`), and rows of effects [n]; those that are missing are at
    their null. small: as of `steps_of`.
    """
    count = len(next(iter(values.values())))
    if simulator.together or count == 1:
        try:
            return _finite(simulated(simulator, course, values, small))
        except Exception:
            if count == 1:
                nothing = np.full((1, course.steps + 1), np.nan)
                return {output.name: nothing for output in simulator.declaration.outputs}
    columns = [
        moved(simulator, course.column(k), {name: column[k : k + 1] for name, column in values.items()}, small)
        for k in range(count)
    ]
    return {name: np.concatenate([one[name] for one in columns]) for name in columns[0]}


def _finite(outputs: Arrays) -> dict[str, np.ndarray]:
    """Columns in which anything is not finite are NaN."""
    bad = np.any([~np.isfinite(series).all(axis=1) for series in outputs.values()], axis=0)
    return {name: np.where(bad[:, None], np.nan, series) for name, series in outputs.items()}


def simulated(
    simulator: Simulator, course: Course, values: Arrays, small: Mapping[str, float]
) -> dict[str, np.ndarray]:
    """`moved` that passes on the errors of the simulator, and numbers that are not finite."""
    declaration = simulator.declaration
    count, steps = len(next(iter(values.values()))), course.steps
    with np.errstate(all="ignore"):
        session = _begun(simulator, values)
        commands = {
            c.name: sent(c, np.broadcast_to(course.commands[c.name], (count, steps)), values, declaration.period)
            for c in declaration.commands
        }
        forces = {
            p.name: np.broadcast_to(course.forces.get(p.name, np.zeros(steps)), (count, steps))
            for p in declaration.ports
        }
        laws = [law for port in declaration.ports if (law := _Port.of(simulator, port, course, values, small))]
        if not laws:
            seen = session.run(commands, forces)
            return {name: np.column_stack([session.first[name], seen[name]]) for name in seen}
        out = {o.name: np.empty((count, steps + 1)) for o in declaration.outputs}
        for name, first in session.first.items():
            out[name][:, 0] = first
        for k in range(steps):
            now = {name: series[:, k : k + 1] for name, series in commands.items()}
            added = {name: series[:, k : k + 1] for name, series in forces.items()}
            for law in laws:
                added[law.port.name] = added[law.port.name] + law.force(out, now, k, declaration.period)[:, None]
            for name, series in session.run(now, added).items():
                out[name][:, k + 1] = series[:, 0]
    return out


class _Port:
    """The laws at one port while a run goes on."""

    def __init__(self, port: ForcePort, laws: Rubbing, mass: np.ndarray, gains: Arrays, rest: np.ndarray):
        self.port, self._laws, self._mass, self._gains = port, laws, mass, gains
        self._before = [rest, rest]
        """what else acted in the last step, and in the one before"""
        self._last = np.zeros(len(mass))
        self._told = np.zeros(len(mass))

    @classmethod
    def of(
        cls, simulator: Simulator, port: ForcePort, course: Course, values: Arrays, small: Mapping[str, float]
    ) -> "_Port | None":
        """The laws at a port; None where all are at their null."""
        turning = simulator.declaration.turns(port)
        table, count = layout(turning).table, len(next(iter(values.values())))
        rows = np.repeat(np.array([[p.default] for p in table]), count, axis=1)
        there = False
        for k, p in enumerate(table):
            effect, _, parameter = p.name.partition(".")
            given = values.get(f"{effect}.{port.name}.{parameter}")
            if given is not None:
                rows[k], there = given, True
        laws = rubbing(turning, rows)
        if not there or not np.any(laws.coefficients[layout(turning).lanes.row("on")]):
            return None
        period = simulator.declaration.period

        mass = inertia(simulator, values, course, port, small)
        gains = {
            c.name: _slope(simulator, values, course, port, small[key], command=c.name) * mass / period
            for c in simulator.declaration.commands if (key := f"{port.name} {c.name}") in small
        }  # fmt: skip
        free = _after(simulator, values, course, port, {}, {}) - _begun(simulator, values).first[port.velocity]
        first = {name: np.broadcast_to(c, (count, course.steps))[:, 0] for name, c in course.commands.items()}
        told = sum((gain * first[name] for name, gain in gains.items()), np.zeros(count))
        return cls(port, laws, mass, gains, mass * free / period - told)

    def force(self, out: Arrays, commands: Arrays, k: int, period: float) -> np.ndarray:
        """Mean force [n] of the laws over step k."""
        speed = out[self.port.velocity]
        place = out[self.port.position][:, k] if self.port.position else np.zeros(len(self._mass))
        if k > 0:  # what acted over the last step besides the laws and the commands
            rest = self._mass * (speed[:, k] - speed[:, k - 1]) / period - self._last - self._told
            self._before = [rest, self._before[0]]
        asked = sum((gain * commands[name][:, 0] for name, gain in self._gains.items()), np.zeros(len(self._mass)))
        self._told = np.asarray(asked)
        net = 2.0 * self._before[0] - self._before[1] + self._told
        self._last = self._laws.forces(np.ascontiguousarray(place), speed[:, k].copy(), self._mass, net, period)
        return self._last
