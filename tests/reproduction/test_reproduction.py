"""Registry, report and command of the reproduction; the parts of the Gu items that are quick."""

import json
import math
import re

import numpy as np
import pytest

from cable_envs.core.errors import ConfigurationError
from cable_envs.identification.least_squares import least_squares
from cable_envs.reproduction import registry, report, style
from cable_envs.reproduction.gu import data as gu_data
from cable_envs.reproduction.gu import fig12 as gu_fig12
from cable_envs.reproduction.gu import fig13 as gu_fig13
from cable_envs.reproduction.gu import fig15_17 as gu_fig15_17
from cable_envs.reproduction.gu import table2 as gu_table2
from cable_envs.reproduction.gu import table2_runs as gu_table2_runs
from cable_envs.reproduction.registry import Extra, Figure, Item, Result, find, run
from cable_envs.reproduction.rows import digits
from cable_envs.reproduction.yardstick import BY_NAME, DIFFERS, EXPLAINED, KINDS, REPRODUCED, STATUSES
from cable_envs.sim.rigs import load_rig
from cablebench.cli import main

KEYS = ["item", "quantity", "kind", "published", "computed", "unit", "rel_error", "band", "status", "why"]


def quiet(share, text):
    """A progress that nobody watches."""


@pytest.fixture(scope="module")
def fig12():
    """A quick item."""
    (item,) = find(["gu-fig12"])
    return item.reproduce(quiet)


def test_rows_have_exactly_the_promised_keys(fig12):
    told = report.as_json([fig12])
    rows = told["rows"]
    assert [list(row) for row in rows] == [KEYS] * len(rows)
    assert {row["status"] for row in rows} <= set(told["statuses"]) == set(BY_NAME)
    assert {row["kind"] for row in rows} <= set(told["kinds"]) == {kind.name for kind in KINDS}
    assert json.loads(json.dumps(told, allow_nan=False)) == told
    assert all(row["why"] for row in rows if row["status"] != REPRODUCED.name)


def test_an_item_counts_its_rows_by_status(fig12):
    (item,) = report.as_json([fig12])["items"]
    assert item["counts"] == {s.name: sum(row.status is s for row in fig12.rows) for s in STATUSES}
    assert sum(item["counts"].values()) == len(fig12.rows) > 1
    assert report.total([fig12, fig12]) == {name: 2 * n for name, n in item["counts"].items()}
    assert not hasattr(fig12, "status")  # one word for an item would hide the rest


def test_registry_names_are_unique_and_unknown_ones_refused():
    names = [item.name for item in registry.ITEMS]
    assert len(set(names)) == len(names) and {item.paper for item in registry.ITEMS} <= set(registry.PAPERS)
    assert {"gu-table2", "gu-fig12", "gu-fig13", "gu-fig15-17"} <= set(names)
    with pytest.raises(ConfigurationError, match="did you mean 'gu-fig12'"):
        find(["gu-fig12x"])


def test_a_failing_item_does_not_take_the_others_along(fig12):
    broken = Item("gu-broken", "broken", "no_such_module", 1.0)
    results = list(run([broken, *find(["gu-fig12"])], lambda *_: None))
    assert "no_such_module" in results[0].error and not results[1].error
    page = report.render_html(results)
    assert "This item failed" in page and fig12.rows[0].quantity in page


def test_report_needs_nothing_else(fig12, tmp_path):
    paths = report.write([fig12], tmp_path / "deep" / "folder")
    page = paths["html"].read_text(encoding="utf-8")
    assert not re.search(r'(?:src|href)="(?:https?:)?//', page) and "<script" not in page
    assert page.count("<figure") == len(fig12.figures)
    assert json.loads(paths["json"].read_text(encoding="utf-8")) == report.as_json([fig12])
    files = sorted(p.name for p in paths["figures"].iterdir())
    assert files == [f"gu-fig12-{name}.svg" for name in ("load", "map", "misprint", "stribeck")]
    (tmp_path / "file").write_text("")
    with pytest.raises(ConfigurationError, match="cannot write to"):
        report.write([fig12], tmp_path / "file")


