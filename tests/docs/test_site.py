"""The site, built and opened in a real browser: on a phone and on a desk, in light and in dark; and all its links."""

import functools
import http.server
import re
import subprocess
import sys
import threading
from html.parser import HTMLParser
from urllib.parse import unquote, urlsplit

import numpy as np
import pytest

from cable_envs import FIRST_IDS, SUITE_IDS
from cable_envs.effects import EFFECTS
from cable_envs.plants import families
from tests.support.browser import CHROMIUM, browser
from tests.support.tree import ROOT

pytest.importorskip("mkdocs", reason="no mkdocs: pip install -c constraints.txt '.[docs]'")
pytest.importorskip("material", reason="no mkdocs-material: pip install -c constraints.txt '.[docs]'")
pytestmark = [pytest.mark.slow, pytest.mark.timeout(1800)]

KINDS = (
    "index.html", "environments/index.html", "environments/cable-hole-position.html", "plants/index.html",
    "plants/tendon-sheath.html", "plants/band-brake.html", "effects.html", "controllers.html", "boards.html",
    "reproduction.html", "api/index.html", "api/environments.html", "diagnosis.html", "proof/proof.html",
    "recordings/index.html", "mismatches/extrusion-ratio.html", "mismatches/index.html", "glossary.html", "cite.html",
    "changelog.html", "contributing.html", "commands.html", "your-own-recording.html", "physics.html",
    "identification.html", "interop.html", "read-the-board.html", "plants/linear-drive.html", "mismatches/load.html",
    "cable-mechanisms.html",
    "reports/board-quick/board.html", "reports/board-quick/tasks/PulleyCircuit-Position-Sine.html",
    "reports/board-suite-v1/board.html",
    "reports/board-suite-v1/tasks/CableHole-Track-Hard.html", "reports/proof.html", "reports/recordings.html",
    "reports/reproduction.html",
)  # fmt: skip
"""One page of each kind at least."""
OF_REPRODUCE = "reports/reproduction.html"
"""Built only after `cablebench reproduce`, which takes minutes."""
SCREENS = [(width, dark) for width in (390, 1280) for dark in (False, True)]
LEAST_TEXT = 11.0
"""Pixels of the letters in a figure, to a tenth."""
LEAST_CONTRAST = 4.5
"""Of text on its background (WCAG 2.2, 1.4.3)."""

