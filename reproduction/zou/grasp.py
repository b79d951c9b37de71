"""The grasp at 25 N (sections 3.2 and 3.3 of Zou 2022): contact, true mechanisms, estimate and compensated drive.

The sensor's stiffness and position are not printed. They are chosen here such that the chain with Table 2, driven
without compensation, has the two printed errors, 13.96 degrees and 0.215 N m: two conditions, two numbers, nothing left
to fit. All other errors are then predictions. "Simulated truth" is the chain with other parameters than the estimator
and the compensation believe in (`truths`) and with sensor noise.
"""

import math
from collections.abc import Mapping, Sequence
from functools import cache
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq

from cable_envs.baselines import make_controller
from cable_envs.core.inputs import INPUTS
from cable_envs.plants import plant_for
from cable_envs.plants.circuit.parameters import CIRCUIT
from cable_envs.plants.circuit.statics import Statics, replay
from cable_envs.reproduction.zou.data import GRASP_PRETENSION, UNCOMPENSATED
from cable_envs.reproduction.zou.runs import CONTACT_DAMPING, DT, SUBSTEPS, Run, follow, last_cycle, sinusoid
from cable_envs.sim.tasks import load_task

UNCERTAIN = ("tensile_stiffness", "cable_friction", "shaft_friction", "pretension_top", "pretension_bottom")
"""what a truth may differ in: the cable, its friction, the shafts, and what the dynamometer read"""
SPREADS = (0.05, 0.1, 0.2, 0.3)
"""+/- shares within which they are drawn"""
SPREAD = 0.2
"""the one that rows and figures use; chosen: friction coefficients from tables are rarely better known"""
TRUTHS = 40
DEADBAND = 4e-3
"""rad; drive motion that counts as a change of direction, eight times the encoder's noise"""
HOLDS = ("band", "minus", "printed")


class Contact(NamedTuple):
    """What the grasper touches."""

    stiffness: float
    """N m/rad"""
    angle: float
    """rad at the output"""

    def parameters(self, pretension: float = GRASP_PRETENSION) -> dict[str, float]:
        """Rig parameters: Table 2 with this contact."""
        return {
            "contact_stiffness": self.stiffness,
            "contact_angle": self.angle,
            "contact_damping": CONTACT_DAMPING,
            "pretension_top": pretension,
            "pretension_bottom": pretension,
        }


@cache
def contact() -> Contact:
    """The contact with which the nominal chain has the uncompensated errors of Fig. 11."""
    wanted = math.radians(UNCOMPENSATED.degrees)
    stiffness = UNCOMPENSATED.torque / wanted  # the torque error is the contact's answer to the position error

    def excess(angle: float) -> float:
        run = last_cycle(uncompensated([Contact(stiffness, angle).parameters()]))
        return float(np.max(np.abs(run.position_error))) - wanted

    return Contact(stiffness, brentq(excess, 1.0, 2.4, xtol=1e-5))


def uncompensated(rigs: Sequence[Mapping[str, float]]) -> Run:
    """1.74 sin(2 pi t / 12.5 s) at the drive, from the chain: a quarter of a cycle to settle, then one whole cycle."""
    return follow("chain", rigs, sinusoid())


def truths(nominal: Mapping[str, float], spread: float, count: int = TRUTHS, seed: int = 7) -> list[dict[str, float]]:
    """Rigs around a nominal one.

    Parameters
    ----------
    nominal : mapping of float
        Parameters, SI.
    spread : float
        Uncertain parameters are drawn uniformly within +/- this share of the nominal ones.
    count : int
        Rigs.
    seed : int
        Of the draws.

    Returns
    -------
    list of dict
    """
    rng = np.random.default_rng(seed)
    factors = 1.0 + spread * rng.uniform(-1.0, 1.0, (count, len(UNCERTAIN)))
    return [
        {
            **nominal,
            **{name: nominal.get(name, CIRCUIT[name].default) * f for name, f in zip(UNCERTAIN, row, strict=True)},
        }
        for row in factors
    ]


def noisy(run: Run, rng: np.random.Generator) -> Run:
    """The run as the sensors of the position task see it."""
    std = load_task("PulleyCircuit-Position").sensor_noise
    return Run(
        run.time,
        {n: v + std[n] * rng.standard_normal(v.shape) if n in std else v for n, v in run.signals.items()},
        run.rigs,
    )


class Sine(NamedTuple):
    """offset + amplitude sin(2 pi t / period), wanted at the output; rad and s."""

    amplitude: float
    period: float
    offset: float = 0.0

    def at(self, t: float) -> tuple[float, float, float]:
        """Value and two derivatives."""
        w = 2 * math.pi / self.period
        sine = math.sin(w * t)
        return self.offset + self.amplitude * sine, self.amplitude * w * math.cos(w * t), -self.amplitude * w * w * sine


class Estimate(NamedTuple):
    """Output as estimated from drive angle and drive torque  [samples, mechanisms]."""

    angle: np.ndarray
    torque: np.ndarray


