"""The controller of a recorded drive, where one of a known form explains what it did."""

import numpy as np
from scipy.signal import lfilter

from cable_envs.diagnosis.data.recording import Recording
from cable_envs.diagnosis.model.noise import jitter
from cable_envs.diagnosis.systems.common import resample, smooth_speed
from cable_envs.diagnosis.systems.drive.model import GAINS, effort_of, middle, recorded

EXPLAINED = 3.0
"""What a controller may leave of the effort, over what the sensors' noise makes of it, for the loop to be replayed. On
266 drives under such a controller 0.6 to 1.6: of coloured noise, the jitter between samples is the smaller part."""


INTEGRAL = 0.02
"""Share of the sum of squares that a controller leaves by which it must leave less with an integral, to have one."""


def controller(recording: Recording, period: float) -> tuple[dict[str, float], float]:
    """(gains of `GAINS`, what they leave of the effort over what noise makes of it), of the fit records.

    By least squares in two stages, the reference and what follows from it being the instruments (Wooldridge,
    Econometric Analysis, 2010, ch. 5): plain ones take the noise of the measured position and speed for motion, and
    found half of the damping or less. The gain of the integral is 0 where the effort is not better told with one. What
    it holds when a record begins is that record's own.
    """
    effort = effort_of(recording)
    records, rows, told, target, noise = recording.used_for("fit"), [], [], [], []
    for k, record in enumerate(records):
        _, series = recorded(record, period, ("position", "position_reference", effort))
        reference, position = series["position_reference"].values, series["position"].values
        speed = smooth_speed(position, period, 0.05)
        if "velocity" in recording.channels:
            speed = resample(record, period, ("velocity",))[1]["velocity"].values
        good = series[effort].good & series["position"].good
        rate = middle(reference, period)[2]
        begun = np.zeros((len(rate), len(records)))
        begun[:, k] = 1.0
        off = reference - position
        rows.append(np.column_stack([off, rate, -speed, period * np.cumsum(off), begun])[good])
        following = _following(rate, period)
        summed = np.cumsum(np.column_stack([reference, *following]), axis=0)
        told.append(np.column_stack([reference, *following, summed, begun])[good])
        target.append(series[effort].values[good])
        noise.append([jitter(series[effort].values), jitter(position), jitter(speed)])
    table, instruments, wanted = np.concatenate(rows), np.concatenate(told), np.concatenate(target)
    plain = instruments[:, : 1 + len(following)]
    gains = _by_instruments(table[:, :3], plain, wanted)[0]
    left = wanted - table[:, :3] @ gains
    missed = _by_instruments(np.delete(table, 3, axis=1), instruments, wanted)[1]
    fuller, rest = _by_instruments(table, instruments, wanted)
    shows = fuller[0] > 0.0 and fuller[3] * period * max(map(len, rows)) > fuller[0]  # within a record
    if shows and np.mean(rest**2) < (1.0 - INTEGRAL) * np.mean(missed**2):
        rest = wanted - table @ fuller
        keep = 1.0 / (1.0 + fuller[3] / fuller[0] * period)
        ends = np.cumsum([len(one) for one in rows])[:-1]
        gains, left = fuller[:4], np.concatenate([_risen(one, keep) for one in np.split(rest, ends)])
    from_noise = np.sqrt(np.mean(noise, axis=0) ** 2 @ np.array([1.0, gains[0] ** 2, gains[2] ** 2]))
    found = dict(zip(GAINS, [*gains.tolist(), 0.0], strict=False))
    return found, float(np.std(left)) / max(float(from_noise), 0.003 * float(np.std(wanted)))


def _by_instruments(table: np.ndarray, instruments: np.ndarray, wanted: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(gains [n] of the columns of a table [T, n], what the instruments' part of these leaves [T] of what is wanted).

    The noise in the columns, larger with larger gains, is not in that part.
    """
    instruments = instruments / np.maximum(np.std(instruments, axis=0), 1e-300)
    moved = instruments @ np.linalg.lstsq(instruments, table, rcond=None)[0]
    gains = np.linalg.lstsq(moved, wanted, rcond=None)[0]
    return gains, wanted - moved @ gains


def _risen(left: np.ndarray, keep: float) -> np.ndarray:
    """What is left [T] through the high pass that makes of a proportional gain with its integral that gain alone.

    The integral of the noise of a position wanders without bounds: behind this it is what the gain makes of the noise.
    """
    return lfilter([keep, -keep], [1.0, -keep], left - left[:1]) if len(left) else left


_LAGS = (1, 2, 4, 8)
"""Samples by which a reference's rate tells what a drive does later."""


def _following(rate: np.ndarray, period: float) -> list[np.ndarray]:
    """What a drive may make of a reference's rate [T]: itself, two derivatives, its sign, and it somewhat later."""
    acceleration = np.gradient(rate, period)
    late = [np.r_[np.full(lag, rate[0]), rate[:-lag]] for lag in _LAGS]
    return [rate, acceleration, np.gradient(acceleration, period), np.sign(rate), *late]
