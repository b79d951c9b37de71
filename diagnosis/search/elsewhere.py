"""Whether a model holds on records that it was not fitted to: of another kind, and those held out.

Every effect of the last model is asked on each group of records given all others: both models, with it and without it,
are refitted to the others (theta, with the covariance S of its posterior), and the probability is compared that they
give to the group,

    log p(group | others) = -1/2 z' A^-1 z - 1/2 log det A,   A = 1 + J S J',

with what is left of the group z and its slopes J, both whitened. It is the evidence of all records over that of the
others. What the others leave open (a zero of this group alone, an effect that they do not show) costs a model little,
and what they settle and the group contradicts costs it much: that effect is local. A record's initial condition is
solved for in every prediction and is its own.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from cable_envs.diagnosis.data.record import Record
from cable_envs.diagnosis.data.recording import Recording
from cable_envs.diagnosis.evidence.candidates import Candidate, priors
from cable_envs.diagnosis.evidence.joint import Joint
from cable_envs.diagnosis.evidence.marginal import Frame
from cable_envs.diagnosis.fit.refit import Fit, Start, look, refit
from cable_envs.diagnosis.fit.weights import autocorrelation_time
from cable_envs.diagnosis.model.hypotheses import Hypothesis
from cable_envs.diagnosis.model.model import HELD_OUT, Block, Free
from cable_envs.diagnosis.model.verdict import SURE

MOST = 8
"""Groups at the most, those that differ most: eight took a ninth of the time of a diagnosis with eight effects."""
FACTOR = 2.0
"""Speed or travel over that of other records from which records are of another kind: a force that grows with the speed
is then twice that of one that does not, so that neither passes for the other."""
NEAR = 0.1
"""Share of the range of a condition within which its values are of one kind: a frequency that was measured is never
twice the same."""
ITERATIONS = 3
"""Of a refit to the other records, from that to all."""
ROUNDS = 3
"""Of the size of what is left of a group, and the parameters, in turns."""
_OF_ONE_RECORD = "continues"
"""Condition of what was cut from another record (`cable_envs.diagnosis.data.record.cut`)."""
_MOTIONS: tuple[tuple[str, Callable[[np.ndarray], float], tuple[str, str]], ...] = (
    ("speed", lambda v: float(np.sqrt(np.mean(v**2))), ("the slower records", "the faster records")),
    ("position", lambda x: float(np.ptp(x)), ("the records of shorter travel", "the records of longer travel")),
)


@dataclass(frozen=True)
class Group:
    """Records of one kind, and what they are called."""

    label: str
    records: frozenset[str]


def groups_of(recording: Recording, blocks: Sequence[Block]) -> tuple[Group, ...]:
    """Groups of the records that move, of which each is asked given all others.

    Parameters
    ----------
    recording : Recording
        With the conditions of its records.
    blocks : sequence of Block
        Of its models, with the motion as coordinates.

    Returns
    -------
    tuple of Group
        By each condition that has several values; without any by speed and travel, and each record by itself. `MOST` at
        the most, those that differ most first; none where all records are of one kind.
    """
    moving = [r for r in recording.records if r.use != "rest"]
    found = _by_condition(moving) or [*_by_motion(moving, blocks), *_each(moving)]
    everything = frozenset(r.name for r in moving)
    groups: dict[frozenset[str], Group] = {}
    for _, group in sorted(found, key=lambda pair: -pair[0]):
        if group.records != everything:
            groups.setdefault(group.records, group)
    return tuple(groups.values())[:MOST]


def _by_condition(moving: Sequence[Record]) -> list[tuple[float, Group]]:
    """(how much it differs, group) of every value of each condition."""
    found = []
    for name in dict.fromkeys(n for r in moving for n in r.conditions if n != _OF_ONE_RECORD):
        of = {r.name: r.conditions[name] for r in moving if name in r.conditions}
        unit = next((f" {r.units[name]}" for r in moving if r.units.get(name, "1") != "1"), "")
        numbers = [v for v in of.values() if not isinstance(v, str)]
        kinds: list[tuple[float, str, list[float | str]]] = [
            (1.0, text, [text]) for text in dict.fromkeys(v for v in of.values() if isinstance(v, str))
        ]
        for near in _apart(numbers):
            low, high = (f"{v:.4g}" for v in (near[0], near[-1]))
            differs = abs(float(np.mean(near)) - float(np.mean(numbers))) / max(float(np.std(numbers)), 1e-300)
            kinds.append((differs, (low if low == high else f"{low} to {high}") + unit, [*near]))
        for differs, said, values in kinds if len(kinds) > 1 else ():
            records = frozenset(record for record, own in of.items() if own in values)
            found.append((differs, Group(f"{name} = {said}", records)))
    return found


def _apart(numbers: Sequence[float]) -> list[list[float]]:
    """Numbers in groups, where neighbours are further apart than `NEAR` of their range; else at their widest gap."""
    ranked = sorted(set(numbers))
    gaps = np.diff(ranked)
    if not len(gaps):
        return [ranked] if ranked else []
    wide = gaps > NEAR * (ranked[-1] - ranked[0])
    cuts = np.flatnonzero(wide if wide.any() else gaps == gaps.max()) + 1
    return [list(part) for part in np.split(np.array(ranked), cuts)]


def _whole(record: Record) -> str:
    """The record that one was cut from, or its own name."""
    return str(record.conditions.get(_OF_ONE_RECORD, record.name))


def _by_motion(moving: Sequence[Record], blocks: Sequence[Block]) -> list[tuple[float, Group]]:
    """The same of the slow and the fast records, and of those that travel little and far."""
    found = []
    for coordinate, measure, labels in _MOTIONS:
        seen: dict[str, list[np.ndarray]] = {}
        for block in blocks:
            seen.setdefault(block.record, []).extend(
                c.values[block.good] for c in block.along if c.name == coordinate and block.good.any()
            )
        sizes: dict[str, float] = {}
        for record in moving:
            if seen.get(record.name):
                size = measure(np.concatenate(seen[record.name]))
                sizes[_whole(record)] = max(sizes.get(_whole(record), 0.0), size)
        ranked = sorted(sizes, key=lambda name: sizes[name])
        if len(ranked) < 2 or not sizes[ranked[0]] > 0.0 or sizes[ranked[-1]] < FACTOR * sizes[ranked[0]]:
            continue
        steps = [sizes[b] / sizes[a] for a, b in pairwise(ranked)]
        cut = 1 + int(np.argmax(steps))
        for label, names in zip(labels, (ranked[:cut], ranked[cut:]), strict=True):
            records = frozenset(r.name for r in moving if _whole(r) in names)
            found.append((float(np.log(sizes[ranked[-1]] / sizes[ranked[0]])), Group(label, records)))
    return found


def _each(moving: Sequence[Record]) -> list[tuple[float, Group]]:
    """The same of every record by itself."""
    return [
        (0.0, Group(name.rpartition("/")[2], frozenset(r.name for r in moving if _whole(r) == name)))
        for name in dict.fromkeys(map(_whole, moving))
    ]


class _Others:
    """All records but those of a group, as a model."""

    def __init__(self, joint: Joint, of_group: Sequence[bool]):
        self._joint = joint
        self.parameters: Sequence[Free] = joint.parameters
        self.blocks = [
            replace(b, good=np.zeros_like(b.good)) if out else b for b, out in zip(joint.blocks, of_group, strict=True)
        ]

    def predict(self, values: np.ndarray) -> list[np.ndarray]:
        """As `cable_envs.diagnosis.model.model.Model`."""
        return self._joint.predict(values)


def asked_elsewhere(
    joint: Joint, best: Candidate, groups: Sequence[Group], known: Callable[[tuple[Hypothesis, ...]], Fit | None]
) -> dict[str, dict[str, float]]:
    """How every effect of a model fares on each group of records, given all others.

    Parameters
    ----------
    joint : Joint
        All records.
    best : Candidate
        The model. What its logger did to the data is in all models and is not asked.
    groups : sequence of Group
        Of the records.
    known : callable
        Effects -> their refit, from which those to the other records begin; None: from the model's values.

    Returns
    -------
    dict of str to dict
        Effect -> label of the group -> log odds of the model with it over the one without it.
    """
    effects = [h for h in best.effects if not h.of_logger]
    whitener = best.frame.whitener
    models = [best.effects, *(tuple(e for e in best.effects if e is not h) for h in effects)]
    begin = [_start(best, model, known(model)) for model in models]
    found: dict[str, dict[str, float]] = {h.name: {} for h in effects}
    for group in groups if effects else ():
        of_group = [b.record.removesuffix(HELD_OUT) in group.records for b in joint.blocks]
        if not all(_any_good(joint.blocks, of_group, part) for part in (True, False)):
            continue
        looks = look(_Others(joint, of_group), whitener, begin, ITERATIONS)
        full, *without = refit(
            joint, whitener, [Start(one.label, one.free, one.values) for one in looks], 0, central=False
        )  # fmt: skip
        inside = np.concatenate([np.full(len(b.time), own) for b, own in zip(joint.blocks, of_group, strict=True)])
        for h, model, fit in zip(effects, models[1:], without, strict=True):
            if np.isfinite(full.cost) and np.isfinite(fit.cost):
                odds = _odds(joint, best, inside, (best.effects, full), (model, fit))
                found[h.name][group.label] = float(odds)
    return found


def _any_good(blocks: Sequence[Block], of_group: Sequence[bool], inside: bool) -> bool:
    return any(b.good.any() for b, own in zip(blocks, of_group, strict=True) if own is inside)


def _start(best: Candidate, effects: tuple[Hypothesis, ...], known: Fit | None) -> Start:
    """Where a refit with some of the effects begins."""
    added = {n for h in best.effects for n in h.names}
    own = {n for h in effects for n in h.names}
    free = tuple(n for n in best.fit.free if n not in added or n in own)
    values = best.fit.values if known is None else known.values
    return Start("", free, {n: values[n] for n in free})


def _odds(
    joint: Joint, best: Candidate, inside: np.ndarray,
    one: tuple[tuple[Hypothesis, ...], Fit], other: tuple[tuple[Hypothesis, ...], Fit],
) -> float:  # fmt: skip
    """Log odds of two refits to the other records on a group's samples ``inside`` [N]."""
    frame, by_size = best.frame, best.by_size
    share = 1.0
    if not by_size:
        share = _share(frame, *(np.where(inside, fit.residual, 0.0) for _, fit in (one, other)))
    (mine, my_volume), (their, their_volume) = (
        _given_others(joint, frame, model, fit, inside, None if by_size else share) for model, fit in (one, other)
    )  # fmt: skip
    return _over(frame, by_size, mine, their, share) + my_volume - their_volume


