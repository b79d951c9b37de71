"""One yardstick for all rows: the kinds of row with one tolerance each, and the five words for what came out.

No call site chooses a tolerance or a word: it says of which kind its row is and what is known about it, and
`cable_envs.reproduction.rows` decides.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from decimal import Decimal


@dataclass(frozen=True)
class Kind:
    """What a row compares, and how close counts."""

    name: str
    tolerance: float | None
    """of the printed size; None: no share of the size decides, ``says`` tells what does"""
    agrees: str
    """how close is close enough, in a few words"""
    says: str

    def within(self, published: float, computed: float) -> bool:
        """Whether a number is within the tolerance of the printed one; False where either is not finite."""
        if self.tolerance is None:
            raise TypeError(f"rows of the kind '{self.name}' are not compared by a share of their size")
        return bool(abs(computed - published) <= self.tolerance * abs(published))


DIGITS = Kind(
    "digits",
    None,
    "half a unit of the last printed digit",
    "A number computed from printed inputs alone. Printed inputs are rounded too: where that can move the result, "
    "all inputs that round to the printed ones give a range, and the range has to meet the numbers that round to the "
    "print.",
)
EQUATION = Kind(
    "equation",
    1e-6,
    "0.0001 %",
    "A printed equation against an independent numerical solution of what it was derived from. The solvers are set "
    "to ten digits, so that a larger difference is one of the equation.",
)
PARAMETER = Kind(
    "parameter",
    0.01,
    "1 %",
    "A parameter recovered from data without noise that were made with the printed one. It tests the identification.",
)
CURVE = Kind(
    "curve",
    0.05,
    "5 %",
    "A value that the paper measured or plotted, or a count that it reports. A plot is read, and an experiment "
    "repeated, about as closely as this.",
)
STATEMENT = Kind("statement", None, "it holds or it does not", "Words of the paper, tested by a computed condition.")
KINDS = (DIGITS, EQUATION, PARAMETER, CURVE, STATEMENT)

WIDEST_BAND = 5.0
"""A band whose upper end is more than this many times its lower end, or which lacks an end, says nothing of a print."""


@dataclass(frozen=True)
class Status:
    """A word for what came out of a row. The sign stands before it, so that the colour is never needed."""

    name: str
    sign: str
    style: str
    """class on the page"""
    colour: str
    """in a terminal"""
    says: str


REPRODUCED = Status(
    "reproduced", "✓", "reproduced", "green", "The computed value is within the tolerance of the row's kind."
)
CONSISTENT = Status(
    "consistent", "≈", "consistent", "cyan",
    "The print does not contradict the model, and does not test it closely either. It lies in the stated band of "
    "assumed truths or of noise (5 to 95 %, or a 99 % interval, its ends at most a factor of 5 apart), or it is "
    "within the tolerance but a number of the model was fitted to it, inferred from it or chosen for want of a "
    "printed one.",
)  # fmt: skip
EXPLAINED = Status(
    "differs, explained", "≠", "explained", "yellow",
    "Beyond the tolerance, and the row gives the reason as evidence that is computed or derived: a misprint, two "
    "prints that exclude each other, or an equation that cannot do what is said of it.",
)  # fmt: skip
DIFFERS = Status("differs", "✗", "differs", "red", "Beyond the tolerance, and no reason was found.")
NOT_REPRODUCIBLE = Status(
    "not reproducible", "?", "missing", "bright_black",
    "The paper does not print what it takes, or what it prints does not determine the number.",
)  # fmt: skip
STATUSES = (REPRODUCED, CONSISTENT, EXPLAINED, DIFFERS, NOT_REPRODUCIBLE)
"""From best to least known."""
BY_NAME: Mapping[str, Status] = {status.name: status for status in STATUSES}


def half_unit(printed: str) -> float:
    """Half a unit of the last digit of a number as it is printed.

    Examples
    --------
    >>> half_unit("0.051"), half_unit("57"), half_unit("2.70")
    (0.0005, 0.5, 0.005)
    """
    exponent = Decimal(printed).as_tuple().exponent
    if not isinstance(exponent, int):
        raise ValueError(f"'{printed}' is no printed number")
    return float(Decimal(5).scaleb(exponent - 1))


def same_digits(printed: str, low: float, high: float) -> bool:
    """Whether some number between ``low`` and ``high`` rounds to what is printed.

    Examples
    --------
    >>> same_digits("0.051", 0.0514, 0.0514), same_digits("0.051", 0.0516, 0.0516), same_digits("0.051", 0.0514, 0.06)
    (True, False, True)
    """
    value, half = float(printed), half_unit(printed)
    slack = 1e-9 * half  # rounding of binary numbers, where a result lies on the edge
    return bool(low <= value + half + slack and high >= value - half - slack)


def tells(low: float, high: float) -> bool:
    """Whether a band is narrow enough to say anything (`WIDEST_BAND`).

    Examples
    --------
    >>> tells(1.0, 4.0), tells(1.0, 6.0), tells(0.0, 1.0), tells(2.0, float("inf"))
    (True, False, False, False)
    """
    small, large = sorted((abs(low), abs(high)))
    return bool(low * high > 0 and math.isfinite(large) and large <= WIDEST_BAND * small)
