"""Environments and replays on an NVIDIA GPU, from the same text as on the CPU (`cable_envs.core.compiling.device`)."""
