"""Logs as rigs make them: clocks, lost and doubled rows, exports, encoders, filtered speeds, hum, colour, zeros.

A `Logger` is drawn for each recording from one of `KINDS`. It decides at what instants channels are sampled, what the
stamps say of them, what noise each channel has, and what the export does to the rows. Commands are logged without
noise, but share the rows' fate.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

STATED = ("white", "jitter", "clock", "rows", "resampled", "moving")
"""Kinds in which a recording states the noise of its channels: it is white there."""


@dataclass(frozen=True)
class Noise:
    """Noise of one channel, as parts of its standard deviation.

    Attributes
    ----------
    std : float
        Of all stationary parts together, SI.
    slow : float
        Share of the variance that has a memory.
    memory : float
        Of it, s.
    lines : tuple of tuple of float
        Frequency, Hz, share of the std as amplitude, phase, of hum.
    grows : float
        Further std over the largest size of the signal, per std.
    walk : float
        Std of a zero that walks, after 30 s, over std.
    tail : float
        Degrees of freedom of Student's t; 0: normal.
    count : float
        Resolution, SI; 0: fine.
    """

    std: float
    slow: float = 0.0
    memory: float = 0.1
    lines: tuple[tuple[float, float, float], ...] = ()
    grows: float = 0.0
    walk: float = 0.0
    tail: float = 0.0
    count: float = 0.0

    def draw(self, rng: np.random.Generator, at: np.ndarray, clean: np.ndarray) -> np.ndarray:
        """What a sensor shows of ``clean`` [T] at times ``at`` [T], s."""
        n, gaps = len(at), np.diff(at, prepend=at[0])
        white = (
            rng.standard_t(self.tail, n) * np.sqrt((self.tail - 2.0) / self.tail) if self.tail else rng.normal(size=n)
        )
        noise = np.sqrt(1.0 - self.slow) * white
        if self.slow > 0.0:
            part, state = np.empty(n), rng.normal()
            keep, kicks = np.exp(-gaps / self.memory), rng.normal(size=n)
            for k in range(n):
                state = keep[k] * state + np.sqrt(1.0 - keep[k] ** 2) * kicks[k]
                part[k] = state
            noise += np.sqrt(self.slow) * part
        for frequency, amplitude, phase in self.lines:
            noise += amplitude * np.sin(2.0 * np.pi * frequency * at + phase)
        if self.grows > 0.0:
            noise += self.grows * rng.normal(size=n) * np.abs(clean) / max(np.abs(clean).max(), 1e-12)
        if self.walk > 0.0:
            noise += self.walk * np.cumsum(rng.normal(size=n) * np.sqrt(np.maximum(gaps, 0.0) / 30.0))
        seen = clean + self.std * noise
        return np.round(seen / self.count) * self.count if self.count > 0.0 else seen


@dataclass(frozen=True)
class Logger:
    """What a rig's logger does.

    Attributes
    ----------
    kind : str
        One of `KINDS`.
    period : float
        Between rows, s.
    sampling, stamping : float
        By what share of the period instants, and what the stamps say of them, are off at most.
    rate : float
        Relative error of the logger's clock.
    drift : float
        How far the clock has wandered off by the middle of a minute, s.
    lost, doubled : float
        Shares of the rows.
    export : float
        Period of a table that is interpolated from the rows, over theirs; 0: the rows themselves.
    corner : float
        Of the low-pass behind a differentiated position, Hz; 0: speeds have sensors of their own.
    moving : float
        Seconds of a record's beginning that are cut off; 0: it starts at rest.
    noise : mapping of str to Noise
        Of each measured channel.
    """

    kind: str
    period: float
    sampling: float = 0.0
    stamping: float = 0.0
    rate: float = 0.0
    drift: float = 0.0
    lost: float = 0.0
    doubled: float = 0.0
    export: float = 0.0
    corner: float = 0.0
    moving: float = 0.0
    noise: Mapping[str, Noise] = field(default_factory=dict)

    def instants(self, rng: np.random.Generator, seconds: float) -> np.ndarray:
        """True times of the rows of a record of so many seconds."""
        regular = np.arange(self.moving, seconds, self.period)
        return np.sort(regular + self.period * self.sampling * rng.uniform(-1.0, 1.0, len(regular)))

    def stamps(self, rng: np.random.Generator, at: np.ndarray) -> np.ndarray:
        """What the log says of times ``at``; it rises."""
        middle = 0.5 * (at[0] + at[-1])
        told = at * (1.0 + self.rate) + self.drift * (((at - middle) / 30.0) ** 2 - 1.0)
        told = told + self.period * self.stamping * rng.uniform(-1.0, 1.0, len(at))
        return np.maximum.accumulate(told + 1e-9 * np.arange(len(at)))

    def rows(self, rng: np.random.Generator, count: int) -> np.ndarray:
        """Which of so many rows stand in the table, in turn; a lost one is missing, a doubled one comes twice."""
        kept = rng.random(count) >= self.lost
        kept[[0, -1]] = True
        if self.lost > 0.0:  # and one longer loss, below what a log is refused for
            first = int(rng.integers(count // 4, 3 * count // 4))
            kept[first : first + 4] = False
        times = kept.astype(int) + (kept & (rng.random(count) < self.doubled))
        return np.repeat(np.arange(count), times)


def random_logger(kind: str, rng: np.random.Generator, noise: Mapping[str, float]) -> Logger:
    """A logger of a kind.

    Parameters
    ----------
    kind : str
        One of `KINDS`.
    rng : numpy.random.Generator
        Draws its numbers.
    noise : mapping of str to float
        Standard deviations of the measured channels, SI.

    Returns
    -------
    Logger
        The same for all records of a recording.

    Raises
    ------
    KeyError
        For a kind that there is not.
    """
    if kind not in _MADE:
        raise KeyError(f"no kind of log '{kind}'")
    period = float(np.exp(rng.uniform(*np.log([0.004, 0.016]))))
    return _MADE[kind](rng, Logger(kind, period, noise={name: Noise(std) for name, std in noise.items()}))


def _each(made: Logger, change: Callable[[str, Noise], Noise]) -> Logger:
    """The logger with every channel's noise changed."""
    return replace(made, noise={name: change(name, noise) for name, noise in made.noise.items()})


