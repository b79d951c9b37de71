"""What of a rig is set anew for the next experiment: another pretension, another weight, as a record's conditions."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

from cable_envs.core.errors import ConfigurationError, require_known
from cable_envs.diagnosis.data.recording import Recording
from cable_envs.diagnosis.systems import simulator_of
from cable_envs.diagnosis.systems.conditions import given
from cable_envs.diagnosis.systems.question import Request

AS_RECORDED: Mapping[str, float] = {}
"""The rig as each record has it."""


def checked(
    recording: Recording, request: Request, settings: Sequence[Mapping[str, float]]
) -> tuple[dict[str, float], ...]:
    """Settings by the names of the plant's table.

    Parameters
    ----------
    recording : Recording
        Of the rig.
    request : Request
        As the recording was asked.
    settings : sequence of Mapping of str to float
        Each a state that the rig can be brought to: parameter -> value, SI.

    Returns
    -------
    tuple of dict of str to float
        The same, checked.

    Raises
    ------
    ConfigurationError
        For names that are no parameters of the plant, values out of its bounds, and a setting of nothing.
    """
    plant = simulator_of(recording, request)
    found = []
    for one in settings:
        if not one:
            raise ConfigurationError("settings: expected a parameter of the rig and its value in each of them")
        require_known("setting", one, (*plant.table.names, *plant.effects.aliases))
        asked = replace(recording.records[0], name="setting", conditions=dict(one), units={})
        found.append(given(asked, plant))
    return tuple(found)


def with_units(recording: Recording, request: Request, setting: Mapping[str, float]) -> dict[str, tuple[float, str]]:
    """A setting with the unit of each value."""
    table = simulator_of(recording, request).table
    return {name: (value, table[name].unit) for name, value in setting.items()}
