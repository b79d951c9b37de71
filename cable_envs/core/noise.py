"""Counter-based random numbers: a function of (key, counter, stream), so single runs and batches draw the same.

Keys and counters are whole numbers kept in floats (below 2**52), as everything else in a block of environments; all
steps are such that loops over environments vectorise.
"""

import math

from cable_envs.core.kernels import JIT_DISABLED, from_bits, inline, log, maximum, sine_cosine, sqrt, to_bits

_WHOLE = 0x4330000000000000  # the bits of 2**52: adding it moves a whole number into the low bits
_ONE = 0x3FF0000000000000
_A, _B, _C = 0x9E3779B97F4A7C15, 0xBF58476D1CE4E5B9, 0x94D049BB133111EB

if JIT_DISABLED:
    _MASK = 0xFFFFFFFFFFFFFFFF

    def _mix(key, counter, stream):
        z = (int(key) * _A + int(counter) * _B + int(stream) * _C) & _MASK
        z = ((z ^ (z >> 30)) * _B) & _MASK
        z = ((z ^ (z >> 27)) * _C) & _MASK
        return (z ^ (z >> 31)) >> 12

else:
    import numpy as np

    _UA, _UB, _UC = np.uint64(_A), np.uint64(_B), np.uint64(_C)
    _30, _27, _31, _12 = np.uint64(30), np.uint64(27), np.uint64(31), np.uint64(12)

    @inline
    def _mix(key, counter, stream):
        z = np.uint64(key) * _UA + np.uint64(counter) * _UB + np.uint64(stream) * _UC
        z = (z ^ (z >> _30)) * _UB
        z = (z ^ (z >> _27)) * _UC
        return np.int64((z ^ (z >> _31)) >> _12)


@inline
def uniform(key, counter, stream):
    """A number in [0, 1). key, counter: whole numbers in [0, 2**52); stream: an integer (SplitMix64, Steele 2014)."""
    key, counter = to_bits(key + 4503599627370496.0) - _WHOLE, to_bits(counter + 4503599627370496.0) - _WHOLE
    return from_bits(_mix(key, counter, stream) | _ONE) - 1.0


@inline
def normal(key, counter, stream):
    """A standard normal number (Box-Muller); uses the streams 2 stream and 2 stream + 1."""
    radius = sqrt(-2.0 * log(maximum(uniform(key, counter, 2 * stream), 1e-300)))
    return radius * sine_cosine(2.0 * math.pi * uniform(key, counter, 2 * stream + 1))[1]
