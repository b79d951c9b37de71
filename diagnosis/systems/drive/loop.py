"""The controller of a recorded drive, where one of a known form explains what it did."""

import numpy as np

from cable_envs.diagnosis.data.recording import Recording
from cable_envs.diagnosis.model.noise import jitter
from cable_envs.diagnosis.systems.common import resample, smooth_speed
from cable_envs.diagnosis.systems.drive.model import GAINS, effort_of, middle, recorded

EXPLAINED = 3.0
"""What a controller may leave of the effort, over what the sensors' noise makes of it, for the loop to be replayed. On
266 drives under such a controller 0.6 to 1.6: of coloured noise, the jitter between samples is the smaller part."""


def controller(recording: Recording, period: float) -> tuple[dict[str, float], float]:
    """(gains of `GAINS`, what they leave of the effort over what noise makes of it), of the fit records.

    By least squares in two stages, the reference and its derivatives being the instruments (Wooldridge, Econometric
    Analysis, 2010, ch. 5): plain ones take the noise of the measured position and speed for motion, and found half of
    the damping or less.
    """
    effort = effort_of(recording)
    rows, told, target, noise = [], [], [], []
    for record in recording.used_for("fit"):
        _, series = recorded(record, period, ("position", "position_reference", effort))
        reference, position = series["position_reference"].values, series["position"].values
        speed = smooth_speed(position, period, 0.05)
        if "velocity" in recording.channels:
            speed = resample(record, period, ("velocity",))[1]["velocity"].values
        good = series[effort].good & series["position"].good
        rate = middle(reference, period)[2]
        rows.append(np.column_stack([reference - position, rate, -speed])[good])
        told.append(np.column_stack([reference, *_following(rate, period)])[good])
        target.append(series[effort].values[good])
        noise.append([jitter(series[effort].values), jitter(position), jitter(speed)])
    table, instruments, wanted = np.concatenate(rows), np.concatenate(told), np.concatenate(target)
    instruments = instruments / np.maximum(np.std(instruments, axis=0), 1e-300)
    moved = instruments @ np.linalg.lstsq(instruments, table, rcond=None)[0]
    gains = np.linalg.lstsq(moved, wanted, rcond=None)[0]
    from_noise = np.sqrt(np.mean(noise, axis=0) ** 2 @ np.array([1.0, gains[0] ** 2, gains[2] ** 2]))
    left = float(np.std(wanted - table @ gains))
    return dict(zip(GAINS, gains.tolist(), strict=True)), left / max(float(from_noise), 0.003 * float(np.std(wanted)))


_LAGS = (1, 2, 4, 8)
"""Samples by which a reference's rate tells what a drive does later."""


def _following(rate: np.ndarray, period: float) -> list[np.ndarray]:
    """What a drive may make of a reference's rate [T]: itself, two derivatives, its sign, and it somewhat later."""
    acceleration = np.gradient(rate, period)
    late = [np.r_[np.full(lag, rate[0]), rate[:-lag]] for lag in _LAGS]
    return [rate, acceleration, np.gradient(acceleration, period), np.sign(rate), *late]
