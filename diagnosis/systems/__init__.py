"""Recordings as models: one module for each plant, found by its name.

    prepare(recording, request) -> Question     what a recording asks
    DRIVEN_BY                                   channels, the first recorded one of which drives the simulator
    REFITTED                                    parameters that are refitted unless the recording knows them
    asks(recording, plant, request)             what must be stated, where the records do not tell it
    values_of(recording, plant, request)        numbers that its simulation starts from (else `common.plant_values`)
    off_balance(recording, record)              channels whose unit cannot be right by the plant's balance of forces
    simulator(recording, request)               the plant that simulates it (else the one of that name)
    SIMULATED_BY                                the plant whose rig corrects it, where that has another name
    instead(recording)                          another module for this recording, or None

All but the first may be absent, and the whole module: then the plant's family says how it is replayed
(`cable_envs.diagnosis.systems.general`). What a recording's channels are, and what motion is called, the plant says
itself
(`cable_envs.plants.family`). ``prepare`` lays the records on an even clock, drives the plant's kernel by what was
recorded as its input, and predicts the other channels. Everything after that (refit, score tests, selection,
localisation, verdict) knows no system.
"""

from collections.abc import Iterator
from dataclasses import replace
from importlib import import_module
from importlib.util import find_spec
from types import ModuleType

from cable_envs.core.errors import ConfigurationError
from cable_envs.diagnosis.data.description import OWN
from cable_envs.diagnosis.data.recording import Record, Recording
from cable_envs.diagnosis.model.driven import drives_of
from cable_envs.diagnosis.systems import general, transmission
from cable_envs.diagnosis.systems.common import plant_values
from cable_envs.diagnosis.systems.conditions import heeded, require_stated
from cable_envs.diagnosis.systems.question import Look, Question, Request
from cable_envs.diagnosis.systems.stated.origins import (
    assumptions,
    origins,
    require_channels,
    require_possible,
    unused,
)
from cable_envs.diagnosis.systems.units import Suspect
from cable_envs.plants import family, plant_for
from cable_envs.plants.base import Plant
from cable_envs.plants.own_effects import with_own_effects

_BY_CHANNEL = {"speed_reading": "coupled_drives", "band_tension_1": "band_brake"}
"""Linear drives that are modelled in another way, by a channel that only they have."""

_OF_PLANTS = ("cable_hole", "general", "linear_drive", "observed", "pulley_circuit")
"""Modules that run a plant as the recording states it. Their models average what they predict of samples that are
means."""


def prepare(recording: Recording, request: Request | None = None) -> Question:
    """What a recording asks. Raises ConfigurationError where its channels cannot answer, naming what is missing."""
    require_model(recording)
    request = request or Request()
    plant, chosen = _of_plant(recording.system), _chosen(recording)
    if request.variant and not (chosen is plant and _has_variants(recording.system)):
        raise ConfigurationError(
            f"{recording.path}: variant '{request.variant}' chooses between two models, and this recording has one: it "
            f"would have to be of a pulley_circuit, with a rig or the circuit's geometry in it"
        )
    simulator = simulator_of(recording, request)
    require_stated(recording, simulator, request.rig)
    values = starting_values(recording, simulator, request)
    if values:
        require_channels(recording)
        require_possible(recording, simulator, values, request.rig)
    question = heeded(recording, simulator, chosen.prepare(recording, request))
    _stated_is_white(recording, question)
    if not values:
        values = {p.name: p.start for p in question.fit.parameters if p.name in question.nominals}
    from_where = origins(recording, simulator, values, question.nominals, request.rig)
    said = tuple(filter(None, (assumptions(from_where), unused(recording, simulator))))
    return replace(
        question, ways=family(recording.system).ways, origins=from_where,
        notes=(*question.notes, *said),
    )  # fmt: skip


def simulator_of(recording: Recording, request: Request) -> Plant:
    """The plant that simulates a recording, with the effects of the user's own."""
    own = getattr(_chosen(recording), "simulator", None)
    return own(recording, request) if own else with_own_effects(plant_for(plant_of(recording)), request.own)


def refitted_by(recording: Recording) -> tuple[str, ...]:
    """Parameters that every refit of a recording moves, unless it knows them; without those of the drive's control."""
    told, own = family(recording.system).replayed, getattr(_chosen(recording), "REFITTED", ())
    names = dict.fromkeys([*(told.refitted if told else own), *recording.nominal])
    return tuple(name for name in names if name not in recording.known)


