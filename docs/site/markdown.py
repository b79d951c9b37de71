"""Small pieces of Markdown that several makers write."""

from collections.abc import Iterable, Sequence


def table(head: Sequence[str], rows: Iterable[Sequence[str]], numbers: Sequence[int] = ()) -> str:
    """A table; columns in ``numbers`` are set to the right.

    Examples
    --------
    >>> print(table(("a", "b"), [("x", "1")], numbers=(1,)))
    | a | b |
    |---|--:|
    | x | 1 |
    """
    rule = "|".join("--:" if k in numbers else "---" for k in range(len(head)))
    lines = [f"| {' | '.join(head)} |", f"|{rule}|"]
    return "\n".join([*lines, *(f"| {' | '.join(cell.replace('|', '&#124;') for cell in row)} |" for row in rows)])


def picture(src: str, words: str, kind: str = "") -> str:
    """An image with its description; ``kind`` is a class of docs/theme/site.css."""
    mark = f' class="{kind}"' if kind else ""
    return f'<img src="{src}" alt="{words}"{mark} loading="lazy">'


def unit(text: str) -> str:
    """A unit in a cell: a dash for a pure number."""
    return text if text not in ("", "1") else "–"


def page(*parts: str) -> str:
    """Parts with an empty line between them."""
    return "\n\n".join(part.strip("\n") for part in parts if part) + "\n"


def of_docstring(text: str) -> str:
    """A docstring as Markdown: a table drawn with rules of equal signs stays as it is drawn."""
    return "\n\n".join(f"```text\n{part}\n```" if part.startswith("===") else part for part in text.split("\n\n"))
