"""What a model leaves: the discrepancy that its evidence asks for, what channels share, and lines.

Each is one way in which a model may be incomplete; the odds that something is left are those of all of them together.
A tone in one sensor alone, what a coarse sensor rounds, and zeros that drift are nothing of the rig; tones and rounding
are taken out before the rest is looked at. A noise that is stated, or known from a record at rest, says that the sensor
has neither tone nor drift beside it: they are then the rig's, but for mains. A tone that the record at rest shows is
noise. Spectra are asked only where noise limits: what a model is off by is no noise of a sensor.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cable_envs.diagnosis.evidence.beside import as_leftover, beside_noise, most_probable
from cable_envs.diagnosis.evidence.candidates import DOMINANT, SCALES, Candidate, under_its_noise
from cable_envs.diagnosis.evidence.counts import without_counts
from cable_envs.diagnosis.evidence.joint import Joint, sizes_of
from cable_envs.diagnosis.evidence.shared import any_of, by_block, coherences
from cable_envs.diagnosis.evidence.tones import tones, without_tones
from cable_envs.diagnosis.model.features import ELAPSED
from cable_envs.diagnosis.model.leftover import AT_REST, DRIFT, Left, Leftover
from cable_envs.diagnosis.model.model import Block
from cable_envs.diagnosis.model.verdict import SURE, SURE_WHERE_LEARNT

STATED = 0.025
"""Share by which a standard deviation that is stated, or was seen at rest, may be off."""
SIZE = "size of the noise"
TONES = 4
"""Times that tones of sensors are taken out, at most, to see what is left beside them: a hum has harmonics."""


def left_by(joint: Joint, compared: Candidate, bare: Candidate, before: float, stated: Mapping[str, float]) -> Left:
    """What a candidate leaves of all records, under its own noise.

    Parameters
    ----------
    joint : Joint
        All records.
    compared : Candidate
        The model, as it was compared with others.
    bare : Candidate
        The model without effects, compared under the same noise.
    before : float
        What effects that both have explain, as a fall of half the sum of squares.
    stated : mapping of str to float
        Channel -> standard deviation of its noise, where the recording says it.

    Returns
    -------
    Left
        Whether something is left, and of which kinds.
    """
    taken = list[Leftover]()
    as_recorded, joint = joint, without_counts(joint, joint.raw(compared.peak))
    candidate = _again(joint, compared, stated) if compared.by_size or joint is not as_recorded else compared
    for _ in range(TONES):
        left, lines = _left(joint, candidate, compared, bare, before, stated, taken)
        if not lines or compared.by_size:
            break
        taken += lines
        joint = without_tones(joint, joint.raw(candidate.peak), lines)
        candidate = _again(joint, compared, stated)
    of_data = [line for line in taken if line.known != AT_REST]
    if of_data and not (left.log_odds > np.log(SURE) and not left.cause):
        worst, why = max((line.log_odds, _said(line)) for line in of_data)
        return replace(left, log_odds=worst, cause=why) if worst > left.log_odds else left
    return left


def _again(joint: Joint, compared: Candidate, stated: Mapping[str, float]) -> Candidate:
    """A candidate under the noise that it leaves of these records."""
    return under_its_noise(joint, compared.effects, compared.fit, compared.peak, stated, compared.remainder.sizes)


def _left(
    joint: Joint, candidate: Candidate, compared: Candidate, bare: Candidate, before: float,
    stated: Mapping[str, float], taken: Sequence[Leftover],
) -> tuple[Left, list[Leftover]]:  # fmt: skip
    """(what is left, the tones of sensors in it)."""
    frame, raw = candidate.frame, joint.raw(candidate.peak)
    smooth = _smooth(candidate, raw, stated, compared.by_size)
    white = frame.whitener.flat(frame.blocks, raw)
    over = [k for c in frame.channels if (k := _over_noise(candidate, white, c, c in stated)) is not None]
    spectra = () if compared.by_size else (*coherences(frame.blocks, white), *tones(frame.blocks, raw, white, taken))
    known = _known(frame.blocks, stated)
    seen = [*(replace(k, cause="") if k.channel in known and not k.known else k for k in spectra), *over]
    of_rig, of_sensors = ([k for k in seen if bool(k.cause) is sensor] for sensor in (False, True))
    if compared.by_size:
        share = np.inf if compared is bare else _share_of_sizes(joint, candidate, compared, bare, stated)
    else:
        share = _share(compared, bare, before, max([smooth.size, *(k.size for k in of_rig if k.log_odds > 0.0)]))
    physics = float(np.logaddexp(smooth.of_rig, any_of(of_rig)))
    kinds = tuple(sorted([*smooth.kinds, *seen], key=lambda k: -k.log_odds))
    sure = [k for k in of_sensors if k.log_odds - float(np.log(len(seen))) > np.log(SURE)]
    if smooth.drift > max(physics, 0.0):
        return Left(smooth.drift, share, kinds, smooth.cause), sure
    return Left(physics, share, kinds), sure


@dataclass(frozen=True)
class _Smooth:
    """What of the smooth discrepancy is left.

    kinds         | every family by itself
    of_rig, drift | log odds of what may be of the rig, and of zeros that drift
    cause         | that they do, in words; empty where something else is left, too
    size          | what the noise alone would have taken in, as a fall of half the sum of squares
    """

    kinds: list[Leftover]
    of_rig: float
    drift: float = -np.inf
    cause: str = ""
    size: float = 0.0


def _smooth(candidate: Candidate, raw: Sequence[np.ndarray], stated: Mapping[str, float], by_size: bool) -> _Smooth:
    """Families of the discrepancy, under the candidate's noise, or with their own beside them where none is seen so."""
    by_itself = [_by_itself(candidate, k) for k in range(len(candidate.frame.families))]
    nothing = not by_size and candidate.left <= np.log(SURE)
    beside = _beside_noise(candidate, raw, stated) if nothing or _drifts(by_itself) else []
    kinds = [max([k, *_same(k, beside)], key=lambda one: one.log_odds) for k in by_itself]
    drifting, cause = list(dict.fromkeys(kinds[k].channel for k in _drifts(kinds))), ""
    of_sensors = drifting and not _known(candidate.frame.blocks, stated) & set(drifting)
    if of_sensors and not _more_than_drifts(candidate, _drifts(by_itself)):
        cause = "; ".join(f"{_plain(channel)}: {DRIFT}" for channel in drifting)
        beside = [k for k in beside if k.channel not in drifting]  # that tells nothing of what is slow
    most = max([k.log_odds - float(np.log(len(beside))) for k in beside], default=-np.inf)
    size = max(k.size for k in beside) if most > np.log(SURE) else 0.0
    if not cause or most > np.log(SURE):
        return _Smooth(kinds, max(candidate.left, most), size=size)
    drift = max([candidate.left, *(k.log_odds for k in kinds if k.coordinate == ELAPSED)])
    return _Smooth(kinds, most, drift, cause)


