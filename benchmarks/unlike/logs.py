"""What rigs' loggers write: counts, filtered speeds, noise, a clock of their own; and a run of a MuJoCo model."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import mujoco
import numpy as np

CONTROL = 1e-3
"""s between two commands of every rig's controller."""


@dataclass(frozen=True)
class Sensor:
    """A column of a log: ``scale`` per SI unit, noise (RMS) and count in its unit, time constant of a filter in s."""

    header: str
    scale: float = 1.0
    noise: float = 0.0
    count: float = 0.0
    filtered: float = 0.0
    digits: int = 5


@dataclass(frozen=True)
class Dialect:
    """How a logger writes: unit of the time (factor to s), rate (Hz), jitter and drift of the clock, text."""

    time: str
    per_second: float
    rate: float
    jitter: float = 1e-4
    drift: float = 2e-5
    delimiter: str = ","
    decimal: str = "."
    preamble: tuple[str, ...] = ()


@dataclass(frozen=True)
class Log:
    """A rig's logs and what is true of it.

    Attributes
    ----------
    name, about : str
        Of the rig; what its owner would say of it.
    files : mapping of str to str
        File name -> text.
    heldout : str
        File that is not for fitting.
    owner : mapping of str to (float, str, float or None)
        What the owner has measured: quantity -> value, unit, standard deviation (None: trusted).
    truth : mapping of str to (float, str)
        What the owner's plain simulator lacks -> size and unit.
    """

    name: str
    about: str
    files: Mapping[str, str]
    heldout: str
    owner: Mapping[str, tuple[float, str, float | None]]
    truth: Mapping[str, tuple[float, str]] = field(default_factory=dict)

    def write(self, folder: Path) -> Path:
        """Write the files to ``folder``, which is made; returns it."""
        folder.mkdir(parents=True, exist_ok=True)
        for name, text in self.files.items():
            (folder / name).write_text(text, encoding="utf-8")
        return folder


Law = Callable[[float, mujoco.MjData], None]
"""What a controller does every `CONTROL` s: (time, data) -> sets data.ctrl."""
See = Callable[[mujoco.MjData], tuple[float, ...]]
"""True values of all sensors, SI."""


def run(model: mujoco.MjModel, law: Law, see: See, seconds: float, between: Law | None = None) -> np.ndarray:
    """True values [1 + seconds / CONTROL, sensors] of a run from rest; ``between``: called before every MuJoCo step."""
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    fine = round(CONTROL / model.opt.timestep)
    seen = []
    for k in range(round(seconds / CONTROL)):
        law(k * CONTROL, data)
        seen.append(see(data))
        for _ in range(fine):
            if between is not None:
                between(data.time, data)
            mujoco.mj_step(model, data)
    return np.array([*seen, see(data)])


def text(seen: np.ndarray, sensors: tuple[Sensor, ...], dialect: Dialect, rng: np.random.Generator) -> str:
    """The file that a logger writes of a run."""
    every = round(1.0 / dialect.rate / CONTROL)
    rows = np.arange(0, len(seen), every)
    clock = rows * CONTROL * (1.0 + dialect.drift) + rng.normal(0.0, dialect.jitter, len(rows))
    columns = [np.char.mod("%.4f", (clock - clock[0]) * dialect.per_second)]
    for k, sensor in enumerate(sensors):
        values = seen[:, k]
        if sensor.filtered:
            values = _filtered(values, sensor.filtered)
        values = values[rows] * sensor.scale + rng.normal(0.0, sensor.noise, len(rows)) * (sensor.noise > 0.0)
        if sensor.count:
            values = sensor.count * np.round(values / sensor.count)
        columns.append(np.char.mod(f"%.{sensor.digits}f", values))
    body = [dialect.delimiter.join(row) for row in np.stack(columns, axis=1)]
    if dialect.decimal != ".":
        body = [line.replace(".", dialect.decimal) for line in body]
    head = dialect.delimiter.join([dialect.time, *(s.header for s in sensors)])
    return "\n".join([*dialect.preamble, head, *body]) + "\n"


def _filtered(values: np.ndarray, time: float) -> np.ndarray:
    out, left, state = np.empty(len(values)), np.exp(-CONTROL / time), values[0]
    for k, value in enumerate(values):
        state = value + (state - value) * left
        out[k] = state
    return out


def sines(rng: np.random.Generator, offset: float, parts: tuple[tuple[float, float, float], ...], soft: float = 1.0):
    """A motion about ``offset``: sines of (size, lowest, highest rate in Hz) that set in softly; time -> value."""
    drawn = [(size, 2 * np.pi * rng.uniform(low, high), rng.uniform(0.0, 2 * np.pi)) for size, low, high in parts]

    def of(time: float) -> float:
        grown = min(time / soft, 1.0)
        grown = grown * grown * (3.0 - 2.0 * grown)
        return offset * grown + grown * sum(size * np.sin(w * time + phase) for size, w, phase in drawn)

    return of


def trapezoids(rng: np.random.Generator, offset: float, size: float, speed: float, hold: float):
    """Ramps at an even speed between holds at places drawn within ``offset`` +- ``size``; time -> value."""
    times, places = [0.0, 0.5], [0.0, 0.0]
    while times[-1] < 60.0:
        place = offset + rng.uniform(-size, size)
        times += [times[-1] + max(abs(place - places[-1]) / speed, 1e-3)]
        times += [times[-1] + hold]
        places += [place, place]
    return lambda time: float(np.interp(time, times, places))
