"""What a test of adequacy finds (`cable_envs.diagnosis.adequacy.tests`), whichever it is."""

from dataclasses import dataclass

ALL = "all channels"
"""Channel of a test that takes several together."""


@dataclass(frozen=True)
class Leftover:
    """What is left beyond noise in one channel along one coordinate.

    gain, functions | fall of the whitened sum of squares, and the chi-square's degrees of freedom
    at, height, error | the smooth map: places along the coordinate, what is left there and its standard error
    """

    channel: str
    coordinate: str
    unit: str
    gain: float
    functions: int
    p_value: float
    at: tuple[float, ...] = ()
    height: tuple[float, ...] = ()
    error: tuple[float, ...] = ()
