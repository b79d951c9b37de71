"""Least squares for many hypotheses and starts at once: every iteration is one batch of columns for the simulator.

Levenberg-Marquardt with Marquardt's scaling (SIAM J. 11 (1963) 431). Slopes are central differences over steps that
are wide against the kinks of friction; three dampings are tried in one batch, so that an iteration costs two runs.
Bounds by projection; priors are further residuals.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cable_envs.core.intervals import NORMAL_95, normal_interval
from cable_envs.diagnosis.fit.rounds import rounds
from cable_envs.diagnosis.model.model import Model, Whitener, residuals

STEP = 1e-2
"""Step of the differences over the parameter's size, or its scale where that is larger.

With 1e-3 refits of drives that stick ended in the nearest of many minima: the second of two effects gained 3 to 45,
from any start, where it now gains 60 to 90 of the 91 that its score promises.
"""
_DAMPINGS = (0.1, 1.0, 10.0)
_LONGER = (1.0, 2.0, 4.0)
"""Multiples of the boldest step that are tried instead, as many as dampings, where the last one was too short."""
SHORT = 1.05
"""Fall of the cost over the one that the slopes promised, from which a step was too short.

Kinks of friction make slopes noisy. The floor of a flat valley then seems steeper than it is, and full steps along it
are short: of a hardening cable whose pretension was 60 % too large, 16 of them gained a third of what there was.
"""
_TOGETHER = 1 << 25
"""Bytes of predictions at a time: refits of many models take slopes of a thousand columns, several copies of each."""
SETTLED = 0.1
"""Fall of the whitened sum of squares below which a refit has ended; chance gives a parameter about 1."""


@dataclass(frozen=True)
class Start:
    """Where one refit begins: values by name (others stay at their start), and which of them move."""

    label: str
    free: tuple[str, ...]
    values: dict[str, float]


@dataclass(frozen=True)
class Fit:
    """One refit: parameters by name (SI), whitened sum of squares with priors, and what it rests on."""

    label: str
    free: tuple[str, ...]
    values: dict[str, float]
    cost: float
    residual: np.ndarray
    """whitened [samples]"""
    jacobian: np.ndarray
    """d whitened prediction / d free [samples, free]"""
    covariance: np.ndarray
    """of the free parameters [free, free]"""
    at_bounds: tuple[str, ...]
    evaluations: int

    @property
    def outline(self) -> "Fit":
        """The same without residual and Jacobian, which take its memory."""
        return replace(self, residual=np.empty(0), jacobian=np.empty((0, len(self.free))))

    def interval(self, name: str, factor: float = NORMAL_95) -> tuple[float, float]:
        """95 % interval of a free parameter, from the curvature."""
        k = self.free.index(name)
        return normal_interval(self.values[name], float(np.sqrt(self.covariance[k, k])), factor).ends


def refit(
    model: Model, whitener: Whitener, starts: Sequence[Start], iterations: int = 20, *, central: bool = True
) -> list[Fit]:
    """Refit from every start, all together. Raises KeyError where a start names no parameter of the model.

    central: slopes from both sides; from one side they cost half.
    """
    runs = _refitted(model, whitener, starts, iterations, central)
    for run in runs:
        run.done = False
    _slopes(model, whitener, runs, central)
    return [run.fit() for run in runs]


@dataclass(frozen=True)
class Look:
    """Where a refit has come after a few iterations: values by name (SI), and its cost."""

    label: str
    free: tuple[str, ...]
    values: dict[str, float]
    cost: float


def look(model: Model, whitener: Whitener, starts: Sequence[Start], iterations: int) -> list[Look]:
    """A few iterations of `refit` with slopes from one side: enough to find out who leads, without intervals."""
    runs = _refitted(model, whitener, starts, iterations, central=False)
    return [Look(run.start.label, run.start.free, run.named(), run.cost) for run in runs]


def nearest(model: Model, whitener: Whitener, starts: Sequence[Start]) -> list[Start]:
    """Of each label the start with the lowest cost as it is: one simulation for each, without slopes."""
    runs = [_Run(model, start) for start in starts]
    best: dict[str, tuple[float, Start]] = {}
    for some in _at_a_time(model, runs, [1] * len(runs)):
        white = _whitened(model, whitener, [run.values for run in some])
        for run, residual in zip(some, white.T, strict=True):
            cost = float(residual @ residual + run.prior(run.values))
            if np.isfinite(cost) and cost < best.get(run.start.label, (np.inf, run.start))[0]:
                best[run.start.label] = cost, run.start
    return [start for _, start in best.values()]


def _refitted(
    model: Model, whitener: Whitener, starts: Sequence[Start], iterations: int, central: bool
) -> list["_Run"]:
    runs = [_Run(model, start) for start in starts]
    for _ in rounds(iterations):
        _slopes(model, whitener, runs, central)
        active = [run for run in runs if not run.done]
        if not active:
            break
        for some in _at_a_time(model, active, [len(_DAMPINGS)] * len(active)):
            trials = [trial for run in some for trial in run.trials()]
            white = _whitened(model, whitener, [values for _, values in trials])
            for k, run in enumerate(some):
                mine = slice(len(_DAMPINGS) * k, len(_DAMPINGS) * (k + 1))
                run.take(trials[mine], white[:, mine])
    return runs


def _at_a_time(model: Model, runs: Sequence["_Run"], columns: Sequence[int]) -> Iterator[list["_Run"]]:
    """Runs of which each asks for so many columns, as many at a time as `_TOGETHER` allows."""
    most = _TOGETHER / (8 * sum(len(b.time) for b in model.blocks))
    some, count = list["_Run"](), 0
    for run, own in zip(runs, columns, strict=True):
        if some and count + own > most:
            yield some
            some, count = [], 0
        some.append(run)
        count += own
    if some:
        yield some


class _Run:
    """The state of one refit."""

    def __init__(self, model: Model, start: Start):
        self.parameters, self.start = list(model.parameters), start
        names = [p.name for p in self.parameters]
        self.rows = [names.index(name) for name in start.free]
        given = {**{p.name: p.start for p in self.parameters}, **start.values}
        self.values = np.array([p.clip(given[p.name]) for p in self.parameters])
        self.damping, self.done, self.failed, self.evaluations = 1e-2, False, False, 0
        self.residual = self.jacobian = np.empty(0)
        self.short = False
        """whether the boldest of the last steps fell by more than the slopes promised"""
        self.known = False
        """whether the residual is that of the values"""
        self.sloped = False
        """whether the Jacobian is that of the values"""

    def prior(self, values: np.ndarray) -> float:
        """Sum of squared priors."""
        return sum(((values[k] - self.parameters[k].start) / self.parameters[k].std) ** 2 for k in self._weighed())

    def _weighed(self) -> list[int]:
        return [k for k in self.rows if self.parameters[k].std]

    @property
    def cost(self) -> float:
        """Whitened sum of squares with priors."""
        return np.inf if self.failed else float(self.residual @ self.residual + self.prior(self.values))

    def columns(self, central: bool) -> tuple[np.ndarray, list[tuple[int, int]]]:
        """(columns, of each free parameter the two between which its slope is taken); the first are the values.

        Where their residual is known, the first column is none of a simulation: see `_slopes`.
        """
        columns, pairs = [self.values], []
        for k in self.rows:
            p, ends = self.parameters[k], []
            step = STEP * max(abs(self.values[k]), p.scale)
            above = p.clip(self.values[k] + step)
            for value in (p.clip(self.values[k] - step), above) if central or above == self.values[k] else (above,):
                ends.append(len(columns))
                columns.append(self.values.copy())
                columns[-1][k] = value
            if not central and above == self.values[k]:
                ends = ends[:1]
            pairs.append((ends[0], ends[1]) if len(ends) == 2 else (0, ends[0]))
        return np.stack(columns, axis=1), pairs

    def normal(self) -> tuple[np.ndarray, np.ndarray]:
        """Normal matrix and gradient, priors included."""
        matrix, gradient = self.jacobian.T @ self.jacobian, self.jacobian.T @ self.residual
        for k in self._weighed():
            j, p = self.rows.index(k), self.parameters[k]
            assert p.std is not None
            matrix[j, j] += 1.0 / p.std**2
            gradient[j] -= (self.values[k] - p.start) / p.std**2
        return matrix, gradient

    def trials(self) -> list[tuple[float, np.ndarray]]:
        """(factor of the damping, values) to be tried."""
        if not self.short:
            return [(factor, self.step(factor)) for factor in _DAMPINGS]
        boldest = self.step(_DAMPINGS[0]) - self.values
        longer = [self.values + by * boldest for by in _LONGER]
        return [
            (_DAMPINGS[0], np.array([p.clip(v) for p, v in zip(self.parameters, one, strict=True)])) for one in longer
        ]

    def step(self, factor: float) -> np.ndarray:
        """Values after a step with the damping times ``factor``; what would leave its bounds stays on them."""
        matrix, gradient = self.normal()
        scale = np.where(np.diag(matrix) > 0.0, np.diag(matrix), 1.0)
        held = np.zeros(len(self.rows), dtype=bool)
        values = self.values.copy()
        for _ in range(len(self.rows) + 1):
            move = np.flatnonzero(~held)
            if not len(move):
                break
            size = np.sqrt(scale[move])  # units differ by many powers of ten
            damped = matrix[np.ix_(move, move)] / np.outer(size, size) + self.damping * factor * np.eye(len(move))
            change = np.linalg.lstsq(damped, gradient[move] / size, rcond=None)[0] / size
            wanted = self.values.copy()
            wanted[[self.rows[j] for j in move]] += change
            values = np.array([p.clip(v) for p, v in zip(self.parameters, wanted, strict=True)])
            stuck = [j for j in move if values[self.rows[j]] != wanted[self.rows[j]]]
            pinned = [j for j in stuck if values[self.rows[j]] == self.values[self.rows[j]]]
            if not pinned:
                break
            held[pinned] = True
        return values

    def take(self, trials: Sequence[tuple[float, np.ndarray]], white: np.ndarray) -> None:
        """Go to the best of trials (factor of the damping, values), if it is better; white: residuals [samples, k]."""
        self.evaluations += len(trials)
        squares = np.sum(white**2, axis=0)
        costs = [
            float(s + self.prior(v)) if np.isfinite(s) else np.inf for s, (_, v) in zip(squares, trials, strict=True)
        ]
        best = int(np.argmin(costs))
        gain = self.cost - costs[best]
        self.short = self.cost - costs[0] > SHORT * self._promised(trials[0][1])
        if gain > 0.0:
            factor, self.values = trials[best]
            self.residual, self.known, self.sloped = white[:, best].copy(), True, False
            self.damping = max(self.damping * factor * 0.3, 1e-9)
            self.done = gain < SETTLED
        else:
            self.damping *= 100.0
            self.done = self.damping > 1e4

    def _promised(self, values: np.ndarray) -> float:
        """Fall of the cost at these values if the slopes were the same all the way."""
        matrix, gradient = self.normal()
        step = (values - self.values)[self.rows]
        return float(2.0 * gradient @ step - step @ matrix @ step)

    def named(self) -> dict[str, float]:
        """The values by name."""
        return {p.name: float(v) for p, v in zip(self.parameters, self.values, strict=True)}

    def fit(self) -> Fit:
        """The result; what the records leave open has the variance of a uniform prior between its bounds."""
        matrix, _ = self.normal()
        ranges = [self.parameters[k].high - self.parameters[k].low for k in self.rows]
        matrix += np.diag([12.0 / width**2 if width > 0.0 else 0.0 for width in ranges])
        bounds = [
            self.parameters[k].name
            for k in self.rows
            if self.values[k] in (self.parameters[k].low, self.parameters[k].high)
        ]
        return Fit(
            self.start.label, self.start.free, self.named(), self.cost, self.residual, self.jacobian,
            _inverse(matrix), tuple(bounds), self.evaluations,
        )  # fmt: skip


def _inverse(matrix: np.ndarray) -> np.ndarray:
    """Pseudoinverse of a normal matrix whose rows have different units; what nothing shows has a huge variance."""
    seen = np.diag(matrix) > 0.0
    size = np.sqrt(np.where(seen, np.diag(matrix), 1.0))
    scaled = matrix / np.outer(size, size) + np.diag(np.where(seen, 1e-12, 1e-30))
    return np.linalg.inv(scaled) / np.outer(size, size)


def _slopes(model: Model, whitener: Whitener, runs: Sequence[_Run], central: bool) -> None:
    """Residual and Jacobian of every run that is not done; a step that was not taken has left both."""
    runs = [run for run in runs if not (run.done or run.sloped)]
    for some in _at_a_time(model, runs, [1 + (1 + central) * len(run.rows) for run in runs]):
        _slopes_at_once(model, whitener, some, central)


def _slopes_at_once(model: Model, whitener: Whitener, runs: Sequence[_Run], central: bool) -> None:
    """Residual and Jacobian of runs from one batch."""
    groups = [run.columns(central) for run in runs]
    for run in runs:
        run.known = run.known and bool(run.rows)
    simulated = [columns[:, int(run.known) :] for run, (columns, _) in zip(runs, groups, strict=True)]
    white = _whitened(model, whitener, list(np.concatenate(simulated, axis=1).T))
    first = 0
    for run, (columns, pairs), new in zip(runs, groups, simulated, strict=True):
        mine = white[:, first : first + new.shape[1]]
        first += new.shape[1]
        run.evaluations += new.shape[1]
        if run.known:
            mine = np.column_stack([run.residual, mine])
        fine = np.isfinite(mine).all(axis=0)  # what the plant refuses has no slope; that of the other side does
        pairs = [(a if fine[a] else 0, b if fine[b] else 0) for a, b in pairs]
        low, high = [a for a, _ in pairs], [b for _, b in pairs]
        widths = np.array([columns[k, b] - columns[k, a] for k, (a, b) in zip(run.rows, pairs, strict=True)])
        run.residual, run.known = mine[:, 0].copy(), True
        slopes = (mine[:, low] - mine[:, high]) / np.where(widths == 0.0, 1e-300, widths)
        run.jacobian, run.sloped = np.where(np.isfinite(slopes).all(axis=0), slopes, 0.0), True
        if not np.isfinite(run.residual).all():  # a simulation that runs away: this start leads nowhere
            run.residual, run.known, run.done, run.failed = np.zeros(len(mine)), False, True, True


def _whitened(model: Model, whitener: Whitener, columns: Sequence[np.ndarray]) -> np.ndarray:
    """Whitened residuals [samples, n] of columns of values."""
    predictions = model.predict(np.stack(columns, axis=1))
    return whitener.flat(model.blocks, residuals(model.blocks, predictions))
