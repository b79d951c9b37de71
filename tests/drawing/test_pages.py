"""Pages of one look: one base template with one style, which every page extends; charts that several pages can hold."""

import re

import pytest

from cable_envs.drawing import charts, pages
from tests.support.tree import FOLDERS, ROOT

SHARED = ROOT / "cable_envs" / "drawing" / "templates"
TEMPLATES = [p for package in FOLDERS for p in sorted((ROOT / package).rglob("*.html.j2")) if p.parent != SHARED]


def test_there_are_pages_to_look_at():
    assert {p.stem.removesuffix(".html") for p in TEMPLATES} >= {"board", "diagnosis", "proof", "recordings"}


@pytest.mark.parametrize("path", TEMPLATES, ids=lambda p: p.stem)
def test_a_page_extends_the_base_and_brings_no_style(path):
    text = path.read_text(encoding="utf-8")
    assert text.startswith('{% extends "page.html.j2" %}\n')
    assert "<style" not in text and "<html" not in text and not re.search(r'style="(?!width|background)', text)


@pytest.mark.parametrize("path", TEMPLATES, ids=lambda p: p.stem)
def test_a_page_uses_only_classes_that_the_style_knows(path):
    """A class without a rule is a mistake, unless the page's script looks for it."""
    style = (SHARED / "page.css").read_text(encoding="utf-8")
    text = re.sub(r"\{%.*?%\}|\{\{.*?\}\}", " ", path.read_text(encoding="utf-8"))
    used = {name for found in re.findall(r'class="([^"]*)"', text) for name in found.split()}
    known = set(re.findall(r"\.([a-z][a-z-]*)", style)) | {"sortable", "family", "replay"}
    assert used <= known, used - known


def test_the_style_is_for_light_and_dark_for_phones_and_for_paper():
    style = (SHARED / "page.css").read_text(encoding="utf-8")
    for query in ("prefers-color-scheme: dark", "max-width: 640px", "media print"):
        assert query in style
    light, dark = (set(re.findall(r"(--[a-z]+):", part)) for part in style.split("prefers-color-scheme: dark")[:2])
    assert light == dark  # every colour has its counterpart


def test_what_is_missing_is_an_error_and_texts_are_escaped(tmp_path, monkeypatch):
    from jinja2 import UndefinedError

    place = tmp_path / "a_page"
    place.mkdir()
    (place / "__init__.py").write_text("")
    (place / "t.html.j2").write_text('{% extends "page.html.j2" %}\n{% block main %}<p>{{ said }}</p>{% endblock %}')
    monkeypatch.syspath_prepend(tmp_path)
    page = pages.render("a_page", "t.html.j2", {"said": "a < b"})
    assert page.startswith("<!doctype html>") and "<p>a &lt; b</p>" in page and page.count("<style>") == 1
    with pytest.raises(UndefinedError, match="said"):
        pages.render("a_page", "t.html.j2", {})


def test_a_chart_is_the_same_each_time_and_shares_no_id_with_another():
    def line(height):
        def draw(figure):
            ax = figure.subplots()
            ax.plot([0, 1], [0, height], label="one")
            charts.legend_below(figure, [ax], gap=0.3)

        return draw

    first, again, other = charts.svg(line(1.0), 3.0, 2.0), charts.svg(line(1.0), 3.0, 2.0), charts.svg(line(9.0), 3, 2)
    assert first == again != other
    ids = [set(re.findall(r' id="([^"]+)"', text)) for text in (first, other)]
    assert ids[0] and not ids[0] & ids[1]
    assert set(re.findall(r'href="#([^"]+)"', first)) <= ids[0]
