"""Feedforward from a simulator, replayed against recordings: what the drive should do so that the jaw does as wished.

The wish is the jaw's recorded angle; the recorded drive angle and torque are then what really brings it about. A
simulator turns the wish and the load into drive angle and torque, the equations of `transmission_kernel` solved for
the drive: behind each contact w is known, so M = w e^-l + c opening, w e^l - c closing (w < 0 pulls), and the drive's
angle adds the springs' stretch. After a reversal the drive jumps across the band of friction, as a command may.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from diagnosis.data.first_look import since_reversal
from diagnosis.real.davinci import DEG, MNM
from diagnosis.systems.common import smooth_speed
from diagnosis.systems.transmission import Run, TransmissionModel, zero_of

MOVING = 0.25
"""rad/s of the jaw from which a sample counts as moving."""
ROUNDS = 20
"""Fixed-point steps for the drive's angle: the springs on the drive and the ripple depend on it weakly."""


def command(run: Run, values: Mapping[str, float], wish: np.ndarray, load: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Drive angle, rad, and torque as its sensor would read it, N m, for a jaw angle ``wish`` and jaw torque ``load``.

    All [T]. ``values``: parameters by name; what it has of pre-sliding is that friction turns round with the jaw.
    """
    _, way = since_reversal(wish)
    exponent, level = values["load_dependent_friction.exponent"], values["coulomb_friction.level"]
    first = values["partial_slip.share"]
    zero = values[zero_of(run.group)]
    x = (wish - zero) / values["ratio"]
    for _ in range(ROUNDS):
        last = (load + values["position_dependent_load.output_side"] * x) * values["ratio"]
        last = last * values["sensor_scale.output_torque"]
        middle = _before(last, exponent * (1.0 - first), level * (1.0 - first), way)
        felt = _before(middle, exponent * first, level * first, way)
        felt = felt + values["position_dependent_load.drive_side"] * x
        stretch = _stretch(felt, values, "cable_elongation.drive_side", "stiffness_hardening.drive_side")
        stretch = stretch + _stretch(load, values, "cable_elongation.output_side", "stiffness_hardening.output_side")
        stretch = stretch + _stretch(middle, values, "partial_slip.compliance", "stiffness_hardening.output_side")
        sine, cosine = values["position_ripple.sine"], values["position_ripple.cosine"]
        path = wish - zero + stretch + 0.5 * values["backlash.width"] * way
        x = (path - sine * (np.sin(2 * x) - 2 * x) - cosine * (np.cos(2 * x) - 1)) / values["ratio"]
    return x, felt + values["torque_zero"]


def _before(behind: np.ndarray, exponent: float, level: float, way: np.ndarray) -> np.ndarray:
    """Torque in front of a contact that slips in direction ``way``, from the torque behind it."""
    return behind * np.exp(way * np.sign(behind) * exponent) + way * level


def _stretch(torque: np.ndarray, values: Mapping[str, float], soft: str, hard: str) -> np.ndarray:
    return values[soft] * 2.0 * torque / (1.0 + np.sqrt(1.0 + 2.0 * values[hard] * np.abs(torque)))


def replayed(model: TransmissionModel, uses: Mapping[str, Mapping[str, float]]) -> list[dict[str, Any]]:
    """Jaw error, deg, and drive torque error, mN m, of the feedforward of every simulator, on the records of ``model``.

    uses: name -> parameters. The load is the jaw's measured torque, or its mean over the record: all that a user knows
    who has no sensor there. Jaw error: drive angle commanded less recorded, times the ratio.
    """
    rows = []
    for use, values in uses.items():
        for load in ("measured", "mean"):
            angles, torques, moving = [], [], []
            for run in model.runs:
                good = run.blocks[0].good & run.blocks[1].good
                wrench = run.blocks[1].measured
                known = wrench if load == "measured" else np.full_like(wrench, wrench[good].mean())
                x, torque = command(run, values, run.blocks[0].measured, known)
                angles.append((values["ratio"] * (x - run.x))[good])
                torques.append((torque - run.torque)[good])
                moving.append((np.abs(smooth_speed(run.blocks[0].measured, model.period)) > MOVING)[good])
            angle, torque, fast = (np.concatenate(part) for part in (angles, torques, moving))
            for regime, chosen in (("all", np.ones_like(fast)), ("moving", fast)):
                rows.append({
                    "use": use, "load": load, "regime": regime,
                    "jaw_deg": DEG * float(np.sqrt(np.mean(angle[chosen] ** 2))),
                    "drive_mnm": MNM * float(np.sqrt(np.mean(torque[chosen] ** 2))),
                })  # fmt: skip
    return rows


def traces(
    model: TransmissionModel, values: Mapping[str, Mapping[str, float]], record: str, every: int = 2
) -> dict[str, Any]:
    """One record for a figure: measured, predicted and commanded by the simulators in ``values``; deg and mN m."""
    number, run = next((k, r) for k, r in enumerate(model.runs) if r.blocks[0].record == record)
    cut = slice(None, None, every)
    angle, wrench = run.blocks
    found: dict[str, Any] = {
        "name": record, "time": angle.time[cut].tolist(),
        "drive_angle_deg": (DEG * run.x[cut]).tolist(), "drive_torque_mnm": (MNM * run.torque[cut]).tolist(),
        "output_angle_deg": (DEG * angle.measured[cut]).tolist(),
        "output_torque_mnm": (MNM * wrench.measured[cut]).tolist(),
    }  # fmt: skip
    place = 2 * number
    for name, one in values.items():
        predicted = model.predict(np.array([[one[p.name]] for p in model.parameters]))
        found[f"{name}_angle_deg"] = (DEG * predicted[place][cut, 0]).tolist()
        found[f"{name}_torque_mnm"] = (MNM * predicted[place + 1][cut, 0]).tolist()
        found[f"ff_{name}_deg"] = (DEG * command(run, one, angle.measured, wrench.measured)[0][cut]).tolist()
    return found
