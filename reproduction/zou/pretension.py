"""Twelve numbers against pretension (Table 4, Zou 2022): four models, their few free conditions fitted.

Free is what the paper does not print: contact_stiffness (N m/rad) and contact_angle (rad) of the sensor that the
grasper touches. What "torque error" is measured against and over which part of the cycle the means are taken is not
printed either: two readings each (`Reading`). The misfit is the root mean square of the twelve relative errors.

printed   Eqs. (42)-(47) as they stand: no cable goes slack (tensions may be negative), no inertia; fitted nothing else
analytic  the analytic plant: the same closed forms, a slack cable carries nothing
chain     spans and friction contacts: slack, and shaft friction at every idler
bearings  the chain and Coulomb friction in the bearings of driving and driven pulley, proportional to the pretension
shafts    the chain with a shaft friction coefficient that grows with pretension, mu_s = 0.157 (T_pre / 50 N)^p
preload   the chain, with cables tighter than stated by a constant, the same at all three pretensions
offset    the chain, with a zero of the camera's angle that is off by a constant
lag       the chain, with a camera that is late by a constant
both      preload and offset
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import differential_evolution

from cable_envs.plants.circuit.parameters import CIRCUIT
from cable_envs.plants.circuit.statics import Statics
from cable_envs.reproduction.zou.data import PERIOD, PRETENSIONS, TABLE_4
from cable_envs.reproduction.zou.runs import CONTACT_DAMPING, EXPECTED, Run, follow, four_errors, last_cycle, sinusoid

Bounds = Mapping[str, tuple[float, float]]
CONTACT: Bounds = {"contact_stiffness": (0.05, 3.0), "contact_angle": (-2.0, 2.2)}
"""beyond 2.44 rad the grasper never touches the sensor"""
ARM = (0.0, 0.8e-3)
"""m; friction coefficient times radius of a bearing. Idlers on plain shafts: 0.39e-3; a rolling bearing: about 4e-6"""
PRELOAD, OFFSET = (-10.0, 60.0), (-0.4, 0.4)
"""N; rad"""
MU_S = CIRCUIT["shaft_friction"].default
COARSE = 0.02
"""s; control step within a fit: the twelve numbers then differ by at most 1 % from those at 10 ms"""


@dataclass(frozen=True)
class Model:
    """One explanation: how to run it and what it frees beyond the contact."""

    name: str
    label: str
    variant: str
    """"chain", "analytic" or "printed" """
    extra: Bounds

    def bounds(self, expected: str) -> dict[str, tuple[float, float]]:
        """What is free; the bearing of the driving pulley only where the torque is taken from the motor."""
        unused = {"drive_arm"} if expected == "contact" else set()
        return {name: b for name, b in {**CONTACT, **self.extra}.items() if name not in unused}


MODELS = (
    Model("printed", "(a) Eqs. (42)-(47) as printed", "printed", {}),
    Model("analytic", "(a) analytic plant, slack cables", "analytic", {}),
    Model("chain", "(b) chain: slack, shaft friction", "chain", {}),
    Model("bearings", "(c) chain, bearings of P0 and P5", "chain", {"drive_arm": ARM, "output_arm": ARM}),
    Model("shafts", "(c) chain, shaft friction grows", "chain", {"shaft_exponent": (-1.0, 1.0)}),
    Model("preload", "chain, cables tighter than stated", "chain", {"preload": PRELOAD}),
    Model("offset", "chain, zero of the angle off", "chain", {"offset": OFFSET}),
    Model("lag", "chain, late camera", "chain", {"lag": (0.0, 0.3)}),
    Model("both", "chain, tighter and zero off", "chain", {"preload": PRELOAD, "offset": OFFSET}),
)
BY_NAME: Mapping[str, Model] = {m.name: m for m in MODELS}


@dataclass(frozen=True)
class Reading:
    """What the words of Table 4 may mean."""

    expected: str
    """one of `EXPECTED`"""
    half: bool
    """means over the half cycle on the contact's side only"""

    @property
    def label(self) -> str:
        """In words."""
        return f"{'contact' if self.expected == 'contact' else 'M_in R5/R0'}, {'half' if self.half else 'whole'} cycle"