def test_report_escapes_what_items_say():
    result = Result([digits("<b>", "1.0", 1.0, "N", how="a & b")], (Figure("f", "x < y", "<svg></svg>"),),
                    (Extra("t", ("c",), [("<i>",)]),), item="gu-x")  # fmt: skip
    page = report.render_html([Result(result.rows, result.figures, result.tables, item="gu-fig12")])
    assert (
        "&lt;b&gt;" in page
        and "a &amp; b" in page
        and "&lt;i&gt;" in page
        and "x &lt; y" in page
        and "<svg></svg>" in page
    )


def test_page_shows_the_yardstick_and_every_count(fig12):
    page = report.render_html([fig12])
    for status in STATUSES:
        assert f'<span class="verdict {status.style}">{status.sign} {status.name}</span>' in page
        assert re.search(rf"\.{status.style}\b[^}}]*{{ color: var\(--\w+\)", page), "no colour"
    for kind in KINDS:
        assert f"<td>{kind.name}</td>" in page and kind.agrees in page
    counts = fig12.counts
    for status in (s for s in STATUSES if counts[s.name]):
        assert f"{status.sign} {counts[status.name]} {status.name}" in page
    assert len({status.sign for status in STATUSES}) == len({status.colour for status in STATUSES}) == len(STATUSES)


def test_command_prints_the_counts_and_why(capsys):
    with pytest.raises(SystemExit):
        main(["reproduce", "gu-fig12", "--jobs", "1"])
    text = capsys.readouterr().out
    assert all(f"{status.sign} {status.name}" in text for status in STATUSES)
    assert re.search(r"gu-fig12 +1 +· +3 +· +1 ", text), text[:400]
    assert "Two prints exclude each other" in text


def test_figures_are_the_same_every_time():
    def draw(figure):
        figure.subplots().plot([0, 1], [1, 2])

    assert style.svg(draw, 3.0, 2.0) == style.svg(draw, 3.0, 2.0)


def test_command_prints_rows_and_writes_the_report(tmp_path, capsys):
    with pytest.raises(SystemExit) as end:
        main(["reproduce", "gu-fig12", "--out", str(tmp_path), "--json", "--jobs", "1"])
    assert not end.value.code and (tmp_path / "index.html").is_file()
    assert {row["item"] for row in json.loads(capsys.readouterr().out)["rows"]} == {"gu-fig12"}


def test_command_lists_and_refuses(capsys):
    with pytest.raises(SystemExit):
        main(["reproduce", "--list", "--json"])
    assert [i["item"] for i in json.loads(capsys.readouterr().out)] == [item.name for item in registry.ITEMS]
    with pytest.raises(SystemExit) as end:
        main(["reproduce", "gu-fig99"])
    assert end.value.code == 2 and "unknown item" in capsys.readouterr().err


@pytest.mark.slow
def test_two_processes_give_what_one_gives(fig12):
    (result,) = (r for r in run(find(["gu-fig12", "gu-fig13"]), lambda *_: None, jobs=2) if r.item == "gu-fig12")
    assert result.rows == fig12.rows and result.figures == fig12.figures


@pytest.mark.parametrize("cable", gu_data.CABLES.values(), ids=lambda c: c.name)
def test_gu_table_a1_equals_the_rigs(cable):
    material = cable.name.split()[0]
    values = load_rig(f"gu-{material}-{1e3 * cable.diameter:g}mm").values
    names = {
        "extrusion_delta": "delta",
        "friction_coefficient": "mu",
        "extrusion_gain": "K",
        "extrusion_exponent": "omega",
    }
    for theirs, ours in names.items():
        assert values[theirs] == getattr(cable, ours)
    assert values["cable_radius"] == pytest.approx(cable.diameter / 2)


