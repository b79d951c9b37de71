"""`diagnose`: from a recording to a verdict, by steps that can be called by themselves.

    load_recording -> gate -> on_one_clock -> kept_back -> prepare -> told_at_rest -> converged
    -> coarser -> select (refit, score tests, comparison of models by their evidence, what is left)
    -> decided_by_steps -> answer

Records for "heldout" are never fitted, and count as evidence of every model. A recording without any keeps back the
last third of each record.
"""

import time as clock
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cable_envs.core.errors import ConfigurationError
from cable_envs.diagnosis.asked import ask, name_of, request_of
from cable_envs.diagnosis.data.clocks.beats import lines_of
from cable_envs.diagnosis.data.clocks.lines import Lines, without_lines_in_commands
from cable_envs.diagnosis.data.clocks.one_clock import on_one_clock
from cable_envs.diagnosis.data.clocks.sure_times import with_sure_times
from cable_envs.diagnosis.data.recording import Recording, load_recording
from cable_envs.diagnosis.data.thinning import statement, thinned, thinning
from cable_envs.diagnosis.evidence.joint import Joint
from cable_envs.diagnosis.fit.likelihood import refit_nominals
from cable_envs.diagnosis.intake.claims import off_claims
from cable_envs.diagnosis.intake.converged import coarser, converged, decided_by_steps
from cable_envs.diagnosis.intake.gate import Quality, gate
from cable_envs.diagnosis.intake.logged import (
    longer,
    redundant_speeds,
    with_logger,
    without_channels,
    without_spikes,
)
from cable_envs.diagnosis.intake.tracks import POSITIONS
from cable_envs.diagnosis.model.in_lines import InLines
from cable_envs.diagnosis.model.remembered import Remembered
from cable_envs.diagnosis.model.trials import Trials
from cable_envs.diagnosis.model.verdict import Diagnosis
from cable_envs.diagnosis.report.answer import answer, with_estimates
from cable_envs.diagnosis.search import stages
from cable_envs.diagnosis.search.elsewhere import groups_of
from cable_envs.diagnosis.search.known.lines import in_lines, with_lines
from cable_envs.diagnosis.search.known.noise import told_at_rest, with_noise_of_drive
from cable_envs.diagnosis.search.known.sure_samples import with_sure_samples
from cable_envs.diagnosis.search.select import select
from cable_envs.diagnosis.search.selection import Selection
from cable_envs.diagnosis.search.steps import Steps, digest
from cable_envs.diagnosis.simulators.base import Simulator
from cable_envs.diagnosis.simulators.question import about_simulator, look_of, request_at_ports, require_fits
from cable_envs.diagnosis.systems import looked_at, plant_of
from cable_envs.diagnosis.systems.question import Question, Request, stated_of
from cable_envs.effects import Effect
from cable_envs.plants import plant_for
from cable_envs.sim.rigs import Rig


@dataclass(frozen=True)
class Examined:
    """A diagnosis with the question that it answers and the models that it rests on."""

    question: Question
    selection: Selection
    diagnosis: Diagnosis


def diagnose(
    recording: Recording | Path | str,
    *,
    effects: Sequence[str] | None = None,
    without: Sequence[str] = (),
    effect_file: Path | str | Effect | None = None,
    rig: Path | str | Rig | Mapping[str, Any] | None = None,
    variant: str = "",
    simulator: Simulator | None = None,
    seed: int = 0,
    out: Path | str | None = None,
    tell: Callable[[str], None] = lambda text: None,
) -> Diagnosis:
    """What a recording shows that its simulator leaves out.

    Parameters
    ----------
    recording : Recording, Path or str
        A recording (`Recording.from_arrays` makes one of arrays), its YAML file, or the folder that holds it.
    effects, without : sequence of str, optional
        Canonical names of effects to look for only, and not to look for.
    effect_file : Path, str or Effect, optional
        An effect of one's own (`cable_envs.plants.own_effects`), looked for beside the canonical ones.
    rig : Path, str, Rig or Mapping, optional
        A rig (augmented.yaml) whose values and effects replace those of the recording; a mapping is the content of
        such a file, as in the field ``rig`` of an earlier answer.
    variant : str
        "analytic" or "chain": the form of a circuit that is held against it; "": as its rig says, else
        the chain.
    simulator : Simulator, optional
        One of your own (`cable_envs.diagnosis.simulators`), for a recording of system "own": effects are looked for at
        the ports that it declares.
    seed : int
        Of all draws; the same seed gives the same answer.
    out : Path or str, optional
        Folder in which finished steps are kept: an interrupted call goes on from there.
    tell : callable
        Called with what is being done.

    Returns
    -------
    Diagnosis
        Verdict, effects with their gains and parameters, errors, places, notes, and the corrected rig.

    Raises
    ------
    ConfigurationError
        For recordings that cannot answer, and for data that no simulator should be held against.

    Examples
    --------
    ::

        found = diagnose("my-rig/", without=["position_ripple"])
        found.write(Path("answer"))  # diagnosis.json and augmented.yaml
        [(effect.name, effect.confidence) for effect in found.effects]
    """
    return examine(
        recording, effects=effects, without=without, effect_file=effect_file, rig=rig, variant=variant,
        simulator=simulator, seed=seed, out=out, tell=tell,
    ).diagnosis  # fmt: skip