def _said(line: Leftover) -> str:
    return f"{_plain(line.channel)}: {line.cause}"


def _share(compared: Candidate, bare: Candidate, before: float, size: float) -> float:
    """What is left over what was to be explained."""
    explained = compared.plain.fit - bare.plain.fit + before
    left = max(compared.best.fit - compared.plain.fit, size)
    return left / explained if explained > 0.0 else np.inf


def _share_of_sizes(
    joint: Joint, candidate: Candidate, compared: Candidate, bare: Candidate, stated: Mapping[str, float]
) -> float:
    """The same of a model that no noise limits: in the channel where most is left, as a share of the squares.

    Of the channels in which the model, or the one without effects, leaves more than the noise: where nothing was to be
    explained, both leave the noise, and its quotient says nothing. A noise that is stated is taken off both.
    """
    raw = joint.raw(candidate.peak)
    off = candidate.frame.raw(candidate.best.weights)
    noise = {**sizes_of(joint.blocks, [r - o for r, o in zip(raw, off, strict=True)]), **stated}
    left, was = (sizes_of(joint.blocks, joint.raw(one.peak)) for one in (compared, bare))
    found = [0.0]
    for channel, size in left.items():
        if max(size, was[channel]) > noise[channel] * np.hypot(1.0, DOMINANT):
            known = stated.get(channel, 0.0) ** 2
            found.append(max(size**2 - known, 0.0) / max(was[channel] ** 2 - known, 1e-300))
    return max(found)


