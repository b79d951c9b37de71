"""Whether the simulation of a question is one: finite, where the rig was, and the same with other steps.

Predictions f of samples with noise s change by d where the step of integration is halved. No effect that imitates the
change can gain more log likelihood by it than sum (d / s)^2 / 2 over all samples, by Cauchy and Schwarz. Below the
logarithm of 20, odds from which a model is preferred to another, the steps decide nothing; above, they are made
shorter as long as that helps. The noise is taken from the samples themselves (`cable_envs.diagnosis.model.noise`), the
values are those that are claimed.

A search simulates the records thousands of times, mostly for slopes. It is done with longer steps where these decide
nothing either, at the claimed values before it and at those that it has found after it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol, cast

import numpy as np

from cable_envs.core.errors import ConfigurationError
from cable_envs.diagnosis.model.model import Block, Model
from cable_envs.diagnosis.model.noise import jitter
from cable_envs.diagnosis.systems.question import Question

WORTH = float(np.log(20.0))
"""Log likelihood that the steps of integration may be worth."""
AT_FIRST = WORTH / 16.0
"""The same of longer steps before a search. What errs with the square of the steps is worth as much more in a model
that needs steps half as long as the claimed one does."""
AS_LARGE = 4.0
"""Times what steps that are short enough are worth in a model that is found, which longer ones may be worth in it: as
much as of an error of first order, of which these are then not short enough either."""
COARSEST = 4
"""How many times as long steps are tried."""
FINEST = 8
"""How many times as many steps are tried: each costs as much time in everything that follows."""
FAR = 1e3
"""Times a channel's largest measurement, beyond which a prediction is no motion of the rig."""
EXACT = 1e-4
"""Share of a channel's standard deviation below which no noise is taken: logs without any are of simulators."""


class Stepped(Model, Protocol):
    """A model that integrates with so many steps in each of its input's."""

    substeps: int

    def resolve(self, substeps: int) -> None:
        """Take so many."""
        ...


@dataclass(frozen=True)
class Steps:
    """What halving the step of integration does.

    Parameters
    ----------
    worth : float
        Log likelihood at most that the change is worth.
    channel : str
        That changes most by its noise.
    share : float
        RMS of its change over its noise.
    """

    worth: float
    channel: str
    share: float


