"""Recorded inputs through many mechanisms at once: the open-loop replay of diagnosis and identification.

Every column is one hypothesis or one start, with a rig and effects of its own; all of them are driven over all control
steps in one compiled call.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar

import numpy as np

from cable_envs.core.compiling.device import module
from cable_envs.core.errors import ConfigurationError, nearest
from cable_envs.core.inputs import FOLLOW, IMPOSED, INPUTS, OBSERVED, RAMPED
from cable_envs.core.params import is_number
from cable_envs.core.team import Team
from cable_envs.effects.lanes import SENSE
from cable_envs.effects.sensor_delay import delayed
from cable_envs.plants.base import Plant
from cable_envs.plants.kernel import BLOCK
from cable_envs.sim.device.replays import run

ABREAST, ALONE = 8, 1
"""Columns that a processor takes at once, and how many of a rest are quicker one by one: 2 take as long as 8."""

DRIVES = ("follow", "imposed", "observed")
HOLDS = ("step", "ramp")
DEVICES = ("cpu", "cuda")


_DEVICE: ContextVar[str] = ContextVar("device", default="cpu")


@contextmanager
def replays_on(device: str) -> Iterator[None]:
    """Within the block replays run on a device.

    Parameters
    ----------
    device : str
        "cpu", or "cuda": an NVIDIA GPU.

    Raises
    ------
    ConfigurationError
        For an unknown device, and for "cuda" where there is no GPU.

    Examples
    --------
    >>> with replays_on("cpu"):
    ...     pass
    """
    if device not in DEVICES:
        raise ConfigurationError(f"unknown device {device!r}; {nearest(str(device), DEVICES)}")
    if device == "cuda":
        module()
    token = _DEVICE.set(device)
    try:
        yield
    finally:
        _DEVICE.reset(token)


def replay(
    plant: Plant,
    values: np.ndarray,
    command: np.ndarray,
    period: float,
    *,
    drive: str,
    signals: Sequence[str],
    hold: str = "ramp",
    rate: np.ndarray | None = None,
    disturbance: np.ndarray | None = None,
    second: np.ndarray | None = None,
    second_rate: np.ndarray | None = None,
    posture: np.ndarray | None = None,
    start: np.ndarray | float = 0.0,
    state: np.ndarray | None = None,
    substeps: int = 10,
    sensors: bool = True,
    threads: int = 1,
) -> np.ndarray:
    """Signals of many mechanisms that are driven by one record, or by one record each.

    Parameters
    ----------
    plant : Plant
        What simulates them.
    values : ndarray, shape (len(plant.table), n)
        Columns of parameters, SI, effects included (`cable_envs.sim.rigs.Rig.column`).
    command : array_like, shape (T,) or (T, n)
        What the drive has reached, or is told, at the end of each control step; of shape (T,) for all columns.
    period : float
        Control period, s; the samples of the record are that far apart.
    drive : str
        What the command is: an action mode of the plant, or one of the following, as far as the plant has it
        (`Plant.replays`).

        - "follow": the drive's position is the command, on a cubic through the samples with the speeds ``rate``.
        - "imposed": the command is the cable's tension at the drive (cable_hole), the torque (circuits) or the force
          (linear_drive).
        - "observed" (linear_drive): the motor's force is ``disturbance`` plus what the servo, feeling the carriage,
          adds to hold it to the command, with an integral of the gain ``second``, N/(m s). The signal "force" is then
          what the recorded motion takes.
    signals : sequence of str
        Names of the signals that are returned.
    hold : str
        "ramp": commands go from sample to sample in straight lines. "step": they jump and are held.
    rate : array_like, shape (T,) or (T, n), optional
        Speed of the command, at the end of each step for "follow", else over the step. By default it comes from
        differences of the command: central ones for "follow", else those over a step with 0 over the first.
    disturbance : array_like, shape (T,) or (T, n), optional
        Force (N) or torque (N m) on the load.
    second : array_like, shape (T,) or (T, n), optional
        The second command of a plant that has one (`ActionMode.second`); by default the one that holds the state from
        which the replay begins at rest. With "observed" as above; by default there is no integral.
    second_rate : array_like, shape (T,) or (T, n), optional
        Its speed over the step, as ``rate`` of the command.
    posture : array_like, shape (T,) or (T, n), optional
        By how much the mechanism is bent more than its rig says, rad, on plants that have a posture.
    start : float or ndarray, shape (n,)
        Position of the output at rest before the first step, SI.
    state : ndarray, shape (rows, n), optional
        State to go on from instead of ``start``, of the shape that `Plant.rest` gives. It is changed in place.
    substeps : int
        Integration steps in each period.
    sensors : bool
        False returns the true signals, without the effects of sensors.
    threads : int
        Threads that share the columns.

    Returns
    -------
    ndarray, shape (T, len(signals), n)
        The signals at the end of each step, SI.

    Raises
    ------
    ConfigurationError
        For wrong shapes, numbers that are not finite, unknown names, and a drive that the plant cannot be replayed
        with.

    Notes
    -----
    All columns go through all steps in one compiled call, on a GPU within `replays_on`. Sensors have no noise here. The
    steps are as coarse as they are asked for: inertias that are too small for them are raised (`Plant.raise_to`).
    """
    n = values.shape[1] if np.ndim(values) == 2 else 0
    if n == 0 or len(values) != len(plant.table):
        raise ConfigurationError(f"values: expected [{len(plant.table)}, n], got {np.shape(values)}")
    if not is_number(period) or period <= 0.0:
        raise ConfigurationError(f"period: expected seconds above 0, got {period!r}")
    idle = -n % ABREAST if n % ABREAST > ALONE else 0
    p = plant.prepare(_widened(np.asarray(values, dtype=np.float64), idle))
    plant.raise_to(p, period / substeps)
    if state is None:
        start = np.broadcast_to(np.asarray(start, dtype=np.float64), (n,))
        state, gone_on = plant.rest(p, _widened(start, idle)), None
    else:
        state, gone_on = _widened(state, idle), state
    held = _held(plant, drive, state)
    if second is not None and held is None and drive != "observed":
        raise ConfigurationError(f"{plant.name} has no second command; leave out 'second'")
    given = {
        "command": command, "rate": rate, "disturbance": disturbance, "posture": posture, "second": second,
        "second_rate": second_rate,
    }  # fmt: skip
    columns = {k: _column(k, v, n) for k, v in given.items() if v is not None}
    columns = {k: _widened(v, idle) if v.shape[1] > 1 else v for k, v in columns.items()}
    if drive not in DRIVES:
        columns |= _late(plant, p, {k: columns[k] for k in ("command", "rate") if k in columns}, period)
    inputs = _inputs(plant, columns, period, drive, hold, held)
    names = [s.name for s in plant.signals]
    for name in signals:
        if name not in names:
            raise ConfigurationError(f"unknown signal '{name}'; {nearest(name, names)}")
    rows = np.array([plant.row(name) for name in signals])
    out = np.empty((len(inputs[0]), len(rows), n + idle))
    first = state[rows].copy()
    needed = max(plant.kernel_needed(p), 1)
    if _DEVICE.get() == "cuda":
        run(plant, needed, (state, p, inputs, rows, out), substeps, period / substeps)
    else:
        arguments = (state, p, inputs, rows, substeps, period / substeps, out)
        _on_cores(plant.replay_kernel(needed), arguments, n + idle, threads if n > BLOCK else 1)
    if gone_on is not None and idle:
        gone_on[:] = state[:, :n]
    shown = distort(plant, p, signals, out, period, first) if sensors else out
    return shown[:, :, :n]


def _on_cores(kernel: Callable[..., None], arguments: tuple, n: int, threads: int) -> None:
    if threads > 1:
        team = Team(kernel, arguments, n, threads, BLOCK)
        team()
        team.close()
    else:
        kernel(*arguments, 0, n)


def _widened(columns: np.ndarray, idle: int) -> np.ndarray:
    """The same with the last column ``idle`` times more: a processor's lanes that would be empty cost nothing."""
    return np.concatenate([columns, np.repeat(columns[..., -1:], idle, axis=-1)], axis=-1) if idle else columns


