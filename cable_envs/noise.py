"""Counter-based random numbers: a function of (key, counter, stream), so single runs and batches draw the same."""

import math

from cable_envs.kernels import JIT_DISABLED, inline, log, maximum, sine_cosine, sqrt

_MASK = 0xFFFFFFFFFFFFFFFF

if JIT_DISABLED:

    def _mix(key, counter, stream):
        z = (key * 0x9E3779B97F4A7C15 + counter * 0xBF58476D1CE4E5B9 + stream * 0x94D049BB133111EB) & _MASK
        z = ((z ^ (z >> 30)) * 0xBF58476D1CE4E5B9) & _MASK
        z = ((z ^ (z >> 27)) * 0x94D049BB133111EB) & _MASK
        return (z ^ (z >> 31)) >> 11

else:
    import numpy as np

    _A, _B, _C = np.uint64(0x9E3779B97F4A7C15), np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)
    _30, _27, _31, _11 = np.uint64(30), np.uint64(27), np.uint64(31), np.uint64(11)

    @inline
    def _mix(key, counter, stream):
        z = np.uint64(key) * _A + np.uint64(counter) * _B + np.uint64(stream) * _C
        z = (z ^ (z >> _30)) * _B
        z = (z ^ (z >> _27)) * _C
        return (z ^ (z >> _31)) >> _11


@inline
def uniform(key, counter, stream):
    """A number in [0, 1). key, counter, stream: non-negative integers (SplitMix64 finaliser, Steele 2014)."""
    return float(_mix(key, counter, stream)) * 1.1102230246251565e-16


@inline
def normal(key, counter, stream):
    """A standard normal number (Box-Muller); uses the streams 2 stream and 2 stream + 1."""
    radius = sqrt(-2.0 * log(maximum(uniform(key, counter, 2 * stream), 1e-300)))
    return radius * sine_cosine(2.0 * math.pi * uniform(key, counter, 2 * stream + 1))[1]
