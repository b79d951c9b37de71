"""The question of a recording with a user's simulator: its records as models, what may be missing, what is assumed."""

from collections.abc import Mapping, Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np

from cable_envs.core.errors import ConfigurationError, require_known
from cable_envs.diagnosis.data.clocks.even import sample_period
from cable_envs.diagnosis.data.description import OWN
from cable_envs.diagnosis.data.recording import Record, Recording
from cable_envs.diagnosis.model.hypotheses import Travel
from cable_envs.diagnosis.model.model import Block, Coordinate, Free
from cable_envs.diagnosis.model.noise import jitter
from cable_envs.diagnosis.simulators.asking import Moves, Sizes, candidates, known_effects
from cable_envs.diagnosis.simulators.base import Simulator
from cable_envs.diagnosis.simulators.corrected import augmented
from cable_envs.diagnosis.simulators.declaration import Declaration, SimulatorParameter
from cable_envs.diagnosis.simulators.model import PortedModel, Run, Start
from cable_envs.diagnosis.simulators.motion import FIRST, Course, inertia, simulated, steps_of
from cable_envs.diagnosis.systems.common import (
    Sampled,
    at_first,
    held_command,
    motion_coordinates,
    moving_command,
    resample,
    smoothed,
)
from cable_envs.diagnosis.systems.conditions import given, heeded, require_stated
from cable_envs.diagnosis.systems.question import Look, Origin, Question, Request

OFF = 5e-5
"""Share of a sample period by which it may differ from a whole number of the simulator's steps."""
NEAR, WITHIN = 8, 1.1
"""Samples at least from which an output at the start is taken; RMS over the noise up to which a parabola goes through
more of them."""


def look_of(simulator: Simulator) -> Look:
    """What of the records such a model uses: all; commands are no sensors."""
    return Look(told=frozenset(c.name for c in simulator.declaration.commands))


_INSTEAD = {
    "an effect file": "write the law into the simulator",
    "a rig": "simulator.corrected('augmented.yaml') has its numbers and effects",
    "a variant": "declare another simulator",
}


def request_at_ports(
    simulator: Simulator, effects: Sequence[str] | None, without: Sequence[str], others: Mapping[str, Any]
) -> Request:
    """What the caller wants looked for at the ports of a simulator of his own.

    others: "an effect file", "a rig", "a variant" -> what was asked for, or None. Raises ConfigurationError for these,
    and for unknown effects.
    """
    for what, given_ in others.items():
        if given_ is not None:
            raise ConfigurationError(f"{what} does not go with a simulator of your own; {_INSTEAD[what]}")
    for names in (effects or (), without):
        require_known("effect", names, known_effects())
    if effects is not None and set(effects) <= set(without):
        raise ConfigurationError("no effect is left to look for")
    return Request(None if effects is None else tuple(effects), tuple(without), simulator=simulator)


def require_fits(recording: Recording, simulator: Simulator) -> None:
    """ConfigurationError for a recording of something else than the simulator declares, naming what does not fit."""
    d, where = simulator.declaration, recording.path
    if recording.system != OWN:
        raise ConfigurationError(f"{where}: a simulator of your own needs a recording with 'system: {OWN}'")
    for name, channel in recording.channels.items():
        if name not in d.units:
            raise ConfigurationError(
                f"{where}: channel '{name}' is neither a command nor an output of '{d.name}': {', '.join(d.units)}"
            )
        if channel.si_unit != d.units[name]:
            raise ConfigurationError(
                f"{where}: channel '{name}' is in {channel.unit}, and '{d.name}' declares {d.units[name]}"
            )
    recording.require(*(c.name for c in d.commands), purpose=f"running '{d.name}'")
    if not any(o.name in recording.channels for o in d.outputs):
        raise ConfigurationError(
            f"{where}: no output of '{d.name}' was recorded: {', '.join(o.name for o in d.outputs)}"
        )
    every = sample_period(recording.records) / d.period
    if abs(every - round(every)) > OFF * every or round(every) < 1:
        raise ConfigurationError(
            f"{where}: a sample every {sample_period(recording.records):.6g} s is no whole number of the steps of "
            f"'{d.name}', {d.period:g} s; declare another period"
        )


