"""What is measured of a trial, each as one number per rig: 0 is perfect."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import pairwise

import numpy as np

from benchmarks.properties.rigs import KEPT, LIMITS, Trial, second_at_rest
from cable_envs.physics.contact import tension_ratio
from cable_envs.physics.hole_ratio import EXACT, hole_ratio
from cable_envs.plants.base import Plant, Signal

FINER = 20
"""How much shorter the steps are that a run is compared with."""

MOST = 0.01
"""Largest difference that a result may have."""

NUDGE = 1e-4
"""Relative change of every parameter that asks whether a rig determines its motion: nobody knows them so well."""

NUDGES = (*((NUDGE, seed) for seed in range(8)), (1e-6, 0), (1e-6, 1), (1e-9, 0), (1e-9, 1))
"""What is asked: (size, seed of the signs) of changes. Eight directions, since one may miss the edge that a rig stands
at; and far smaller ones, which still move what is chaotic."""

SMALLEST = {"m": 1e-5, "rad": 2e-4, "N": 5e-3, "N m": 1e-4}
"""By unit: a hundredth of what a task's reward calls a small error. What moves less is compared with this."""


def compared(name: str) -> bool:
    """Whether a signal is compared: positions and forces, but not those of the motor.

    Its torque jumps where the drive turns round, by the friction of its gear: there is no difference to be small.
    """
    shown = name.endswith(("_position", "_angle", "_tension", "_torque")) or name.startswith(
        ("tension_", "pitch_tension")
    )
    return shown and not name.startswith("motor_")


FORCES = {"N": ("drive_tension", "tension_drive_top", "tension_drive_a"), "N m": ("drive_torque",)}
"""By unit, signals whose size a difference is compared with: that which a plant has of the forces at the drive."""


def yardstick(plant: Plant, signal: Signal) -> str:
    """The signal whose size a difference of a signal is compared with; empty where the plant shows none.

    Of a position itself, of a tension or torque that at the drive. What a servo asks for moves the drive and its
    friction too, with cables that barely pull: it is compared with itself.
    """
    if signal.unit in ("m", "rad") or signal.name.startswith("servo_"):
        return signal.name
    names = [s.name for s in plant.signals]
    return next((name for name in FORCES[signal.unit] if name in names), "")


def step_error(trial: Trial, coarse: np.ndarray, fine: np.ndarray) -> np.ndarray:
    """Worst signal's difference (root mean square) between steps and `FINER` times shorter ones, shape (n,).

    Positions relative to how much they move, tensions and torques to the size of those at the drive; at least
    `SMALLEST`.
    """
    plant, worst = trial.plant, np.zeros(trial.values.shape[1])
    for row, signal in enumerate(plant.signals):
        if compared(signal.name):
            name = yardstick(plant, signal)
            size = fine[:, plant.row(name)] if name else _wound(trial, fine)
            if signal.unit in ("m", "rad"):
                size = size - size.mean(axis=0)
            worst = np.maximum(
                worst, _rms(coarse[:, row] - fine[:, row]) / np.maximum(_rms(size), SMALLEST[signal.unit])
            )
    return worst


def _wound(trial: Trial, out: np.ndarray) -> np.ndarray:
    """Torque at the yaw drive of a wrist, which shows the tensions there alone, shape (T, n)."""
    plant = trial.plant
    radius = trial.values[plant.parameters.names.index("yaw_radius")]
    return radius * (out[:, plant.row("tension_drive_a")] - out[:, plant.row("tension_drive_b")])


def nudged(plant: Plant, values: np.ndarray) -> Iterator[np.ndarray]:
    """Rigs, shape (len(plant.parameters), n), with every parameter a little more or less, for each of `NUDGES`.

    Motion is determined by a rig where none of them changes it by more than `MOST`. A limit cycle of a servo, or a load
    that stands at the edge of breaking away, is not: no step settles what the parameters leave open.
    """
    for size, seed in NUDGES:
        other = values.copy()
        ways = np.random.default_rng(seed).choice((-1.0, 1.0), len(values))
        for row, (name, way) in enumerate(zip(plant.parameters.names, ways, strict=True)):
            if name not in KEPT and name not in LIMITS:
                declared = plant.parameters[name]
                other[row] = np.clip(values[row] * (1.0 + size * way), declared.low, declared.high)
        yield other


