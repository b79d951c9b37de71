"""What of a rig leaves the package: its program, its numbers, and the state in which it begins."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from cable_envs.core.compiling.templates import specialised
from cable_envs.core.errors import ConfigurationError, nearest
from cable_envs.core.inputs import FOLLOW, INPUTS
from cable_envs.core.params import is_number
from cable_envs.effects.bristles import deflection
from cable_envs.effects.lanes import SENSE
from cable_envs.effects.own import joined
from cable_envs.plants.base import Plant
from cable_envs.sim.rigs import Rig, load_rig
from cable_envs.sim.stepsize import substeps_for
from cable_envs.standalone.program import ELEMENTARY, Program
from cable_envs.standalone.specialise import program_of

PERIOD, SUBSTEPS = 0.01, 20
"""Control period, s, and integration steps in it, as of the tasks (configs/tasks), unless others are asked for."""

DELAY = "command_delay.time"
"""Effect of a recorded command, which `cable_envs.sim.replay.replay` delays before the plant is told."""
BRISTLES = 2
"""Number of the kernel whose friction has bristles (`cable_envs.plants.base.Plant.kernel_needed`)."""


@dataclass(frozen=True)
class Entry:
    """A number that is told to a mechanism, or that it shows: name, SI unit, meaning."""

    name: str
    unit: str
    meaning: str


@dataclass(frozen=True)
class Sensor:
    """What a sensor with effects shows of a signal: ``scale`` x + ``bias``, less ``cut`` of what is negative, late."""

    signal: str
    scale: float
    bias: float
    cut: float
    late: float
    """In control steps."""


@dataclass(frozen=True)
class Law:
    """A rig as it leaves the package.

    Attributes
    ----------
    rig : Rig
        Its parameters.
    plant : Plant
        What simulates it.
    drive : str
        What it is told: an action mode of the plant, or "follow".
    period : float
        Control period, s: how long a command holds.
    substeps : int
        Integration steps in it.
    start : float
        Position of the output at rest before the first step, SI.
    label : str
        What it is called there; by default as the rig is.
    """

    rig: Rig
    plant: Plant
    drive: str
    period: float
    substeps: int
    start: float
    label: str = ""

    @cached_property
    def coefficients(self) -> np.ndarray:
        """Coefficients of plant and effects, [rows, 1]."""
        return self.plant.prepare(self.rig.column(self.plant))

    @property
    def kernel(self) -> int:
        """Number of the simulator's kernel that has the same stages."""
        return max(self.plant.kernel_needed(self.coefficients), int(self.follows or not self.plant.plain))

    @property
    def follows(self) -> bool:
        """Whether the drive follows a path instead of obeying a command."""
        return self.drive == "follow"

    @property
    def mode(self) -> float:
        """Number of the drive in the row mode of the inputs."""
        return float(FOLLOW if self.follows else self.plant.number_of(self._modes()[self.drive]))

    def _modes(self) -> dict[str, Any]:
        return {mode.name: mode for mode in self.plant.action_modes}

    @property
    def name(self) -> str:
        """Its name as one of Python and C."""
        name = re.sub(r"\W+", "_", self.label or self.rig.name, flags=re.ASCII).strip("_").lower() or "rig"
        return name if not name[0].isdigit() else f"rig_{name}"

    def program(self, elementary: tuple[str, ...] = ELEMENTARY) -> Program:
        """The stages of its kernel; ``elementary`` as of `cable_envs.standalone.specialise.program_of`."""
        plant = self.plant
        own = [effect.name for effect in plant.own]
        if own:
            raise ConfigurationError(
                f"{own[0]}: an effect of your own cannot be exported; only those of the library can"
            )
        if self.rig.effects.get(DELAY, 0.0):
            raise ConfigurationError(
                f"{DELAY}: a delay of the command is not in the exported law; tell it what came then"
            )
        records = {
            "x": plant.signal_rows, "p": plant.coefficient_rows, "u": INPUTS, "w": plant.scratch,
            "e": plant.effects.lanes, "s": plant.effects.states, "g": plant.step_rows,
        }  # fmt: skip
        pieces = joined(plant.effects.effects.values())
        if self.kernel >= BRISTLES:
            pieces["bristle_length"] = deflection
        return program_of(specialised(plant.solve, **pieces), records, self.kernel > 0, elementary)

    @cached_property
    def values(self) -> Mapping[str, Mapping[str, Any]]:
        """Values of the records "rig", "effects", "signals" and "states" by field: a float, or a list of them."""
        plant, p = self.plant, self.coefficients
        own = plant.coefficient_rows.count
        x = plant.rest(p, np.array([self.start]))
        return {
            "rig": _fields(plant.coefficient_rows.over(p)),
            "effects": _fields(plant.effects.lanes.over(p[own:])),
            "signals": _fields(plant.signal_rows.over(x)),
            "states": _fields(plant.effects.states.over(x[len(plant.signals) :])),
        }

    @property
    def inputs(self) -> tuple[Entry, ...]:
        """What it is told in each control step, by the names of `cable_envs.core.inputs.INPUTS`."""
        found, mode = [], self._modes().get(self.drive)
        angular = "drive_angle" in {s.name for s in self.plant.signals}
        if mode:
            found.append(Entry("command", mode.unit, f"{mode.name} that the drive is told, held over the control step"))
        else:
            unit = "rad" if angular else "m"
            found.append(Entry("command", unit, "position of the drive at the end of the control step"))
            found.append(Entry("command_rate", f"{unit}/s", "its speed there"))
        second = mode.second if mode else next((m.second for m in self.plant.action_modes if m.second), None)
        if second:
            found.append(Entry("second", second.unit, f"{second.name}, held over the control step"))
        given = (
            "what the drive's sensor of torque reads" if self.plant.name == "transmission" else "on the load or output"
        )
        found.append(Entry("disturbance", "N m" if angular else "N", given))
        if self.plant.posture:
            found.append(Entry("posture", "rad", "by how much it is bent more than the rig says"))
        return tuple(found)

    @property
    def second(self) -> float:
        """The second command that holds it at rest; 0 where there is none."""
        modes = self.plant.action_modes
        mode = self._modes().get(self.drive, modes[0] if modes else None)
        if mode is None or mode.second is None or not mode.second.rest_signal:
            return 0.0
        x = self.plant.rest(self.coefficients, np.array([self.start]))
        return float(x[self.plant.row(mode.second.rest_signal), 0])

    @property
    def outputs(self) -> tuple[Entry, ...]:
        """The plant's signals, in the order of their rows."""
        return tuple(Entry(s.name, s.unit, s.meaning) for s in self.plant.signals)

    @cached_property
    def places(self) -> Mapping[str, tuple[str, int]]:
        """Signal -> (field of the record "signals", place in it or -1 where it is a number)."""
        rows = self.plant.signal_rows
        found: dict[str, tuple[str, int]] = {}
        for field, value in self.values["signals"].items():
            many = len(value) if isinstance(value, list) else 1
            for k in range(many):
                name = self.plant.signals[rows.row(field, k)].name
                found[name] = (field, k if isinstance(value, list) else -1)
        return found

    @cached_property
    def sensors(self) -> tuple[Sensor, ...]:
        """Those of the sensors that have an effect."""
        found = []
        for signal in self.plant.effects.measured:
            row = self.plant.sense_row(signal)
            if row < 0 or signal not in {s.name for s in self.plant.signals}:
                continue
            e = SENSE.over(self.coefficients[row:])
            one = Sensor(
                signal, float(e.sensor_scale[0]), float(e.sensor_bias[0]), float(e.sensor_rectification[0]),
                float(e.sensor_delay[0]) / self.period,
            )  # fmt: skip
            if (one.scale, one.bias, one.cut, one.late) != (1.0, 0.0, 0.0, 0.0):
                found.append(one)
        return tuple(found)

    @property
    def parameters(self) -> tuple[tuple[str, float, str, str], ...]:
        """(name, value, SI unit, meaning with source) of what the rig says, effects that are not at null included."""
        table = self.plant.table
        given = {**self.rig.values, **{k: v for k, v in self.rig.effects.items() if k in table}}
        shown = []
        for name, value in given.items():
            source = self.rig.sources.get(name, "")
            meaning = f"{table[name].meaning} ({source})" if source else table[name].meaning
            shown.append((name, float(value), table[name].unit, " ".join(meaning.split())))
        return tuple(shown)


