"""EMPS (Janot, Gautier, Brunot 2019): a ball-screw axis from voltage and position; mass, friction and offset.

Three estimates beside the published ones, which rest on other weights of the same record:

steps    | `diagnose`: what the model may be off by has a place beside the noise; 200 Hz
coloured | a refit without that: all that is left is taken for noise and whitened; 1 kHz
inverse  | least squares of the filtered force on acceleration, speed, its sign and one (Gautier, IDIM-LS): the way the
         | published numbers were found; it uses no simulator and is here to check one

What is left is ten times the encoder's noise and follows the motion: model error, not noise. Whitened, it counts where
it changes quickly, just behind reversals, and the estimate is that of the friction there. The curvature takes it for
noise that is drawn anew and gives a quarter of the interval that parts of the record have among themselves, so the
second's intervals are from parts (`cable_envs.diagnosis.fit.weights.with_sandwich_covariance`).
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import butter, decimate, filtfilt

from cable_envs.core.intervals import NORMAL_95
from cable_envs.diagnosis.data.description import Quantity
from cable_envs.diagnosis.data.recording import Record, Recording
from cable_envs.diagnosis.fit.likelihood import refit_and_learn
from cable_envs.diagnosis.fit.refit import Start
from cable_envs.diagnosis.fit.weights import with_sandwich_covariance
from cable_envs.diagnosis.model.verdict import Estimate
from cable_envs.diagnosis.real.finding import Finding, find
from cable_envs.diagnosis.systems.linear_drive import prepare
from cable_envs.diagnosis.systems.question import Request

PUBLISHED = {"mass": 95.1, "viscous": 203.5, "coulomb": 20.4, "force_offset": -3.16}
"""kg, N s/m, N, N."""
UNITS = {"mass": "kg", "viscous": "N s/m", "coulomb": "N", "force_offset": "N"}
STARTS = {"mass": 60.0, "viscous": 100.0, "coulomb": 10.0, "force_offset": 0.0}
THINNED = 5
CUT, EVERY = 40.0, 10
"""Hz of the fourth-order Butterworth filter, forwards and back; samples between rows of the regression."""
WITHOUT = ("cable_elongation", "asymmetric_friction")
"""The axis is one body here; and with a free offset, an asymmetric friction is a Coulomb friction of half its size."""


@dataclass(frozen=True)
class Emps:
    """Estimates by method and parameter, and the steps from a frictionless mass."""

    estimates: Mapping[str, Mapping[str, Estimate]]
    finding: Finding


def emps(recording: Recording, tell: Callable[[str], None] = lambda text: None) -> Emps:
    """From a recording as ``cablebench import emps`` writes it: the last quarter held out."""
    known = {**recording.known, "motor_mass": Quantity(0.0)}
    one_body = replace(recording, known=known)
    tell("EMPS: refit of all four with the colour of the noise")
    estimates = {"inverse": inverse_dynamics(one_body), "coloured": coloured(one_body)}
    tell("EMPS: diagnosis")
    naive = {name: Quantity(STARTS[name]) for name in ("mass", "force_offset")}
    thin = tuple(thinned(record, THINNED) for record in one_body.records)
    finding = find("EMPS", replace(one_body, nominal=naive, records=thin), without=WITHOUT, tell=tell)
    last = finding.steps[-1].parameters
    estimates["steps"] = {name: last[name] for name in PUBLISHED if name in last}
    return Emps(estimates, finding)


def coloured(recording: Recording) -> dict[str, Estimate]:
    """All four parameters refitted together on the fit record."""
    nominal = {name: Quantity(value) for name, value in STARTS.items()}
    question = prepare(replace(recording, nominal=nominal), Request(without=WITHOUT))
    fit = with_sandwich_covariance(question.fit, refit_and_learn(question.fit, [Start("", question.nominals, {})]).fit)
    return {name: Estimate(fit.values[name], *fit.interval(name), UNITS[name]) for name in PUBLISHED}


def inverse_dynamics(recording: Recording) -> dict[str, Estimate]:
    """IDIM-LS over all records; intervals from white residuals at `EVERY` samples, as in the publications."""
    rows, target = [], []
    per_volt = recording.value("force_per_volt")
    assert per_volt is not None, "the reader of this data set says it"
    for record in recording.used_for("fit"):
        table, force = _regressors(record, per_volt)
        rows.append(table)
        target.append(force)
    table, force = np.concatenate(rows), np.concatenate(target)
    found = np.linalg.lstsq(table, force, rcond=None)[0]
    left = force - table @ found
    error = NORMAL_95 * np.sqrt(np.diag(np.linalg.inv(table.T @ table)) * left.var())
    return {n: Estimate(v, v - e, v + e, UNITS[n]) for n, v, e in zip(PUBLISHED, found, error, strict=True)}


def _regressors(record: Record, per_volt: float) -> tuple[np.ndarray, np.ndarray]:
    """(acceleration, speed, its sign, 1 [T, 4], force [T]), filtered and thinned alike."""
    dt = float(np.median(np.diff(record.time)))
    low = butter(4, CUT * 2.0 * dt)
    speed = np.gradient(filtfilt(*low, record.data["position"]), dt)
    columns = [np.gradient(speed, dt), speed, np.sign(speed), np.ones_like(speed), record.data["voltage"] * per_volt]
    thin = [decimate(filtfilt(*low, c), EVERY, ftype="fir", zero_phase=True)[20:-20] for c in columns]
    return np.stack(thin[:4], axis=1), thin[4]


def thinned(record: Record, every: int) -> Record:
    """A record averaged over ``every`` samples, the rest at its end left out."""
    count = len(record.time) // every * every
    return replace(record, data={c: v[:count].reshape(-1, every).mean(axis=1) for c, v in record.data.items()})
