"""Matplotlib's SVG text made small without a visible change: a page holds a hundred figures and is one file."""

import hashlib
import re
from collections import Counter
from collections.abc import Iterator
from string import ascii_lowercase, digits

STEPS_PER_POINT = 10
"""Grid of the coordinates, steps per point (1/72 inch): finer than a screen or a printer resolves."""

STRAIGHT = 0.75
"""Steps of the grid by which a line may pass beside the points that it was drawn through."""

MOST = 100
"""Points of one line, at the most: each of them is looked at again for every further one."""

MARKS = 4
"""Marks of one class in a row from which on they are a group."""

Piece = tuple[str, list[int]]
"""A command of a path, and where it goes: steps of the grid from the picture's corner."""

_TOKEN = re.compile(r"<!--.*?-->|<text\b.*?</text>|<style\b.*?</style>|<[^>]+>", re.DOTALL)
_FAMILIES = re.compile(r"font-family:\s*('[^']*'),[^;}\"]*?(sans-serif|monospace|serif)(?=[;}\"])")
"""A list of fonts: the first is drawn with, and the kind stands for whoever has it not."""
_DIGITS = ascii_lowercase + digits
_COORDINATES = {"M": 2, "L": 2, "Q": 4, "C": 6, "z": 0}


def compact_svg(svg: str) -> str:
    r"""The same picture in about a third of the characters.

    Paths are written relative to their last point on a grid of `STEPS_PER_POINT`, without points of a straight line
    (`STRAIGHT`), numbers of other places are rounded
    to it, a style that several elements have becomes a class, and that of `MARKS` marks in a row their group's, of a
    list of fonts the first and the kind are kept, references are those of SVG 2, and behind its last hyphen an id is a
    number; ids that nothing refers to, turns by nothing, groups that say nothing, comments and space between elements
    are left out.

    Parameters
    ----------
    svg : str
        SVG as matplotlib's backend writes it. What is compact already comes back as it is.

    Returns
    -------
    str
        SVG text on one line.

    Examples
    --------
    >>> compact_svg('<svg><g id="a">\n <path d="M 0 0.04 \nL 10.26 5 \nL 10.26 5.5 \n"/></g></svg>')
    '<svg><path d="M0 0l10.3 5v.5"/></svg>'
    """
    svg = re.sub(r'\bd="([^"]*)"', lambda found: f'd="{compact_path(found[1])}"', svg)
    svg = re.sub(r'\b(x|y|width|height)="(-?\d+\.\d+)"', lambda f: f'{f[1]}="{_short(float(f[2]))}"', svg)
    svg = re.sub(r' transform="rotate\(-?0(?:\.0*)? [^)]*\)"', "", svg)
    svg = re.sub(r"\b(translate|rotate)\(([^)]*)\)", lambda f: f"{f[1]}({_rounded(f[2])})", svg)
    svg = re.sub(r'\bstyle="[^"]*"', lambda found: re.sub(r"([:;]) +", r"\1", found[0]), svg)
    svg = _FAMILIES.sub(r"font-family:\1,\2", svg)
    svg = svg.replace(" xlink:href=", " href=").replace(' xmlns:xlink="http://www.w3.org/1999/xlink"', "")
    used = set(re.findall(r'href="#([^"]+)"', svg)) | set(re.findall(r"url\(#([^)]+)\)", svg))
    svg = re.sub(r' id="([^"]*)"', lambda found: found[0] if found[1] in used else "", svg)
    svg = _with_clips_in_styles(_without_idle_groups(_with_short_ids(svg)))
    return _without_idle_rules(_with_shared_classes(_with_classes(svg)))


def name_of(text: str) -> str:
    """Four characters that stand for a text: a letter, and three that are letters or digits.

    Of a hundred texts two have one name in 4 of 1000 pages.

    Examples
    --------
    >>> name_of("fill:none")
    'kifl'
    """
    rest, name = int(hashlib.sha256(text.encode()).hexdigest()[:8], 16), ""
    for _ in range(3):
        rest, digit = divmod(rest, len(_DIGITS))
        name += _DIGITS[digit]
    return ascii_lowercase[rest % len(ascii_lowercase)] + name


