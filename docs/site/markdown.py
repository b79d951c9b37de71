"""Small pieces of Markdown that several makers write."""

import re
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


def whole_picture(src: str, words: str) -> str:
    """A picture across the page that leads to itself: on a phone, where its letters are small, to be enlarged."""
    return f"[{picture(src, words, 'film')}]({src})"


def unit(text: str) -> str:
    """A unit in a cell: a dash for a pure number."""
    return text if text not in ("", "1") else "–"


def page(*parts: str) -> str:
    """Parts with an empty line between them."""
    return "\n\n".join(part.strip("\n") for part in parts if part) + "\n"


def linked_pages(text: str) -> str:
    """A page that a description names by its file, as a link from a folder of the site.

    Examples
    --------
    >>> linked_pages("inferred (docs/physics.md)")
    'inferred ([physics](../physics.md))'
    """
    return re.sub(r"docs/([\w-]+)\.md", r"[\1](../\1.md)", text)


def of_docstring(text: str) -> str:
    r"""A docstring as Markdown; a table drawn with rules of equal signs becomes one of Markdown.

    Examples
    --------
    >>> print(of_docstring("Says.\n\n===  ===\na    b\nc    d\n===  ==="))
    Says.
    <BLANKLINE>
    |  |  |
    |---|---|
    | a | b |
    | c | d |
    """
    return "\n\n".join(_drawn_table(part) if part.startswith("===") else part for part in text.split("\n\n"))


def _drawn_table(text: str) -> str:
    rule, *rows = text.splitlines()
    starts = [found.start() for found in re.finditer("=+", rule)]
    ends = [*starts[1:], None]
    body = [line for line in rows if not line.startswith("===")]
    cells = [[line[a:b].strip() for a, b in zip(starts, ends, strict=True)] for line in body]
    return table([""] * len(starts), cells)