READINGS = tuple(Reading(expected, half) for expected in EXPECTED for half in (True, False))
CHOSEN = READINGS[0]
"""torque: see `zou_runs`; half: "can only measure the output displacement and output torque in every half cycle",
section 3.2"""


@dataclass(frozen=True)
class Fitted:
    """A model with the conditions that suit Table 4 best."""

    model: Model
    reading: Reading
    conditions: Mapping[str, float]
    errors: np.ndarray
    """as TABLE_4"""

    @property
    def misfit(self) -> float:
        return float(misfit(self.errors[None])[0])

    @property
    def best_pretension(self) -> float:
        """N; where the largest position error is smallest."""
        return PRETENSIONS[int(np.argmin(self.errors[:, 0]))]


Fits = Mapping[tuple[str, Reading], Fitted]
"""by model's name and reading"""


def misfit(errors: np.ndarray) -> np.ndarray:
    """Root mean square of the relative errors  [k, 3, 4] -> [k]."""
    return np.sqrt(np.mean((errors / TABLE_4 - 1.0) ** 2, axis=(1, 2)))


def rig(conditions: Mapping[str, float], pretension: float) -> dict[str, float]:
    """Table 2 with a contact at one pretension, and what the conditions change."""
    exponent = conditions.get("shaft_exponent", 0.0)
    friction = MU_S * (pretension / 50.0) ** exponent
    pretension = pretension + conditions.get("preload", 0.0)
    return {
        "contact_stiffness": conditions["contact_stiffness"],
        "contact_angle": conditions["contact_angle"],
        "contact_damping": CONTACT_DAMPING,
        "pretension_top": pretension,
        "pretension_bottom": pretension,
        "shaft_friction": friction,
        "brake_torque": conditions.get("output_arm", 0.0) * 2 * pretension,  # the sum of both tensions, nearly constant
    }


def simulate(model: Model, conditions: Sequence[Mapping[str, float]], dt: float = COARSE) -> Run:
    """One settled cycle for each of some conditions at the three pretensions of Table 4.

    Parameters
    ----------
    model : Model
        How to run it.
    conditions : sequence of mapping
        What the model frees, by name.
    dt : float
        Sampling period, s.

    Returns
    -------
    Run
        Mechanisms [3 x conditions].
    """
    rigs = [rig(c, pretension) for c in conditions for pretension in PRETENSIONS]
    angle = sinusoid(1.25, dt)
    run = printed_equations(rigs, angle, dt) if model.variant == "printed" else follow(model.variant, rigs, angle, dt)
    lag, offset = (np.repeat([c.get(name, 0.0) for c in conditions], len(PRETENSIONS)) for name in ("lag", "offset"))
    if lag.any() or offset.any():
        seen = [np.interp(run.time - late, run.time, y) for late, y in zip(lag, run["output_angle"].T, strict=True)]
        run = Run(run.time, {**run.signals, "output_angle": np.stack(seen, axis=1) + offset}, run.rigs)
    return last_cycle(run, PERIOD)


def errors_of(
    model: Model, conditions: Sequence[Mapping[str, float]], reading: Reading, dt: float = COARSE
) -> np.ndarray:
    """The twelve numbers  [conditions, 3, 4]."""
    arm = np.repeat([c.get("drive_arm", 0.0) for c in conditions], len(PRETENSIONS))
    run = simulate(model, conditions, dt)
    return four_errors(run, reading.expected, reading.half, arm).reshape(len(conditions), len(PRETENSIONS), 4)


