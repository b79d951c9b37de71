"""A plant as the reference controllers know it: what commands hold it, and which quantity to feed back."""

from collections.abc import Mapping
from typing import ClassVar, Protocol

Gains = Mapping[str, tuple[str, float, float]]
"""Name of a gain -> (unit, default, largest)."""
Reference = tuple[float, float, float]
"""r, r_dot, r_ddot in SI."""


class Hauling(Protocol):
    """A load hauled by a tension with direction-dependent losses: m y'' = T n^-s - G (Gu 2024, G28)."""

    mass: float
    stiffness: float
    cable_stiffness: float

    def ratio(self, speed: float, drive_tension: float, load_tension: float) -> float:
        """n >= 1, the tension ratio while sliding at ``speed`` (m/s)."""

    def resistance(self, position: float, velocity: float) -> float:
        """G, N: what the load-side tension works against."""

    def require_spring(self, task: str) -> None:
        """Raise ConfigurationError where the load-side tension of a task cannot be set."""


class View:
    """The nominal model of a rig in one action mode and kind of task; a plant's folder has its own.

    Parameters
    ----------
    rig : mapping of str to float
        Every parameter of the plant, SI.
    action_mode, task : str
        What the command is, and what the reference is.

    Attributes
    ----------
    signal : str
        Measured signal that should follow the reference.
    pid : mapping of (str, str) to Gains
        (action mode, task) -> gains "kp", "ki", "kd" and "filter_time" of a PID on that signal.
    """

    pid: ClassVar[Mapping[tuple[str, str], Gains]]
    hauls: ClassVar[tuple[str, ...]] = ()
    """action modes in which the command is the tension at the drive: `hauling` then has the model"""
    signal: str

    def __init__(self, rig: Mapping[str, float], action_mode: str, task: str):
        raise NotImplementedError

    def steady(self, ref: Reference, way: float) -> float:
        """The command with which the output follows ``ref``.

        way: share of the friction that acts, 1 where it opposes positive motion, -1 negative; 0: as if there was none.
        """
        raise NotImplementedError

    def hauling(self) -> Hauling:
        """The model for controllers of a hauled load; only in the action modes ``hauls``."""
        raise NotImplementedError
