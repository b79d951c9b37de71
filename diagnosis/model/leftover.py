"""What is left beyond noise in one channel along one coordinate, or of what several channels share."""

from dataclasses import dataclass

from cable_envs.diagnosis.model.features import ELAPSED

DRIFT = "its zero drifts"
"""How the cause ends of what is left of a sensor and changes with the elapsed time alone."""
AT_REST, MAINS = "at rest", "mains"
"""What may be known of a tone; either is of the sensor, whatever its noise is stated to be."""
ALL = "all channels"
"""Channel of what several have together."""


@dataclass(frozen=True)
class Leftover:
    """What is left of one kind.

    Parameters
    ----------
    channel, coordinate, unit : str
        In which channel, and along what; of a line in a spectrum "frequency", Hz.
    log_odds : float
        That it is there over that it is not.
    size : float
        Half the fall of the whitened sum of squares that it explains.
    cause : str
        What it is of the sensor or logger, where it can be nothing of the rig; else empty.
    at, height, error : tuple of float
        The smooth map: places along the coordinate, what is left there and its standard error; a frequency's place.
    known : str
        Of a tone: `AT_REST` if the record at rest shows it, too, `MAINS` if it has a frequency of mains; else empty.
    """

    channel: str
    coordinate: str
    unit: str
    log_odds: float
    size: float = 0.0
    cause: str = ""
    at: tuple[float, ...] = ()
    height: tuple[float, ...] = ()
    error: tuple[float, ...] = ()
    known: str = ""


@dataclass(frozen=True)
class Left:
    """What a model leaves beyond noise: whether, how much, and of which kinds.

    Parameters
    ----------
    log_odds : float
        That something is left over that nothing is.
    share : float
        What is left over what the effects explain, as falls of half the sum of squares; infinite without effects.
    kinds : tuple of Leftover
        Each by itself, the surest first.
    cause : str
        What it is of the sensors or of the logger, where it can be nothing of the rig; else empty.
    """

    log_odds: float
    share: float
    kinds: tuple[Leftover, ...] = ()
    cause: str = ""

    @property
    def slow(self) -> str:
        """That what is left is slow and could be of a sensor, were its noise not known; empty where it is not."""
        if self.cause or not self.kinds or self.kinds[0].coordinate != ELAPSED:
            return ""
        return (
            f"what is left is slow, most of all in {self.kinds[0].channel.replace('_', ' ')}: a zero of that sensor "
            f"that drifts would look the same; it counts as the rig's where its noise is stated or known from rest"
        )
