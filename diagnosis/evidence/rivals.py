"""Rivals: models that have other effects in the place of some, and what only the priors of sizes tell from them.

Two effects may fit the records equally well, and yet have odds of 80 to 1: one is then a thousandth of the size at
which it is typical, the other a tenth. Such odds are those of the priors' widths, to which a Bayes factor is sensitive
whatever the records are (Kass and Raftery, J. Am. Stat. Assoc. 90 (1995) 773, section 5). What a typical size is, a
library may guess; it is no reason to exclude a rival.
"""

from cable_envs.diagnosis.evidence.candidates import Candidate, log_odds


def over_rival(one: Candidate, other: Candidate) -> float:
    """Log odds of a model over a rival, as far as they do not rest on how wide the priors of its sizes are.

    Parameters
    ----------
    one, other : Candidate
        Under the same noise.

    Returns
    -------
    float
        `log_odds`, but that no size of the rival's own effects costs more than one of the first model's own does. What
        only shapes an effect is paid for as in `log_odds`.
    """
    own, new = _sizes_apart(one, other), _sizes_apart(other, one)
    if not own or not new:
        return log_odds(one, other)
    price, their = one.remainder.priced.of(own), other.remainder.priced.of(new)
    return log_odds(one, other) - max(their - price * len(new) / len(own), 0.0)


def _sizes_apart(one: Candidate, other: Candidate) -> set[str]:
    """Sizes of the effects that the other model has not."""
    return {name for h in one.effects if h not in other.effects for name in h.nulls}
