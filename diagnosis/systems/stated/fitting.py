"""Which systems the channels of a recording, or of a mapping, fit: what is missing, and what each would assume."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from cable_envs.core.config import read_yaml
from cable_envs.diagnosis.data.description import Channel, channels_of, parameters_of, read_quantities, read_rig
from cable_envs.diagnosis.data.recording import Recording, load_recording
from cable_envs.diagnosis.readers.guess.assign import Match, Signal, matches
from cable_envs.diagnosis.readers.mapping import SCHEMA, load_mapping
from cable_envs.diagnosis.systems import asked_for, refitted_by, simulator_of, starting_values
from cable_envs.diagnosis.systems.question import Origin, Request
from cable_envs.diagnosis.systems.stated.origins import missing_channels, origins
from cable_envs.plants import family

OF_RECORDS = (
    "the ratio and the zeros are told by the records; friction and stiffness count as absent until they are found"
)


@dataclass(frozen=True)
class SystemFit:
    """One system held against the channels of a recording.

    Parameters
    ----------
    system, title : str
        Name in files, and for people.
    fits : bool
        Whether all channels are there that a diagnosis needs.
    channels : Mapping of str to str
        Channel of the system -> the recording's channel that would be it.
    missing : tuple of tuple of str
        Groups of channels, of each of which one is needed and none is there.
    asks : tuple of str
        Parameters that must be stated and are not; where the drive's controller can be replayed they need not be.
    parameters : tuple of Origin
        Every number: stated, fitted, or assumed, with its value and where that comes from. Empty where nothing fits.
    note : str
        What else a person should know.
    """

    system: str
    title: str
    fits: bool
    channels: Mapping[str, str]
    missing: tuple[tuple[str, ...], ...]
    asks: tuple[str, ...] = ()
    parameters: tuple[Origin, ...] = ()
    note: str = ""


def systems_for(source: Recording | Path | str) -> list[SystemFit]:
    """Which systems fit, the one that is stated first, then the others, the best first.

    Parameters
    ----------
    source : Recording, Path or str
        A recording, its file or folder, or a mapping file (``cablebench import FORMAT PATH --guess`` proposes one).

    Returns
    -------
    list of SystemFit
        One for every system whose recordings can be diagnosed.

    Raises
    ------
    ConfigurationError
        For a file that cannot be read.

    Examples
    --------
    >>> from cable_envs.diagnosis import Recording
    >>> run = {"time": [0.0, 0.1, 0.2], "position": [0.0, 1.0, 2.0], "voltage": [1.0, 2.0, 3.0]}
    >>> best = systems_for(Recording.from_arrays("linear_drive", {"up": run}))[0]
    >>> best.system, best.fits, best.asks
    ('linear_drive', True, ('mass',))
    """
    recording = source if isinstance(source, Recording) else _read(Path(source))
    names = [name for name in recording.channels if name != "time"]
    signals = [Signal.of_channel(name, recording.channels[name].si_unit) for name in names]
    found = []
    for one in matches(signals):
        if one.system == recording.system:
            own = {name: k for k, name in enumerate(names)}
            one = replace(one, channels=own, missing=_missing(recording))
        found.append(_fit(recording, one, names))
    return sorted(found, key=lambda fit: fit.system != recording.system)


def _missing(recording: Recording) -> tuple[tuple[str, ...], ...]:
    if not starting_values(recording, simulator_of(recording, Request()), Request()):
        return ()  # of a model of its own, which its channels chose
    return missing_channels(recording)


def _read(path: Path) -> Recording:
    """The recording at a path; of a mapping file one without records."""
    if path.is_dir() or read_yaml(path).get("schema") != SCHEMA:
        return load_recording(path)
    mapped = load_mapping(path, "inspect", topics="topic" in path.read_text(encoding="utf-8"))
    units, said = channels_of(mapped.system), mapped.general
    known, nominal = (
        read_quantities(said.get(key), mapped.system, f"{path.name}: {key}") for key in ("known", "nominal")
    )
    channels = {c.name: Channel(c.name, c.header, c.unit, units[c.name]) for c in mapped.channels}
    rig = read_rig(said.get("rig"), mapped.system, path)
    return Recording(path, mapped.system, rig, known, nominal, channels, ())


def _fit(recording: Recording, match: Match, names: list[str]) -> SystemFit:
    taken = {channel: names[k] for channel, k in match.channels.items()}
    title = family(match.system).title
    if match.missing:
        return SystemFit(match.system, title, False, taken, match.missing)
    request, own = Request(), _as(recording, match.system, taken)
    plant = simulator_of(own, request)
    values = starting_values(own, plant, request)
    rows = origins(own, plant, values, refitted_by(own))
    return SystemFit(match.system, title, True, taken, (), asked_for(own, request), rows, "" if values else OF_RECORDS)


def _as(recording: Recording, system: str, taken: Mapping[str, str]) -> Recording:
    """The recording as one of another system: its channels by other names, and what is said that both systems have."""
    if system == recording.system:
        return recording
    table, back = parameters_of(system), {"time": "time", **taken}
    units = channels_of(system)
    return replace(
        recording, system=system, rig=None,
        known={n: q for n, q in recording.known.items() if n in table},
        nominal={n: q for n, q in recording.nominal.items() if n in table},
        channels={n: replace(recording.channels[s], name=n, si_unit=units[n]) for n, s in back.items()},
        records=tuple(
            replace(r, data={n: r.data[s] for n, s in back.items()}) for r in recording.records
        ),
    )  # fmt: skip
