"""What a recording of a closed cable circuit shows before any simulation: how far from rigid, and where.

Jaw of a cable-driven tool: both angles grow together (opening), a load pulls the jaw open. Numbers are in SI but where
a name says deg or mnm. Nothing here is fitted by more than straight lines and one length:

rigid        output = ratio drive + zero, least squares over all records of a group; jaw torque = drive torque / ratio
slopes       drive torque over jaw torque across loads, at the middle of the travel, each direction by itself. Friction
             that grows with tension multiplies by n one way and divides by n the other: ln n is half the log of the
             slopes' quotient; the gap is the difference between the lines where the jaw's torque is zero
reversals    samples within `NEAR` rad of the drive's travel after a reversal; the two lines by direction of motion,
             and by a state that follows it over a length (pre-sliding): ds / dx = (sign - s) / length
stiffness    shift of the jaw's angle from one load to the next, over that of its torque
repeats      spread from stroke to stroke of one record, at the same drive angle and direction
"""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from cable_envs.core.errors import ConfigurationError
from cable_envs.diagnosis.data.recording import Record, Recording

NEEDS = ("drive_angle", "drive_torque", "output_angle", "output_torque")
FILTER_HZ, SLOW, MIDDLE, NEAR, TURN = 50.0, 0.25, 0.1, 0.1, 0.003
"""Hz of the zero-phase Butterworth filter; rad/s below which no motion counts as steady (both as in RA-L 2018); rad to
either side of the middle of the travel; rad of travel after a reversal; rad of way back that make a reversal."""
LEAST = 50
"""Samples of a record: fewer tell nothing, and cannot be filtered."""
LENGTHS = np.geomspace(0.003, 0.2, 25)
_DEG, _MNM = 180 / np.pi, 1e3


def first_look(recording: Recording, group: str = "series", load: str = "load_percent") -> dict[str, Any]:
    """Findings of a circuit's recording that need no simulator, by group of records.

    Parameters
    ----------
    recording : Recording
        Of a pulley circuit, with drive and output.
    group : str
        Condition that records of one group share.
    load : str
        Condition that says the load.

    Returns
    -------
    dict
        Findings by group.

    Raises
    ------
    ConfigurationError
        For other recordings.
    """
    if recording.system != "pulley_circuit":
        raise ConfigurationError(f"{recording.path}: this looks at pulley_circuit recordings, not {recording.system}")
    recording.require(*NEEDS, purpose="a first look")
    moving = [record for record in recording.records if record.use != "rest"]
    _require_condition(recording, moving, group, "series")
    _require_condition(recording, moving, load, "load_percent")
    groups: dict[str, list[Record]] = {}
    for record in moving:
        groups.setdefault(str(record.conditions.get(group, "all")), []).append(record)
    return {name: _look([_prepared(r, load) for r in members]) for name, members in groups.items()}


def _require_condition(recording: Recording, records: Sequence[Record], name: str, usual: str) -> None:
    """ConfigurationError for a condition, other than the usual one, that no record has."""
    known = sorted({condition for record in records for condition in record.conditions})
    if name != usual and name not in known:
        listed = f"they have {', '.join(known)}" if known else "they have none"
        raise ConfigurationError(f"{recording.path}: no record has the condition '{name}'; {listed}")


def _prepared(record: Record, load: str) -> dict[str, Any]:
    """Filtered signals of one record, the first and last second left out."""
    from scipy.signal import butter, filtfilt

    time = record.time
    rate = 1.0 / float(np.median(np.diff(time)))
    good = np.logical_and.reduce([record.usable(c) for c in NEEDS])
    moving = NEEDS[:3]  # a load may be a weight: the torque at the output may stay
    still = [c for c in moving if not good.any() or np.ptp(record.data[c][good]) == 0.0]
    if np.count_nonzero(good) < LEAST or time[-1] - time[0] <= 3.0:
        raise ConfigurationError(
            f"{record.name}: {np.count_nonzero(good)} samples over {time[-1] - time[0]:.3g} s; a first look needs "
            f"{LEAST} and more than 3 s"
        )
    if still:
        raise ConfigurationError(f"{record.name}: {', '.join(still)} never changes: there is nothing to see")
    b, a = butter(2, min(FILTER_HZ / (rate / 2), 0.99))
    signals = {c: filtfilt(b, a, np.interp(time, time[good], record.data[c][good])) for c in NEEDS}
    x, speed = signals["drive_angle"], np.gradient(signals["drive_angle"], time)
    inner = good & (time > time[0] + 1.0) & (time < time[-1] - 1.0)
    frequency = record.conditions.get("frequency")
    since, way = since_reversal(x)
    return {
        "load": record.conditions.get(load), "frequency": frequency, "time": time, "x": x, "speed": speed,
        "inner": inner, "since": since, "way": way, "torque": signals["drive_torque"],
        "jaw": signals["output_angle"], "jaw_torque": signals["output_torque"],
    }  # fmt: skip


