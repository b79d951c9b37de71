"""A band around a drum that is driven to and fro, as a `Model`: displacement to band tensions, tensions to force.

    D = T2 - T1, the band's pull on the drum        |D| <= grip(v): beyond it the drum slips under the band
    D = sign(s) p (1 + hardening p / 2),  p = max(|s| - gap / 2, 0) / compliance,  s = x - z     (z: what has slipped)
    F = load_dependent D + coulomb sign(v) + viscous v + zero

A capstan's pull is in proportion to the tension of its slack end (Eytelwein), so it belongs to ``load_dependent``; the
self-energising band has one spring, one play and one slip for both directions. The motion is recorded and slow against
the band's own vibration (some 100 Hz), so all is quasi-static: with the friction set-valued, z is a play operator of
the displacement, which needs no integrator and no step. With pre-sliding, friction builds up over the slip by four
elements (generalised Maxwell-slip, as `cable_envs.effects.presliding_hysteresis`), and z is found by bisection.

The force is predicted from the *recorded* tensions, the tensions from the recorded displacement: each step of the
mechanism is asked by itself. Nulls: F = coulomb sign(v) and D = grip sign(v), a brake with nothing but dry friction.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from cable_envs.core.kernels import jit
from cable_envs.effects import EFFECTS
from cable_envs.plants.drive.plant import PLANT
from diagnosis.data.recording import Record, Recording
from diagnosis.model.hypotheses import Hypothesis
from diagnosis.model.model import Block, Coordinate, Free
from diagnosis.systems.common import augmented_rig, motion_coordinates, plant_values, resample, sample_period
from diagnosis.systems.question import Question, Request

RATE = 64.0
"""Hz to which records are averaged: a force sensor's ringing is above it, the load's rise takes 10 samples."""
RIGID = 1e-9
"""m/N of a band that is taken as rigid: 5 um at 5 kN."""
HARDEST = 1e-3
"""1/N: six times as stiff at 5 kN. The law is of first order in the tension; a spring all of hardening is a play."""
STILL = 0.01
"""Share of the fastest speed over which the sign of a friction turns, so that noise at rest does not switch it."""
ELEMENTS, HALVINGS = 4, 40

PULL = "band_tension_difference"
(GRIP, COULOMB, F_ZERO, D_ZERO, LOAD, GAP, SOFT, HARD, PRE, VISCOUS, BAND_V, EXCESS, STRIBECK_V, UNEVEN, SPRING,
 DELAY) = range(16)  # fmt: skip
PARAMETERS = (
    Free("band_grip", 3e3, 1.0, 1e6, 3e3),
    Free("coulomb", 6e3, 0.0, 1e6, 1e3),
    Free("force_offset", 0.0, -1e5, 1e5, 100.0),
    Free("tension_offset", 0.0, -1e5, 1e5, 100.0),
    Free("load_dependent_friction.coefficient", 0.0, 0.0, 20.0, 1.0),
    Free("backlash.gap", 0.0, 0.0, 0.1, 1e-3),
    Free("cable_elongation.compliance", RIGID, RIGID, 1e-3, 1e-7),
    Free("stiffness_hardening.coefficient", 0.0, 0.0, HARDEST, 1e-4),
    Free("presliding_hysteresis.displacement", 0.0, 0.0, 0.1, 1e-3),
    Free("viscous", 0.0, 0.0, 1e6, 1e3),
    Free("viscous_friction.band", 0.0, 0.0, 1e6, 1e3),
    Free("stribeck_friction.excess", 0.0, 0.0, 1e5, 100.0),
    Free("stribeck_friction.velocity", 0.02, 1e-3, 1.0, 0.01),
    Free("asymmetric_friction.difference", 0.0, -1e5, 1e5, 100.0),
    Free("position_dependent_load.stiffness", 0.0, 0.0, 1e7, 1e4),
    Free("sensor_delay.force", 0.0, 0.0, 0.2, 0.01),
)
"""Rows of `_pulls`: N, N, N, N, 1, m, m/N, 1/N, m, N s/m, N s/m, N, m/s, N, N/m, s. Levels of the band are pulls D."""
_UNITS = ("N", "N", "N", "N", "1", "m", "m/N", "1/N", "m", "N s/m", "N s/m", "N", "m/s", "N", "N/m", "s")
NOMINALS = ("band_grip", "coulomb", "force_offset", "tension_offset")


@jit
def _pulls(p, x, v, out):
    """Pull of the band ``out`` [T, n] for parameter columns p [16, n] along positions x and speeds v [T]."""
    s = np.empty(ELEMENTS)
    for i in range(p.shape[1]):
        gap, soft, hard, width = 0.5 * p[GAP, i], p[SOFT, i], p[HARD, i], p[PRE, i]
        z = x[0]
        s[:] = 0.5
        for t in range(x.shape[0]):
            grip = p[GRIP, i] + p[EXCESS, i] * np.exp(-((v[t] / p[STRIBECK_V, i]) ** 2))
            up, down = grip + max(p[UNEVEN, i], 0.0), grip + max(-p[UNEVEN, i], 0.0)
            if width <= 0.0:
                high = gap + soft * 2.0 * up / (1.0 + np.sqrt(1.0 + 2.0 * hard * up))
                low = gap + soft * 2.0 * down / (1.0 + np.sqrt(1.0 + 2.0 * hard * down))
                z = min(max(z, x[t] - high), x[t] + low)
            else:
                a, b = min(z, x[t]) - width - gap, max(z, x[t]) + width + gap
                for _ in range(HALVINGS):
                    m = 0.5 * (a + b)
                    if _spring(x[t] - m, gap, soft, hard) > _held(s, m - z, width, up, down):
                        a = m
                    else:
                        b = m
                for k in range(ELEMENTS):
                    s[k] = min(max(s[k] + 4.0 * (a - z) / ((k + 1.0) * width), 0.0), 1.0)
                z = a
            pull = _spring(x[t] - z, gap, soft, hard) if width <= 0.0 else _held(s, 0.0, width, up, down)
            out[t, i] = pull + p[BAND_V, i] * v[t] + p[D_ZERO, i]


@jit
def _spring(stretch, gap, soft, hard):
    taken = max(stretch - gap, 0.0) + min(stretch + gap, 0.0)
    linear = abs(taken) / soft
    return np.sign(taken) * linear * (1.0 + 0.5 * hard * linear)


@jit
def _held(s, moved, width, up, down):
    """Friction of the elements, were they moved on."""
    mean = 0.0
    for k in range(ELEMENTS):
        mean += min(max(s[k] + 4.0 * moved / ((k + 1.0) * width), 0.0), 1.0) / ELEMENTS
    return mean * (up + down) - down


class BandBrake:
    """See `diagnosis.model.model.Model`. ``tracks``: (position, speed, direction, pull, period) of each record."""

    def __init__(self, parameters: Sequence[Free], tracks: Sequence[tuple], blocks: Sequence[Block]):
        self.parameters, self.tracks, self.blocks = tuple(parameters), list(tracks), list(blocks)

    def predict(self, values: np.ndarray) -> list[np.ndarray]:
        """Force and pull [T, n] of every record for parameter columns [len(parameters), n]."""
        found = []
        columns = np.ascontiguousarray(values)
        for x, v, way, pull, period in self.tracks:
            force = values[LOAD] * pull[:, None] + values[COULOMB] * way[:, None] + values[F_ZERO]
            force += values[VISCOUS] * v[:, None] + values[SPRING] * (x - x.mean())[:, None]
            band = np.empty((len(x), columns.shape[1]))
            _pulls(columns, x, v, band)
            late = values[DELAY] / period
            found += [_late(force, late), _late(band, late)]
        return found


def _late(series: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """Series [T, n] late by ``steps`` [n], straight lines between samples."""
    if not np.any(steps):
        return series
    at = np.arange(len(series))
    return np.stack([np.interp(at - s, at, c) for s, c in zip(steps, series.T, strict=True)], axis=1)


def prepare(recording: Recording, request: Request) -> Question:
    """What a band brake's recording asks. Raises ConfigurationError where a channel is missing."""
    recording.require(
        "position", "force", "band_tension_1", "band_tension_2", purpose="the model of a band brake"
    )  # fmt: skip
    period = sample_period(recording.records)
    models = {}
    parameters = None
    for use in ("fit", "heldout"):
        parts = [_prepared(record, period) for record in recording.used_for(use)]
        parameters = parameters or _started([p[1] for p in parts])
        models[use] = BandBrake(parameters, [p[0] for p in parts], [b for p in parts for b in p[1]])
    hypotheses = tuple(h for h in _hypotheses() if _wanted(h.name, request))
    values = plant_values(recording, PLANT, request.rig)
    return Question(
        "linear_drive", models["fit"], models["heldout"], NOMINALS, ("force_offset", "tension_offset"), hypotheses,
        {p.name: unit for p, unit in zip(PARAMETERS, _UNITS, strict=True)},
        lambda found, accepted: augmented_rig(PLANT, {**values, **_as_plant(found)}, accepted),
        (f"averaged to {RATE:g} Hz; force from the recorded tensions, tensions from the recorded displacement",),
    )  # fmt: skip


