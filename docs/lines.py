"""Python lines of each folder: all, code, and words (docstrings and comments).

Run ``python docs/lines.py [CHECKOUT ...]``; the folder of each checkout is a column, by default this one.
"""

import ast
import subprocess
import sys
import tokenize
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).parents[1]


def counted(path: Path) -> Counter:
    """Lines of one file: ``lines``, ``code``, ``words``, and 1 for ``files``."""
    text = path.read_text(encoding="utf-8")
    docstrings = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
            docstrings |= set(range(node.lineno, node.end_lineno + 1))
    code, comments = set(), set()
    with path.open("rb") as file:
        for token in tokenize.tokenize(file.readline):
            if token.type == tokenize.COMMENT:
                comments.add(token.start[0])
            elif token.type not in (
                tokenize.ENCODING, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER,
            ):  # fmt: skip
                code |= set(range(token.start[0], token.end[0] + 1))
    code -= docstrings
    return Counter(files=1, lines=len(text.splitlines()), code=len(code), words=len(docstrings | (comments - code)))


def folders(checkout: Path) -> dict[str, Counter]:
    """Sums by the first folder of the files that git knows."""
    command = ["git", "ls-files", "-z", "*.py"]
    listed = subprocess.run(command, cwd=checkout, capture_output=True, text=True, check=True).stdout
    found: dict[str, Counter] = {}
    for name in filter(None, listed.split("\0")):
        if (checkout / name).is_file():
            found.setdefault(name.split("/")[0], Counter()).update(counted(checkout / name))
    return found


def main(checkouts: list[Path]) -> None:
    """Print a Markdown table: files, lines, of them code, of them words, for each checkout."""
    columns = [folders(checkout) for checkout in checkouts]
    names = sorted(set().union(*columns))
    product = [name for name in names if name not in ("tests", "benchmarks", "docs")]
    print("| folder |" + " files, lines: code + words |" * len(columns))
    print("|---|" + "--:|" * len(columns))
    for title, own in [*((name, [name]) for name in names), ("**product**", product)]:
        sums = [sum((column.get(name, Counter()) for name in own), Counter()) for column in columns]
        cells = [f"{s['files']}, {s['lines']}: {s['code']} + {s['words']}" if s else "-" for s in sums]
        print(f"| {title} | " + " | ".join(cells) + " |")


if __name__ == "__main__":
    main([Path(argument) for argument in sys.argv[1:]] or [ROOT])
