"""Products of parameters that are known where the parameters themselves are not: sloppy directions, by their names.

Near the optimum the logarithms of the parameters are normal with the covariance C (Laplace's approximation). A group of
them of which a combination  sum_i k_i ln x_i  is known much better than any member is a product  x_1^k_1 x_2^k_2 ..
that the records fix, while they let the members slide along it (Gutenkunst et al., PLoS Comput. Biol. 3 (2007) e189).
The combination is the eigenvector of the smallest eigenvalue of the group's correlations: at right angles to where the
members slide, each in its own standard deviation.

A parabola tells no bend and no bound. So each member is held a standard deviation to either side, and all others are
refitted (profile likelihood; Raue et al., Bioinformatics 25 (2009) 1923): how the cost rises there says how far the
member is open, and how far the product moves there is added to its interval. A sum of two parameters that is known
bends away from every product.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np

from cable_envs.core.intervals import NORMAL_95
from cable_envs.diagnosis.fit.refit import Fit, Start, refit
from cable_envs.diagnosis.model.model import Model, Whitener

OPEN = 0.1
"""Relative standard deviation from which a parameter counts as not known by itself."""
CLOSER = 1.0 / 3.0
"""Of a member's standard deviation, that the product's has at the most: nine tenths of the variance are then shared."""
LARGEST = 4
"""Members of a group, at the most."""
MATTERS = 0.5
"""Least share of a member in a group, over that of a group whose members all have the same."""
NEW = 0.3
"""Least part of a product, as a direction of length 1, that is in no other product."""
FARTHEST = float(np.log(3.0))
"""Of a profile: logarithm of the factor by which a parameter is moved at the most."""
STEEPER = (0.25, 100.0)
"""Rise of the cost over its parabola's that is believed."""
ITERATIONS = 4
"""Of each refit of a profile, from where the parabola says that it ends."""


@dataclass(frozen=True)
class Product:
    """A product of powers that is known better than its members.

    Parameters
    ----------
    names : tuple of str
        Parameters, the one with the largest exponent first.
    exponents : tuple of float
        Of each; the first is 1.
    nulls : tuple of float
        What is subtracted from each before the power is taken: the value without the effect, 0 for most.
    value, low, high : float
        The product and its 95 % interval, in products of the parameters' units.
    alone : tuple of (float, float)
        95 % interval of each member, less its null.
    """

    names: tuple[str, ...]
    exponents: tuple[float, ...]
    nulls: tuple[float, ...]
    value: float
    low: float
    high: float
    alone: tuple[tuple[float, float], ...]

    def as_json(self, units: Mapping[str, str]) -> dict[str, Any]:
        """As in the JSON's "products"; units: of every parameter."""
        parts = [(units.get(n, ""), k) for n, k in zip(self.names, self.exponents, strict=True)]
        unit = " ".join(u if k == 1.0 else f"({u})^{k:g}" for u, k in parts if u not in ("", "1"))
        return {
            "names": self.names, "exponents": self.exponents, "less": self.nulls, "value": self.value, "unit": unit,
            "ci95": [self.low, self.high], "alone_ci95": [list(ends) for ends in self.alone],
        }  # fmt: skip


@dataclass(frozen=True)
class _Sizes:
    """Parameters as logarithms of their distance from the null: names, nulls, distances (signed) and covariance."""

    names: tuple[str, ...]
    nulls: np.ndarray
    away: np.ndarray
    covariance: np.ndarray

    @property
    def std(self) -> np.ndarray:
        """Relative standard deviations."""
        return np.sqrt(np.diag(self.covariance))

    def logs(self, values: Mapping[str, float]) -> np.ndarray:
        """Of values by name; what has crossed its null is next to it."""
        ratio = np.array([values[n] for n in self.names]) - self.nulls
        return np.log(np.maximum(ratio / self.away, 1e-6)) + np.log(np.abs(self.away))


def products(
    model: Model, whitener: Whitener, fit: Fit, nulls: Mapping[str, float], without: Sequence[str] = ()
) -> tuple[Product, ...]:
    """Products that a refit knows much better than their members.

    Parameters
    ----------
    model : Model
        Whose parameters were refitted; it is refitted for the profiles, with `ITERATIONS` iterations for either end of
        each member of a product.
    whitener : Whitener
        The noise.
    fit : Fit
        The refit. Its covariance may be wider than the curvature.
    nulls : Mapping of str to float
        Value of a parameter that leaves its effect out; 0 for those that are not here.
    without : sequence of str
        Parameters that are no sizes: offsets.

    Returns
    -------
    tuple of Product
        Pairs first; empty where every parameter is known by itself, or by no product either.

    Examples
    --------
    Of  y = stiffness * gain * u  with steps u, no record tells the stiffness from the gain::

        (found,) = products(model, whitener, fit, {})
        found.names, found.exponents    # ("gain", "stiffness"), (1.0, 1.0)
    """
    sizes = _sizes(fit, nulls, without)
    groups = list(_groups(sizes))
    if not groups:
        return ()
    members = sorted({k for group, _ in groups for k in group})
    profile = _profile(model, whitener, fit, sizes, members)
    bounds = _bounds(model, sizes)
    found = (_product(sizes, bounds, profile, group, exponents) for group, exponents in groups)
    return tuple(one for one in found if one is not None)


