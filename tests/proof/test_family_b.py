"""Generator B: its simulators against generator A's and finer steps, its logs by statistics, its cases, its hash."""

import hashlib
import json
import math
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from cable_envs.diagnosis.data.recording import load_recording
from cable_envs.proof import effects as first
from cable_envs.proof.cases import Case
from cable_envs.proof.effects import SYSTEMS
from cable_envs.proof.excitation import reference as reference_of_a
from cable_envs.proof.family_b import cases, logger, odds
from cable_envs.proof.family_b.effects import LIBRARY, STRANGE, find
from cable_envs.proof.family_b.excitation import DESIGNS, reference
from cable_envs.proof.family_b.simulators import cable_hole, laws, linear_drive, pulley_circuit
from cable_envs.proof.rigs import SIMULATE, observe
from cable_envs.proof.sensors import flat
from cable_envs.proof.simulators.numerics import tension_ratio
from cable_envs.proof.writing import digest

FOLDER = Path(__file__).parents[2] / "proof" / "family_b"
OWN = {"linear_drive": linear_drive, "cable_hole": cable_hole, "pulley_circuit": pulley_circuit}
PLAIN = {
    "linear_drive": ({"viscous": 20.0, "coulomb": 5.0, "kp": 6125.0, "kv": 245.0, "kd": 245.0}, 0.0, 0.06),
    "cable_hole": ({"kp": 4.0, "load_stiffness": 300.0}, 0.018, 0.012),
    "pulley_circuit": ({}, 0.0, 0.7),
}
"""Parameters, middle and amplitude of a motion of each system with nothing concealed."""


def test_its_sources_are_those_that_were_sealed():
    """It was written before the tool was run on it. A change needs a new generator, not a new hash."""
    total = hashlib.sha256()
    for file in sorted(FOLDER.rglob("*.py")):
        total.update(file.relative_to(FOLDER).as_posix().encode() + b"\0" + file.read_bytes())
    assert total.hexdigest()[:32] == (FOLDER / "SEAL").read_text(encoding="utf-8").strip()


@pytest.mark.parametrize("system", SYSTEMS)
def test_with_nothing_concealed_it_is_generator_a(system):
    """Other steps, other friction, other loop over the contacts; the same equations: to some 1e-4 of the range."""
    values, middle, amplitude = PLAIN[system]
    motion = middle + reference_of_a("triangle", np.random.default_rng(0), 12.0, amplitude, linear_drive.CLOCK)
    other, own = SIMULATE[system](values, motion), OWN[system].simulate(values, motion)
    for name in OWN[system].OUTPUTS:
        if name in own and name != "motor_position":
            assert np.sqrt(np.mean((own[name] - other[name]) ** 2)) < 4e-4 * np.ptp(other[name]), name


@pytest.mark.parametrize("system", SYSTEMS)
def test_a_finer_step_changes_nothing_that_can_be_measured(system):
    values, middle, amplitude = PLAIN[system]
    motion = middle + reference("moves", np.random.default_rng(1), 8.0, amplitude, linear_drive.CLOCK)
    coarse = OWN[system].simulate(values, motion)
    fine = OWN[system].simulate({**values, "step": OWN[system].STEP / 5.0}, motion)
    for name in OWN[system].OUTPUTS:
        assert np.sqrt(np.mean((coarse[name] - fine[name]) ** 2)) < 1e-4 * np.ptp(fine[name]), name


def test_a_load_hauled_and_lowered_has_the_ratios_of_the_closed_form():
    motion = 0.01 * np.concatenate([np.linspace(0.0, 1.0, 6000), np.linspace(1.0, 0.0, 6000)])
    made = cable_hole.simulate({"friction_coefficient": 0.3, "wrap_angle": 0.9, "radius_ratio": 2.0}, motion)
    n = tension_ratio(2.0, 0.3, 0.9)
    ratio = made["drive_tension"] / made["load_tension"]
    assert ratio[4000] == pytest.approx(n, rel=1e-6) and ratio[11000] == pytest.approx(1.0 / n, rel=1e-6)