def _with_short_ids(svg: str) -> str:
    """Numbers in the place of what follows the last hyphen of an id: before it is what tells a page's figures apart.

    An id without one is by matplotlib, and has its `name_of`.
    """
    ids = dict.fromkeys(re.findall(r' id="([^"]*-[^"-]*)"', svg))
    short = {old: f"{old.rpartition('-')[0]}-{k}" for k, old in enumerate(ids)}
    short |= {old: name_of(old) for old in re.findall(r' id="([mp][0-9a-f]{10})"', svg)}
    return re.sub(r'(?<= id=")[^"]+|(?<=href="#)[^"]+|(?<=url\(#)[^)]+', lambda f: short.get(f[0], f[0]), svg)


def _with_classes(svg: str) -> str:
    """Repeated styles as classes. A class is named after its style: figures on one page share names without harm."""
    counts = Counter(re.findall(r' style="([^"]*)"', svg))
    names = {style: name_of(style) for style, n in counts.items() if n > 2}
    if not names or "</style>" not in svg:
        return svg
    rules = "".join(f".{name}{{{style}}}" for style, name in names.items())
    svg = re.sub(r' style="([^"]*)"', lambda f: f' class="{names[f[1]]}"' if f[1] in names else f[0], svg)
    return svg.replace("</style>", f"{rules}</style>", 1)


def _with_clips_in_styles(svg: str) -> str:
    """Styles that say how their element is cut off, where several elements are cut off by one path in one style."""
    rules = dict(re.findall(r"\.(\w+){([^}]*)}", svg))
    clip, styled = re.compile(r' clip-path="(url\(#[^"]+\))"'), re.compile(r' (style|class)="([^"]*)"')

    def whole(tag: str) -> str:
        """The style of an element with what cuts it off; "" of one that has only one of both."""
        cut, style = clip.search(tag), styled.search(tag)
        if cut is None or style is None or (style[1] == "class" and style[2] not in rules):
            return ""
        own = style[2] if style[1] == "style" else rules[style[2]]
        return f"{own.rstrip(';')};clip-path:{cut[1]}"

    tags = re.compile(r"<(?:path|use|g|image|rect)\b[^>]*>")
    counts = Counter(whole(tag) for tag in tags.findall(svg))

    def moved(found: re.Match[str]) -> str:
        style = whole(found[0])
        if not style or counts[style] < MARKS:
            return found[0]
        return styled.sub(f' style="{style}"', clip.sub("", found[0]), count=1)

    return tags.sub(moved, svg)


def _without_idle_rules(svg: str) -> str:
    """Without classes that no element has."""
    used = set(re.findall(r' class="([^"]*)"', svg))
    return re.sub(r"\.(\w+){[^}]*}", lambda found: found[0] if found[1] in used else "", svg)


def _with_shared_classes(svg: str) -> str:
    """Marks of one class in a row as a group of that class; not of one whose opacity is that of all it holds."""
    mark = '<use href="#[^"]+" x="[^"]+" y="[^"]+" class="NAME"/>'
    first, further = mark.replace("NAME", '([^"]+)'), mark.replace("NAME", r"\1")

    def grouped(found: re.Match[str]) -> str:
        rule = re.search(rf"\.{found[1]}{{([^}}]*)}}", svg)
        if rule is None or re.search(r"(?:^|;)(?:opacity|clip-path|mask|filter):", rule[1]):
            return found[0]
        own = f' class="{found[1]}"'
        return f"<g{own}>{found[0].replace(own, '')}</g>"

    return re.sub(f"{first}(?:{further}){{{MARKS - 1},}}", grouped, svg)


