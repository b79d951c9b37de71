"""A servo that lifts a pendulum (Better Actuator Models): from the Coulomb-viscous simulator to what the runs ask for.

Every run is simulated as a whole from its first angle, with the servo's controller in the loop at 200 Hz and no reset,
as the publication does. The figure is the mean absolute error of the angle on runs that no refit has used: with the
other gain (leave one gain out, both ways), and with the other trajectories (leave one trajectory out).

A ladder has one effect more on each rung. A rung is refitted from the one before, and from the motor's data sheet with
the effects so far, each with the new effect at the sizes at which a diagnosis first tries it. The best on the fitted
runs is kept; the runs held out choose nothing.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cable_envs.diagnosis.data.recording import Record, Recording
from cable_envs.diagnosis.fit.refit import Fit, Start, look, refit
from cable_envs.diagnosis.model.model import Model, Whitener
from cable_envs.diagnosis.model.noise import Noise
from cable_envs.diagnosis.real.finding import Finding, find
from cable_envs.diagnosis.systems import prepare
from cable_envs.diagnosis.systems.question import Question, Request

LADDER = ("gear_friction", "torque_saturation", "command_delay")
"""Effects in the order in which the rungs add them."""
ASKED = (*LADDER, "supply_sag", "winding_heating", "stribeck_friction")
"""What the diagnosis is asked for: what a servo is known to have."""
PEERS = {
    "Coulomb, viscous": {"all": 0.0819, "kp=100": 0.041, "kp=400": 0.091},
    "load-dependent": {"all": 0.0691, "kp=100": 0.028, "kp=400": 0.074},
    "quadratic, directional, Stribeck": {"all": 0.0741, "kp=100": 0.027, "kp=400": 0.084},
}
"""Mean absolute error, rad, of the friction models of Better Actuator Models with the parameters that it ships for this
servo: on all 16 runs (gains 50, 100, 200 and 400), and on the eight that are here by gain."""
EXPECTED = 0.02
"""rad: what a right model is thought to leave, which weighs least squares against nothing else here."""
TRIED, FIRST, LATER, FRESH = 3, 6, 30, 16
"""Starts that are refitted to the end; iterations of the first look at all of them, and of those; starts from the data
sheet at the most."""
DECIMALS = 4
FIGURE = (
    ("without kp=100", "kp100_sin_sin"),
    ("without kp=400", "kp400_sin_sin"),
    ("without kp=400", "kp400_lift_and_drop"),
)
"""Splits, and runs that they hold out, for a figure."""


@dataclass(frozen=True)
class Curve:
    """A run held out: time, s, measured and predicted angle, rad, each [T]."""

    time: np.ndarray
    measured: np.ndarray
    predicted: np.ndarray


@dataclass(frozen=True)
class Rung:
    """A model on one split: the effect that it adds ("" for none), its parameters, and errors by run, rad."""

    effect: str
    values: Mapping[str, float]
    fit: Mapping[str, float]
    heldout: Mapping[str, float]
    curves: Mapping[str, Curve]
    """of runs held out"""

    def as_json(self) -> dict[str, Any]:
        """Numbers alone, rounded."""
        return {
            "effect": self.effect, "values": {k: float(f"{v:.4g}") for k, v in self.values.items()},
            "fit": _mean(self.fit), "heldout": _mean(self.heldout),
            "runs": {k: round(v, DECIMALS) for k, v in (self.heldout or self.fit).items()},
        }  # fmt: skip


@dataclass(frozen=True)
class ServoPendulum:
    """The rungs of every split, by its name, and the diagnosis of the recording as it was imported."""

    splits: Mapping[str, tuple[Rung, ...]]
    finding: Finding


def servo_pendulum(recording: Recording, tell: Callable[[str], None] = lambda text: None) -> ServoPendulum:
    """From a recording as ``cablebench import servo-pendulum`` writes it."""
    found = {}
    for name, split in splits(recording).items():
        tell(f"servo pendulum: {name}")
        found[name] = ladder(split)
    tell("servo pendulum: diagnosis")
    return ServoPendulum(found, find("servo pendulum", recording, effects=ASKED, tell=tell))


def splits(recording: Recording) -> dict[str, Recording]:
    """The recording with one gain, and with one trajectory, held out, and with all runs to fit."""
    found = {}
    for condition in ("kp", "trajectory"):
        for value in dict.fromkeys(r.conditions[condition] for r in recording.records):
            shown = value if isinstance(value, str) else f"{value:g}"
            found[f"without {condition}={shown}"] = replace(
                recording, records=tuple(_used(r, r.conditions[condition] == value) for r in recording.records)
            )
    return found | {"all": replace(recording, records=tuple(_used(r, False) for r in recording.records))}


def _used(record: Record, heldout: bool) -> Record:
    return replace(record, use="heldout" if heldout else "fit")


def ladder(recording: Recording, effects: Sequence[str] = LADDER) -> tuple[Rung, ...]:
    """The rungs on the recording's own split.

    Parameters
    ----------
    recording : Recording
        Of a rotary joint.
    effects : sequence of str
        What the rungs add, in this order.

    Returns
    -------
    tuple of Rung
        The simulator with Coulomb and viscous friction, and one for each effect.
    """
    question = prepare(recording, Request(only=tuple(effects)))
    known = {h.name: h for h in question.hypotheses}
    free = question.nominals
    best = _best(question, "", [Start("", free, {})])
    rungs, sizes = [_rung(question, "", best)], [dict[str, float]()]
    for name in effects:
        free = (*free, *known[name].names)
        probes = [{k: v for one in probe for k, v in one.items()} for probe in known[name].probes]
        sizes = [{**have, **probe} for have in sizes for probe in probes][:FRESH]
        starts = [Start(name, free, {**best.values, **probe}) for probe in probes]
        starts += [Start(name, free, size) for size in sizes]
        new = _best(question, name, [*starts, Start(name, free, best.values)])
        best = new if new.cost <= best.cost else replace(best, free=free)
        rungs.append(_rung(question, name, best))
    return tuple(rungs)


def _best(question: Question, name: str, starts: Sequence[Start]) -> Fit:
    """The best refit on the runs to fit, of those starts that lead after a first look."""
    white = Whitener({"position": Noise(np.empty(0), EXPECTED)})
    seen = look(question.fit, white, starts, FIRST)
    leaders = sorted(seen, key=lambda one: one.cost)[:TRIED]
    fits = refit(question.fit, white, [Start(name, one.free, one.values) for one in leaders], LATER)
    return min(fits, key=lambda one: one.cost)


def _rung(question: Question, name: str, fit: Fit) -> Rung:
    values = {n: fit.values[n] for n in fit.free}
    heldout = curves(question.heldout, fit.values)
    return Rung(name, values, errors(curves(question.fit, fit.values)), errors(heldout), heldout)


def curves(model: Model, values: Mapping[str, float]) -> dict[str, Curve]:
    """Every run of a model with its prediction, by name."""
    if not model.blocks:
        return {}
    column = np.array([values.get(p.name, p.start) for p in model.parameters])[:, None]
    return {
        block.record.removesuffix(".csv"): Curve(block.time, block.measured, seen[:, 0])
        for block, seen in zip(model.blocks, model.predict(column), strict=True)
    }


def errors(runs: Mapping[str, Curve]) -> dict[str, float]:
    """Mean absolute error of the angle by run, rad, over all samples."""
    return {name: float(np.mean(np.abs(run.measured - run.predicted))) for name, run in runs.items()}


def glance(splits: Mapping[str, Sequence[Mapping[str, Any]]]) -> list[dict[str, Any]]:
    """The rungs with their mean error on the gain left out, both ways, for the page's first table."""
    gains = [rungs for name, rungs in splits.items() if name.startswith("without kp")]
    return [
        {"name": row[0]["effect"], "heldout": float(np.mean([r["heldout"] for r in row])), "dropped": []}
        for row in zip(*gains, strict=True)
    ]


def _mean(by_run: Mapping[str, float]) -> float | None:
    return round(float(np.mean(list(by_run.values()))), DECIMALS) if by_run else None