def test_the_circuit_keeps_every_limit_at_every_piece():
    """Whatever the ends do: within the limits, and at its own wherever a piece has slid."""
    rng, p = np.random.default_rng(2), pulley_circuit.TABLE.pack({})
    logs, slip = pulley_circuit.contact_logs(0.54, 0.157)
    lengths, limits = pulley_circuit.spans(slip)[0], np.repeat(np.exp(0.5 * logs[0]), 2)
    s, ways, none = np.zeros(8), np.zeros(8, dtype=np.int64), np.zeros(9)
    tension, front, back, slid = np.zeros(9), 0.0, 0.0, 0
    for _ in range(400):
        front, back, before = front + rng.normal(0.0, 2e-4), back + rng.normal(0.0, 2e-4), s.copy()
        pulley_circuit._relaxed(p, 1.684e4, 50.0, front, back, s, ways, lengths, limits, none, none, tension)
        ahead, behind = tension[:-1], tension[1:]
        assert np.all(ahead <= limits * behind * (1.0 + 1e-6) + 1e-9)
        assert np.all(behind <= limits * ahead * (1.0 + 1e-6) + 1e-9)
        moved = s - before
        up, down = (moved > 1e-9) & (behind > 0.0), (moved < -1e-9) & (ahead > 0.0)
        assert np.allclose(ahead[up], (limits * behind)[up], rtol=1e-6)
        assert np.allclose(behind[down], (limits * ahead)[down], rtol=1e-6)
        slid += int(up.sum() + down.sum())
    assert slid > 400


def test_the_bristle_ends_at_its_steady_deflection_and_dissipates():
    z, work = 0.0, 0.0
    path = 3e-4 * np.sin(np.linspace(0.0, 4.0 * np.pi, 8001))
    for ds in np.diff(path):
        before, z = z, laws.bristle(z, ds / 1e-4)
        work += 0.5 * (before + z) * ds
    assert work > 0.0 and abs(laws.bristle(0.999, 10.0)) == 1.0
    z = 0.0
    for _ in range(1000):  # below its breakaway it is a spring: what is pushed comes back
        z = laws.bristle(z, 1e-4)
    assert laws.bristle(z, -0.1) == pytest.approx(0.0, abs=1e-12)


def test_every_form_of_a_law_begins_and_ends_alike():
    for form in (0.0, 1.0, 2.0):
        assert laws.falling(form, 0.0, 0.01) == 1.0 and laws.falling(form, 10.0, 0.01) < 1e-5
    for form in (0.0, 1.0):
        assert laws.drifted(form, 0.0, 9.0) == 0.0
        assert laws.drifted(form, 9.0 * math.log(2.0), 9.0) == pytest.approx(0.5)


def test_what_a_kind_of_log_says_is_what_its_rows_do():
    rng, at = np.random.default_rng(0), np.arange(0.0, 600.0, 0.01)
    still = np.zeros(len(at))
    spread = {"x_position": 2.0}
    made = {kind: logger.random_logger(kind, np.random.default_rng(3), spread) for kind in logger.KINDS}
    white = made["white"].noise["x_position"].draw(rng, at, still)
    assert white.std() == pytest.approx(2.0, rel=0.02)
    slow = made["coloured"].noise["x_position"]
    drawn = slow.draw(rng, at, still)
    lag = round(slow.memory / 0.01)
    found = np.mean(drawn[lag:] * drawn[:-lag]) / np.mean(drawn**2)
    assert found == pytest.approx(slow.slow * math.exp(-lag * 0.01 / slow.memory), abs=0.05)
    counts = made["counts"].noise["x_position"]
    assert np.allclose(counts.draw(rng, at, still) / counts.count % 1.0, 0.0)
    grows = made["gain"].noise["x_position"].draw(rng, at, np.linspace(0.0, 1.0, len(at)))
    assert grows[-9000:].std() > 1.1 * grows[:9000].std()
    walks = made["wandering"].noise["x_position"].draw(rng, at, still)
    assert abs(walks[-3000:].mean() - walks[:3000].mean()) > 1.0
    times = made["jitter"].instants(np.random.default_rng(1), 60.0)
    assert 0.0 < np.std(np.diff(times)) < 0.03 * made["jitter"].period
    off = made["clock"].stamps(rng, at) - at
    assert 1e-4 < np.ptp(off) < 1.0
    rows = made["rows"].rows(rng, 10_000)
    assert len(set(rows)) < 10_000 and len(rows) > len(set(rows))
    hum = made["hum"].noise["x_position"].draw(rng, np.arange(0.0, 60.0, 0.001), np.zeros(60_000))
    power = np.abs(np.fft.rfft(hum))
    peak = np.argmax(power[60:]) + 60
    assert abs(peak / 60.0 - 50.0) < 0.2 or abs(peak / 60.0 - 60.0) < 0.2
    assert made["moving"].instants(rng, 30.0)[0] >= 3.0


def test_whitened_noise_is_white():
    """What the odds count with: noise of a kind, divided by the spectrum that its logger states, has power one."""
    at, moving = np.arange(0.0, 27.0, 0.01), np.linspace(0.0, 3000.0, 2700)
    for kind in ("white", "coloured", "counts", "wandering"):
        noise = logger.random_logger(kind, np.random.default_rng(5), {"x_position": 1.0}).noise["x_position"]
        rng, powers = np.random.default_rng(6), []
        for _ in range(30):
            waves = flat(odds.Spectrum(noise, 0.01), (noise.draw(rng, at, moving) - moving)[:, None])
            powers.append(np.mean(waves[5:] ** 2))
        assert np.mean(powers) == pytest.approx(1.0, abs=0.12), kind