def examine(
    recording: Recording | Path | str,
    *,
    effects: Sequence[str] | None = None,
    without: Sequence[str] = (),
    effect_file: Path | str | Effect | None = None,
    rig: Path | str | Rig | Mapping[str, Any] | None = None,
    variant: str = "",
    simulator: Simulator | None = None,
    seed: int = 0,
    out: Path | str | None = None,
    tell: Callable[[str], None] = lambda text: None,
) -> Examined:
    """`diagnose`, with what its answer rests on.

    Returns
    -------
    Examined
        The question, the selected model, and the diagnosis.
    """
    started = clock.monotonic()
    recording = recording if isinstance(recording, Recording) else load_recording(recording)
    tell(stages.CHECKING)
    if simulator is not None:
        require_fits(recording, simulator)
    look = looked_at(recording) if simulator is None else look_of(simulator)
    quality = gate(recording, look)
    quality.require_usable()
    recording, timed = with_sure_times(recording)
    lines = lines_of(recording)
    recording, brought = on_one_clock(recording)
    recording, averaged = averaged_if_long(recording)
    if averaged:
        lines = replace(lines, ratio=0.0)
        tell(f"averaging {averaged['rows']} rows to {averaged['samples']} samples")
    if simulator is None:
        request = request_of(recording, effects, without, effect_file, rig, variant)
    else:
        request = request_at_ports(
            simulator, effects, without, {"an effect file": effect_file, "a rig": rig, "a variant": variant or None}
        )
    taken = request.rig and sorted(request.rig.items())
    own = None if simulator is None else simulator.digest()
    keep = _Keep(None if out is None else Path(out), (request.only, request.without, taken, effect_file, variant, own))
    one = _searched(recording, request, lines, seed, keep, tell)
    left_out = tuple(with_estimates(fault, one.question, one.selection) for fault in one.selection.redundant)
    if left_out:
        channels = {fault.hypothesis.redundant for fault in left_out}
        tell(f"leaving out {', '.join(sorted(channels))}, which the logger has made")
        recording = without_channels(recording, channels)
        one = _searched(recording, request, lines, seed, keep, tell)
    question, selection = one.question, replace(one.selection, left_out=left_out)
    tell(stages.LOCATING)
    about = {
        "recording": recording.path.name, "system": recording.system, "seed": seed,
        "effects": None if effects is None else list(effects), "without": list(without),
        "effect_file": None if effect_file is None else str(getattr(effect_file, "name", effect_file)),
        "rig": name_of(rig), "variant": variant or None, "averaged": averaged,
        **({} if simulator is None else about_simulator(recording, simulator)),
    }  # fmt: skip
    found = answer(recording, question, selection, quality, one.rng, about)
    one.steps.forget()
    notes = (*filter(None, (averaged and averaged["why"], brought)), *timed, *found.notes)
    found = replace(found, notes=notes, about={**found.about, "seconds": round(clock.monotonic() - started, 1)})
    return Examined(question, selection, found)


class _Keep(NamedTuple):
    """Where finished steps are kept, and what they depend on beside the recording and the seed."""

    out: Path | None
    options: tuple[Any, ...]


class _Searched(NamedTuple):
    """A question with the model that was selected, and what draws and keeps steps for it."""

    question: Question
    selection: Selection
    rng: np.random.Generator
    steps: Steps


