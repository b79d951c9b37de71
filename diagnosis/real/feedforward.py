"""Feedforward from a simulator, replayed against recordings: what the drive should do so that the jaw does as wished.

The wish is the jaw's recorded angle; the recorded drive angle and torque are then what really brings it about. The
simulator is the plant ``transmission`` with its effects, and the command is found by replaying it: Newton's method on
the whole record at once, each sample's drive angle and torque corrected by what the output of that sample lacks. It
begins far beyond the wish in the direction of its motion, where every lost motion is taken up.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from cable_envs.core.errors import ConfigurationError
from cable_envs.diagnosis.data.first_look import since_reversal
from cable_envs.diagnosis.real.davinci import DEG, MNM
from cable_envs.diagnosis.systems.common import smooth_speed
from cable_envs.diagnosis.systems.transmission import Run, TransmissionModel, driven, zero_of
from cable_envs.plants.transmission.plant import PLANT

GAP = "backlash.gap"
MOVING = 0.25
"""rad/s of the jaw from which a sample counts as moving."""
ROUNDS = 40
"""Newton steps at the most."""
CLOSE = 1e-10
"""rad and N m: the command is found where the plant's output is as near to the wish."""
BEYOND = 1.0
"""rad and N m by which the search starts beyond the wish: more than half of any gap and any friction of a tool."""
NUDGE = 1e-6
"""rad and N m of the differences that give the slopes."""


def command(run: Run, values: Mapping[str, float], wish: np.ndarray, load: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Drive angle and torque with which the plant does as wished.

    Friction turns round with the jaw: a command may jump across its band, so the part of it that sticks is taken by the
    sign of the motion (pre-sliding's share 0). So is the gap: its drive is at the edge in that direction, and does not
    cross it for the noise of a measured wish. Sensors are not late in what is commanded.

    Parameters
    ----------
    run : Run
        The record; its group has the zero of the jaw's angle.
    values : mapping of str to float
        Of the plant, by name, SI, and the groups' zeros ("zero.GROUP").
    wish, load : array [T]
        Jaw angle, rad, and jaw torque, N m, as their sensors read them.

    Returns
    -------
    tuple of array [T]
        Drive angle, rad, and torque as its sensor would read it, N m (A where that is a current).

    Raises
    ------
    ConfigurationError
        Where the plant cannot do as wished.
    """
    taken = {k: v for k, v in values.items() if k in PLANT.table}
    lost = 0.5 * taken.get(GAP, 0.0)
    taken |= {"presliding_hysteresis.share": 0.0, "sensor_delay.output_angle": 0.0, GAP: 0.0}
    columns = np.repeat(PLANT.table.pack(taken)[:, None], 3, axis=1)
    period = float(np.median(np.diff(run.blocks[0].time)))
    _, way = since_reversal(wish)
    ratio = values["ratio"]
    path = wish - values[zero_of(run.group)] + lost * way
    asked = Run(path, load, smooth_speed(path / ratio, period), way, run.group, run.blocks)
    aim = np.stack([path, load], axis=1)
    x, torque = (path + BEYOND * way) / ratio, load * ratio + BEYOND * way
    for _ in range(ROUNDS):
        angles, torques = (np.repeat(a[:, None], 3, axis=1) for a in (x, torque))
        angles[:, 1] += NUDGE
        torques[:, 2] += NUDGE
        out = driven(asked, columns, period, angles, torques)
        lacks = aim - out[:, :, 0]
        if np.abs(lacks).max() < CLOSE:
            return x, torque
        slopes = (out[:, :, 1:] - out[:, :, :1]) / NUDGE
        step = np.linalg.solve(slopes, lacks[:, :, None])[:, :, 0]
        x, torque = x + step[:, 0], torque + step[:, 1]
    raise ConfigurationError(f"no command was found: the jaw is {np.abs(lacks).max():.2g} rad or N m from the wish")


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
