"""Where refits of numbers begin that nobody states: what the records tell of them before anything is simulated.

A plant whose records tell such numbers has a module here with its name, and in it

    begin(series, values, period, said) -> {parameter: value}     SI; those that the records do not tell are left out

with what is given to the `begin` of this package.
"""

from collections.abc import Collection, Mapping, Sequence
from importlib import import_module
from importlib.util import find_spec

from cable_envs.diagnosis.systems.common import Sampled
from cable_envs.plants.base import Plant

UNSURE = 0.3
"""Standard deviation of a number that the records tell, as a share of it: the laws that tell it leave things out."""


def begin(
    plant: Plant, series: Sequence[Mapping[str, Sampled]], values: Mapping[str, float], period: float,
    said: Collection[str] = (),
) -> dict[str, float]:  # fmt: skip
    """Numbers of a plant as its records tell them.

    Parameters
    ----------
    plant : Plant
        Which.
    series : sequence of mapping of str to Sampled
        Channels of each record to fit, SI, on an even clock.
    values : mapping of str to float
        Numbers of the plant's whole table, SI, as they are stated or assumed.
    period : float
        Of the clock, s.
    said : collection of str
        Parameters that are stated.

    Returns
    -------
    dict of str to float
        Parameters that are not stated, SI, within their bounds; empty for a plant that has no module here.
    """
    if not series or find_spec(f"{__name__}.{plant.name}") is None:
        return {}
    told = import_module(f"{__name__}.{plant.name}").begin(series, values, period, said)
    table = plant.table
    return {n: float(min(max(v, table[n].low), table[n].high)) for n, v in told.items() if n not in said}
