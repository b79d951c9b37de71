"""One control step of a block of environments in one compiled call: action -> plant -> measurement and reward.

The plants' kernels are called by name, one stepper each, because a compiled function handed in as an argument would
not be cached on disk.
"""

from typing import NamedTuple

import numpy as np
from numba import prange

from cable_envs.kernels import inline, jit, jit_parallel
from cable_envs.plants import cable_hole, pulley_circuit
from cable_envs.plants.base import COMMAND
from cable_envs.tasks import after_step, before_step, observe

BLOCK = 128
"""Environments that a thread takes at a time."""


class Buffers(NamedTuple):
    """Everything a stepper reads and writes; arrays have one column (or entry) for each environment."""

    x: np.ndarray
    p: np.ndarray
    u: np.ndarray
    reference: np.ndarray
    disturbance: np.ndarray
    limits: np.ndarray
    """rows: tension limit, breaking tension, gain from output to proxy"""
    actions: np.ndarray
    """rows: the last action and the one before, each in [-1, 1]"""
    steps: np.ndarray
    keys: np.ndarray
    obs: np.ndarray
    reward: np.ndarray
    terminated: np.ndarray
    truncated: np.ndarray
    info: np.ndarray
    channel_rows: np.ndarray
    channel_scales: np.ndarray
    noise: np.ndarray
    """standard deviation for each signal of the plant"""
    output_row: int
    peak_row: int
    proxy_row: int
    mode: float
    low: float
    high: float
    period: float
    substeps: int
    dt: float
    error_scale: float
    effort_weight: float
    last_step: int


@inline
def _before(s, actions, lo, hi):
    for i in range(lo, hi):
        action = min(max(float(actions[i]), -1.0), 1.0)
        last = s.u[COMMAND, i]
        before_step(s.u, s.disturbance, action, last, i, s.steps[i] * s.period, s.low, s.high, s.mode, s.period)
        s.actions[1, i] = s.actions[0, i]
        s.actions[0, i] = action


@inline
def measure(s, i):
    """Observation of environment i at its present step."""
    observe(
        s.x, s.u, s.reference, i, s.steps[i], s.period, s.keys[i], s.channel_rows, s.channel_scales, s.noise,
        s.proxy_row, s.limits[2, i], s.obs,
    )  # fmt: skip
    return after_step(s.x, s.u, s.reference, i, s.steps[i], s.period, s.output_row, s.peak_row, s.limits[0, i], s.info)


@inline
def _after(s, lo, hi):
    for i in range(lo, hi):
        s.steps[i] += 1
        error = abs(measure(s, i))
        change = s.actions[0, i] - s.actions[1, i]
        s.reward[i] = 1.0 / (1.0 + error / s.error_scale) - s.effort_weight * change * change
        broken = not (s.x[s.peak_row, i] <= s.limits[1, i] and error < 1e12)
        s.terminated[i] = broken
        s.truncated[i] = s.steps[i] >= s.last_step and not broken


@jit
def measure_all(s, lanes):
    """Fill obs and info of the environments ``lanes`` (after a reset)."""
    for lane in lanes:
        measure(s, lane)


@jit
def step_cable_hole(s, actions, lo, hi):
    _before(s, actions, lo, hi)
    cable_hole.advance(s.x, s.p, s.u, lo, hi, s.substeps, s.dt)
    _after(s, lo, hi)


@jit
def step_pulley_circuit(s, actions, lo, hi):
    _before(s, actions, lo, hi)
    pulley_circuit.advance(s.x, s.p, s.u, lo, hi, s.substeps, s.dt)
    _after(s, lo, hi)


@jit_parallel
def step_cable_hole_threads(s, actions, lo, hi):
    for block in prange((hi - lo + BLOCK - 1) // BLOCK):
        step_cable_hole(s, actions, lo + block * BLOCK, min(hi, lo + (block + 1) * BLOCK))


@jit_parallel
def step_pulley_circuit_threads(s, actions, lo, hi):
    for block in prange((hi - lo + BLOCK - 1) // BLOCK):
        step_pulley_circuit(s, actions, lo + block * BLOCK, min(hi, lo + (block + 1) * BLOCK))


STEPPERS = {
    "cable_hole": (step_cable_hole, step_cable_hole_threads),
    "pulley_circuit": (step_pulley_circuit, step_pulley_circuit_threads),
}
"""plant name -> (one thread, several threads); both take (buffers, actions, lo, hi)"""
