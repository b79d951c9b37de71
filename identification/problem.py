"""What is identified from what: measured tension ratios over wrap and speed, the model, the search box.

The cost is Eq. (23) of Gu 2024, the sum over all points of (n_i - n(theta; wrap_i, v_i))^2; ``weighted`` divides each
residual by the standard deviation of its noise first, so that the cost is a chi-square. All methods search the unit
box: each free parameter mapped from its bounds, the gain K either linearly, as in the paper, or by its logarithm.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from cable_envs.core.errors import ConfigurationError, nearest, require_known
from cable_envs.identification.model import FORMS, GAIN, NAMES, costs, ratio_jacobian, ratios

BOUNDS: Mapping[str, tuple[float, float]] = {
    "delta": (0.0, 0.1), "mu": (0.05, 1.0), "K": (10.0, 20e3), "omega": (1.0, 4.0), "rho0": (0.2, 20.0),
}  # fmt: skip
"""Search box; chosen around Table A1 (.009-.042, .27-.43, 1192-9982, 1.66-3.53), since the paper prints none."""

PAPER_RHO0 = 1.5
"""inferred, docs/physics.md"""


def _points(name: str, values, count: int | None, low: float, strict: bool = False) -> np.ndarray:
    array = np.array(values, dtype=float, ndmin=1)
    if count is not None and array.size == 1:
        array = np.full(count, array.flat[0])
    if array.ndim != 1 or (count is not None and len(array) != count):
        raise ConfigurationError(f"{name}: expected {count} numbers in a row, got the shape {array.shape}")
    bad = ~np.isfinite(array) | ((array <= low) if strict else (array < low))
    if np.any(bad):
        k = int(np.argmax(bad))
        limit = f"{'above' if strict else 'at least'} {low:g}"
        raise ConfigurationError(f"{name}[{k}] = {array[k]:g} must be finite and {limit}")
    return array


@dataclass(frozen=True)
class RatioProblem:
    """Points, model and bounds. Raises ConfigurationError for shapes, signs and names that cannot be meant."""

    wrap: np.ndarray
    """theta_e, rad [points]"""
    speed: np.ndarray
    """sliding speed, m/s [points]; its absolute value counts"""
    ratio: np.ndarray
    """measured n >= about 1 [points]: the larger tension over the smaller"""
    noise_std: np.ndarray
    """standard deviation of ``ratio`` [points], or one number"""
    fixed: Mapping[str, float] = field(default_factory=lambda: {"rho0": PAPER_RHO0})
    """parameters that are known: not searched"""
    model: str = "g22"
    """"g22" (the paper's) or "exact" """
    weighted: bool = False
    log_gain: bool = False
    """search ln K instead of K"""
    bounds: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """replaces `BOUNDS` for the named parameters"""

    def __post_init__(self):
        object.__setattr__(self, "wrap", _points("wrap", self.wrap, None, 0.0))
        count = len(self.wrap)
        object.__setattr__(self, "speed", np.abs(_points("speed", np.abs(self.speed), count, 0.0)))
        object.__setattr__(self, "ratio", _points("ratio", self.ratio, count, 0.0, strict=True))
        object.__setattr__(self, "noise_std", _points("noise_std", self.noise_std, count, 0.0, strict=True))
        if self.model not in FORMS:
            raise ConfigurationError(f"unknown model '{self.model}'; {nearest(self.model, FORMS)}")
        require_known("parameter", [*self.fixed, *self.bounds], NAMES)
        if not self.free:
            raise ConfigurationError("every parameter is fixed: nothing to identify")
        if count < len(self.free):
            raise ConfigurationError(
                f"{count} points cannot determine {len(self.free)} parameters: {', '.join(self.free)}"
            )
        for name in self.free:
            low, high = self.box[name]
            if not (math.isfinite(low) and math.isfinite(high) and low < high):
                raise ConfigurationError(f"bounds of {name}: [{low:g}, {high:g}] is empty or not finite")
        if self.log_gain and "K" in self.free and self.box["K"][0] <= 0:
            raise ConfigurationError("K is searched by its logarithm: its lower bound must be positive")

    @cached_property
    def free(self) -> tuple[str, ...]:
        """Names of the searched parameters, in the order of `model.NAMES`."""
        return tuple(name for name in NAMES if name not in self.fixed)

    @cached_property
    def box(self) -> dict[str, tuple[float, float]]:
        """Bounds of every parameter."""
        bounds = {name: self.bounds.get(name, BOUNDS[name]) for name in NAMES}
        return {name: (float(low), float(high)) for name, (low, high) in bounds.items()}

    @cached_property
    def weight(self) -> np.ndarray:
        """Factor of each residual [points]."""
        return 1.0 / self.noise_std if self.weighted else np.ones(len(self.wrap))

    @property
    def noise_floor(self) -> float:
        """Expected cost at the best fit: the noise in all points less what the free parameters absorb of it."""
        share = 1.0 - len(self.free) / len(self.wrap)
        return float(np.sum((self.weight * self.noise_std) ** 2) * share)

    def changed(self, **changes) -> "RatioProblem":
        """The same problem with other fields; validated anew."""
        return replace(self, **changes)

    @cached_property
    def _map(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, bool]:
        """(rows of theta, low, span, whether the gain is among them as a logarithm) of the free parameters."""
        rows = np.array([NAMES.index(name) for name in self.free])
        ends = np.array([self.box[name] for name in self.free])
        logarithmic = self.log_gain and "K" in self.free
        if logarithmic:
            k = self.free.index("K")
            ends[k] = np.log(ends[k])
        return rows, ends[:, 0], ends[:, 1] - ends[:, 0], logarithmic

    def theta(self, unit: np.ndarray) -> np.ndarray:
        """Physical parameters [5, sets] (or [5]) of points [free, sets] (or [free]) of the unit box."""
        unit = np.asarray(unit, dtype=float)
        rows, low, span, logarithmic = self._map
        result = np.empty((5, *unit.shape[1:]))
        for name, value in self.fixed.items():
            result[NAMES.index(name)] = value
        result[rows] = (low + span * unit.T).T
        if logarithmic:
            result[GAIN] = np.exp(result[GAIN])
        return result

    def unit(self, parameters: Mapping[str, float]) -> np.ndarray:
        """The inverse of `theta` for one set given by name."""
        _, low, span, logarithmic = self._map
        values = np.array([float(parameters[name]) for name in self.free])
        if logarithmic:
            k = self.free.index("K")
            values[k] = math.log(values[k])
        return (values - low) / span

    def named(self, unit: np.ndarray) -> dict[str, float]:
        """`theta` of one point by name, fixed parameters included."""
        return dict(zip(NAMES, map(float, self.theta(unit)), strict=True))

    def costs(self, unit: np.ndarray) -> np.ndarray:
        """Costs [sets] of points [free, sets]; columns outside the box are allowed."""
        theta = np.ascontiguousarray(self.theta(unit))
        return costs(FORMS[self.model], theta, self.wrap, self.speed, self.ratio, self.weight)

    def residuals(self, unit: np.ndarray) -> np.ndarray:
        """weight (n - measured) [points] of one point [free]."""
        model = ratios(FORMS[self.model], self.theta(unit)[:, None], self.wrap, self.speed)[0]
        return self.weight * (model - self.ratio)

    def jacobian(self, unit: np.ndarray) -> np.ndarray:
        """d residuals / d unit [points, free], exact."""
        rows, _, span, logarithmic = self._map
        theta = self.theta(unit)
        slopes = ratio_jacobian(FORMS[self.model], theta, self.wrap, self.speed)[:, rows] * span
        if logarithmic:
            slopes[:, self.free.index("K")] *= theta[GAIN]
        return slopes * self.weight[:, None]


def ratio_at(parameters: Mapping[str, float], wrap, speed, model: str = "exact") -> np.ndarray:
    """Tension ratio for parameters by name.

    Parameters
    ----------
    parameters : Mapping of str to float
        All of `cable_envs.identification.model.NAMES`, SI.
    wrap, speed : array_like
        rad, m/s; they broadcast.
    model : str
        Of `cable_envs.identification.model.FORMS`.

    Returns
    -------
    ndarray
        Drive-side over load-side tension where the drive hauls.
    """
    wrap, speed = np.broadcast_arrays(np.asarray(wrap, float), np.abs(np.asarray(speed, float)))
    theta = np.array([[float(parameters[name])] for name in NAMES])
    return ratios(FORMS[model], theta, wrap.ravel().copy(), speed.ravel().copy())[0].reshape(wrap.shape)
