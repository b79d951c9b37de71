"""Random rigs of each system: true parameters, what the recording says of them, channels, noise; how to observe."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from cable_envs.proof.effects import Missing
from cable_envs.proof.sensors import distort
from cable_envs.proof.simulators import cable_hole, linear_drive, pulley_circuit


@dataclass(frozen=True)
class Told:
    """What the recording says of one quantity: the true value in the recording's terms, and whether it is refitted."""

    name: str
    value: float
    unit: str
    refitted: bool = True


@dataclass(frozen=True)
class TrueRig:
    """A rig without any effect. ``free``: simulator's parameters that the refit of `refit` moves."""

    system: str
    values: Mapping[str, float]
    told: tuple[Told, ...]
    free: tuple[tuple[str, ...], ...]
    amplitude: float
    centre: float
    noise: Mapping[str, float]
    scored: tuple[str, ...]
    given: tuple[str, ...]
    """channels that are commands: recorded without noise"""
    preset: str | None = None
    simulate: Callable[..., dict[str, np.ndarray]] | None = None
    """another simulator of the system than generator A's (`SIMULATE`)"""
    fault: Callable[..., dict[str, np.ndarray]] = distort


SIMULATE: Mapping[str, Callable[..., dict[str, np.ndarray]]] = {
    "linear_drive": linear_drive.simulate,
    "cable_hole": cable_hole.simulate,
    "pulley_circuit": pulley_circuit.simulate,
}
CLOCK = linear_drive.CLOCK