def prepare(recording: Recording, request: Request) -> Question:
    """What a recording asks of a user's simulator.

    Parameters
    ----------
    recording : Recording
        Of system "own", with records to fit and records held out.
    request : Request
        What the caller wants looked for, and the simulator.

    Returns
    -------
    Question
        As of every system.

    Raises
    ------
    ConfigurationError
        Where recording and declaration do not fit, or the simulator fails at its nominal parameters.
    """
    simulator: Simulator = request.simulator
    require_fits(recording, simulator)
    d, inner = simulator.declaration, simulator.inner
    plant: Any = SimpleNamespace(name=d.name, table=d.table, parameters=d.table, effects=SimpleNamespace(aliases={}))
    require_stated(recording, plant)
    every = round(sample_period(recording.records) / d.period)
    runs = {use: [_run(recording, r, d, every, plant) for r in recording.used_for(use)] for use in ("fit", "heldout")}
    base = {**d.nominal, **simulator.terms}
    small = _at_nominal(inner, runs["fit"], base, lambda run, values: steps_of(inner, run.course, values))
    asked, rows = candidates(d, _sizes(recording, inner, runs["fit"], base, small), simulator.terms, request)
    base = {row: p.null for row, p in rows.items()} | base
    nominals = [_free(p) for p in d.parameters if not p.known]
    freed = {p.name: p for h in asked.asked for p in h.free}
    parameters = [*nominals, *(f for name, f in freed.items())]
    held = any(recording.holds(c.name) for c in d.commands)
    models = {use: PortedModel(inner, of, base, parameters, every, small, held) for use, of in runs.items()}
    for run in runs["heldout"]:
        _outputs(inner, run, {**d.nominal, **simulator.terms}, small)
    units = {p.name: p.unit for p in d.parameters} | {row: p.unit for row, p in rows.items()}
    named = {h.name: h for h in asked.asked}
    question = Question(
        OWN, models["fit"], models["heldout"], tuple(p.name for p in nominals), (), asked.asked, units,
        lambda found, accepted: augmented(simulator, {**base, **found}, accepted, rows, named),
        assumed(recording, d), at_rest=True, not_asked=asked.not_asked,
        origins=tuple(_origin(d, p) for p in d.parameters),
    )  # fmt: skip
    return heeded(recording, plant, question)


def _origin(d: Declaration, p: SimulatorParameter) -> Origin:
    status = "stated" if p.known else "fitted"
    return Origin(p.name, p.nominal, p.unit, p.name, status, f"declaration of {d.name}", stated=True)


def _free(p: SimulatorParameter) -> Free:
    scale = max(abs(p.nominal), 1e-3 * (p.high - p.low))
    return Free(p.name, p.nominal, p.low, p.high, scale, p.std)


def _at_nominal(simulator: Simulator, runs: Sequence[Run], base: Mapping[str, float], make: Any) -> Any:
    """What ``make`` gives of the first run; an error of the simulator is named as one at the nominal parameters."""
    values = {**base, **{FIRST + n: start.true({}) for n, start in runs[0].starts.items()}}
    try:
        return make(runs[0], values)
    except ConfigurationError:
        raise
    except Exception as error:
        raise _failed(simulator, error) from error


def _failed(simulator: Simulator, error: Exception | str) -> ConfigurationError:
    said = error if isinstance(error, str) else f"{type(error).__name__}: {error}"
    return ConfigurationError(f"simulator '{simulator.declaration.name}' fails at its nominal parameters: {said}")


