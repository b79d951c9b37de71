"""The range that a corrected rig was fitted in: what its file says under "valid", so that a simulation outside says so.

A law that was fitted on a part of the travel may be another law beyond it: a ripple of +-0.5 rad was none on +-1.6 rad.
The range of a signal is that of its channel in the fitted records, widened by `MARGIN`. Of a channel whose zero means
nothing, only the speed has one; but what drives a simulator as it was recorded counts from the recording's zero.
"""

from typing import Any

import numpy as np

from cable_envs.diagnosis.data.recording import Recording
from cable_envs.diagnosis.intake.tracks import SPEEDS, is_told, track_of
from cable_envs.plants import plant_for
from cable_envs.plants.base import OUT_OF_RANGE

MARGIN = 0.05
"""Of a range's width, on either side: sensors' noise, and what the same command does next time."""
SOURCE = "the fitted records"
FOLLOWED = {"transmission": ("drive_angle",)}
"""Plant -> channels that drive its simulator as they were recorded."""


def fitted_range(recording: Recording, plant: str) -> dict[str, dict[str, Any]]:
    """Range of every signal of a plant that the fitted records show.

    Parameters
    ----------
    recording : Recording
        Whose records were fitted.
    plant : str
        Of the corrected rig.

    Returns
    -------
    dict of str to dict
        Signal -> low, high (SI), unit and source, as a rig file has it under "valid"
        (`cable_envs.sim.rigs`); empty for a plant that does not tell when it is outside.
    """
    units = {s.name: s.unit for s in plant_for(plant).signals}
    if OUT_OF_RANGE.name not in units:
        return {}
    records = recording.used_for("fit")
    seen: dict[str, np.ndarray] = {}
    for name, channel in recording.channels.items():
        if name == "time" or is_told(name):
            continue
        speed = SPEEDS.get(name)
        if speed in units and speed not in recording.channels:
            tracks = [track_of(record) for record in records]
            rates = np.concatenate([track.speed(name) for track in tracks])
            seen[speed] = np.concatenate([seen.get(speed, rates[:0]), rates])
        if name in units and (channel.offset_free is None or name in FOLLOWED.get(plant, ())):
            seen[name] = np.concatenate([record.data[name][record.usable(name)] for record in records])
    found = {}
    for name, values in seen.items():
        low, high = float(np.min(values)), float(np.max(values))
        if low < high:
            more = MARGIN * (high - low)
            found[name] = {"low": low - more, "high": high + more, "unit": units[name], "source": SOURCE}
    return found
