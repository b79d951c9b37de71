"""A band around a drum that is driven to and fro, as a `Model`: displacement to band tensions, tensions to force.

The force is predicted from the *recorded* tensions, the tensions from the recorded displacement: each step of the
mechanism is asked by itself. The law is that of the plant ``band_brake`` (`cable_envs.plants.band_brake`), replayed
with the recorded motion. Nulls: F = coulomb sign(v) and D = grip sign(v), a brake with nothing but dry friction.

A record that states its ``band_pretension`` under its conditions grips by that, and one set of parameters is for all:

records to fit            | what is refitted of grip = band_grip + (e^capstan_exponent - 1) band_pretension
------------------------- | -----------------------------------------------------------------------------
state none                | band_grip: the grip is one for all records
state one and the same    | capstan_exponent; band_grip is 0, the grip is in proportion to the pretension
state several             | both
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from cable_envs.diagnosis.data.clocks.even import sample_period
from cable_envs.diagnosis.data.recording import Record, Recording
from cable_envs.diagnosis.model.hypotheses import Candidates, Hypothesis, unsearched
from cable_envs.diagnosis.model.model import Block, Coordinate, Free
from cable_envs.diagnosis.systems.common import fitted_rig, motion_coordinates, plant_values, resample
from cable_envs.diagnosis.systems.conditions import given, usual, with_given
from cable_envs.diagnosis.systems.question import Question, Request
from cable_envs.plants.band_brake.effects import FORMS
from cable_envs.plants.band_brake.plant import PLANT
from cable_envs.sim.replay import replay

RATE = 64.0
"""Hz to which records are averaged: a force sensor's ringing is above it, the load's rise takes 10 samples."""
STILL = 0.01
"""Share of the fastest speed over which the sign of a friction turns, so that noise at rest does not switch it."""
SIMULATED_BY = PLANT.name
"""Whose rigs such a recording's corrected rig is one of."""
PULL = "band_tension_difference"
PRETENSION, GRIP, EXPONENT = "band_pretension", "band_grip", "capstan_exponent"
NOMINALS = ("coulomb", "force_offset", "tension_offset")
"""Refitted beside what the grip is made of."""
APART = 0.02
"""Share of the largest pretension by which others must be less for both parts of the grip to be told apart."""
_SIZES = {GRIP: 3e3, EXPONENT: 1.0, "coulomb": 1e3, "force_offset": 100.0, "tension_offset": 100.0}
"""Sizes of the plant's own parameters."""
_LATE = {f"sensor_delay.{signal}": Free(f"sensor_delay.{signal}", 0.0, 0.0, 0.2, 0.01) for signal in ("force", PULL)}
"""What is looked for of the sensors, and how far: a bias is an offset."""


def _parameters() -> dict[str, Free]:
    own = [Free(p.name, p.default, p.low, p.high, _SIZES[p.name]) for p in PLANT.parameters if p.name in _SIZES]
    effects = [
        Free(f"{form.name}.{p.name}", p.null, p.low, p.high, p.typical)
        for form in FORMS
        for p in form.parameters
        if not p.shape or p.probes
    ]
    return {p.name: p for p in (*own, *effects)} | _LATE


PARAMETERS: Mapping[str, Free] = _parameters()
"""What a refit may move, by name of the plant's table. Levels of the band are pulls D."""


@dataclass(frozen=True)
class Track:
    """What drives the plant in one record, each [T] SI: position, speed, the recorded pull; and its period, s.

    given: parameters that only this record has, SI (its pretension).
    """

    position: np.ndarray
    speed: np.ndarray
    pull: np.ndarray
    period: float
    given: Mapping[str, float] = field(default_factory=dict)


class BandBrake:
    """See `cable_envs.diagnosis.model.model.Model`. ``base``: values of the plant."""

    def __init__(
        self, parameters: Sequence[Free], tracks: Sequence[Track], blocks: Sequence[Block], base: Mapping[str, float]
    ):
        self.parameters, self.tracks, self.blocks = tuple(parameters), list(tracks), list(blocks)
        self.base = dict(base)
        self._rows = [PLANT.table.index(p.name) for p in parameters]

    def predict(self, values: np.ndarray) -> list[np.ndarray]:
        """Force and pull [T, n] of every record for parameter columns [len(parameters), n]."""
        columns = np.repeat(PLANT.table.pack(self.base)[:, None], values.shape[1], axis=1)
        columns[self._rows] = values
        found = []
        for track in self.tracks:
            out = driven(track, columns)
            found += [out[:, 0], out[:, 1]]
        return found


def driven(track: Track, columns: np.ndarray) -> np.ndarray:
    """Force and pull [T, 2, n] of the plant for columns of its table, driven by a record."""
    return replay(
        PLANT, with_given(PLANT, columns, track.given), track.position, track.period, drive="observed",
        signals=("force", PULL), rate=track.speed, disturbance=track.pull, start=track.position[0], substeps=1,
    )  # fmt: skip


