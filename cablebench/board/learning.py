"""Learning curves of the agents on a board, read from the policies that lie in its folder.

Only the text beside the weights is read: no policy is loaded, nothing of it is executed.
"""

import hashlib
import json
import math
import zipfile
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

METADATA = "cable-policy.json"
"""Entry of a saved policy that says what it was trained for, `curve` among it."""


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
        Policies are looked for below them.
    records : iterable of mapping
        They name policies by the hash of their file; other policies are left out.

    Returns
    -------
    tuple of Curve
        By task, entrant and training seed.
    """
    wanted: dict[str, Mapping[str, Any]] = {}
    for r in records:
        digest = (r.get("settings") or {}).get("policy")
        if digest:
            wanted.setdefault(str(digest), r)
    if not wanted:
        return ()
    found: dict[str, Curve] = {}
    for path in (path for folder in folders for path in sorted(folder.rglob("*.zip"))):
        content = path.read_bytes()
        digest = hashlib.sha256(content).hexdigest()[:12]
        if digest in wanted and digest not in found and (points := _points(path)):
            r = wanted[digest]
            seed = r["training_seed"] or 0
            found[digest] = Curve(r["entrant"], r["task"], seed, *map(tuple, zip(*points, strict=True)))
    return tuple(sorted(found.values(), key=lambda c: (c.task, c.entrant, c.seed)))


def _points(path: Path) -> list[tuple[float, float]]:
    """(environment steps, reward) of a saved policy; nothing where the file does not tell."""
    try:
        with zipfile.ZipFile(path) as archive:
            curve = json.loads(archive.read(METADATA)).get("curve") or ()
        points = [(float(p[0]), float(p[-1])) for p in curve if p[-1] is not None]
    except (zipfile.BadZipFile, KeyError, ValueError, TypeError, AttributeError, IndexError):
        return []
    return [p for p in points if all(map(math.isfinite, p))]