def _as_plant(found: Mapping[str, float]) -> dict[str, float]:
    """The linear drive that comes nearest: its carriage is the drum's surface, its belt the band."""
    lever = found["load_dependent_friction.coefficient"] or 1.0
    soft = found["cable_elongation.compliance"]
    return {
        "coulomb": found["coulomb"] + lever * found["band_grip"] * (lever != 1.0), "viscous": found["viscous"],
        "belt_stiffness": lever / soft if soft > 2 * RIGID else 0.0, "backlash.gap": found["backlash.gap"],
        "stiffness_hardening.coefficient": found["stiffness_hardening.coefficient"] / lever,
    }  # fmt: skip


def _prepared(record: Record, period: float) -> tuple[tuple, list[Block]]:
    names = ("position", "force", "band_tension_1", "band_tension_2")
    time, found = resample(record, period, names)
    step = max(round(1.0 / (RATE * period)), 1)
    count = len(time) // step * step

    def mean(values):
        return values[:count].reshape(-1, step).mean(axis=1)

    time, x, force = mean(time), mean(found["position"].values), mean(found["force"].values)
    pull = mean(found["band_tension_2"].values) - mean(found["band_tension_1"].values)
    good = np.logical_and.reduce([found[n].good for n in names])[:count].reshape(-1, step).all(axis=1)
    v = np.gradient(x, time)
    way = np.clip(v / (STILL * np.abs(v).max()), -1.0, 1.0)
    along = (*motion_coordinates(time, x), Coordinate("band pull", "N", pull))
    blocks = [
        Block(record.name, channel, time, values, good, "N", along, memory=0)
        for channel, values in (("force", force), (PULL, pull))
    ]
    return (x, v, way, pull, step * period), blocks