def _sizes(fit: Fit, nulls: Mapping[str, float], without: Sequence[str]) -> _Sizes:
    """What is away from its null, and open by itself."""
    null = np.array([nulls.get(name, 0.0) for name in fit.free])
    away = np.array([fit.values[name] for name in fit.free]) - null
    kept = [k for k, name in enumerate(fit.free) if away[k] != 0.0 and name not in without]
    relative = fit.covariance[np.ix_(kept, kept)] / np.outer(away[kept], away[kept])
    opened = [j for j in range(len(kept)) if np.sqrt(relative[j, j]) > OPEN]
    names = tuple(fit.free[kept[j]] for j in opened)
    rows = [kept[j] for j in opened]
    return _Sizes(names, null[rows], away[rows], relative[np.ix_(opened, opened)])


def _bounds(model: Model, sizes: _Sizes) -> list[tuple[float, float]]:
    """Bounds of every size, as logarithms of the distance from the null on its side."""
    rows, found = {p.name: p for p in model.parameters}, []
    for name, null, away in zip(sizes.names, sizes.nulls, sizes.away, strict=True):
        ends = ((end - null) * np.sign(away) for end in (rows[name].low, rows[name].high))
        low, high = sorted(float(np.log(end)) if end > 0.0 else -np.inf for end in ends)
        found.append((low, high))
    return found


def _groups(sizes: _Sizes) -> Iterator[tuple[tuple[int, ...], np.ndarray]]:
    """(members, their exponents) of groups of which a product is known, pairs first, none that others imply."""
    std = sizes.std
    correlation = sizes.covariance / np.outer(std, std)
    directions: list[np.ndarray] = []
    for count in range(2, min(LARGEST, len(std)) + 1):
        found = []
        for group in combinations(range(len(std)), count):
            values, vectors = np.linalg.eigh(correlation[np.ix_(group, group)])
            vector = vectors[:, 0] * np.sqrt(count)  # a member that has its share has 1
            if np.sqrt(max(values[0], 0.0) * count) < CLOSER and np.min(np.abs(vector)) > MATTERS:
                found.append((float(values[0]), group, vector))
        for _, group, vector in sorted(found, key=lambda one: one[0]):
            direction = np.zeros(len(std))
            direction[list(group)] = vector / np.sqrt(count)
            if _new(direction, directions):
                directions.append(direction)
                exponents = vector / std[list(group)]
                yield group, exponents / exponents[int(np.argmax(np.abs(exponents)))]


def _new(direction: np.ndarray, others: Sequence[np.ndarray]) -> bool:
    """Whether a direction is not in the span of others."""
    if not others:
        return True
    basis = np.array(others).T
    rest = direction - basis @ np.linalg.lstsq(basis, direction, rcond=None)[0]
    return float(np.linalg.norm(rest)) > NEW


@dataclass(frozen=True)
class _Ends:
    """Profile of one member, held at either end: its logarithm [2] and all members' [2, members] there.

    spread: its standard deviation to either side [2], by how the cost rises.
    """

    at: np.ndarray
    logs: np.ndarray
    spread: np.ndarray


def _profile(
    model: Model, whitener: Whitener, fit: Fit, sizes: _Sizes, members: Sequence[int]
) -> tuple[np.ndarray, dict[int, _Ends]]:
    """(logarithms at the optimum, ends of every member), from one batch of refits with one parameter held."""
    (best,) = refit(model, whitener, [Start("", fit.free, fit.values)], ITERATIONS, central=False)
    rows = {p.name: p for p in model.parameters}
    top = sizes.logs(best.values)
    starts, held = [], []
    for k in members:
        name, reach = sizes.names[k], min(float(sizes.std[k]), FARTHEST)
        for sign in (-1.0, 1.0):
            there = float(best.values[name] - sizes.nulls[k]) * float(np.exp(sign * reach)) + float(sizes.nulls[k])
            value = rows[name].clip(there)
            starts.append(Start("", tuple(n for n in fit.free if n != name), _along(fit, best, sizes, k, value)))
            held.append((k, value))
    profiled = refit(model, whitener, starts, ITERATIONS, central=False)
    ends: dict[int, list[tuple[float, np.ndarray, float]]] = {k: [] for k in members}
    for (k, value), one in zip(held, profiled, strict=True):
        name, p = sizes.names[k], rows[sizes.names[k]]
        priors = ((one.values[name] - p.start) ** 2 - (best.values[name] - p.start) ** 2) / p.std**2 if p.std else 0.0
        logs = sizes.logs({**one.values, name: value})
        ends[k].append((float(logs[k]), logs, one.cost + priors - best.cost))
    curved = np.diag(best.covariance)[[best.free.index(n) for n in sizes.names]] / sizes.away**2
    return top, {k: _ends(k, top, sizes, curved, both) for k, both in ends.items()}


