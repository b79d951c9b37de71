"""Where refits of numbers begin that nobody states: what the records tell of them before anything is simulated.

A plant whose records tell such numbers has a module here with its name, and in it

    begin(series, values, period) -> {parameter: value}     SI; those that the records do not tell are left out

with the records to fit as ``series``, each channel -> its samples on an even clock
(`cable_envs.diagnosis.systems.common.Sampled`), and ``values`` of the plant's whole table.
"""

from collections.abc import Mapping, Sequence
from importlib import import_module
from importlib.util import find_spec

from cable_envs.diagnosis.systems.common import Sampled

UNSURE = 0.3
"""Standard deviation of a number that the records tell, as a share of it: the laws that tell it leave things out."""


def begin(
    plant: str, series: Sequence[Mapping[str, Sampled]], values: Mapping[str, float], period: float
) -> dict[str, float]:
    """Numbers of a plant as its records tell them.

    Parameters
    ----------
    plant : str
        Its name.
    series : sequence of mapping of str to Sampled
        Channels of each record to fit, SI, on an even clock.
    values : mapping of str to float
        Numbers of the plant's whole table, SI, as they are stated or assumed.
    period : float
        Of the clock, s.

    Returns
    -------
    dict of str to float
        Parameters by name, SI; empty for a plant that has no module here.
    """
    if find_spec(f"{__name__}.{plant}") is None:
        return {}
    return dict(import_module(f"{__name__}.{plant}").begin(series, values, period))
