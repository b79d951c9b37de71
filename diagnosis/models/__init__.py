"""Recordings as models: one module for each system, each with ``prepare(recording, request) -> Question``.

A module lays the records on an even clock, drives the system's kernel by what was recorded as its input, and predicts
the other channels. Everything after that (refit, screening, selection, localisation, verdict) knows no system.
"""

from importlib import import_module

from cable_envs.errors import ConfigurationError
from diagnosis.models import transmission
from diagnosis.models.question import Question, Request
from diagnosis.recording import Recording

_MODULES = {"linear_drive": "linear_drive", "cable_hole": "cable_hole", "pulley_circuit": "pulley_circuit"}
_BY_CHANNEL = {"speed_reading": "coupled_drives", "band_tension_1": "band_brake"}
"""Linear drives that are modelled in another way, by a channel that only they have."""


def prepare(recording: Recording, request: Request | None = None) -> Question:
    """What a recording asks. Raises ConfigurationError where its channels cannot answer, naming what is missing."""
    if recording.system not in _MODULES:
        raise ConfigurationError(f"{recording.path}: no model for system '{recording.system}'")
    if recording.system == "pulley_circuit" and transmission.fits(recording):
        return transmission.prepare(recording, request or Request())
    special = [module for channel, module in _BY_CHANNEL.items() if channel in recording.channels]
    module = import_module(f"diagnosis.models.{(special or [_MODULES[recording.system]])[0]}")
    return module.prepare(recording, request or Request())