def _along(fit: Fit, best: Fit, sizes: _Sizes, k: int, value: float) -> dict[str, float]:
    """Where the others are expected where one is held: sizes along the logarithms, the rest along a line."""
    row = fit.free.index(sizes.names[k])
    ratio = (value - sizes.nulls[k]) / (best.values[sizes.names[k]] - sizes.nulls[k])
    moved = {**best.values, sizes.names[k]: value}
    for j, name in enumerate(fit.free):
        if j == row or name not in sizes.names:
            continue
        i = sizes.names.index(name)
        slope = sizes.covariance[i, k] / sizes.covariance[k, k]
        moved[name] = float((best.values[name] - sizes.nulls[i]) * max(ratio, 1e-3) ** slope + sizes.nulls[i])
    return moved


def _ends(
    k: int, top: np.ndarray, sizes: _Sizes, curved: np.ndarray, both: Sequence[tuple[float, np.ndarray, float]]
) -> _Ends:
    """The spread to either side: as the covariance says, where the cost rises as its parabola does."""
    spread = []
    for at, _, rise in both:
        expected = (at - top[k]) ** 2 / curved[k]
        steeper = rise / expected if expected > 0.0 else 1.0  # on its bound already
        spread.append(float(sizes.std[k]) / float(np.sqrt(np.clip(steeper, *STEEPER))))
    at, logs, _ = zip(*both, strict=True)
    return _Ends(np.array(at), np.array(logs), np.array(spread))


def _product(
    sizes: _Sizes, bounds: Sequence[tuple[float, float]], profile: tuple[np.ndarray, Mapping[int, _Ends]],
    group: tuple[int, ...], exponents: np.ndarray,
) -> Product | None:  # fmt: skip
    """The product of a group with what its profiles say; None where they show that it is no closer than its members."""
    top, ends = profile
    rounded = np.array([float(f"{k:.2g}") for k in exponents])
    own = list(group)
    std = float(np.sqrt(rounded @ sizes.covariance[np.ix_(own, own)] @ rounded))
    center = float(rounded @ top[own])
    low = high = center
    for k in own:
        for at, logs, spread in zip(ends[k].at, ends[k].logs, ends[k].spread, strict=True):
            way = abs(at - top[k])  # a bend grows with its square
            share = min(NORMAL_95 * spread / way, FARTHEST / way) ** 2 if way > 0.0 else 0.0
            there = center + share * (float(rounded @ logs[own]) - center)
            low, high = min(low, there), max(high, there)
    low, high = low - NORMAL_95 * std, high + NORMAL_95 * std
    alone = [
        (
            max(top[k] - NORMAL_95 * ends[k].spread[0], bounds[k][0]),
            min(top[k] + NORMAL_95 * ends[k].spread[1], bounds[k][1]),
        )
        for k in own
    ]
    widths = np.abs(rounded) * np.array([b - a for a, b in alone])
    single = np.array([b - a for a, b in alone])
    widest = 2.0 * NORMAL_95 * FARTHEST  # as far as the profiles tell
    if high - low > min(CLOSER * float(np.min(widths)), widest) or float(np.min(single)) < 2.0 * NORMAL_95 * OPEN:
        return None
    order = sorted(range(len(own)), key=lambda j: (-abs(rounded[j]), -rounded[j]))
    signs = np.sign(sizes.away[own])
    value, lowest, highest = (float(np.exp(log)) for log in (center, low, high))
    return Product(
        tuple(sizes.names[own[j]] for j in order), tuple(float(rounded[j]) for j in order),
        tuple(float(sizes.nulls[own[j]]) for j in order),
        value, lowest, highest,
        tuple(_ordered(*(float(signs[j] * np.exp(end)) for end in alone[j])) for j in order),
    )  # fmt: skip


def _ordered(one: float, other: float) -> tuple[float, float]:
    return min(one, other), max(one, other)
