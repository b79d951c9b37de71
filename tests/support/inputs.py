"""Rows of a plant's input, for tests that fill it by hand."""

from cable_envs.core.inputs import INPUTS

COMMAND, COMMAND_RATE, MODE, DISTURBANCE = (
    INPUTS.row(name) for name in ("command", "command_rate", "mode", "disturbance")
)
