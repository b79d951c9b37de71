"""Recordings of a rotary joint: the whole run again, with the joint's own controller in the loop."""

from cable_envs.diagnosis.systems.rotary_joint.model import RATE, prepare

__all__ = ["RATE", "prepare"]
