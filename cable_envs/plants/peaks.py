"""The largest tension of a control step: it begins with that of the step's start.

Without that a tension that falls all along would have its peak behind the first integration step, whatever its length.
"""

from cable_envs.core.kernels import inline


@inline
def peak_at_start(tension):
    """The peak with which a control step begins, N: the tension there."""
    return tension


@inline
def no_peak(tension):
    """In the place of `peak_at_start` for the ids ``-v0``, which leave the start of a control step out."""
    return 0.0
