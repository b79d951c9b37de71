"""Which column is which channel of a system, and which systems a set of columns fits."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from cable_envs.diagnosis.data.description import told
from cable_envs.diagnosis.readers.guess.words import SPECIAL, speaks_for, words_of
from cable_envs.plants import families
from cable_envs.plants.family import Family

EFFORTS = ("force", "torque", "current", "voltage")
"""Channels of a drive's motor, whose names do not say so: what is measured at the other end is none of them."""
_DRIVE, _OUTPUT = ("drive", "motor"), ("load", "output")
"""Parts of channels' names that say at which end they are."""
_OTHER_END = -0.6
_BESIDE = 0.01
"""Of the score: columns that come first are taken first, and the drive's channels before the output's."""
_SPOKEN = 1.5
"""Of the score, for a word that speaks for a system."""


SHOWN_AS = {
    ("linear_drive", "force"): {"N m": 0.5, "A": 0.4}, ("linear_drive", "motor_position"): {"rad": 0.5},
    ("cable_hole", "drive_position"): {"rad": 0.4}, ("tendon_sheath", "drive_position"): {"rad": 0.4},
    ("tendon_sheath", "load_position"): {"rad": 0.5},
}  # fmt: skip
"""Channels that a motor shows as its torque, current or angle, or what bends as its angle -> the SI unit of these, and
their share of the score."""


@dataclass(frozen=True)
class Signal:
    """What may be a channel: SI unit, "command", "reference" or "" of a measurement, its end, words of its name."""

    si: str
    told: str = ""
    side: str = ""
    words: tuple[str, ...] = ()

    @classmethod
    def of_channel(cls, name: str, si: str) -> "Signal":
        """A channel of a system as a signal of others."""
        words = tuple(words_of(name))
        kind = "reference" if name.endswith("_reference") else "command" if told(name) else ""
        return cls(si, kind, _side(name), words)


@dataclass(frozen=True)
class Match:
    """A system held against signals: channel -> number of the signal, groups of channels that are missing, score."""

    system: str
    channels: Mapping[str, int]
    missing: tuple[tuple[str, ...], ...]
    score: float

    @property
    def needs(self) -> str:
        """What is missing, in words."""
        return ", and ".join(" or ".join(group) for group in self.missing)

    @property
    def fits(self) -> bool:
        """Whether nothing is missing."""
        return not self.missing


def _side(name: str) -> str:
    parts = name.split("_")
    return "drive" if parts[0] in _DRIVE else "output" if parts[0] in _OUTPUT else ""


def matches(signals: Sequence[Signal], spoken: frozenset[str] = frozenset()) -> list[Match]:
    """Every system whose recordings can be diagnosed, the best first: those that fit, by what they take.

    spoken: systems for which something besides the signals speaks, as the names of their files.
    """
    found = [match(one, signals, spoken) for one in families().values() if one.channels and one.least]
    return sorted(found, key=lambda m: (len(m.missing), -m.score))


def match(family: Family, signals: Sequence[Signal], spoken: frozenset[str] = frozenset()) -> Match:
    """The channels of one system that signals are, each signal once."""
    names = [name for name in family.channels if name != "time"]
    scores = np.array([
        [_of(family, name, signal) - _BESIDE * (i + j) / 10.0 for j, signal in enumerate(signals)]
        for i, name in enumerate(names)
    ]).reshape(len(names), len(signals))  # fmt: skip
    rows, columns = linear_sum_assignment(np.maximum(scores, 0.0), maximize=True)
    taken = {names[i]: int(j) for i, j in zip(rows, columns, strict=True) if scores[i, j] > 0.0}
    total = float(sum(scores[i, j] for i, j in zip(rows, columns, strict=True) if scores[i, j] > 0.0))
    missing = tuple(group for group in family.least if not set(group) & set(taken))
    said = spoken | speaks_for(word for signal in signals for word in signal.words)
    return Match(family.name, taken, missing, total + (_SPOKEN if family.name in said else 0.0))


def _of(family: Family, name: str, signal: Signal) -> float:
    """As `_score`, of a channel that a log may show in another unit."""
    shown = SHOWN_AS.get((family.name, name), {})
    others = (share * _score(name, si, signal) for si, share in shown.items())
    return max(_score(name, family.channels[name], signal), *others, -1.0)


def _score(name: str, si: str, signal: Signal) -> float:
    """How well a signal is a channel; not above 0: it is not."""
    if si != signal.si or told(name) != bool(signal.told):
        return -1.0
    special = next((words for part, words in SPECIAL.items() if part in name.split("_")), None)
    if special is not None and not special & set(signal.words):
        return -1.0
    score = 1.0 + (0.3 if special is not None else 0.0)
    if signal.told:
        score += 0.3 if name.endswith(f"_{signal.told}") else 0.0
    side = _side(name) or ("drive" if name in EFFORTS else "")
    if side and signal.side:
        return score + (1.0 if side == signal.side else _OTHER_END)
    return score + (0.1 if side else 0.2)
