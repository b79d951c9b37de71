"""Figures made small: the same points, the same words, and nothing that is referred to is lost."""

import io
import re

import numpy as np
import pytest

from cable_envs.drawing.compact_svg import STEPS_PER_POINT, STRAIGHT, compact_path, compact_svg, name_of
from tests.support.svg_paths import points_of


@pytest.fixture(scope="module")
def drawn():
    """A figure with a noisy curve, markers, a filled band, a legend and formulas, as matplotlib writes it."""
    import matplotlib
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure

    x = np.linspace(0, 1, 300)
    with matplotlib.rc_context({"svg.fonttype": "none", "svg.hashsalt": "test"}):
        figure = Figure(figsize=(4, 3))
        FigureCanvasSVG(figure)
        ax = figure.subplots()
        ax.plot(x, np.random.default_rng(0).normal(size=300), label="a  b <c>")
        ax.plot(x[::30], x[::30], "o", gid="entrant-3")
        ax.fill_between(x, -x, x, alpha=0.3)
        ax.set_xlabel("a $x^2$")
        ax.legend()
        buffer = io.StringIO()
        figure.savefig(buffer, format="svg", metadata={"Date": None})
    text = buffer.getvalue()
    return text[text.index("<svg") :]


def test_every_path_passes_the_same_points(drawn):
    before, after = (re.findall(r'\bd="([^"]*)"', text) for text in (drawn, compact_svg(drawn)))
    assert len(before) == len(after) > 10
    for old, new in zip(before, after, strict=True):
        wanted, found = points_of(old), points_of(new)
        assert len(found) <= len(wanted)
        # points are rounded, and errors do not add up; what is left out lies beside the line from one to the next
        near, rounded = (0.5 * np.sqrt(2.0) + STRAIGHT) / STEPS_PER_POINT, 0.5001 / STEPS_PER_POINT + 1e-6
        k = 0
        for point in wanted:
            while _beside(found, k, point) > near + 1e-6:
                k += 1
        assert np.abs(found[[0, -1]] - wanted[[0, -1]]).max() <= rounded


def _beside(points, k, point):
    """How far a point is from the k-th line of a path."""
    start, end = points[k], points[min(k + 1, len(points) - 1)]
    way = end - start
    share = np.clip((point - start) @ way / max(way @ way, 1e-12), 0.0, 1.0)
    return np.linalg.norm(point - start - share * way)


def words_of(svg: str) -> list[str]:
    """The text of each ``text`` element, formulas without their tags."""
    return [re.sub(r"<[^>]+>", "", text) for text in re.findall(r"<text\b.*?</text>", svg, re.DOTALL)]


def test_words_references_and_marks_stay(drawn):
    small = compact_svg(drawn)
    assert len(small) < 0.6 * len(drawn)
    assert words_of(small) == words_of(drawn) and "a  b &lt;c&gt;" in words_of(small)
    ids = set(re.findall(r' id="([^"]+)"', small))
    asked = set(re.findall(r'href="#([^"]+)"', small)) | set(re.findall(r"url\(#([^)]+)\)", small))
    assert asked == ids and len(asked) > 3
    assert small.count("<g") == small.count("</g>") and small.count("<use") == drawn.count("<use")
    classes = set(re.findall(r'class="([^"]+)"', small))
    assert classes and all(f".{name}{{" in small for name in classes)


def test_what_is_compact_comes_back_as_it_is(drawn):
    small = compact_svg(drawn)
    assert compact_svg(small) == small


def test_ids_are_numbered_behind_what_tells_figures_apart():
    text = '<svg><path id="f1-{0}"/><path id="f1-{1}"/><g clip-path="url(#f1-{1})"><use href="#f1-{0}"/></g></svg>'
    assert compact_svg(text.format("mdc5e06", "p16d03")) == text.format("0", "1")
    assert compact_svg(text.format("1", "0")) == text.format("0", "1")  # each is renamed once
    plain = '<svg><path id="mdc5e06"/><use href="#mdc5e06"/></svg>'
    assert compact_svg(plain) == plain


def test_a_turn_by_nothing_says_nothing():
    text = '<svg><text x="1.04" transform="rotate(-{} 1.04 2)">a</text></svg>'
    assert compact_svg(text.format("0")) == '<svg><text x="1">a</text></svg>'
    assert compact_svg(text.format("90")) == '<svg><text x="1" transform="rotate(-90 1 2)">a</text></svg>'


@pytest.mark.parametrize(
    ("data", "wanted"),
    [
        ("M 1.04 2 \nL 1.04 2.01 \nL 3 2 \nz\n", "M1 2h2z"),
        ("M 0 0 C 1 1 2 -1 3 0 C 4 1 5 1 6 0.26", "M0 0c1 1 2-1 3 0 1 1 2 1 3 .3"),
        ("M 5 5 L 5.5 4.5 L 6 4 M 0 0 L 1 1", "M5 5l1-1M0 0l1 1"),
        ("M 0 0 L 1 1 L 2 0 L 3 0.05 L 4 0 L 4 9 L 4 3", "M0 0l1 1 1-1h2v9-6"),
        ("M 0 0 A 1 1 0 0 1 2 2", "M 0 0 A 1 1 0 0 1 2 2"),
        ("", ""),
    ],
)
def test_paths_in_few_characters(data, wanted):
    assert compact_path(data) == wanted


def test_marks_of_one_class_in_a_row_are_a_group_and_what_cuts_off_is_in_the_style():
    """Four marks and four lines that one path cuts off; three lines that another one does keep it to themselves."""
    dots = "".join(f'<use href="#a" x="{k}" y="1" style="fill: #111"/>' for k in range(4))
    lines = "".join(f'<path d="M {k} 0 L {k} 9" clip-path="url(#c)" style="stroke: #222"/>' for k in range(4))
    others = "".join(f'<path d="M {k} 0 L {k} 9" clip-path="url(#e)" style="stroke: #222"/>' for k in range(3))
    clips = '<clipPath id="c"><path d="M 0 0 L 9 9"/></clipPath><clipPath id="e"><path d="M 0 0 L 9 9"/></clipPath>'
    svg = f'<svg><defs><style>*{{}}</style><path id="a" d="M 0 0 L 1 1"/>{clips}</defs>{dots}{lines}{others}</svg>'
    small = compact_svg(svg)
    dot, line, plain = (name_of(s) for s in ("fill:#111", "stroke:#222;clip-path:url(#c)", "stroke:#222"))
    assert f'<g class="{dot}"><use href="#a" x="0" y="1"/>' in small
    assert small.count(f'class="{line}"') == 4 and f".{line}{{stroke:#222;clip-path:url(#c)}}" in small
    assert small.count('clip-path="url(#e)"') == 3 and small.count(f'class="{plain}"') == 3
    assert compact_svg(small) == small
    faint = compact_svg(svg.replace("fill: #111", "fill: #111; opacity: 0.5"))  # marks that overlap would be one
    assert "<g class=" not in faint