def _given_others(
    joint: Joint, frame: Frame, effects: tuple[Hypothesis, ...], fit: Fit, inside: np.ndarray, share: float | None
) -> tuple[np.ndarray, float]:
    """(what is left of the group [N] at the likeliest parameters of all records, what these cost): see the module.

    share: of every sample's information that counts; None: as the size of what is left says, of the group and of the
    others by themselves.
    """
    variances, off = priors(joint, effects, fit)
    units = np.sqrt(variances)
    slopes, left = fit.jacobian * units, fit.residual
    worth = _worth(frame, np.where(inside, 0.0, left), share)[~inside, None]
    others = slopes[~inside]
    precision = (worth * others).T @ others + np.eye(len(units))
    shift = np.linalg.solve(precision, (worth * others).T @ left[~inside] - off / units)
    left = np.where(inside, left - slopes @ shift, 0.0)
    change = np.zeros(len(units))
    for _ in range(1 if share is not None else ROUNDS):
        worth = _worth(frame, left - np.where(inside, slopes @ change, 0.0), share)[inside, None]
        group = slopes[inside]
        whole = precision + (worth * group).T @ group
        change = np.linalg.solve(whole, (worth * group).T @ left[inside])
    volume = 0.5 * float(np.linalg.slogdet(precision)[1] - np.linalg.slogdet(whole)[1])
    return left - np.where(inside, slopes @ change, 0.0), volume - 0.5 * float(change @ precision @ change)


