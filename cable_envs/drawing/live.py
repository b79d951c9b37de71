"""Pictures that are shown while a mechanism runs: in a window of its own, or on a web page of this machine.

Both keep up with simulated time. The page needs no display and no library beyond Pillow, which matplotlib brings: it
works through an SSH tunnel (`ssh -L PORT:127.0.0.1:PORT`) and inside a notebook.
"""

import html
import io
import math
import os
import sys
import threading
import time as clock
from collections.abc import Callable
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from typing import Any
from urllib.parse import parse_qs, urlsplit

import numpy as np

from cable_envs.core.errors import ConfigurationError

PORT = "CABLE_ENVS_PORT"
"""Variable of the environment that fixes the page's port; without it a free one is taken."""

PATIENCE = 10.0
"""s that a request waits for the next picture."""

QUALITY = 90
"""of the JPEG pictures that the page is sent"""


class Shown:
    """What is shown at most ``fps`` times a simulated second, and no faster than real time."""

    def __init__(self, fps: float):
        self._period = 1.0 / fps
        self._open = True
        self._shown = self._origin = -math.inf  # simulated time of the last picture; wall clock minus simulated time

    def show(self, time: float, frame: Callable[[], np.ndarray]) -> None:
        """Put the picture of a moment where it is due. Once closed by the user, nothing is done."""
        if not self._open:
            return
        due = not self._shown <= time < self._shown + self._period - 1e-9
        if due:
            self._put(frame())
        self._handle_events()
        if due and self._open:
            self._wait(time)
            self._shown = time

    def _put(self, picture: np.ndarray) -> None:
        raise NotImplementedError

    def _handle_events(self) -> None:
        """What must happen at every call, picture or not."""

    def _wait(self, time: float) -> None:
        """Sleep while simulated time is ahead of the wall clock; a late picture or a new episode sets a new origin."""
        ahead = self._origin + time - clock.monotonic()
        if 0.0 < ahead <= 2.0 * self._period and time > self._shown:
            clock.sleep(ahead)
        else:
            self._origin = clock.monotonic() - time

    def close(self) -> None:
        """Take it away; it may be called more than once."""
        self._open = False


class Window(Shown):
    """A pygame window."""

    def __init__(self, caption: str, fps: float):
        super().__init__(fps)
        os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
        try:
            import pygame
        except ImportError as error:
            raise ImportError("a window needs pygame: pip install 'cable-envs[render]'") from error
        self._pygame, self._caption = pygame, caption
        self._surface: Any = None

    def _put(self, picture: np.ndarray) -> None:
        pygame = self._pygame
        size = picture.shape[1], picture.shape[0]
        if self._surface is None:
            pygame.display.init()
            self._surface = pygame.display.set_mode(size)
            pygame.display.set_caption(self._caption)
        self._surface.blit(pygame.image.frombuffer(picture.tobytes(), size, "RGB"), (0, 0))
        pygame.display.flip()

    def _handle_events(self) -> None:
        """Without this the window system takes the window for frozen."""
        if self._surface is not None and any(e.type == self._pygame.QUIT for e in self._pygame.event.get()):
            self.close()

    def close(self) -> None:
        """Close the window."""
        if self._surface is not None:
            self._pygame.display.quit()
            self._surface = None
        super().close()


class WebPage(Shown):
    """A page at an address of this machine, which nobody else can reach; it is printed on standard error.

    The page asks for the picture after the one that it has (``/frame?after=N``) and draws it on a canvas. Only what is
    asked for is encoded. It is dark where the browser asks for that, or from the start with ``dark``.

    Attributes
    ----------
    address : str
        As "http://127.0.0.1:43211/".
    """

    def __init__(self, caption: str, fps: float, dark: bool = False):
        super().__init__(fps)
        self._caption, self._dark = caption, dark
        self._news = threading.Condition()
        self._count, self._picture = 0, np.zeros((1, 1, 3), np.uint8)
        self._encoded: tuple[int, bytes] = (0, b"")
        self._server = _server(self)
        self.address = f"http://127.0.0.1:{self._server.server_address[1]}/"
        threading.Thread(target=self._server.serve_forever, args=(0.05,), daemon=True).start()
        print(f"cable_envs: live view at {self.address}", file=sys.stderr, flush=True)

    def _put(self, picture: np.ndarray) -> None:
        with self._news:
            self._count, self._picture = self._count + 1, picture
            self._news.notify_all()

    def after(self, number: int) -> tuple[int, bytes]:
        """The newest picture as JPEG with its number, once it is another one than ``number``; empty if none came."""
        from PIL import Image

        with self._news:
            self._news.wait_for(lambda: self._count != number or not self._open, PATIENCE)
            if self._count == number or not self._open:
                return number, b""
            if self._encoded[0] != self._count:
                buffer = io.BytesIO()
                Image.fromarray(self._picture).save(buffer, "JPEG", quality=QUALITY, subsampling=0)
                self._encoded = self._count, buffer.getvalue()
            return self._encoded

    def page(self) -> bytes:
        """The page itself: one file, which asks for nothing but the pictures."""
        text = files("cable_envs").joinpath("drawing/templates/live.html").read_text(encoding="utf-8")
        text = text.replace('<html lang="en">', '<html lang="en" class="dark">') if self._dark else text
        return text.replace("CAPTION", html.escape(self._caption)).encode()

    def close(self) -> None:
        """End the server; the page says that it is over."""
        if self._open:
            with self._news:
                super().close()
                self._news.notify_all()
            self._server.shutdown()
            self._server.server_close()


def _server(shown: WebPage) -> ThreadingHTTPServer:
    class Answer(BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.1"

        def do_GET(self) -> None:
            asked = urlsplit(self.path)
            if asked.path == "/":
                self._send(200, "text/html; charset=utf-8", shown.page())
            elif asked.path == "/frame":
                text = parse_qs(asked.query).get("after", ["0"])[0]
                number, content = shown.after(int(text) if text.isdecimal() else 0)
                self._send(200 if content else 204, "image/jpeg", content, number)
            else:
                self._send(404, "text/plain", b"")

        def _send(self, status: int, kind: str, content: bytes, number: int = 0) -> None:
            self.send_response(status)
            self.send_header("Content-Type", kind)
            self.send_header("Content-Length", str(len(content)))
            self.send_header("Cache-Control", "no-store")
            self.send_header("X-Number", str(number))
            self.end_headers()
            self.wfile.write(content)

        def log_message(self, *_: Any) -> None:
            """Requests are no news."""

    asked = os.environ.get(PORT, "0")
    if not asked.isdecimal() or int(asked) > 65535:
        raise ConfigurationError(f"{PORT}={asked}: expected the number of a port, 0 to 65535")

    class Server(ThreadingHTTPServer):
        daemon_threads = True

        def handle_error(self, *_: Any) -> None:
            """A reader who goes away is no error."""

    try:
        return Server(("127.0.0.1", int(asked)), Answer)
    except OSError as error:
        raise ConfigurationError(f"{PORT}={asked}: {error.strerror or error}; choose another port") from error