def converged(trial: Trial, coarse: np.ndarray, fine: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(`step_error`, whether the rig determines its motion), shape (n,) each; the second is asked above `MOST` only."""
    error = step_error(trial, coarse, fine)
    sure = np.ones(len(error), bool)
    late = np.flatnonzero(error > MOST)
    if len(late):
        part = trial.of(late)
        for values in nudged(part.plant, part.values):
            change = step_error(part, replace(part, values=values).run(trial.substeps * FINER), fine[:, :, late])
            sure[late] &= change <= MOST
    return error, sure


def _rms(values: np.ndarray) -> np.ndarray:
    return np.sqrt(np.mean(values**2, axis=0))


def pushed(trial: Trial, coarse: np.ndarray, fine: np.ndarray) -> np.ndarray:
    """Most negative tension, N, shape (n,): cables do not push."""
    rows = [row for row, signal in enumerate(trial.plant.signals) if "tension" in signal.name]
    return np.maximum(0.0, -coarse[:, rows].min(axis=(0, 1)))


def outside_contact(trial: Trial, coarse: np.ndarray, fine: np.ndarray) -> np.ndarray:
    """How far the tensions of two sides of a contact are outside 1/n to n, as a share of it, shape (n,)."""
    if trial.plant.name in _PAIRS:
        return _of_pairs(trial, coarse)
    if "span_tension_1" in [s.name for s in trial.plant.signals]:
        return _of_series(trial, coarse)
    return _LAWS[trial.plant.name.split("_")[-1]](trial, coarse)


def _of_series(trial: Trial, out: np.ndarray) -> np.ndarray:
    """At every contact of a series: each ratio to the limit of its contact at its speed."""
    plant, names = trial.plant, trial.plant.parameters.names
    rows = {s.name: out[:, row] for row, s in enumerate(plant.signals)}
    value = dict(zip(names, trial.values, strict=True))
    inner = [rows[name] for name in rows if name.startswith("span_tension")]
    tensions = [rows["drive_tension"], *inner, rows["load_tension"]]
    worst = np.zeros(out.shape[2])
    for h, (a, b) in enumerate(pairwise(tensions), start=1):
        if "bend" in rows:
            limit = np.exp(value["friction_coefficient"] * rows["bend"] / (len(tensions) - 1))
        else:
            limit = _hole_limit(value, h, rows[f"slip_velocity_{h}" if h < len(tensions) - 1 else "load_velocity"])
        taut = np.maximum(a, b) > 1e-9
        ratio = np.where(taut, np.maximum(a, b) / np.maximum(np.minimum(a, b), 1e-12), 1.0)
        worst = np.maximum(worst, (ratio / limit - 1.0).max(axis=0))
    return np.maximum(worst, 0.0)


def _hole_limit(value: dict[str, np.ndarray], hole: int, speed: np.ndarray) -> np.ndarray:
    """Limit of hole 1, 2, ... at a speed [T, n]; without bending stiffness, which a series' rigs do not have."""
    own = "" if hole == 1 else f"_{hole}"
    wrap, rho, mu = (
        value[f"{name}{own}" if f"{name}{own}" in value else name]
        for name in ("wrap_angle", "radius_ratio", "friction_coefficient")
    )
    rubs = mu + value["extrusion_gain"] * np.abs(speed) ** value["extrusion_exponent"]
    return np.vectorize(tension_ratio)(rho * (1.0 + value["extrusion_delta"]), rubs, wrap)


def _of_hole(trial: Trial, out: np.ndarray) -> np.ndarray:
    plant, names = trial.plant, trial.plant.parameters.names
    t1, t2 = out[:, plant.row("drive_tension")], out[:, plant.row("load_tension")]
    speed = out[:, plant.row("load_velocity")]
    worst = np.zeros(t1.shape[1])
    for k in range(t1.shape[1]):
        q = dict(zip(names, trial.values[:, k], strict=True))
        for a, b, v in zip(t1[:, k], t2[:, k], speed[:, k], strict=True):
            n = hole_ratio(
                EXACT, v, q["wrap_angle"], q["radius_ratio"], q["friction_coefficient"], q["extrusion_delta"],
                q["extrusion_gain"], q["extrusion_exponent"], q["bending_rigidity"],
                q["radius_ratio"] * q["cable_radius"], a, b,
            )  # fmt: skip
            if max(a, b) > 1e-9:
                worst[k] = max(worst[k], max(a, b) / max(min(a, b), 1e-12) / n - 1.0)
                if v != 0.0:  # sliding: exactly at the limit that opposes it
                    worst[k] = max(worst[k], abs((a / b if v > 0.0 else b / a) / n - 1.0))
    return worst


def _of_sheath(trial: Trial, out: np.ndarray) -> np.ndarray:
    plant, names = trial.plant, trial.plant.parameters.names
    t1, t2 = out[:, plant.row("drive_tension")], out[:, plant.row("load_tension")]
    most = trial.values[names.index("friction_coefficient")] * trial.values[names.index("bend_angle")]
    taut = np.maximum(t1, t2) > 1e-9
    share = np.abs(np.log(np.where(taut, t1, 1.0) / np.where(taut, t2, 1.0))) - most
    return np.maximum(share.max(axis=0), 0.0)


def _of_circuit(trial: Trial, out: np.ndarray) -> np.ndarray:
    """At every idler the ratio is within its limit; over the four of a side within their product."""
    from cable_envs.plants.circuit.statics import Statics

    plant = trial.plant
    product = Statics.from_values(trial.values).product
    worst = np.zeros(out.shape[2])
    for side, limit in zip(("top", "bottom"), product, strict=True):
        a, b = out[:, plant.row(f"tension_drive_{side}")], out[:, plant.row(f"tension_output_{side}")]
        taut = np.maximum(a, b) > 1e-9
        ratio = np.where(taut, np.maximum(a, b) / np.maximum(np.minimum(a, b), 1e-12), 1.0)
        worst = np.maximum(worst, (ratio / limit - 1.0).max(axis=0))
    return np.maximum(worst, 0.0)


def _of_pairs(trial: Trial, out: np.ndarray) -> np.ndarray:
    """Of tendons with one contact each: the ratio of the tensions before and behind it, to the limit at its wrap."""
    plant, worst = trial.plant, np.zeros(out.shape[2])
    value = dict(zip(plant.parameters.names, trial.values, strict=True))
    for before, behind, wrap in _PAIRS[plant.name]:
        a, b = out[:, plant.row(before)], out[:, plant.row(behind)]
        bend = np.maximum(wrap(value, out, plant), 0.0) * np.ones(a.shape)
        limit = np.vectorize(tension_ratio)(value["radius_ratio"], value["friction_coefficient"], bend)
        taut = np.maximum(a, b) > 1e-9
        ratio = np.where(taut, np.maximum(a, b) / np.maximum(np.minimum(a, b), 1e-12), 1.0)
        worst = np.maximum(worst, (ratio / limit - 1.0).max(axis=0))
    return np.maximum(worst, 0.0)


def _yaw_wrap(way: float) -> Callable:
    return lambda value, out, plant: value["yaw_wrap"] + way * value["wrap_growth"] * out[:, plant.row("pitch_angle")]


_PAIRS: dict[str, tuple[tuple[str, str, Callable], ...]] = {
    "antagonistic_joint": tuple(
        (f"tension_drive_{side}", f"tension_joint_{side}", lambda value, out, plant: value["wrap_angle"])
        for side in "ab"
    ),
    "wrist": (
        ("tension_drive_a", "tension_end_a", _yaw_wrap(1.0)),
        ("tension_drive_b", "tension_end_b", _yaw_wrap(-1.0)),
        *(
            (f"pitch_tension_drive_{side}", f"pitch_tension_end_{side}", lambda value, out, plant: value["pitch_wrap"])
            for side in "ab"
        ),
    ),
}
"""By plant: tensions at the drive and behind the contact, and the wrap between them, rad."""

_LAWS = {"hole": _of_hole, "sheath": _of_sheath, "circuit": _of_circuit, "chain": _of_circuit}


def holds(trial: Trial) -> np.ndarray:
    """Whether the drive can hold what the cables pull at rest, shape (n,): a motor that is too weak runs backwards.

    It has the torque of its largest current at rest, within the saturator; friction and losses of the gear help.
    """
    plant = trial.plant
    p = plant.prepare(trial.values)
    if plant.drive != "motor":
        return np.ones(trial.values.shape[1], bool)
    r = plant.coefficient_rows.over(p)
    current = np.minimum(r.current_limit, r.supply_voltage / r.resistance)
    most = np.minimum(current * r.torque_constant * r.gear_ratio, r.servo_limit) / r.gear_efficiency + r.drive_friction
    pulls = _pulls(plant, plant.rest(p, trial.start))
    return np.all([most >= np.abs(pull) for pull in pulls], axis=0)


def _pulls(plant: Plant, x: np.ndarray) -> list[np.ndarray]:
    """What the cables pull at each drive, shape (n,) each."""
    if plant.name == "antagonistic_joint":
        return [x[plant.row("tension_drive_a")], x[plant.row("tension_drive_b")]]
    if plant.name == "wrist":
        ends = ("tension_drive", "pitch_tension_drive")
        return [x[plant.row(f"{name}_a")] - x[plant.row(f"{name}_b")] for name in ends]
    return [x[plant.row(next(s.name for s in plant.signals if s.name in ("drive_tension", "drive_torque")))]]


OUTPUTS = ("load_position", "output_angle", "joint_angle", "yaw_angle")
"""Signals that a plant's load moves by; each plant has one of them."""


def rest_moves(trial: Trial) -> np.ndarray:
    """Motion of the load, m or rad, in a minute in which the drive is held, shape (n,)."""
    from cable_envs.core.inputs import INPUTS

    plant, n = trial.plant, trial.values.shape[1]
    p = plant.prepare(trial.values)
    x = plant.rest(p, trial.start)
    u = INPUTS.zeros(n)
    u.mode[:], u.second[:] = plant.number_of(trial.mode), second_at_rest(plant, trial.mode, x)
    if trial.mode.rest_signal:
        u.command[:] = x[plant.row(trial.mode.rest_signal)]
    row = next(r for r, s in enumerate(plant.signals) if s.name in OUTPUTS)
    before = x[row].copy()
    for _ in range(round(60.0 / trial.period)):
        plant.advance(x, p, u.rows, 0, n, trial.substeps, trial.period / trial.substeps)
    return np.abs(x[row] - before)
