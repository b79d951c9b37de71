"""An error repeats with the position: of the motion (eccentric pulleys and screws) or of the force (cogging)."""

from collections.abc import Mapping

from cable_envs.core.kernels import inline, sine_cosine
from cable_envs.effects.base import Effect, EffectParameter

_TAU = 6.283185307179586


def _backwards(values: Mapping[str, float]) -> str:
    """Why a rig cannot have such a ripple, if it cannot."""
    amplitude, period = abs(values.get("amplitude", 0.0)), values.get("period", 1.0)
    if amplitude <= period / _TAU:
        return ""
    return (
        f"amplitude {amplitude:g} is above period / 2 pi = {period / _TAU:g}: the cable would move backwards while the "
        "drive moves forwards; choose a smaller amplitude or a longer period"
    )


EFFECT = Effect(
    name="position_ripple",
    seam="actuate",
    equation="x_cable = x + amplitude sin(2 pi x / period + phase); drive: F = force sin(2 pi x / period + phase)",
    source="the first harmonic of an eccentric pulley's or screw's transmission error, or of a motor's cogging",
    parameters=(
        EffectParameter(
            "amplitude", "m", 0.0, -1.0, 1.0, "amplitude of the transmission error", 2e-4, 0.01,
        ),
        EffectParameter(
            "force", "N", 0.0, -1e4, 1e4, "amplitude of the force", 1.0, signed=True,
            lane="amplitude",
        ),
        EffectParameter(
            "period", "m", 5e-3, 1e-5, 1e3, "travel of one period", 5e-3, 1.0, shape=True, null_turning=1.0
        ),
        EffectParameter("phase", "rad", 0.0, -7.0, 7.0, "phase at position 0", 0.0, 0.0, shape=True),
    ),
    validity="amplitudes up to period / 2 pi; a larger one is refused, as it would move the cable backwards",
    experiment="Move slowly over several periods, in both directions and at two speeds. The error is the same over "
    "position and not over time",
    confusable=("position_dependent_load",),
    wave=("period", "phase"),
    refuse=_backwards,
)  # fmt: skip


@inline
def wave(position, amplitude, period, phase):
    """(amplitude sin(2 pi position / period + phase), its slope)."""
    sine, cosine = sine_cosine(_TAU * position / period + phase)
    return amplitude * sine, amplitude * cosine * _TAU / period


@inline
def half_turn(angle, sine, cosine):
    """Transmission error of period half a turn, rad, without its straight part: that is in the ratio."""
    s, c = sine_cosine(2.0 * angle)
    return sine * (s - 2.0 * angle) + cosine * (c - 1.0)
