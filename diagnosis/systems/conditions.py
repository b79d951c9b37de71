"""What a record's conditions say to a model: a condition that is called as a parameter of the plant is its value there.

A load that was hung on, a pretension that was set, a coefficient that a temperature made: numbers that one rig has
differently in its records. A condition enters the replay of its own record by name, in the plant's unit and within the
plant's bounds. What every record to fit states is known and is not refitted. Where some records state a parameter and
others do not, the recording must say it for those (``known``, ``nominal`` or ``rig``). Conditions that no parameter
takes are listed in a note.
"""

import difflib
from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np

from cable_envs.core.errors import ConfigurationError
from cable_envs.diagnosis.data.record import Record
from cable_envs.diagnosis.data.recording import Recording
from cable_envs.diagnosis.model.hypotheses import Candidates
from cable_envs.diagnosis.systems.question import Question
from cable_envs.plants.base import Plant

_OF_THE_SPLIT = "continues"
"""Condition that a record has when it was cut from another (`cable_envs.diagnosis.data.record.cut`)."""
_CLOSE = 0.6
"""Likeness from which a name may have been meant (`difflib.SequenceMatcher`)."""


def given(record: Record, plant: Plant) -> dict[str, float]:
    """Parameters of a plant that a record's conditions state.

    Parameters
    ----------
    record : Record
        With its conditions.
    plant : Plant
        That replays it.

    Returns
    -------
    dict of str to float
        SI, by name of the plant's whole table.

    Raises
    ------
    ConfigurationError
        For a text where the plant has a number, a unit of another kind, and a value out of the plant's bounds.

    Examples
    --------
    >>> from cable_envs.plants import plant_for
    >>> record = Record("heavy.csv", "fit", {}, {"load_mass": 7.5, "tool": "A"}, units={"load_mass": "kg"})
    >>> given(record, plant_for("cable_hole"))
    {'load_mass': 7.5}
    """
    found = {}
    for name, value in record.conditions.items():
        row = plant.effects.aliases.get(name, name)
        if row not in plant.table:
            continue
        parameter = plant.table[row]
        where = f"{record.name}: condition {name}"
        if isinstance(value, str):
            raise ConfigurationError(f"{where}: expected a number in {parameter.unit}, got the text '{value}'")
        if record.units.get(name, parameter.unit) != parameter.unit:
            raise ConfigurationError(
                f"{where} is in {record.units[name]}, and {row} of {plant.name} is in {parameter.unit}"
            )
        try:
            found[row] = parameter.check(value)
        except ConfigurationError as error:
            raise ConfigurationError(f"{where}: {error}") from error
    return found


def with_given(plant: Plant, columns: np.ndarray, stated: Mapping[str, float]) -> np.ndarray:
    """Columns [len(table), n] of a plant with what a record states (`given`) in every one of them.

    Parameters
    ----------
    plant : Plant
        Whose table it is.
    columns : ndarray
        [len(table), n], SI; left as they are.
    stated : mapping of str to float
        Values by name of the table.

    Returns
    -------
    ndarray
        A copy where something is stated, else ``columns``.
    """
    if not stated:
        return columns
    columns = columns.copy()
    for name, value in stated.items():
        columns[plant.table.index(name)] = value
    return columns


def usual(recording: Recording, plant: Plant, rig: Mapping[str, float] | None = None) -> dict[str, float]:
    """Mean over the records to fit of what all of them state and nothing else says: the rig that they are of.

    Parameters
    ----------
    recording : Recording
        Of the plant.
    plant : Plant
        That replays it.
    rig : mapping of str to float, optional
        Values that replace those of the recording.

    Returns
    -------
    dict of str to float
        SI, by name of the plant's table.
    """
    told = [given(record, plant) for record in recording.used_for("fit")]
    said = _said(recording, plant, rig)
    return {name: float(np.mean([t[name] for t in told])) for name in _shared(told) if name not in said}