def _run(recording: Recording, record: Record, d: Declaration, every: int, plant: Any) -> Run:
    period = every * d.period
    time, seen = resample(record, period, [name for name in recording.channels if name != "time"])
    steps = every * (len(time) - 1)
    commands = {c.name: _course(recording, record, c.name, time[0], d.period, steps) for c in d.commands}
    predicted = [o.name for o in d.outputs if o.name in seen]
    port = next((p for p in d.ports if p.position in seen), None)
    place = port.position if port else predicted[0]
    early = at_first(time, seen[place].values)
    along: tuple[Coordinate, ...] = ()
    if port:
        unit = d.unit_of(place)
        along = motion_coordinates(time, seen[place].values, unit, place)
    first = d.commands[0]
    along = (*along, Coordinate(first.name, first.unit, smoothed(seen[first.name].values, period)[0], first.name))
    blocks = tuple(
        Block(
            record.name,
            n,
            time,
            seen[n].values,
            seen[n].good & ~early,
            d.unit_of(n),
            along,
            sensor=n,
            reading=seen[n].reading,
        )
        for n in predicted
    )
    starts = {o.name: _start(d, o.name, seen, period) for o in d.outputs if o.starts}
    offset = tuple(n for n in predicted if recording.channels[n].offset_free)
    return Run(Course(commands, given(record, plant)), starts, blocks, offset)


def _course(recording: Recording, record: Record, name: str, first: float, period: float, steps: int) -> np.ndarray:
    """What a command was over each step of the simulator [steps]."""
    ends = first + period * np.arange(1, steps + 1)
    if recording.holds(name):
        usable = record.usable(name)
        return held_command(record, name, ends, period, float(record.data[name][usable][0]))
    return moving_command(record, name, ends - 0.5 * period, sample_period(recording.records))


def _start(d: Declaration, name: str, seen: Mapping[str, Sampled], period: float) -> Start:
    """An output at the start of a record: measured, or the slope of a position that was, or 0."""
    position = next((p.position for p in d.ports if p.velocity == name and p.position in seen), "")
    for channel, slope in ((name, False), (position, True)):
        if channel in seen and seen[channel].good[:NEAR].sum() > 3:
            value, error = _at_first(seen[channel], period, int(slope))
            return Start(value, channel, slope, error)
    return Start(0.0)


def _at_first(sampled: Sampled, period: float, order: int) -> tuple[float, float]:
    """(a channel at the start, or its slope there, its standard error), by a parabola through the first samples.

    As many as a parabola goes through within their noise.
    """
    noise, found = jitter(sampled.values[sampled.good]), (0.0, 0.0)
    count = NEAR
    while count <= len(sampled.values):
        good = np.flatnonzero(sampled.good[:count])
        powers = (period * good)[:, None] ** np.arange(3)
        fit, *_ = np.linalg.lstsq(powers, sampled.values[good], rcond=None)
        left = float(np.sqrt(np.mean((sampled.values[good] - powers @ fit) ** 2)))
        if count > NEAR and left > WITHIN * noise:
            break
        spread = np.linalg.pinv(powers.T @ powers)
        found = float(fit[order]), max(noise, left) * float(np.sqrt(max(spread[order, order], 0.0)))
        count *= 2
    return found


def _outputs(
    simulator: Simulator, run: Run, base: Mapping[str, float], small: Mapping[str, float]
) -> dict[str, np.ndarray]:
    """Outputs of a run at the nominal parameters; an error of the simulator is named as one there."""
    values = {**base, **run.course.given, **{FIRST + n: s.true({}) for n, s in run.starts.items()}}
    try:
        out = simulated(simulator, run.course, {n: np.array([float(v)]) for n, v in values.items()}, small)
    except ConfigurationError:
        raise
    except Exception as error:
        raise _failed(simulator, error) from error
    for name, series in out.items():
        if not np.isfinite(series).all():
            raise _failed(simulator, f"output {name} of {run.blocks[0].record} is not finite")
    return out