def asked_for(recording: Recording, request: Request) -> tuple[str, ...]:
    """What a recording must state and does not."""
    own = getattr(_chosen(recording), "asks", None)
    return own(recording, simulator_of(recording, request), request) if own else ()


def starting_values(recording: Recording, plant: Plant, request: Request) -> dict[str, float]:
    """Numbers of the plant that its simulation of a recording starts from, SI; empty where the records tell them."""
    chosen = _chosen(recording)
    if chosen.__name__.rpartition(".")[2] not in _OF_PLANTS:
        return {}
    own = getattr(chosen, "values_of", None)
    return own(recording, plant, request) if own else plant_values(recording, plant, request.rig)


def require_model(recording: Recording) -> None:
    """Refuse a recording of a system that no module here models."""
    if recording.system == OWN:
        raise ConfigurationError(
            f"{recording.path}: a recording of system '{OWN}' needs its simulator: diagnose(recording, simulator=...), "
            "or --simulator FILE.py:NAME"
        )
    if _of_plant(recording.system) is None:
        raise ConfigurationError(f"{recording.path}: no model for system '{recording.system}'")


def off_balance(recording: Recording, record: Record) -> Iterator[Suspect]:
    """Channels whose unit cannot be right, by what the plant says of its forces; none where it says nothing."""
    said = getattr(_of_plant(recording.system), "off_balance", None)
    return said(recording, record) if said else iter(())


def driven_by(recording: Recording) -> str:
    """The channel that drives the simulator: what it does in another motion can be predicted.

    Raises
    ------
    ConfigurationError
        Where other channels drive it, too, so that no other motion can be simulated.
    """
    chosen = _chosen(recording)
    known = general.driven_by(recording.system) if chosen is general else getattr(chosen, "DRIVEN_BY", ())
    for channel in known:
        if channel in recording.channels:
            return str(channel)
    needed = f"record {known[0]}, the command" if known else "a recording of this kind is driven by what it measured"
    raise ConfigurationError(f"{recording.path}: no other motion of this rig can be simulated: {needed}")


def plant_of(recording: Recording) -> str:
    """Name of the plant that simulates a recording: the one whose rig corrects it."""
    return getattr(_chosen(recording), "SIMULATED_BY", recording.system)


def _stated_is_white(recording: Recording, question: Question) -> None:
    """Channels whose noise the recording states are noisy from sample to sample: what lasts longer is no noise there.

    Else a bias is an endless memory of the noise, a slow mismatch its colour, and each costs a few numbers only. The
    noise that a recorded effort passes on has a colour.
    """
    if not question.at_rest and not drives_of(question.fit):
        return
    for model in (question.fit, question.heldout):
        for k, block in enumerate(model.blocks):
            if block.channel in recording.noise:
                model.blocks[k] = replace(block, memory=0)


def looked_at(recording: Recording) -> Look:
    """What of the records the model uses."""
    if _of_plant(recording.system) is None:
        return Look()
    chosen = _chosen(recording)
    if chosen is transmission:
        return Look(transmission.PERIOD, transmission.EDGE)
    if hasattr(chosen, "RATE"):
        return Look(1.0 / chosen.RATE)
    return Look(averages=chosen.__name__.rpartition(".")[2] in _OF_PLANTS)


def _of_plant(name: str) -> ModuleType | None:
    """The module of a plant; the general one where its family says how it is replayed; None where there is none."""
    if name == OWN:
        return None
    found = find_spec(f"{__name__}.{name}") if name.isidentifier() else None
    if found is None:
        return general if general.models(name) else None
    return import_module(found.name)


def _has_variants(name: str) -> bool:
    """Whether a plant has more than one simulator."""
    return len(family(name).variants) > 1


def _chosen(recording: Recording) -> ModuleType:
    """The module that models a recording."""
    plant = _of_plant(recording.system)
    if plant is not None and _has_variants(recording.system) and transmission.fits(recording):
        return transmission
    special = [module for channel, module in _BY_CHANNEL.items() if channel in recording.channels]
    if special:
        return import_module(f"{__name__}.{special[0]}")
    assert plant is not None, "a recording without channels of a special module is of a known plant"
    instead = getattr(plant, "instead", None)
    return (instead(recording) if instead else None) or plant
