"""A plant as the reference controllers know it: what commands hold it, and which quantity to feed back."""

from collections.abc import Mapping
from typing import ClassVar, Protocol

Gains = Mapping[str, tuple[str, float, float]]
"""Name of a gain -> (unit, default, largest)."""
ACCELERATION: Gains = {
    "kp": ("1/s^2", 560.0, 1e4), "ki": ("1/s^3", 2000.0, 1e5), "kd": ("1/s", 37.0, 500.0),
    "filter_time": ("s", 0.005, 0.5),
}  # fmt: skip
"""A PID that asks for an acceleration: of a free mass its poles are those of (s^2 + 2 0.8 20 s + 20^2) (s + 5), 1/s."""
POSITION: Gains = {
    "kp": ("1", 0.0, 3.0), "ki": ("1/s", 2.0, 60.0), "kd": ("s", 0.0, 0.1), "filter_time": ("s", 0.02, 0.5),
}  # fmt: skip
"""A PID that asks for a position, beside the servo that goes there."""
Reference = tuple[float, float, float]
"""r, r_dot, r_ddot in SI."""


class Hauling(Protocol):
    """A load hauled by a tension with losses that depend on the direction of motion.

    Attributes
    ----------
    mass : float
        m, kg.
    stiffness : float
        Stiffness of the spring on the load, N/m; 0 where there is none.
    cable_stiffness : float
        Stiffness of the cable between drive and load, N/m.

    Notes
    -----
    m y'' = T n^-s - G (Gu 2024, G28), with the driving tension T and the sign s of the motion.
    """

    mass: float
    stiffness: float
    cable_stiffness: float

    def ratio(self, speed: float, drive_tension: float, load_tension: float) -> float:
        """Ratio of the tensions on both sides of the friction.

        Parameters
        ----------
        speed : float
            Speed of sliding, m/s.
        drive_tension, load_tension : float
            Tensions on both sides, N.

        Returns
        -------
        float
            n, at least 1.
        """

    def resistance(self, position: float, velocity: float) -> float:
        """What the load-side tension works against.

        Parameters
        ----------
        position : float
            Of the load, m.
        velocity : float
            Of the load, m/s.

        Returns
        -------
        float
            G, N.
        """

    def require_spring(self, task: str) -> None:
        """Refuse a task that needs a spring on the load where there is none.

        Parameters
        ----------
        task : str
            "position" or "tension".

        Raises
        ------
        ConfigurationError
            Where the load-side tension of the task cannot be set.
        """


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
    unit_command : float
        Command for one unit of what the PID asks for; 1 where that is a command. Of a drive that is told its force or
        torque the PID asks for an acceleration, and the gains fit any inertia.
    pid : mapping of (str, str) to Gains
        (action mode, task) -> gains "kp", "ki", "kd" and "filter_time" of a PID on that signal.
    hauls : tuple of str
        Action modes in which the command is the tension at the drive: `hauling` then has the model.
    """

    pid: ClassVar[Mapping[tuple[str, str], Gains]]
    hauls: ClassVar[tuple[str, ...]] = ()
    signal: str
    unit_command: float = 1.0

    def __init__(self, rig: Mapping[str, float], action_mode: str, task: str):
        raise NotImplementedError

    def steady(self, ref: Reference, way: float) -> float:
        """The command with which the output follows a reference.

        Parameters
        ----------
        ref : tuple of three float
            Reference with its first two derivatives, SI.
        way : float
            Share of the friction that acts: 1 where it opposes positive motion, -1 where it opposes negative motion, 0
            as if there was none.

        Returns
        -------
        float
            In the unit of the action mode.
        """
        raise NotImplementedError

    def hauling(self) -> Hauling:
        """The model for controllers of a hauled load, in the action modes `hauls` only.

        Returns
        -------
        Hauling
            With the nominal parameters.
        """
        raise NotImplementedError