def _more_than_drifts(candidate: Candidate, drifts: Sequence[int]) -> bool:
    """Whether something is seen under a candidate's noise beside what of it are slow waves (numbers of families)."""
    if not drifts:
        return candidate.left > np.log(SURE)
    frame, remainder = candidate.frame, candidate.remainder
    left = remainder.left - frame.explained(most_probable(frame, remainder, drifts))
    beside = replace(candidate, remainder=replace(remainder, left=left, products=frame.products(left)))
    return beside.left > np.log(SURE)


def _beside_noise(candidate: Candidate, raw: Sequence[np.ndarray], stated: Mapping[str, float]) -> list[Leftover]:
    """Families of channels whose noise is learnt, over that noise alone.

    Odds are less than they say where the noise is learnt (`SURE_WHERE_LEARNT`).
    """
    frame, known = candidate.frame, _known(candidate.frame.blocks, stated)
    learnt = [c for c in frame.channels if c not in known]
    found = beside_noise(frame.blocks, frame.families, raw, candidate.remainder.sizes, learnt)
    return [replace(k, log_odds=k.log_odds - SURE_WHERE_LEARNT + float(np.log(SURE))) for k in found]


def _known(blocks: Sequence[Block], stated: Collection[str]) -> set[str]:
    """Channels whose noise is stated, or known from a record at rest: what is beside it is not the sensor's."""
    return {*stated, *(b.channel for b in blocks if b.noise is not None)}


def _drifts(smooth: Sequence[Leftover]) -> list[int]:
    """Numbers of the families that are slow waves, and surely there."""
    return [k for k, kind in enumerate(smooth) if kind.coordinate == ELAPSED and kind.log_odds > np.log(SURE)]


def _same(one: Leftover, others: Sequence[Leftover]) -> list[Leftover]:
    return [k for k in others if (k.channel, k.coordinate) == (one.channel, one.coordinate)]


def _by_itself(candidate: Candidate, family: int) -> Leftover:
    """A family of the discrepancy by itself."""
    frame, model = candidate.frame, candidate.remainder
    best = max((frame.marginal(model, scale, (family,)) for scale in SCALES), key=candidate.over_none)
    odds = candidate.over_none(best) - float(np.log(len(SCALES)))
    return as_leftover(frame, model, best, family, (odds, best.fit - candidate.plain.fit))


def _over_noise(candidate: Candidate, white: np.ndarray, channel: str, stated: bool) -> Leftover | None:
    """How much more a channel leaves than its noise, where that is known: the only sight of white physics.

    The logarithm of the ratio is normal about 0 with what is known of the noise, or about anything, with 1.
    """
    frame = candidate.frame
    own = [(b, w) for b, w in by_block(frame.blocks, white) if b.channel == channel]
    at_rest = own[0][0].noise is not None
    if not (stated or at_rest):
        return None
    count = sum(int(np.count_nonzero(w)) for _, w in own)
    ratio = frame.whitener.noise[channel].std if at_rest else float(np.sqrt(sum(float(w @ w) for _, w in own) / count))
    spread = float(np.hypot(STATED, np.sqrt(0.5 / count)))
    off = float(np.log(ratio))
    odds = 0.5 * (off / spread) ** 2 + float(np.log(spread)) if off > 0.0 else float(np.log(spread))
    return Leftover(channel, SIZE, "", odds, 0.5 * count * max(ratio**2 - 1.0, 0.0))


def _plain(channel: str) -> str:
    return channel.replace("_", " ")
