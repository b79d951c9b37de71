"""A long command says what it does and about how long that may still take, by a clock that these tests turn."""

import re

import pytest

from cable_envs.diagnosis.fit.rounds import heard, rounds
from cable_envs.diagnosis.search import stages as steps
from cablebench.cli.shared.progress import Remaining, in_words, stages


class Clock:
    """Stands still until a test moves it on."""

    def __init__(self):
        self.now = 100.0

    def __call__(self):
        return self.now


def work(capsys) -> str:
    """A work of which the refit takes 10 s: what comes after it is told from that."""
    clock = Clock()
    with stages(clock) as (tell, hear), heard(hear):
        tell(steps.CHECKING)
        clock.now += 3.0
        tell("averaging 60000 rows to 12000 samples")
        tell(steps.REFITTING)
        for _ in rounds(4):
            clock.now += 2.5
        tell(steps.testing(21))
        clock.now += 20.0
        tell(steps.LOCATING)
    out, err = capsys.readouterr()
    assert out == ""
    return err


def test_a_pipe_gets_a_line_for_each_step_with_the_time_left(capsys, monkeypatch):
    monkeypatch.delenv("FORCE_COLOR", raising=False)
    usual = steps.USUAL
    after = sum(usual[s] for s in (steps.TESTING, *steps.AFTER[steps.TESTING]))
    pace = 30.0 / (usual[steps.REFITTING] + usual[steps.TESTING])  # s for a usual 1, when both have ended
    assert work(capsys).splitlines() == [
        "    0 s  checking the data",
        "    3 s  averaging 60000 rows to 12000 samples",
        "    3 s  refitting the stated parameters",
        f"   13 s  testing 21 effects; {in_words(10.0 * after)}",
        f"   33 s  looking where the mismatch is; {in_words(pace * usual[steps.LOCATING])}",
    ]


def test_a_long_step_says_now_and_then_that_it_goes_on(capsys, monkeypatch):
    monkeypatch.delenv("FORCE_COLOR", raising=False)
    clock = Clock()
    with stages(clock) as (tell, hear):
        tell(steps.REFITTING)
        for done in range(5):
            hear(done, 20)
            clock.now += 10.0
    text = capsys.readouterr().err.splitlines()
    assert text[1:] == [
        "   20 s  refitting the stated parameters: round 2 of at most 20",
        "   40 s  refitting the stated parameters: round 4 of at most 20",
    ]


def test_a_terminal_has_one_line_that_is_drawn_anew(capsys, monkeypatch):
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("COLUMNS", "120")
    monkeypatch.setenv("TERM", "xterm")
    raw = work(capsys)
    text = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", raw)
    assert "refitting the stated parameters (round 4 of at most 4)" in text
    assert re.search(r"testing 21 effects; about \d+ s left", text)
    lines = [line for line in text.split("\n") if line.strip()]
    assert [line for line in lines if "averaging" in line.rsplit("\r", 1)[-1]], "a remark stays"
    assert "\x1b[2K" in raw and raw.rstrip("\x1b[?25h\r\n").count("\n") <= 2, "the line takes its own place"


def test_the_time_left_follows_the_steps_that_are_done():
    clock = Clock()
    left = Remaining(clock)
    left.begin(steps.CHECKING)
    clock.now += 5.0
    assert left.seconds() is None
    left.begin(steps.REFITTING)
    clock.now += 8.0
    left.begin(steps.testing(3))
    whole = 8.0 * sum(steps.USUAL[s] for s in (steps.TESTING, *steps.AFTER[steps.TESTING]))
    assert left.seconds() == pytest.approx(whole)
    clock.now += 1.0
    assert left.seconds() == pytest.approx(whole - 1.0)
    left.begin("a remark")
    assert left.seconds() == pytest.approx(whole - 1.0)
    clock.now += 1000.0
    assert left.seconds() > 150.0  # a step that takes longer than usual is not about to end


def test_a_second_effect_lengthens_what_is_left():
    assert set(steps.AFTER) == set(steps.USUAL)
    assert {s for after in steps.AFTER.values() for s in after} <= set(steps.USUAL)
    clock = Clock()
    left = Remaining(clock)
    for text in (steps.REFITTING, steps.testing(9), steps.COMPARING):
        left.begin(text)
        clock.now += 4.0 * steps.USUAL[steps.step_of(text)]
    end = 4.0 * sum(steps.USUAL[s] for s in steps.AFTER[steps.COMPARING])
    left.begin(steps.testing(8))
    again = 4.0 * (steps.USUAL[steps.TESTING] + steps.USUAL[steps.COMPARING])
    assert left.seconds() == pytest.approx(again + end)


@pytest.mark.parametrize(
    ("seconds", "words"),
    [(None, ""), (0.2, "about 1 s left"), (8.6, "about 9 s left"), (43.0, "about 45 s left"),
     (89.0, "about 90 s left"), (200.0, "about 3 min left")],
)  # fmt: skip
def test_times_are_told_as_people_say_them(seconds, words):
    assert in_words(seconds) == words


def test_nobody_hears_what_happens_outside():
    heard_rounds = []
    with heard(lambda done, most: heard_rounds.append((done, most))):
        assert list(rounds(2)) == [0, 1]
    list(rounds(5))
    assert heard_rounds == [(0, 2), (1, 2)]
    with pytest.raises(ValueError, match="it ends"), heard(lambda done, most: None):
        raise ValueError("it ends")
    assert list(rounds(1)) == [0]
