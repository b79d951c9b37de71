"""Numbers as people read them, and texts of records in Markdown."""

import math
import re

from cable_envs.core.errors import ConfigurationError


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


def markdown_text(text: str) -> str:
    r"""Text of a record in Markdown, on one line, shown as it is.

    Parameters
    ----------
    text : str
        Any text, of anybody.

    Returns
    -------
    str
        What would be HTML, a link, code, or the end of a cell is escaped; control characters are left out.

    Examples
    --------
    >>> markdown_text("<b>|[a](b)")
    '&lt;b&gt;\\|\\[a\\](b)'
    """
    for mark, shown in (("&", "&amp;"), ("<", "&lt;"), (">", "&gt;"), *((c, f"\\{c}") for c in "|`[]*")):
        text = text.replace(mark, shown)
    return _one_line(text)


def markdown_code(text: str) -> str:
    """Text of a record as code in Markdown: between more backticks than it holds in a row.

    Parameters
    ----------
    text : str
        Any text, of anybody.

    Returns
    -------
    str
        On one line, without control characters.

    Examples
    --------
    >>> markdown_code("a `b`")
    '`` a `b` ``'
    """
    fence = "`" * (1 + max((len(run) for run in re.findall("`+", text)), default=0))
    inner = _one_line(text)
    return f"{fence}{inner}{fence}" if "`" not in text else f"{fence} {inner} {fence}"


def _one_line(text: str) -> str:
    return "".join(c for c in " ".join(text.split()) if c.isprintable())


def between_marks(page: str, begin: str, end: str, text: str) -> str:
    r"""A page with other text between two marks: what people wrote around it stays.

    Parameters
    ----------
    page : str
        The page as it is.
    begin, end : str
        The marks, each once, in this order.
    text : str
        What goes between them.

    Returns
    -------
    str
        The page anew.

    Raises
    ------
    ConfigurationError
        Where the page lacks a mark.

    Examples
    --------
    >>> between_marks("a <b> old <e> z", "<b>", "<e>", "new")
    'a <b>\n\nnew\n\n<e> z'
    """
    before, first, rest = page.partition(begin)
    _, second, after = rest.partition(end)
    if not first or not second:
        raise ConfigurationError(f"the page lacks '{begin}' with '{end}' after it")
    return f"{before}{begin}\n\n{text}\n\n{end}{after}"
