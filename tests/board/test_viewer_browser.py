"""The trace viewer of a task's page in a real browser: what it draws and reads, by mouse, finger and keyboard."""

from types import SimpleNamespace

import numpy as np
import pytest

from cablebench.board.board import build_board
from cablebench.board.pages.task import render_task
from cablebench.board.pages.traces import TICKED
from tests.support.board_records import ENTRANTS, made_protocol, made_records
from tests.support.browser import CHROMIUM, browser

TASK = "CableHole-Position-Sine"
PHONE = 380
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine (Debian: apt install chromium)")

DURATION, POINTS = 20.0, 201
SLOPE = 0.4
"""mm/s of the made-up output's error, so that a value says at what time it was read."""


def traces(run):
    """An error that grows in a straight line; the worst episode fails half-way."""

    def episode(end):
        t = np.linspace(0.0, end, POINTS).astype(np.float32)
        reference = 0.01 * np.sin(t)
        failed = np.array(end < DURATION)
        return {"time": t, "reference": reference, "output": reference - 1e-3 * SLOPE * t, "drive_tension": 50 + t,
                "load_tension": 0 * t + 49.0, "command": 20 + t, "failed": failed}  # fmt: skip

    return {"median": episode(DURATION), "worst": episode(DURATION / 2)}


@pytest.fixture(scope="module")
def opened(tmp_path_factory):
    protocol = made_protocol(episodes=2, tasks=tuple(t for t in made_protocol().tasks if t.short == TASK))
    board = build_board(protocol, [r for r in made_records(protocol) if r["track"] != "stress"])
    folder = tmp_path_factory.mktemp("viewer")
    (folder / "page.html").write_text(render_task(board, TASK, traces), "utf-8")
    with browser(folder / "profile") as tab:
        yield SimpleNamespace(tab=tab, url=(folder / "page.html").as_uri())


@pytest.fixture
def tab(opened):
    """The page anew, on a desk and in light."""
    assert opened.tab.show(opened.url, 1000, False) == []
    return opened.tab


def rows(tab):
    """The readings: entrant -> values by heading."""
    return tab.evaluate("""(() => { const table = document.querySelector('#viewer table');
      const heads = [...table.tHead.rows[0].cells].map(c => c.firstChild.data);
      return Object.fromEntries([...table.tBodies[0].rows].map(r => [r.cells[0].childNodes[1].data,
        Object.fromEntries([...r.cells].map((c, k) => [heads[k], c.textContent]))])); })()""")


def window(tab):
    """(from, to) in s as the sliders say it."""
    sides = ("from", "to")
    texts = [
        tab.evaluate(f"document.getElementById('viewer').elements.{s}.getAttribute('aria-valuetext')") for s in sides
    ]
    return tuple(float(text.removesuffix(" s")) for text in texts)


def key(tab, name, **more):
    tab.evaluate("document.querySelector('.traces').focus()")
    tab.ask("Input.dispatchKeyEvent", type="keyDown", key=name, **more)
    tab.ask("Input.dispatchKeyEvent", type="keyUp", key=name, **more)
    settle(tab)


def settle(tab):
    tab.evaluate("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")


def place(tab, share, down=100):
    """(x, y) of a point in the upper panel, at a share of its width."""
    tab.evaluate("document.querySelector('.traces').scrollIntoView({behavior: 'instant', block: 'center'})")
    box = tab.evaluate(
        "(() => { const b = document.querySelector('.traces').getBoundingClientRect(), "
        "p = document.querySelector('#panel-0 rect').getBBox(); return [b.x + p.x, b.y, p.width]; })()"
    )
    return box[0] + share * box[2], box[1] + down


def test_it_shows_the_ticked_entrants_and_four_panels(tab):
    assert tab.evaluate("document.getElementById('viewer').hidden") is False
    titles = tab.evaluate(
        "[...document.querySelectorAll('.traces text')].map(t => t.textContent).filter(t => t.includes('['))"
    )
    assert titles == [
        "reference and output [mm]", "error: reference − output [mm]", "tension [N]", "command [N]", "time [s]",
    ]  # fmt: skip
    assert len(rows(tab)) == TICKED
    assert tab.evaluate("document.querySelectorAll('#viewer fieldset input').length") == len(ENTRANTS)
    tab.evaluate("document.querySelector('#viewer fieldset input:not(:checked)').click()")
    assert len(rows(tab)) == TICKED + 1
    tab.evaluate("document.querySelectorAll('#viewer fieldset input:checked').forEach(i => i.click())")
    assert rows(tab) == {}
    assert "No entrant is chosen" in tab.evaluate("document.querySelector('#viewer figcaption').textContent")
    assert tab.evaluate("[...document.querySelectorAll('.traces rect')].every(r => r.height.baseVal.value >= 0)")