def _worth(frame: Frame, left: np.ndarray, share: float | None) -> np.ndarray:
    """Information of a sample [N] over that of its noise: a share, or by size and correlation of what is left [N]."""
    if share is not None:
        return np.full(frame.count, share)
    found = np.zeros(frame.count)
    for own in _rows(frame).values():
        series, slow = np.concatenate([left[r] for r in own]), autocorrelation_time([left[r] for r in own])
        for r in own:
            found[r] = np.count_nonzero(series) / max(float(series @ series), 1e-300) / slow
    return found


def _rows(frame: Frame) -> dict[str, list[slice]]:
    """Samples of every block, by channel."""
    return {c: [r for b, r in zip(frame.blocks, frame.rows, strict=True) if b.channel == c] for c in frame.channels}


def _share(frame: Frame, one: np.ndarray, other: np.ndarray) -> float:
    """Share of the log odds of two predictions that counts, by what they leave [N] (Kent)."""
    return frame.adjustment(other - one, one if one @ one <= other @ other else other)


def _over(frame: Frame, by_size: bool, one: np.ndarray, other: np.ndarray, share: float) -> float:
    """Log odds of what one prediction leaves [N], 0 where it is not compared, over what another does."""
    if not by_size:
        return 0.5 * share * float(other @ other - one @ one)
    found = 0.0
    for own in _rows(frame).values():
        mine, their = (np.concatenate([left[r] for r in own]) for left in (one, other))
        count = int(np.count_nonzero(mine)) / min(autocorrelation_time([left[r] for r in own]) for left in (one, other))
        if count > 0.0:
            found += 0.5 * count * float(np.log(max(their @ their, 1e-300) / max(mine @ mine, 1e-300)))
    return found


def worse_than_claim(joint: Joint, candidate: Candidate, seen: int, claim: Mapping[str, float]) -> bool:
    """Whether the refit of a model predicts records that it has not seen worse than the model as it was claimed.

    Parameters
    ----------
    joint : Joint
        All records.
    candidate : Candidate
        The model, with the refit of the fitted ones.
    seen : int
        Number of blocks, from the first, that were fitted.
    claim : mapping of str to float
        Values of all parameters as they were claimed, without effects.

    Returns
    -------
    bool
        Whether the odds of the claim are above `SURE`, on the others.
    """
    frame = candidate.frame
    values = np.array([[candidate.fit.values[p.name], claim[p.name]] for p in joint.parameters])
    left = [b.measured[:, None] - p for b, p in zip(joint.blocks, joint.predict(values), strict=True)]
    white = frame.whitener.flat(joint.blocks, left)
    white[: frame.rows[seen].start if seen < len(frame.rows) else None] = 0.0
    if not np.isfinite(white[:, 1]).all():
        return False
    one, other = white.T
    share = 1.0 if candidate.by_size else _share(frame, one, other)
    return -_over(frame, candidate.by_size, one, other, share) > np.log(SURE)
