"""Which effects are asked of a user's simulator, at its commands, ports and sensors, and at which sizes.

The library's sizes are those of its own rigs. A crane and a watch have others, so sizes here are shares of what the
simulator does on the records at its nominal parameters.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

from cable_envs.core.errors import ConfigurationError
from cable_envs.core.params import ParameterTable
from cable_envs.diagnosis.intake.logged import FILTER, SPEEDS
from cable_envs.diagnosis.model.hypotheses import Candidates, Travel, hypotheses_for
from cable_envs.diagnosis.simulators.declaration import Command, Declaration, ForcePort
from cable_envs.diagnosis.simulators.effects import DROOP, FORMS, OF_COMMANDS, OF_SENSORS, SENSOR_LAG
from cable_envs.diagnosis.simulators.ports import ACTING, OF_PLACE, layout
from cable_envs.diagnosis.systems.question import Request
from cable_envs.effects import EFFECTS, Effect, EffectParameter

SHARE = 0.3
"""Typical size of a force, over the RMS of what moves the port."""
_OF_LIBRARY = ("actuator_lag", "backlash", "command_delay")
_SENSED = ("sensor_delay", "sensor_bias", "sensor_scale", "sensor_rectification")
_LIMITS = (0.5, 0.7, 0.85, 0.97)
"""Probed limits of a command over its largest size."""
_STOPS = (0.3, 3.0, 30.0)
"""Probed stiffnesses of what is met over a typical spring's: a soft body, and a stop."""
NO_PORT = "the simulator declares no port at which a force can be added"
NO_PLACE = "the port declares no position"
NO_SUPPLY = "no full command is declared"


@dataclass(frozen=True)
class Moves:
    """What a port does on the records, at the nominal parameters.

    Parameters
    ----------
    force, speed : float
        RMS of what moves it (inertia times acceleration), and of its velocity.
    travel : Travel, optional
        Where its position goes; None without one.
    """

    force: float
    speed: float
    travel: Travel | None


@dataclass(frozen=True)
class Sizes:
    """What the records and the simulator show of sizes, SI.

    Parameters
    ----------
    ports : mapping of str to Moves
        Of every port.
    commands : mapping of str to float
        Largest size of each command.
    outputs : mapping of str to float
        Range of each output that was recorded.
    seconds : float
        Length of the longest record.
    """

    ports: Mapping[str, Moves]
    commands: Mapping[str, float]
    outputs: Mapping[str, float]
    seconds: float


def known_effects() -> tuple[str, ...]:
    """Names of all effects that can be asked."""
    own = (*FORMS, *OF_COMMANDS, *OF_SENSORS)
    return (*ACTING, *_OF_LIBRARY, *_SENSED, *(effect.name for effect in own))


def candidates(
    declaration: Declaration, sizes: Sizes, terms: Mapping[str, float], request: Request
) -> tuple[Candidates, dict[str, EffectParameter]]:
    """(what may be missing, every parameter of these effects by its row).

    terms: effects that the simulator has already, by row. Raises ConfigurationError where nothing is left to look for.
    """
    found = Candidates()
    rows: dict[str, EffectParameter] = {}
    for place, effects, signals, travel in _places(declaration, sizes):
        wanted = {e.name: e for e in effects if _wanted(e.name, request)}
        parameters = {e.row(p): p for e in wanted.values() for p in e.parameters}
        values = {row: terms.get(row, p.null) for row, p in parameters.items()}
        table = ParameterTable(*(p.declared(e.name) for e in wanted.values() for p in e.parameters))
        plant: Any = SimpleNamespace(
            name=f"{place or 'sensors'} of {declaration.name}", table=table, effects=SimpleNamespace(effects=wanted)
        )
        asked = hypotheses_for(plant, values, {}, signals, travel=travel)
        if place:
            asked = Candidates(
                tuple(replace(h, name=f"{h.name}.{place}") for h in asked.asked),
                {f"{name}.{place}": why for name, why in asked.not_asked.items()},
            )
        found, rows = found.and_also(asked), {**rows, **parameters}
    reasons = {n: why for n, why in _not_asked(declaration, sizes).items() if _wanted(n.partition(".")[0], request)}
    found = found.and_also(Candidates((), reasons))
    if not found.asked:
        raise ConfigurationError("no effect is left to look for")
    return found, rows


def _wanted(name: str, request: Request) -> bool:
    return name not in request.without and (request.only is None or name in request.only)


def _places(
    declaration: Declaration, sizes: Sizes
) -> Iterator[tuple[str, Sequence[Effect], Sequence[str], Travel | None]]:
    """(place, its effects with parameters and sizes there, signals of sensors, travel)."""
    for port in declaration.ports:
        yield port.name, _forces(declaration, port, sizes), (), sizes.ports[port.name].travel
    for command in declaration.commands:
        yield command.name, _of_command(command, sizes.commands[command.name]), (), None
    outputs = {o.name: o.unit for o in declaration.outputs if o.name in sizes.outputs}
    effects = [EFFECTS[name] for name in _SENSED] + list(OF_SENSORS)
    yield "", [_of_sensors(e, outputs, sizes) for e in effects], tuple(outputs), None


