"""A long command says what it does, and on a terminal how far it is and how long that may still take."""

import re

import pytest

from cable_envs.diagnosis.fit.rounds import heard, rounds
from cablebench.cli.shared.output import stages


def said(capsys) -> str:
    with stages() as (tell, hear), heard(hear):
        tell("refitting a model")
        for _ in rounds(4):
            pass
        tell("looking at what is left")
    out, err = capsys.readouterr()
    assert out == ""
    return re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", err)


def test_a_pipe_gets_the_steps_alone(capsys, monkeypatch):
    monkeypatch.delenv("FORCE_COLOR", raising=False)
    assert said(capsys) == "    0 s  refitting a model ...\n    0 s  looking at what is left ...\n"


def test_a_terminal_sees_the_rounds_and_what_they_may_take(capsys, monkeypatch):
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("COLUMNS", "120")
    text = said(capsys)
    assert "refitting a model ..." in text and "of at most 4 rounds" in text and re.search(r"\d:\d\d:\d\d", text)
    assert text.rstrip().endswith("looking at what is left ...")


def test_nobody_hears_what_happens_outside():
    heard_rounds = []
    with heard(lambda done, most: heard_rounds.append((done, most))):
        assert list(rounds(2)) == [0, 1]
    list(rounds(5))
    assert heard_rounds == [(0, 2), (1, 2)]
    with pytest.raises(ValueError, match="it ends"), heard(lambda done, most: None):
        raise ValueError("it ends")
    assert list(rounds(1)) == [0]