def _jitter(rng: np.random.Generator, made: Logger) -> Logger:
    off = float(np.exp(rng.uniform(*np.log([0.002, 0.02]))))
    return replace(made, sampling=off, stamping=off * rng.uniform(0.0, 1.0))


def _clock(rng: np.random.Generator, made: Logger) -> Logger:
    return replace(made, rate=float(rng.uniform(-3e-4, 3e-4)), drift=float(rng.uniform(-2e-3, 2e-3)))


def _rows(rng: np.random.Generator, made: Logger) -> Logger:
    return replace(made, lost=float(rng.uniform(0.002, 0.01)), doubled=float(rng.uniform(0.0, 0.005)))


def _of_a_user(rng: np.random.Generator, made: Logger) -> Logger:
    """Everything at once, each less than where it is alone."""
    noise = {n: replace(_coloured(rng, x, 0.4), count=_count(rng, n, x.std)) for n, x in made.noise.items()}
    off = float(np.exp(rng.uniform(*np.log([0.002, 0.02]))))
    return replace(
        made, noise=noise, sampling=off, stamping=off, rate=float(rng.uniform(-1e-4, 1e-4)),
        lost=float(rng.uniform(0.0, 0.004)), corner=float(rng.choice([0.0, rng.uniform(20.0, 60.0)])),
        moving=float(rng.choice([0.0, 0.0, rng.uniform(3.0, 6.0)])),
    )  # fmt: skip


def _coloured(rng: np.random.Generator, noise: Noise, hums: float) -> Noise:
    lines = ((float(rng.uniform(2.0, 24.0)), float(rng.uniform(0.1, 0.35)), float(rng.uniform(0.0, 6.28))),)
    return replace(
        noise, slow=float(rng.uniform(0.2, 0.7)), memory=float(np.exp(rng.uniform(*np.log([0.03, 0.6])))),
        lines=lines if rng.random() < hums else (),
    )  # fmt: skip


def _mains(rng: np.random.Generator) -> tuple[tuple[float, float, float], ...]:
    base = float(rng.choice([50.0, 60.0]) * (1.0 + rng.uniform(-1e-3, 1e-3)))  # aliased by the sampling
    return tuple((k * base, float(rng.uniform(0.1, 0.6) / k), float(rng.uniform(0.0, 6.28))) for k in (1, 2, 3))


def _count(rng: np.random.Generator, name: str, std: float) -> float:
    """Encoders count more coarsely than their noise, amplifiers resolve it."""
    encoder = name.endswith(("position", "angle"))
    return float(std * (rng.uniform(2.0, 6.0) if encoder else rng.uniform(0.5, 1.5)))


