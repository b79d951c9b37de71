"""Random rigs of a plant within a factor of its shipped ones, and random commands for them."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from cable_envs.core.errors import ConfigurationError
from cable_envs.plants.base import ActionMode, Plant
from cable_envs.sim.stepsize import MOST

PERIOD = 0.01
"""Control period, s."""

USUAL = 20
"""Integration steps in it, unless a rig needs more."""

FACTOR = 3.0
"""Parameters are drawn log-uniformly between a shipped rig's value over this and times this."""

KEPT = (
    "gravity", "load_gravity", "hold_rule", "servo_kp", "servo_ki", "servo_kd", "servo_filter", "encoder_counts",
    "encoder_period",
)  # fmt: skip
"""Parameters that are no size of a rig, and those of a servo, which are set for its drive: others make it unstable."""

NOISE = {"m": 0.002, "rad": 0.002}
"""By the unit of the command: white noise as a share of its size, where it is not 0.02. Positions that jump by more at
every sample ask a servo for more than its drive has, which no user does."""


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
    substeps : int
        Integration steps in a control period.
    """

    plant: Plant
    mode: ActionMode
    values: np.ndarray
    start: np.ndarray
    command: np.ndarray
    substeps: int

    def run(self, substeps: int) -> np.ndarray:
        """Signals at the end of every control step, shape (T, len(plant.signals), n)."""
        from cable_envs.core.inputs import INPUTS

        p = self.plant.prepare(self.values)
        x, n = self.plant.rest(p, self.start), self.values.shape[1]
        u = INPUTS.zeros(n)
        u.mode[:] = self.plant.action_modes.index(self.mode)
        out = np.empty((len(self.command), len(self.plant.signals), n))
        last = self.command[0]
        for k, command in enumerate(self.command):
            u.command[:], u.command_rate[:], last = command, (command - last) / PERIOD, command
            self.plant.advance(x, p, u.rows, 0, n, substeps, PERIOD / substeps)
            out[k] = x[: len(self.plant.signals)]
        return out


def trials(plant: Plant, mode: ActionMode, nominal: np.ndarray, count: int, steps: int, seed: int) -> Iterator[Trial]:
    """Random rigs and commands, in groups of the same number of integration steps; what is refused is left out."""
    rng = np.random.default_rng(seed)
    values = np.repeat(nominal[:, None], count, axis=1)
    for row, name in enumerate(plant.parameters.names):
        if name not in KEPT:
            drawn = nominal[row] * FACTOR ** rng.uniform(-1.0, 1.0, count)
            values[row] = np.clip(drawn, plant.parameters[name].low, plant.parameters[name].high)
    names = plant.parameters.names
    torn, safe = names.index("breaking_tension"), names.index("tension_limit")
    values[torn] = np.maximum(values[torn], values[safe])
    kept, needed = [], []
    for k in range(count):
        try:
            longest = plant.longest_step(plant.prepare(values[:, k : k + 1]))[0]
        except ConfigurationError:
            continue
        if PERIOD / longest <= MOST:
            kept.append(k)
            needed.append(max(USUAL, int(np.ceil(PERIOD / longest))))
    groups = np.array(needed)
    for substeps in sorted(set(needed)):
        chosen = np.array(kept)[groups == substeps]
        yield _told(plant, mode, values[:, chosen], steps, substeps, rng)


def _told(plant: Plant, mode: ActionMode, values: np.ndarray, steps: int, substeps: int, rng) -> Trial:
    """Two sinusoids and steps about the command that holds the rig at rest, with a little noise."""
    n, t = values.shape[1], PERIOD * np.arange(steps)[:, None]
    bound = values[plant.parameters.names.index(mode.bound)]
    x = plant.rest(plant.prepare(values), np.zeros(n))
    rest = x[plant.row(mode.rest_signal)] if mode.rest_signal else np.zeros(n)
    size = np.minimum(np.where(rest > 0.0, 0.6 * rest, 0.3 * bound), bound)
    slow, fast = rng.uniform(0.2, 1.0, n), rng.uniform(1.0, 3.0, n)
    wave = 0.6 * np.sin(2 * np.pi * slow * t) + 0.2 * np.sin(2 * np.pi * fast * t + rng.uniform(0, 6.28, n))
    jumps = 0.4 * rng.uniform(-1.0, 1.0, (steps // 50 + 1, n)).repeat(50, axis=0)[:steps]
    command = rest * 1.2 + size * (wave + jumps + NOISE.get(mode.unit, 0.02) * rng.standard_normal((steps, n)))
    return Trial(plant, mode, values, np.zeros(n), np.clip(command, 0.0 if mode.one_sided else -bound, bound), substeps)
