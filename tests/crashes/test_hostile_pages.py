"""Texts of records stay texts on every page: of the proof, of a diagnosis and of the recordings.

Every key of the published records whose values are free texts is made hostile, many keys at once; keys whose values are
words of the program (a verdict, a kind) make the page fail instead, and are found by halves and left out.
"""

import shutil
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path

import pytest
from jinja2 import UndefinedError
from markdown_it import MarkdownIt

from cable_envs.core.files import jsonable, packed_json, read_json
from cable_envs.diagnosis.engine import diagnose
from cablebench.pages import diagnosis, proof, recordings
from tests.support import drive_recording

DOCS = Path(__file__).parents[2] / "docs"
EVIL = "<script>alert(1)</script>\"'><img src=x onerror=alert(1)>\n|`x`[a](javascript:b)\x1b[31m&lt;b&gt;"
TURNED = "text.transform"
"""Of an axis's label that stands upright: a page that is told other things draws other figures."""


class Tags(HTMLParser):
    """Elements with their attributes, and where links lead."""

    def __init__(self, text):
        super().__init__()
        self.found = set()
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        self.found |= {tag, *(f"{tag}.{name}" for name, _ in attributes)}
        self.found |= {value for _, value in attributes if value and value.strip().lower().startswith("javascript:")}


def keys_of(value) -> Iterator[str]:
    """Keys with a text somewhere directly under them."""
    if isinstance(value, dict):
        for key, part in value.items():
            if isinstance(part, str) or (isinstance(part, list) and part and isinstance(part[0], str)):
                yield key
            yield from keys_of(part)
    elif isinstance(value, list):
        for part in value:
            yield from keys_of(part)


def poisoned(value, keys):
    """The same with hostile texts under these keys, at any depth."""
    if isinstance(value, dict):
        return {k: _evil(v) if k in keys else poisoned(v, keys) for k, v in value.items()}
    return [poisoned(v, keys) for v in value] if isinstance(value, list) else value


def drawn(render, record, keys) -> Iterator[tuple[list[str], str]]:
    """(keys, page with hostile texts under them) for all keys with which there is a page, as many at once as can be."""
    try:
        yield keys, render(poisoned(record, keys))
    except (KeyError, ValueError, TypeError, StopIteration, IndexError, UndefinedError):
        if len(keys) > 1:
            yield from drawn(render, record, keys[: len(keys) // 2])
            yield from drawn(render, record, keys[len(keys) // 2 :])


def _evil(value):
    if isinstance(value, str):
        return value + EVIL
    return [v + EVIL if isinstance(v, str) else v for v in value] if isinstance(value, list) else value


def rendered_markdown(text):
    return MarkdownIt("commonmark", {"html": True}).enable("table").render(text)


def answer(folder):
    """The record of a diagnosis."""
    recording = drive_recording.write(folder / "recording", load=lambda y, v, t: 1500.0 * y)
    return jsonable(diagnose(recording, effects=["position_dependent_load"]).as_json())


def recordings_page(record, folder):
    shutil.copytree(DOCS / "recordings", folder, dirs_exist_ok=True)
    (folder / "emps.json.xz").write_bytes(packed_json(record))
    return recordings.render(folder, ["davinci", "band-brake", "emps", "coupled-drives"])


PAGES = {
    "proof": (lambda _: read_json(DOCS / "proof" / "proof.json.xz"), lambda r, _: proof.render(r)),
    "recordings": (lambda _: read_json(DOCS / "recordings" / "emps.json.xz"), recordings_page),
    "a diagnosis": (answer, lambda r, _: diagnosis.render(r)),
}


@pytest.mark.filterwarnings("ignore:Glyph")  # a control character in a label: a warning, and no more
@pytest.mark.parametrize("name", PAGES)
def test_no_element_and_no_attribute_comes_from_a_text(tmp_path, name):
    load, render = PAGES[name]
    record = load(tmp_path)
    before, tried = Tags(render(record, tmp_path)).found | {TURNED}, []
    for keys, page in drawn(lambda hostile: render(hostile, tmp_path), record, sorted(set(keys_of(record)))):
        tried += keys
        assert Tags(page).found <= before, (keys, Tags(page).found - before)
    assert len(tried) >= 3, tried