def _between(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def random_rig(system: str, rng: np.random.Generator, effects: tuple[Missing, ...] = ()) -> TrueRig:
    """A rig on which effects can act.

    Parameters
    ----------
    system : str
        One of `cable_envs.proof.effects.SYSTEMS`.
    rng : numpy.random.Generator
        Draws its numbers.
    effects : tuple of Missing
        What it must leave out for them, others leave out too at times.

    Returns
    -------
    TrueRig
        Without any effect.
    """
    made = {"linear_drive": _drive, "cable_hole": _hole, "pulley_circuit": _circuit}
    known = {name: value for effect in effects for name, value in effect.known.items()}
    return made[system](rng, {e.name for e in effects}, known)


def _drive(rng, names, known) -> TrueRig:
    total, share = _between(rng, 3.0, 12.0), rng.uniform(0.1, 0.3)
    viscous = 0.0 if "viscous" in known or rng.random() < 0.15 else _between(rng, 10.0, 50.0)
    rubs = names & {"stribeck_friction", "asymmetric_friction"}  # a difference alone would push in one direction
    dry = "coulomb" not in known and (bool(rubs) or rng.random() > 0.15)
    coulomb = _between(rng, 3.0, 12.0) if dry or "friction_drift" in names or "presliding_hysteresis" in names else 0.0
    wide = rng.uniform(25.0, 45.0)  # rad/s, closed loop
    values = {
        "mass": total, "motor_share": share, "viscous": viscous, "coulomb": coulomb, "kp": total * wide**2,
        "kv": 1.4 * total * wide, "kd": 1.4 * total * wide,
    }  # fmt: skip
    told = [Told("mass", total * (1 - share), "kg"), Told("motor_mass", total * share, "kg", False)]
    told += [Told("viscous", viscous, "N s/m", viscous > 0.0), Told("coulomb", coulomb, "N", coulomb > 0.0)]
    free = [("mass",), ("kp",), ("kv",), ("kd",)]  # the recording does not tell the controller's gains
    free += [(n,) for n, on in (("viscous", viscous > 0), ("coulomb", coulomb > 0)) if on]
    belt = "backlash" in names or (not known and rng.random() < 0.3)
    if belt and "cable_elongation" not in names:
        # 9 times the loop's bandwidth: with the load's position fed back a softer belt, damped as below, is unstable
        stiffness = max(_between(rng, 1e5, 3e5), (9.0 * wide) ** 2 * total * share * (1.0 - share))
        values["cable_elongation.compliance"] = 1.0 / stiffness
        damping = 0.2 * np.sqrt(stiffness * total * share * (1 - share))
        told += [Told("belt_stiffness", stiffness, "N/m"), Told("belt_damping", damping, "N s/m", False)]
        free.append(("cable_elongation.compliance",))
    else:
        told.append(Told("belt_stiffness", 0.0, "N/m", False))
    told.append(Told("gravity_share", 0.0, "1", False))
    noise = {
        "position": _between(rng, 5e-6, 2e-5),
        "velocity": _between(rng, 1e-3, 3e-3),
        "force": _between(rng, 0.1, 0.4),
    }
    return TrueRig(
        "linear_drive", values, tuple(told), tuple(free), rng.uniform(0.04, 0.09), 0.0, noise, tuple(noise),
        ("position_reference",),
    )  # fmt: skip


def _hole(rng, names, known) -> TrueRig:
    mass, wrap, rho = _between(rng, 3.0, 8.0), rng.uniform(0.6, 1.4), rng.uniform(1.3, 3.0)
    rigid = "cable_stiffness" in known or (not names and rng.random() < 0.2)
    stiffness = 2e5 if rigid else _between(rng, 3e4, 9e4)
    spring = 0.0 if "load_stiffness" in known or rng.random() < 0.3 else _between(rng, 200.0, 800.0)
    varied = names & {"load_dependent_friction", "stiffness_hardening", "bending_stiffness"}
    if varied and "load_stiffness" not in known:  # else a further spring would be none beside one that is refitted
        spring = _between(rng, 400.0, 1000.0)  # tensions that vary
    mu, gain = rng.uniform(0.2, 0.5), 0.0
    damping = 2.0 * 0.1 * np.sqrt(min(stiffness, 1e5) * mass)
    closed = rng.random() < 0.5
    values = {
        "load_mass": mass, "wrap_angle": wrap, "radius_ratio": rho, "cable_stiffness": stiffness,
        "cable_damping": damping, "load_stiffness": spring, "friction_coefficient": mu, "kp": 4.0 if closed else 0.0,
    }  # fmt: skip
    weighed = "sensor_scale" in names or rng.random() < 0.7
    told = [
        Told("friction_coefficient", mu, "1"), Told("load_mass", mass, "kg", not weighed),
        Told("cable_stiffness", stiffness, "N/m", not rigid), Told("load_stiffness", spring, "N/m", spring > 0),
        Told("cable_damping", damping, "N s/m", False), Told("wrap_angle", wrap, "rad", False),
        Told("radius_ratio", rho, "1", False), Told("cable_radius", 1e-3, "m", False),
        Told("extrusion_gain", gain, "SI", False), Told("extrusion_delta", 0.0, "1", False),
        Told("extrusion_exponent", 2.03, "1", False), Told("bending_rigidity", 0.0, "N m^2", False),
        Told("load_damping", 0.0, "N s/m", False), Told("gravity", 9.81, "m/s^2", False),
        Told("load_gravity", 1.0, "1", False), Told("drive_acceleration_limit", 2.0, "m/s^2", False),
    ]  # fmt: skip
    free = [("friction_coefficient",)] + [(t.name,) for t in told[1:4] if t.refitted]
    noise = {
        "drive_position": _between(rng, 5e-6, 3e-5), "drive_velocity": _between(rng, 1e-4, 3e-4),
        "drive_tension": _between(rng, 0.05, 0.3), "load_position": _between(rng, 5e-6, 3e-5),
    }  # fmt: skip
    if rigid:  # the simulator's sticking gives way by 0.06 N there, which must stay within the noise
        noise["drive_tension"] = max(noise["drive_tension"], 0.15)
    if rng.random() < 0.5:
        noise["load_tension"] = max(_between(rng, 0.05, 0.3), 0.15 if rigid else 0.0)
    return TrueRig(
        "cable_hole", values, tuple(told), tuple(free), rng.uniform(0.008, 0.015), 0.018, noise, tuple(noise),
        ("drive_velocity_command", "position_reference"),
    )  # fmt: skip


def _circuit(rng, names, known) -> TrueRig:
    rigid = "tensile_stiffness" in known
    pre, ea = _between(rng, 35.0, 90.0), 5e4 if rigid else 1.684e4 * rng.uniform(0.9, 1.1)
    contact, shaft = _between(rng, 0.05, 0.4), 0.157 * rng.uniform(0.85, 1.15)
    values = {
        "tensile_stiffness": ea, "pretension_top": pre, "pretension_bottom": pre,
        "shaft_friction": shaft, "contact_stiffness": contact, "contact_angle": 0.0, "output_inertia": 2e-5,
    }  # fmt: skip
    rubs = names & {"stribeck_friction", "asymmetric_friction", "presliding_hysteresis"}
    rubs = rubs or ("brake_torque" not in known and rng.random() < 0.3)
    brake = _between(rng, 5e-3, 2e-2) if rubs else 0.0
    values["coulomb_friction.torque"] = brake
    measured = rng.random() < 0.5
    told = [
        Told("shaft_friction", shaft, "1"),
        Told("tensile_stiffness", ea, "N", not rigid),
        Told("pretension_top", pre, "N", not measured), Told("pretension_bottom", pre, "N", not measured),
        Told("contact_stiffness", contact, "N m/rad", False), Told("contact_angle", 0.0, "rad", False),
        Told("contact_damping", 2e-3, "N m s", False), Told("brake_torque", brake, "N m", brake > 0.0),
        Told("output_damping", 2e-4, "N m s", False), Told("payload_mass", 0.0, "kg", False),
        Told("cable_friction", 0.54, "1", False),
        Told("output_inertia", 2e-5, "kg m^2"),  # never known: the rope that rides on the idlers adds 6 % to it
    ]  # fmt: skip
    free = [("shaft_friction",), ("output_inertia",)] + ([] if rigid else [("tensile_stiffness",)])
    free += [] if measured else [("pretension_top",), ("pretension_bottom",)]
    free += [("coulomb_friction.torque",)] if brake else []
    noise = {
        "drive_angle": _between(rng, 2e-4, 1e-3), "drive_torque": _between(rng, 1e-3, 4e-3),
        "output_angle": _between(rng, 5e-4, 2e-3), "output_torque": _between(rng, 5e-4, 2e-3),
    }  # fmt: skip
    return TrueRig(
        "pulley_circuit", values, tuple(told), tuple(free), rng.uniform(0.5, 0.9), 0.0, noise, tuple(noise),
        ("drive_angle_command",), "zou-table2",
    )  # fmt: skip


def simulated(rig: TrueRig, values: Mapping[str, float], reference: np.ndarray) -> dict[str, np.ndarray]:
    """All signals of a rig at every tick of `CLOCK`, before sensors: of its own simulator, or generator A's.

    Parameters
    ----------
    rig : TrueRig
        The rig.
    values : Mapping of str to float
        All that the simulator is to be told.
    reference : ndarray, shape (ticks,)
        What the drive is told.

    Returns
    -------
    dict of str to ndarray
        Signals of shape (ticks,) by name, SI.
    """
    return (rig.simulate or SIMULATE[rig.system])(values, reference)


def observe(rig: TrueRig, changes: Mapping[str, float], reference: np.ndarray, at: np.ndarray) -> dict[str, np.ndarray]:
    """Channels of a rig without noise.

    Parameters
    ----------
    rig : TrueRig
        The rig.
    changes : Mapping of str to float
        Simulator's parameters, and sensor faults as "kind:channel". A late position sensor is late for the
        controller too.
    reference : ndarray
        What the drive is told, at every tick of `CLOCK`.
    at : ndarray
        Times of the samples, s since the record's start [T].

    Returns
    -------
    dict of str to ndarray
        [T] by channel, SI.
    """
    faults = {k: v for k, v in changes.items() if ":" in k}
    values = {**rig.values, **{k: v for k, v in changes.items() if ":" not in k}}
    if rig.system == "linear_drive" and "delay:position" in faults:
        values["sensor_delay.time"] = faults["delay:position"]
    signals = simulated(rig, values, reference)
    seen = rig.fault(signals["time"], signals, faults)
    return {name: np.interp(at, signals["time"], seen[name]) for name in (*rig.noise, *rig.given)}
