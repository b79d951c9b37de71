"""What simpler methods make of the same recordings. Each is recording -> verdict JSON ("cable-diagnosis/1").

A recording is whatever has ``system``, ``value(name)`` of a parameter (SI, or None) and ``used_for(use)``, records with
``data``: channel -> samples [T], SI.

All start from the balance of forces of the nominal model with derivatives of the measured motion, and from the same
list of templates, one for each effect that a template can show:

no_refit    residual at the nominal parameters; the template that explains most of it is named
sparse      regression of the force on nominal terms and templates with sequential thresholding (SINDy: Brunton et al.
            2016, PNAS 113, 3932; here pysindy's STLSQ on derivatives of sliding lines)
black_box   gradient boosting on the residual after a linear refit; improves the fit, names nothing
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view


@dataclass(frozen=True)
class Balance:
    """Forces of one record: ``force`` is what the ``terms`` (columns, nominal values) should sum to."""

    channel: str
    force: np.ndarray
    terms: Mapping[str, np.ndarray]
    templates: Mapping[str, np.ndarray]
    inputs: np.ndarray


def _slope(values: np.ndarray, time: np.ndarray, half: int = 6) -> np.ndarray:
    """Derivative by straight lines over a sliding window."""
    x = sliding_window_view(np.pad(time, half, mode="reflect", reflect_type="odd"), 2 * half + 1)
    y = sliding_window_view(np.pad(values, half, mode="reflect", reflect_type="odd"), 2 * half + 1)
    x = x - x.mean(axis=1, keepdims=True)
    return (x * y).sum(axis=1) / (x * x).sum(axis=1)


def _common(t: np.ndarray, x: np.ndarray, v: np.ndarray, force: np.ndarray, scale: float) -> dict[str, np.ndarray]:
    """Templates from time, position, speed; ``scale``: a speed that is small."""
    sign = np.tanh(v / (0.1 * scale))
    early = np.exp(-(t - t[0]) / (0.3 * (t[-1] - t[0])))
    turned = np.maximum.accumulate(np.where(np.diff(np.sign(v), prepend=0) != 0, np.arange(len(t)), 0))
    since = t - t[turned]
    return {
        "coulomb_friction": sign,
        "viscous_friction": v,
        "stribeck_friction": sign * np.exp(-((v / scale) ** 2)),
        "asymmetric_friction": np.abs(sign),
        "presliding_hysteresis": sign * np.exp(-since * np.abs(v) / max(np.ptp(x), 1e-12) * 50),
        "friction_drift": sign * early,
        "position_dependent_load": x - x.mean(),
        "position_ripple": np.sin(20 * np.pi * (x - x.min()) / max(np.ptp(x), 1e-12)),
        "actuator_lag": _slope(force, t),
        "load_dependent_friction": sign * np.abs(force),
    }


def balances(recording: Any, use: str) -> list[Balance]:
    """The balance of every record for "fit" or "heldout"."""
    made = {"linear_drive": _of_drive, "cable_hole": _of_hole, "pulley_circuit": _of_circuit}
    return [made[recording.system](recording, record.data) for record in recording.used_for(use)]


def _value(recording: Any, name: str, default: float = 0.0) -> float:
    found = recording.value(name)
    return default if found is None else float(found)


def _of_drive(recording: Any, data: Mapping[str, np.ndarray]) -> Balance:
    t, x, v, force = (data[n] for n in ("time", "position", "velocity", "force"))
    templates = _common(t, x, v, force, 0.01)
    mass = _value(recording, "mass") + _value(recording, "motor_mass")
    terms = {"inertia": mass * _slope(v, t), "viscous": _value(recording, "viscous") * v,
             "coulomb": _value(recording, "coulomb") * np.sign(v)}  # fmt: skip
    del templates["load_dependent_friction"]
    return Balance(
        "force", force, _kept(terms), _unlike(templates, terms), np.column_stack([x, v, terms["inertia"], t])
    )


def _of_hole(recording: Any, data: Mapping[str, np.ndarray]) -> Balance:
    t, y, tension = (data[n] for n in ("time", "load_position", "drive_tension"))
    v = _slope(y, t)
    mass, spring = _value(recording, "load_mass"), _value(recording, "load_stiffness")
    pull = mass * (9.81 + _slope(v, t)) + spring * y
    from cable_envs.proof.simulators.numerics import tension_ratio

    mu, wrap = _value(recording, "friction_coefficient"), _value(recording, "wrap_angle")
    ratio = np.log(tension_ratio(_value(recording, "radius_ratio"), mu, wrap))
    grip = pull * (np.exp(ratio * np.tanh(v / 3e-4)) - 1.0)
    templates = _common(t, y, v, tension, 0.003)
    templates["lateral_extrusion"] = np.sign(v) * np.abs(v) ** 2 * pull
    return Balance("drive_tension", tension, {"load": pull, "grip": grip}, _unlike(templates, {"viscous": 0.0}),
                   np.column_stack([y, v, pull, t]))  # fmt: skip


def _of_circuit(recording: Any, data: Mapping[str, np.ndarray]) -> Balance:
    t, angle, torque = data["time"], data["drive_angle"], data["drive_torque"]
    v = _slope(angle, t)
    load = 1.4 * data["output_torque"]
    pre = _value(recording, "pretension_top", 50.0) * _value(recording, "shaft_friction", 0.157)
    terms = {"load": load, "friction": 0.012 * pre * np.tanh(v / 0.02)}
    return Balance("drive_torque", torque, terms, _unlike(_common(t, angle, v, torque, 0.1), terms),
                   np.column_stack([angle, v, data["output_torque"], t]))  # fmt: skip


def _kept(terms: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    return {name: column for name, column in terms.items() if np.any(column)}


def _unlike(templates: Mapping[str, np.ndarray], terms: Mapping[str, Any]) -> dict[str, np.ndarray]:
    """Templates that are not a nominal term already."""
    has = {"coulomb": "coulomb_friction", "viscous": "viscous_friction", "friction": "coulomb_friction"}
    gone = {has[n] for n, column in terms.items() if n in has and np.any(column)}
    return {name: column for name, column in templates.items() if name not in gone}


def _stack(made: list[Balance]) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[str], list[str]]:
    names, known = list(made[0].templates), list(made[0].terms)
    force = np.concatenate([b.force for b in made])
    terms = np.concatenate([np.column_stack([b.terms[n] for n in known]) for b in made])
    templates = np.concatenate([np.column_stack([b.templates[n] for n in names]) for b in made])
    return force, terms, templates, known, names


def _verdict(kind: str, effects: list[dict[str, Any]], channel: str, errors: Mapping[str, float]) -> dict[str, Any]:
    fit = {channel: {"heldout_rmse": dict(errors)}}
    return {
        "schema": "cable-diagnosis/1", "verdict": kind, "effects": effects, "location": [], "absorbed": {}, "fit": fit,
        "test": {},
    }  # fmt: skip


def no_refit(recording: Any) -> dict[str, Any]:
    """The template most like the residual at the nominal parameters, where it explains 5 % of it or more."""
    made = balances(recording, "fit")
    force, terms, templates, _, names = _stack(made)
    residual = force - terms.sum(axis=1)
    residual = residual - residual.mean()
    columns = templates - templates.mean(axis=0)
    likeness = (columns.T @ residual) ** 2 / ((columns**2).sum(axis=0) * (residual**2).sum() + 1e-300)
    best = int(np.argmax(likeness))
    errors = {"nominal": float(np.sqrt(np.mean(residual**2)))}
    if likeness[best] < 0.05:
        return _verdict("no_detectable_mismatch", [], made[0].channel, errors)
    entry = {"name": names[best], "confidence": float(np.sqrt(likeness[best])), "parameters": {}, "alternatives": []}
    return _verdict("named", [entry], made[0].channel, errors)


def sparse(recording: Any, threshold: float = 0.03) -> dict[str, Any]:
    """Names of the templates that survive thresholding at ``threshold`` of the force's standard deviation."""
    from pysindy.optimizers import STLSQ

    made = balances(recording, "fit")
    force, terms, templates, known, names = _stack(made)
    library = np.column_stack([terms, templates])
    size = np.maximum(library.std(axis=0), 1e-12)
    optimizer = STLSQ(threshold=threshold, alpha=1e-6, max_iter=30)
    target = (force - force.mean()) / force.std()
    optimizer.fit((library - library.mean(axis=0)) / size, target[:, None])
    coefficients = np.asarray(optimizer.coef_).ravel()[len(known) :]
    order = np.argsort(-np.abs(coefficients))
    found = [
        {"name": names[k], "confidence": None, "parameters": {}, "alternatives": []} for k in order if coefficients[k]
    ]
    return _verdict("named" if found else "no_detectable_mismatch", found, made[0].channel, {})


