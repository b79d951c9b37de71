"""SVG path data read back to the points it passes, as a viewer does."""

import re

import numpy as np

_COUNT = {"m": 2, "l": 2, "h": 1, "v": 1, "q": 4, "c": 6, "z": 0}


def points_of(data: str) -> np.ndarray:
    """End points of a path's segments, shape (n, 2), from commands M, L, Q, C, h, v and z, relative or not."""
    words = re.findall(r"[a-zA-Z]|-?(?:\d+\.?\d*|\.\d+)(?:e-?\d+)?", data)
    points, at, k, command = [], np.zeros(2), 0, ""
    while k < len(words):
        if words[k].isalpha():
            command, k = words[k], k + 1
        count = _COUNT[command.lower()]
        if count:
            end = [float(w) for w in words[k + max(count - 2, 0) : k + count]]
            if command in "hv":
                end = [*end, 0.0] if command == "h" else [0.0, *end]
            at = at + np.array(end) if command.islower() else np.array(end)
            points.append(at)
            k += count
    return np.array(points).reshape(-1, 2)
