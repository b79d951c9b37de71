"""From the keyword arguments of an environment to a validated, frozen `Setup`."""

import inspect
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from cable_envs.core.errors import ConfigurationError, UnknownOption, nearest, require_known
from cable_envs.core.params import is_number
from cable_envs.effects import Effect, dotted
from cable_envs.plants import VERSIONS, families
from cable_envs.plants.base import ActionMode, Plant, SecondCommand
from cable_envs.plants.own_effects import load_effect
from cable_envs.sim.rigs import Rig, load_rig
from cable_envs.sim.stepsize import MOST, substeps_for
from cable_envs.sim.suite.drawing import DrawnSignal
from cable_envs.sim.suite.levels import (
    OWN,
    USUAL,
    Conditions,
    check_derived,
    check_observed,
    content_of,
    make_conditions,
)
from cable_envs.sim.tasks import (
    COMMAND,
    ERROR,
    LEVELS,
    REFERENCE,
    REFERENCE_ACCELERATION,
    REFERENCE_RATE,
    Channel,
    Task,
    load_task,
)

MAX_DELAY = 100


@dataclass(frozen=True)
class Setup:
    """Everything that defines an environment but its random state.

    Attributes
    ----------
    task : Task
        Content of the task's file.
    rig : Rig
        Nominal parameters and effects.
    plant : Plant
        What simulates the rig.
    action_mode : ActionMode
        What a command is.
    ranges : tuple of (float, float)
        For each action: commands of -1 and 1, in its unit (`ActionMode.commands`).
    channels : tuple of Channel
        Entries of an observation, in order.
    reference, disturbance, posture : mapping
        Signals as `cable_envs.sim.references.pack_signal` takes them.
    randomize : tuple of (str, float, float)
        Parameters that each episode draws anew, with the ends of their ranges in SI.
    noise : ndarray, shape (len(plant.signals),)
        Standard deviation of the noise on each signal of the plant, SI.
    sensor_delay : int
        Control steps by which all measurements are late.
    sensor_steps : int
        Control steps that the effect sensor_delay may need besides.
    action_delay : int
        Control steps until an action acts.
    control_period : float
        Time between two actions, s.
    substeps : int
        Integration steps in a control period.
    steps : int
        Control steps in an episode.
    conditions : Conditions, optional
        What a level of a task of the suite has besides; None: the task has no levels.
    """

    task: Task
    rig: Rig
    plant: Plant
    action_mode: ActionMode
    ranges: tuple[tuple[float, float], ...]
    channels: tuple[Channel, ...]
    reference: Mapping[str, Any]
    disturbance: Mapping[str, Any]
    posture: Mapping[str, Any]
    randomize: tuple[tuple[str, float, float], ...]
    noise: np.ndarray
    sensor_delay: int
    sensor_steps: int
    action_delay: int
    control_period: float
    substeps: int
    steps: int
    conditions: Conditions | None = None

    @property
    def low(self) -> float:
        """Command of the action -1, in the unit of the action mode."""
        return self.ranges[0][0]

    @property
    def high(self) -> float:
        """Command of the action 1, in the unit of the action mode."""
        return self.ranges[0][1]

    @property
    def output_unit(self) -> str:
        """SI unit of the controlled quantity."""
        return self.plant.signals[self.plant.row(self.task.output)].unit

    @property
    def output_observed(self) -> bool:
        """Whether the controlled quantity is among the measurements."""
        return self.task.output in {c.name for c in self.channels}

    @property
    def proxy(self) -> str:
        """The signal whose measurement stands for the output in the channel "error"."""
        return self.task.output if self.output_observed else self.task.proxy

    @property
    def sensors(self) -> tuple[str, ...]:
        """The signals that are measured, each once: those observed, and the `proxy`."""
        return tuple(dict.fromkeys([*(c.name for c in self.channels if c.measured), self.proxy]))


