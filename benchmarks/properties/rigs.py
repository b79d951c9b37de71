"""Random rigs of a plant within a factor of its shipped ones, and random commands for them."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from cable_envs.core.errors import ConfigurationError
from cable_envs.core.inputs import INPUTS
from cable_envs.plants.base import ActionMode, Plant
from cable_envs.sim.stepsize import MOST, in_ticks

USUAL = 20
"""Integration steps in a control period, unless a rig needs more."""

FACTOR = 3.0
"""Parameters are drawn log-uniformly between a shipped rig's value over this and times this."""

KEPT = ("gravity", "load_gravity", "hold_rule", "servo_filter", "encoder_period")
"""Parameters that are no size of a rig."""

LIMITS = ("tension_limit", "breaking_tension")
"""What says when a run ends, and moves nothing."""

GAINS = ("servo_kp", "servo_ki", "servo_kd")
"""Gains of a servo, which is set for its drive: they are drawn in proportion to the drive's inertia."""

NOISE = {"m": 0.002, "rad": 0.002}
"""By the unit of the command: white noise as a share of its size, where it is not 0.02. Positions that jump by more at
every sample ask a servo for more than its drive has, which no user does."""


@dataclass(frozen=True)
class Box:
    """What rigs are drawn from.

    Attributes
    ----------
    name : str
        For the table.
    period : float
        Control period, s.
    within : mapping of str to (float, float)
        Parameters that are drawn between other bounds than a factor of the shipped rig's, SI.
    """

    name: str
    period: float = 0.01
    within: Mapping[str, tuple[float, float]] | None = None


@dataclass(frozen=True)
class Trial:
    """Rigs that take the same number of integration steps, with what they are told.

    Attributes
    ----------
    plant : Plant
        What simulates them.
    mode : ActionMode
        What the command is.
    values : ndarray, shape (len(plant.parameters), n)
        Parameters, SI.
    start : ndarray, shape (n,)
        Position of the output at rest, SI.
    command : ndarray, shape (T, n)
        Commands, in the unit of the mode.
    second : ndarray, shape (T, n)
        Second commands; 0 where the mode has none.
    substeps : int
        Integration steps in a control period.
    period : float
        Control period, s.
    """

    plant: Plant
    mode: ActionMode
    values: np.ndarray
    start: np.ndarray
    command: np.ndarray
    second: np.ndarray
    substeps: int
    period: float

    def run(self, substeps: int) -> np.ndarray:
        """Signals at the end of every control step, shape (T, len(plant.signals), n)."""
        p = self.plant.prepare(self.values)
        x, n = self.plant.rest(p, self.start), self.values.shape[1]
        u = INPUTS.zeros(n)
        u.mode[:] = self.plant.number_of(self.mode)
        out = np.empty((len(self.command), len(self.plant.signals), n))
        last, before = self.command[0], self.second[0]
        for k, (command, second) in enumerate(zip(self.command, self.second, strict=True)):
            u.command[:], u.command_rate[:], last = command, (command - last) / self.period, command
            u.second[:], u.second_rate[:], before = second, (second - before) / self.period, second
            self.plant.advance(x, p, u.rows, 0, n, substeps, self.period / substeps)
            out[k] = x[: len(self.plant.signals)]
        return out

    def of(self, chosen: np.ndarray | slice) -> "Trial":
        """Some of the rigs alone."""
        return replace(
            self, values=self.values[:, chosen], start=self.start[chosen], command=self.command[:, chosen],
            second=self.second[:, chosen],
        )  # fmt: skip


def drawn(plant: Plant, nominal: np.ndarray, box: Box, count: int, rng: np.random.Generator) -> np.ndarray:
    """Parameters of random rigs, shape (len(plant.parameters), count), SI.

    An encoder has no steps: one that shows the next step sooner changes what the servo asks for at once, so that the
    smallest difference grows, whatever the integration does.
    """
    values, names = np.repeat(nominal[:, None], count, axis=1), plant.parameters.names
    for row, name in enumerate(names):
        least, most = plant.parameters[name].low, plant.parameters[name].high
        if name in (box.within or {}):
            low, high = (box.within or {})[name]
            values[row] = low * (high / low) ** rng.random(count)
        elif name not in KEPT and name not in GAINS:
            values[row] = np.clip(nominal[row] * FACTOR ** rng.uniform(-1.0, 1.0, count), least, most)
        if name == "encoder_counts":
            values[row] = 0.0
    safe, torn = (names.index(name) for name in LIMITS)
    values[torn] = np.maximum(values[torn], values[safe])
    if "co_contraction" in names:
        least, most = names.index("co_contraction"), names.index("co_contraction_limit")
        values[most] = np.maximum(values[most], 1.01 * values[least])  # those that are a little larger are legal too
    if plant.drive == "motor":
        heavier = _inertia(plant, values) / _inertia(plant, nominal[:, None])
        for name in GAINS:
            values[names.index(name)] = nominal[names.index(name)] * heavier
    return values


