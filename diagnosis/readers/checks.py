"""Checks of a record while it streams by: its clock, stuck encoders, saturating sensors, missing values.

Nothing is repaired but rows whose time is impossible, which are left out and told. What the checks take for a fault of
the sensor and what the mechanism may do by itself differ by these limits:

stuck      a position stays the same number for 0.1 s and 20 samples, while another position moves by a fifth of its
           range (a dead band at a reversal is a few per cent), or its own recorded speed makes such a way, or, where
           neither is recorded, a force or command moves by 0.6
saturated  a force, torque, current or reading stays at its highest or lowest number for 5 samples and five times as
           long as it stays at a number elsewhere, and goes there by more than its resolution: a smooth peak does not
gap        more than one and a half sampling intervals without a row
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from cable_envs.diagnosis.readers.base import Chunk, Log

POSITIONS = ("drive_position", "load_position", "drive_angle", "output_angle", "position", "motor_position")
FORCES = (
    "drive_tension", "load_tension", "drive_torque", "drive_current", "output_torque", "tension_top", "tension_bottom",
    "force", "band_tension_1", "band_tension_2", "speed_reading",
)  # fmt: skip
SPEEDS = {"position": "velocity", "drive_position": "drive_velocity"}
"""Position -> its speed, where that is recorded: what the position should have moved."""
PAIRS = (("drive_angle", "output_angle"), ("drive_position", "load_position"), ("motor_position", "position"))
"""Motions that one transmission ratio connects: (drive, output)."""

STUCK_SECONDS, STUCK_SAMPLES, STUCK_SHARE, STUCK_SHARE_FORCE = 0.1, 20, 0.2, 0.6
FLAT_SAMPLES, FLAT_TIMES = 5, 5.0
GAP_INTERVALS = 1.5


@dataclass(frozen=True)
class Summary:
    """What is known of a record when it has gone by.

    Times in s, ranges raw; of the pair of motions, in SI, the line output = ``ratio`` drive + ``offset`` and the
    output's ``travel``.
    """

    rows: int
    start: float
    end: float
    interval: float
    ranges: Mapping[str, tuple[float, float]]
    ratio: float | None
    offset: float | None
    travel: float


class Clock:
    """Times of a record: finite and increasing. ``filter`` says which rows of a chunk can stay."""

    def __init__(self, log: Log) -> None:
        self._log, self.last, self._rows = log, -np.inf, 0
        self.first, self.interval = float("nan"), float("nan")

    def filter(self, time: np.ndarray, lines: Sequence[int] | None) -> np.ndarray:
        """Rows [n] of bool with a finite time later than all before; ``time`` in s."""
        before = np.maximum.accumulate(np.concatenate(([self.last], np.where(np.isnan(time), -np.inf, time))))[:-1]
        good = time > before
        for k in np.flatnonzero(~good):
            if np.isnan(time[k]):
                text = "no time"
            elif time[k] == before[k]:
                text = f"time {time[k]:.9g} s again (printed with too few digits? declare sample_rate instead)"
            else:
                text = f"time goes back from {before[k]:.9g} s to {time[k]:.9g} s"
            self._log.add("clock", text, channel="time", place=_row(lines, int(k), self._rows), structural=True)
        kept, rows = time[good], np.flatnonzero(good)
        if len(kept):
            if np.isnan(self.first):
                self.first = float(kept[0])
            self._intervals(kept, rows, lines)
            self.last = float(kept[-1])
        self._rows += len(time)
        return good

    def _intervals(self, time: np.ndarray, rows: np.ndarray, lines: Sequence[int] | None) -> None:
        steps = np.diff(time, prepend=self.last if np.isfinite(self.last) else time[0])
        if np.isnan(self.interval):
            if len(time) < 2:
                return
            self.interval = float(np.median(np.diff(time)))
        for k in np.flatnonzero(steps > GAP_INTERVALS * self.interval):
            start = float(time[k] - steps[k])
            self._log.add(
                "gap", f"{steps[k]:.6g} s without a row after {start:.6g} s; rows are {self.interval:.6g} s apart",
                channel="time", place=_row(lines, int(rows[k]), self._rows), start=start, end=float(time[k]),
            )  # fmt: skip
        usual = (steps > 0) & (steps <= GAP_INTERVALS * self.interval)
        far = np.abs(steps[usual] - self.interval).max(initial=0.0) / self.interval
        if far > 0.05:
            self._log.say("clock not uniform: intervals differ from their median by more than 5 %")


def _row(lines: Sequence[int] | None, k: int, before: int) -> str:
    return f"line {lines[k]}" if lines is not None else f"row {before + k + 1}"


@dataclass(frozen=True)
class _Run:
    value: float
    first: int  # row, from 0
    length: int
    start: float  # s
    end: float


class _Runs:
    """Runs of one channel that stay at the same number, across chunks; only those of `STUCK_SAMPLES` are kept."""

    def __init__(self) -> None:
        self.count = 0
        self.going: _Run | None = None

    def feed(self, values: np.ndarray, time: np.ndarray, first: int) -> list[_Run]:
        """Long runs that ended in this chunk (rows ``first`` and on)."""
        edges = np.flatnonzero(np.concatenate(([True], values[1:] != values[:-1])))  # NaN differs from all
        self.count += len(edges)
        ends = np.append(edges[1:], len(values))
        runs = [
            _Run(float(values[a]), first + int(a), int(b - a), float(time[a]), float(time[b - 1]))
            for a, b in zip(edges, ends)
            if b - a >= STUCK_SAMPLES or a == 0 or b == len(values)
        ]
        if self.going is not None:
            if self.going.value == runs[0].value:
                self.count -= 1
                old = self.going
                runs[0] = _Run(old.value, old.first, old.length + runs[0].length, old.start, runs[0].end)
            else:
                runs.insert(0, self.going)
        self.going = runs.pop()
        return [run for run in runs if run.length >= STUCK_SAMPLES]

    def rest(self) -> list[_Run]:
        """The run that was going on when the record ended."""
        return [self.going] if self.going and self.going.length >= STUCK_SAMPLES else []


class RecordCheck:
    """Feed chunks (times in s, all else raw), then `finish`. Memory does not grow with the record.

    The positions' excursions during a run are taken from a copy of every channel thinned to 4096 samples or fewer.
    """

    THIN = 4096

    def __init__(self, log: Log, factors: Mapping[str, float]) -> None:
        self._log, self._factors = log, factors
        self._rows = 0
        self._runs = {c: _Runs() for c in factors if c in POSITIONS or c in FORCES}
        self._long: dict[str, list] = {c: [] for c in self._runs}
        self._extremes: dict[str, dict[int, tuple[float, list]]] = {
            c: {+1: (-np.inf, []), -1: (-np.inf, [])} for c in self._runs if c in FORCES
        }
        self._resolution = dict.fromkeys(self._extremes, np.inf)
        self._low = dict.fromkeys(factors, np.inf)
        self._high = dict.fromkeys(factors, -np.inf)
        self._missing: dict[str, int] = {}
        self._stride = 1
        self._thin: dict[str, list] = {c: [] for c in ("time", *factors)}
        self._sums = np.zeros(5)
        self._pair = next((p for p in PAIRS if set(p) <= set(factors)), None)
        self._previous: dict[str, float] = {}

    def feed(self, chunk: Chunk, time: np.ndarray) -> None:
        """A chunk that the clock let through."""
        for name, values in chunk.columns.items():
            if name == "time":
                continue
            finite = values[np.isfinite(values)]
            if len(finite) < len(values):
                self._empty(name, values, chunk.lines)
            if len(finite):
                self._low[name] = min(self._low[name], float(finite.min()))
                self._high[name] = max(self._high[name], float(finite.max()))
            if name in self._runs:
                self._long_runs(name, self._runs[name].feed(values, time, self._rows))
            if name in self._extremes:
                self._top(name, values, time)
        self._pair_up(chunk)
        self._thin_out(chunk, time)
        self._rows += len(time)

    def _empty(self, name: str, values: np.ndarray, lines: Sequence[int] | None) -> None:
        if name not in self._missing:
            k = int(np.argmax(~np.isfinite(values)))
            self._log.say(f"channel {name}: empty cells, the first in {_row(lines, k, self._rows)}")
        self._missing[name] = self._missing.get(name, 0) + int((~np.isfinite(values)).sum())

    def _long_runs(self, name: str, ended: list[_Run]) -> None:
        if name in POSITIONS:
            self._long[name] += [run for run in ended if run.end - run.start >= STUCK_SECONDS]
            self._long[name] = sorted(self._long[name], key=lambda run: -run.length)[:200]

    def _top(self, name: str, values: np.ndarray, time: np.ndarray) -> None:
        """Samples at the highest and lowest number so far, as (first, last row, start, end, jump into it)."""
        before = np.concatenate(([self._previous.get(name, values[0])], values[:-1]))
        steps = np.abs(values - before)
        self._resolution[name] = min(self._resolution[name], float(steps[steps > 0].min(initial=np.inf)))
        self._previous[name] = float(values[-1])
        for sign, (extreme, runs) in self._extremes[name].items():
            highest = float(np.nanmax(sign * values)) if np.isfinite(values).any() else -np.inf
            if highest > extreme:
                extreme, runs = highest, []
            at = np.flatnonzero(sign * values == extreme)
            for group in np.split(at, np.flatnonzero(np.diff(at) > 1) + 1) if len(at) else ():
                a, b = group[0], group[-1]
                if runs and runs[-1][1] == self._rows + a - 1:
                    runs[-1] = (runs[-1][0], self._rows + b, runs[-1][2], float(time[b]), runs[-1][4])
                elif len(runs) < 1000:
                    runs.append((self._rows + a, self._rows + b, float(time[a]), float(time[b]), float(steps[a])))
            self._extremes[name][sign] = (extreme, runs)

    def _pair_up(self, chunk: Chunk) -> None:
        if self._pair:
            x, y = (chunk.columns[c] * self._factors[c] for c in self._pair)
            good = np.isfinite(x) & np.isfinite(y)
            x, y = x[good], y[good]
            self._sums += (len(x), x.sum(), y.sum(), (x * x).sum(), (x * y).sum())

    def _thin_out(self, chunk: Chunk, time: np.ndarray) -> None:
        pick = np.arange(-self._rows % self._stride, len(time), self._stride)
        for name, kept in self._thin.items():
            kept.extend((time if name == "time" else chunk.columns[name])[pick].tolist())
        while len(self._thin["time"]) > self.THIN:
            self._thin = {name: kept[::2] for name, kept in self._thin.items()}
            self._stride *= 2

    def finish(self, clock: Clock) -> Summary:
        """Add what was found to the log; the record in numbers."""
        for name, runs in self._runs.items():
            self._long_runs(name, runs.rest())
        for name, count in self._missing.items():
            self._log.say(f"channel {name}: {count} of {self._rows} values empty")
        thin = {name: np.array(kept) for name, kept in self._thin.items()}
        for name in self._long:
            self._stuck(name, thin)
        for name in self._extremes:
            self._saturated(name)
        ratio, offset = self._regression()
        ranges = {name: (self._low[name], self._high[name]) for name in self._low}
        output = self._pair[1] if self._pair else None
        travel = abs(self._factors[output]) * (self._high[output] - self._low[output]) if output else float("nan")
        return Summary(self._rows, clock.first, clock.last, clock.interval, ranges, ratio, offset, travel)

    def _moved(self, name: str, thin: Mapping[str, np.ndarray]) -> Mapping[str, np.ndarray]:
        """``thin`` with the way that a recorded speed makes, in the position's raw unit, as a further motion."""
        speed = SPEEDS.get(name)
        if speed is None or speed not in thin:
            return thin
        values = np.nan_to_num(thin[speed]) * self._factors[speed] / self._factors[name]
        steps = 0.5 * (values[1:] + values[:-1]) * np.diff(thin["time"])
        return {**thin, speed: np.concatenate(([0.0], np.cumsum(steps)))}

    def _stuck(self, name: str, thin: Mapping[str, np.ndarray]) -> None:
        thin, speed = self._moved(name, thin), SPEEDS.get(name)
        others = [c for c in POSITIONS if c in thin and c != name]
        needed = STUCK_SHARE if others else STUCK_SHARE_FORCE
        others = others or [c for c in thin if c not in ("time", name) and not c.endswith("reference")]
        for run in sorted(self._long[name], key=lambda run: run.first):
            inside = (thin["time"] >= run.start) & (thin["time"] <= run.end)
            for other in others:
                part, span = thin[other][inside], self._high[other] - self._low[other]
                least = needed
                if other == speed:
                    span, least = self._high[name] - self._low[name], STUCK_SHARE
                part = part[np.isfinite(part)]
                if len(part) > 1 and span > 0 and np.ptp(part) >= least * span:
                    way = f"{other} makes a way of" if other == speed else f"{other} moves over"
                    self._log.add(
                        "stuck", f"stays at {run.value:.9g} for {run.length} rows, {run.start:.6g} to {run.end:.6g} s, "
                        f"while {way} {100 * np.ptp(part) / span:.0f} % of its range", channel=name,
                        place=f"rows {run.first + 1} to {run.first + run.length}", start=run.start, end=run.end,
                    )  # fmt: skip
                    break

    def _saturated(self, name: str) -> None:
        usual = self._rows / max(self._runs[name].count, 1)
        for extreme, runs in self._extremes[name].values():
            flat = [r for r in runs if r[1] - r[0] + 1 >= max(FLAT_SAMPLES, FLAT_TIMES * usual)]
            if not flat or max(r[4] for r in flat) < 1.5 * self._resolution[name]:
                continue
            value = extreme if extreme == self._high[name] else -extreme
            for first, last, start, end, _ in flat:
                span = f"{last - first + 1} rows, {start:.6g} to {end:.6g} s"
                self._log.add(
                    "saturated", f"flat at its limit {value:.9g} for {span}", channel=name,
                    place=f"rows {first + 1} to {last + 1}", start=start, end=end,
                )  # fmt: skip

    def _regression(self) -> tuple[float | None, float | None]:
        n, sx, sy, sxx, sxy = self._sums
        spread = n * sxx - sx * sx
        if not n or spread <= 1e-12 * n * sxx:
            return None, None
        ratio = (n * sxy - sx * sy) / spread
        return float(ratio), float((sy - ratio * sx) / n)