def estimate(nominal: Mapping[str, float], run: Run, hold: str = "band") -> Estimate:
    """Output angle and torque as Eqs. (44)-(47) estimate them from recorded drive signals.

    Parameters
    ----------
    nominal : mapping of float
        Parameters that the estimate believes in.
    run : Run
        Drive angle and torque.
    hold : str
        How delay and transition end. "printed": flag of Eq. (47) as it stands, which never holds; "minus": with its
        lost minus, which holds until the drive's torque changes sign; "band": for the drive's distance between the two
        working lines, Eq. (45) in both directions, as both plants do (`cable_envs.reproduction.zou.fig6`).

    Returns
    -------
    Estimate
        [samples, mechanisms].
    """
    statics = Statics.from_rig(nominal)
    columns = range(run["drive_angle"].shape[1])
    if hold == "band":
        found = [_by_band(statics, run["drive_angle"][:, j], run["drive_torque"][:, j]) for j in columns]
    else:
        found = [
            replay(statics, run["drive_angle"][:, j], run["drive_torque"][:, j], hold == "printed", DEADBAND)[:2]
            for j in columns
        ]
    angle, torque = (np.stack(v, axis=1) for v in zip(*found, strict=True))
    return Estimate(angle, torque)


def _by_band(statics: Statics, drive: np.ndarray, torque: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Hold at each reversal of the drive for the distance between the two working lines at the held torque."""
    lines = {1: statics.working(torque, 1), -1: statics.working(torque, -1)}
    rigid = drive * statics.drive_radius / statics.output_radius
    angle, output = np.empty_like(drive), np.empty_like(drive)
    direction, turning, release = 1 if drive[-1] > drive[0] else -1, drive[0], 0.0
    for k in range(len(drive)):
        if (drive[k] - turning) * direction > 0.0:
            turning = drive[k]
        elif abs(drive[k] - turning) > DEADBAND and k > 0:
            band = [float(statics.inverse(0.0, output[k - 1], side).drive_angle[0]) for side in (1, -1)]
            direction, release, turning = -direction, turning - direction * (band[0] - band[1]), drive[k]
        if k > 0 and release and (release - drive[k]) * direction > 0.0:
            angle[k], output[k] = angle[k - 1], output[k - 1]
            continue
        release = 0.0
        angle[k], output[k] = rigid[k] - lines[direction].elongation_angle[k], lines[direction].output_torque[k]
    return angle, output


def largest(values: np.ndarray) -> np.ndarray:
    """Largest magnitude of each mechanism."""
    return np.max(np.abs(values), axis=0)


def compensated(
    name: str,
    nominal: Mapping[str, float],
    rigs: Sequence[Mapping[str, float]],
    reference: Sine,
    cycles: float = 1.5,
    seed: int | None = 11,
    action_mode: str = "position",
    **gains: float,
) -> Run:
    """The chain under a reference controller with noisy drive signals, through a position servo or by torque.

    Parameters
    ----------
    name : str
        "feedforward-pid" (Eq. (49), Fig. 7) or "uncompensated-pid".
    nominal : mapping of float
        Parameters that the controller believes in.
    rigs : sequence of mapping
        True parameters.
    reference : Sine
        Wanted output angle; it is added to the signals as "reference".
    cycles : float
        Length of the run in periods of the reference.
    seed : int or None
        Of the noise; None: no noise.
    action_mode : str
        "position": the controller commands a servo; "torque": it commands the motor, as Fig. 7 draws it.
    **gains : float
        Of the controller; the torque saturator is set out of reach unless ``grasp_limit`` is given.

    Returns
    -------
    Run
    """
    plant = plant_for("pulley_circuit", "chain")
    p = plant.prepare(np.stack([CIRCUIT.pack(rig) for rig in rigs], axis=1))
    x = plant.rest(p, np.zeros(len(rigs)))
    u = INPUTS.zeros(len(rigs))
    u.mode[:] = [mode.name for mode in plant.action_modes].index(action_mode)
    drives = [
        make_controller(name, "pulley_chain", action_mode, "position", nominal, DT, **{"grasp_limit": 5.0, **gains})
        for _ in rigs
    ]
    rows = {n: plant.row(n) for n in ("drive_angle", "drive_velocity", "drive_torque")}
    std = load_task("PulleyCircuit-Position").sensor_noise
    rng = np.random.default_rng(seed)
    scale = 0.0 if seed is None else 1.0
    names = [s.name for s in plant.signals if not s.name.startswith(("stretch_", "slip_"))]
    steps = round(cycles * reference.period / DT)
    kept = np.empty((steps, len(names), len(rigs)))
    wanted = np.empty((steps, len(rigs)))
    for k in range(steps):
        ref = reference.at(k * DT)
        seen = {n: x[row] + scale * std[n] * rng.standard_normal(len(rigs)) for n, row in rows.items()}
        command = np.array(
            [c.act(k * DT, {n: float(v[j]) for n, v in seen.items()}, ref) for j, c in enumerate(drives)]
        )
        u.command_rate[:] = 0.0 if k == 0 else (command - u.command) / DT
        u.command[:] = command
        plant.advance(x, p, u.rows, 0, len(rigs), SUBSTEPS, DT / SUBSTEPS)
        kept[k], wanted[k] = x[: len(names)], reference.at((k + 1) * DT)[0]
    signals = {name: kept[:, i] for i, name in enumerate(names)}
    return Run(DT * np.arange(1, steps + 1), {**signals, "reference": wanted}, rigs)


def tracking_errors(run: Run) -> Estimate:
    """Wanted less actual angle and torque; the wanted torque is the contact's answer at the wanted angle."""
    return Estimate(
        run["reference"] - run["output_angle"],
        run.contact_torque(run["reference"]) - run.contact_torque(run["output_angle"]),
    )
