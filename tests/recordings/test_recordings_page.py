"""The page of real recordings: what it says of numbers, what it does where a set is missing, and the committed one."""

import re
from pathlib import Path

import numpy as np
import pytest

from cable_envs.core.errors import ConfigurationError
from cable_envs.core.files import read_json
from cable_envs.diagnosis.model.hypotheses import Hypothesis
from cable_envs.diagnosis.model.verdict import EffectGain, Estimate
from cable_envs.diagnosis.real.finding import Finding
from cablebench.cli import main
from cablebench.pages import recordings_figures as draw
from cablebench.pages.recordings import again_of, error, estimate, number, numbers_of, plain, render, summary, write_set
from cablebench.pages.recordings_sets import SETS, numbers
from tests.support.svg_paths import points_of

COMMITTED = Path(__file__).parents[2] / "docs" / "recordings"


def step(name, force):
    parameters = {"backlash.gap": Estimate(0.004, 0.0035, 0.0045, "m")}
    errors = {"force": force, "band_tension_difference": force / 2}
    return EffectGain(
        Hypothesis(name, (), ()), 7.0, alternatives=("cable_elongation",), confidence=0.98, parameters=parameters,
        fit=errors, heldout=errors,
    )  # fmt: skip


def brake():
    worse = {"force": 7777.0, "band_tension_difference": 10.0}
    finding = Finding(
        "band brake",
        "named",
        (step("", 6000.0), step("backlash", 350.0)),
        (EffectGain(Hypothesis("viscous_friction", (), ()), -3.0, fit=worse, heldout=worse),),
        {},
        {"viscous_friction": 0.2},
        {"log_odds_left": 60.0, "share_left": 0.01},
        (),
        (),
    )
    return {"command": "cablebench real-data --only band-brake", "seconds": 9, "finding": numbers(finding),
            "viscous_last": 0.2}  # fmt: skip


def test_numbers_read_as_people_write_them():
    assert [number(v) for v in (350.4, 6069.7, 0.07323, -3.1648, None)] == ["350", "6\u202f070", "0.0732", "-3.16", "–"]
    assert error(1.88e-5, "m") == "18.8 um" and error(0.25, "V") == "0.25 V" and error(np.pi, "rad") == "180 deg"
    gap = {"value": 0.004, "low": 0.0035, "high": 0.0045, "unit": "m"}
    assert estimate(gap) == "4 [3.5, 4.5] mm"
    assert estimate({**gap, "value": 2e-5, "low": -1e-6, "high": 4e-5}) == "20 [-1, 40] um"
    assert estimate({"value": 2.0, "low": 1.9, "high": 2.1, "unit": "1"}) == "2 [1.9, 2.1]"
    assert plain("") == "naive simulator" and plain("stiffness_hardening") == "stiffness hardening"


def test_a_page_of_one_set_shows_its_ladder_and_says_what_is_missing(tmp_path):
    loop = {
        "title": "t",
        "xlabel": "x",
        "ylabel": "y",
        **dict.fromkeys(("x", "measured", "nominal", "final"), np.arange(9.0)),
    }
    write_set(tmp_path, "band-brake", brake(), {"loops": draw.loops([loop])})
    page = render(tmp_path, list(SETS))
    assert "Not run yet: da-vinci-jaw, emps, coupled-drives, servo-pendulum." in page
    assert "4 [3.5, 4.5] mm" in page and "7\u202f780" in page
    assert page.count("<svg") == 1 and "cable elongation" in page and 'id="emps"' not in page
    assert read_json(tmp_path / "band-brake.json.xz")["finding"]["named"] == ["backlash"]
    (tmp_path / "emps.json.xz").write_text("{")
    with pytest.raises(ConfigurationError, match=r"cannot read .*emps.json.xz"):
        render(tmp_path, list(SETS))


def test_figures_hold_a_figure_of_the_data_and_no_copy():
    x = np.linspace(0.0, 1.0, 50_000)
    run = {"title": "t", "ylabel": "y", "time": x, "measured": x, "nominal": x, "final": np.sin(900.0 * x)}
    text = draw.runs([run])
    longest = max(len(points_of(path)) for path in re.findall(r' d="([^"]*)"', text))
    assert 100 < longest <= draw.POINTS
    bars = draw.bars([("a_b", 1.0, 2.0), ("worse", 4.0, 2.0)], "error", 3.0, {"nets": 0.5})
    assert "a b" in bars and draw.NAIVE in bars and draw.NAMED in bars


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--only", "band-break"], "band-brake"),
        (["--page-only", "--only", "emps"], "--page-only runs no set"),
        (["--page-only"], "holds no set's numbers"),
        (["--shared", "nowhere"], "no folder nowhere"),
        (["--shared", "."], "da-vinci-jaw: no folder davinci_tool"),
    ],
)
def test_what_cannot_be_run_is_said(tmp_path, monkeypatch, capsys, words, said):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as end:
        main(["recordings", "--out", str(tmp_path / "out"), *words])
    assert end.value.code == 2
    assert said in capsys.readouterr().err.replace("\n", " ")


def test_the_page_of_the_committed_numbers_needs_nothing_else():
    page = render(COMMITTED, list(SETS))
    assert summary(COMMITTED, list(SETS)) == (COMMITTED / "README.md").read_text(encoding="utf-8")
    assert not re.search(r"<(?:script|link|img)\b|url\(\s*http", page)
    coupled = read_json(COMMITTED / "coupled-drives.json.xz")
    for finding in coupled["findings"].values():
        assert finding["named"][0] == "sensor_rectification"
    assert max(coupled["test"][n]["named"] for n in ("uniform_1", "uniform_2")) < 0.09
    brake = read_json(COMMITTED / "band-brake.json.xz")
    named = brake["finding"]["named"]
    last = brake["viscous_last"]  # on top of the answer viscous friction has less evidence than is asked, if any
    assert last is None or last < 3.0
    for name in SETS:  # the rig that corrects a real set leaves nothing that the library could name
        assert again_of(read_json(numbers_of(COMMITTED, name))) == []
    assert {"load_dependent_friction", "backlash"} < set(named) and "viscous_friction" not in named