def black_box(recording: Any) -> dict[str, Any]:
    """The verdict "unknown" where boosted trees on the refitted residual lower its held-out error by 5 % or more."""
    from sklearn.ensemble import HistGradientBoostingRegressor

    fit, held = balances(recording, "fit"), balances(recording, "heldout")
    force, terms, _, _, _ = _stack(fit)
    basis = np.column_stack([terms, np.ones(len(force))])
    factors = np.linalg.lstsq(basis, force, rcond=None)[0]
    model = HistGradientBoostingRegressor(max_iter=80, learning_rate=0.1, min_samples_leaf=40, random_state=0)
    model.fit(np.concatenate([b.inputs for b in fit]), force - basis @ factors)
    force, terms, _, _, _ = _stack(held)
    left = force - np.column_stack([terms, np.ones(len(force))]) @ factors
    before = float(np.sqrt(np.mean(left**2)))
    after = float(np.sqrt(np.mean((left - model.predict(np.concatenate([b.inputs for b in held]))) ** 2)))
    kind = "unknown" if after < 0.95 * before else "no_detectable_mismatch"
    return _verdict(kind, [], fit[0].channel, {"refit": before, "augmented": after})


BASELINES: Mapping[str, Callable[[Any], dict[str, Any]]] = {
    "no refit": no_refit, "sparse regression": sparse, "black box": black_box
}  # fmt: skip
