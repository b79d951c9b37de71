"""The report of a diagnosis in a real browser: it fits a phone, light and dark."""

import pytest

from cablebench.pages.diagnosis import render
from tests.diagnosis.test_headline import CASES
from tests.support.browser import CHROMIUM, browser

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine (Debian: apt install chromium)")
CONTRAST = """(() => {
  const light = c => {
    const [r, g, b] = c.match(/[\\d.]+/g).map(Number);
    return 0.2126 * r + 0.7152 * g + 0.0722 * b;
  };
  const of = e => getComputedStyle(e);
  return Math.abs(light(of(document.querySelector('h1')).color) - light(of(document.body).backgroundColor));
})()"""


def report(tmp_path):
    """A page with many effects that look like many others, as rigs with sensors have them."""
    record = CASES["class, and more is left"]
    (row,) = record["hypotheses"]
    alike = [f"sensor_scale.channel_{k}" for k in range(15)]
    rows = [
        {**row, "name": name, "looks_like": alike, "state": "not refitted: its score is too small"} for name in alike
    ]
    least = {"minimum_detectable": dict.fromkeys(alike, "no size within its bounds; it would take 23.4 N m/rad")}
    page = tmp_path / "report.html"
    page.write_text(render({**record, "hypotheses": rows, "test": {**record["test"], **least}}), encoding="utf-8")
    return page.as_uri()


def test_the_report_fits_a_phone(tmp_path):
    url = report(tmp_path)
    with browser(tmp_path / "profile") as tab:
        for width, dark in ((360, False), (360, True), (1280, False)):
            assert tab.show(url, width, dark) == []
            assert tab.evaluate("document.documentElement.scrollWidth") <= width  # tables scroll in their own box
            heights = tab.evaluate("[...document.querySelectorAll('.tried tr')].map(r => r.offsetHeight)")
            assert max(heights) < (100 if width == 360 else 220)
            shown = tab.evaluate("[...document.querySelectorAll('.tried th')].filter(h => h.offsetWidth).length")
            assert shown == (4 if width == 360 else 7)
            assert tab.evaluate("document.querySelector('h1').scrollWidth") <= width
            assert tab.evaluate(CONTRAST) > 120  # of 255: the headline stands out from the paper
