"""Recordings as models: one module for each system, each with ``prepare(recording, request) -> Question``.

A module lays the records on an even clock, drives the system's kernel by what was recorded as its input, and predicts
the other channels. Everything after that (refit, score tests, selection, localisation, verdict) knows no system.
"""

from dataclasses import replace
from importlib import import_module

from cable_envs.core.errors import ConfigurationError
from diagnosis.data.recording import Recording
from diagnosis.systems import transmission
from diagnosis.systems.question import Look, Question, Request

_MODULES = {"linear_drive": "linear_drive", "cable_hole": "cable_hole", "pulley_circuit": "pulley_circuit"}
_BY_CHANNEL = {"speed_reading": "coupled_drives", "band_tension_1": "band_brake"}
"""Linear drives that are modelled in another way, by a channel that only they have."""


def prepare(recording: Recording, request: Request | None = None) -> Question:
    """What a recording asks. Raises ConfigurationError where its channels cannot answer, naming what is missing."""
    if recording.system not in _MODULES:
        raise ConfigurationError(f"{recording.path}: no model for system '{recording.system}'")
    request = request or Request()
    seen_as_a_whole = recording.system == "pulley_circuit" and transmission.fits(recording)
    if request.variant and (recording.system != "pulley_circuit" or seen_as_a_whole):
        raise ConfigurationError(
            f"{recording.path}: variant '{request.variant}' chooses between two models, and this recording has one: it "
            f"would have to be of a pulley_circuit, with a rig or the circuit's geometry in it"
        )
    if seen_as_a_whole:
        question = transmission.prepare(recording, request)
    else:
        question = import_module(f"diagnosis.systems.{_module(recording)}").prepare(recording, request)
    _stated_is_white(recording, question)
    return question


def _stated_is_white(recording: Recording, question: Question) -> None:
    """Channels whose noise the recording states are noisy from sample to sample: what lasts longer is no noise there.

    Else a bias is an endless memory of the noise, a slow mismatch its colour, and each costs a few numbers only.
    """
    for model in (question.fit, question.heldout):
        for k, block in enumerate(model.blocks):
            if block.channel in recording.noise:
                model.blocks[k] = replace(block, memory=0)


def looked_at(recording: Recording) -> Look:
    """What of the records the model uses."""
    if recording.system == "pulley_circuit" and transmission.fits(recording):
        return Look(transmission.PERIOD, transmission.EDGE)
    if recording.system in _MODULES and _module(recording) == "band_brake":
        return Look(1.0 / import_module("diagnosis.systems.band_brake").RATE)
    return Look()


def _module(recording: Recording) -> str:
    special = [module for channel, module in _BY_CHANNEL.items() if channel in recording.channels]
    return (special or [_MODULES[recording.system]])[0]