def prepare(recording: Recording, request: Request) -> Question:
    """What a band brake's recording asks. Raises ConfigurationError where a channel is missing."""
    recording.require(
        "position", "force", "band_tension_1", "band_tension_2", purpose="the model of a band brake"
    )  # fmt: skip
    period = sample_period(recording.records)
    parts = {use: [_prepared(r, period) for r in recording.used_for(use)] for use in ("fit", "heldout")}
    base = plant_values(recording, PLANT, request.rig) if request.rig else _started(recording, parts["fit"])
    told = [track.given.get(PRETENSION, 0.0) for track, _ in parts["fit"]]
    nominals, how = _grip_by(told, base)
    parameters = [_begun(p, base, request) for p in PARAMETERS.values()]
    models = [
        BandBrake(parameters, [t for t, _ in p], [b for _, pair in p for b in pair], base) for p in parts.values()
    ]
    candidates = _candidates(base, request)
    return Question(
        "linear_drive", models[0], models[1], (*nominals, *NOMINALS), ("force_offset", "tension_offset"),
        candidates.asked,
        {name: PLANT.table[name].unit for name in PARAMETERS},
        lambda found, accepted: fitted_rig(PLANT, {**base, **found}),
        (f"averaged to {RATE:g} Hz; force from the recorded tensions, tensions from the recorded displacement", how),
        not_asked=candidates.not_asked,
    )  # fmt: skip


def _grip_by(told: Sequence[float], base: Mapping[str, float]) -> tuple[tuple[str, ...], str]:
    """(what is refitted of the grip, why in words) for the pretensions of the records to fit, N."""
    if max(told) == 0.0:
        return (GRIP,), f"no record to fit states a {PRETENSION} above 0 N: the grip is one for all records"
    if min(told) < (1.0 - APART) * max(told):
        return (GRIP, EXPONENT), f"the records to fit have several pretensions: {GRIP} is the grip without one"
    if base[EXPONENT] == 0.0:
        return (GRIP,), f"the rig's grip does not depend on the pretension: {EXPONENT} is 0"
    return (EXPONENT,), (
        f"all records to fit have a pretension of {told[0]:.3g} N: the grip is taken as in proportion to it. "
        "Records of another pretension would tell what the band grips without one"
    )


def _started(recording: Recording, parts: Sequence[tuple[Track, Sequence[Block]]]) -> dict[str, float]:
    """Values of the plain brake: levels as the records show them while it slides, and what belongs to their motion."""
    force, pull = (
        float(np.quantile(np.abs(np.concatenate([pair[k].measured for _, pair in parts])), 0.6)) for k in (0, 1)
    )
    position, speed = (np.concatenate([getattr(track, n) for track, _ in parts]) for n in ("position", "speed"))
    tension = usual(recording, PLANT).get(PRETENSION, 0.0)
    grip = {GRIP: 0.0, EXPONENT: float(np.log1p(pull / tension))} if tension > 0.0 else {GRIP: pull}
    return {p.name: p.default for p in PLANT.table} | usual(recording, PLANT) | grip | {
        "coulomb": force, "still_speed": STILL * float(np.abs(speed).max()),
        "position_dependent_load.neutral": float(position.mean()),
    }  # fmt: skip


def _begun(parameter: Free, base: Mapping[str, float], request: Request) -> Free:
    """A parameter that begins at the plant's value; the size of a level is that at which it begins."""
    start = base[parameter.name]
    level = parameter.name in (GRIP, "coulomb") and start > 0.0 and not request.rig
    return replace(parameter, start=start, scale=start if level else parameter.scale)


def _prepared(record: Record, period: float) -> tuple[Track, list[Block]]:
    """What drives the plant in a record, and what it is to predict."""
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
    along = (*motion_coordinates(time, x), Coordinate("band pull", "N", pull))
    blocks = [
        Block(record.name, channel, time, values, good, "N", along, memory=0)
        for channel, values in (("force", force), (PULL, pull))
    ]
    return Track(x, v, pull, step * period, given(record, PLANT)), blocks


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
        ("viscous_friction.coefficient", "viscous_friction.band"),
        tuple({"viscous_friction.coefficient": c, "viscous_friction.band": 0.5 * c} for c in (1e3, 3e4)),
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
    **{name: ((name,), tuple({name: s} for s in (0.01, 0.05))) for name in _LATE},
}  # fmt: skip
"""Hypothesis -> (what it frees, where it is probed)."""
_SHAPES = ("stribeck_friction.velocity",)


_ZEROS = {"sensor_bias.force": "force_offset", f"sensor_bias.{PULL}": "tension_offset"}
"""What the nominal parameters do as well."""


def _candidates(base: Mapping[str, float], request: Request) -> Candidates:
    """What the brake of ``base`` may lack."""
    found, refused = [], {}
    for name, (names, probes) in _PROBES.items():
        form = PLANT.effects.effects[name.split(".")[0]]
        free = {n: PARAMETERS[n] for n in names}
        nulls = {n: p.start for n, p in free.items() if n not in _SHAPES}
        if name == "stiffness_hardening":  # a band that hardens is a band that gives
            nulls = {"stiffness_hardening.coefficient": 0.0}
        if any(base[n] != null for n, null in nulls.items()):
            refused[name] = "the rig has it"
        found.append(Hypothesis(
            name, tuple(free.values()), tuple((p,) for p in probes), form.equation, form.experiment,
            form.confusable, nulls, form,
        ))  # fmt: skip
    asked = Candidates(tuple(h for h in found if _wanted(h.name, request))).less(refused)
    others = {name: why for name, why in unsearched(PLANT, tuple(_PROBES), _ZEROS).items() if _wanted(name, request)}
    return asked.and_also(Candidates((), others))


def _wanted(name: str, request: Request) -> bool:
    names = {name, name.split(".")[0]}
    return not names & set(request.without) and (request.only is None or bool(names & set(request.only)))
