"""Learning curves of the agents on a board, read from policies, or from the file that keeps the curves without them.

Only the text beside the weights is read: no policy is loaded, nothing of it is executed.
"""

import hashlib
import json
import math
import zipfile
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cable_envs.core.files import packed_json, read_json, write_atomic

METADATA = "cable-policy.json"
"""Entry of a saved policy that says what it was trained for, `curve` among it."""


PACKED_CURVES = "curves.json.xz"
"""In a results folder: hash of a policy -> [environment steps, reward] of its training, a list of points."""

KEPT_POINTS = 40
"""Of a curve in that file."""

Points = list[tuple[float, float]]


@dataclass(frozen=True)
class Curve:
    """One training: mean reward per step of the last episodes over environment steps."""

    entrant: str
    task: str
    seed: int
    steps: tuple[float, ...]
    rewards: tuple[float, ...]


def learning_curves(folders: Iterable[Path], records: Iterable[Mapping[str, Any]]) -> tuple[Curve, ...]:
    """Learning curves of the agents on a board.

    Parameters
    ----------
    folders : iterable of Path
        Policies are looked for below them, and packed curves in them.
    records : iterable of mapping
        They name policies by the hash of their file; other policies are left out.

    Returns
    -------
    tuple of Curve
        By task, entrant and training seed.
    """
    wanted = _trained(records)
    found = []
    for digest, points in _found(folders, wanted).items():
        r = wanted[digest]
        found.append(Curve(r["entrant"], r["task"], r["training_seed"] or 0, *map(tuple, zip(*points, strict=True))))
    return tuple(sorted(found, key=lambda c: (c.task, c.entrant, c.seed)))


def pack_curves(folder: Path, folders: Iterable[Path], records: Iterable[Mapping[str, Any]]) -> int:
    """Keep the learning curves of a board without its policies.

    Parameters
    ----------
    folder : Path
        Gets the file, which replaces its predecessor whole or not at all; none where there is no curve.
    folders : iterable of Path
        As of `learning_curves`.
    records : iterable of mapping
        As of `learning_curves`.

    Returns
    -------
    int
        Number of curves.
    """
    found = _found([folder, *folders], _trained(records))
    if found:
        thin = {digest: [(round(x), round(y, 4)) for x, y in _thinned(points)] for digest, points in found.items()}
        write_atomic(folder / PACKED_CURVES, packed_json(dict(sorted(thin.items()))))
    return len(found)


def _trained(records: Iterable[Mapping[str, Any]]) -> dict[str, Mapping[str, Any]]:
    """Hash of a policy -> a record of it."""
    wanted: dict[str, Mapping[str, Any]] = {}
    for r in records:
        digest = (r.get("settings") or {}).get("policy")
        if digest:
            wanted.setdefault(str(digest), r)
    return wanted


def _found(folders: Iterable[Path], wanted: Collection[str]) -> dict[str, Points]:
    """The points of the wanted policies, where a folder has the policy, or its packed curve."""
    found: dict[str, Points] = {}
    places = list(folders) if wanted else []
    for path in (path for folder in places for path in sorted(folder.rglob("*.zip"))):
        digest = hashlib.sha256(path.read_bytes()).hexdigest()[:12]
        if digest in wanted and digest not in found and (points := _points(path)):
            found[digest] = points
    for path in (folder / PACKED_CURVES for folder in places):
        for digest, curve in _packed(path).items():
            if digest in wanted and digest not in found and (points := _numbers(curve)):
                found[digest] = points
    return found


def _packed(path: Path) -> Mapping[str, Any]:
    try:
        content = read_json(path) if path.is_file() else {}
    except (OSError, ValueError):
        return {}
    return content if isinstance(content, Mapping) else {}


def _points(path: Path) -> Points:
    """(environment steps, reward) of a saved policy; nothing where the file does not tell."""
    try:
        with zipfile.ZipFile(path) as archive:
            return _numbers(json.loads(archive.read(METADATA)).get("curve") or ())
    except (zipfile.BadZipFile, KeyError, ValueError, AttributeError):
        return []


def _numbers(curve: Any) -> Points:
    """The finite points of a curve; nothing where it is none."""
    try:
        points = [(float(p[0]), float(p[-1])) for p in curve if p[-1] is not None]
    except (KeyError, ValueError, TypeError, IndexError):
        return []
    return [p for p in points if all(map(math.isfinite, p))]


def _thinned(points: Points) -> Points:
    """About `KEPT_POINTS` of them, the first and the last among them."""
    chosen = {round(k * (len(points) - 1) / (KEPT_POINTS - 1)) for k in range(KEPT_POINTS)}
    return [points[k] for k in sorted(chosen)]
