"""Goodness of fit: whether what a model leaves is noise. No hypothesis is asked, only what any mismatch would do.

It is asked of the records that were fitted and, as nothing is fitted any more, may be of those that are held out.

Three kinds of tests, each with a p-value of its own; the least of them counts, times their number:

- smooth functions of what a mismatch may follow, channel by channel and all channels together (`adequacy.functions`)
- lines of the spectrum, and whether channels know of each other (`cable_envs.diagnosis.adequacy.spectra`)
- where the recording states its noise, or has a record at rest, the RMS of what is left over that: the only test that
  sees white physics
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cable_envs.diagnosis.adequacy.functions import Regression, regressed
from cable_envs.diagnosis.adequacy.spectra import coherences, lines
from cable_envs.diagnosis.fit.likelihood import Judged, raw_residuals
from cable_envs.diagnosis.fit.refit import Start, refit
from cable_envs.diagnosis.model.leftover import Leftover
from cable_envs.diagnosis.model.model import Block, Model, of_all_records
from cable_envs.diagnosis.model.noise import resolution

SIGNIFICANCE = 1e-3
"""Familywise p-value below which something is left."""


@dataclass(frozen=True)
class Adequacy:
    """All of them, the surest first; ``p_value`` is familywise; ``excess``: largest sum of squares beyond noise."""

    p_value: float
    excess: float
    leftovers: tuple[Leftover, ...]
    over_noise: float = 1.0
    """largest RMS over what the recording states as a channel's noise; 1 where it states none"""


def adequacy(
    model: Model, judged: Judged, stated: dict[str, float] | None = None, heldout: Model | None = None
) -> Adequacy:
    """Look for structure in what a refit leaves, in the records of ``heldout`` too.

    stated: channel -> standard deviation of its noise, SI.
    """
    blocks, judged = (model.blocks, judged) if heldout is None else _of_all(model, heldout, judged)
    regression = Regression(blocks, judged)
    found = [*regressed(regression), *lines(blocks, judged, regression.white), *coherences(blocks, regression.white)]
    tests = len(found)
    found.sort(key=lambda f: f.p_value)
    excess = max([f.gain - f.functions for f in found if tests * f.p_value < SIGNIFICANCE], default=0.0)
    over = _over_noise(blocks, judged, stated or {})
    return Adequacy(min(1.0, tests * found[0].p_value), excess, tuple(found), over)


def _of_all(model: Model, heldout: Model, judged: Judged) -> tuple[list[Block], Judged]:
    """(blocks of both, what the refit leaves in them); what the parameters are unsure of is taken out of both.

    A fitted parameter that the held-out records do not have (where a record begins) has no slope there.
    """
    known = {p.name for p in heldout.parameters}
    free = tuple(n for n in judged.fit.free if n in known)
    slopes = refit(heldout, judged.whitener, [Start("", free, judged.fit.values)], 0)[0].jacobian
    wide = np.zeros((len(slopes), len(judged.fit.free)))
    wide[:, [judged.fit.free.index(n) for n in free]] = slopes
    everything = replace(judged.fit, jacobian=np.concatenate([judged.fit.jacobian, wide]))
    left = (*judged.raw, *raw_residuals(heldout, judged.fit))
    return of_all_records(model, heldout), replace(judged, fit=everything, raw=left)


def _over_noise(blocks: Sequence[Block], judged: Judged, stated: dict[str, float]) -> float:
    known = [judged.whitener.noise[b.channel].std for b in blocks if b.noise is not None]
    worst = max([1.0, *known])
    for channel, std in stated.items():
        own = [r[b.good] for r, b in zip(judged.raw, blocks, strict=True) if b.channel == channel]
        if own:
            step = resolution(np.concatenate([b.measured[b.good] for b in blocks if b.channel == channel]))
            worst = max(worst, float(np.sqrt(np.mean(np.concatenate(own) ** 2) / (std**2 + step**2 / 12.0))))
    return worst