def converged(question: Question) -> Question:
    """The question with steps of integration that decide nothing, and a note where they had to be changed or still do.

    Parameters
    ----------
    question : Question
        Its models are changed in place. Those without steps of their own (``substeps``) are only asked for sense.

    Returns
    -------
    Question
        With a note where steps were made shorter, or are too long still.

    Raises
    ------
    ConfigurationError
        Naming the channel, where the simulation at the claimed values is not finite or far beyond the measurements.
    """
    if not hasattr(question.fit, "substeps"):
        for each in (question.fit, question.heldout):
            _require_sense(each.blocks, _claimed(each))
        return question
    model, heldout = cast(Stepped, question.fit), cast(Stepped, question.heldout)
    least, found = model.substeps, []
    now = _claimed(model)
    while True:
        finer = _with(model, 2 * model.substeps)
        found.append(halved(model.blocks, now, finer))
        if found[-1].worth <= WORTH:
            model.resolve(model.substeps // 2)
            break
        now = finer
        if model.substeps >= FINEST * least:
            break
    if len(found) > 1 and not found[-1].worth < 0.5 * found[0].worth:  # finer ones help nothing
        model.resolve(least)
    if model.substeps > least:
        heldout.resolve(model.substeps)
    _require_sense(model.blocks, now)
    _require_sense(heldout.blocks, _claimed(heldout))
    said = _said(found, model.substeps // least)
    return replace(question, notes=(*question.notes, said)) if said else question


def coarser(question: Question) -> Question:
    """The question with steps of integration that are as long as decides nothing at the claimed values.

    What is found with them is to be shown to `decided_by_steps`.

    Parameters
    ----------
    question : Question
        As of `converged`. Its models are changed in place.

    Returns
    -------
    Question
        The same one.
    """
    if not hasattr(question.fit, "substeps"):
        return question
    model, heldout = cast(Stepped, question.fit), cast(Stepped, question.heldout)
    right = model.substeps
    now, found = _claimed(model), right
    for by in range(1, COARSEST.bit_length()):
        fewer = right >> by
        if fewer < 1 or not halved(model.blocks, _with(model, fewer), now).worth <= AT_FIRST:
            break
        found = fewer
    for each in (model, heldout):
        each.resolve(found)
    return question


def decided_by_steps(question: Question, substeps: int | None, found: Sequence[Mapping[str, float]]) -> bool:
    """Whether steps of integration decide what was found with them, and shorter ones would not as much.

    Parameters
    ----------
    question : Question
        Its models are changed in place, and changed back.
    substeps : int, optional
        Steps in each of the input's that are short enough; None: its models have none of their own.
    found : sequence of Mapping
        Values by name, SI, of each model that was found; what is not there is as it is claimed.

    Returns
    -------
    bool
        Whether with ``substeps`` one of them predicts something else: by more than `WORTH`, and by more than `AS_LARGE`
        times what twice as many steps change.
    """
    model = cast(Stepped, question.fit)
    if substeps is None or model.substeps == substeps:
        return False
    columns = np.array([[one.get(p.name, p.start) for one in found] for p in model.parameters])
    taken, series = model.substeps, []
    with np.errstate(over="ignore", invalid="ignore"):
        for steps in (taken, substeps, 2 * substeps):
            model.resolve(steps)
            series.append(model.predict(columns))
    model.resolve(taken)
    for k in range(len(found)):
        coarse, right, finer = ([values[:, k] for values in one] for one in series)
        err, own = halved(model.blocks, coarse, right).worth, halved(model.blocks, right, finer).worth
        if not err <= max(WORTH, AS_LARGE * own):
            return True
    return False


def halved(blocks: Sequence[Block], coarse: Sequence[np.ndarray], fine: Sequence[np.ndarray]) -> Steps:
    """What predictions [T] of all blocks change from ``coarse`` to ``fine`` steps."""
    worth, worst = 0.0, ("", 0.0)
    for channel in dict.fromkeys(b.channel for b in blocks if b.good.any()):
        power, count = 0.0, 0
        noise = max(_noise(b) for b in blocks if b.channel == channel and b.good.any())
        for b, one, other in zip(blocks, coarse, fine, strict=True):
            if b.channel == channel and b.good.any():
                with np.errstate(over="ignore", invalid="ignore"):
                    power += float(np.sum(((one - other)[b.good] / noise) ** 2))
                count += int(b.good.sum())
        power = power if np.isfinite(power) else np.inf
        worth += 0.5 * power
        share = float(np.sqrt(power / max(count, 1)))
        worst = max(worst, (channel, share), key=lambda w: w[1])
    return Steps(worth, *worst)


def _noise(block: Block) -> float:
    measured = block.measured[block.good]
    return max(jitter(measured), EXACT * float(np.std(measured)))


def _with(model: Stepped, substeps: int) -> list[np.ndarray]:
    model.resolve(substeps)
    return _claimed(model)


def _claimed(model: Model) -> list[np.ndarray]:
    """Predictions [T] of all blocks at the claimed values."""
    with np.errstate(over="ignore", invalid="ignore"):
        return [p[:, 0] for p in model.predict(np.array([[p.start] for p in model.parameters]))]


def _require_sense(blocks: Sequence[Block], predicted: Sequence[np.ndarray]) -> None:
    for b, values in zip(blocks, predicted, strict=True):
        if not b.good.any():
            continue
        most = float(np.max(np.abs(b.measured[b.good])))
        if not np.isfinite(values).all():
            how = "is not finite"
        elif most > 0.0 and np.max(np.abs(values)) > FAR * most:
            how = f"reaches {np.max(np.abs(values)):.3g} {b.unit}, where {most:.3g} {b.unit} were measured at most"
        else:
            continue
        raise ConfigurationError(
            f"{b.record}: the simulation at the claimed values runs away, its {b.channel} {how}: no effect can be "
            "looked for. Check the claimed values and the units of what drives the simulator"
        )


def _said(found: Sequence[Steps], finer: int) -> str:
    """What was found of the steps, in words; empty where they are short enough as they were."""
    last = found[-1]
    made = f"the steps of integration are {finer} times as many" if finer > 1 else ""
    if last.worth <= WORTH:
        return f"{made}: with fewer, {_changes(found[0])}" if made else ""
    still = f"the simulation depends on its steps: with half as long ones {_changes(last)}"
    return f"{made}, and still {still}" if made else still


def _changes(steps: Steps) -> str:
    return f"{steps.channel.replace('_', ' ')} changes by {steps.share:.2g} of its noise"