def _forces(declaration: Declaration, port: ForcePort, sizes: Sizes) -> list[Effect]:
    moves = sizes.ports[port.name]
    force, speed = SHARE * moves.force, moves.speed
    typical: dict[str, tuple[float, float, float]] = {  # parameter -> typical, low, high
        "coulomb_friction.level": (force, 0.0, 1e3 * force),
        "viscous_friction.coefficient": (force / speed, 0.0, 1e3 * force / speed),
        "quadratic_drag.coefficient": (force / speed**2, 0.0, 1e3 * force / speed**2),
        "stribeck_friction.excess": (force, 0.0, 1e3 * force),
        "stribeck_friction.velocity": (0.05 * speed, 1e-4 * speed, 10.0 * speed),
        "asymmetric_friction.difference": (force, *_both(force)),
        "constant_load.force": (force, *_both(force)),
        "friction_drift.time": (0.5 * sizes.seconds, 1e-2, 1e9),
    }
    if moves.travel is not None:
        way = moves.travel.widest
        typical |= {
            "presliding_hysteresis.displacement": (0.02 * way, 0.0, way),
            "position_dependent_load.stiffness": (2.0 * force / way, 0.0, 1e3 * force / way),
            "position_ripple.force": (force, *_both(force)),
            "unilateral_contact.stiffness": (2.0 * force / way, *_both(force / way)),
            "unilateral_contact.damping": (force / (way * speed), *_both(force / (way * speed))),
            "unilateral_contact.friction": (force / way, *_both(force / way)),
        }
    of = layout(declaration.turns(port)).effects
    names = [n for n in (*ACTING, *(form.name for form in FORMS)) if port.position or n not in OF_PLACE]
    return [_placed(_stiff(_sized(of[name], typical)), port.name) for name in names]


def _stiff(effect: Effect) -> Effect:
    """What is met is looked for soft and hard: nothing holds the simulator to its record, and much lies between."""
    if effect.name != "unilateral_contact":
        return effect
    own = (replace(p, probes=_STOPS) if p.name == "stiffness" else p for p in effect.parameters)
    return replace(effect, parameters=tuple(own))


def _both(size: float) -> tuple[float, float]:
    """Bounds of what may have either sign."""
    return -1e3 * size, 1e3 * size


def _of_command(command: Command, most: float) -> list[Effect]:
    typical = {
        "command_dead_band.width": (0.1 * most, 0.0, 2.0 * most),
        "command_step.step": (0.05 * most, 0.0, 2.0 * most),
        "command_saturation.limit": (most, 0.0, most),
        "backlash.gap": (0.02 * most, 0.0, 2.0 * most),
    }
    # the library asks for a delay where it is named only; a command of somebody else's program is often late
    effects = [EFFECTS["actuator_lag"], replace(EFFECTS["command_delay"], hypothesis=True), *OF_COMMANDS]
    if command.unit in ("m", "rad"):
        effects.append(EFFECTS["backlash"])
    if command.full is None:
        effects.remove(DROOP)
    units = {"command_dead_band": command.unit, "command_step": command.unit, "command_saturation": command.unit,
             "backlash": command.unit}  # fmt: skip
    found = []
    for effect in effects:
        one = _sized(effect, typical)
        if effect.name in units:
            one = replace(one, parameters=tuple(replace(p, unit=units[effect.name]) for p in one.parameters))
        if effect.name == "command_saturation":
            one = replace(one, parameters=tuple(replace(p, probes=_LIMITS) for p in one.parameters))
        found.append(_placed(one, command.name))
    return found


def _of_sensors(effect: Effect, outputs: Mapping[str, str], sizes: Sizes) -> Effect:
    (one,) = effect.parameters
    share = {"sensor_bias": 0.05, "sensor_step": 0.02, "sensor_drift": 0.05 / max(sizes.seconds, 1e-9)}.get(effect.name)
    found = []
    for name, unit in outputs.items():
        if effect is SENSOR_LAG and unit in SPEEDS:
            continue
        size = one.typical if share is None else share * sizes.outputs[name]
        own = one.unit or (f"{unit}/s" if effect.name == "sensor_drift" else unit)
        found.append(replace(one, name=name, unit=own, typical=size))
    return replace(effect, parameters=tuple(found))


def _sized(effect: Effect, typical: Mapping[str, tuple[float, float, float]]) -> Effect:
    found = []
    for p in effect.parameters:
        size = typical.get(f"{effect.name}.{p.name}")
        if size is None:
            found.append(p)
        else:
            one = replace(p, typical=size[0], typical_turning=None, low=size[1], high=size[2])
            found.append(replace(one, null=size[0], null_turning=None) if p.shape else one)
    return replace(effect, parameters=tuple(found))


def _placed(effect: Effect, place: str) -> Effect:
    """The effect with its parameters called after the place."""
    wave = None if effect.wave is None else (f"{place}.{effect.wave[0]}", f"{place}.{effect.wave[1]}")
    own = tuple(replace(p, name=f"{place}.{p.name}", alias="") for p in effect.parameters)
    met = f"{place}.{effect.place}" if effect.place else ""
    return replace(effect, parameters=own, wave=wave, place=met, refuse=None)


def _not_asked(declaration: Declaration, sizes: Sizes) -> dict[str, str]:
    """What the declaration gives no place to, and why."""
    found: dict[str, str] = {}
    if not declaration.ports:
        found |= dict.fromkeys((*ACTING, *(form.name for form in FORMS)), NO_PORT)
    for port in declaration.ports:
        if not port.position:
            found |= {f"{name}.{port.name}": NO_PLACE for name in OF_PLACE}
    for command in declaration.commands:
        if command.full is None:
            found[f"{DROOP.name}.{command.name}"] = NO_SUPPLY
        if command.unit not in ("m", "rad"):
            found[f"backlash.{command.name}"] = "the command is no position, and a gap needs the motion on both sides"
    for output in declaration.outputs:
        if output.name in sizes.outputs and output.unit in SPEEDS:
            found[f"{SENSOR_LAG.name}.{output.name}"] = f"it is asked as {FILTER}.{output.name}"
    return found
