"""Recordings of a rotary joint: its own controller in the loop, or its motor's effort with the joint held softly."""

from cable_envs.diagnosis.systems.rotary_joint.model import RATE, instead, prepare

__all__ = ["RATE", "instead", "prepare"]