def make_setup(
    task: str,
    reference: str | Mapping[str, Any] | None = None,
    *,
    level: str | None = None,
    split: str = "train",
    sensors: str = "rig",
    preview: bool = False,
    rig: str | Path | Mapping[str, Any] | Rig | None = None,
    effects: Mapping[str, Any] | None = None,
    effect_file: str | Path | Effect | None = None,
    version: str = VERSIONS[-1],
    plant: str | None = None,
    action_mode: str | None = None,
    observe: str | None = None,
    randomize: bool | Mapping[str, Any] | None = None,
    sensor_noise: bool | float | Mapping[str, float] | None = None,
    sensor_delay: int | None = None,
    action_delay: int | None = None,
    disturbance: Mapping[str, Any] | None = None,
    posture: Mapping[str, Any] | None = None,
    control_period: float | None = None,
    substeps: int | None = None,
    duration: float | None = None,
    **unknown: Any,
) -> Setup:
    """Validate the options of an environment.

    Parameters
    ----------
    task : str
        Name of a task in configs/tasks or configs/suite, as "CableHole-Position".
    reference : str or mapping, optional
        "step", "sine", or a signal as `cable_envs.sim.suite.drawing.DrawnSignal.of` takes it; by default that of the
        level.
    level, split, sensors, preview
        As of `cable_envs.envs.CableEnv`, for tasks of the suite. What the level says holds for every option that is
        not given.
    rig, effects, effect_file, plant, action_mode, observe, randomize, sensor_noise, sensor_delay, action_delay
        As of `cable_envs.envs.CableEnv`.
    version : str
        Version of the ids whose numbers the plant gives (`cable_envs.plants.plant_for`).
    disturbance, posture, control_period, substeps, duration
        As of `cable_envs.envs.CableEnv`. None takes what the task says; disturbance and posture are then absent.
    **unknown
        Whatever else is given is refused, with the nearest option.

    Returns
    -------
    Setup
        What the environment is made from.

    Raises
    ------
    ConfigurationError
        Names the option and what would be right.

    Examples
    --------
    >>> setup = make_setup("CableHole-Position", "step", duration=2.0)
    >>> setup.steps, setup.output_unit, (setup.low, setup.high)
    (200, 'm', (0.0, 120.0))
    """
    for name in unknown:
        raise UnknownOption.of("CableEnv", name, ("reference", *OPTIONS, "render_mode", "render_theme"))
    declared = load_task(task)
    content = content_of(declared, level, split)
    asked = {
        "reference": reference, "rig": rig, "effects": effects, "plant": plant, "action_mode": action_mode,
        "observe": observe, "randomize": randomize, "sensor_noise": sensor_noise, "sensor_delay": sensor_delay,
        "action_delay": action_delay, "disturbance": disturbance, "posture": posture, "control_period": control_period,
        "substeps": substeps, "duration": duration,
    }  # fmt: skip
    o = (
        dict(USUAL)
        | {k: v for k, v in content.items() if k not in OWN}
        | {k: v for k, v in asked.items() if v is not None}
    )
    if isinstance(rig, Mapping) and not {"plant", "schema"} & set(rig) and isinstance(content.get("rig"), Mapping):
        o["rig"] = {**content["rig"], **rig}
    own: tuple[Effect, ...] = ()
    if effect_file is not None:
        own = (effect_file if isinstance(effect_file, Effect) else load_effect(effect_file),)
    chosen = _choose_rig(declared, o["rig"], own, version)
    if o["effects"] is not None:
        if not isinstance(o["effects"], Mapping):
            raise ConfigurationError(f"effects: expected a mapping of effect: {{parameter: value}}, got {effects!r}")
        chosen = chosen.replace(dict(dotted(o["effects"])))
    simulator = chosen.simulated_by(o["plant"] or "", version)
    mode = _choose_mode(simulator, o["action_mode"] or declared.action_mode)
    observed = o["observe"] or declared.observe
    if observed not in LEVELS:
        raise ConfigurationError(f"unknown observe level '{observed}'; {nearest(observed, LEVELS)}")
    signals = _signals(declared, simulator, o)
    period = _seconds("control_period", o["control_period"], declared.control_period, PERIODS)
    length = _seconds("duration", o["duration"], declared.duration, (period, LONGEST))
    if abs(length / period - round(length / period)) > 1e-6:
        raise ConfigurationError(f"duration {length:g} s is no multiple of the control period {period:g} s")
    drawn = content.get("randomize", True) if o["randomize"] is True else o["randomize"]
    ranges = _ranges(declared, chosen, simulator, drawn)
    column = chosen.column(simulator)
    given = None if o["substeps"] is None else _count("substeps", o["substeps"], 1, MOST)
    channels = _channels(declared, simulator, mode, observed)
    made = Setup(
        task=declared,
        rig=chosen,
        plant=simulator,
        action_mode=mode,
        ranges=tuple(_range_of(one, chosen) for one in mode.commands),
        channels=channels,
        reference=signals["reference"],
        disturbance=signals["disturbance"],
        posture=signals["posture"],
        randomize=ranges,
        noise=_noise(declared, simulator, o["sensor_noise"]),
        sensor_delay=_count("sensor_delay", o["sensor_delay"], 0, MAX_DELAY),
        sensor_steps=_sensor_steps(simulator, column, ranges, period),
        action_delay=_count("action_delay", o["action_delay"], 0, MAX_DELAY),
        control_period=period,
        substeps=substeps_for(simulator, column, ranges, period, given, declared.substeps),
        steps=round(length / period),
    )
    if level is None:
        return made
    check_observed(declared, content, level, observed, sensors)
    conditions = make_conditions(declared, content, level, split, simulator, sensors, preview)
    check_derived(conditions, made.sensors)
    return replace(made, conditions=conditions)


