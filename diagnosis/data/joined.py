"""Recordings of one rig as one: a new record beside those that were there."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import count

from cable_envs.core.errors import ConfigurationError
from cable_envs.diagnosis.data.record import Record
from cable_envs.diagnosis.data.recording import Recording


def joined(recording: Recording, others: Sequence[Recording]) -> Recording:
    """The records of several recordings of one rig; what is known of the rig is what the first one says.

    Parameters
    ----------
    recording : Recording
        That says what is known and believed of the rig.
    others : sequence of Recording
        Of the same system with the same channels. A record at rest of theirs is left out where there is one already,
        and a record of a name that is taken has a number behind it.

    Returns
    -------
    Recording

    Raises
    ------
    ConfigurationError
        For another system, and for other channels.

    Examples
    --------
    ::

        joined(load_recording("jaw/"), [load_recording("jaw-next/")])
    """
    records = list(recording.records)
    for other in others:
        if other.system != recording.system:
            raise ConfigurationError(
                f"{other.path} is of a {other.system}, {recording.path} of a {recording.system}: only records of "
                "one rig can be joined"
            )
        if set(other.channels) != set(recording.channels):
            apart = ", ".join(sorted(set(other.channels) ^ set(recording.channels)))
            raise ConfigurationError(
                f"{other.path} and {recording.path} have not the same channels: {apart}. Import both with one mapping"
            )
        for record in other.records:
            if record.use != "rest" or not any(r.use == "rest" for r in records):
                records.append(_named_apart(record, {r.name for r in records}))
    return replace(recording, records=tuple(records))


def _named_apart(record: Record, taken: set[str]) -> Record:
    if record.name not in taken:
        return record
    return replace(record, name=next(name for k in count(2) if (name := f"{record.name} ({k})") not in taken))