def test_the_pointer_reads_values_with_units(tab):
    x, y = place(tab, 0.5)
    tab.ask("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y)
    assert tab.evaluate("document.querySelector('#viewer caption').textContent") == "Values at 10.00 s"
    found = rows(tab)["ppo"]
    assert float(found["error"]) == pytest.approx(SLOPE * 10.0, abs=2e-3)
    assert float(found["reference"].replace("−", "-")) == pytest.approx(10 * np.sin(10.0), abs=2e-3)
    assert (found["tension, drive"], found["tension, load"], found["command"]) == ("60", "49", "30")
    units = tab.evaluate("[...document.querySelectorAll('#viewer thead small')].map(s => s.textContent)")
    assert units == ["mm", "mm", "mm", "N", "N", "N"]


def test_a_drag_zooms_and_the_button_shows_the_whole_episode(tab):
    (x, y), (end, _) = place(tab, 0.25), place(tab, 0.5)
    tab.ask("Input.dispatchMouseEvent", type="mousePressed", x=x, y=y, button="left", clickCount=1)
    tab.ask("Input.dispatchMouseEvent", type="mouseMoved", x=end, y=y, button="left", buttons=1)
    assert float(tab.evaluate("document.querySelector('[data-part=chosen]').getAttribute('width')")) == pytest.approx(
        end - x, abs=1
    )
    tab.ask("Input.dispatchMouseEvent", type="mouseReleased", x=end, y=y, button="left", clickCount=1)
    settle(tab)
    assert window(tab) == pytest.approx((5.0, 10.0), abs=0.05)
    labels = tab.evaluate("[...document.querySelectorAll('.traces text')].map(t => t.textContent)")
    assert "7.0" in labels and "15" not in labels
    tab.evaluate("document.getElementById('viewer').elements.whole.click()")
    settle(tab)
    assert window(tab) == (0.0, 20.0)


def test_a_short_press_only_moves_the_cursor(tab):
    x, y = place(tab, 0.25)
    tab.ask("Input.dispatchMouseEvent", type="mousePressed", x=x, y=y, button="left", clickCount=1)
    tab.ask("Input.dispatchMouseEvent", type="mouseReleased", x=x + 2, y=y, button="left", clickCount=1)
    settle(tab)
    assert window(tab) == (0.0, 20.0) and "Values at 5." in tab.evaluate(
        "document.querySelector('#viewer caption').textContent"
    )


def test_two_fingers_zoom_and_the_times_under_them_stay(tab):
    (a, y), (b, _), (c, _), (d, _) = (place(tab, share) for share in (0.4, 0.6, 0.2, 0.8))
    tab.ask("Emulation.setTouchEmulationEnabled", enabled=True, maxTouchPoints=2)
    try:
        touches = (("touchStart", (a,)), ("touchStart", (a, b)), ("touchMove", (c, d)))
        for kind, fingers in touches:
            points = [{"x": x, "y": y, "id": k} for k, x in enumerate(fingers)]
            tab.ask("Input.dispatchTouchEvent", type=kind, touchPoints=points)
        settle(tab)
        tab.ask("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])
    finally:
        tab.ask("Emulation.setTouchEmulationEnabled", enabled=False)
    # 8 s and 12 s were under the fingers; apart three times as far they show 20/3 s
    low, high = window(tab)
    assert high - low == pytest.approx(20.0 / 3, rel=0.05) and (low + high) / 2 == pytest.approx(10.0, abs=0.1)


def test_the_keyboard_moves_the_cursor_zooms_and_goes_back(tab):
    for _ in range(3):
        key(tab, "ArrowRight")
    assert tab.evaluate("document.querySelector('#viewer caption').textContent") == "Values at 0.30 s"
    key(tab, "End")
    assert float(rows(tab)["ppo"]["error"]) == pytest.approx(SLOPE * DURATION, abs=2e-3)
    key(tab, "Home")
    for _ in range(10):
        key(tab, "ArrowRight", modifiers=8)  # with shift: ten at once
    key(tab, "+")
    assert window(tab) == pytest.approx((5.0, 15.0), abs=0.05)
    key(tab, "-")
    assert window(tab) == (0.0, 20.0)
    key(tab, "+")
    key(tab, "0")
    assert window(tab) == (0.0, 20.0)


def test_the_sliders_zoom_and_never_cross(tab):
    slide = (
        "(() => {{ const s = document.getElementById('viewer').elements.{}; s.value = {}; "
        "s.dispatchEvent(new Event('input', {{bubbles: true}})); }})()"
    )
    tab.evaluate(slide.format("from", 500))
    settle(tab)
    assert window(tab) == pytest.approx((10.0, 20.0), abs=0.05)
    tab.evaluate(slide.format("to", 100))
    settle(tab)
    low, high = window(tab)
    assert 0.0 < high - low <= 0.1


def test_a_failure_is_marked_where_the_episode_ends(tab):
    assert tab.evaluate("document.querySelectorAll('.traces .failure').length") == 0
    tab.evaluate("document.querySelector('#viewer input[value=worst]').click()")
    assert tab.evaluate("document.querySelectorAll('.traces .failure').length") == 2 * TICKED  # output and error
    assert window(tab) == (0.0, 10.0)
    assert "failed at 10.00 s" in rows(tab)["ppo"]["controller"]


@pytest.mark.parametrize("dark", [False, True])
def test_it_fits_a_phone_in_light_and_in_the_dark(opened, dark):
    tab = opened.tab
    assert tab.show(opened.url, PHONE, dark) == []
    assert tab.evaluate("document.documentElement.scrollWidth") <= PHONE
    left, right, height = tab.evaluate(
        "(() => { const b = document.querySelector('.traces svg').getBoundingClientRect(); "
        "return [b.left, b.right, b.height]; })()"
    )
    assert left >= 0 and right <= PHONE and height < 900
    sizes = tab.evaluate(
        "[...document.querySelectorAll('.traces text')].map("
        "t => parseFloat(getComputedStyle(t).fontSize) * t.getScreenCTM().a)"
    )
    assert min(sizes) >= 11.0
    turned = tab.evaluate("getComputedStyle(document.querySelector('.traces svg')).filter")
    assert ("invert" in turned) is dark