def test_the_plan_is_a_thousand_cases_of_every_kind():
    plan = cases.plan()
    assert 900 <= len(plan) <= 1100 and len({case.name for case in plan}) == len(plan)
    kinds, logs = Counter(case.kind for case in plan), Counter(case.noise for case in plan)
    assert set(kinds) == {"single", "pair", "strange", "nothing", "decoy"} and set(logs) == set(logger.KINDS)
    quiet = Counter(case.noise for case in plan if case.kind == "nothing")
    assert all(quiet[kind] >= 8 for kind in logger.KINDS) and quiet["user"] >= 50
    singles = {(case.system, case.effects[0]) for case in plan if case.kind == "single"}
    assert singles == {(system, effect.name) for system in SYSTEMS for effect in LIBRARY[system]}
    assert cases.plan() == plan and cases.plan(seed=2) != plan
    assert len(cases.plan(scale=0.05)) < 0.1 * len(plan)


def test_its_effects_have_the_names_of_the_question_and_parameters_of_its_simulators():
    for system in SYSTEMS:
        assert [e.name for e in LIBRARY[system]] == [e.name for e in first.LIBRARY[system]]
        assert not {e.name for e in STRANGE[system]} & {e.name for e in LIBRARY[system]}
        for effect in (*LIBRARY[system], *STRANGE[system]):
            named = [n for n in (*effect.sized, *effect.shaped) if ":" not in n]
            assert set(named) <= set(OWN[system].TABLE.names), effect.name
    law = find("linear_drive", "stribeck_friction")
    assert law.comparable({"stribeck_friction.form": 0.2}) and not law.comparable({"stribeck_friction.form": 1.7})


@pytest.mark.parametrize("design", DESIGNS)
def test_a_motion_starts_at_rest_and_stays_in_its_range(design):
    motion = reference(design, np.random.default_rng(4), 25.0, 2.0, 1e-3)
    assert motion[0] == 0.0 and np.ptp(motion[:300]) < 1e-9 and 0.5 < np.abs(motion).max() < 4.5
    assert np.abs(np.diff(motion, 3)).max() < 1e-5  # no corner


@pytest.mark.parametrize(
    ("system", "kind", "effects", "noise"),
    [
        ("linear_drive", "single", ("stribeck_friction",), "user"),
        ("linear_drive", "nothing", (), "resampled"),
        ("cable_hole", "nothing", (), "rest"),
    ],
)
def test_a_case_is_a_recording_that_loads_and_comes_again(tmp_path, system, kind, effects, noise):
    case = Case("case-0001", 21, system, kind, effects, ">10" if effects else "", noise)
    key = cases.make(case, tmp_path / "a")
    assert json.loads(json.dumps(key, allow_nan=False)) == json.loads(json.dumps(cases.make(case, tmp_path / "b")))
    assert digest(tmp_path / "a") == digest(tmp_path / "b")
    recording = load_recording(tmp_path / "a")
    assert recording.system == system and len(recording.records) == (4 if noise == "rest" else 3)
    if effects:
        assert key["effects"][0]["name"] == effects[0] and 0.08 < key["added"] < 0.8


def test_a_held_command_is_what_the_drive_does():
    """From row to row the drive goes on by exactly the command that the row before has."""
    seeds = (s for s in range(100) if cases._drawn(_quiet(s)).rig.values.get("held", 0.0) > 1.5)
    made = cases._drawn(_quiet(next(seeds)))
    seen = observe(made.rig, {}, made.references[0], made.at[0])
    moved = np.diff(seen["drive_position"])
    told = seen["drive_velocity_command"][:-1] * made.logger.period
    assert np.abs(moved - told).max() < 0.05 * np.abs(told).max() and np.ptp(told) > 0.0


def _quiet(seed: int) -> Case:
    return Case("case-0001", seed, "cable_hole", "nothing", (), "", "white")


@pytest.mark.slow
def test_odds_are_high_against_what_is_unlike_and_low_against_what_is_alike():
    """A late sensor and a late drive differ by the controller alone; a spring is nothing like either."""
    found = cases.rivals(Case("case-0001", 3, "pulley_circuit", "single", ("coulomb_friction",), "1-3", "white"))
    assert found["stribeck_friction"] < found["sensor_delay"]
    assert not odds.separable({**found, "twin": 0.5})
