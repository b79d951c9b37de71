"""The answer as data: what `cable-diagnosis/1` holds, to JSON and back."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from cable_envs.core.errors import ConfigurationError
from cable_envs.core.files import json_text, jsonable, write_atomic
from cable_envs.core.intervals import Interval
from cable_envs.diagnosis.model.hypotheses import Hypothesis

SCHEMA = "cable-diagnosis/1"
VERDICTS = ("named", "equivalence_class", "partly_named", "unknown", "data_fault", "no_detectable_mismatch")
NAMED = ("named", "equivalence_class", "partly_named")
"""Verdicts with effects."""
SURE = 20.0
"""Odds from which one model is preferred to another."""
SURE_WHERE_LEARNT = 8.0
"""Log odds from which it is where the noise is learnt from what is left: of effects with 3 to 10 on logs of generator A
(`cable_envs.proof.logs`, seed 5) 1 of 7 was right, of those with more 14 of 16."""


def local_groups(odds: Mapping[str, float]) -> tuple[str, ...]:
    """Groups of records on which an effect does not hold.

    The more groups are asked, the more it takes (Bonferroni): one may speak against it by chance.

    Parameters
    ----------
    odds : Mapping of str to float
        Group -> log odds of the model with the effect over the one without it, both fitted to the other groups.

    Returns
    -------
    tuple of str
    """
    least = np.log(SURE * max(len(odds), 1))
    return tuple(group for group, found in odds.items() if found < -least)


@dataclass(frozen=True)
class Estimate(Interval):
    """A parameter with its 95 % confidence interval.

    Parameters
    ----------
    value, low, high : float
        As of `Interval`, in ``unit``.
    unit : str
        Of all three.
    row : str
        The plant's own name of the parameter, where an effect calls it otherwise.
    """

    unit: str
    row: str = ""

    def as_json(self) -> dict[str, Any]:
        """Value, ends of the interval and unit by name."""
        return {"value": self.value, "low": self.low, "high": self.high, "unit": self.unit}


@dataclass(frozen=True)
class EffectGain:
    """An effect with what a model gains by it: as a candidate, as a step of a selection, and in the answer.

    Gains are log odds (`cable_envs.diagnosis.evidence`); of a refit that is only compared with others, falls of the
    deviance, twice the logarithm of the likelihood ratio.

    Parameters
    ----------
    hypothesis : Hypothesis
        The effect, and which of the plant's parameters a refit with it moves.
    gain : float
        Over the model without it.
    heldout_gain : float
        Of a limit cycle, the same on the records that were not fitted.
    margin : float
        Gain over the best rival that is no alternative.
    alternatives : tuple of str
        What these records do not tell from it.
    confidence : float
        Probability that it, or one of its alternatives, is there (`cable_envs.diagnosis.evidence`).
    parameters : Mapping of str to Estimate
        In the answer by the effect's own names; of a step all that were refitted, by the plant's.
    fit, heldout : Mapping of str to float
        RMS error of the model with it by channel, SI, where it was taken.
    rivals : Mapping of str to float
        Gain of every hypothesis that was refitted beside it.
    dropped : tuple of str
        Effects that were in before, and are not missed once this one is in.
    elsewhere : Mapping of str to float
        Group of records -> log odds of the model with it over the one without it on these, given all others
        (`cable_envs.diagnosis.search.elsewhere`); empty where it was not asked.
    """

    hypothesis: Hypothesis
    gain: float = 0.0
    heldout_gain: float = 0.0
    margin: float = 0.0
    alternatives: tuple[str, ...] = ()
    confidence: float = 0.0
    parameters: Mapping[str, Estimate] = field(default_factory=dict)
    fit: Mapping[str, float] = field(default_factory=dict)
    heldout: Mapping[str, float] = field(default_factory=dict)
    rivals: Mapping[str, float] = field(default_factory=dict)
    dropped: tuple[str, ...] = ()
    elsewhere: Mapping[str, float] = field(default_factory=dict)

    @property
    def holds(self) -> tuple[str, ...]:
        """Groups of records on which it holds, given the others."""
        return tuple(group for group, odds in self.elsewhere.items() if odds > np.log(SURE))

    @property
    def local(self) -> tuple[str, ...]:
        """Groups of records on which it does not hold: the model without it, fitted to the others, is better there."""
        return local_groups(self.elsewhere)

    @property
    def name(self) -> str:
        """Name of the effect: "sensor_bias" of the hypothesis "sensor_bias.velocity"; "" of the nominal refit."""
        return self.hypothesis.canonical

    @property
    def equation(self) -> str:
        """Its law."""
        return self.hypothesis.equation

    @property
    def separating_experiment(self) -> str:
        """What would tell it from its alternatives."""
        return self.hypothesis.experiment

    def as_answer(self) -> dict[str, Any]:
        """As in the JSON's "effects"."""
        parameters = {
            name: {"value": e.value, "unit": e.unit, "row": e.row, "ci95": [e.low, e.high]}
            for name, e in self.parameters.items()
        }  # fmt: skip
        return {
            "name": self.name, "confidence": self.confidence, "parameters": parameters, "equation": self.equation,
            "alternatives": self.alternatives, "separating_experiment": self.separating_experiment,
            "hypothesis": self.hypothesis.name, "log_odds": self.gain, "margin": self.margin, "rivals": self.rivals,
            "elsewhere": self.elsewhere, "holds": self.holds, "local": self.local,
        }  # fmt: skip

    def as_step(self) -> dict[str, Any]:
        """As in the JSON's "steps"; "alike" are its alternatives there."""
        return {
            "name": self.hypothesis.name, "log_odds": self.gain, "confidence": self.confidence,
            "alike": self.alternatives, "fit": self.fit, "heldout": self.heldout,
            "parameters": {name: estimate.as_json() for name, estimate in self.parameters.items()},
            "rivals": self.rivals, "dropped": self.dropped,
        }  # fmt: skip


