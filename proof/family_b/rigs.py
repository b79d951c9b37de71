"""Rigs of generator B: generator A's random parameters under other controllers, encoders, simulators and faults."""

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from cable_envs.proof import rigs as first
from cable_envs.proof.effects import Missing
from cable_envs.proof.family_b.simulators import cable_hole, linear_drive, pulley_circuit
from cable_envs.proof.rigs import TrueRig
from cable_envs.proof.sensors import distort

SIMULATE: Mapping[str, Callable[..., dict[str, np.ndarray]]] = {
    "linear_drive": linear_drive.simulate,
    "cable_hole": cable_hole.simulate,
    "pulley_circuit": pulley_circuit.simulate,
}
DIFFERENCES: Mapping[str, Mapping[str, str]] = {
    "linear_drive": {"velocity": "position"},
    "cable_hole": {"drive_velocity": "drive_position"},
    "pulley_circuit": {},
}
"""Speeds that a logger may make of positions."""


def faulty(time: np.ndarray, signals: Mapping[str, np.ndarray], faults: Mapping[str, float]) -> dict[str, np.ndarray]:
    """Signals as faulty sensors give them.

    Parameters
    ----------
    time : ndarray, shape (ticks,)
        s.
    signals : mapping of str to ndarray of shape (ticks,)
        By channel.
    faults : mapping of str to float
        "kind:channel" -> size: the kinds that have a name (`cable_envs.proof.sensors.distort`), and two of no library.
        compressive: the scale falls off towards both ends of the range. missed_counts: a few are lost at reversals.

    Returns
    -------
    dict of str to ndarray
        The same channels.
    """
    own = {key: size for key, size in faults.items() if key.split(":")[0] in ("compressive", "missed_counts")}
    seen = distort(time, signals, {key: size for key, size in faults.items() if key not in own})
    for key, size in own.items():
        kind, channel = key.split(":")
        value = seen[channel]
        if kind == "compressive":
            middle, half = 0.5 * (value.max() + value.min()), max(0.5 * np.ptp(value), 1e-12)
            seen[channel] = value - size * half * ((value - middle) / half) ** 3
        else:
            moved = np.flatnonzero(np.abs(np.diff(value, prepend=value[0])) > 0.02 * np.abs(np.diff(value)).max())
            ways = np.sign(np.diff(value, prepend=value[0])[moved])
            turns = moved[1:][ways[1:] != ways[:-1]]
            lost = np.zeros(len(value))
            lost[turns[::3]] = size
            seen[channel] = value - np.cumsum(lost)
    return seen


def random_rig(
    system: str, rng: np.random.Generator, effects: tuple[Missing, ...], kind: str, period: float
) -> TrueRig:
    """A rig on which effects can act.

    Parameters
    ----------
    system : str
        One of `cable_envs.proof.effects.SYSTEMS`.
    rng : numpy.random.Generator
        Draws its numbers.
    effects : tuple of Missing
        What it must leave out for them, others leave out too at times.
    kind : str
        Kind of its log (`logger.KINDS`): users' drives are controlled on encoder counts, in a cascade as often as not.
    period : float
        Of the log, s, a whole number of ticks where the command is held from row to row.

    Returns
    -------
    TrueRig
        Without any effect.
    """
    made = first.random_rig(system, rng, effects)
    values, free = dict(made.values), list(made.free)
    if system == "linear_drive" and kind != "white":
        values["count"] = made.noise["position"] * rng.uniform(0.1, 0.5)
        soft = {"cable_elongation", "backlash"} & {e.name for e in effects} or "cable_elongation.compliance" in values
        if not soft and rng.random() < 0.5:  # kv (kp / kv e + r' - v) + integral: a cascade of a P and a PI controller
            wide = float(np.sqrt(values["kp"] / values["mass"]))
            values["kv"], values["ki"] = values["mass"] * wide, 0.3 * values["mass"] * wide**2
            values["kp"] = values["kv"] * 0.35 * wide
            values.pop("kd")
            free = [("ki",) if names == ("kd",) else names for names in free]
    if system == "cable_hole" and kind in ("white", "rest") and not values["kp"] and rng.random() < 0.4:
        values["held"] = float(round(period / linear_drive.CLOCK))
    return replace(made, values=values, free=tuple(free), simulate=SIMULATE[system], fault=faulty)
