"""Noise from a record at rest: whitened to independent samples, kept apart from mismatches, refused if it is none."""

from dataclasses import replace

import numpy as np
import pytest
import yaml
from scipy.linalg import cholesky, toeplitz
from scipy.signal import lfilter

from cable_envs.core.errors import ConfigurationError
from cable_envs.diagnosis.asked import ask, request_of
from cable_envs.diagnosis.data.readings import resolution
from cable_envs.diagnosis.data.recording import load_recording
from cable_envs.diagnosis.fit.likelihood import refit_and_learn
from cable_envs.diagnosis.fit.refit import Start
from cable_envs.diagnosis.intake.gate import gate
from cable_envs.diagnosis.model.model import learn_whitener
from cable_envs.diagnosis.model.noise import Noise, bridged
from cable_envs.diagnosis.model.rest import LONGEST, noise_at_rest
from cable_envs.diagnosis.search.known.noise import NOISE_IS_LEARNT, told_at_rest
from cable_envs.diagnosis.search.select import select
from cable_envs.proof.sensors import Colour
from tests.support import drive_recording as drive
from tests.support.diagnosis_toy import HYPOTHESES, NOMINALS, Toy

WAVES = ((1, 3), (3, 6), (6, 12), (12, 48), (48, 384), (384, 1300))


def _hum(rng, count):
    tone = lfilter([1.0], [1.0, -2.0 * 0.97 * np.cos(0.9), 0.97**2], rng.normal(0.0, 0.1, count + 200))[200:]
    return rng.normal(0.0, 1.0, count) + tone


KINDS = {
    "white": lambda rng, n: Colour("white").draw(rng, n, 1.0),
    "marked": lambda rng, n: Colour("ar1", 0.93).draw(rng, n, 1.0),
    "flicker": lambda rng, n: Colour("flicker").draw(rng, n, 1.0),
    "hum": _hum,
}


@pytest.mark.parametrize(
    "kind", ["marked", *(pytest.param(kind, marks=pytest.mark.slow) for kind in ("white", "flicker", "hum"))]
)
def test_noise_known_from_rest_is_white_at_every_frequency_and_from_the_first_sample(kind):
    """40 records of 27 s, each with a record at rest of its own; slow waves of 40 records are known to 15 %."""
    rng = np.random.default_rng(4)
    powers, starts = [], []
    for _ in range(40):
        noise = noise_at_rest(np.round(2.0 * KINDS[kind](rng, 12_000)) / 2.0)
        white = noise.whiten(np.round(2.0 * KINDS[kind](rng, 2700)) / 2.0)
        power = np.abs(np.fft.rfft(white)) ** 2 / len(white)
        powers.append([power[low:high].mean() for low, high in WAVES])
        starts.append(white[:20])
        assert noise.std == 1.0 and noise.floor == pytest.approx(1.05, rel=0.25 if kind == "flicker" else 0.1)
    assert np.mean(powers, axis=0) == pytest.approx(1.0, abs=0.35)
    assert np.mean(powers, axis=0)[3:] == pytest.approx(1.0, abs=0.08)
    assert np.std(starts) == pytest.approx(1.0, abs=0.12)


def test_a_line_at_rest_is_told_and_none_where_there_is_none():
    rng, turn = np.random.default_rng(5), 2.0 * np.pi * np.arange(12_000)
    colours = ("white", "marked", "flicker")
    for kind in colours:
        hum = 0.2 * np.sqrt(2.0) * (np.sin(0.0831 * turn) + np.sin(0.3712 * turn + 1.0))
        lines = np.array(noise_at_rest(KINDS[kind](rng, 12_000) + hum).lines)
        assert all(np.min(np.abs(lines - f)) < 1e-4 for f in (0.0831, 0.3712))
        assert all(min(abs(f - 0.0831), abs(f - 0.3712)) < 3e-4 for f in lines)
    found = [noise_at_rest(KINDS[kind](rng, 4000)).lines for kind in colours for _ in range(8)]
    assert sum(map(len, found)) <= 1  # 1 rest of 1000


def test_a_mean_wanders_no_more_from_record_to_record_than_within_one():
    """Flicker has no mean; a sensor that is zeroed before every record has one, within what its slowest wave does."""
    still = KINDS["flicker"](np.random.default_rng(7), 12_000)
    means = [1.0 / np.mean(noise_at_rest(still, longest=n).whiten(np.ones(2700)) ** 2) for n in (12_000, 2700)]
    slowest = 2700 * 0.5 * 0.065  # of flicker: its half of the power, over the frequency of one wave in 2700 samples
    assert means[0] > 1.5 * means[1] and means[1] == pytest.approx(slowest, rel=0.6)


