"""What is asked of a recording: the caller's wishes, checked, and the question with something held out."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from cable_envs.core.config import read_yaml
from cable_envs.core.errors import ConfigurationError, require_known
from cable_envs.diagnosis.data.recording import Record, Recording
from cable_envs.diagnosis.simulators.question import prepare as prepare_at_ports
from cable_envs.diagnosis.systems import plant_of, prepare, require_model
from cable_envs.diagnosis.systems.question import Question, Request
from cable_envs.effects import Effect
from cable_envs.plants import plant_for, variants
from cable_envs.plants.own_effects import load_effect
from cable_envs.sim.rigs import Rig, load_rig

KEPT_BACK = 1.0 / 3.0
"""Share of each record that is held out where the recording has no record for it."""


def request_of(
    recording: Recording,
    effects: Sequence[str] | None = None,
    without: Sequence[str] = (),
    effect_file: Path | str | Effect | None = None,
    rig: Path | str | Rig | Mapping[str, Any] | None = None,
    variant: str = "",
) -> Request:
    """What the caller wants looked for, checked against the recording's plant; parameters as of `diagnose`.

    Raises
    ------
    ConfigurationError
        For unknown names, nothing left to look for, and a rig of another plant.
    """
    require_model(recording)
    own = () if effect_file is None else (_own(effect_file),)
    if variant:
        require_known("variant", [variant], variants())
    known = [*plant_for(recording.system).effects.effects, *(e.name for e in own)]
    for names in (effects or (), without):
        require_known("effect", names, known)
    if effects is not None and not effects:
        raise ConfigurationError("no effect is left to look for")
    if effects is not None and set(effects) <= set(without):
        raise ConfigurationError(f"without {', '.join(without)} no effect is left to look for")
    only = None if effects is None else tuple(effects)
    if rig is None:
        return Request(only, tuple(without), own, variant=variant)
    loaded = load_rig(rig, own)
    values = _values_of(recording, rig, loaded)
    return Request(only, tuple(without), own, values, variant or loaded.variant, loaded.contacts)


def name_of(rig: Path | str | Rig | Mapping[str, Any] | None) -> str | None:
    """What an answer calls the rig that it was given."""
    if rig is None:
        return None
    return str(rig.get("name", "rig") if isinstance(rig, Mapping) else getattr(rig, "name", rig))


def _own(effect: Path | str | Effect) -> Effect:
    return effect if isinstance(effect, Effect) else load_effect(effect)


def _values_of(recording: Recording, rig: Path | str | Rig | Mapping[str, Any], loaded: Rig) -> Mapping[str, float]:
    """Numbers that the rig gives, SI; what it leaves at the plant's default says nothing."""
    plant = plant_of(recording)
    if loaded.plant != plant:
        raise ConfigurationError(f"rig '{loaded.name}' belongs to {loaded.plant}, the recording to {plant}")
    values = dict(loaded.values)
    if isinstance(rig, Mapping) or (not isinstance(rig, Rig) and Path(rig).suffix in (".yaml", ".yml")):
        content = rig if isinstance(rig, Mapping) else read_yaml(Path(rig))
        named = set(content.get("parameters") or {})
        aliases = loaded.simulated_by().effects.aliases
        named |= {aliases[full] for full in _dotted_names(content.get("effects") or {}) if full in aliases}
        values = {name: value for name, value in values.items() if name in named}
    return {**values, **loaded.effects}


def _dotted_names(effects: Mapping[str, Any]) -> list[str]:
    from cable_envs.effects import dotted

    return [name for name, _ in dotted(effects)]


def ask(recording: Recording, request: Request) -> Question:
    """The question of a recording (`cable_envs.diagnosis.systems`), with something held out."""
    asked = prepare if request.simulator is None else prepare_at_ports
    if recording.used_for("heldout"):
        return _with_held_shapes(asked(recording, request), request)
    cut, ends = kept_back(recording)
    question = _with_held_shapes(asked(cut, request), request)
    for block in question.heldout.blocks:  # the whole record is run, for the state at the cut; its end is scored
        block.good[block.time < ends[block.record]] = False
    share = f"the last {KEPT_BACK:.0%} of each record is held out: the recording has no record for that"
    return replace(question, notes=(*question.notes, share))


def _with_held_shapes(question: Question, request: Request) -> Question:
    """The question, with a note on what of a user's own effects no refit moves."""
    own = {effect.name for effect in request.own}
    notes = []
    for h in question.hypotheses:
        if h.name in own and h.effect is not None:
            held = [p.name for p in h.effect.parameters if p.shape and h.effect.row(p) not in h.names]
            if held:
                notes.append(
                    f"{', '.join(held)} of {h.name} is not fitted and keeps its value: "
                    "a shape is fitted where its parameter declares probes"
                )
    return replace(question, notes=(*question.notes, *notes))


def kept_back(recording: Recording) -> tuple[Recording, dict[str, float]]:
    """(a recording that fits the first part of each record and holds out the whole, where each is cut, s)."""
    records: list[Record] = []
    ends: dict[str, float] = {}
    for record in recording.used_for("fit"):
        count = int(len(record.time) * (1.0 - KEPT_BACK))
        ends[record.name] = float(record.time[count])
        first = {name: values[:count] for name, values in record.data.items()}
        records += [replace(record, data=first), replace(record, use="heldout")]
    return replace(recording, records=tuple(records)), ends
