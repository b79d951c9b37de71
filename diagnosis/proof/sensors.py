"""What sensors make of signals: wrong in a way that can be named, noisy, quantised, each on a clock of its own."""

from collections.abc import Mapping

import numpy as np

NOISES = ("white", "ar1", "flicker")


def distort(time: np.ndarray, signals: Mapping[str, np.ndarray], faults: Mapping[str, float]) -> dict[str, np.ndarray]:
    """Signals [ticks] as faulty sensors give them; faults: "kind:channel" -> size (see `effects`)."""
    seen = dict(signals)
    for key, size in faults.items():
        kind, channel = key.split(":")
        value = seen[channel]
        if kind == "delay":
            value = np.interp(time - size, time, value)
        elif kind == "bias":
            value = value + size
        elif kind == "scale":
            value = value * (1.0 + size)
        elif kind == "rectification":
            value = value - size * np.minimum(value, 0.0)
        elif kind == "thermal_scale":  # the scale's support warms up
            value = value * (1.0 + size * (1.0 - np.exp(-(time - time[0]) / 15.0)))
        elif kind == "lost_counts":  # some are lost whenever the motion is fast
            speed = np.abs(np.gradient(value, time))
            fast = speed > 0.7 * np.quantile(speed, 0.98)
            value = value - size * np.cumsum(np.diff(fast.astype(int), prepend=0) == 1)
        else:
            raise KeyError(f"no sensor fault '{kind}'")
        seen[channel] = value
    return seen


def noise(kind: str, rng: np.random.Generator, samples: int, std: float) -> np.ndarray:
    """Noise of standard deviation ``std`` [samples]: white; half white, half AR(1); half white, half flicker (1/f)."""
    white = rng.standard_normal(samples)
    if kind == "white":
        return std * white
    if kind == "ar1":
        rho = rng.uniform(0.8, 0.97)
        drive = rng.standard_normal(samples + 300) * np.sqrt(1.0 - rho * rho)
        slow = np.empty(len(drive))
        slow[0] = 0.0
        for k in range(1, len(drive)):
            slow[k] = rho * slow[k - 1] + drive[k]
        slow = slow[300:]
    elif kind == "flicker":
        f = np.fft.rfftfreq(2 * samples)
        f[0] = np.inf
        spectrum = (rng.standard_normal(len(f)) + 1j * rng.standard_normal(len(f))) / np.sqrt(f)
        slow = np.fft.irfft(spectrum)[:samples]
        slow = (slow - slow.mean()) / slow.std()
    else:
        raise KeyError(f"no noise '{kind}'")
    return std * np.sqrt(0.5) * (white + slow)


def quantise(values: np.ndarray, step: float) -> np.ndarray:
    """Values on a grid."""
    return np.round(values / step) * step


def stamps(rng: np.random.Generator, first: float, seconds: float, period: float, jitter: float) -> np.ndarray:
    """Times at which samples are taken, s: every ``period``, each off by a share ``jitter`` of it at most."""
    regular = first + period * np.arange(round(seconds / period))
    return np.sort(regular + period * jitter * rng.uniform(-0.5, 0.5, len(regular)))
