"""What an effect looks like: each plant moved slowly to and fro, without the effect and with it at its typical size."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from cable_envs.drawing.charts import BLUE, SOFT, svg
from cable_envs.effects import EFFECTS
from cable_envs.effects.base import Effect
from cable_envs.plants import plant_for, plants_with
from cable_envs.plants.base import Plant
from cable_envs.sim.replay import replay
from cable_envs.sim.rigs import load_rig
from docs.site.cache import kept

PERIODS, STEPS, DT = 3, 500, 0.02
"""Of the motion: periods, control steps in each, s between two of them."""
SIZE = (3.3, 3.3)
"""Inches; the page shows a picture at this size, so that its letters are as large as printed."""
LEAST = 1e-3
"""Mean change over the signal's swing below which there is nothing to see."""
UNITS = {
    "m": ("mm", 1e3), "rad": ("deg", 180.0 / np.pi), "N": ("N", 1.0), "N m": ("N m", 1.0), "A": ("A", 1.0),
    "V": ("V", 1.0),
}  # fmt: skip
"""Of signals that are shown (speeds are not): unit on the picture, and its factor on SI."""


@dataclass(frozen=True)
class Motion:
    """How a plant is moved.

    Attributes
    ----------
    rig : str
        Preset; empty: the defaults of the plant.
    drive : str
        Action mode.
    swing : float
        Amplitude of the drive's position, m or rad, or of a motor's voltage, V.
    centre : float
        Its mean, m or rad.
    position : str
        Signal of that position or voltage.
    rate : bool
        Whether the command is the speed of the drive.
    changes : tuple of (str, float)
        Parameters of the rig that are changed.
    last : bool
        Whether the plant is shown only with effects that no other plant of these has.
    """

    rig: str
    drive: str
    swing: float
    position: str
    centre: float = 0.0
    rate: bool = False
    changes: tuple[tuple[str, float], ...] = ()
    last: bool = False


MOTIONS: Mapping[str, Motion] = {
    "cable_hole": Motion("gu-inferred", "speed", 0.01, "drive_position", rate=True),
    "pulley_circuit": Motion("zou-grasp", "position", 0.5, "drive_angle"),
    "tendon_sheath": Motion("bowden-1m", "position", 0.008, "drive_position", centre=0.012),
    "linear_drive": Motion("", "position", 0.1, "motor_position", changes=(("belt_stiffness", 5e5),)),
    "rotary_joint": Motion("geared-arm", "voltage", 3.0, "voltage", last=True),
}
"""The plants that are shown. The circuit's chain shows the same as its closed form, and the plants of recordings
follow a motion instead of making one."""


def drawn() -> dict[tuple[str, str], bytes]:
    """The picture of each effect on each plant that has it: (effect, plant) -> SVG."""
    packed = kept("signatures.json", lambda: json.dumps(_drawn()).encode())
    return {tuple(key.split("/")): text.encode() for key, text in json.loads(packed).items()}


def _drawn() -> dict[str, str]:
    cases = [(effect, plant) for effect in EFFECTS for plant in _plants(effect)]
    made = {f"{effect}/{plant}": _picture(plant_for(plant), effect, MOTIONS[plant]) for effect, plant in cases}
    return {case: svg for case, svg in made.items() if svg}


def _plants(effect: str) -> list[str]:
    """Plants that an effect is shown on."""
    found = [plant for plant in plants_with(effect) if plant in MOTIONS]
    return [plant for plant in found if not MOTIONS[plant].last] or found


def _picture(plant: Plant, name: str, motion: Motion) -> str:
    """The picture; empty where this motion of this rig does not show the effect."""
    effect = plant.effects.effects[name]
    sensors = {name: plant.signals[plant.row(name)].unit for name in plant.effects.acting.sensors}
    signals = [name for name, unit in sensors.items() if unit in UNITS and name != motion.position]
    x, without, with_it = _moved(plant, effect, motion, signals)
    row, size = _plainest(without, with_it)
    if size < LEAST:
        return ""
    label, factor = _shown(plant, signals[row])
    x_label, x_factor = _shown(plant, motion.position)
    whole, last = slice(STEPS, None), slice(-STEPS - 1, None)
    change = with_it[:, row] - without[:, row]

    def draw(figure: Any) -> None:
        above, below = figure.subplots(2, sharex=True, height_ratios=(1.35, 1.0))
        above.plot(x_factor * x[last], factor * without[last, row], color=SOFT, linewidth=1.2)
        above.plot(x_factor * x[whole], factor * with_it[whole, row], color=BLUE, linewidth=1.2)
        below.plot(x_factor * x[whole], factor * change[whole], color=BLUE, linewidth=1.2)
        above.set(ylabel=label)
        below.set(xlabel=x_label, ylabel="change")
        for ax in (above, below):
            ax.locator_params(nbins=4)
        figure.align_ylabels()
        figure.subplots_adjust(left=0.2, right=0.97, top=0.97, bottom=0.13, hspace=0.12)

    return svg(draw, *SIZE)


def _moved(plant: Plant, effect: Effect, motion: Motion, signals: list[str]) -> tuple[np.ndarray, ...]:
    """True position of the drive without the effect [T]; the sensors' signals without and with it [T, k]."""
    values = np.repeat(_column(plant, motion), 2, axis=1)
    for parameter in effect.parameters:
        row = plant.table.index(effect.row(parameter))
        if not parameter.shape:
            values[row, 0] = parameter.null
        values[row, 1] = parameter.typical
    t = DT * np.arange(1, PERIODS * STEPS + 1)
    w = 2.0 * np.pi / (STEPS * DT)
    place = motion.centre + motion.swing * np.sin(w * t)
    path = motion.swing * w * np.cos(w * t) if motion.rate else place
    names = [motion.position, *signals]
    out = replay(plant, values, path, DT, drive=motion.drive, signals=names, start=motion.centre, substeps=40)
    return out[:, 0, 0], out[:, 1:, 0], out[:, 1:, 1]


def _column(plant: Plant, motion: Motion) -> np.ndarray:
    if not motion.rig:
        return plant.table.pack(dict(motion.changes))[:, None]
    return load_rig(motion.rig).replace(dict(motion.changes)).column(plant)


def _plainest(without: np.ndarray, with_it: np.ndarray) -> tuple[int, float]:
    """The signal that changes most over its own swing, and by how much (RMS); the least of those that change by more.

    A signal that hardly moves (the tension of a hanging load) is measured by a fifth of its size instead.
    """
    swing = np.maximum(np.ptp(without, axis=0), 0.2 * np.abs(without).max(axis=0)) + 1e-9
    change = np.sqrt(np.mean((with_it - without)[STEPS:] ** 2, axis=0)) / swing
    row = int(np.argmax(np.where(change <= 1.0, change, -change)))
    return row, float(change[row])


def _shown(plant: Plant, name: str) -> tuple[str, float]:
    """Axis label of a signal, and the factor from SI to what is shown."""
    unit, factor = UNITS[plant.signals[plant.row(name)].unit]
    return f"{name.replace('_', ' ')} [{unit}]", factor
