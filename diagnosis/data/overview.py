"""What is in a recording, before anything is computed from it: records, channels, what is stated of the rig."""

from typing import Any

import numpy as np

from cable_envs.diagnosis.data.recording import Record, Recording


def overview(recording: Recording) -> dict[str, Any]:
    """Records and channels of a recording in numbers.

    Parameters
    ----------
    recording : Recording

    Returns
    -------
    dict
        "system", "description"; "records": for each its name, use, samples, seconds, rate (Hz, of the median step),
        gaps (empty values of all channels), doubts and conditions; "channels": for each but the time its name, SI unit,
        least and largest value that is a measurement, and stated noise or None; "known" and "nominal": values by name.

    Examples
    --------
    >>> t = np.arange(0.0, 1.0, 0.01)
    >>> run = {"time": t, "position": 10.0 * t, "force": 0.0 * t}
    >>> seen = overview(Recording.from_arrays("linear_drive", {"up": run}, units={"position": "mm"}))
    >>> seen["records"][0]["samples"], round(seen["records"][0]["rate"]), seen["channels"][0]["high"]
    (100, 100, 0.0099)
    """
    names = [name for name in recording.channels if name != "time"]
    return {
        "system": recording.system,
        "description": recording.description,
        "records": [_record(record, names) for record in recording.records],
        "channels": [
            {
                "name": name,
                "unit": recording.channels[name].si_unit,
                **_range(recording, name),
                "noise_std": recording.channels[name].noise_std,
            }
            for name in names
        ],
        "known": {name: quantity.value for name, quantity in recording.known.items()},
        "nominal": {name: quantity.value for name, quantity in recording.nominal.items()},
    }


def _record(record: Record, channels: list[str]) -> dict[str, Any]:
    time = record.time
    return {
        "name": record.name,
        "use": record.use,
        "samples": len(time),
        "seconds": float(time[-1] - time[0]),
        "rate": float(1.0 / np.median(np.diff(time))) if len(time) > 1 else float("nan"),
        "gaps": int(sum(np.isnan(record.data[name]).sum() for name in channels)),
        "doubts": len(record.quality),
        "conditions": dict(record.conditions),
    }


def _range(recording: Recording, channel: str) -> dict[str, float]:
    """Least and largest measurement of a channel over all records; NaN where there is none."""
    values = [record.data[channel][record.usable(channel)] for record in recording.records]
    found = np.concatenate([*values, np.empty(0)])
    return {"low": float(found.min()), "high": float(found.max())} if len(found) else {"low": np.nan, "high": np.nan}
