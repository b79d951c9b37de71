"""The mapping file that is proposed: each line with its reason and how sure it is; what is open says CONFIRM."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cable_envs.core.errors import ConfigurationError
from cable_envs.diagnosis.data.description import channels_of
from cable_envs.diagnosis.readers.base import files_at
from cable_envs.diagnosis.readers.formats import table
from cable_envs.diagnosis.readers.guess.assign import SHOWN_AS, Match, Signal, matches
from cable_envs.diagnosis.readers.guess.columns import meant
from cable_envs.diagnosis.readers.guess.meant import OPEN, Meant
from cable_envs.diagnosis.readers.guess.raw import Raw, columns_in
from cable_envs.diagnosis.readers.guess.words import speaks_for, words_of
from cable_envs.diagnosis.readers.mapping import SCHEMA

FORMS = {"table": table.tables_at, "mat": lambda path: files_at(path, ".mat")}
"""Formats that are guessed at -> their files at a path."""
RATE = 100.0
"""Hz that a mapping begins with where no column is a clock."""
STILL = 0.02
"""Share of the largest travel below which a file is one in which nothing moves."""
_PLACES = ("m", "rad")
_ALONG = 0.98
"""Correlation from which on a position and a motor's angle are one motion."""


@dataclass(frozen=True)
class Proposal:
    """A mapping file, and what stands behind it.

    Parameters
    ----------
    text : str
        YAML of a mapping.
    system : str
        The one that is proposed.
    matches : tuple of Match
        All systems, the best first.
    columns : tuple of Meant
        What each column is taken for.
    open : tuple of str
        Channels, and "system", that the user must confirm.
    """

    text: str
    system: str
    matches: tuple[Match, ...]
    columns: tuple[Meant, ...]
    open: tuple[str, ...]


def propose(path: Path, form: str) -> Proposal:
    """A mapping for the file at ``path``, or the files in a folder, whose first one is looked at closely.

    Parameters
    ----------
    path : Path
        Logs of one rig, with the same columns.
    form : str
        One of `FORMS`.

    Returns
    -------
    Proposal
        `cablebench import FORM path --mapping FILE` reads its text.

    Raises
    ------
    ConfigurationError
        For files without numbers, and where no column is a channel of any system.
    """
    if form not in FORMS:
        raise ConfigurationError(f"--guess is for {' and '.join(FORMS)}, got {form}: messages name their fields")
    files = FORMS[form](path)
    raw = columns_in(files[0], form)
    found = meant(raw.columns)
    signals = [_signal(m) for m in found]
    names = [word for file in files for word in words_of(file.stem)] + words_of(path.stem)
    ranked = matches(signals, speaks_for(names))
    best = ranked[0]
    if not best.channels:
        listed = "; ".join(f"{_called(m)}: {_what(m)}" for m in found)
        raise ConfigurationError(f"{files[0].name}: no column is a channel of any system ({listed})")
    text, open_ = _text(raw, found, ranked, files)
    return Proposal(text, best.system, tuple(ranked), tuple(found), tuple(open_))


def _signal(m: Meant) -> Signal:
    return Signal(m.kind if m.unit is not None else "", m.told, m.side, m.words)


def _called(m: Meant) -> str:
    return m.column.name or f"column {m.column.place}"


def _what(m: Meant) -> str:
    return "; ".join(m.why) or "nothing tells what it is"


