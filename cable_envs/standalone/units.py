"""SI units as products of powers of base units."""

import re

DERIVED = {
    "1": {}, "kg": {"kg": 1}, "m": {"m": 1}, "s": {"s": 1}, "A": {"A": 1}, "K": {"K": 1}, "rad": {"rad": 1},
    "N": {"kg": 1, "m": 1, "s": -2}, "Pa": {"kg": 1, "m": -1, "s": -2}, "J": {"kg": 1, "m": 2, "s": -2},
    "W": {"kg": 1, "m": 2, "s": -3}, "V": {"kg": 1, "m": 2, "s": -3, "A": -1}, "Hz": {"s": -1},
    "ohm": {"kg": 1, "m": 2, "s": -3, "A": -2},
}  # fmt: skip
"""Units without a prefix, in base units."""


def base_units(unit: str) -> dict[str, int]:
    """Exponents of the base units in a unit.

    Parameters
    ----------
    unit : str
        As parameters and signals have it: factors with a space between them, powers with ``^``, at most one ``/``.

    Returns
    -------
    dict of str to int
        Base unit -> exponent; empty where it has none, or where a factor is not known.

    Examples
    --------
    >>> base_units("N m/(rad s)")
    {'kg': 1, 'm': 2, 's': -3, 'rad': -1}
    """
    found: dict[str, int] = {}
    above, _, below = unit.partition("/")
    for text, way in ((above, 1), (below.strip("()"), -1)):
        for factor in text.split():
            match = re.fullmatch(r"(\w+?)(?:\^(-?\d+))?", factor)
            if match is None or match[1] not in DERIVED:
                return {}
            for base, power in DERIVED[match[1]].items():
                found[base] = found.get(base, 0) + way * power * int(match[2] or 1)
    return {base: power for base, power in found.items() if power}
