"""Exports from another clock: predictions go by its straight lines where the records are better told so.

The noise of the samples says which clock it was (`cable_envs.diagnosis.data.clocks.beats`). A noise that grows and
shrinks slowly with the motion may look like that, so that the refitted simulator is asked as well.
"""

from dataclasses import replace

from cable_envs.diagnosis.data.clocks.lines import Lines, near_jumps
from cable_envs.diagnosis.data.clocks.sure_times import SURE
from cable_envs.diagnosis.fit.likelihood import refit_and_learn
from cable_envs.diagnosis.fit.refit import Start
from cable_envs.diagnosis.model.driven import drives_of
from cable_envs.diagnosis.model.in_lines import InLines
from cable_envs.diagnosis.systems.question import Question


def with_lines(plain: Question, restored: Question, lines: Lines) -> Question:
    """The question with predictions as an export has brought the records from another clock, or without.

    Parameters
    ----------
    plain, restored : Question
        Of the recording as it is, and with its commands without lines
        (`cable_envs.diagnosis.data.clocks.lines.without_lines_in_commands`).
    lines : Lines
        The other clock.

    Returns
    -------
    Question
        With lines where the nominal simulator, refitted, is likelier so by 20 to 1; samples near jumps do not count
        then. Without them where there are none, where the records are not even, and where a recorded position or
        effort drives the simulator: all else has then lost as much as that.
    """
    known = in_lines(restored, lines)
    if known is restored or [len(b.time) for b in plain.fit.blocks] != [len(b.time) for b in known.fit.blocks]:
        return plain
    counted = [block.good.copy() for block in plain.fit.blocks]
    for block, other in zip(plain.fit.blocks, known.fit.blocks, strict=True):
        block.good[:] = other.good
    if _deviance(plain) - _deviance(known) > 2.0 * SURE:
        return known
    for block, good in zip(plain.fit.blocks, counted, strict=True):
        block.good[:] = good
    return plain


def _deviance(question: Question) -> float:
    """Of a refit from what is claimed; controllers of its own drives may have an integral or none."""
    return refit_and_learn(question.fit, [Start("as claimed", question.nominals, {})], rounds=1).deviance


def in_lines(question: Question, lines: Lines) -> Question:
    """The question with predictions that go by straight lines; the same where these are not known.

    Parameters
    ----------
    question : Question
        Of the recording, its commands without lines.
    lines : Lines
        The other clock.
    """
    if not lines.ratio or drives_of(question.fit):
        return question
    models = []
    for model in (question.fit, question.heldout):
        by = [lines.of(block.record, block.time) for block in model.blocks]
        if any(one is None for one in by):
            return question
        models.append(InLines(model, by))
    for block in (*question.fit.blocks, *question.heldout.blocks):
        block.good[near_jumps(block.measured)] = False
    said = f"the samples came from another clock, of a period of {1e3 * lines.period:.4g} ms, by straight lines"
    return replace(
        question, fit=models[0], heldout=models[1], notes=(*question.notes, f"{said}: predictions go by the same lines")
    )
