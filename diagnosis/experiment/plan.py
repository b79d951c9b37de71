"""A planned experiment: the reference to run, and what to expect of its record."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from cable_envs.core.files import json_text, jsonable, write_atomic
from cable_envs.diagnosis.data.description import Channel
from cable_envs.diagnosis.experiment.motions import Limits
from cable_envs.diagnosis.model.verdict import SURE

SCHEMA = "cable-experiment/1"
GONE = 8.0
"""Log odds by which a rival is so far behind that it is no longer thought true: three thousand to one."""
REFERENCE, DESCRIPTION = "reference.csv", "experiment.json"


@dataclass(frozen=True)
class Plan:
    """The motion to run next.

    Parameters
    ----------
    purpose : str
        "tell apart", or "narrow" where one model is left.
    rivals : tuple of str
        Models that are left open, the most probable first.
    behind : tuple of float
        Log odds of the first over each, by the records so far.
    expected : ndarray
        Log odds of a rival over another one by all records and one that was simulated with the first, noise and all
        [rivals, rivals].
    repeated : ndarray
        The same where the best of the motions that were run is run once more instead.
    narrowed : Mapping of str to tuple of float
        Free parameter of an effect of the first rival -> standard deviation, SI, so far and with the new record.
    family : str
        Kind of motion, or the name of a record whose motion is to be run once more.
    channel : Channel
        That is told the reference, or whose place it is.
    time, values : ndarray
        [rows], s and SI unit of the channel; straight lines between rows are near enough to the motion.
    limits : Limits
        That the motion keeps to.
    conditions : Mapping
        Of the record that it is like: load, tool.
    like : str
        That record.
    tried : int
        Motions that were simulated.
    settings : Mapping of str to tuple of (float, str)
        What of the rig is to be set for it: parameter -> value, SI, and its unit. The new record has to state these
        under its conditions.
    """

    purpose: str
    rivals: tuple[str, ...]
    behind: tuple[float, ...]
    expected: np.ndarray
    repeated: np.ndarray
    narrowed: Mapping[str, tuple[float, float]]
    family: str
    channel: Channel
    time: np.ndarray
    values: np.ndarray
    limits: Limits
    conditions: Mapping[str, Any] = field(default_factory=dict)
    like: str = ""
    tried: int = 0
    settings: Mapping[str, tuple[float, str]] = field(default_factory=dict)

    @property
    def least(self) -> float:
        """The smallest log odds to be expected for the true one of the rivals over another; infinite of one alone."""
        return least(self.expected, self.behind)

    @property
    def settles(self) -> bool:
        """Whether the true one is expected to have odds above `SURE` to one over each of the others."""
        return self.least > float(np.log(SURE))

    def in_unit(self) -> np.ndarray:
        """``values`` as the recording's column has them [rows]."""
        one = self.channel.to_si(np.array([0.0, 1.0]))
        return (self.values - one[0]) / (one[1] - one[0])

    def as_json(self) -> dict[str, Any]:
        """JSON types only, schema `SCHEMA`."""
        return {
            "schema": SCHEMA, "purpose": self.purpose, "rivals": list(self.rivals),
            "log_odds_behind": list(self.behind),
            "expected_log_odds": jsonable(self.expected), "expected_if_repeated": jsonable(self.repeated),
            "settles": self.settles, "narrowed": jsonable({n: list(pair) for n, pair in self.narrowed.items()}),
            "motion": self.family, "channel": self.channel.name, "column": self.channel.column,
            "unit": self.channel.unit, "seconds": float(self.time[-1]),
            "limits": jsonable(vars(self.limits)), "conditions": jsonable(self.conditions), "like": self.like,
            "settings": {n: {"value": value, "unit": unit} for n, (value, unit) in self.settings.items()},
            "motions_tried": self.tried, "reference": REFERENCE,
        }  # fmt: skip

    def write(self, out: Path) -> None:
        """reference.csv (time in s, the channel in its recording's unit) and experiment.json into a folder."""
        rows = [f"time,{self.channel.name}", f"s,{self.channel.unit}"]
        rows += [f"{t:.9g},{v:.9g}" for t, v in zip(self.time, self.in_unit(), strict=True)]
        write_atomic(out / REFERENCE, "\n".join(rows) + "\n")
        write_atomic(out / DESCRIPTION, json_text(self.as_json()))

    def lines(self) -> list[str]:
        """For people."""
        said = [
            f"Run {self.family} of {self.time[-1]:.3g} s: {REFERENCE} has {self.channel.name} in {self.channel.unit}."
        ]
        if self.conditions:
            said.append("Under " + ", ".join(f"{k} = {v}" for k, v in self.conditions.items()) + f", as {self.like}.")
        if self.settings:
            asked = ", ".join(f"{name} to {value:.6g} {unit}" for name, (value, unit) in self.settings.items())
            said.append(f"Set {asked} for it, and state that under the conditions of the new record.")
        if self.purpose == "tell apart":
            said.append(f"It is to tell apart: {'; '.join(self.rivals)}.")
            gone = [r for r, odds in zip(self.rivals, self.behind, strict=True) if odds > GONE]
            if gone:
                said.append(f"The records so far rule out {'; '.join(gone)}.")
            said.append(f"Expected odds of the true one over the next, with this record: {_odds(self.least)} to 1.")
            said.append(
                f"With the best of the recorded motions run once more: {_odds(least(self.repeated, self.behind))} to 1."
            )
            if not self.settles:
                said.append(
                    f"No motion of the {self.tried} that were simulated within these limits is expected to settle it: "
                    "another load or pretension (say with --set what can be set), a longer travel or a further sensor "
                    "is needed."
                )
        for name, (before, after) in self.narrowed.items():
            said.append(f"{name}: the standard deviation falls to {after / before:.0%} of what it is now.")
        return said


def least(expected: np.ndarray, behind: Sequence[float] | np.ndarray) -> float:
    """The smallest log odds over another rival to be expected of one that may still be true.

    Parameters
    ----------
    expected : ndarray
        Log odds of the first over the second, if the first is true [rivals, rivals].
    behind : sequence of float
        Log odds of the best rival over each, by the records so far; beyond `GONE` it is not asked what if it were true.

    Returns
    -------
    float
        Infinite where there is one rival only.
    """
    others = ~np.eye(len(expected), dtype=bool) & (np.asarray(behind) < GONE)[:, None]
    return float(expected[others].min()) if others.any() else np.inf


def _odds(log_odds: float) -> str:
    return "more than a million" if log_odds > np.log(1e6) else f"{np.exp(max(log_odds, -20.0)):.3g}"