def test_the_filter_is_the_inverse_root_of_the_covariance():
    noise = noise_at_rest(KINDS["flicker"](np.random.default_rng(1), 6000))
    root = cholesky(toeplitz(noise.covariance), lower=True)
    plain = np.linalg.inv(root)
    assert noise.start == pytest.approx(plain[:LONGEST, :LONGEST], abs=1e-9)
    assert noise.taps[::-1] == pytest.approx(plain[LONGEST], abs=1e-9)
    series = np.random.default_rng(2).normal(0.0, 1.0, (LONGEST + 1, 3))
    assert noise.whiten(series) == pytest.approx(plain @ series)
    assert noise.whiten(series[:, 0]) == pytest.approx((plain @ series)[:, 0])


def test_only_the_size_is_learnt_from_what_is_left():
    rng = np.random.default_rng(3)
    noise = noise_at_rest(KINDS["marked"](rng, 12_000))
    left = 2.5 * KINDS["marked"](rng, 4000)
    assert noise.sized([left]).std == pytest.approx(2.5, rel=0.05)
    gap = left.copy()
    gap[100:105] = np.nan
    assert noise.sized([gap]).std == pytest.approx(2.5, rel=0.05)
    assert bridged(gap, np.isfinite(gap))[99:106] == pytest.approx(np.linspace(left[99], left[105], 7))
    means = left[:4000].reshape(-1, 20).mean(axis=1)
    assert noise.sized([left]).of_mean(20) == pytest.approx(means.std(), rel=0.15)
    assert Noise(np.array([0.9]), 1.0).of_mean(20) == pytest.approx(
        np.std(lfilter([1.0], [1.0, -0.9], rng.normal(0, 1, 400_000)).reshape(-1, 20).mean(axis=1)), rel=0.05
    )


def test_a_channel_that_never_changes_tells_nothing_and_few_samples_are_refused():
    assert noise_at_rest(np.full(3000, 0.7)) is None
    counts = np.round(np.random.default_rng(0).normal(0.3, 0.15, 3000))  # now and then a step of 1
    assert 0.2 < counts.std() < 0.5 and noise_at_rest(counts, resolution(counts)) is None
    fine = np.round(np.random.default_rng(0).normal(0.3, 0.6, 3000))
    assert noise_at_rest(fine, resolution(fine)).floor == pytest.approx(fine.std(), rel=0.05)
    moved = 0.1 * counts * (1.0 + 4e-16 * np.random.default_rng(1).integers(-1, 2, 3000))  # by the rounding of units
    assert len(np.unique(moved)) > len(np.unique(counts)) and resolution(moved) == pytest.approx(0.1)
    with pytest.raises(ValueError, match="1500 samples at rest do not show the noise's colour; 2000 would"):
        noise_at_rest(np.random.default_rng(0).normal(0.0, 1.0, 1500))


def _toys(truth, seed, colour, rest):
    """Two toys, to fit and held out, in noise that remembers 1 s, known from rest or not."""
    made = [Toy(truth, seed + k, records, colour=colour, std=0.3) for k, records in ((0, 2), (50, 1))]
    if rest:
        rng = np.random.default_rng([seed, 9])
        still = lfilter([1.0], [1.0, -colour], rng.normal(0.0, 0.3 * np.sqrt(1.0 - colour**2), 12_000))
        noise = noise_at_rest(still)
        for toy in made:
            toy.blocks[:] = [replace(b, noise=noise) for b in toy.blocks]
    return made


def test_a_slow_mismatch_is_no_colour_of_a_noise_that_is_known():
    """A bias of the noise's own size lasts for ever: a learnt colour takes it for a long memory."""
    truth = {"bias": 0.35}
    gains = {}
    for rest in (False, True):
        fit, heldout = _toys(truth, 21, 0.97, rest)
        found = select(fit, heldout, NOMINALS, HYPOTHESES, np.random.default_rng(0))
        gains[rest] = found.tried["bias_effect"]
        if rest:
            # with Coulomb's level free a bias and a difference of directions are one: the first of them is named
            assert [a.hypothesis.name for a in found.accepted] == ["difference_effect"]
            assert "bias_effect" in found.accepted[0].alternatives
    assert gains[True] > gains[False]


@pytest.mark.parametrize("seed", range(1, 9))
def test_nothing_is_found_in_noise_that_is_known(seed):
    fit, heldout = _toys({}, seed, 0.9, True)
    found = select(fit, heldout, NOMINALS, HYPOTHESES, np.random.default_rng(0))
    assert found.verdict == "no_detectable_mismatch"


def test_more_than_the_noise_at_rest_is_no_noise():
    """White physics of half the noise's size: no function of the motion shows it, the size does."""
    fit, heldout = _toys({}, 5, 0.0, True)
    rng = np.random.default_rng(6)
    for toy in (fit, heldout):
        toy.blocks[:] = [replace(b, measured=b.measured + rng.normal(0.0, 0.15, len(b.time))) for b in toy.blocks]
    found = select(fit, heldout, NOMINALS, HYPOTHESES, np.random.default_rng(0))
    assert found.verdict == "unknown" and found.after.kinds[0].coordinate == "size of the noise"


