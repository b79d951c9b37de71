"""What a plant declares of itself: its signals, the commands that it understands, and the ranges of its laws."""

from collections.abc import Iterable
from dataclasses import dataclass, replace

from cable_envs.core.lanes import Lanes


@dataclass(frozen=True)
class Signal:
    """One row of a plant's signal array: a state, or something that the plant reports.

    Attributes
    ----------
    name : str
        Name of the row.
    unit : str
        SI unit.
    meaning : str
        What it is, for people.
    """

    name: str
    unit: str
    meaning: str


OUT_OF_RANGE = Signal(
    "out_of_range", "1", "1 where a signal is outside the range that the rig's parameters or the plant's laws hold in"
)
"""A signal that plants have whose rigs may say in what range they hold (`cable_envs.sim.rigs.Rig.valid`)."""


@dataclass(frozen=True)
class SecondCommand:
    """What some plants are told besides the command.

    Attributes
    ----------
    name : str
        What it is, as "co_contraction".
    unit : str
        SI unit.
    bound : str
        Name of the parameter that bounds it. The range is [-bound, bound], or [0, bound] where `one_sided`.
    one_sided : bool
        Whether it is never negative.
    rest_signal : str
        Signal whose value at rest keeps the plant at rest; where it is empty, that is 0. It holds where the action mode
        has one action.
    """

    name: str
    unit: str
    bound: str
    one_sided: bool = False
    rest_signal: str = ""


@dataclass(frozen=True)
class ActionMode:
    """How a command is understood by the drive.

    Attributes
    ----------
    name : str
        Name of the mode, as "tension".
    unit : str
        SI unit of the command.
    bound : str
        Name of the parameter that bounds the command. The range is [-bound, bound], or [0, bound] where `one_sided`.
    one_sided : bool
        Whether the command is never negative.
    rest_signal : str
        Signal whose value at rest is the command that keeps the plant at rest; where it is empty, that command is 0.
    second : SecondCommand, optional
        What the plant is told besides; None: nothing.
    of : str
        Of a mode with two actions: the mode with one whose command it has too. Empty: there is one action, and a second
        command stays where it was at rest.
    """

    name: str
    unit: str
    bound: str
    one_sided: bool = False
    rest_signal: str = ""
    second: SecondCommand | None = None
    of: str = ""

    @property
    def commands(self) -> "tuple[ActionMode | SecondCommand, ...]":
        """What the actions are, in their order."""
        return (self, self.second) if self.of and self.second is not None else (self,)

    def with_second(self) -> "ActionMode":
        """The same mode with two actions, as "position_and_co_contraction".

        Examples
        --------
        >>> lift = SecondCommand("grip", "N", "grip_limit")
        >>> ActionMode("position", "m", "reach", second=lift).with_second().name
        'position_and_grip'
        """
        if self.second is None:
            raise ValueError(f"action mode {self.name} has no second command")
        return replace(self, name=f"{self.name}_and_{self.second.name}", of=self.name)


@dataclass(frozen=True)
class Range:
    """Where a law of a plant was identified. Beyond it a simulation goes on, and says ``out_of_range``.

    Attributes
    ----------
    signal : str
        Signal of the plant that the law was measured over.
    low, high : float
        Least and largest value that it had there, SI.
    law : str
        Parameter that says how strong the law is; where it is 0 the law says nothing.
    source : str
        Where the range is from.
    """

    signal: str
    low: float
    high: float
    law: str
    source: str


def rows_of(signals: Iterable[Signal]) -> Lanes:
    """Rows under the names of signals, in their order, for plants none of whose signals form a sequence."""
    return Lanes("Signals", [s.name for s in signals])