def compact_path(data: str) -> str:
    """A path's ``d`` with relative coordinates; one that has other commands than M, L, Q, C and z stays as it is."""
    words = data.split()
    if not words or any(w not in _COORDINATES and not re.fullmatch(r"-?[\d.]+(?:e-?\d+)?", w) for w in words):
        return data
    pieces, k = list[Piece](), 0
    while k < len(words):
        command = words[k] if words[k] in "Mz" else words[k].lower()
        count = _COORDINATES[words[k]]
        pieces.append((command, [round(float(w) * STEPS_PER_POINT) for w in words[k + 1 : k + 1 + count]]))
        k += 1 + count
    written, previous, at = "", "", (0, 0)
    for command, steps in _straightened(pieces):
        way = [step if command == "M" else step - at[j % 2] for j, step in enumerate(steps)]
        at = (steps[-2], steps[-1]) if steps else at
        if command == "l" and 0 in way:
            command, way = ("h", way[:1]) if way[1] == 0 else ("v", way[1:])
        written += command if command in "Mz" or command != previous else ""
        for step in way:
            written = _followed(written, step)
        previous = command
    return written


def _straightened(pieces: list[Piece]) -> Iterator[Piece]:
    """Pieces without the ends of lines that are closer than `STRAIGHT` to the line past them."""
    k = 0
    while k < len(pieces):
        last = k
        if k and pieces[k][0] == "l" and pieces[k - 1][1]:
            points = [pieces[k - 1][1][-2:], pieces[k][1]]
            while last + 1 < len(pieces) and pieces[last + 1][0] == "l" and len(points) < MOST:
                points.append(pieces[last + 1][1])
                if not _straight(points):
                    break
                last += 1
        yield pieces[last]
        k = last + 1


def _straight(points: list[list[int]]) -> bool:
    """Whether all points are close to the line from the first to the last, and none lies beyond its ends."""
    (x0, y0), (x1, y1) = points[0], points[-1]
    dx, dy = x1 - x0, y1 - y0
    length = dx * dx + dy * dy
    for x, y in points[1:-1]:
        at = 0.0 if length == 0 else min(max(((x - x0) * dx + (y - y0) * dy) / length, 0.0), 1.0)
        if (x - x0 - at * dx) ** 2 + (y - y0 - at * dy) ** 2 > STRAIGHT**2:
            return False
    return True


def _followed(written: str, step: int) -> str:
    """Path data and a further number, parted by a space only where neither its sign nor its point begins it."""
    text = _short(step / STEPS_PER_POINT)
    last = re.sub(r".*[^\d.]", "", written[-12:])
    parted = not last or text.startswith("-") or (text.startswith(".") and "." in last)
    return f"{written}{text}" if parted else f"{written} {text}"


def _short(value: float) -> str:
    """A tenth at most, without a zero that says nothing: 3, -.5, 12.4."""
    text = f"{round(value * STEPS_PER_POINT) / STEPS_PER_POINT:g}"
    return re.sub(r"^(-?)0\.", r"\1.", "0" if text == "-0" else text)


def _rounded(numbers: str) -> str:
    return " ".join(_short(float(number)) for number in re.split(r"[ ,]+", numbers.strip()))


def _without_idle_groups(svg: str) -> str:
    """Without comments, space between elements, and groups that have no attribute."""
    written, opened, end = [], [], 0
    for token in _TOKEN.finditer(svg):
        between, tag, end = svg[end : token.start()], token[0], token.end()
        written.append(between if between.strip() else "")
        if tag.startswith("<!--"):
            continue
        if re.fullmatch(r"<g(?:\s[^>]*)?>", tag) and not tag.endswith("/>"):
            opened.append(tag != "<g>")
            written.append(tag if opened[-1] else "")
        elif tag == "</g>":
            written.append(tag if opened.pop() else "")
        else:
            written.append(tag)
    return "".join(written) + svg[end:].strip()
