"""The live page: what a browser is sent, how fast, and that it ends with the environment. The dark theme."""

import base64
import io
import socket
import threading
import time
import urllib.error
import urllib.request
from contextlib import closing

import gymnasium as gym
import numpy as np
import pytest

import cable_envs
from cable_envs.core.errors import ConfigurationError
from cable_envs.drawing import live
from cable_envs.render import Renderer, darkened
from tests.support.browser import CHROMIUM, browser

pytest.importorskip("matplotlib")
from PIL import Image

HOLE = "cable_envs/CableHole-Position-Sine-v0"


@pytest.fixture
def env(capfd):
    made = gym.make(HOLE, render_mode="web", disable_env_checker=True)
    made.reset(seed=0)
    yield made
    made.close()


def asked(address: str) -> tuple[int, int, bytes]:
    """(status, number of the picture, content)."""
    with urllib.request.urlopen(address, timeout=20) as answer:
        return answer.status, int(answer.headers["X-Number"]), answer.read()


def test_the_page_is_one_file_and_its_pictures_follow_the_environment(env, capfd):
    address = env.unwrapped._renderer.address
    assert address.startswith("http://127.0.0.1:") and f"live view at {address}" in capfd.readouterr().err
    page = asked(address)[2].decode()
    assert "<title>Cable-hole: CableHole-Position, sine" in page and "prefers-color-scheme: dark" in page
    assert "http" not in page and "src=" not in page and 'name="viewport"' in page
    status, first, content = asked(f"{address}frame?after=0")
    assert status == 200 and Image.open(io.BytesIO(content)).size == (960, 640)
    for _ in range(10):
        env.step(env.action_space.high)
    _, second, moved = asked(f"{address}frame?after={first}")
    assert second > first and moved != content and env.render() is None
    shown = np.asarray(Image.open(io.BytesIO(moved)), float)
    exact = env.unwrapped._renderer.frame().astype(float)
    assert np.abs(shown - exact).mean() < 6.0  # of 255: JPEG, and the pictures are some steps apart
    with pytest.raises(urllib.error.HTTPError):
        asked(f"{address}etc/passwd")


def test_a_reader_is_served_fifteen_pictures_a_second(env):
    address, served = env.unwrapped._renderer.address, []

    def read():
        number = 0
        while not served or served[-1]:
            try:
                _, number, content = asked(f"{address}frame?after={number}")
            except OSError:  # the page has ended while it was asked
                return
            served.append(content)

    reader = threading.Thread(target=read, daemon=True)
    reader.start()
    rates = []
    for _ in range(3):  # the machine may be busy
        before, began = len(served), time.monotonic()
        for _ in range(100):
            env.step(env.action_space.high)
        rates.append((len(served) - before) / (time.monotonic() - began))
        if rates[-1] >= 15.0:
            break
    assert max(rates) >= 15.0, rates


def test_the_page_ends_with_the_environment(env):
    address = env.unwrapped._renderer.address
    waiting = []

    def wait():
        number = asked(f"{address}frame?after=0")[1]
        waiting.append(asked(f"{address}frame?after={number}")[0])

    reader = threading.Thread(target=wait)
    reader.start()
    time.sleep(0.3)
    env.close()
    reader.join(5.0)
    assert waiting == [204]
    with pytest.raises(urllib.error.URLError):
        asked(address)


def test_the_port_can_be_fixed_for_a_tunnel(monkeypatch, capfd):
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    monkeypatch.setenv(live.PORT, str(port))
    page = live.WebPage("t", 30.0)
    assert page.address == f"http://127.0.0.1:{port}/"
    page.close()
    page.close()
    monkeypatch.setenv(live.PORT, "many")
    with pytest.raises(ConfigurationError, match="CABLE_ENVS_PORT=many: expected the number of a port"):
        live.WebPage("t", 30.0)


