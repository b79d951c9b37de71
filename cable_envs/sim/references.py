"""Reference signals (and disturbances and postures): what the output should follow, with its first two derivatives.

A signal is a column of `FIELDS`; `signal(q, i, t)` evaluates it in a kernel (q: rows by name), `pack_signal` makes
the column from a mapping such as ``{"kind": "sine", "amplitude": 0.01, "frequency": 0.17}``.

kind         | r(t) for t >= start (before: the offset)
------------ | ---------------------------------------------------------------------------------------
constant     | offset
step         | offset + amplitude
pulse        | offset + amplitude for ``hold`` seconds, then offset
sine         | offset + amplitude sin(2 pi frequency (t - start) + phase)
ramp         | offset + amplitude (t - start) / hold, then held
triangle     | offset + amplitude tri(frequency (t - start)), tri starts at 0 and rises
multisine    | offset + amplitude / 4 sum of sines at frequency x (1, 2.3, 3.7, 5.9), phases drawn per episode
random_steps | offset + amplitude u, u in [-1, 1) drawn anew every ``hold`` seconds
trapezoids   | the same levels, each reached on a straight line of ``ramp`` seconds and then held; while it is held,
             | + micro tri(frequency x the time since it was reached), in whole cycles
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from cable_envs.core.errors import ConfigurationError, nearest, require_known
from cable_envs.core.kernels import inline, jit, sine_cosine
from cable_envs.core.lanes import Lanes
from cable_envs.core.noise import uniform
from cable_envs.core.params import is_number

KINDS = ("constant", "step", "pulse", "sine", "ramp", "triangle", "multisine", "random_steps", "trapezoids")
FIELDS = Lanes("Signal", ["kind", "offset", "amplitude", "frequency", "start", "phase", "hold", "ramp", "micro", "key"])
"""Rows of a signal; its kind is the place of its name in `KINDS`, its key draws what is random in it."""

CONSTANT, STEP, PULSE, SINE, RAMP, TRIANGLE, MULTISINE, RANDOM_STEPS, TRAPEZOIDS = range(len(KINDS))

_NEEDS = {
    "constant": (), "step": ("amplitude",), "pulse": ("amplitude", "hold"), "sine": ("amplitude", "frequency"),
    "ramp": ("amplitude", "hold"), "triangle": ("amplitude", "frequency"), "multisine": ("amplitude", "frequency"),
    "random_steps": ("amplitude", "hold"), "trapezoids": ("amplitude", "hold", "ramp"),
}  # fmt: skip
_TAU = 2.0 * math.pi
_HARMONICS = (1.0, 2.3, 3.7, 5.9)
MULTISINE_SPEED = 0.25 * _TAU * math.fsum(_HARMONICS)
"""Largest speed that a multisine can have, for an amplitude and a frequency of 1."""
_named = FIELDS.views


@inline
def _multisine(q, i, s):
    """`signal` of the sum of four sines of one amplitude and random phases, s [s] after its start."""
    r, rate, acceleration = q.offset[i], 0.0, 0.0
    part = 0.25 * q.amplitude[i]
    for h in range(4):
        w = _TAU * q.frequency[i] * _HARMONICS[h]
        angle = w * s + _TAU * uniform(q.key[i], float(h), 7)
        sine, cosine = sine_cosine(angle)
        r += part * sine
        rate += part * w * cosine
        acceleration -= part * w * w * sine
    return r, rate, acceleration


@inline
def _cycle(phase, amplitude, frequency):
    """(value, slope) of a triangle that starts at 0 and rises; phase: cycles since its start."""
    cycle = phase + 0.25
    cycle = cycle - math.floor(cycle)
    slope = 4.0 * amplitude * frequency
    if cycle < 0.5:
        return amplitude * (4.0 * cycle - 1.0), slope
    return amplitude * (3.0 - 4.0 * cycle), -slope


@inline
def _trapezoids(q, i, s):
    """`signal` of drawn levels that are reached at a steady speed, s [s] after its start."""
    amplitude, ramp, hold, frequency = q.amplitude[i], q.ramp[i], q.hold[i], q.frequency[i]
    k = math.floor(s / (ramp + hold))
    since = s - k * (ramp + hold)
    level = amplitude * (2.0 * uniform(q.key[i], k, 9) - 1.0)
    if since < ramp:
        before = 0.0
        if k > 0.0:
            before = amplitude * (2.0 * uniform(q.key[i], k - 1.0, 9) - 1.0)
        return q.offset[i] + before + (level - before) * since / ramp, (level - before) / ramp, 0.0
    held = since - ramp
    if q.micro[i] == 0.0 or held * frequency >= math.floor(hold * frequency):
        return q.offset[i] + level, 0.0, 0.0
    small, slope = _cycle(held * frequency, q.micro[i], frequency)
    return q.offset[i] + level + small, slope, 0.0


@inline
def signal(q, i, t):  # noqa: PLR0911 - one return for each kind
    """Value of a signal with its first two derivatives, as a piece of a kernel.

    Parameters
    ----------
    q : named tuple
        Rows of `FIELDS` by name.
    i : int
        Column.
    t : float
        Time, s.

    Returns
    -------
    tuple of three float
        r, dr/dt and d2r/dt2 in SI. A jump has no derivative; 0 is given.
    """
    kind, offset, amplitude = int(q.kind[i]), q.offset[i], q.amplitude[i]
    s = t - q.start[i]
    if kind == CONSTANT or s < 0.0:
        return offset, 0.0, 0.0
    if kind == STEP:
        return offset + amplitude, 0.0, 0.0
    if kind == PULSE:
        return offset + (amplitude if s < q.hold[i] else 0.0), 0.0, 0.0
    if kind == SINE:
        w = _TAU * q.frequency[i]
        sine, cosine = sine_cosine(w * s + q.phase[i])
        return offset + amplitude * sine, amplitude * w * cosine, -amplitude * w * w * sine
    if kind == RAMP:
        if s >= q.hold[i]:
            return offset + amplitude, 0.0, 0.0
        return offset + amplitude * s / q.hold[i], amplitude / q.hold[i], 0.0
    if kind == TRIANGLE:
        part, slope = _cycle(q.frequency[i] * s, amplitude, q.frequency[i])
        return offset + part, slope, 0.0
    if kind == MULTISINE:
        return _multisine(q, i, s)
    if kind == TRAPEZOIDS:
        return _trapezoids(q, i, s)
    level = 2.0 * uniform(q.key[i], math.floor(s / q.hold[i]), 9) - 1.0
    return offset + amplitude * level, 0.0, 0.0


@jit
def evaluate(q, t):
    """Values of signals with their first two derivatives, for callers in Python.

    Parameters
    ----------
    q : ndarray, shape (FIELDS.count, n)
        Columns as `pack_signal` makes them.
    t : float
        Time, s.

    Returns
    -------
    ndarray, shape (3, n)
        r, dr/dt and d2r/dt2 as of `signal`.
    """
    named, found = _named(q), np.empty((3, q.shape[1]))
    for i in range(q.shape[1]):
        found[0, i], found[1, i], found[2, i] = signal(named, i, t)
    return found


def pack_signal(what: str, spec: Mapping[str, Any]) -> np.ndarray:
    """A signal as a column of `FIELDS`.

    Parameters
    ----------
    what : str
        What errors call it: "reference", "disturbance" or "posture".
    spec : mapping
        "kind", one of `KINDS`, and numbers in SI: "offset", "amplitude", "frequency" (Hz), "start" (s), "phase" (rad),
        "hold" (s), "ramp" (s), "micro". What is left out is 0, where the kind does not need it.

    Returns
    -------
    ndarray, shape (FIELDS.count,)
        The column. Its last row, the key of what is random, is 0.

    Raises
    ------
    ConfigurationError
        For unknown kinds or keys, missing keys, and numbers that are not finite or, for a frequency, hold or ramp that
        the kind needs, not above 0.

    Examples
    --------
    >>> column = pack_signal("reference", {"kind": "sine", "amplitude": 0.01, "frequency": 0.2})
    >>> dict(zip(FIELDS.names, column.tolist()))["frequency"]
    0.2
    """
    if not isinstance(spec, Mapping):
        raise ConfigurationError(f"{what}: expected a mapping with 'kind', got {spec!r}")
    kind = spec.get("kind")
    if kind not in KINDS:
        raise ConfigurationError(f"unknown {what} kind {kind!r}; {nearest(str(kind), KINDS)}")
    given = FIELDS.names[1:-1]
    require_known(f"key in {what}", spec, ("kind", *given))
    missing = [key for key in _NEEDS[kind] if key not in spec]
    if missing:
        raise ConfigurationError(f"{what} of kind '{kind}' needs {', '.join(missing)}")
    column = np.zeros(FIELDS.count)
    column[FIELDS.row("kind")] = KINDS.index(kind)
    positive = {*_NEEDS[kind]} | ({"frequency"} if spec.get("micro") else set())
    for field in given:
        value = spec.get(field, 0.0)
        if not is_number(value):
            raise ConfigurationError(f"{what}.{field}: expected a finite number, got {value!r}")
        if field in ("frequency", "hold", "ramp") and field in positive and value <= 0.0:
            raise ConfigurationError(f"{what}.{field} must be above 0 for kind '{kind}'")
        column[FIELDS.row(field)] = float(value)
    return column