def test_the_noise_is_not_relearnt_in_a_refit():
    fit, _ = _toys({"bias": 2.0}, 8, 0.5, True)
    judged = refit_and_learn(fit, [Start("", NOMINALS, {})])
    assert judged.whitener.noise["force"].taps is fit.blocks[0].noise.taps
    assert learn_whitener(fit.blocks, judged.raw, 0).noise["force"].std == pytest.approx(
        judged.whitener.noise["force"].std, rel=1e-3
    )


def _with_rest(folder, seconds=60.0, change=None, more=()):
    """A drive's recording that has a record at rest, whose table ``change`` may damage."""
    drive.write(folder)
    rng = np.random.default_rng(11)
    t = 100.0 + 0.01 * np.arange(round(seconds / 0.01))
    noise = rng.normal(0.0, list(drive.NOISE.values()), (len(t), 3))
    table = np.column_stack([t, np.zeros_like(t), noise])
    table = table if change is None else change(table)
    content = yaml.safe_load((folder / "recording.yaml").read_text())
    for name in ("rest.csv", *more):
        np.savetxt(folder / name, table, delimiter=",", header="t,r,x,v,f", comments="", fmt="%.9g")
        content["records"].append({"data": name, "use": "rest"})
    for channel in content["channels"].values():
        channel.pop("noise_std", None)
    (folder / "recording.yaml").write_text(yaml.safe_dump(content, sort_keys=False))
    return folder


def test_a_record_at_rest_tells_every_channel_and_is_neither_fitted_nor_predicted(tmp_path):
    recording = load_recording(_with_rest(tmp_path / "drive"))
    assert not gate(recording).faults
    question = told_at_rest(recording, ask(recording, request_of(recording)))
    assert {b.record for b in (*question.fit.blocks, *question.heldout.blocks)} == {
        "run_1.csv",
        "run_2.csv",
        "run_3.csv",
    }
    for block in (*question.fit.blocks, *question.heldout.blocks):
        assert block.noise.floor == pytest.approx(drive.NOISE[block.channel], rel=0.05)


def test_a_channel_without_noise_at_rest_is_learnt_and_said(tmp_path):
    def counts(table):
        table[:, 2] = 0.02 + 1e-4 * (np.arange(len(table)) % 700 == 0)  # a count now and then
        return table

    recording = load_recording(_with_rest(tmp_path / "drive", change=counts))
    assert not gate(recording).faults
    question = told_at_rest(recording, ask(recording, request_of(recording)))
    assert {b.channel for b in question.fit.blocks if b.noise is None} == {"position"}
    assert question.notes[-1].startswith("the noise of force, velocity is known from rest.csv; position shows no noise")


@pytest.mark.slow
def test_who_tells_no_noise_is_told_what_it_costs(tmp_path):
    def notes(folder, change):
        content = yaml.safe_load((folder / "recording.yaml").read_text())
        change(content)
        (folder / "recording.yaml").write_text(yaml.safe_dump(content))
        recording = load_recording(folder)
        return told_at_rest(recording, ask(recording, request_of(recording))).notes

    without = notes(_with_rest(tmp_path / "learnt"), lambda content: content["records"].pop())
    assert without[-1] == NOISE_IS_LEARNT and "use: rest" in NOISE_IS_LEARNT
    assert NOISE_IS_LEARNT not in notes(drive.write(tmp_path / "stated"), lambda content: None)
    assert NOISE_IS_LEARNT not in notes(_with_rest(tmp_path / "rest"), lambda content: None)


def test_a_simulator_that_a_recorded_signal_drives_does_not_take_the_noise_at_rest(tmp_path):
    folder = _with_rest(tmp_path / "drive")
    content = yaml.safe_load((folder / "recording.yaml").read_text())
    del content["channels"]["position_reference"]
    (folder / "recording.yaml").write_text(yaml.safe_dump(content))
    recording = load_recording(folder)
    question = told_at_rest(recording, ask(recording, request_of(recording)))
    assert all(b.noise is None for b in question.fit.blocks)
    assert "rest.csv, at rest, is not used" in question.notes[-1]


def _moving(table):
    table[:, 2] += 0.01 * np.clip(table[:, 0] - 130.0, 0.0, 1.0)
    return table


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"seconds": 15.0}, r"rest.csv, channel time, row 1500: 1500 samples; 2000 are the least"),
        ({"change": _moving}, r"rest.csv, channel position, row \d+: it moves by 0.01; a record with 'use: rest'"),
        ({"more": ("rest_2.csv",)}, r"rest.csv, rest_2.csv have 'use: rest'; one, the longest, is enough"),
    ],
)
def test_what_is_no_record_at_rest_is_refused_by_name(tmp_path, options, message):
    with pytest.raises(ConfigurationError, match=message):
        gate(load_recording(_with_rest(tmp_path / "drive", **options))).require_usable()