def test_a_batch_shows_its_first_environment(capfd):
    batch = gym.make_vec(HOLE, num_envs=2, vectorization_mode="vector_entry_point", render_mode="web")
    batch.reset(seed=0)
    (renderer,) = batch.unwrapped._pictures.renderers.values()
    assert asked(f"{renderer.address}frame?after=0")[0] == 200
    assert batch.render() is None
    batch.close()


@pytest.fixture(scope="module")
def tab(tmp_path_factory):
    if CHROMIUM is None:
        pytest.skip("no chromium on this machine (Debian: apt install chromium)")
    with browser(tmp_path_factory.mktemp("profile")) as opened:
        yield opened


PIXELS = """(async () => {
  for (let k = 0; k < 100 && !document.getElementById("state").textContent.startsWith("live"); k++)
    await new Promise(done => setTimeout(done, 50));
  const canvas = document.querySelector("canvas");
  return canvas.toDataURL("image/png").split(",")[1];
})()"""


def canvas_of(tab) -> np.ndarray:
    """What the page has drawn, before its theme turns the lightness round [height, width, 3]."""
    content = base64.b64decode(tab.evaluate(PIXELS))
    return np.asarray(Image.open(io.BytesIO(content)).convert("RGB"), float)


def screen_of(tab, path) -> np.ndarray:
    """What whoever looks at the page sees [height, width, 3]."""
    tab.photograph(path, 700)
    return np.asarray(Image.open(path).convert("RGB"), float)


@pytest.mark.slow
@pytest.mark.parametrize("env_id", [one for one in cable_envs.ENV_IDS if "-Sine-" in one])
def test_a_browser_draws_every_mechanism_light_and_dark(env_id, tab, tmp_path, capfd):
    with closing(gym.make(env_id, render_mode="web", disable_env_checker=True)) as env:
        env.reset(seed=0)
        address = env.unwrapped._renderer.address
        assert tab.show(address, 1000, False) == []
        before, light = canvas_of(tab), screen_of(tab, tmp_path / "light.png")
        for _ in range(20):
            env.step(env.action_space.high)
        wait = "new Promise(done => setTimeout(done, 400))"
        tab.evaluate(wait)
        after = canvas_of(tab)
        assert before.std() > 15.0 and np.count_nonzero(np.abs(after - before).max(axis=2) > 40.0) > 300
        assert tab.show(address, 390, True) == []
        canvas_of(tab)
        dark = screen_of(tab, tmp_path / "dark.png")
        assert tab.evaluate("document.documentElement.scrollWidth") <= 390
        assert light[:, :1000].mean() > 200.0 > 60.0 > dark[:, :390].mean()


def test_a_page_may_be_dark_from_the_start_and_is_sent_light_pictures(capfd):
    renderer = Renderer("cable_hole", {}, "t", mode="web", theme="dark")
    renderer.push({}, 0.0, 0.0, 0.0)
    renderer.show()
    assert b'<html lang="en" class="dark">' in asked(renderer.address)[2]
    sent = np.asarray(Image.open(io.BytesIO(asked(f"{renderer.address}frame?after=0")[2])))
    assert sent[0, 0].min() > 250 and renderer.frame()[0, 0].tolist() == [20, 20, 20]
    renderer.close()


def test_dark_turns_the_lightness_round_and_keeps_the_hues():
    pair = [Renderer("cable_hole", {}, "t", theme=theme) for theme in ("light", "dark")]
    light, dark = (renderer.frame() for renderer in pair)
    assert light.shape == dark.shape and dark.dtype == np.uint8
    assert light[0, 0].tolist() == [255, 255, 255] and dark[0, 0].tolist() == [20, 20, 20]
    red = darkened(np.array([[[200, 30, 30]]], np.uint8))[0, 0]
    assert red[0] > red[1] == red[2]
    with pytest.raises(ConfigurationError, match="unknown theme 'drak'; did you mean 'dark'"):
        Renderer("cable_hole", {}, theme="drak")
