"""Numbers as people read them."""

import math


def number(value: float | None, digits: int = 3) -> str:
    r"""A number to some significant digits, without needless exponents.

    Parameters
    ----------
    value : float or None
        None and what is not finite is shown as a dash.
    digits : int
        Significant digits.

    Returns
    -------
    str
        With a narrow no-break space between thousands, with an exponent below 1e-3 and from 1e6 on.

    Examples
    --------
    >>> number(0.123456), number(1234.5, 2), number(1e-7), number(None)
    ('0.123', '1\u202f234', '1.00e-7', '–')
    """
    if value is None or not math.isfinite(value):
        return "–"
    if value == 0:
        return "0"
    if not 1e-3 <= abs(value) < 1e6:
        mantissa, exponent = f"{value:.{digits - 1}e}".split("e")
        return f"{mantissa}e{int(exponent)}"
    places = max(digits - 1 - math.floor(math.log10(abs(value))), 0)
    return f"{value:,.{places}f}".replace(",", "\N{NARROW NO-BREAK SPACE}")


def count(value: float) -> str:
    """A large whole number in short: three digits and k, M or G.

    Examples
    --------
    >>> count(0), count(850), count(12_000), count(1_500_000)
    ('0', '850', '12k', '1.5M')
    """
    for limit, suffix in ((1e9, "G"), (1e6, "M"), (1e3, "k")):
        if value >= limit:
            return f"{value / limit:.3g}{suffix}"
    return f"{value:g}"
