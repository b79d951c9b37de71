"""What an answer notes beside its verdict, in sentences."""

from collections.abc import Sequence

import numpy as np

from cable_envs.diagnosis.fit.refit import Fit
from cable_envs.diagnosis.intake.after import Suspicion
from cable_envs.diagnosis.intake.logged import CLOCK, DIFFERENCE, LINES
from cable_envs.diagnosis.model.hypotheses import LOGGER
from cable_envs.diagnosis.model.model import Block
from cable_envs.diagnosis.model.verdict import EffectGain
from cable_envs.diagnosis.search.limit_cycles import RUNS
from cable_envs.diagnosis.search.select import BIAS
from cable_envs.diagnosis.search.selection import Selection
from cable_envs.diagnosis.systems.question import Question

FIRST = 5
"""Samples that tell whether a record begins in motion."""


def faulty(selection: Selection, faults: Sequence[EffectGain], seen: Sequence[Suspicion]) -> list[str]:
    """What is wrong with the data, in words."""
    gone = "; it is left out, for the recorded place holds what it does"
    said = [*(one.text for one in seen), *(in_words(f) + (gone if f in selection.left_out else "") for f in faults)]
    if selection.after.cause and selection.more:
        said.append(selection.after.cause)
    slow = selection.after.slow if selection.more else ""
    return [*(f"of the data, not of the rig: {text}" for text in said), *([slow] if slow else [])]


def in_words(fault: EffectGain) -> str:
    """A logger's fault, in a sentence."""
    (estimate,) = fault.parameters.values()
    if fault.hypothesis.name == CLOCK:
        return f"the logger's clock is off by {100.0 * estimate.value:+.3g} %"
    if fault.hypothesis.name == LINES:
        return f"all channels were brought from another clock, of {1e3 * estimate.value:.3g} ms, by straight lines"
    kind, _, channel = fault.hypothesis.name.removeprefix(LOGGER).partition(".")
    channel = channel.replace("_", " ")
    if not fault.hypothesis.of_logger:  # the bias of a sensor that drifts
        return f"{channel}: its zero is off by {estimate.value:.3g} {estimate.unit} on average, and drifts"
    filtered = f"was filtered with a time constant of {1e3 * estimate.value:.3g} ms"
    if LOGGER + kind == DIFFERENCE:
        late = f"{channel} is the difference of two places one sample apart, and so half a sample late"
        return f"{late}, and {filtered}" if estimate.low > 0.0 else late
    return f"{channel} {filtered}"


def constant(biases: Sequence[EffectGain]) -> list[str]:
    """Biases of sensors, or what is like one, that may be how an effect beside them is formulated, in words."""
    alike = [one.hypothesis.name for one in biases if one.hypothesis.canonical != BIAS]
    return [
        *(
            f"{channel.replace('_', ' ')} is off by {size.value:.3g} {size.unit}, by its sensor or because what is "
            "missing has another formulation: no bias is named"
            for bias in biases
            if bias.hypothesis.canonical == BIAS
            for channel, size in bias.parameters.items()
        ),
        *(
            f"{name} is not named: it cannot be distinguished from a sensor's bias, by which another formulation of "
            "what is missing may differ"
            for name in alike
        ),
    ]


def since_it_began(blocks: Sequence[Block], effects: Sequence[EffectGain]) -> list[str]:
    """What a change with time is counted from, where a record begins in motion."""
    moving = list(dict.fromkeys(b.record for b in blocks if _begins_in_motion(b)))
    return [
        f"{one.hypothesis.name} is counted from the beginning of each record; {', '.join(moving)} began in motion, and "
        "what had changed before is in the refitted parameters"
        for one in effects
        if one.hypothesis.drifts and moving
    ]


def _begins_in_motion(block: Block) -> bool:
    """Whether the rig moves in all of the first samples."""
    direction = next((c.values for c in block.along if c.name == "direction"), np.zeros(1))
    return bool(np.all(direction[:FIRST] != 0.0))


def unpredicted(selection: Selection) -> list[str]:
    """Channels for which nothing may be named."""
    return [
        f"{channel.replace('_', ' ')} is predicted worse than by its own mean, so that nothing is named"
        for channel in selection.unpredicted
    ]


def on_bounds(question: Question, fit: Fit) -> list[str]:
    """Parameters that cannot be zero or unlimited, and that the refit drove to an end of what it tries."""
    found = []
    for p in question.fit.parameters:
        if p.name not in question.nominals or p.name in question.nuisance or p.low <= 0.0:
            continue
        end = next((e for e in (p.low, p.high) if np.isclose(fit.values[p.name], e, rtol=1e-6)), None)
        if end is not None and not np.isclose(p.start, end, rtol=1e-6):
            found.append(
                f"{p.name.replace('_', ' ')} ended at {end:.3g} {question.units.get(p.name, '')}, the "
                f"{'least' if end == p.low else 'largest'} value that is tried: more may be missing than is named, and "
                "the corrected rig may be one that cannot be simulated"
            )
    return found


def unseen(selection: Selection) -> list[str]:
    """What was given up because the claim predicts unseen records better."""
    found = []
    if selection.worse:
        found.append("held-out records are predicted better by the model as it was claimed, so that nothing is named")
    if selection.as_claimed:
        found.append(
            "the nominal parameters are left as they were claimed: refitted, they predict held-out records worse"
        )
    return found


def oscillating(selection: Selection) -> list[str]:
    """How to read the errors of a model that oscillates by itself."""
    if selection.bands is None:
        return []
    by = " with it" if selection.accepted else ""
    return [
        f"the simulation{by} oscillates by itself, with a phase that cannot be predicted; so spectra were compared, "
        f"and the errors are those of the mean of {RUNS} runs, in which the oscillation averages out"
    ]
