"""What Zou 2022 prints: Tables 3 and 4, the errors of sections 3.2 and 3.3, and the words around them."""

import math
from typing import NamedTuple

import numpy as np

from cable_envs.physics.supports import Pulley

IDLERS = ("1t", "1b", "2t", "2b", "3t", "3b", "4t", "4b")


class Idler(NamedTuple):
    """A row of Table 3."""

    slip: float
    """rad"""
    rotatable: float
    fixed: float
    """tension ratio of the fixed pulley"""
    wrap: float
    """rad"""

    def shown(self, column: str) -> str:
        """A value as the table prints it: three decimals in all columns."""
        return f"{getattr(self, column):.3f}"


TABLE_3 = {
    "1t": Idler(0.051, 1.006, 1.098, 0.279),
    "1b": Idler(0.051, 1.006, 1.098, 0.279),
    "2t": Idler(0.129, 1.047, 2.130, 1.571),
    "2b": Idler(0.206, 1.072, 2.025, 1.571),
    "3t": Idler(0.291, 1.115, 4.213, 3.141),
    "3b": Idler(0.182, 1.074, 4.622, 3.141),
    "4t": Idler(0.182, 1.074, 4.796, 3.217),
    "4b": Idler(0.290, 1.114, 4.739, 3.390),
}
EXACT_WRAPS = {1.571: math.pi / 2, 3.141: math.pi}
"""Table 2 rounds or cuts right and straight angles; Table 3 was computed with the angles themselves"""
RADII = {"1t": 4e-3, "1b": 4e-3, "2t": 8e-3, "2b": 5e-3, "3t": 5e-3, "3b": 8e-3, "4t": 8e-3, "4b": 5e-3}
"""m; Table 2"""


def idler(name: str, support: str = "shaft", wrap: float | None = None) -> Pulley:
    """An idler of Table 2.

    Parameters
    ----------
    name : str
        As in the table.
    support : str
        "shaft", or "fixed".
    wrap : float, optional
        rad; without it its own.

    Returns
    -------
    Pulley
        The cable's 0.56 mm are taken as a radius.
    """
    printed = TABLE_3[name].wrap if wrap is None else wrap
    return Pulley(RADII[name], 0.56e-3, EXACT_WRAPS.get(printed, printed), 0.54, support, 2.5e-3, 0.157)


PRETENSIONS = (12.5, 50.0, 150.0)
"""N; rows of Table 4"""
TABLE_4 = np.array([[0.342, 0.1436, 0.196, 0.041], [0.323, 0.1368, 0.182, 0.052], [0.354, 0.1538, 0.201, 0.073]])
"""rows as in `PRETENSIONS`; columns `ERRORS`"""
ERRORS = ("max position error", "mean position error", "max torque error", "mean torque error")
ERROR_UNITS = ("rad", "rad", "N m", "N m")

AMPLITUDE, PERIOD = 1.74, 12.5
"""rad and s at the drive; f = 12.5 Hz read as a period of 12.5 s"""
GRASPER_LENGTH = 15e-3
"""m"""


class Pair(NamedTuple):
    """Largest errors of a figure."""

    degrees: float
    torque: float
    """N m"""


ESTIMATED, UNCOMPENSATED, COMPENSATED = Pair(3.17, 0.109), Pair(13.96, 0.215), Pair(4.84, 0.081)
"""Figs. 11 and 12, at 25 N"""
INSTRUMENT, INSTRUMENT_MEAN = Pair(3.49, 0.025), 1.03
"""Fig. 14, at 25 N; mean in degrees"""
GRASP_PRETENSION = 25.0
"""N; sections 3.2 and 3.3"""