LETTERS = """(async () => {
  const found = [];
  // the words of a figure; letters that are raised or lowered within a word are left aside
  const measure = (root, name) => {
    for (const t of root.querySelectorAll('svg text')) {
      const scale = t.getScreenCTM();
      if (!t.textContent.trim() || !scale || !t.getClientRects().length) continue;
      const sizes = [t, ...t.querySelectorAll('tspan')].map(e => parseFloat(getComputedStyle(e).fontSize));
      found.push([Math.max(...sizes) * Math.hypot(scale.a, scale.b), t.textContent.trim(), name]);
    }
  };
  measure(document, 'on the page');
  for (const image of [...document.images].filter(i => i.src.endsWith('.svg'))) {
    const box = document.body.appendChild(document.createElement('div'));
    box.innerHTML = (await (await fetch(image.src)).text()).replace(/^<[?][^]*?[?]>/, '');
    const svg = box.querySelector('svg');
    svg.setAttribute('style', `width: ${image.clientWidth}px; height: auto; max-width: none`);
    measure(box, image.src);
    box.remove();
  }
  return found.sort((a, b) => a[0] - b[0]).slice(0, 3);
})()"""
PICTURES = """[...document.querySelectorAll('.md-content img:not(.twemoji), figure svg')].map(e => {
  const at = e.getBoundingClientRect(), name = (e.src || 'figure').split('/').pop();
  return [at.x, at.y + scrollY, at.right, at.bottom + scrollY, name];
})"""
PHOTOGRAPHED = 9000
"""Pixels of a page's height that are looked at."""
MEDIAN_DARK, MEDIAN_LIGHT = 60.0, 190.0
"""Of the brightness (of 255) at a picture's edge, where its ground is."""
TALLEST_ROW = 600
"""Pixels of a row of a table on a phone, two thirds of its screen: no column is squeezed to a word a line."""
SEARCH = """(async () => {
  const field = document.querySelector('.md-search__input');
  field.focus();
  field.value = 'backlash';
  for (let n = 0; n < 100 && !document.querySelector('.md-search-result__item'); n++) {
    field.dispatchEvent(new Event('keyup', {bubbles: true}));
    await new Promise(done => setTimeout(done, 100));
  }
  return document.querySelectorAll('.md-search-result__item').length;
})()"""
ROWS = "[...document.querySelectorAll('tbody tr')].map(e => [e.clientHeight, e.textContent.trim().slice(0, 60)])"
CUT = """[...document.querySelectorAll('caption')].filter(e => e.clientWidth > innerWidth).map(e => e.textContent)"""
BROKEN = "[...document.images].filter(i => !i.naturalWidth).map(i => i.src)"
CONTRAST = """(() => {
  const parts = c => (c.match(/[\\d.]+/g) || []).map(Number);
  const light = c => { const [r, g, b] = c.map(v => (v /= 255) <= .04045 ? v / 12.92 : ((v + .055) / 1.055) ** 2.4);
                       return .2126 * r + .7152 * g + .0722 * b; };
  const worst = [];
  const where = document.querySelector('.md-content') || document.querySelector('main');
  for (const e of where.querySelectorAll('p, li, td, th, h1, h2, h3, a, code')) {
    if (!e.getClientRects().length || ![...e.childNodes].some(n => n.nodeType === 3 && n.data.trim())) continue;
    if (e.classList.contains('headerlink')) continue;  // drawn when it is pointed at
    let back = [], filtered = false;
    for (let up = e; up; up = up.parentElement) {
      if (getComputedStyle(up).filter !== 'none' || getComputedStyle(up).opacity !== '1') filtered = true;
      const c = parts(getComputedStyle(up).backgroundColor);
      if (!back.length && (c.length === 3 || c[3] === 1)) back = c;
    }
    const ink = parts(getComputedStyle(e).color);
    if (filtered || ink[3] === 0) continue;
    const on = back.length ? back.slice(0, 3) : [255, 255, 255], alpha = ink.length === 4 ? ink[3] : 1;
    const a = light(ink.slice(0, 3).map((v, k) => alpha * v + (1 - alpha) * on[k])), b = light(on);
    worst.push([(Math.max(a, b) + .05) / (Math.min(a, b) + .05), e.tagName, e.textContent.trim().slice(0, 40)]);
  }
  return worst.sort((a, b) => a[0] - b[0]).slice(0, 3);
})()"""


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The folder of a site that was built strictly: a dead link within the pages of MkDocs fails here."""
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(folder)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-3000:]
    return folder


@pytest.fixture(scope="module")
def address(site):
    class Quiet(http.server.SimpleHTTPRequestHandler):
        def log_message(self, *_):
            pass

    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Quiet, directory=str(site)))
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    yield f"http://127.0.0.1:{server.server_port}"
    server.shutdown()
    thread.join()
    server.server_close()


@pytest.fixture(scope="module")
def tab(tmp_path_factory):
    if CHROMIUM is None:
        pytest.skip("no chromium on this machine (Debian: apt install chromium)")
    with browser(tmp_path_factory.mktemp("profile")) as opened:
        yield opened


class Links(HTMLParser):
    """Where a page leads, what it shows, and its anchors."""

    def __init__(self, text: str):
        super().__init__()
        self.to: list[str] = []
        self.anchors: set[str] = set()
        self.fetched: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        found = dict(attrs)
        self.anchors |= {found[key] for key in ("id", "name") if found.get(key)}
        self.to += [found[key] for key in ("href", "src") if found.get(key)]
        if tag in ("img", "script", "iframe") or (
            tag == "link" and found.get("rel") not in ("canonical", "prev", "next")
        ):
            self.fetched += [found[key] for key in ("href", "src") if found.get(key)]


def test_every_link_leads_somewhere_and_nothing_is_fetched_from_elsewhere(site):
    pages = {path: Links(path.read_text(encoding="utf-8")) for path in site.rglob("*.html") if path.name != "404.html"}
    dead, foreign = [], []
    for page, links in pages.items():
        foreign += [(page.name, to) for to in links.fetched if urlsplit(to).netloc]
        for to in links.to:
            parts = urlsplit(to)
            if parts.scheme or parts.netloc:
                continue
            target = (page.parent / unquote(parts.path)).resolve() if parts.path else page
            target = target / "index.html" if target.is_dir() else target
            known = pages[target].anchors if target in pages else set()
            # a board's filters are in its address, behind the sign of an anchor
            missing = (
                parts.fragment
                and target in pages
                and "=" not in parts.fragment
                and unquote(parts.fragment) not in known
            )
            if not target.is_file() or missing:
                dead.append((str(page.relative_to(site)), to))
    assert foreign == []
    assert dead == []


def test_the_search_answers_in_a_site_that_is_opened_from_a_folder(site, tab):
    assert tab.show((site / "index.html").as_uri(), 1280, False) == []
    assert tab.evaluate(SEARCH) > 0


def test_all_that_is_declared_has_its_page(site):
    declared = FIRST_IDS + SUITE_IDS
    tasks = {env_id.split("/")[1].rsplit("-", 2)[0] for env_id in declared}
    text = "".join(path.read_text(encoding="utf-8") for path in (site / "environments").glob("*.html"))
    assert len(list((site / "environments").glob("*.html"))) == len(tasks) + 1
    assert [env_id for env_id in declared if env_id not in text] == []
    assert {path.stem for path in (site / "plants").glob("*.html")} >= {name.replace("_", "-") for name in families()}
    catalogue = (site / "effects.html").read_text(encoding="utf-8")
    assert [name for name in EFFECTS if f'id="{name}"' not in catalogue] == []
    assert [name for name in EFFECTS if f'src="effects/{name}-' not in catalogue] == []


@pytest.mark.parametrize("name", KINDS)
def test_a_page_is_whole_on_a_phone_and_in_the_dark(site, address, tab, name):
    if name == OF_REPRODUCE and not (site / name).is_file():
        pytest.skip("not built")
    for width, dark in SCREENS:
        screen = f"{name}, {width} px, {'dark' if dark else 'light'}"
        assert tab.show(f"{address}/{name}", width, dark) == [], screen
        assert tab.evaluate("document.documentElement.scrollWidth") <= width, screen
        assert tab.evaluate(BROKEN) == [], screen
        assert [found for found in tab.evaluate(LETTERS) if found[0] < LEAST_TEXT - 0.1] == [], screen
        assert tab.evaluate(CUT) == [], screen
        assert width > 390 or [row for row in tab.evaluate(ROWS) if row[0] > TALLEST_ROW] == [], screen
        faint = [found for found in tab.evaluate(CONTRAST) if found[0] < LEAST_CONTRAST]
        assert faint == [], screen
        background = tab.evaluate("getComputedStyle(document.body).backgroundColor")
        assert (sum(map(float, re.findall(r"[\d.]+", background)[:3])) < 3 * 80) is dark, (screen, background)


@pytest.mark.parametrize("name", KINDS)
def test_pictures_have_the_ground_of_the_page(site, address, tab, tmp_path, name):
    image = pytest.importorskip("PIL.Image")
    if name == OF_REPRODUCE and not (site / name).is_file():
        pytest.skip("not built")
    for dark in (False, True):
        tab.show(f"{address}/{name}", 1280, dark)
        places = [place for place in tab.evaluate(PICTURES) if place[3] <= PHOTOGRAPHED]
        if not places:
            continue
        tab.photograph(tmp_path / "page.png", min(PHOTOGRAPHED, tab.evaluate("document.documentElement.scrollHeight")))
        with image.open(tmp_path / "page.png") as opened:
            page = opened.convert("L")
        for left, top, right, bottom, picture in places:
            part = page.crop((round(left), round(top), round(min(right, 1280.0)), round(bottom)))
            if min(part.size) < 40:
                continue
            seen = np.asarray(part)
            median = float(np.median(np.concatenate([seen[:3].ravel(), seen[-3:].ravel(), seen[:, :3].ravel()])))
            assert median < MEDIAN_DARK if dark else median > MEDIAN_LIGHT, (name, picture, median)
