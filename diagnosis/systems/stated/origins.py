"""Where each number of a simulator comes from: stated by the user, assumed because nobody states it, or fitted."""

from collections.abc import Mapping, Sequence

from cable_envs.core.errors import ConfigurationError
from cable_envs.core.params import Parameter
from cable_envs.diagnosis.data.recording import Recording
from cable_envs.diagnosis.systems.conditions import given
from cable_envs.diagnosis.systems.question import Origin
from cable_envs.plants import family
from cable_envs.plants.base import Plant

STATED, ASSUMED, FITTED = "stated", "assumed", "fitted"
DEFAULT, ABSENT, MEASURED = "default", "absent unless stated", "from the records"
"""What a number that nobody states starts from."""
LISTED = 6
"""Assumed numbers that a note names."""


def origins(
    recording: Recording, plant: Plant, values: Mapping[str, float], fitted: Sequence[str],
    rig: Mapping[str, float] | None = None,
) -> tuple[Origin, ...]:  # fmt: skip
    """Where the plant's own parameters come from, the effects that it may lack left out.

    Parameters
    ----------
    recording : Recording
        What the user states.
    plant : Plant
        That simulates it.
    values : mapping of str to float
        Where the simulation starts, SI, by name; of what is not in it nothing is said.
    fitted : sequence of str
        Parameters that every refit moves.
    rig : mapping of str to float, optional
        Values of a rig file that replace those of the recording.

    Returns
    -------
    tuple of Origin
        In the order of the plant's table.
    """
    aliases = plant.effects.aliases
    said = dict.fromkeys(recording.rig.values, f"rig {recording.rig.name}") if recording.rig else {}
    said |= dict.fromkeys(recording.nominal, "nominal") | dict.fromkeys(recording.known, "known")
    told = [set(given(record, plant)) for record in recording.used_for("fit")]
    said |= dict.fromkeys(set.intersection(*told) if told else (), "conditions")
    said |= dict.fromkeys(rig or {}, "the rig that was given")
    named = {aliases.get(name, name): source for name, source in said.items()}
    found = []
    for p in plant.parameters:
        if p.name not in values:
            continue
        source = named.get(p.name) or _unstated(p, values[p.name])
        stated = p.name in named
        status = FITTED if p.name in fitted else STATED if stated else ASSUMED
        found.append(Origin(p.name, float(values[p.name]), p.unit, p.meaning, status, source, stated))
    return tuple(found)


def _unstated(parameter: Parameter, value: float) -> str:
    """Where a number is from that nobody states."""
    if value == parameter.default:
        return f"{DEFAULT}: {parameter.source}" if parameter.source else DEFAULT
    return ABSENT if value == 0.0 else MEASURED


def missing_channels(recording: Recording) -> tuple[tuple[str, ...], ...]:
    """Groups of channels, of each of which the diagnosis of the system needs one, that a recording has none of."""
    return tuple(group for group in family(recording.system).least if not set(group) & set(recording.channels))


def in_words(groups: Sequence[Sequence[str]]) -> str:
    """``(("a", "b"), ("c",))`` -> "a or b, and c"."""
    return ", and ".join(" or ".join(group) for group in groups)


def require_channels(recording: Recording) -> None:
    """ConfigurationError where `missing_channels` names any."""
    if missing := missing_channels(recording):
        raise ConfigurationError(
            f"{recording.path}: the diagnosis of {recording.system} needs the channel {in_words(missing)}; "
            f"the recording has {', '.join(recording.channels)}"
        )


def require_possible(
    recording: Recording, plant: Plant, values: Mapping[str, float], rig: Mapping[str, float] | None = None
) -> None:
    """Refuse a rig that cannot be, before anything is simulated.

    Parameters
    ----------
    recording, plant, values, rig
        As of `origins`.

    Raises
    ------
    ConfigurationError
        Naming the values, and which of them nobody stated.
    """
    for record in recording.used_for("fit") + recording.used_for("heldout"):
        own = {**values, **given(record, plant)}
        try:
            plant.prepare(plant.table.pack({n: v for n, v in own.items() if n in plant.table})[:, None])
        except ConfigurationError as error:
            raise ConfigurationError(_impossible(recording, plant, own, rig, str(error))) from None


def _impossible(recording: Recording, plant: Plant, values: Mapping[str, float], rig, why: str) -> str:
    """The refusal with the numbers that it speaks of, and where each is from."""
    words = {word.strip(".,:;()'") for word in why.split()}
    about = [
        o for o in origins(recording, plant, values, (), rig) if o.name in words or any(
            len(w) > 3 and o.name.startswith(f"{w}_") for w in words)
    ]  # fmt: skip
    numbers = [f"{o.name} {o.value:.4g} {o.unit} ({'stated' if o.stated else 'assumed'}, {o.source})" for o in about]
    unsaid = [o.name for o in about if not o.stated]
    listed = f": {'; '.join(numbers)}" if numbers else ""
    ask = f". Nobody stated {', '.join(unsaid)}: state it under 'known' or 'nominal'" if unsaid else ""
    return f"{recording.path}: no such rig can be, {why}{listed}{ask}"


def assumptions(found: Sequence[Origin]) -> str:
    """Which numbers are assumed, in a sentence; empty where none is."""
    assumed = [o.name for o in found if o.status == ASSUMED]
    more = f" and {len(assumed) - LISTED} more" if len(assumed) > LISTED else ""
    listed = f"{', '.join(assumed[:LISTED])}{more}"
    return f"assumed, as nothing states them: {listed} (all are in the table of parameters)" if assumed else ""


def unused(recording: Recording, plant: Plant) -> str:
    """What the recording states and the plant that simulates it does not have, in a sentence; empty for nothing."""
    known = {*plant.table.names, *(p.name for p in family(recording.system).beside)}
    names = [n for n in {**recording.known, **recording.nominal} if plant.effects.aliases.get(n, n) not in known]
    return f"stated, and not used by the model ({plant.name}): {', '.join(names)}" if names else ""
