"""Samples that the recorded effort makes unsure are left out where all parameters are told better without them.

`cable_envs.diagnosis.systems.drive.unsure` says which samples a step of the effort between two others may have moved.
Whether it did the records say themselves: with the friction that every drive has refitted, what is left there is more
than elsewhere. Samples with the slopes s and noise of the variance q tell sum(s^2) / q of a parameter.
"""

from dataclasses import replace

import numpy as np

from cable_envs.diagnosis.fit.likelihood import raw_residuals
from cable_envs.diagnosis.fit.refit import STEP, Fit, Start, refit
from cable_envs.diagnosis.model.model import Block, Model, learn_whitener
from cable_envs.diagnosis.systems.question import Question

FRICTION = ("coulomb_friction", "viscous_friction")
"""What is refitted beside the nominal parameters."""
LEAST = 0.1
"""Share of a record that is sure at least: of a record that is nowhere sure all samples stay."""
NOTE = (
    "the recorded effort steps between samples, at instants that nobody recorded: what that may have moved does not "
    "count until it is forgotten"
)


def with_sure_samples(question: Question) -> Question:
    """The question without what steps of the effort make unsure, and a note, where that tells more; else as it is."""
    blocks = [*question.fit.blocks, *question.heldout.blocks]
    sure = [_sure(b) for b in blocks]
    if not any(s.sum() < b.good.sum() for b, s in zip(blocks, sure, strict=True)) or not _told_better(question):
        return question
    for block, own in zip(blocks, sure, strict=True):
        block.good[~own] = False
    return replace(question, notes=(*question.notes, NOTE))


def _sure(block: Block) -> np.ndarray:
    """Samples [T] that count where those that are unsure do not."""
    sure = block.good if block.unsure is None else block.good & ~block.unsure
    return sure if sure.sum() >= LEAST * block.good.sum() else block.good


def _told_better(question: Question) -> bool:
    """Whether every parameter of the rig is told better by what is sure: all records to fit together, by channel.

    Steps tell best how late they act, which is the logger's.
    """
    model = question.fit
    friction = [n for h in question.hypotheses if h.canonical in FRICTION for n in h.names]
    of_rig = [name for name in question.nominals if name not in question.nuisance]
    names = tuple(dict.fromkeys((*of_rig, *friction)))
    values = np.array([[p.start] for p in model.parameters])
    left = [b.measured - p[:, 0] for b, p in zip(model.blocks, model.predict(values), strict=True)]
    fit = refit(model, learn_whitener(model.blocks, left, 0), [Start("", names, {})], central=False)[0]
    raw, slopes = raw_residuals(model, fit), _slopes(model, fit)
    told = np.zeros((2, len(names)))  # by all, and by what is sure
    for channel in dict.fromkeys(b.channel for b in model.blocks):
        own = [k for k, b in enumerate(model.blocks) if b.channel == channel]
        for row, pick in zip(told, (lambda b: b.good, _sure), strict=True):
            kept = [pick(model.blocks[k]) for k in own]
            power = np.concatenate([raw[k][rows] for k, rows in zip(own, kept, strict=True)]) ** 2
            squares = sum(np.sum(slopes[k][rows] ** 2, axis=0) for k, rows in zip(own, kept, strict=True))
            row += squares / max(float(np.mean(power)), 1e-300)
    return bool(np.all(told[1] >= told[0]))


def _slopes(model: Model, fit: Fit) -> list[np.ndarray]:
    """Of predictions by free parameter [T, free], block by block."""
    names = [p.name for p in model.parameters]
    columns = np.repeat(np.array([[fit.values[n]] for n in names]), 1 + len(fit.free), axis=1)
    steps = np.array([STEP * max(abs(fit.values[n]), model.parameters[names.index(n)].scale) for n in fit.free])
    for k, name in enumerate(fit.free):
        columns[names.index(name), 1 + k] += steps[k]
    return [(p[:, 1:] - p[:, :1]) / steps for p in model.predict(columns)]
