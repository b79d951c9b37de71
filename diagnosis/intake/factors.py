"""Factors and signs between channels that physics ties to each other, closer than a power of ten.

Physics that a simulator lacks changes such ratios by tens of percent. The unit that is nearest to the right one is the
kilogram for the newton, a factor of 9.81: half way to it, in logarithms, the wrong unit becomes the likelier of the
two. A rate is tied to its position by time alone, and the nearest factor of a clock is 2.

    rates      position' = speed, with a factor of 1 and the same sign
    asked      what obeys a command goes its way; so does a driven end
    tension    a cable only pulls, and over friction up and down its tensions are  W e^q  and  W e^-q: their geometric
               mean is the weight W, and the same at both ends of a cable
    band       what drives a drum carries the difference of its band's tensions
    forces     force = m a + c v + k sign(v) + constant, with the numbers that are stated
"""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from cable_envs.diagnosis.data.recording import Recording
from cable_envs.diagnosis.intake.tracks import ASKED, DRIVEN, LAG, RATES, Fault, Track
from cable_envs.diagnosis.systems.common import smooth_speed

GRAVITY = 9.81
"""N/kg."""
HALF = float(np.sqrt(GRAVITY))
_CLOCK = float(np.sqrt(2.0))
_TOGETHER = 0.7
"""Correlation from which two channels share half of their variance."""
ALIKE = 0.9
"""Correlation from which a force has the course that the stated numbers make of the motion: four fifths of it."""
_TURN = 0.05
"""Of the fastest speed, over which the sign of friction turns."""
OF_RATES = {
    1000.0: "'milli' or 'kilo'", 180.0 / np.pi: "degrees and radians", 30.0 / np.pi: "turns a minute and rad/s",
    25.4: "inches and millimetres", 2.0: "a right clock and one that is off by 2",
}  # fmt: skip
OF_FORCES = {
    1000.0: "'milli' or 'kilo'", GRAVITY: "kilograms and newtons", 4.448: "pounds and newtons",
    4.0: "accelerations by a clock that is off by 2",
}  # fmt: skip
_TENSIONS = ("drive_tension", "load_tension", "tension_top", "tension_bottom")


def hint(ratio: float, factors: Mapping[float, str]) -> str:
    """What a ratio that should be 1 may come from: the nearest factor of those that such channels may be off by."""
    near = min(factors, key=lambda factor: abs(abs(np.log(abs(ratio))) - np.log(factor)))
    return f"{factors[near]} differ by a factor of {near:.3g}"


def wrong_factors(recording: Recording, tracks: Sequence[Track]) -> Iterator[Fault]:
    """Channels whose factor or sign cannot be right beside another's."""
    yield from _rates(recording, tracks)
    yield from _ways(recording, tracks)
    yield from _tensions(recording, tracks)
    yield from _both_ends(recording, tracks)
    yield from _forces(recording, tracks)
    yield from _band(recording, tracks)


def _pooled(tracks: Sequence[Track], one: str, other: str, slopes: str = "") -> tuple[float, float]:
    """(slope, correlation) of one channel on another over all records; slopes: which of them is derived first."""
    pairs = []
    for track in tracks:
        both = [_rate(track, name) if slopes else track.channels[name] for name in (one, other)]
        pairs.append(np.array([values - np.mean(values) for values in both]))
    y, x = np.concatenate(pairs, axis=1)
    over = np.sqrt(float(x @ x) * float(y @ y))
    return (float(y @ x) / float(x @ x), float(y @ x) / over) if over > 0.0 else (0.0, 0.0)


def _rate(track: Track, name: str) -> np.ndarray:
    """A speed, or the slope of a position, over the same time."""
    values = track.channels[name]
    if name in RATES:
        return smooth_speed(values, track.period)
    width = max(round(0.15 / track.period), 1)
    return np.convolve(np.pad(values, width, mode="edge"), np.full(width, 1.0 / width), mode="same")[width:-width]