def _late(plant: Plant, p: np.ndarray, columns: dict, period: float) -> dict:
    """The command and its rate behind the effect command_delay, each [T, 1] or [T, n]."""
    time = p[plant.coefficient_rows.count + plant.effects.lanes.row("command_delay_time")]
    if not np.any(time):
        return {}
    wide = {k: np.ascontiguousarray(np.broadcast_to(v, (len(v), len(time)))) for k, v in columns.items()}
    return {k: delayed(v, time / period) for k, v in wide.items()}


def _held(plant: Plant, drive: str, state: np.ndarray) -> np.ndarray | None:
    """The second command that holds a state at rest [n]; None where the plant has none."""
    of = {mode.name: mode.second for mode in plant.action_modes}
    told = of.get(drive, next(iter(of.values()), None))
    if told is None:
        return None
    return state[plant.row(told.rest_signal)].copy() if told.rest_signal else np.zeros(state.shape[1])


def _check_drive(plant: Plant, drive: str, hold: str, given: dict) -> None:
    modes = [m.name for m in plant.action_modes]
    if drive not in (*modes, *DRIVES):
        raise ConfigurationError(f"unknown drive '{drive}'; {nearest(drive, (*modes, *DRIVES))}")
    if drive not in (*modes, *plant.replays):
        known = ", ".join((*modes, *plant.replays))
        raise ConfigurationError(f"{plant.name} cannot be replayed with its drive '{drive}'; it can with: {known}")
    if hold not in HOLDS:
        raise ConfigurationError(f"unknown hold '{hold}'; {nearest(hold, HOLDS)}")
    if "posture" in given and not plant.posture:
        raise ConfigurationError(f"{plant.name} has no posture")