OPTIONS = tuple(name for name, p in inspect.signature(make_setup).parameters.items() if p.kind is p.KEYWORD_ONLY)
"""Names of the options of an environment."""


def _signals(task: Task, plant: Plant, options: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Reference, disturbance and posture, each checked."""
    reference, posture = options["reference"], options["posture"]
    spec = task.references.get(reference.lower()) if isinstance(reference, str) else reference
    if spec is None:
        raise ConfigurationError(f"unknown reference '{reference}'; {nearest(str(reference), task.references)}")
    if posture is not None:
        require_posture(plant)
    still = {"kind": "constant"}
    found = {"reference": spec, "disturbance": options["disturbance"], "posture": posture}
    found = {what: still if one is None else one for what, one in found.items()}
    for what, one in found.items():
        DrawnSignal.of(what, one)
    return {what: dict(one) for what, one in found.items()}


def require_posture(plant: Plant) -> None:
    """Refuse a posture on a plant that has none.

    Parameters
    ----------
    plant : Plant
        What simulates the rig.

    Raises
    ------
    ConfigurationError
        Where its shape is fixed.
    """
    if not plant.posture:
        raise ConfigurationError(
            f"option 'posture': {plant.name} with this rig has no posture, its shape is fixed; a tendon sheath whose "
            "rig says 'contacts' has one, and the wrist"
        )


def _choose_rig(
    task: Task, rig: str | Path | Mapping[str, Any] | Rig | None, own: tuple[Effect, ...], version: str
) -> Rig:
    """The task's own rig, another one, or the task's own with some parameters changed."""
    usual = task.rigs.get(version, task.rig)
    if isinstance(rig, Mapping) and not {"plant", "schema"} & set(rig):
        chosen = load_rig(usual, own).replace(rig)
    else:
        chosen = load_rig(usual if rig is None else rig, own)
    wanted = next(one for one in families().values() if one.tasks == task.name.split("-")[0])
    if chosen.plant != wanted.name:
        raise ConfigurationError(
            f"task {task.name} needs a rig of plant {wanted.name}; {chosen.name} is of {chosen.plant}"
        )
    for need in wanted.output(task.kind).needs:
        if chosen.values[need] <= 0.0:
            raise ConfigurationError(f"task {task.name} needs a rig with {need} above 0; '{chosen.name}' has 0")
    return chosen


def _choose_mode(plant: Plant, name: str) -> ActionMode:
    for mode in plant.action_modes:
        if mode.name == name:
            return mode
    raise ConfigurationError(f"unknown action mode '{name}'; {nearest(name, [m.name for m in plant.action_modes])}")


def _range_of(command: ActionMode | SecondCommand, rig: Rig) -> tuple[float, float]:
    bound = rig.values[command.bound]
    return 0.0 if command.one_sided else -bound, bound


def _channels(task: Task, plant: Plant, mode: ActionMode, level: str) -> tuple[Channel, ...]:
    units = {s.name: s.unit for s in plant.signals}
    out, scale = units[task.output], task.scales[task.output]
    channels = [
        Channel(REFERENCE, out, scale, False),
        Channel(REFERENCE_RATE, f"{out}/s", scale, False),
        Channel(REFERENCE_ACCELERATION, f"{out}/s^2", scale, False),
        Channel(ERROR, out, task.scales["error"], False),
        Channel(COMMAND, mode.unit, task.scales["command"], False),
    ]
    for second in mode.commands[1:]:
        name = f"{second.name}_command"
        channels.append(Channel(name, second.unit, task.scales[name], False))
    channels.extend(Channel(name, units[name], task.scales[name], True) for name in task.observed(level))
    return tuple(channels)


def _ranges(task: Task, rig: Rig, plant: Plant, randomize: bool | Mapping[str, Any]) -> tuple:
    if isinstance(randomize, Mapping):
        given = randomize
    elif isinstance(randomize, bool):
        given = task.randomize if randomize else {}
    else:
        raise ConfigurationError(f"randomize: expected true, false or a mapping of parameter: range, got {randomize!r}")
    ranges = []
    for name, spec in given.items():
        declared = plant.table[name]
        if "." in str(name):
            plant.effects.check(name)
        if not isinstance(spec, Mapping) or set(spec) not in ({"scale"}, {"low", "high"}):
            raise ConfigurationError(f"randomize.{name}: expected {{scale: [a, b]}} or {{low: a, high: b}}, got {spec}")
        given_range = spec["scale"] if "scale" in spec else [spec["low"], spec["high"]]
        if not (isinstance(given_range, (list, tuple)) and len(given_range) == 2 and all(map(is_number, given_range))):
            raise ConfigurationError(f"randomize.{name}: expected two finite numbers, got {spec}")
        nominal = rig.column(plant)[plant.table.index(name), 0] if "scale" in spec else 1.0
        a, b = (float(v) * nominal for v in given_range)
        if not a <= b:
            raise ConfigurationError(f"randomize.{name}: low {a:g} is above high {b:g}")
        ranges.append((name, declared.check(a), declared.check(b)))
    known = plant.effects.effects
    drawn = {n: (a, b) for n, a, b in ranges if "." in n and known[n.partition(".")[0]].refuse is not None}
    for ends in product(*drawn.values()):
        plant.effects.require_possible({**rig.effects, **dict(zip(drawn, ends, strict=True))})
    return tuple(ranges)


def _sensor_steps(plant: Plant, column: np.ndarray, ranges: tuple, period: float) -> int:
    """Control steps of the longest delay that the effect sensor_delay has in this environment."""
    table = plant.table
    delays = [column[table.index(n), 0] for n in table.names if n.startswith("sensor_delay.")]
    delays += [high for name, _, high in ranges if name.startswith("sensor_delay.")]
    return math.ceil(max(delays) / period - 1e-9)


def _noise(task: Task, plant: Plant, sensor_noise: bool | float | Mapping[str, float]) -> np.ndarray:
    if isinstance(sensor_noise, Mapping):
        known = [s.name for s in plant.signals]
        require_known("signal in sensor_noise", sensor_noise, known)
        given = dict(sensor_noise)
    elif isinstance(sensor_noise, bool) or (is_number(sensor_noise) and sensor_noise >= 0.0):
        given = {name: float(std) * float(sensor_noise) for name, std in task.sensor_noise.items()}
    else:
        raise ConfigurationError(
            f"sensor_noise: expected true, false, a factor >= 0 or {{signal: standard deviation}}, got {sensor_noise!r}"
        )
    noise = np.zeros(len(plant.signals))
    for name, std in given.items():
        if not is_number(std) or std < 0.0:
            raise ConfigurationError(f"sensor_noise.{name}: expected a standard deviation >= 0, got {std!r}")
        noise[plant.row(name)] = std
    return noise


PERIODS, LONGEST = (1e-6, 100.0), 1e7
"""Shortest and longest control period, and longest episode, s: beyond, nothing of a cable is simulated."""


def _seconds(name: str, value: float | None, default: float, limits: tuple[float, float]) -> float:
    value = default if value is None else value
    if not is_number(value) or value <= 0.0:
        raise ConfigurationError(f"{name}: expected seconds above 0, got {value!r}")
    if not limits[0] <= value <= limits[1]:
        raise ConfigurationError(f"{name}: expected {limits[0]:g} to {limits[1]:g} s, got {value!r}")
    return float(value)


def _count(name: str, value: int, low: int, high: int) -> int:
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or not low <= value <= high:
        raise ConfigurationError(f"{name}: expected a whole number of steps in [{low}, {high}], got {value!r}")
    return int(value)