def _rates(recording: Recording, tracks: Sequence[Track]) -> Iterator[Fault]:
    for place, rate in RATES.items():
        if place not in recording.channels or rate not in recording.channels:
            continue
        slope, together = _pooled(tracks, rate, place, "both")
        if abs(together) < _TOGETHER:
            late = _late_rate(tracks, place, rate)
            what = f"is {late}" if late else "has nothing to do with it: is one in another's column?"
            yield Fault(tracks[0].name, place, 1, f"{rate}, which should be its slope over time, {what}")
        elif slope < 0.0:
            yield Fault(tracks[0].name, place, 1, f"{rate} grows where it should fall: turn the sign of one of them")
        elif not 1.0 / _CLOCK < slope < _CLOCK:
            text = f"{rate} is {slope:.3g} times its slope over time: {hint(slope, OF_RATES)}"
            yield Fault(tracks[0].name, place, 1, text)
        else:
            late = _late_rate(tracks, place, rate)
            if late:
                yield Fault(tracks[0].name, place, 1, f"{rate}, which should be its slope over time, is {late}")
            elif (other := _better(recording, tracks, place, rate)) is not None:
                text = f"{rate} is rather the slope of {other} over time: exchange the two"
                yield Fault(tracks[0].name, place, 1, text)


def _late_rate(tracks: Sequence[Track], place: str, rate: str) -> str:
    """By how much a speed is late against its position, in words; empty within `LAG`."""
    found = []
    for track in tracks:
        slope, seen = _rate(track, place), _rate(track, rate)
        most = round(4.0 * LAG / track.period)
        if len(slope) < 4 * most:
            return ""
        inner = slope[most:-most]
        shifts = np.arange(-most, most + 1)
        sums = [float(inner @ seen[most + k : len(seen) - most + k]) for k in shifts]
        found.append(float(shifts[int(np.argmax(sums))]) * track.period)
    late = float(np.median(found))
    if abs(late) <= LAG or min(f * late for f in found) <= 0.0:
        return ""
    return f"{1e3 * abs(late):.0f} ms {'late' if late > 0.0 else 'early'}: bring them to one clock"


def _better(recording: Recording, tracks: Sequence[Track], place: str, rate: str) -> str | None:
    """Another position whose slope a speed is rather than its own position's: it leaves a tenth of the squares.

    Where nothing stretches, the two leave the same.
    """
    other = DRIVEN.get(place)
    if other is None or other not in recording.channels:
        return None
    left = np.zeros(2)
    for track in tracks:
        way = np.cumsum(track.channels[rate]) * track.period
        table = np.column_stack([np.ones(len(way)), np.arange(len(way)) / len(way), way])
        for k, name in enumerate((place, other)):
            values = track.channels[name]
            left[k] += float(np.sum((values - table @ np.linalg.lstsq(table, values, rcond=None)[0]) ** 2))
    return other if left[1] < 0.1 * left[0] else None


def _ways(recording: Recording, tracks: Sequence[Track]) -> Iterator[Fault]:
    pairs = [(told, name) for told, names in ASKED.items() for name in names]
    for one, other in (*pairs, *DRIVEN.items()):
        if one in recording.channels and other in recording.channels:
            together = _pooled(tracks, one, other)[1]
            if together < -_TOGETHER:
                text = f"it goes the other way than {other}, which follows it: turn the sign of one of them"
                yield Fault(tracks[0].name, one, 1, text)


def _tensions(recording: Recording, tracks: Sequence[Track]) -> Iterator[Fault]:
    for channel in _TENSIONS:
        if channel not in recording.channels:
            continue
        pulls = np.concatenate([track.channels[channel] for track in tracks])
        if np.median(pulls) < 0.0:
            text = "it is below 0 for more than half of the time, and a cable only pulls: turn its sign"
            yield Fault(tracks[0].name, channel, 1, text)
        elif recording.system == "cable_hole" and (weight := _weight(recording, tracks)):
            ratio = _carried(tracks, channel) / weight
            if not 1.0 / HALF < ratio < HALF:
                carried = f"up and down it carries {ratio:.3g} times the load's weight of {weight:.3g} N"
                text = f"{carried}: {hint(ratio, OF_FORCES)}"
                yield Fault(tracks[0].name, channel, 1, text)


