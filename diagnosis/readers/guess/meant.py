"""What a column is taken for: its quantity, its unit, how sure that is, and why."""

from dataclasses import dataclass, field, replace

import numpy as np

from cable_envs.diagnosis.readers.guess.raw import Column
from cable_envs.diagnosis.readers.guess.words import COUNTS, Unit, unit_of

SURE, LIKELY, OPEN = "sure", "likely", "CONFIRM"
"""How sure a statement is; what is open the user must confirm."""
RATES = {"m": "m/s", "rad": "rad/s"}
"""SI unit of a position -> that of its rate."""
PLAIN = {
    "m": ("m", "mm", 5.0), "rad": ("rad", "deg", 10.0), "m/s": ("m/s", "mm/s", 10.0), "rad/s": ("rad/s", "deg/s", 60.0),
    "N": ("N", "N", np.inf), "N m": ("N m", "N mm", 50.0), "A": ("A", "mA", 100.0), "V": ("V", "V", np.inf),
}  # fmt: skip
"""SI unit -> (what is taken where nothing tells, what from a range on, that range): lengths of tables and joints."""


@dataclass(frozen=True)
class Meant:
    """What a column is taken for.

    Parameters
    ----------
    column : Column
        As it stands.
    kind : str
        SI unit of the quantity; "time", "count", "constant", "text", or "" where nothing tells.
    unit : Unit, optional
        Of its numbers.
    told : str
        "command", "reference", or "" of what was measured.
    side : str
        "drive", "output" or "".
    sign : int
        -1 where the numbers tell that it counts against its position.
    sure : str
        One of "sure", "likely", "CONFIRM".
    why : tuple of str
        Reasons.
    clock : Column, optional
        Of its times, where these are not the table's.
    """

    column: Column
    kind: str = ""
    unit: Unit | None = None
    told: str = ""
    side: str = ""
    sign: int = 1
    sure: str = OPEN
    why: tuple[str, ...] = ()
    words: tuple[str, ...] = field(default=(), repr=False)
    clock: Column | None = None

    def because(self, reason: str, **changes) -> "Meant":
        """The same with another reason, and what that changes."""
        return replace(self, why=(*self.why, reason), **changes)

    @property
    def factor(self) -> float:
        """SI for one of its numbers, without sign."""
        assert self.unit is not None, "asked for of what has a unit"
        return self.unit.scale * (si_of(self.unit.name, self.unit.si) if self.unit.si != COUNTS else 1.0)


def si_of(unit: str, si: str) -> float:
    """SI for one of a unit."""
    from cable_envs.core.params import to_si

    return to_si(1.0, unit, si)


def by_size(m: Meant) -> Meant:
    """With the unit that the range of the numbers suggests, where nothing else tells."""
    if m.kind not in PLAIN:
        return m
    counts = m.unit is not None and m.unit.si == COUNTS
    if m.unit is not None and m.unit.si == m.kind:
        return m
    if counts:
        return m.because(
            "counts: state the unit and the scale, the units for one count", unit=Unit(m.kind, 1.0, m.kind), sure=OPEN
        )
    small, large, most = PLAIN[m.kind]
    span = float(np.nanmax(m.column.values) - np.nanmin(m.column.values))
    unit = unit_of(large if span > most else small)
    assert unit is not None, "names of units"
    return m.because(f"no unit is given; {unit.name} by its range of {span:.3g}", unit=unit, sure=OPEN)