def _searched(
    recording: Recording, request: Request, lines: Lines, seed: int, keep: _Keep, tell: Callable[[str], None],
    *, quick: bool = True,
) -> _Searched:  # fmt: skip
    """The question of a recording as it is asked, and the model with the largest evidence.

    quick: whether steps of integration are as long as seems to decide nothing; where it does, all is done again.
    """
    question = _tried(converged(told_at_rest(recording, without_spikes(_with_logger(recording, request, lines)))))
    right = getattr(question.fit, "substeps", None)
    question = coarser(question) if quick else question
    taken = getattr(question.fit, "substeps", None)
    Quality(tuple(off_claims(recording, question))).require_usable()
    question = with_noise_of_drive(recording, with_sure_samples(question))
    rng = np.random.default_rng(seed)
    steps = Steps(keep.out, digest(recording, (*keep.options, seed, taken)), question.hypotheses, rng)
    added = request.simulator is not None and bool(request.simulator.terms)
    bare = steps("without", partial(without_its_effects, recording, request)) if request.rig or added else None
    selection = select(
        question.fit, question.heldout, question.nominals, question.hypotheses, rng, without=bare,
        groups=groups_of(recording, [*question.fit.blocks, *question.heldout.blocks]),
        stated=stated_of(recording, question), tell=tell, keep=steps,
    )  # fmt: skip
    found = [selection.null.fit.values, selection.final.fit.values]
    cycle = selection.bands is not None and taken != right  # of a limit cycle longer steps make another one
    if cycle or decided_by_steps(question, right, found):
        tell("searching again with shorter steps of integration, which decide what was found")
        return _searched(recording, request, lines, seed, keep, tell, quick=False)
    return _Searched(question, selection, rng, steps)


def _with_logger(recording: Recording, request: Request, lines: Lines) -> Question:
    """The question, with what a logger may have done to the data; not where the caller says what is looked for."""
    restored = without_lines_in_commands(recording, lines)
    question = ask(recording, request)
    if lines.ratio:
        question = with_lines(question, ask(restored, request), lines)
    if request.only is not None:
        return question
    try:
        known = isinstance(question.fit, InLines)
        stretched = in_lines(ask(longer(restored), request), lines) if known else ask(longer(recording), request)
    except ConfigurationError:
        stretched = None
    return with_logger(question, stretched, lines, redundant_speeds(recording))


def _tried(question: Question) -> Question:
    """The question with models that predict nothing twice, and for which what their plant refuses is a bad trial."""
    fit, heldout = (Trials(Remembered(model)) for model in (question.fit, question.heldout))
    return replace(question, fit=fit, heldout=heldout)


def averaged_if_long(recording: Recording) -> tuple[Recording, dict[str, Any] | None]:
    """(a long recording with fewer samples, what an answer says of that); a short one as it is, and None.

    So is one whose model uses its samples as they are.
    """
    if not looked_at(recording).averages:
        return recording, None
    how = thinning(recording, POSITIONS)
    if how.every == 1:
        return recording, None
    fewer = thinned(recording, how)
    rows, samples = (sum(len(r.time) for r in one.records if r.use != "rest") for one in (recording, fewer))
    said = {"rows": rows, "period_s": how.period, "samples": samples, "every": how.every}
    return fewer, {**said, "why": statement(recording, fewer, how)}


def without_its_effects(recording: Recording, request: Request) -> dict[str, float] | None:
    """RMS of every channel, SI, under the rig that is given, refitted, without that rig's effects; None if it has none.

    What an effect is called in the plant's own table (a spring at the load) counts as one.
    """
    if request.simulator is not None:
        bare = told_at_rest(recording, ask(recording, replace(request, simulator=request.simulator.plain())))
        return Joint(bare.fit, bare.heldout).left_by(refit_nominals(bare.fit, bare.nominals).fit)
    plant = plant_for(plant_of(recording))
    effects = (*plant.effects.effects.values(), *request.own)
    rows = {e.row(p) for e in effects for p in e.parameters}
    rest = {name: value for name, value in (request.rig or {}).items() if name not in rows}
    if len(rest) == len(request.rig or {}):
        return None
    question = _tried(told_at_rest(recording, ask(recording, replace(request, rig=rest))))
    return Joint(question.fit, question.heldout).left_by(refit_nominals(question.fit, question.nominals).fit)