def _both_ends(recording: Recording, tracks: Sequence[Track]) -> Iterator[Fault]:
    if not {"drive_tension", "load_tension"} <= set(recording.channels):
        return
    ratio = _carried(tracks, "drive_tension") / _carried(tracks, "load_tension")
    if not 1.0 / HALF < ratio < HALF:
        text = f"pulled in and paid out it is {ratio:.3g} times load_tension: {hint(ratio, OF_FORCES)}"
        yield Fault(tracks[0].name, "drive_tension", 1, text)


def _weight(recording: Recording, tracks: Sequence[Track]) -> float:
    """Of the load, N; 0 where the recording does not state its mass, or a spring pulls more than it weighs."""
    mass = recording.value("load_mass")
    gravity, share = recording.value("gravity"), recording.value("load_gravity")
    weight = (mass or 0.0) * (GRAVITY if gravity is None else gravity) * (1.0 if share is None else share)
    places = [t.channels[n] for t in tracks for n in ("drive_position", "load_position") if n in t.channels]
    pull = (recording.value("load_stiffness") or 0.0) * max((float(np.max(np.abs(p))) for p in places), default=0.0)
    return weight if pull <= weight else 0.0


def _carried(tracks: Sequence[Track], channel: str) -> float:
    """Geometric mean of a tension's medians on the way up and on the way down, N."""
    ways: dict[float, list[np.ndarray]] = {1.0: [], -1.0: []}
    for track in tracks:
        place = next((n for n in ("drive_position", "load_position") if n in track.channels), None)
        speed = track.speed(place) if place else np.zeros(len(track.time))
        turn = 0.2 * float(np.quantile(np.abs(speed), 0.95))
        for way, parts in ways.items():
            parts.append(track.channels[channel][way * speed > turn])
    means = [float(np.median(np.abs(np.concatenate(p)))) for p in ways.values() if sum(map(len, p))]
    if not means:
        means = [float(np.median(np.abs(np.concatenate([t.channels[channel] for t in tracks]))))]
    return float(np.exp(np.mean(np.log(np.maximum(means, 1e-300)))))


def _forces(recording: Recording, tracks: Sequence[Track]) -> Iterator[Fault]:
    if not {"position", "force"} <= set(recording.channels) or recording.value("mass") is None:
        return
    mass, motor, coulomb, viscous = (recording.value(n) or 0.0 for n in ("mass", "motor_mass", "coulomb", "viscous"))
    needs = []
    for track in tracks:
        speed = track.speed("position")
        turn = _TURN * float(np.quantile(np.abs(speed), 0.95))
        friction = viscous * speed + coulomb * np.tanh(speed / max(turn, 1e-300))
        needs.append((mass + motor) * smooth_speed(speed, track.period) + friction)
    ratio = _in_course([track.channels["force"] for track in tracks], needs)
    if ratio is not None and not 1.0 / HALF < ratio < HALF:
        text = f"{ratio:.3g} times what the stated mass and friction make of the motion, in the same course"
        yield Fault(tracks[0].name, "force", 1, f"{text}: {hint(ratio, OF_FORCES)}")


def _band(recording: Recording, tracks: Sequence[Track]) -> Iterator[Fault]:
    if not {"force", "band_tension_1", "band_tension_2"} <= set(recording.channels):
        return
    pulls = [track.channels["band_tension_2"] - track.channels["band_tension_1"] for track in tracks]
    ratio = _in_course([track.channels["force"] for track in tracks], pulls)
    if ratio is not None and not 1.0 / HALF < ratio < HALF:
        text = f"{ratio:.3g} times the difference of the band's tensions, in the same course"
        yield Fault(tracks[0].name, "force", 1, f"{text}: {hint(ratio, OF_FORCES)}")


def _in_course(ones: Sequence[np.ndarray], others: Sequence[np.ndarray]) -> float | None:
    """Size of series over that of others, without the means of the records; None where they differ in their course."""
    one, other = (np.concatenate([values - np.mean(values) for values in series]) for series in (ones, others))
    over = float(np.sqrt((one @ one) * (other @ other)))
    if over == 0.0 or float(one @ other) / over < ALIKE:
        return None
    return float(np.sqrt((one @ one) / (other @ other)))
