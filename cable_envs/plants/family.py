"""What a folder of plants says of itself: all that others ask of it, without compiling anything.

Every folder beside this file has a ``FAMILY`` in its ``__init__``; `cable_envs.plants` finds it there. A family that
leaves something out does without it: what would need it refuses by name.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from importlib import import_module
from typing import Any

import numpy as np

from cable_envs.core.errors import ConfigurationError
from cable_envs.core.params import Parameter

Values = Mapping[str, Any]
"""Parameters of a rig by name, SI: numbers, or arrays [n]."""


def _as_asked(values: Values, wanted: np.ndarray) -> np.ndarray:
    return wanted


def _one(values: Values) -> float:
    return 1.0


def _found(place: str) -> Any:
    """The class or function at "module:name"."""
    module, _, name = place.partition(":")
    return getattr(import_module(module), name)


def coarse(plant: Any) -> Any:
    """The plant without a longest step: with `Plant.raise_to` its inertias are raised instead."""
    return replace(plant, version="v0", resolves=None)


@dataclass(frozen=True)
class Output:
    """A quantity that a task may control.

    Attributes
    ----------
    reference : str
        Channel of a recording that holds what it should follow.
    start : callable
        (values, wanted [n]) -> position of the output at rest [n] where the quantity is as wanted.
    rigid : callable
        values -> change of the task's proxy signal for one unit of it, were the mechanism rigid and frictionless.
    needs : tuple of str
        Parameters that must be above 0.
    """

    reference: str
    start: Callable[[Values, np.ndarray], np.ndarray] = _as_asked
    rigid: Callable[[Values], float] = _one
    needs: tuple[str, ...] = ()


@dataclass(frozen=True)
class Replayed:
    """How recordings of a plant are held against it, where nothing else is made for them (`diagnosis.systems.general`).

    Attributes
    ----------
    drive : str
        Channel of the drive's position; it is followed where no command was recorded.
    of_drive : tuple of str
        Channels that say what the drive did: one sensor's, and no answer where it is followed.
    predicted : tuple of str
        Channels that are compared.
    refitted : tuple of str
        Parameters that are refitted unless the recording knows them.
    servo, by_servo : tuple of str
        Parameters of the drive's own control, refitted where it was seen to obey one of the commands ``by_servo``.
    stiff : mapping of str to float
        Parameter -> size from which on it counts as rigid, or as absent.
    places, pulls : tuple of str
        Channels of position and of tension or torque along which a mismatch may lie, the best first.
    far : tuple of str
        Channels at the end that is farthest from the drive: once one of them moves, what friction held between both
        ends at the start of a record is forgotten.
    contacts : int
        At how many places the simulator of a recording rubs whose rig does not say it; 0: as the family builds it.
    """

    drive: str
    of_drive: tuple[str, ...]
    predicted: tuple[str, ...]
    refitted: tuple[str, ...]
    servo: tuple[str, ...] = ()
    by_servo: tuple[str, ...] = ()
    stiff: Mapping[str, float] = field(default_factory=dict)
    places: tuple[str, ...] = ()
    pulls: tuple[str, ...] = ()
    far: tuple[str, ...] = ()
    contacts: int = 0


@dataclass(frozen=True)
class Family:
    """A folder of plants that share parameters, signals and recordings.

    Attributes
    ----------
    name : str
        Its name in rig files and recordings.
    title : str
        For people.
    build : callable
        (variant, holes) -> `cable_envs.plants.base.Plant`; what it imports is imported when it is called.
    as_v0 : callable
        Plant -> the plant with the numbers that the ids ``-v0`` have. Unless the family says otherwise they differ in
        one thing: the step does not fit the rig, the rig's inertias are raised to the step.
    with_motor : callable, optional
        Plant -> the plant with a real drive (`cable_envs.plants.servo`); None: its drive is ideal.
    variants : tuple of str
        Simulators of the same rig; the first one is what is taken unless another is asked for.
    series : bool
        Whether a rig may say ``holes``: several of the same in series.
    with_contacts : callable, optional
        Number of contacts -> the plant with its friction at so many places, for rigs that say ``contacts``; None: it
        has no such.
    tasks : str
        First part of the names of its tasks (configs/tasks), as "CableHole"; empty where it has none.
    outputs : mapping of str to Output
        What its tasks control, by the kind of task: "position", "tension", "torque".
    observe : str
        Observation level that a controller of it needs unless it says otherwise: "drive", "output" or "full".
    view : str
        "module:class" of its `cable_envs.plants.view.View`, as reference controllers see it; empty: those that are made
        for it alone apply.
    continuous : str
        "module:function" that gives its equations of motion in continuous time
        (`cable_envs.plants.continuous.Equations`); empty: it has none.
    scene : str
        "module:class" that draws it; empty: it cannot be rendered.
    shown : tuple of str
        Signals that the scene cannot do without.
    channels : mapping of str to str
        Channels of its recordings with their SI units; empty: it has none.
    signals : mapping of str to str
        Channel -> signal of the plant, where their names differ.
    commands : mapping of str to str
        Action mode -> channel of the command.
    limits : mapping of str to str
        Channel -> parameter that bounds a command of that kind, and says nothing else of the rig: a corrected rig has
        the largest that was recorded, where nobody states it.
    known, nominal : tuple of str
        Parameters that one measures on a rig before it runs; that a simulator believes and a recording may correct.
    beside : tuple of Parameter
        What a recording may state besides the plant's parameters.
    needs : tuple of tuple of str
        Groups of channels, of each of which a recording must have one to be diagnosed; of what is ``replayed`` these
        follow from that.
    replayed : Replayed, optional
        How recordings of it are diagnosed; None: by a module of their own in `cable_envs.diagnosis.systems`, or not at
        all.
    ways : tuple of two str
        Words for motion in the positive and in the negative direction.
    """

    name: str
    title: str
    build: Callable[[str, int], Any]
    as_v0: Callable[[Any], Any] = coarse
    with_motor: Callable[[Any], Any] | None = None
    variants: tuple[str, ...] = ("analytic",)
    series: bool = False
    with_contacts: Callable[[int], Any] | None = None
    tasks: str = ""
    outputs: Mapping[str, Output] = field(default_factory=dict)
    observe: str = "output"
    view: str = ""
    continuous: str = ""
    scene: str = ""
    shown: tuple[str, ...] = ()
    channels: Mapping[str, str] = field(default_factory=dict)
    signals: Mapping[str, str] = field(default_factory=dict)
    commands: Mapping[str, str] = field(default_factory=dict)
    limits: Mapping[str, str] = field(default_factory=dict)
    known: tuple[str, ...] = ()
    nominal: tuple[str, ...] = ()
    beside: tuple[Parameter, ...] = ()
    needs: tuple[tuple[str, ...], ...] = ()
    replayed: Replayed | None = None
    ways: tuple[str, str] = ("moving forward", "moving backward")

    def __hash__(self) -> int:
        return hash(self.name)

    def output(self, kind: str) -> Output:
        """The controlled quantity of a kind of task.

        Parameters
        ----------
        kind : str
            "position", "tension" or "torque".

        Returns
        -------
        Output
            One of ``outputs``.

        Raises
        ------
        ConfigurationError
            Where the family has none such.
        """
        if kind not in self.outputs:
            known = ", ".join(self.outputs) or "none"
            raise ConfigurationError(f"{self.name} has no {kind} task; its tasks control: {known}")
        return self.outputs[kind]

    @property
    def least(self) -> tuple[tuple[str, ...], ...]:
        """Groups of channels, of each of which a recording must have one; empty where recordings are not diagnosed."""
        if self.needs or self.replayed is None:
            return self.needs
        answers = tuple(name for name in self.replayed.predicted if name not in self.replayed.of_drive)
        return ((*self.commands.values(), self.replayed.drive), answers)

    def draws(self) -> Any:
        """The class that draws it, imported now; ConfigurationError where there is none."""
        if not self.scene:
            raise ConfigurationError(f"{self.name} has no scene: rgb_array and human are not available")
        return _found(self.scene)

    def sees(self) -> Any:
        """The class of its view, imported now; ConfigurationError where there is none."""
        if not self.view:
            raise ConfigurationError(f"{self.name} has no view: general reference controllers are not available")
        return _found(self.view)

    def moves(self) -> Any:
        """The function that gives its equations of motion, imported now; ConfigurationError where there is none."""
        if not self.continuous:
            raise ConfigurationError(f"{self.name} has no equations in continuous time")
        return _found(self.continuous)

    def records(self) -> Mapping[str, str]:
        """Its channels with their SI units; ConfigurationError where it has no recordings."""
        if not self.channels:
            raise ConfigurationError(f"{self.name} has no channels: recordings of it cannot be read or written")
        return self.channels
