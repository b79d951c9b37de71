"""The answer as data: what `cable-diagnosis/1` holds, to JSON and back."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from cable_envs.core.errors import ConfigurationError
from cable_envs.core.files import jsonable, write_atomic
from cable_envs.core.intervals import Interval

SCHEMA = "cable-diagnosis/1"
VERDICTS = ("named", "equivalence_class", "unknown", "no_detectable_mismatch")


@dataclass(frozen=True)
class Found:
    """An effect. ``confidence``: that it, or one of its alternatives, is there (`diagnosis.fit.confidence`).

    parameters: canonical name -> {value, unit, ci95}; ``hypothesis`` tells sensors apart: "sensor_bias.velocity".
    """

    name: str
    confidence: float
    parameters: Mapping[str, Mapping[str, Any]]
    equation: str
    alternatives: tuple[str, ...]
    separating_experiment: str
    hypothesis: str = ""
    gain: float = 0.0
    margin: float = 0.0
    heldout_gain: float = 0.0


@dataclass(frozen=True)
class Estimate(Interval):
    """A parameter with its 95 % interval, in ``unit``."""

    unit: str


@dataclass(frozen=True)
class Step:
    """One effect that the held-out records asked for; the first step is the refit of the nominals alone, named "".

    gain       | held-out fall of the sum of squares, in independent stretches
    alike      | other names that these records do not tell from it
    fit, heldout | RMS error by channel, SI
    parameters | those that were free at this step
    rivals     | held-out gain of every hypothesis that was refitted at this step
    dropped    | effects that were in before, and are not missed any more
    """

    name: str
    gain: float
    confidence: float
    alike: tuple[str, ...]
    fit: Mapping[str, float]
    heldout: Mapping[str, float]
    parameters: Mapping[str, Estimate]
    rivals: Mapping[str, float]
    dropped: tuple[str, ...] = ()


@dataclass(frozen=True)
class Trace:
    """One channel of one record for figures, SI, each [T]: what was measured, and both predictions.

    along: coordinate -> (unit, values); shaded: where the mismatch is, s on the recording's clock.
    """

    record: str
    channel: str
    unit: str
    use: str
    time: np.ndarray
    measured: np.ndarray
    good: np.ndarray
    refit: np.ndarray
    augmented: np.ndarray
    noise: float
    along: Mapping[str, tuple[str, np.ndarray]]
    shaded: tuple[tuple[float, float], ...] = ()


@dataclass(frozen=True)
class Diagnosis:
    """The whole answer. Fields as in the JSON; those from ``suspected`` on are beyond the specification.

    suspected  | effects that helped, where what is left forbids naming them (verdict "unknown"); `fit` then has the
               | errors with them as "suspected"
    hypotheses | every hypothesis tried: gain, absorbability, what it is confused with, why it was refused
    leftover   | smooth maps of what is left: channel, coordinate, places, height, error, p_value
    clues      | channel and coordinate -> p-values of block permutation, before and after
    visited    | what the recording visited: ranges by channel, reversals
    about      | recording, system, options, seed, seconds
    steps      | from the refit up, where the held-out records judge; else empty
    spectra    | where spectra were compared: channel, frequencies, Hz, power of what the answer leaves and what it
               | expects, over that of the noise
    rig        | content of augmented.yaml
    traces     | for figures; not in the JSON
    """

    verdict: str
    effects: tuple[Found, ...]
    location: tuple[Mapping[str, Any], ...]
    absorbed: Mapping[str, Mapping[str, Any]]
    fit: Mapping[str, Mapping[str, Any]]
    test: Mapping[str, Any]
    suspected: tuple[Found, ...] = ()
    hypotheses: tuple[Mapping[str, Any], ...] = ()
    leftover: tuple[Mapping[str, Any], ...] = ()
    clues: tuple[Mapping[str, Any], ...] = ()
    visited: Mapping[str, Any] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    about: Mapping[str, Any] = field(default_factory=dict)
    augmented_rig: str = "augmented.yaml"
    steps: tuple[Step, ...] = ()
    spectra: tuple[Mapping[str, Any], ...] = ()
    rig: Mapping[str, Any] = field(default_factory=dict)
    traces: tuple[Trace, ...] = ()

    def as_json(self) -> dict[str, Any]:
        """JSON types only, schema `SCHEMA`; numbers that are not finite are null."""
        data: dict[str, Any] = {"schema": SCHEMA}
        for f in fields(self):
            if f.name not in ("rig", "traces"):
                data[f.name] = jsonable(getattr(self, f.name))
        return data

    def write(self, out: Path) -> None:
        """diagnosis.json and augmented.yaml into a folder, which is made; each file is replaced whole."""
        write_atomic(out / "diagnosis.json", json.dumps(self.as_json(), indent=1, allow_nan=False) + "\n")
        write_atomic(out / self.augmented_rig, yaml.safe_dump(jsonable(self.rig), sort_keys=False))


def from_json(data: Mapping[str, Any]) -> Diagnosis:
    """The diagnosis in a JSON record, without rig and traces. Raises ConfigurationError for another schema."""
    if data.get("schema") != SCHEMA:
        raise ConfigurationError(f"expected a verdict of schema '{SCHEMA}', found {data.get('schema')!r}")
    if data.get("verdict") not in VERDICTS:
        raise ConfigurationError(f"verdict {data.get('verdict')!r} is none of {', '.join(VERDICTS)}")
    known = {f.name for f in fields(Diagnosis)}
    given = {key: tuple(v) if isinstance(v, list) else v for key, v in data.items() if key in known}
    for key in ("effects", "suspected"):
        made = [Found(**{**e, "alternatives": tuple(e["alternatives"])}) for e in given.get(key, ())]
        given[key] = tuple(made)
    given["steps"] = tuple(_step(entry) for entry in given.get("steps", ()))
    return Diagnosis(**given)


def _step(entry: Mapping[str, Any]) -> Step:
    parameters = {name: Estimate(**estimate) for name, estimate in entry["parameters"].items()}
    return Step(**{**entry, "parameters": parameters, **{k: tuple(entry[k]) for k in ("alike", "dropped")}})
