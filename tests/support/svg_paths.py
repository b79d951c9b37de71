"""SVG path data read back to the points it passes, as a viewer does."""

import re

import numpy as np

_COUNT = {"m": 2, "l": 2, "q": 4, "c": 6, "z": 0}


def points_of(data: str) -> np.ndarray:
    """End points of a path's segments, shape (n, 2), from commands M, L, Q, C and z, absolute or relative."""
    words = re.findall(r"[a-zA-Z]|-?(?:\d+\.?\d*|\.\d+)(?:e-?\d+)?", data)
    points, at, k, command = [], np.zeros(2), 0, ""
    while k < len(words):
        if words[k].isalpha():
            command, k = words[k], k + 1
        count = _COUNT[command.lower()]
        if count:
            end = np.array([float(w) for w in words[k + count - 2 : k + count]])
            at = at + end if command.islower() else end
            points.append(at)
            k += count
    return np.array(points).reshape(-1, 2)