def _text(raw: Raw, found: Sequence[Meant], ranked: Sequence[Match], files: Sequence[Path]) -> tuple[str, list[str]]:
    best, open_ = ranked[0], []
    fit = [m.system for m in ranked[1:] if m.fits]
    said = f"also fits: {', '.join(fit)}" if fit else "no other system fits"
    if best.missing:
        said = f"NOT COMPLETE: it needs {best.needs}"
    if fit or best.missing:
        open_.append("system")
    lines = [
        f"# Proposed from {raw.file.name} by cablebench import --guess. Check each line that says {OPEN}, and the",
        "# positive directions (docs/your-own-recording.md): a table does not tell them.",
        f"schema: {SCHEMA}",
        _line(f"system: {best.system}", f"{f'{OPEN}: ' if 'system' in open_ else ''}{said}"),
    ]
    if raw.layout:
        layout = ", ".join(f"{key}: {json.dumps(value)}" for key, value in raw.layout.items())
        lines.append(_line(f"layout: {{{layout}}}", "as detected"))
    lines.append("channels:")
    clock = next((m for m in found if m.kind == "time"), None)
    if clock is None:
        open_.append("time")
    lines.append(_clock_line(clock, found, raw.rate))
    if clock is not None and clock.sure == OPEN:
        open_.append("time")
    for channel in (c for c in channels_of(best.system) if c in best.channels):
        m = found[best.channels[channel]]
        lines.append(_channel_line(channel, m, found, best))
        open_ += [channel] if m.sure == OPEN or _turned(channel, m, best) else []
    used = {id(found[k]) for k in best.channels.values()} | {id(clock)}
    rest = [m for m in found if id(m) not in used]
    lines += ["# not used:", *(f"#   {_called(m)}: {_what(m)}" for m in rest)] if rest else []
    lines += [f"# {text}" for text in raw.said]
    return "\n".join([*lines, *_records(files, raw, found, best)]) + "\n", open_


def _line(entry: str, comment: str) -> str:
    return f"{entry}   # {' '.join(comment.split())}"


def _clock_line(clock: Meant | None, found: Sequence[Meant], rate: float) -> str:
    if clock is not None:
        assert clock.unit is not None, "a clock has one"
        scale = f", scale: {clock.unit.scale:g}" if clock.unit.scale != 1.0 else ""
        entry = (
            f"  time: {{column: {json.dumps(clock.column.place, ensure_ascii=False)}, unit: {clock.unit.name}{scale}}}"
        )
        return _line(entry, f"{clock.sure}: {_what(clock)}")
    stamps = next((m.column.stamps for m in found if m.kind == "stamps"), None)
    if stamps is not None:
        good = stamps[np.isfinite(stamps)]
        step = float(good[-1] - good[0]) / max(len(good) - 1, 1)
        if step > 0.0:
            why = f"{OPEN}: times of day as text are not read; these rows are {step:.4g} s apart on average"
            return _line(f"  time: {{sample_rate: {1.0 / step:.6g}}}", why)
    if rate > 0.0:
        why = f"{OPEN}: no column is a clock; a line above the table says {rate:g} Hz"
        return _line(f"  time: {{sample_rate: {rate:g}}}", why)
    why = f"{OPEN}: no column is a clock; state the rate of the log, in Hz"
    return _line(f"  time: {{sample_rate: {RATE:g}}}", why)


def _channel_line(channel: str, m: Meant, found: Sequence[Meant], best: Match) -> str:
    assert m.unit is not None, "only columns with a unit are taken"
    if _turned(channel, m, best):
        return _turned_line(channel, m, found, best)
    parts = [f"column: {json.dumps(m.column.place, ensure_ascii=False)}", f"unit: {m.unit.name}"]
    if m.clock is not None:
        parts.insert(1, f"clock: {json.dumps(m.clock.place, ensure_ascii=False)}")
    parts += [f"scale: {m.unit.scale:.10g}"] if m.unit.scale != 1.0 else []
    parts += ["sign: -1"] if m.sign < 0 else []
    steps = np.diff(m.column.values[np.isfinite(m.column.values)])
    parts += ["hold: step"] if channel.endswith("_command") and np.mean(steps == 0.0) > 0.5 else []
    why = f"{m.sure}: {_what(m)}"
    against = _against(channel, m, found, best)
    return _line(f"  {channel}: {{{', '.join(parts)}}}", f"{why}; {against}" if against else why)


def _turned(channel: str, m: Meant, best: Match) -> bool:
    """Whether a column is a torque, current or angle that is a channel by what turns that into it."""
    return m.unit is not None and m.unit.si in SHOWN_AS.get((best.system, channel), {})