def _started(blocks: Sequence[Sequence[Block]]) -> tuple[Free, ...]:
    """The parameters, with levels that start at what the record shows while it slides."""
    force, pull = (
        float(np.quantile(np.abs(np.concatenate([pair[k].measured for pair in blocks])), 0.6)) for k in (0, 1)
    )
    starts = {"band_grip": pull, "coulomb": force}
    return tuple(
        Free(p.name, starts.get(p.name, p.start), p.low, p.high, starts.get(p.name, p.scale)) for p in PARAMETERS
    )


def _wanted(name: str, request: Request) -> bool:
    return name not in request.without and (request.only is None or name in request.only)


_PROBES: Mapping[str, tuple[tuple[str, ...], tuple[dict[str, float], ...]]] = {
    "load_dependent_friction": (
        ("load_dependent_friction.coefficient",),
        ({"load_dependent_friction.coefficient": 0.3}, {"load_dependent_friction.coefficient": 2.0, "coulomb": 100.0}),
    ),
    "backlash": (("backlash.gap",), tuple({"backlash.gap": g} for g in (1e-3, 3e-3, 8e-3))),
    "cable_elongation": (
        ("cable_elongation.compliance",), tuple({"cable_elongation.compliance": c} for c in (1e-7, 3e-7, 1e-6)),
    ),
    "stiffness_hardening": (
        ("stiffness_hardening.coefficient", "cable_elongation.compliance"),
        tuple({"stiffness_hardening.coefficient": h, "cable_elongation.compliance": c}
              for h in (1e-4, 6e-4) for c in (3e-7, 1e-6)),
    ),
    "presliding_hysteresis": (
        ("presliding_hysteresis.displacement",),
        tuple({"presliding_hysteresis.displacement": d} for d in (1e-3, 3e-3, 1e-2)),
    ),
    "viscous_friction": (
        ("viscous", "viscous_friction.band"),
        tuple({"viscous": c, "viscous_friction.band": 0.5 * c} for c in (1e3, 3e4)),
    ),
    "stribeck_friction": (
        ("stribeck_friction.excess", "stribeck_friction.velocity"),
        tuple({"stribeck_friction.excess": 300.0, "stribeck_friction.velocity": v} for v in (5e-3, 0.02, 0.08)),
    ),
    "asymmetric_friction": (
        ("asymmetric_friction.difference",), tuple({"asymmetric_friction.difference": d} for d in (-300.0, 300.0)),
    ),
    "position_dependent_load": (
        ("position_dependent_load.stiffness",), ({"position_dependent_load.stiffness": 1e4},),
    ),
    "sensor_delay.force": (("sensor_delay.force",), tuple({"sensor_delay.force": s} for s in (0.01, 0.05))),
}  # fmt: skip
"""Hypothesis -> (what it frees, where it is probed)."""
_SHAPES = ("stribeck_friction.velocity",)


def _hypotheses() -> list[Hypothesis]:
    free = {p.name: p for p in PARAMETERS}
    found = []
    for name, (names, probes) in _PROBES.items():
        effect = EFFECTS[name.split(".")[0]]
        nulls = {n: free[n].start for n in names if n not in _SHAPES}
        if name == "stiffness_hardening":  # a band that hardens is a band that gives
            nulls = {"stiffness_hardening.coefficient": 0.0}
        found.append(Hypothesis(
            name, tuple(free[n] for n in names), tuple((p,) for p in probes), effect.equation, effect.experiment,
            effect.confusable, nulls,
        ))  # fmt: skip
    return found