NOMINAL = Hypothesis("", (), ())
"""No effect: the refit of the nominal parameters, from which every selection starts."""


@dataclass(frozen=True)
class Trace:
    """One channel of one record for figures, SI: what was measured, and both predictions.

    Parameters
    ----------
    record, channel, unit, use : str
        Which one; use is "fit" or "heldout".
    time, measured, good, refit, augmented : ndarray
        [T]: s, the measurements and whether they count, the predictions of the refit and of the answer.
    noise : float
        Standard deviation of the channel's noise.
    along : Mapping of str to (str, ndarray)
        Coordinate -> (unit, values [T]).
    shaded : tuple of (float, float)
        Where the mismatch is, s on the recording's clock.
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
    """The whole answer. Fields as in the JSON (schema "cable-diagnosis/1").

    Parameters
    ----------
    verdict : str
        One of `VERDICTS`.
    effects : tuple of EffectGain
        What is named; empty unless the verdict is one of `NAMED`.
    location : tuple of Mapping
        Where the mismatch is: channel, record, intervals in s, regime, in words.
    absorbed : Mapping
        Nominal parameter -> value claimed, after the refit, and with the effects.
    fit : Mapping
        Channel -> RMS errors on fitted and held-out records, and the noise.
    test : Mapping
        p-value of the first score tests, log odds of the best model over the nominal one, log odds and share of what
        is left and what it is of the sensors, and the least size that could have been seen.
    suspected : tuple of EffectGain
        Effects that helped, where what is left forbids naming them (verdict "unknown"); `fit` then has the errors with
        them as "suspected".
    faults : tuple of EffectGain
        What is wrong with the data: the logger's clock, a filtered speed.
    hypotheses : tuple of Mapping
        Every hypothesis tried: log odds, absorbability, what it is confused with, why it was refused.
    leftover : tuple of Mapping
        What is left of every kind: channel, coordinate, log odds; of a smooth map places, height, error.
    clues : tuple of Mapping
        Channel and coordinate -> p-values of block permutation, before and after.
    visited : Mapping
        What the recording visited: ranges by channel, reversals.
    notes : tuple of str
        What a person should know beside it.
    about : Mapping
        Recording, system, options, seed, seconds.
    augmented_rig : str
        Name of the corrected rig's file.
    steps : tuple of EffectGain
        The refit without effects, and each effect as it was accepted, with the errors after it.
    spectra : tuple of Mapping
        Where spectra were compared: channel, frequencies, Hz, power of what the answer leaves and what it expects, over
        that of the noise.
    products : tuple of Mapping
        Products of powers of parameters that are known where the parameters are not: names, exponents, what is
        subtracted from each, value, unit, 95 % interval, and that of each parameter alone.
    rig : Mapping
        Content of augmented.yaml.
    traces : tuple of Trace
        For figures; not in the JSON.
    not_asked : Mapping of str to str
        Effect, or a parameter of one, that was not looked for -> why; without those that the caller left out.
    parameters : tuple of Mapping
        Every number of the simulator: name, value, SI unit, meaning, status ("stated", "assumed", "fitted"), source of
        the value, or of where the refit starts, and whether the user stated that.
    """

    verdict: str
    effects: tuple[EffectGain, ...]
    location: tuple[Mapping[str, Any], ...]
    absorbed: Mapping[str, Mapping[str, Any]]
    fit: Mapping[str, Mapping[str, Any]]
    test: Mapping[str, Any]
    suspected: tuple[EffectGain, ...] = ()
    faults: tuple[EffectGain, ...] = ()
    hypotheses: tuple[Mapping[str, Any], ...] = ()
    leftover: tuple[Mapping[str, Any], ...] = ()
    clues: tuple[Mapping[str, Any], ...] = ()
    visited: Mapping[str, Any] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    about: Mapping[str, Any] = field(default_factory=dict)
    augmented_rig: str = "augmented.yaml"
    steps: tuple[EffectGain, ...] = ()
    spectra: tuple[Mapping[str, Any], ...] = ()
    products: tuple[Mapping[str, Any], ...] = ()
    rig: Mapping[str, Any] = field(default_factory=dict)
    traces: tuple[Trace, ...] = ()
    not_asked: Mapping[str, str] = field(default_factory=dict)
    parameters: tuple[Mapping[str, Any], ...] = ()

    def as_json(self) -> dict[str, Any]:
        """JSON types only, schema `SCHEMA`; numbers that are not finite are null."""
        data: dict[str, Any] = {"schema": SCHEMA}
        for f in fields(self):
            if f.name not in ("rig", "traces"):
                write = _WRITERS.get(f.name)
                value = getattr(self, f.name)
                data[f.name] = jsonable(value if write is None else [write(effect) for effect in value])
        return data

    def corrected(self, simulator: Any) -> Any:
        """A user's simulator with the physics that is named, at its ports.

        Parameters
        ----------
        simulator : Simulator
            That was diagnosed (`cable_envs.diagnosis.simulators`).

        Returns
        -------
        Simulator
            The same interface, with the refitted parameters as its nominal ones.
        """
        return simulator.corrected(self.rig)

    def write(self, out: Path) -> None:
        """diagnosis.json and augmented.yaml into a folder, which is made; each file is replaced whole."""
        write_atomic(out / "diagnosis.json", json_text(self.as_json()))
        write_atomic(out / self.augmented_rig, yaml.safe_dump(jsonable(self.rig), sort_keys=False))


def from_json(data: Mapping[str, Any]) -> Diagnosis:
    """The diagnosis in a JSON record, without rig and traces.

    Raises
    ------
    ConfigurationError
        For another schema or verdict.
    """
    if data.get("schema") != SCHEMA:
        raise ConfigurationError(f"expected a verdict of schema '{SCHEMA}', found {data.get('schema')!r}")
    if data.get("verdict") not in VERDICTS:
        raise ConfigurationError(f"verdict {data.get('verdict')!r} is none of {', '.join(VERDICTS)}")
    known = {f.name for f in fields(Diagnosis)}
    given: dict[str, Any] = {key: tuple(v) if isinstance(v, list) else v for key, v in data.items() if key in known}
    for key, read in _READERS.items():
        given[key] = tuple(read(entry) for entry in given.get(key, ()))
    return Diagnosis(**given)


def _read(entry: Mapping[str, Any]) -> EffectGain:
    parameters = {
        name: Estimate(p["value"], p["ci95"][0], p["ci95"][1], p["unit"], p.get("row", ""))
        for name, p in entry["parameters"].items()
    }
    name = entry.get("hypothesis") or entry["name"]
    hypothesis = Hypothesis(name, (), (), entry["equation"], entry["separating_experiment"])
    return EffectGain(
        hypothesis, entry.get("log_odds", 0.0), margin=entry.get("margin", 0.0), rivals=entry.get("rivals", {}),
        alternatives=tuple(entry["alternatives"]), confidence=entry["confidence"], parameters=parameters,
        elsewhere=entry.get("elsewhere", {}),
    )  # fmt: skip


def _step_read(entry: Mapping[str, Any]) -> EffectGain:
    return EffectGain(
        Hypothesis(entry["name"], (), ()), entry["log_odds"], alternatives=tuple(entry["alike"]),
        confidence=entry["confidence"], fit=entry["fit"], heldout=entry["heldout"], rivals=entry["rivals"],
        parameters={name: Estimate(**estimate) for name, estimate in entry["parameters"].items()},
        dropped=tuple(entry["dropped"]),
    )  # fmt: skip


_WRITERS = {
    "effects": EffectGain.as_answer,
    "suspected": EffectGain.as_answer,
    "faults": EffectGain.as_answer,
    "steps": EffectGain.as_step,
}
_READERS = {"effects": _read, "suspected": _read, "faults": _read, "steps": _step_read}