def since_reversal(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Travel, rad [samples], since the motion last turned, and its direction, 1 or -1.

    Turns of less than `TURN` are noise at a standstill, where the sign of the speed means nothing.
    """
    since, ways = np.empty(len(x)), np.empty(len(x))
    turn = far = float(x[0])
    way = 1.0 if x[np.argmax(np.abs(x - x[0]) > TURN)] >= x[0] else -1.0
    for k, at in enumerate(x.tolist()):
        if way * (at - far) > 0:
            far = at
        elif abs(at - far) > TURN:
            turn, way, far = far, -way, at
        since[k], ways[k] = abs(at - turn), way
    return since, ways


def _look(records: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    found: dict[str, Any] = {"records": len(records), "rigid": _rigid(records)}
    by_frequency: dict[Any, list] = {}
    for r in records:
        key = None if r["frequency"] is None else round(float(r["frequency"]), 1)
        by_frequency.setdefault(key, []).append(r)
    found["slopes"] = [
        {"frequency": f, **lines} for f, members in by_frequency.items() if (lines := _slopes(members)) is not None
    ]
    found["reversals"] = _reversals(records)
    found["stiffness"] = {"closing": _stiffness(records, -1), "opening": _stiffness(records, 1)}
    found["repeats"] = _repeats(records)
    return found


def _together(records: Sequence[Mapping[str, Any]], *names: str) -> list[np.ndarray]:
    return [np.concatenate([r[name][r["inner"]] for r in records]) for name in names]


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else float("nan")


def _rigid(records: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    x, jaw, torque, jaw_torque, speed = _together(records, "x", "jaw", "torque", "jaw_torque", "speed")
    ratio, zero = np.polyfit(x, jaw, 1)
    angle, wrench = jaw - ratio * x - zero, jaw_torque - torque / ratio
    closing = speed <= -SLOW
    return {
        "ratio": float(ratio), "zero": float(zero), "angle_rms_deg": _DEG * _rms(angle),
        "torque_rms_mnm": _MNM * _rms(wrench), "closing_angle_rms_deg": _DEG * _rms(angle[closing]),
        "closing_torque_rms_mnm": _MNM * _rms(wrench[closing]),
        "each_record_angle_rms_deg": _DEG * _rms(np.concatenate([_own_line(r) for r in records])),
    }  # fmt: skip


def _own_line(record: Mapping[str, Any]) -> np.ndarray:
    """What a line of its own leaves of one record's angle."""
    (x, jaw) = _together([record], "x", "jaw")
    return jaw - np.polyval(np.polyfit(x, jaw, 1), x)


def _steady(record: Mapping[str, Any], way: int) -> np.ndarray:
    middle = (record["x"].max() + record["x"].min()) / 2
    steady = record["inner"] & (way * record["speed"] > min(SLOW, 0.5 * np.abs(record["speed"]).max()))
    return steady & (np.abs(record["x"] - middle) < MIDDLE)


def _slopes(records: Sequence[Mapping[str, Any]]) -> dict[str, Any] | None:
    """Lines across loads; None where there are fewer than two loads."""
    if len({r["load"] for r in records}) < 2:
        return None
    lines = {}
    for name, way in (("closing", -1), ("opening", 1)):
        chosen = [(r, mask) for r in records if (mask := _steady(r, way)).any()]
        points = [(r["jaw_torque"][m].mean(), r["torque"][m].mean()) for r, m in chosen]
        if len(points) < 2:
            return None
        drive, jaw = np.transpose(points)
        lines[name] = np.polyfit(drive, jaw, 1)
    closing, opening = lines["closing"], lines["opening"]
    quotient = closing[0] / opening[0]
    return {
        "closing": float(closing[0]), "opening": float(opening[0]),
        "ln_n": float(np.log(quotient) / 2) if quotient > 0 else None,
        "gap_mnm": _MNM * float(opening[1] - closing[1]), "middle_mnm": _MNM * float(opening[1] + closing[1]) / 2,
    }  # fmt: skip


def _reversals(records: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    """Errors of the drive's torque near reversals and elsewhere, by direction of motion and by a state."""
    torque, jaw_torque, ways, since = _together(records, "torque", "jaw_torque", "way", "since")
    near = since < NEAR

    def left(way: np.ndarray) -> np.ndarray:
        terms = np.column_stack([jaw_torque, np.ones_like(way), way * jaw_torque, way])
        return torque - terms @ np.linalg.lstsq(terms, torque, rcond=None)[0]

    by_sign = left(ways)
    best, length = by_sign, 0.0
    for candidate in LENGTHS:
        # on each stroke the state goes from the other direction's 1 to this one's: 1 - 2 exp(-travel / length)
        error = left(ways * (1 - 2 * np.exp(-since / candidate)))
        if _rms(error) < _rms(best):
            best, length = error, float(candidate)
    return {
        "share": float(near.mean()), "by_sign_mnm": _MNM * _rms(by_sign[near]),
        "by_sign_elsewhere_mnm": _MNM * _rms(by_sign[~near]), "by_state_mnm": _MNM * _rms(best[near]),
        "by_state_elsewhere_mnm": _MNM * _rms(best[~near]), "length_deg": _DEG * length,
    }  # fmt: skip


def _stiffness(records: Sequence[Mapping[str, Any]], way: int) -> list[dict[str, float]]:
    """N m/rad between neighbouring loads, in one direction, at the middle of the travel."""
    loads: dict[float, list[tuple[float, float]]] = {}
    for r in records:
        mask = _steady(r, way)
        if isinstance(r["load"], float) and mask.any():
            ratio = np.polyfit(r["x"][r["inner"]], r["jaw"][r["inner"]], 1)[0]
            middle = (r["x"].max() + r["x"].min()) / 2
            jaw = (r["jaw"][mask] - ratio * (r["x"][mask] - middle)).mean()
            loads.setdefault(r["load"], []).append((jaw, r["jaw_torque"][mask].mean()))
    means = {load: np.mean(values, axis=0) for load, values in sorted(loads.items())}
    return [
        {"from": a, "to": b, "n_m_per_rad": float(abs((means[b][1] - means[a][1]) / (means[b][0] - means[a][0])))}
        for a, b in pairwise(means)
        if means[b][0] != means[a][0]
    ]


def _repeats(records: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    """Median spread over records, drive angles and directions, of strokes that cover the middle half of the travel."""
    spreads: dict[str, list[float]] = {"jaw": [], "jaw_torque": [], "torque": []}
    for r in records:
        low, high = np.quantile(r["x"], (0.0, 1.0))
        grid = np.linspace(low + (high - low) / 4, high - (high - low) / 4, 21)
        strokes: dict[tuple[int, str], list[np.ndarray]] = {}
        turns = np.flatnonzero(np.diff(r["since"]) < -0.5 * (high - low))
        for a, b in pairwise(turns + 1):
            x, way = r["x"][a:b], 1 if r["x"][b - 1] > r["x"][a] else -1
            if not r["inner"][a:b].all() or x.min() > grid[0] or x.max() < grid[-1]:
                continue
            order = np.argsort(x, kind="stable")
            for name in spreads:
                strokes.setdefault((way, name), []).append(np.interp(grid, x[order], r[name][a:b][order]))
        for (_, name), curves in strokes.items():
            if len(curves) > 2:
                spreads[name].append(float(np.median(np.std(curves, axis=0, ddof=1))))
    return {
        key: scale * float(np.median(spreads[name])) if spreads[name] else float("nan")
        for key, name, scale in (
            ("jaw_deg", "jaw", _DEG), ("jaw_torque_mnm", "jaw_torque", _MNM), ("torque_mnm", "torque", _MNM),
        )
    }  # fmt: skip
