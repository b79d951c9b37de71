"""What the translation refuses, by the function and the construct; and the command."""

import json

import pytest

from cable_envs import ConfigurationError
from cable_envs.core.kernels import inline
from cable_envs.core.lanes import Lanes
from cable_envs.standalone.c_text import functions_in_c
from cable_envs.standalone.law import law_of
from cable_envs.standalone.program import NotTranslated
from cable_envs.standalone.specialise import program_of
from cablebench.cli import main

ROWS = Lanes("Rows", ["a", "b", ("many", 3)])
RECORDS = dict.fromkeys("xpuwesg", ROWS)


@inline
def _comprehends(x, i):
    x.a[i] = sum([x.many[k, i] for k in range(3)])


@inline
def _powers(x, i):
    x.a[i] = x.b[i] ** 2


@inline
def _grows(x, i):
    x.b[i] = x.b[i] + 1.0
    return x.b[i]


@inline
def _reads_what_it_changes(x, i):
    x.a[i] = x.b[i] + 2.0 * _grows(x, i)


@inline
def _swaps(x, i):
    x.a[i], x.b[i] = x.b[i], x.a[i]


def made(piece):
    """The program of a kernel that calls a piece."""

    def solve(x, p, u, w, e, s, g, lanes, substeps, dt):
        for i in range(lanes):
            piece_of_it(x, i)  # noqa: F821 - a name of the space below

    solve = type(solve)(solve.__code__, {"piece_of_it": piece, "range": range}, "solve")
    return program_of(solve, RECORDS, effects=True, elementary=())


def test_an_unknown_construct_is_named_with_its_place():
    with pytest.raises(NotTranslated, match=r"test_translation\._comprehends, line \d+: .* cannot be exported"):
        made(_comprehends)


def test_an_operator_without_a_translation_is_named():
    with pytest.raises(NotTranslated, match="_powers: this operator cannot be written in C"):
        functions_in_c(made(_powers))


def test_an_order_of_evaluation_that_c_does_not_have_is_refused():
    with pytest.raises(NotTranslated, match="reads what a call in it changes"):
        functions_in_c(made(_reads_what_it_changes))


def test_values_that_change_places_go_through_others():
    assert "= t1_;" in functions_in_c(made(_swaps))


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"drive": "tensio"}, "did you mean 'tension'"),
        ({"period": 0.0}, "period: expected seconds above 0"),
        ({"start": float("nan")}, "start: expected a position"),
        ({"substeps": 0}, "substeps: expected a whole number"),
        ({"substeps": 1, "period": 0.5}, "substeps = 1 is too few"),
    ],
)
def test_wrong_options_are_named(options, said):
    with pytest.raises(ConfigurationError, match=said):
        law_of("gu-inferred", **options)


def test_an_effect_of_ones_own_is_refused_by_name():
    from cable_envs.effects import Effect, EffectParameter

    own = Effect(
        name="cubic_spring", seam="load", equation="F = -k y^3", source="Duffing 1918", validity="any",
        experiment="hold",
        parameters=(EffectParameter("stiffness", "N/m^3", 0.0, 0.0, 1e9, "spring", typical=5e3),), confusable=(),
        hooks={"load": lambda position, stiffness: stiffness * position},
    )  # fmt: skip
    from cable_envs import load_rig

    law = law_of(load_rig("gu-inferred", (own,)))
    with pytest.raises(ConfigurationError, match="cubic_spring: an effect of your own"):
        law.program()


def run(*words):
    with pytest.raises(SystemExit) as ended:
        main(["export-rig", *map(str, words)])
    return ended.value.code


def test_the_command_writes_what_it_says(tmp_path, capsys):
    assert run("gu-inferred", "--format", "c", "--out", tmp_path / "hole.c", "--json") in (0, None)
    said = json.loads(capsys.readouterr().out)
    assert said["inputs"] == {"command": "N", "disturbance": "N"} and said["substeps"] == 20
    assert sorted(path.name for path in tmp_path.iterdir()) == ["hole.c", "hole.h"]
    assert '#include "hole.h"' in (tmp_path / "hole.c").read_text()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--format", "cc", "--out", "x.c"), "unknown format 'cc'"),
        (("--format", "c", "--out", "x.py"), "ends in '.c'"),
        (("--format", "mujoco", "--out", "x.xml"), "MuJoCo has no elements for the law of cable_hole"),
    ],
)
def test_the_command_refuses_by_name_and_writes_nothing(words, said, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert run("gu-inferred", *words) == 2
    assert said in capsys.readouterr().err and list(tmp_path.iterdir()) == []