def law_of(
    rig: str | Path | Mapping[str, Any] | Rig, *, variant: str = "", drive: str | None = None,
    period: float = PERIOD, substeps: int | None = None, start: float = 0.0, name: str = "",
) -> Law:  # fmt: skip
    """A rig as it is exported.

    Parameters
    ----------
    rig : str, path, mapping or Rig
        What names or holds it, as in `cable_envs.load_rig`.
    variant : str
        "analytic", or "chain" for a pulley circuit as a chain of spans and contacts; "": the rig's own.
    drive : str, optional
        What it is told: an action mode of the plant, or "follow" for a path of the drive. By default the first action
        mode, or "follow" where the plant has none.
    period : float
        Control period, s.
    substeps : int, optional
        Integration steps in it; by default 20, or as many as the rig needs.
    start : float
        Position of the output at rest before the first step, SI.
    name : str
        What it is to be called; by default as the rig is.

    Returns
    -------
    Law

    Raises
    ------
    ConfigurationError
        For unknown names, and numbers that cannot be.

    Examples
    --------
    >>> law = law_of("gu-inferred")
    >>> law.drive, law.name, [one.name for one in law.inputs]
    ('tension', 'gu_inferred', ['command', 'disturbance'])
    """
    loaded = load_rig(rig)
    plant = loaded.simulated_by(variant)
    drives = [*(mode.name for mode in plant.action_modes), *(d for d in plant.replays if d == "follow")]
    asked = drives[0] if drive is None else drive
    if asked not in drives:
        raise ConfigurationError(f"unknown drive '{asked}' of {plant.name}; {nearest(asked, drives)}")
    for what, value in (("period", period), ("start", start)):
        if not is_number(value) or not np.isfinite(value) or (what == "period" and value <= 0.0):
            wanted = "seconds above 0" if what == "period" else "a position in SI"
            raise ConfigurationError(f"{what}: expected {wanted}, got {value!r}")
    if substeps is not None and (not isinstance(substeps, int) or isinstance(substeps, bool) or substeps < 1):
        raise ConfigurationError(f"substeps: expected a whole number above 0, got {substeps!r}")
    steps = substeps_for(plant, loaded.column(plant), (), float(period), substeps, SUBSTEPS)
    return Law(loaded, plant, asked, float(period), steps, float(start), name)


def _fields(rows: Any) -> dict[str, Any]:
    named = {name: getattr(rows, name) for name in rows._fields if name != "rows"}
    return {name: [float(v) for v in row[:, 0]] if row.ndim == 2 else float(row[0]) for name, row in named.items()}