def _turned_line(channel: str, m: Meant, found: Sequence[Meant], best: Match) -> str:
    """A torque, current or angle as a force or place: a radius is what the position goes for a turn."""
    assert m.unit is not None, "only columns with a unit are taken"
    if m.unit.si == "A":
        by, what = 1.0, "a motor's current times the force of one ampere (torque constant and gear over the radius, or "
        what += "2 pi over the lead of a screw), which nothing tells: 1 N stands for it"
    elif channel == "load_position":
        by, why = _radius(found, best, "drive_position", m)
        what = f"the angle of what bends times the tendon's distance from its middle, its stretch included, {why}"
    else:
        radius, why = _radius(found, best, "position", m)
        by, what = (radius, "a motor's angle times") if m.unit.si == "rad" else (1.0 / radius, "a motor's torque over")
        what += f" the radius of its pulley, {why}"
    parts = [
        f"column: {json.dumps(m.column.place, ensure_ascii=False)}", f"unit: {channels_of(best.system)[channel]}",
        f"scale: {m.factor * by:.6g}", *(["sign: -1"] if m.sign < 0 else []),
    ]  # fmt: skip
    return _line(f"  {channel}: {{{', '.join(parts)}}}", f"{OPEN}: {what}; {_what(m)}")


def _radius(found: Sequence[Meant], best: Match, channel: str, m: Meant) -> tuple[float, str]:
    """(radius, m; how it is known), by the slope of a place over an angle, which is that of ``m`` where it is one."""
    place = found[best.channels[channel]] if channel in best.channels else None
    angles = (o for o in (m, *found) if o.unit is not None and o.unit.si == "rad" and not o.told)
    motor = next(angles, None)
    if place is None or motor is None:
        return 1.0, "which nothing tells: 1 m stands for it"
    x, y = motor.column.values * motor.factor, place.column.values * place.factor
    good = np.isfinite(x) & np.isfinite(y)
    if good.sum() < 3 or np.ptp(x[good]) == 0.0 or abs(np.corrcoef(x[good], y[good])[0, 1]) < _ALONG:
        return 1.0, "which nothing tells: 1 m stands for it"
    radius = abs(float(np.polyfit(x[good], y[good], 1)[0]))
    return radius, f"{1e3 * radius:.4g} mm by the slope of {_called(place)} over {_called(motor)}"


def _against(channel: str, m: Meant, found: Sequence[Meant], best: Match) -> str:
    """What a column says that falls while the drive's position rises."""
    drive = next((c for c in ("drive_position", "drive_angle") if c in best.channels), None)
    if drive is None or channel == drive or m.told or channels_of(best.system)[channel] not in _PLACES:
        return ""
    other = found[best.channels[drive]]
    x, y = other.column.values, m.column.values
    good = np.isfinite(x) & np.isfinite(y)
    if good.sum() < 3 or np.ptp(x[good]) == 0.0 or np.ptp(y[good]) == 0.0:
        return ""
    like = float(np.corrcoef(x[good], y[good])[0, 1])
    return f"{OPEN} the sign: it falls while {drive} rises" if like < -0.5 else ""


def _records(files: Sequence[Path], raw: Raw, found: Sequence[Meant], best: Match) -> list[str]:
    """Files with what they are for, where one of several is at rest; their rates, where these differ."""
    if len(files) < 2:
        return []
    places = [found[k].column.place for c, k in best.channels.items() if channels_of(best.system)[c] in _PLACES]
    form = "mat" if raw.file.suffix.lower() == ".mat" else "table"
    travel, lines = [], []
    for file in files:
        own = {c.place: c.values for c in (raw if file == raw.file else columns_in(file, form)).columns}
        spans = [float(np.nanmax(own[p]) - np.nanmin(own[p])) for p in places[:1] if p in own]
        travel.append(spans[0] if spans else np.inf)
    most = max((t for t in travel if np.isfinite(t)), default=0.0)
    still = [t < STILL * most for t in travel]
    if not any(still):
        return []
    for file, rests, way in zip(files, still, travel, strict=True):
        use = "rest" if rests and still.index(True) == files.index(file) else "fit"
        lines.append(_line(f"  - {{file: {json.dumps(file.name)}, use: {use}}}", f"travel {way:.3g} of {most:.3g}"))
    return ["records:", *lines]
