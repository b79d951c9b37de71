"""What a long work is doing, and how long that may still take: one line that rewrites itself, or plain lines."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from cablebench.cli.shared.output import PLAIN_INTERVAL, console

Clock = Callable[[], float]
OVERRUN = 0.2
"""Share of the time of a step that takes longer than usual which it is thought to go on for."""


class Remaining:
    """Time left, from the steps that are done and how long each usually takes.

    Parameters
    ----------
    clock : callable
        Gives the time, s.
    """

    def __init__(self, clock: Clock = time.monotonic):
        self._clock = clock
        self._step: str | None = None
        self._since = clock()
        self._spent = self._usual = 0.0

    def begin(self, text: str) -> None:
        """A step begins, and the one before it has ended; a remark changes nothing."""
        from cable_envs.diagnosis.search.stages import USUAL, step_of

        step, now = step_of(text), self._clock()
        if step is None:
            return
        if self._step is not None and USUAL[self._step] > 0.0:
            self._spent += now - self._since
            self._usual += USUAL[self._step]
        self._step, self._since = step, now

    def seconds(self) -> float | None:
        """About how many are left; None as long as no step has ended whose time can be compared."""
        from cable_envs.diagnosis.search.stages import AFTER, USUAL

        if self._step is None or self._usual == 0.0:
            return None
        pace, spent = self._spent / self._usual, self._clock() - self._since
        now = max(pace * USUAL[self._step] - spent, OVERRUN * spent)
        return now + pace * sum(USUAL[step] for step in AFTER[self._step])


def in_words(seconds: float | None) -> str:
    """``about 35 s left``; empty for None."""
    if seconds is None:
        return ""
    if seconds >= 90.0:
        return f"about {seconds / 60.0:.0f} min left"
    if seconds >= 10.0:
        return f"about {5.0 * max(round(seconds / 5.0), 1):.0f} s left"
    return f"about {max(round(seconds), 1)} s left"


@contextmanager
def stages(clock: Clock = time.monotonic) -> Iterator[tuple[Callable[[str], None], Callable[[int, int], None]]]:
    """Steps of one long work on standard error; yields ``tell(text)`` and ``hear(done, most)``.

    ``tell`` begins a step, or makes a remark; ``hear`` says how many of at most so many rounds of the step are done. On
    a terminal one line tells the step and about how long everything may still take, and remarks stay above it;
    elsewhere each is a line, and a step that lasts long says so now and then.
    """
    said = _Rewritten(clock) if console(stderr=True).is_terminal else _Plain(clock)
    try:
        yield said.tell, said.hear
    finally:
        said.end()


class _Plain:
    """A line for every step and remark."""

    def __init__(self, clock: Clock):
        self._clock, self._began, self._last = clock, clock(), clock()
        self._left, self._out, self._text = Remaining(clock), console(stderr=True), ""

    def tell(self, text: str) -> None:
        self._text = text
        self._left.begin(text)
        self._say(text)

    def hear(self, done: int, most: int) -> None:
        if done and self._clock() - self._last >= PLAIN_INTERVAL:
            self._say(f"{self._text}: round {done} of at most {most}")

    def _say(self, text: str) -> None:
        self._last, left = self._clock(), in_words(self._left.seconds())
        self._out.print(f"{self._last - self._began:5.0f} s  {text}{f'; {left}' if left else ''}", markup=False)

    def end(self) -> None:
        pass


class _Rewritten:
    """One line, which a clock of its own keeps up to date; it is gone at the end."""

    def __init__(self, clock: Clock):
        self._clock, self._began, self._left = clock, clock(), Remaining(clock)
        self._text = self._round = ""
        self._bar = _line(console(stderr=True), self._line)

    def tell(self, text: str) -> None:
        from cable_envs.diagnosis.search.stages import step_of

        if step_of(text) is None:
            self._bar.console.print(f"{self._clock() - self._began:5.0f} s  {text}", markup=False)
            return
        self._text, self._round = text, ""
        self._left.begin(text)
        self._bar.start()
        self._bar.refresh()

    def hear(self, done: int, most: int) -> None:
        self._round = f" (round {done + 1} of at most {most})"
        self._bar.refresh()

    def _line(self) -> str:
        left = in_words(self._left.seconds())
        return f"{self._clock() - self._began:5.0f} s  {self._text}{f'; {left}' if left else ''}{self._round}"

    def end(self) -> None:
        self._bar.stop()


def _line(err: Any, text: Callable[[], str]) -> Any:
    """A line on a terminal that is drawn anew, with ``text`` at that moment."""
    from rich.live import Live
    from rich.text import Text

    return Live(get_renderable=lambda: Text(text(), no_wrap=True, overflow="ellipsis"), console=err, transient=True)