def _inputs(
    plant: Plant, columns: dict, period: float, drive: str, hold: str, held
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What the kernel takes in (`replay_with_effects`), from what is given, each [T, 1] or [T, n]."""
    _check_drive(plant, drive, hold, columns)
    path, steps = columns["command"], len(columns["command"])
    if held is not None and "second" not in columns:
        one = held[:1] if np.all(held == held[0]) else held
        columns["second"] = np.repeat(one[None], steps, axis=0)
    for name, column in columns.items():
        if len(column) != steps:
            raise ConfigurationError(f"{name} has {len(column)} steps, command has {steps}")
    mode = FOLLOW if drive == "follow" else _mode(plant, drive) + (RAMPED if hold == "ramp" else 0)
    rows = {name: columns[name] for name in ("command", "disturbance", "posture", "second") if name in columns}
    rows["mode"] = np.full((steps, 1), float(mode))
    if "rate" in columns:
        rows["command_rate"] = columns["rate"]
    elif drive == "follow":
        rows["command_rate"] = np.gradient(path, period, axis=0) if steps > 1 else np.zeros_like(path)
    else:
        rows["command_rate"] = _over_steps(path, period)
    if "second" in columns:
        rows["second_rate"] = columns.get("second_rate", _over_steps(columns["second"], period))
    wide = {name: series for name, series in rows.items() if series.shape[1] > 1}
    shared = np.zeros((steps, len(INPUTS)))
    for name in rows.keys() - wide.keys():
        shared[:, INPUTS.row(name)] = rows[name][:, 0]
    own = np.stack(list(wide.values()), axis=1) if wide else np.zeros((steps, 0, 1))
    return shared, own, np.array([INPUTS.row(name) for name in wide], dtype=np.int64)


def _over_steps(series: np.ndarray, period: float) -> np.ndarray:
    """Rates over each step, 0 over the first."""
    rates = np.zeros_like(series)
    rates[1:] = np.diff(series, axis=0) / period
    return rates


def _mode(plant: Plant, drive: str) -> int:
    if drive == "observed":
        return OBSERVED
    modes = {mode.name: mode for mode in plant.action_modes}
    if drive != "imposed":
        return plant.number_of(modes[drive])
    direct = [name for name in ("force", "torque") if name in modes]
    return plant.number_of(modes[direct[0]]) if direct else IMPOSED


def _column(name: str, value, n: int) -> np.ndarray:
    """[T, 1] or [T, n], finite."""
    array = np.asarray(value, dtype=np.float64)
    array = array[:, None] if array.ndim == 1 else array
    if array.ndim != 2 or array.shape[1] not in (1, n) or not len(array):
        raise ConfigurationError(f"{name}: expected [T] or [T, {n}], got {np.shape(value)}")
    if not np.isfinite(array).all():
        raise ConfigurationError(f"{name}: step {int(np.argmin(np.isfinite(array).all(axis=1)))} is not finite")
    return array


def distort(
    plant: Plant, p: np.ndarray, signals: Sequence[str], out: np.ndarray, period: float, first: np.ndarray
) -> np.ndarray:
    """What the sensors show of signals: scale and bias, then rectification, then delay.

    Parameters
    ----------
    plant : Plant
        Says which signals have a sensor.
    p : ndarray, shape (coefficients, n)
        As of `Plant.prepare`, with the rows of effects.
    signals : sequence of str
        Names of the k signals.
    out : ndarray, shape (T, k, n)
        Their true values, SI. It is not changed.
    period : float
        Time between two samples, s.
    first : ndarray, shape (k, n)
        Their true values before the first sample.

    Returns
    -------
    ndarray, shape (T, k, n)
        What is shown; ``out`` itself where no sensor has an effect.
    """
    shown = out
    for k, name in enumerate(signals):
        row = plant.sense_row(name)
        if row < 0:
            continue
        e = SENSE.over(p[row:])
        scale, bias, cut, late = e.sensor_scale, e.sensor_bias, e.sensor_rectification, e.sensor_delay
        some = np.flatnonzero((scale != 1.0) | (bias != 0.0) | (cut != 0.0) | (late != 0.0))
        if len(some):
            shown = shown.copy() if shown is out else shown
            series = np.concatenate([first[None, k, some], out[:, k, some]]) * scale[some] + bias[some]
            series = series - cut[some] * np.minimum(series, 0.0)
            shown[:, k, some] = delayed(series, late[some] / period)[1:]
    return shown
