"""A tendon in a sheath while it slides: friction, stiffness and load by lines through its records.

While the load's end moves, the tendon slides all along, and with a = mu Theta, pulled in (+) or paid out (-)

    T1 = T2 e^(+-a)        Tm = T2 (e^(+-a) - 1) / (+-a)        T2 = preload + k_l y        x - y = Tm / k +- gap / 2

(`cable_envs.plants.sheath.plant`). Each way has a constant of its own in the last line, so that a gap, of which nothing
is known yet, does not count as stretch. Two of T1, T2 and y, with x, tell a; with T2 and y by how much more the tendon
is stretched for the same T2 pulled in than paid out, e^a. Masses and dampings are left out: the motion is slow.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import binary_erosion

from cable_envs.diagnosis.systems.common import SMOOTHED, Sampled, smooth_speed

MOVES = 0.1
"""Share of its 95 % quantile from which on the speed of the load's end counts as sliding."""
ENOUGH = 20
"""Samples that must slide each way."""
CERTAIN = 0.1
"""Standard error of a slope, as a share of it, up to which a line tells it."""


@dataclass(frozen=True)
class _Sliding:
    """Samples [m] of all records in which the tendon slides, SI: drive, tensions, place of the load; and which way."""

    x: np.ndarray
    t1: np.ndarray | None
    t2: np.ndarray | None
    y: np.ndarray | None
    way: np.ndarray


def begin(
    series: Sequence[Mapping[str, Sampled]], values: Mapping[str, float], period: float, said: Collection[str]
) -> dict[str, float]:
    """Friction coefficient, stiffness of the tendon, and spring and preload of the load; see the package."""
    slides = _sliding(series, period)
    a = _friction(slides) if slides is not None else None
    if slides is None or a is None:
        return {}
    r = slides.way * a
    t2 = slides.t2 if slides.t1 is None or slides.t2 is not None else slides.t1 * np.exp(-r)
    assert t2 is not None, "friction is told by one of both tensions at least"
    mean = t2 * np.expm1(r) / r
    ways = [slides.way > 0.0, slides.way < 0.0]
    if slides.y is not None:
        load, stretch = _line([np.ones(len(r)), slides.y], t2), _line([*ways, mean], slides.x - slides.y)
        if load is None or stretch is None:
            return {}
        spring, preload, stiffness = load[1], load[0], 1.0 / stretch[2]
    else:
        line = _line([*ways, t2, mean], slides.x)
        if line is None:
            return {}
        spring, stiffness = 1.0 / line[2], 1.0 / line[3]
        preload = -spring * 0.5 * (line[0] + line[1])
    found = {"load_stiffness": spring, "load_preload": preload}
    if values["bend_angle"] > 0.0:
        found["friction_coefficient"] = a / values["bend_angle"]
    if stiffness < values["sheath_stiffness"]:
        found["tendon_stiffness"] = 1.0 / (1.0 / stiffness - 1.0 / values["sheath_stiffness"])
    return {name: float(value) for name, value in found.items() if value > 0.0}


def _sliding(series: Sequence[Mapping[str, Sampled]], period: float) -> _Sliding | None:
    """The samples that slide; None where the records have too few of them, or of their channels."""
    far = next((n for n in ("load_position", "load_tension") if all(n in seen for seen in series)), None)
    wanted = ("drive_position", "drive_tension", "load_tension", "load_position")
    names = [n for n in wanted if all(n in seen for seen in series)]
    if far is None or "drive_position" not in names or len(names) < 3:
        return None
    speeds = [smooth_speed(seen[far].values, period) for seen in series]
    least = MOVES * float(np.quantile(np.abs(np.concatenate(speeds)), 0.95))
    parts: dict[str, list[np.ndarray]] = {name: [] for name in (*names, "way")}
    for seen, speed in zip(series, speeds, strict=True):
        drive = smooth_speed(seen["drive_position"].values, period)
        slides = (np.abs(speed) > least) & (np.sign(drive) == np.sign(speed))
        good = binary_erosion(slides, np.ones(2 * round(0.5 * SMOOTHED / period) + 1))  # speeds are of so many samples
        good &= np.logical_and.reduce([seen[n].good for n in names])
        for name in names:
            parts[name].append(seen[name].values[good])
        parts["way"].append(np.sign(speed[good]))
    joined = {name: np.concatenate(values) for name, values in parts.items()}
    x, t1, t2, y = (joined.get(name) for name in wanted)
    if x is None or min(np.sum(joined["way"] > 0.0), np.sum(joined["way"] < 0.0)) < ENOUGH:
        return None
    return _Sliding(x, t1, t2, y, joined["way"])


def _friction(slides: _Sliding) -> float | None:
    """mu Theta; None where the samples do not tell it."""
    x, t1, t2, y = slides.x, slides.t1, slides.t2, slides.y
    if t1 is not None and t2 is not None:
        taut = (t1 > 0.0) & (t2 > 0.0)
        pulled, paid = (np.log(t1[taut & way] / t2[taut & way]) for way in (slides.way > 0.0, slides.way < 0.0))
        a = 0.5 * (np.median(pulled) - np.median(paid)) if min(len(pulled), len(paid)) >= ENOUGH else 0.0
    elif t1 is not None and y is not None:
        a = 0.5 * _steeper(slides.way, t1, y)
    elif t2 is not None and y is not None:
        a = _steeper(slides.way, x - y, t2)
    else:
        return None
    return float(a) if a > 0.0 else None


def _steeper(way: np.ndarray, rises: np.ndarray, over: np.ndarray) -> float:
    """Logarithm of how much steeper something rises while the tendon is pulled in; 0 where lines do not tell it."""
    slopes = []
    for along in (way > 0.0, way < 0.0):
        line = _line([np.ones(int(np.sum(along))), over[along]], rises[along])
        if line is None:
            return 0.0
        slopes.append(line[1])
    return float(np.log(slopes[0] / slopes[1]))


def _line(columns: Sequence[np.ndarray], wanted: np.ndarray) -> np.ndarray | None:
    """Least squares; None where a slope, which is no column of zeros and ones, is not positive or not certain."""
    design = np.column_stack(columns).astype(float)
    slopes = [k for k in range(design.shape[1]) if np.any((design[:, k] != 0.0) & (design[:, k] != 1.0))]
    found, _, rank, _ = np.linalg.lstsq(design, wanted, rcond=None)
    if rank < design.shape[1]:
        return None
    left = wanted - design @ found
    variance = float(left @ left) / max(len(wanted) - rank, 1) * np.diag(np.linalg.inv(design.T @ design))
    certain = all(found[k] > 0.0 and np.sqrt(variance[k]) < CERTAIN * found[k] for k in slopes)
    return found if certain else None
