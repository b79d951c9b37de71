"""A headless Chromium over its debugging pipe: pages at any width, light or dark, with what their consoles say."""

import base64
import json
import os
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
SETTLE = """new Promise(done => {
  const images = [...document.images]; images.forEach(i => { i.loading = 'eager'; });
  const waits = images.map(i => i.decode().catch(() => null));
  Promise.all(waits).then(() => requestAnimationFrame(() => setTimeout(done, 60)));
})"""
"""Until every picture of a page is there, the lazy ones too."""


class Browser:
    """One tab. Messages are JSON objects that end with a null byte, on two pipes."""

    def __init__(self, profile: Path):
        here_reads, there_writes = os.pipe()
        there_reads, here_writes = os.pipe()
        command = [
            str(CHROMIUM), "--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--hide-scrollbars",
            "--disable-background-networking", "--disable-dev-shm-usage", "--remote-debugging-pipe",
            f"--user-data-dir={profile}", "about:blank",
        ]  # fmt: skip
        line = f'exec "$@" 3<&{there_reads} 4>&{there_writes}'
        self.process = subprocess.Popen(
            ["bash", "-c", line, "bash", *command], pass_fds=(there_reads, there_writes),
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        os.close(there_reads)
        os.close(there_writes)
        self.pipe_in = os.fdopen(here_reads, "rb", buffering=0)
        self.pipe_out = os.fdopen(here_writes, "wb", buffering=0)
        self.waiting, self.events, self.number, self.session = b"", [], 0, None
        target = self.ask("Target.createTarget", url="about:blank")["targetId"]
        self.session = self.ask("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.ask(f"{domain}.enable")

    def _receive(self) -> dict[str, Any]:
        while b"\0" not in self.waiting:
            more = self.pipe_in.read(1 << 16)
            assert more, "the browser has ended"
            self.waiting += more
        message, _, self.waiting = self.waiting.partition(b"\0")
        return json.loads(message)

    def ask(self, method: str, **parameters: Any) -> dict[str, Any]:
        """The answer to one command; events that come before it are kept."""
        self.number += 1
        message = {"id": self.number, "method": method, "params": parameters}
        if self.session:
            message["sessionId"] = self.session
        self.pipe_out.write(json.dumps(message).encode() + b"\0")
        while True:
            answer = self._receive()
            if answer.get("id") == self.number:
                assert "error" not in answer, (method, answer["error"])
                return answer["result"]
            self.events.append(answer)

    def evaluate(self, expression: str) -> Any:
        """The value of JavaScript, awaited where it is a promise."""
        result = self.ask("Runtime.evaluate", expression=expression, awaitPromise=True, returnByValue=True)
        assert "exceptionDetails" not in result, result
        return result["result"].get("value")

    def show(self, url: str, width: int, dark: bool) -> list[str]:
        """Open a page and wait until it is whole; what went wrong on it."""
        self.ask("Emulation.setDeviceMetricsOverride", width=width, height=900, deviceScaleFactor=1, mobile=False)
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.ask("Emulation.setEmulatedMedia", features=[scheme])
        self.events.clear()
        self.ask("Page.navigate", url=url)
        while not any(e.get("method") == "Page.loadEventFired" for e in self.events):
            self.events.append(self._receive())
        self.evaluate(SETTLE)
        return [said for event in self.events if (said := _complaint(event))]

    def photograph(self, path: Path, height: int = 900) -> None:
        """The upper ``height`` pixels of the page as a PNG."""
        width = self.evaluate("innerWidth")
        clip = {"x": 0, "y": 0, "width": width, "height": height, "scale": 1}
        shot = self.ask("Page.captureScreenshot", format="png", clip=clip, captureBeyondViewport=True)
        path.write_bytes(base64.b64decode(shot["data"]))

    def close(self) -> None:
        """End the browser."""
        self.ask("Browser.close")
        self.process.wait(20)
        self.pipe_in.close()
        self.pipe_out.close()


def _complaint(event: dict[str, Any]) -> str:
    """What an event says is wrong; empty for one that says nothing."""
    method, about = event.get("method"), event.get("params", {})
    if method == "Log.entryAdded" and about["entry"]["level"] == "error":
        return f"{about['entry']['text']} {about['entry'].get('url', '')}"
    if method == "Runtime.exceptionThrown":
        return str(about["exceptionDetails"].get("exception", about["exceptionDetails"]).get("description"))
    if method == "Runtime.consoleAPICalled" and about["type"] == "error":
        return str([value.get("value") for value in about["args"]])
    return ""


@contextmanager
def browser(profile: Path) -> Iterator[Browser]:
    """A browser that is ended in any case."""
    tab = Browser(profile)
    try:
        yield tab
    finally:
        if tab.process.poll() is None:
            tab.close()