def heeded(recording: Recording, plant: Plant, question: Question) -> Question:
    """A recording's question without refits of what its records state, and with notes on their conditions.

    Parameters
    ----------
    recording : Recording
        Whose conditions they are.
    plant : Plant
        That replays it.
    question : Question
        As the plant's module makes it.

    Returns
    -------
    Question
        Nominals and hypotheses that all records to fit state are left out.
    """
    shared = set(_shared(given(record, plant) for record in recording.used_for("fit")))
    stated = {h.name: ", ".join(n for n in h.names if n in shared) for h in question.hypotheses}
    why = {name: f"every record to fit states {names} under its conditions" for name, names in stated.items() if names}
    kept = Candidates(question.hypotheses, question.not_asked).less(why)
    return replace(
        question,
        nominals=tuple(name for name in question.nominals if name not in shared),
        hypotheses=kept.asked,
        not_asked=kept.not_asked,
        notes=(*question.notes, *_notes(recording, plant)),
    )


def require_stated(recording: Recording, plant: Plant, rig: Mapping[str, float] | None = None) -> None:
    """Refuse records that leave open what others state.

    Parameters
    ----------
    recording : Recording
        Of the plant.
    plant : Plant
        That replays it.
    rig : mapping of str to float, optional
        Values that replace those of the recording.

    Raises
    ------
    ConfigurationError
        Naming the record and the condition, where nothing says the value for it; and as `given` does.
    """
    told = {record.name: given(record, plant) for record in _moving(recording)}
    said = _said(recording, plant, rig)
    for name in _any(told.values()):
        lacking = [record for record, values in told.items() if name not in values]
        if lacking and name not in said:
            raise ConfigurationError(
                f"{recording.path}: {lacking[0]} states no {name}, which other records state: write it under its "
                f"conditions ({{{name}: {{value: 1, unit: {plant.table[name].unit}}}}}), or leave the record out"
            )


def _notes(recording: Recording, plant: Plant) -> tuple[str, ...]:
    """What of the conditions the model knows, what it takes where a record is silent, and what it does not know."""
    records = _moving(recording)
    told = [given(record, plant) for record in records]
    found = []
    for name in _any(told):
        stated, unit = [t[name] for t in told if name in t], plant.table[name].unit
        low, high = min(stated), max(stated)
        span = f"{low:.4g} {unit}" if low == high else f"{low:.4g} to {high:.4g} {unit}"
        silent = [r.name for r, t in zip(records, told, strict=True) if name not in t]
        rest = f"; for {', '.join(silent)}, which do not state it, the recording's value" if silent else ""
        found.append(f"{name} is each record's own, as its conditions state: {span}{rest}")
    groups = {channel.offset_free for channel in recording.channels.values()} | {_OF_THE_SPLIT}
    aliases = plant.effects.aliases
    unused = dict.fromkeys(n for r in records for n in r.conditions if aliases.get(n, n) not in plant.table)
    if listed := [_hinted(name, records, plant) for name in unused if name not in groups]:
        found.append(f"conditions that no parameter of {plant.name} takes, and nothing uses: {', '.join(listed)}")
    return tuple(found)


def _hinted(name: str, records: Iterable[Record], plant: Plant) -> str:
    """A condition's name; with the parameter of the same unit that is called nearly so."""
    unit = next((r.units[name] for r in records if name in r.units), None)
    alike = [p.name for p in plant.parameters if p.unit == unit]
    close = difflib.get_close_matches(name, alike, n=1, cutoff=_CLOSE)
    return f"{name} (is it {close[0]}?)" if close else name


def _moving(recording: Recording) -> list[Record]:
    return [record for record in recording.records if record.use != "rest"]


def _any(told: Iterable[Mapping[str, float]]) -> list[str]:
    """Names that any of the records states."""
    return list(dict.fromkeys(name for values in told for name in values))


def _shared(told: Iterable[Mapping[str, float]]) -> list[str]:
    """Names that every record states."""
    told = list(told)
    return [name for name in _any(told) if all(name in values for values in told)]


def _said(recording: Recording, plant: Plant, rig: Mapping[str, float] | None) -> set[str]:
    """Parameters of which the recording, its rig or ``rig`` gives a value for all records."""
    names = {*recording.known, *recording.nominal, *(rig or {})}
    if recording.rig is not None:
        names |= {*recording.rig.values, *recording.rig.effects}
    return {plant.effects.aliases.get(name, name) for name in names}