def _inertia(plant: Plant, values: np.ndarray) -> np.ndarray:
    """Inertia of drives with a motor; rigs that are refused for their cable have one too."""
    whole = values.copy()
    whole[plant.parameters.names.index("breaking_tension")] = plant.parameters["breaking_tension"].high
    return plant.coefficient_rows.over(plant.prepare(whole)).moved_inertia


def trials(
    plant: Plant, mode: ActionMode, nominal: np.ndarray, box: Box, count: int, steps: int, seed: int
) -> Iterator[Trial]:
    """Random rigs and commands, in groups of the same number of integration steps; what is refused is left out."""
    rng = np.random.default_rng(seed)
    values = drawn(plant, nominal, box, count, rng)
    kept, needed = [], []
    for k in range(count):
        try:
            p = plant.prepare(values[:, k : k + 1])
        except ConfigurationError:
            continue
        longest = plant.longest_step(p)[0]
        if box.period / longest <= MOST:
            kept.append(k)
            needed.append(in_ticks(plant, p, box.period, max(USUAL, int(np.ceil(box.period / longest)))))
    groups = np.array(needed)
    for substeps in sorted(set(needed)):
        chosen = np.array(kept)[groups == substeps]
        yield _told(plant, mode, values[:, chosen], box.period, steps, substeps, rng)


def _told(
    plant: Plant, mode: ActionMode, values: np.ndarray, period: float, steps: int, substeps: int,
    rng: np.random.Generator,
) -> Trial:  # fmt: skip
    """Two sinusoids and steps about the command that holds the rig at rest, with a little noise."""
    n, t = values.shape[1], period * np.arange(steps)[:, None]
    bound = values[plant.parameters.names.index(mode.bound)]
    x = plant.rest(plant.prepare(values), np.zeros(n))
    rest = x[plant.row(mode.rest_signal)] if mode.rest_signal else np.zeros(n)
    share = 1.5 if plant.drive == "motor" else 0.6  # a real drive's friction comes first
    size = np.minimum(np.where(rest > 0.0, share * rest, 0.3 * bound), bound)
    slow, fast = rng.uniform(0.2, 1.0, n), rng.uniform(1.0, 3.0, n)
    wave = 0.6 * np.sin(2 * np.pi * slow * t) + 0.2 * np.sin(2 * np.pi * fast * t + rng.uniform(0, 6.28, n))
    held = max(round(0.5 / period), 1)
    jumps = 0.4 * rng.uniform(-1.0, 1.0, (steps // held + 1, n)).repeat(held, axis=0)[:steps]
    command = rest * 1.2 + size * (wave + jumps + NOISE.get(mode.unit, 0.02) * rng.standard_normal((steps, n)))
    low = 0.0 if mode.one_sided else -bound
    second = second_at_rest(plant, mode, x) * np.ones((steps, 1))
    if mode.of and mode.second is not None:
        most = values[plant.parameters.names.index(mode.second.bound)]
        size = np.where(second[0] > 0.0, 0.5 * second[0], 0.3 * most)
        second = second + size * np.sin(2 * np.pi * rng.uniform(0.2, 1.0, n) * t)
        second = np.clip(second, 0.0 if mode.second.one_sided else -most, most)
    return Trial(plant, mode, values, np.zeros(n), np.clip(command, low, bound), second, substeps, period)


def second_at_rest(plant: Plant, mode: ActionMode, x: np.ndarray) -> np.ndarray:
    """The second command that keeps mechanisms at rest with signals ``x``, shape (n,); 0 where the mode has none."""
    if mode.second is None or not mode.second.rest_signal:
        return np.zeros(x.shape[1])
    return x[plant.row(mode.second.rest_signal)].copy()
