"""Tables and names that stay readable in a narrow column: what the site does to the HTML of every page."""

import html
import re

TABLE = re.compile(r"<table>.*?</table>", re.DOTALL)
ROW = re.compile(r"<tr>.*?</tr>", re.DOTALL)
CELL = re.compile(r"<(t[hd])((?: [^>]*)?)>(.*?)</\1>", re.DOTALL)
CODE = re.compile(r"<code>([^<]*)</code>")
WORD = re.compile(r"\S+")
INTERVAL = re.compile(r"\[[-+−]?[\d.]+, [-+−]?[\d.]+\](?=[^>]*(?:<|$))")
"""In the text of a cell."""
LINES, LEAST, MOST = 4, 9, 30
"""Lines that the longest text of a column may take, as far as a column between so many characters wide allows it."""
UNBROKEN = 28
"""Characters of a name that is never broken at its hyphens."""


def readable(text: str) -> str:
    r"""A page whose columns of prose are not squeezed to a word a line; ``--options`` and intervals stay whole.

    A table that is then wider than the page scrolls in its own box.

    Examples
    --------
    >>> readable("<p><code>run --seed 3</code></p>")
    '<p><code>run <span class="whole">--seed</span> 3</code></p>'
    >>> readable("<pre><code>run --check\nlook</code></pre>")  # lines of commands stay lines
    '<pre><code>run <span class="whole">--check</span>\nlook</code></pre>'
    >>> readable("<table><tr><td>0.6 [-0.5, 0.7]</td></tr></table>")
    '<table><tr><td>0.6 <span class="whole">[-0.5, 0.7]</span></td></tr></table>'
    """
    return TABLE.sub(lambda found: _widened(found[0]), CODE.sub(_whole, text))


def _whole(found: re.Match[str]) -> str:
    def kept(word: re.Match[str]) -> str:
        return f'<span class="whole">{word[0]}</span>' if "-" in word[0] and len(word[0]) <= UNBROKEN else word[0]

    return f"<code>{WORD.sub(kept, found[1])}</code>"


def _widened(table: str) -> str:
    """The table with a least width on the head of every column that holds sentences, and with whole intervals."""
    table = CELL.sub(lambda cell: INTERVAL.sub(r'<span class="whole">\g<0></span>', cell[0]), table)
    columns: dict[int, int] = {}
    for row in ROW.findall(table):
        for k, (_, _, content) in enumerate(CELL.findall(row)):
            said = html.unescape(re.sub(r"<[^>]+>", "", content)).strip()
            columns[k] = max(columns.get(k, 0), len(said))
    head = ROW.search(table)
    if head is None:
        return table
    cells = iter(range(len(columns)))

    def widened(found: re.Match[str]) -> str:
        length = columns[next(cells)]
        wide = min(max(length // LINES, LEAST), MOST)
        style = found[2] if length < LINES * LEAST else _styled(found[2], f"min-width: {wide}ch")
        return f"<{found[1]}{style}>{found[3]}</{found[1]}>"

    return table.replace(head[0], CELL.sub(widened, head[0]), 1)


def _styled(attributes: str, rule: str) -> str:
    if 'style="' in attributes:
        return attributes.replace('style="', f'style="{rule}; ', 1)
    return f'{attributes} style="{rule}"'