def _sizes(
    recording: Recording, simulator: Simulator, runs: Sequence[Run], base: Mapping[str, float],
    small: Mapping[str, float],
) -> Sizes:  # fmt: skip
    """What is typical: of the simulator at its nominal parameters, and of the records."""
    d = simulator.declaration
    outputs: dict[str, list[np.ndarray]] = {o.name: [] for o in d.outputs}
    for run in runs:
        for name, series in _outputs(simulator, run, base, small).items():
            outputs[name].append(series[0])
    ports = {}
    for port in d.ports:
        speeds, inertia = outputs[port.velocity], _inertia(simulator, runs[0], base, port, small)
        speed = float(np.sqrt(np.mean(np.concatenate(speeds) ** 2)))
        faster = float(np.sqrt(np.mean(np.concatenate([np.gradient(v, d.period) for v in speeds]) ** 2)))
        travel = Travel.of(outputs[port.position]) if port.position else None
        if speed == 0.0 or (travel is not None and travel.widest == 0.0):
            raise ConfigurationError(
                f"simulator '{d.name}': nothing moves at port '{port.name}' on the records at the nominal parameters"
            )
        ports[port.name] = Moves(inertia * faster, speed, travel)
    measured = {
        o.name: float(max(np.ptp(b.measured[b.good]) for run in runs for b in run.blocks if b.channel == o.name))
        for o in d.outputs if o.name in recording.channels
    }  # fmt: skip
    most = {c.name: float(max(np.max(np.abs(run.course.commands[c.name])) for run in runs)) for c in d.commands}
    for name, size in most.items():
        if size == 0.0:
            raise ConfigurationError(f"{recording.path}: command '{name}' is 0 in all records to fit")
    seconds = max(float(r.time[-1] - r.time[0]) for r in recording.used_for("fit"))
    return Sizes(ports, most, measured, seconds)


def _inertia(simulator: Simulator, run: Run, base: Mapping[str, float], port: Any, small: Mapping[str, float]) -> float:
    values = {**base, **run.course.given, **{FIRST + n: s.true({}) for n, s in run.starts.items()}}
    return float(inertia(simulator, {n: np.array([float(v)]) for n, v in values.items()}, run.course, port, small)[0])


def assumed(recording: Recording, d: Declaration) -> tuple[str, ...]:
    """What nobody has stated, and what is taken for it."""
    found = []
    free = [p.name for p in d.parameters if p.std is None and not p.known]
    if free:
        found.append(f"no standard deviation of {', '.join(free)} is stated: any value within the bounds is as likely")
    lines = [c.name for c in d.commands if not recording.holds(c.name)]
    if lines:
        found.append(f"between samples {', '.join(lines)} goes in a straight line: 'hold: step' is not stated")
    found.append(f"{', '.join(c.name for c in d.commands)} is exactly what the simulator was given, without noise")
    silent = [o.name for o in d.outputs if o.name in recording.channels and o.name not in recording.noise]
    if silent and not recording.used_for("rest"):
        found.append(f"the noise of {', '.join(silent)} is not stated: it is what the best model leaves")
    slopes = {p.velocity: p.position for p in d.ports if p.position in recording.channels}
    for output in d.outputs:
        if output.name in recording.channels and not output.starts:
            found.append(
                f"each record begins at the simulator's own {output.name}: it is not declared to start elsewhere"
            )
        elif output.starts and output.name not in recording.channels:
            how = f"at the slope of {slopes[output.name]}" if output.name in slopes else "at 0"
            found.append(f"{output.name} begins {how}: it was not recorded")
    found += [f"a spring at {p.name} is relaxed at 0" for p in d.ports if p.position]
    return tuple(f"assumed, not stated: {one}" for one in found)


def about_simulator(recording: Recording, simulator: Simulator) -> dict[str, Any]:
    """What an answer's "about" says of the simulator."""
    d = simulator.declaration
    return {"simulator": d.name, "terms": dict(simulator.terms), "assumed": list(assumed(recording, d))}
