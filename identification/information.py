"""How well the parameters are determined: Fisher information, correlations, directions, profile-likelihood intervals.

Noise is taken as normal with `RatioProblem.noise_std`, independent from point to point. delta and rho0 enter the ratio
as rho0 (1 + delta) only (docs/physics.md): with both free the information matrix is singular, and which further
measurement makes it regular is computed by `delta_experiments`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq
from scipy.stats import chi2

from cable_envs.core.intervals import Interval
from cable_envs.identification.least_squares import refine
from cable_envs.identification.model import FORMS, NAMES, ratio_jacobian
from cable_envs.identification.problem import RatioProblem

_SINGULAR = 1e-12
"""eigenvalues of the scaled information below this share of the largest are rounding"""


@dataclass(frozen=True)
class Information:
    """Fisher information of points on parameters; covariance, correlation and confidence intervals follow from it.

    Parameters
    ----------
    names : tuple of str
        The parameters, in the order of all arrays.
    values : ndarray
        Where it is taken [names].
    matrix : ndarray
        The information matrix [names, names], over the noise's variance.
    """

    names: tuple[str, ...]
    values: np.ndarray
    matrix: np.ndarray
    """[n, n], in inverse physical units: the inverse covariance that no unbiased estimate can beat"""

    @property
    def _eigen(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        # scaled to a unit diagonal, otherwise K (thousands) and delta (hundredths) drown the small eigenvalues
        scale = np.sqrt(np.maximum(np.diag(self.matrix), 1e-300))
        values, vectors = np.linalg.eigh(self.matrix / np.outer(scale, scale))
        return scale, values, vectors

    @property
    def regular(self) -> bool:
        """Whether every parameter is determined at all."""
        values = self._eigen[1]
        return bool(values[0] > _SINGULAR * values[-1])

    @property
    def covariance(self) -> np.ndarray:
        """[n, n]; for a parameter with a share in an undetermined direction: infinite variance, NaN beside it."""
        scale, values, vectors = self._eigen
        good = values > _SINGULAR * values[-1]
        inverse = (vectors[:, good] / values[good]) @ vectors[:, good].T / np.outer(scale, scale)
        lost = np.any(np.abs(vectors[:, ~good]) > 1e-5, axis=1)
        inverse[lost, :] = inverse[:, lost] = np.nan
        inverse[lost, lost] = np.inf
        return inverse

    @property
    def std(self) -> dict[str, float]:
        """Smallest standard deviation an unbiased estimate can have (Cramer-Rao), by name; inf where undetermined."""
        return dict(zip(self.names, map(float, np.sqrt(np.diag(self.covariance))), strict=True))

    @property
    def correlation(self) -> np.ndarray:
        """[n, n] correlation of the estimates; NaN where undetermined."""
        covariance = self.covariance
        with np.errstate(invalid="ignore", divide="ignore"):
            return covariance / np.sqrt(np.outer(np.diag(covariance), np.diag(covariance)))

    @property
    def directions(self) -> list[tuple[float, dict[str, float]]]:
        """(standard deviation, share of each parameter) of relative changes, the worst determined direction first.

        The shares are a unit vector of changes d theta / theta; its standard deviation is inf where nothing is known.
        """
        relative = self.matrix * np.outer(self.values, self.values)
        values, vectors = np.linalg.eigh(relative)
        found = []
        for value, vector in zip(values, vectors.T, strict=True):
            vector = vector * np.sign(vector[np.argmax(np.abs(vector))])
            std = float("inf") if value <= _SINGULAR * values[-1] else float(1 / np.sqrt(value))
            found.append((std, dict(zip(self.names, map(float, vector), strict=True))))
        return found


def fisher(
    problem: RatioProblem,
    parameters: Mapping[str, float],
    names: Sequence[str] | None = None,
    prior_std: Mapping[str, float] | None = None,
) -> Information:
    """Information matrix of the problem's points on parameters, which says what they can identify.

    Parameters
    ----------
    problem : RatioProblem
        Points with their noise.
    parameters : Mapping of str to float
        Where slopes are taken: all of `cable_envs.identification.model.NAMES`, SI.
    names : sequence of str, optional
        Of which parameters; by default the problem's free ones.
    prior_std : Mapping of str to float, optional
        Standard deviations of separate measurements of some of them, in their units.

    Returns
    -------
    Information
        Its `std` and `correlation` are the limits of Cramer and Rao.
    """
    names = tuple(problem.free if names is None else names)
    slopes = scaled_slopes(problem, parameters)[:, [NAMES.index(name) for name in names]]
    matrix = slopes.T @ slopes
    for name, std in (prior_std or {}).items():
        k = names.index(name)
        matrix[k, k] += 1.0 / std**2
    return Information(names, np.array([parameters[name] for name in names]), matrix)


def scaled_slopes(problem: RatioProblem, parameters: Mapping[str, float]) -> np.ndarray:
    """(d n / d theta) / noise_std [points, 5], columns as `model.NAMES`."""
    theta = np.array([float(parameters[name]) for name in NAMES])
    slopes = ratio_jacobian(FORMS[problem.model], theta, problem.wrap, problem.speed)
    return slopes / problem.noise_std[:, None]


@dataclass(frozen=True)
class ProfileInterval(Interval):
    """Profile-likelihood interval. An end that lies on the search bound is no end: the data do not limit it there."""

    name: str
    low_open: bool
    high_open: bool
    curve: np.ndarray
    """[2, points]: value of the parameter, cost above the best (chi-square), the others refitted at each"""


def profile_interval(
    problem: RatioProblem, parameters: Mapping[str, float], name: str, level: float = 0.95
) -> ProfileInterval:
    """Profile-likelihood interval of a parameter.

    All values for which the refitted others reach a chi-square within the quantile of ``level`` (Venzon, Moolgavkar,
    Appl. Statist. 37 (1988) 87).

    Parameters
    ----------
    problem : RatioProblem
        Points, model and bounds.
    parameters : Mapping of str to float
        The best ones, from which the others are refitted.
    name : str
        The parameter, one of the problem's free ones.
    level : float
        Of confidence.

    Returns
    -------
    ProfileInterval
        With the curve; an end on a bound is open: the data do not limit the parameter there.
    """
    problem = problem.changed(weighted=True, log_gain=True)
    best = refine(problem, problem.unit(parameters))
    values, floor = problem.named(best.x), 2.0 * best.cost
    limit = float(chi2.ppf(level, 1))
    std = fisher(problem, values).std[name]
    curve = {values[name]: 0.0}
    ends = []
    for sign, bound in zip((-1.0, 1.0), problem.box[name], strict=True):
        ends.append(_end(problem, values, name, sign, bound, std, floor, limit, curve))
    (low, low_open), (high, high_open) = ends
    return ProfileInterval(values[name], low, high, name, low_open, high_open, np.array(sorted(curve.items())).T)


def _end(problem, values, name, sign, bound, std, floor, limit, curve):
    """(value, whether it is the search bound) where the profile rises to ``limit`` on one side."""
    state = {"start": values}

    def above(value: float) -> float:
        inner = problem.changed(fixed={**problem.fixed, name: value})
        found = refine(inner, inner.unit(state["start"]))
        state["start"] = inner.named(found.x)
        rise = 2.0 * found.cost - floor
        curve[value] = rise
        return rise - limit

    step = std if np.isfinite(std) and std > 0 else 0.1 * abs(bound - values[name])
    inside, reach = values[name], step
    while True:
        value = values[name] + sign * reach
        if sign * value >= sign * bound:
            value = bound
        if above(value) > 0.0:
            return float(brentq(above, inside, value, rtol=1e-4, xtol=1e-4 * step)), False
        if value == bound:
            return float(bound), True
        inside, reach = value, reach * 1.5 + 0.5 * step


def speed_shares(problem: RatioProblem, parameters: Mapping[str, float]) -> dict[str, np.ndarray]:
    """Which speeds matter: for each free parameter, the factor on its variance if one speed were not measured.

    Returns {"speed": [speeds], name: [speeds]}; 1 means that the speed tells nothing about the parameter.
    """
    columns = [NAMES.index(name) for name in problem.free]
    slopes = scaled_slopes(problem, parameters)[:, columns]
    whole = np.diag(np.linalg.inv(slopes.T @ slopes))
    speeds = np.unique(problem.speed)
    factors = []
    for speed in speeds:
        kept = slopes[problem.speed != speed]
        factors.append(np.diag(np.linalg.inv(kept.T @ kept)) / whole)
    return {"speed": speeds, **dict(zip(problem.free, np.array(factors).T, strict=True))}


@dataclass(frozen=True)
class Experiment:
    """What would separate delta from rho0, and how well it would determine them."""

    name: str
    std_delta: float
    std_rho0: float
    why: str


def delta_experiments(
    problem: RatioProblem,
    parameters: Mapping[str, float],
    *,
    cable_radius: float,
    camera_std: float = 0.01e-3,
    other_load: float = 2.0,
    other_hole: float = 2.0,
) -> list[Experiment]:
    """What would separate delta from rho0, and how well.

    Always with the exact ratio: Eq. (22) is a truncation in which rho0 and delta seem to differ by terms of second
    order in delta.

    Parameters
    ----------
    problem : RatioProblem
        The points that there are.
    parameters : Mapping of str to float
        Where slopes are taken.
    cable_radius, camera_std : float
        m (0.01 mm: the camera of section 5.1).
    other_load, other_hole : float
        Factors on load and hole radius of a second set of the same points.

    Returns
    -------
    list of Experiment
        Standard deviations of delta and rho0 after the problem's points and one more measurement each.
    """
    names = NAMES
    problem = problem.changed(model="exact")
    rho0, delta = parameters["rho0"], parameters["delta"]
    relative = camera_std / cable_radius
    rho0_std = rho0 * relative * np.sqrt(1.0 + 1.0 / rho0**2)  # of R / r, both measured
    base = scaled_slopes(problem, parameters)

    def entry(name, slopes, why, priors=None):
        matrix = slopes.T @ slopes
        for k, std in (priors or {}).items():
            matrix[k, k] += 1.0 / std**2
        columns = names if matrix.shape[0] == 5 else (*names, "rho0 of the second hole")
        values = np.append([parameters[n] for n in names], [rho0 * other_hole] * (len(columns) - 5))
        std = Information(columns, values, matrix).std
        return Experiment(name, std["delta"], std["rho0"], why)

    heavier = dict(parameters) | {"delta": other_load * delta}
    loaded = scaled_slopes(problem, heavier) * other_load  # the same sensor has less noise in the ratio
    loaded[:, names.index("delta")] *= other_load  # delta grows with the load, rho0 does not
    second = scaled_slopes(problem, dict(parameters) | {"rho0": rho0 * other_hole})
    two_holes = np.zeros((2 * len(base), 6))
    two_holes[: len(base), :5] = base
    two_holes[len(base) :, [0, 1, 2, 3, 5]] = second
    d, r = names.index("delta"), names.index("rho0")
    return [
        entry("ratios alone", base, "rho0 (1 + delta) is one number"),
        entry("ratios again in a second hole", two_holes, "each hole brings its own rho0, times the same factor"),
        entry("rho0 from diameters outside", base, "R and r measured unloaded", {r: rho0_std}),
        entry(
            "compressed diameter in the hole",
            base,
            "R, r and r - eps measured: delta itself",
            {r: rho0_std, d: relative},
        ),
        entry(
            "ratios again under another load", np.vstack([base, loaded]), "delta follows the load (G4), rho0 does not"
        ),
    ]
