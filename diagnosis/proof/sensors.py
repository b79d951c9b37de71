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


def standing_out(kind: str, noise_seen: np.ndarray, signal: np.ndarray) -> float:
    """Sum of squares of a signal [samples] over the spectrum of the noise it is in: what knowing its shape would gain.

    noise_seen: the noise itself, in the signal's unit; its size and an AR(1)'s memory are taken from it.
    """
    count = len(signal)
    power = np.abs(np.fft.rfft(signal)) ** 2 / count
    power[1 : (count + 1) // 2] *= 2.0
    f = np.maximum(np.arange(len(power)), 1.0) / count  # cycles per sample; a mean counts as the slowest wave
    colour = np.ones(len(power))
    if kind == "ar1":
        centred = noise_seen - noise_seen.mean()
        second, first = (float(centred[k:] @ centred[:-k]) for k in (2, 1))
        rho = min(max(second / max(first, 1e-300), 0.5), 0.98)
        colour = 0.5 + 0.5 * (1.0 - rho * rho) / np.abs(1.0 - rho * np.exp(-2j * np.pi * f)) ** 2
    elif kind == "flicker":
        colour = 0.5 + 0.5 / f / np.mean(1.0 / f[1:])
    return float(np.sum(power / colour) / np.var(noise_seen))


def quantise(values: np.ndarray, step: float) -> np.ndarray:
    """Values on a grid."""
    return np.round(values / step) * step


def stamps(rng: np.random.Generator, first: float, seconds: float, period: float, jitter: float) -> np.ndarray:
    """Times at which samples are taken, s: every ``period``, each off by a share ``jitter`` of it at most."""
    regular = first + period * np.arange(round(seconds / period))
    return np.sort(regular + period * jitter * rng.uniform(-0.5, 0.5, len(regular)))