def test_gu_eq13_points_agree_with_the_closed_form():
    exact = gu_data.design(gu_data.TABLE_2, gu_data.PEAK_SPEED).ratio
    assert gu_data.simulated_ratios(gu_data.TABLE_2, gu_data.PEAK_SPEED) == pytest.approx(
        exact, rel=1e-7
    )  # solver 1e-9


def test_gu_table_2_comes_back_from_data_of_eq13():
    data = gu_data.problem(gu_data.TABLE_2, gu_data.PEAK_SPEED, None)
    fit = least_squares(data, np.random.default_rng(0))
    clean = gu_table2_runs.Runs(gu_data.TABLE_2, gu_data.PEAK_SPEED, data, {"lsq": [fit]})
    assert [row.status for row in gu_table2.clean_rows(clean)] == [REPRODUCED] * 4


def test_gu_table_1_bounds_of_success_are_strict():
    """At the edge of what counts as found, mu is within a third of its standard error."""
    data = gu_data.problem(gu_data.TABLE_2, gu_data.PEAK_SPEED, np.random.default_rng(0))
    fit = least_squares(data, np.random.default_rng(0))
    assert math.sqrt(gu_table2_runs.FOUND) < 1 / 3
    assert fit.cost == pytest.approx(data.noise_floor, rel=0.6)


def test_gu_fig12_ratio_only_rises_with_speed(fig12):
    row = next(r for r in fig12.rows if r.quantity == "speed at 60-90°")
    assert row.status is EXPLAINED and row.computed.startswith("only rises")
    found = gu_fig12.stribeck_search()
    assert 0 < found["fall_30"] < found["fall_60"] < found["fall_90"]
    assert gu_fig12.stribeck_search(2.0)["fall_90"] == pytest.approx(0.0, abs=1e-12)  # falls first, never after a rise


def test_gu_table_a1_compressions_fit_steel_and_not_thick_rubber():
    fits = {name: gu_fig13.fit_modulus(cable) for name, cable in gu_data.CABLES.items()}
    assert fits["steel wire 1 mm"].misfit < 0.01e-3  # the camera's accuracy
    assert fits["rubber 3 mm"].misfit > 0.1e-3
    moduli = [fits[f"steel wire {d} mm"].contact.lateral_modulus for d in (1, 2, 3)]
    assert moduli[0] > 3 * moduli[1] > 3 * moduli[2]  # no constant of the material


def test_gu_fig13_rows_of_one_fitted_modulus_are_never_called_reproduced():
    rows = gu_fig13.cable_rows([gu_fig13.fit_modulus(cable) for cable in gu_data.CABLES.values()])
    assert len(rows) == 27 and {row.status.name for row in rows} == {"consistent", "differs"}
    assert all((row.status is DIFFERS) == (abs(row.rel_error) > 0.05) for row in rows)


def test_gu_table_a1_thicker_cables_are_compressed_more():
    assert gu_fig13._softer_when_thicker() == 18  # read off the table: three materials, two steps, three angles


def test_line_force_integrates_to_the_friction():
    """Mean of M N' over the wrap is the tension gained, T(phi) - T(0), plus the shear force's share Q(phi) = T'/rho."""
    cable, wrap = gu_data.TABLE_2, 1.0
    angles = np.linspace(1e-4, wrap, 4001)
    force = np.array([gu_fig13.largest_line_force(cable, a) for a in angles])  # N' at the outlet of each partial wrap
    rho = 1.5 * (1 + cable.delta)
    gained = gu_fig12.tension_ratio(rho, cable.mu, wrap) - 1.0
    # F' = M N' = T' (1 + rho) / rho integrates to (T - T1)(1 + rho) / rho
    assert cable.mu * np.trapezoid(force, angles) == pytest.approx(49.05 * gained * (1 + rho) / rho, rel=1e-3)


def test_gu_fig15_growth_of_a_spread():
    assert gu_fig15_17.growth_of(0.9 ** np.arange(100)) == pytest.approx(0.9)
    assert gu_fig15_17.growth_of(1.1 ** np.arange(400)) == pytest.approx(1.1)  # what left all bounds is not counted
