"""Lines of JSON as columns, which compress better: numbers of the same name stand beside each other.

    cable-columns/1
    number of patterns, and the patterns: lines without their numbers
    number of the pattern of each line, as its own line or the next
    one line for each number in each pattern, those of one name together: its values in all lines of the pattern

A name is the key before a number; the numbers of a list have one for each place in it. The text is kept to the byte.
"""

import re
from collections.abc import Sequence

HEAD = b"cable-columns/1\n"
_NUMBER = re.compile(rb"(?<=[:,\[])-?\d[\d.eE+-]*(?=[,}\]])")
_PLACE = b"\0"  # JSON text has no such byte


def to_columns(lines: bytes) -> bytes:
    r"""Lines as columns.

    Parameters
    ----------
    lines : bytes
        Whole lines, each with its end.

    Returns
    -------
    bytes
        What `from_columns` makes the same lines of; the lines themselves where they hold what no JSON text can.

    Examples
    --------
    >>> whole = b'{"seed":1,"rmse":0.5}\n{"seed":2,"rmse":0.25}\n'
    >>> from_columns(to_columns(whole)) == whole
    True
    """
    if _PLACE in lines or not lines.endswith(b"\n"):
        return lines
    numbers: dict[bytes, int] = {}
    which: list[int] = []
    found: list[list[list[bytes]]] = []
    for line in lines[:-1].split(b"\n"):
        number = numbers.setdefault(_NUMBER.sub(_PLACE, line), len(numbers))
        if number == len(found):
            found.append([])
        which.append(number)
        found[number].append(_NUMBER.findall(line))
    columns = [[b" ".join(column) for column in zip(*rows, strict=True)] for rows in found]
    patterns = list(numbers)
    parts = [b"%d" % len(patterns), *patterns, b" ".join(b"%d" % number for number in which)]
    parts += [columns[number][k] for number, k in _order(patterns)]
    return HEAD + b"\n".join(parts) + b"\n"


def from_columns(content: bytes) -> bytes:
    """The lines that `to_columns` was given.

    Parameters
    ----------
    content : bytes
        As it made them; what does not begin as columns do is returned as it is.

    Returns
    -------
    bytes
        Whole lines, each with its end.

    Raises
    ------
    ValueError
        Where the content is damaged.
    """
    if not content.startswith(HEAD):
        return content
    try:
        count, *parts = content[len(HEAD) : -1].split(b"\n")
        patterns, which = parts[: int(count)], [int(number) for number in parts[int(count)].split()]
        columns: list[list[list[bytes]]] = [[[]] * pattern.count(_PLACE) for pattern in patterns]
        for (number, k), column in zip(_order(patterns), parts[int(count) + 1 :], strict=True):
            columns[number][k] = column.split(b" ")
        pieces = [pattern.split(_PLACE) for pattern in patterns]
        rows = [iter(zip(*one, strict=True)) for one in columns]
        lines = []
        for number in which:
            values = next(rows[number]) if columns[number] else ()
            between = zip(pieces[number], (*values, b""), strict=True)
            lines.append(b"".join(part for pair in between for part in pair))
    except (ValueError, IndexError, StopIteration) as problem:
        raise ValueError(f"damaged: its columns do not fit together ({problem})") from None
    return b"\n".join(lines) + b"\n"


def _order(patterns: Sequence[bytes]) -> list[tuple[int, int]]:
    """(pattern, number in it) of all numbers in all patterns, those of one name together."""
    named: dict[tuple[bytes, int], list[tuple[int, int]]] = {}
    for number, pattern in enumerate(patterns):
        seen: dict[bytes, int] = {}
        for k, piece in enumerate(pattern.split(_PLACE)[:-1]):
            name = piece.rsplit(b'"', 2)[-2] if piece.endswith(b'":') else b""
            seen[name] = seen.get(name, 0) + 1
            named.setdefault((name, seen[name]), []).append((number, k))
    return [place for places in named.values() for place in places]