_MADE: Mapping[str, Callable[[np.random.Generator, Logger], Logger]] = {
    "white": lambda rng, made: made,
    "rest": lambda rng, made: _each(made, lambda name, noise: _coloured(rng, noise, 0.4)),
    "user": _of_a_user,
    "jitter": _jitter,
    "clock": _clock,
    "rows": _rows,
    "resampled": lambda rng, made: replace(made, export=float(rng.choice([0.5, 0.8, 1.25, 2.0]))),
    "counts": lambda rng, made: _each(made, lambda name, noise: replace(noise, count=_count(rng, name, noise.std))),
    "filtered": lambda rng, made: replace(made, corner=float(rng.uniform(15.0, 50.0))),
    "hum": lambda rng, made: _each(made, lambda name, noise: replace(noise, lines=_mains(rng))),
    "coloured": lambda rng, made: _each(made, lambda name, noise: _coloured(rng, noise, 0.0)),
    "gain": lambda rng, made: _each(made, lambda name, noise: replace(noise, grows=float(rng.uniform(0.5, 2.0)))),
    "moving": lambda rng, made: replace(made, moving=float(rng.uniform(3.0, 6.0))),
    "wandering": lambda rng, made: _each(made, lambda name, noise: replace(noise, walk=float(rng.uniform(0.3, 1.0)))),
    "heavy": lambda rng, made: _each(made, lambda name, noise: replace(noise, tail=float(rng.uniform(3.0, 6.0)))),
}
KINDS = tuple(_MADE)
"""white: a perfect log, whose noise is stated. rest: colour and hum, with two minutes at rest. user: all that logs of
users have at once. The others have one fault each, over white noise: clocks that jitter or go wrong, rows lost and
doubled, an export at another rate, encoder counts, speeds that are filtered differences, mains and harmonics, colour
without a record at rest, noise that grows with the signal, records that start in motion, zeros that walk, outliers."""


def differentiated(at: np.ndarray, position: np.ndarray, corner: float) -> np.ndarray:
    """Speed as a controller makes it of counts: a backward difference and a low-pass of first order."""
    raw = np.diff(position, prepend=position[0]) / np.maximum(np.diff(at, prepend=at[0] - (at[1] - at[0])), 1e-9)
    keep = 1.0 - np.exp(-2.0 * np.pi * corner * np.median(np.diff(at)))
    out, state = np.empty(len(raw)), 0.0
    for k, value in enumerate(raw):
        state += keep * (value - state)
        out[k] = state
    return out


def table_of(
    logger: Logger, rng: np.random.Generator, at: np.ndarray, clean: Mapping[str, np.ndarray], given: Sequence[str],
    differences: Mapping[str, str], offset: float,
) -> tuple[dict[str, np.ndarray], np.ndarray]:  # fmt: skip
    """Columns of one file, SI, and which rows of ``clean`` they show.

    Parameters
    ----------
    logger : Logger
        Of the recording.
    rng : numpy.random.Generator
        Draws the noise.
    at : ndarray, shape (T,)
        True instants, s.
    clean : mapping of str to ndarray of shape (T,)
        Signals at these instants.
    given : sequence of str
        Channels that are commands.
    differences : mapping of str to str
        Speed -> position of which it is the difference, where the logger differentiates.
    offset : float
        What the clock says at the record's start, s.

    Returns
    -------
    columns : dict of str to ndarray
        With "time" first.
    rows : ndarray of int
        Instants that the columns are of; where a table was exported at another rate, the nearest before.
    """
    seen = {
        name: values if name in given else logger.noise[name].draw(rng, at, values) for name, values in clean.items()
    }
    stamps = logger.stamps(rng, at) + offset
    if logger.corner > 0.0:
        for speed, position in differences.items():
            if speed in seen and position in seen:
                seen[speed] = differentiated(at, seen[position], logger.corner)
    rows = logger.rows(rng, len(at))
    columns = {"time": stamps[rows], **{name: values[rows] for name, values in seen.items()}}
    if logger.export:
        even = np.arange(stamps[0], stamps[-1], logger.export * logger.period)
        columns = {"time": even, **{n: np.interp(even, stamps, v) for n, v in seen.items()}}
        rows = np.searchsorted(stamps, even, side="right") - 1
    columns["time"] = np.round(columns["time"], 6)
    return columns, rows
