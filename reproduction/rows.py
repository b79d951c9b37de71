"""A printed number or statement beside the computed one. What a row is called follows from what is known about it.

Items make rows by `digits`, `equation`, `parameter`, `curve`, `statement` and `missing`, one for each kind of
`cable_envs.reproduction.yardstick`. None of them takes a tolerance or a status.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from cable_envs.reproduction.yardstick import (
    CONSISTENT,
    CURVE,
    DIFFERS,
    DIGITS,
    EQUATION,
    EXPLAINED,
    NOT_REPRODUCIBLE,
    PARAMETER,
    REPRODUCED,
    STATEMENT,
    Kind,
    Status,
    same_digits,
    tells,
)

Number = float | int | str | None
NO_REASON = "No reason was found."


@dataclass(frozen=True)
class Band:
    """What assumed truths, or noise, make of a computed number."""

    low: float
    """minus infinity where there is no lower end"""
    high: float
    of: str
    """which band and of what, for example "5 to 95 % of 40 truths within ±20 %" """

    def holds(self, value: float) -> bool:
        """Whether a number lies in it."""
        return self.low <= value <= self.high

    def sentence(self, unit: str) -> str:
        """The band in words."""
        low = f"{self.low:.4g}" if math.isfinite(self.low) else "no lower end"
        high = f"{self.high:.4g}" if math.isfinite(self.high) else "no upper end"
        return f"Band ({self.of}): {low} to {high}{'' if unit == '1' else f' {unit}'}."


@dataclass(frozen=True)
class Row:
    """One row of the report; made by the functions below. Texts are whole sentences."""

    kind: Kind
    quantity: str
    published: Number
    """as printed: text where its digits count"""
    computed: Number
    unit: str
    holds: bool = False
    """whether both agree by the measure of the kind"""
    how: str = ""
    """how it was computed"""
    chosen: str = ""
    """which number of the model was fitted to this quantity, inferred from it or chosen: agreement then proves less"""
    band: Band | None = None
    reason: str = ""
    """why it differs: evidence that is computed or derived"""
    missing: str = ""
    """what the paper does not tell"""

    def __post_init__(self):
        if self.reason and self.missing:
            raise ValueError(f"{self.quantity}: a row that cannot be compared has no reason to differ")
        if self.band is not None and _value(self.published) is None:
            raise ValueError(f"{self.quantity}: a band needs a printed number")

    @property
    def status(self) -> Status:
        """What the row is called."""
        if self.missing or (self.band and self._inside and not tells(self.band.low, self.band.high)):
            return NOT_REPRODUCIBLE
        if self.band:
            good = CONSISTENT if self._inside else None
        elif self.holds:
            good = CONSISTENT if self.chosen else REPRODUCED
        else:
            good = None
        return good or (EXPLAINED if self.reason else DIFFERS)

    @property
    def _inside(self) -> bool:
        value = _value(self.published)
        return self.band is not None and value is not None and self.band.holds(value)

    @property
    def why(self) -> str:
        """How the row came to its status, in sentences."""
        status = self.status
        parts = [self.reason if status is EXPLAINED else NO_REASON if status is DIFFERS else self.missing]
        if self.band:
            parts.append(self.band.sentence(self.unit))
            if status is NOT_REPRODUCIBLE:
                parts.append("So wide a band determines no number.")
        return " ".join(part for part in (*parts, self.chosen, self.how) if part)

    @property
    def rel_error(self) -> float | None:
        """(computed - published) / |published|; None where either is no number or nothing but zero was printed."""
        published, computed = _value(self.published), _value(self.computed)
        if not published or computed is None or not (math.isfinite(published) and math.isfinite(computed)):
            return None
        return (computed - published) / abs(published)

    def as_json(self, item: str) -> dict[str, Any]:
        """The row of ``--json``; numbers that are not finite become null."""
        band = None if self.band is None else [_plain(self.band.low), _plain(self.band.high)]
        return {
            "item": item, "quantity": self.quantity, "kind": self.kind.name, "published": _plain(self.published),
            "computed": _plain(self.computed), "unit": self.unit, "rel_error": self.rel_error, "band": band,
            "status": self.status.name, "why": self.why,
        }  # fmt: skip


def _value(number: Number) -> float | None:
    """A number, also one that is kept as it is printed; None for words."""
    try:
        return None if number is None else float(number)
    except ValueError:
        return None


def _plain(number: Number) -> Number:
    value = _value(number)
    if value is None:
        return number
    return value if math.isfinite(value) else None


def digits(
    quantity: str,
    printed: str,
    computed: float,
    unit: str,
    *,
    inputs: tuple[float, float] | None = None,
    how: str = "",
    reason: str = "",
) -> Row:
    """A number computed from printed inputs, against its printed digits.

    Parameters
    ----------
    quantity : str
        What it is, in words.
    printed : str
        As printed, so that its digits are known.
    computed : float
        From the inputs as printed.
    unit : str
        SI, "1" for a ratio.
    inputs : tuple of float, optional
        Smallest and largest result of all inputs that round to the printed ones.
    how : str
        How it was computed.
    reason : str
        Evidence for why it differs, if it does.

    Returns
    -------
    Row

    Examples
    --------
    >>> digits("force for 0.215 N m over 15 mm", "14.3", 0.215 / 0.015, "N").status.name
    'reproduced'
    """
    low, high = (computed, computed) if inputs is None else (min(*inputs, computed), max(*inputs, computed))
    if inputs is not None:
        how = f"{how} The inputs that round to the printed ones give {low:.5g} to {high:.5g}.".strip()
    return Row(DIGITS, quantity, printed, computed, unit, same_digits(printed, low, high), how, reason=reason)


def equation(quantity: str, printed: float, solved: float, unit: str, *, how: str, reason: str = "") -> Row:
    """A printed equation's value against an independent numerical solution; ``how`` says which one.

    Returns
    -------
    Row
    """
    holds = EQUATION.within(printed, solved)
    return Row(EQUATION, quantity, float(printed), float(solved), unit, holds, how, reason=reason)


def parameter(
    quantity: str, published: float, computed: float, unit: str, *, band: Band | None = None, how: str = ""
) -> Row:
    """An identified parameter; from noisy data it has a ``band``, which then decides.

    Returns
    -------
    Row
    """
    return Row(PARAMETER, quantity, published, computed, unit, PARAMETER.within(published, computed), how, band=band)


def curve(
    quantity: str,
    published: float,
    computed: float,
    unit: str,
    *,
    how: str = "",
    chosen: str = "",
    band: Band | None = None,
    reason: str = "",
) -> Row:
    """A measured or plotted value.

    Parameters
    ----------
    quantity : str
        What it is, in words.
    published, computed : float
        In ``unit``.
    unit : str
        SI, "1" for a ratio.
    how : str
        How it was computed.
    chosen : str
        Which number of the model was fitted to this value, inferred from it or chosen.
    band : Band, optional
        What assumed truths make of it; it then decides.
    reason : str
        Evidence for why it differs, if it does.

    Returns
    -------
    Row

    Examples
    --------
    >>> curve("angle", 1.20, 1.21, "rad").status.name, curve("angle", 1.20, 1.30, "rad").status.name
    ('reproduced', 'differs')
    """
    holds = CURVE.within(published, computed)
    return Row(CURVE, quantity, published, computed, unit, holds, how, chosen, band, reason)


def within_truths(
    quantity: str, published: float, values: np.ndarray, unit: str, of: str, *, how: str = "", reason: str = ""
) -> Row:
    """A measured value against an ensemble: the median is shown, and the 5 to 95 % band decides.

    Returns
    -------
    Row
    """
    low, high = (float(v) for v in np.quantile(values, (0.05, 0.95)))
    band = Band(low, high, f"5 to 95 % of {len(values)} {of}")
    return curve(quantity, published, float(np.median(values)), unit, how=how, band=band, reason=reason)


def statement(
    quantity: str,
    published: str,
    computed: Number,
    holds: bool,
    *,
    how: str = "",
    chosen: str = "",
    reason: str = "",
    unit: str = "",
) -> Row:
    """A statement of a paper in words, and whether the computation bears it out.

    Parameters
    ----------
    quantity : str
        What the statement is about.
    published : str
        The statement.
    computed : float, str or None
        What was computed.
    holds : bool
        Whether the statement holds: a computed condition.
    how : str
        How that is seen.
    chosen : str
        Which number that it hangs on was fitted, inferred or chosen.
    reason : str
        Evidence for why it does not hold, if it does not.
    unit : str
        Of the computed number.

    Returns
    -------
    Row
    """
    return Row(STATEMENT, quantity, published, computed, unit, bool(holds), how, chosen, reason=reason)


def missing(
    quantity: str, published: Number, computed: Number, unit: str, what: str, *, kind: Kind = CURVE, how: str = ""
) -> Row:
    """A number whose inputs the paper does not tell.

    Parameters
    ----------
    quantity : str
        What it is, in words.
    published, computed : float, str or None
        As printed, and with the inputs that were assumed.
    unit : str
        Of both.
    what : str
        What is missing.
    kind : Kind
        Of which kind the row would be.
    how : str
        How the number was computed all the same.

    Returns
    -------
    Row
    """
    return Row(kind, quantity, published, computed, unit, False, how, missing=what)
