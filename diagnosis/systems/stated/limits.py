"""The limits of a corrected rig: what its records show, so that the commands of an environment are the rig's.

Nobody states how far a drive goes whose recording is diagnosed, and the plant's default is another rig's: it would cut
off a force that was recorded, or leave a hundredth of its range to what the rig ever had.
"""

from collections.abc import Iterable
from typing import Any

import numpy as np

from cable_envs.diagnosis.data.recording import Recording
from cable_envs.diagnosis.systems.question import Request
from cable_envs.plants import family, plant_for

MARGIN = 1.05
"""Limit over the largest size that was recorded, which has its noise."""
TEARS = ("tension_limit", "breaking_tension")
SOURCE = "the largest that was recorded"


def limits_of(recording: Recording, request: Request) -> dict[str, float]:
    """Limits of commands that the records show and nobody states.

    Parameters
    ----------
    recording : Recording
        Whose records are diagnosed.
    request : Request
        What was asked of it; a rig that it has states its limits.

    Returns
    -------
    dict of str to float
        Parameter of the plant -> value, SI (`cable_envs.plants.family.Family.limits`).
    """
    stated = stated_in(recording, request)
    sizes = {name: MARGIN * _largest(recording, [channel]) for channel, name in family(recording.system).limits.items()}
    return {name: size for name, size in sizes.items() if size > 0.0 and name not in stated}


def untorn(recording: Recording, rig: dict[str, Any]) -> dict[str, Any]:
    """A corrected rig in which nothing tears at a tension that the records have.

    Parameters
    ----------
    recording : Recording
        Whose records were fitted.
    rig : dict
        Content of the corrected rig's file.

    Returns
    -------
    dict
        The same content. Where a recorded force is above a limit that nobody states, both limits are raised alike.
    """
    parameters = dict(rig["parameters"])
    if not plant_for(rig["plant"]).tears or not set(TEARS) <= set(parameters):
        return rig
    forces = [channel.name for channel in recording.channels.values() if channel.si_unit == "N"]
    more = MARGIN * _largest(recording, forces) / parameters[TEARS[0]]["value"]
    if more <= 1.0 or set(TEARS) & stated_in(recording):
        return rig
    for name in TEARS:
        parameters[name] = {**parameters[name], "value": more * parameters[name]["value"], "source": SOURCE}
    return {**rig, "parameters": parameters}


def stated_in(recording: Recording, request: Request | None = None) -> set[str]:
    """Names of what a recording states, and of what a rig does that was given with the request."""
    given = request.rig if request is not None and request.rig else ()
    return {*given, *recording.known, *recording.nominal, *(recording.rig.values if recording.rig else ())}


def _largest(recording: Recording, channels: Iterable[str]) -> float:
    """Largest size of channels in the fitted records, SI; 0 where none is there."""
    sizes = [
        float(np.max(np.abs(record.data[name][record.usable(name)]), initial=0.0))
        for record in recording.used_for("fit")
        for name in channels
        if name in recording.channels
    ]
    return max(sizes, default=0.0)