def fit(model: Model, reading: Reading, generations: int = 30, seed: int = 1) -> Fitted:
    """Conditions with the smallest misfit to Table 4: differential evolution, a generation simulated at once.

    Parameters
    ----------
    model : Model
    reading : Reading
        What the words of the table mean.
    generations : int
    seed : int
        Of the draws.

    Returns
    -------
    Fitted
    """
    bounds = model.bounds(reading.expected)
    names = list(bounds)

    def cost(columns: np.ndarray) -> np.ndarray:
        return misfit(errors_of(model, [dict(zip(names, x, strict=True)) for x in columns.T], reading))

    found = differential_evolution(
        cost,
        list(bounds.values()),
        vectorized=True,
        updating="deferred",
        popsize=6 * max(len(names) - 1, 1),
        maxiter=generations,
        rng=np.random.default_rng(seed),
        polish=False,
        tol=1e-4,
    )
    conditions = {name: float(v) for name, v in zip(names, found.x, strict=True)}
    return Fitted(model, reading, conditions, errors_of(model, [conditions], reading, 0.01)[0])


def landscape(model: Model, reading: Reading, stiffness: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Misfit over the two conditions of the contact  [angles, stiffnesses]."""
    return np.stack(
        [
            misfit(errors_of(model, [{"contact_stiffness": k, "contact_angle": c} for k in stiffness], reading))
            for c in angle
        ]
    )


def printed_equations(rigs: Sequence[Mapping[str, Any]], angle: np.ndarray, dt: float) -> Run:
    """The paper's theory of the circuit: Eqs. (37)-(45) with the hold of Eq. (47), massless, tensions of either sign.

    At a D the output carries M_ccw(D) moving ccw and M_cw(D) moving cw; between both it holds. The contact's answer is
    piecewise linear, so the angle at which it balances each branch is explicit.

    Parameters
    ----------
    rigs : sequence of mapping
        Parameters of the mechanisms, SI.
    angle : ndarray [samples + 1]
        Of the drive, rad.
    dt : float
        Sampling period, s.

    Returns
    -------
    Run
    """
    s = Statics.from_values(np.stack([CIRCUIT.pack(r) for r in rigs], axis=1))
    stiffness, touch = (np.array([r[name] for r in rigs]) for name in ("contact_stiffness", "contact_angle"))
    stretch = s.tensile_stiffness * s.output_radius
    rest = s.pretension * s.length
    gain = np.array([[1 / s.product[0], s.product[1]], [s.product[0], 1 / s.product[1]]])  # [direction, cable, n]

    def tensions(d: np.ndarray, direction: int) -> tuple[np.ndarray, np.ndarray]:
        return (rest[0] + stretch * d) / s.kappa[direction, 0], (rest[1] - stretch * d) / s.kappa[direction, 1]

    def torque(d: np.ndarray, direction: int) -> np.ndarray:
        top, bottom = tensions(d, direction)
        return s.output_radius * (top * gain[direction, 0] - bottom * gain[direction, 1])

    def balance(rigid: np.ndarray, direction: int) -> np.ndarray:
        """Output angle at which the branch carries the contact."""
        zero = torque(np.zeros_like(rigid), direction)
        slope = torque(np.ones_like(rigid), direction) - zero
        free = rigid + zero / slope
        return np.where(free <= touch, free, (slope * rigid + zero + stiffness * touch) / (slope + stiffness))

    gear = s.drive_radius / s.output_radius
    output = np.zeros(len(rigs))
    kept = np.empty((7, len(angle) - 1, len(rigs)))
    for k, drive in enumerate(angle[1:]):
        rigid = gear * drive
        output = np.minimum(np.maximum(output, balance(rigid, 0)), balance(rigid, 1))
        d = rigid - output
        load = stiffness * np.maximum(output - touch, 0.0)
        ccw, cw = torque(d, 0), torque(d, 1)
        share = np.clip((load - ccw) / np.maximum(cw - ccw, 1e-12), 0.0, 1.0)
        t, b = ((1 - share) * x + share * y for x, y in zip(tensions(d, 0), tensions(d, 1), strict=True))
        speed = np.full(len(rigs), (drive - angle[k]) / dt)
        kept[:, k] = np.full(len(rigs), drive), speed, s.drive_radius * (t - b), output, load, t, b
    names = (
        "drive_angle",
        "drive_velocity",
        "drive_torque",
        "output_angle",
        "output_torque",
        "tension_drive_top",
        "tension_drive_bottom",
    )
    return Run(dt * np.arange(1, len(angle)), dict(zip(names, kept, strict=True)), rigs)
