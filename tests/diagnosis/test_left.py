"""What a model leaves: along the motion and the time, what sensors share, tones, and more than the noise."""

from dataclasses import replace
from itertools import product
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lfilter, savgol_filter
from scipy.special import i0e

from cable_envs.diagnosis.data.readings import Reading
from cable_envs.diagnosis.evidence import tones as lines
from cable_envs.diagnosis.evidence.candidates import under_one_noise
from cable_envs.diagnosis.evidence.counts import without_counts
from cable_envs.diagnosis.evidence.joint import Joint
from cable_envs.diagnosis.evidence.left import left_by
from cable_envs.diagnosis.evidence.shared import bayes_bound, coherence_evidence, coherences
from cable_envs.diagnosis.evidence.tones import of_mains, one_phase, tones, without_tones
from cable_envs.diagnosis.fit.likelihood import refit_and_learn
from cable_envs.diagnosis.fit.refit import Start
from cable_envs.diagnosis.model.leftover import ALL, Leftover
from cable_envs.diagnosis.model.model import Block, Coordinate, learn_whitener
from cable_envs.diagnosis.model.rest import noise_at_rest
from tests.support.diagnosis_toy import HYPOTHESES, NOMINALS, Moving, Toy, along

SURE = float(np.log(20.0))


def _left(model, heldout=None, stated=None):
    """What the refit of the nominal parameters leaves of all records."""
    heldout = heldout or Moving({}, 991, 1)
    fit = refit_and_learn(model, [Start("", NOMINALS, {})]).fit
    joint = Joint(model, heldout)
    (found,) = under_one_noise(model, joint, [((), fit)], 0, stated or {}, joint.left_by(fit))
    return left_by(joint, found, found, 0.0, stated or {})


def _coloured(rng, count, std, memory=0.9):
    return lfilter([1.0], [1.0, -memory], rng.normal(0.0, std * np.sqrt(1.0 - memory**2), count))


class Sensors(Toy):
    """The toy's force as ``count`` sensors see it, each in coloured noise of its own; ``seen(t, y, v)`` is in all."""

    def __init__(self, seed, seen=None, sensors=2, records=2, own=None, memory=0.9):
        super().__init__({}, seed, records, std=1e-3, count=2400)
        rng, blocks = np.random.default_rng([seed, 5]), []
        self._sensors = sensors
        for block, (t, y, v, _) in zip(self.blocks, self._motion, strict=True):
            for k in range(sensors):
                noise = _coloured(rng, len(t), 0.3, memory) + rng.normal(0.0, 0.1, len(t))
                measured = block.measured + noise
                measured = measured if seen is None else measured + seen(t, y, v)
                measured = measured if own is None else measured + own(rng, t, k)
                name = f"force_{k}"
                blocks.append(replace(block, channel=name, measured=measured, along=along(y, v), sensor=name))
        self.blocks = blocks

    def predict(self, values):
        """As the protocol says."""
        return [p for p in super().predict(values) for _ in range(self._sensors)]


def _seen_by(seed, **options):
    return _left(Sensors(seed, **options), Sensors(seed + 500, records=1, **options))


@pytest.mark.parametrize("seed", range(3))
def test_nothing_is_left_of_a_right_model(seed):
    assert _left(Moving({}, seed, colour=0.3 * seed), Moving({}, seed + 300, 1, colour=0.3 * seed)).log_odds < SURE
    assert _seen_by(seed).log_odds < SURE


def _pawl(t, y, v):
    """Two newtons within a few per cent of the travel, on the way up only."""
    return 2.0 * np.exp(-(((y - 0.02) / 0.004) ** 2)) * (v > 0)


def test_a_pawl_is_left_along_the_position():
    model, heldout = (Moving({}, seed, k, extra=_pawl) for seed, k in ((2, 2), (502, 1)))
    found = _left(model, heldout)
    best = next(k for k in found.kinds if k.at and k.height and k.coordinate.startswith("position"))
    assert found.log_odds > SURE and not found.cause
    assert abs(best.at[int(np.argmax(np.abs(best.height)))] - 0.02) < 0.02


def test_a_drag_that_drifts_is_left():
    """Grease warms up: 30 % of the drag, up and down."""

    def warm(t, y, v):
        return 0.3 * 20.0 * v * np.cos(np.pi * t / t[-1])

    found = _seen_by(3, seen=warm)
    assert found.log_odds > SURE and not found.cause


def test_a_zero_that_drifts_in_one_sensor_is_of_the_sensor():
    def drift(rng, t, k):
        return 1.5 * k * np.cos(np.pi * t / t[-1] + rng.uniform(0.0, 6.0))

    model, heldout = (Sensors(seed, own=drift, memory=0.0, records=k) for seed, k in ((7, 2), (507, 1)))
    found = _left(model, heldout)
    assert found.log_odds > SURE and found.cause == "force 1: its zero drifts"
    stated = _left(model, heldout, {"force_0": float(np.hypot(0.3, 0.1)), "force_1": float(np.hypot(0.3, 0.1))})
    assert stated.log_odds > SURE and not stated.cause  # whoever states the noise says that there is no more of it


@pytest.mark.parametrize("seed", range(3))
def test_what_two_sensors_share_is_no_noise(seed):
    """Each channel by itself is a fine autoregression."""

    def wave(t, y, v):
        rng = np.random.default_rng(round(1e6 * abs(y[5])))
        return lfilter([1.0], [1.0, -0.98], rng.normal(0.0, 0.4 * np.sqrt(1.0 - 0.98**2), len(t)))

    found = _seen_by(seed, seen=wave)
    assert found.log_odds > SURE and not found.cause
    assert any(k.channel == "force_0 and force_1" and k.log_odds > SURE for k in found.kinds)


def test_sensors_of_one_encoder_are_not_held_against_each_other():
    def wave(t, y, v):
        rng = np.random.default_rng(round(1e6 * abs(y[5])))
        return lfilter([1.0], [1.0, -0.98], rng.normal(0.0, 0.4 * np.sqrt(1.0 - 0.98**2), len(t)))

    model, heldout = Sensors(1, wave), Sensors(501, wave, records=1)
    for one in (model, heldout):
        one.blocks = [replace(b, sensor="one") for b in one.blocks]
    assert not any(" and " in k.channel for k in _left(model, heldout).kinds)


@pytest.mark.parametrize("memory", [0.0, 0.9, 0.99])
def test_coherence_of_independent_channels_is_rarely_taken_for_shared(memory):
    odds = []
    for seed in range(80):
        rng, blocks = np.random.default_rng(seed), []
        t = 0.01 * np.arange(2000)
        for record, channel in product(("one", "two"), "abc"):
            noise = lfilter([1.0], [1.0, -memory], rng.normal(size=len(t)))
            blocks.append(Block(record, channel, t, noise, np.ones(len(t), dtype=bool), sensor=channel))
        raw = [b.measured for b in blocks]
        found = coherences(blocks, learn_whitener(blocks, raw).flat(blocks, raw))
        odds.append(next(f.log_odds for f in found if f.channel == ALL))
    assert np.mean(np.array(odds) > SURE) < 0.05 and np.median(odds) < 0.0


def test_the_evidence_of_a_coherence_is_the_integral_over_it():
    from scipy.integrate import quad
    from scipy.special import hyp2f1

    for c, n in ((0.1, 8.0), (0.5, 12.0), (0.9, 30.0)):
        whole = quad(lambda g, c=c, n=n: (1.0 - g) ** n * hyp2f1(n, n, 1.0, g * c), 0.0, 1.0)[0]
        assert coherence_evidence(c, n) == pytest.approx(np.log(whole), abs=1e-6)
    assert bayes_bound(0.05) == pytest.approx(np.log(2.456), abs=1e-3) and bayes_bound(0.5) == 0.0


def _hum(rng, t, k):
    return 0.4 * np.sin(2.0 * np.pi * 7.3 * t + rng.uniform(0.0, 2.0 * np.pi))


def test_hum_in_each_sensor_is_of_the_sensors_and_a_vibration_is_not():
    found = _seen_by(4, own=_hum)
    assert found.log_odds > SURE and "a steady tone of 7." in found.cause
    shaken = _seen_by(4, seen=lambda t, y, v: 0.4 * np.sin(2.0 * np.pi * 7.3 * t))
    assert shaken.log_odds > SURE and not shaken.cause
    line = next(k for k in shaken.kinds if k.coordinate == "frequency" and " and " not in k.channel)
    assert line.at[0] == pytest.approx(7.3, abs=0.1)


def test_a_tone_that_the_record_at_rest_shows_is_noise():
    """The phase differs from record to record, as it does between records and rest."""
    rng = np.random.default_rng(6)
    at_rest = rng.standard_normal(6000) + 2.0 * _hum(rng, 0.01 * np.arange(6000), 0)

    def left(known):
        models = [Sensors(4, own=_hum, memory=0.0, records=2), Sensors(504, own=_hum, memory=0.0, records=1)]
        for model in models:
            model.blocks[:] = [replace(b, noise=known) for b in model.blocks]
        return _left(*models)

    quiet = noise_at_rest(0.5 * rng.standard_normal(6000))
    humming = noise_at_rest(0.5 * at_rest)
    assert not quiet.lines and any(abs(f - 0.073) < 2e-4 for f in humming.lines)
    assert left(humming).log_odds < SURE and not left(humming).cause
    beside = left(quiet)  # the sensor had no tone: it is the rig's
    assert beside.log_odds > SURE and not beside.cause


def test_mains_are_of_the_sensors_with_one_phase_too_and_as_sampling_folds_them():
    model = Sensors(4)
    blocks = [replace(b, time=b.time * (1.0 / 92.0) / 0.01) for b in model.blocks]
    assert [of_mains(f, blocks) for f in (42.0, 8.0, 34.0, 32.0, 28.0, 4.0, 20.0, 38.0)] == [True] * 6 + [False] * 2

    shaken = _seen_by(4, seen=lambda t, y, v: 0.4 * np.sin(2.0 * np.pi * 40.0 * t))  # 60 Hz, read at 100 Hz
    assert shaken.log_odds > SURE and "a steady tone of 40" in shaken.cause


def test_zeros_that_drift_are_of_the_sensors_if_nothing_is_left_beside_them():
    def drift(rng, t, k):
        return 1.5 * np.cos(np.pi * t / t[-1] + rng.uniform(0.0, 6.0))

    def left(seen):
        model, heldout = (Sensors(seed, seen, own=drift, memory=0.0, records=k) for seed, k in ((7, 2), (507, 1)))
        return _left(model, heldout)

    found = left(None)
    assert found.log_odds > SURE and found.cause == "force 0: its zero drifts; force 1: its zero drifts"
    found = left(_pawl)
    assert found.log_odds > SURE and not found.cause


def test_a_zero_that_walks_a_little_beside_one_that_walks_far_drifts_too():
    """The most probable size of a slow wave is not always the one whose odds may be trusted most."""

    def walk(rng, t, k):
        return (0.36, 0.12)[k] * (rng.normal() + np.cumsum(rng.normal(size=len(t))) / np.sqrt(len(t)))

    model, heldout = (Sensors(seed, own=walk, memory=0.0, records=k) for seed, k in ((17, 2), (517, 1)))
    found = _left(model, heldout)
    assert found.log_odds > SURE and found.cause == "force 0: its zero drifts; force 1: its zero drifts"


@pytest.mark.parametrize("rows", [1, 2, 3])
def test_what_a_coarse_sensor_rounds_is_no_tone_of_the_rig(rows):
    """Slow triangles, counted in steps of seven standard deviations of the noise: tones of v / q and its multiples.

    Samples are readings, or means of so many of them about their time, the two ends of an even number counting half.
    """
    rng, step, noise = np.random.default_rng(5), 4e-5, 5.6e-6
    weights = np.r_[np.ones(rows), [0.0] * (1 - rows % 2)] / rows
    if rows % 2 == 0:
        weights[[0, -1]] = 0.5 / rows
    time, blocks, truths = 0.01 * np.arange(2500), [], []
    times = time[:, None] + 0.01 / rows * (np.arange(len(weights)) - len(weights) // 2)
    for record, speed in (("a", 1.2e-3), ("b", 1.0e-3), ("c", 1.1e-3)):
        begin = rng.uniform()
        place = speed * np.abs((times + begin) % 8.0 - 4.0)
        counted = step * np.round((place + noise * rng.standard_normal((2500, len(weights)))) / step)
        good = np.ones(len(time), dtype=bool)
        blocks.append(Block(record, "position", time, counted @ weights, good, "m", reading=Reading(step, rows)))
        truths.append(place @ weights + 3e-6)  # a model is off by a tenth of a step
    raw = [b.measured - place for b, place in zip(blocks, truths, strict=True)]
    assert tones(blocks, raw, learn_whitener(blocks, raw).flat(blocks, raw))[0].log_odds > SURE
    fine = without_counts(SimpleNamespace(blocks=blocks), raw).blocks
    left = [b.measured - place for b, place in zip(fine, truths, strict=True)]
    assert tones(fine, left, learn_whitener(fine, left).flat(fine, left))[0].log_odds < SURE
    assert np.std(left) < 0.95 * np.std(raw)
    if rows == 1:  # what is left is what noise before rounding makes of it: less than rounding alone
        assert np.std(left) < step / np.sqrt(12.0) < np.std(raw)
    blocks = [replace(b, reading=Reading(0.5 * noise, rows)) for b in blocks]
    joint = SimpleNamespace(blocks=blocks)
    assert without_counts(joint, raw) is joint


def test_a_hum_does_not_hide_what_is_left_beside_it():
    both = _seen_by(4, own=_hum, seen=lambda t, y, v: 1.5 * np.sin(40.0 * y))
    assert both.log_odds > SURE and not both.cause


def _two_sensors(frequency, apart):
    """Blocks of two forces with a tone, ``apart`` rad between them in each record, and what a model leaves of both."""
    rng, blocks = np.random.default_rng(4), []
    time = 0.01 * np.arange(2500)
    for record, more in enumerate(apart):
        phase = rng.uniform(0.0, 2.0 * np.pi)
        for k in range(2):
            tone = 0.8 * np.sin(2.0 * np.pi * frequency * time + phase + k * more)
            left = tone + rng.standard_normal(len(time))
            name = f"force_{k}"
            blocks.append(Block(str(record), name, time, left, np.ones(len(time), dtype=bool), sensor=name))
    return blocks, [b.measured for b in blocks]


def test_phases_between_sensors_agree_as_closely_as_they_are_known():
    """Three phases at random lie within 0.7 rad in some recordings; these are known to 0.06 rad."""
    for apart, shaken in (((0.62, 0.70, 0.58), True), ((2.23, 1.81, 1.56), False)):
        blocks, left = _two_sensors(7.3, apart)
        found = tones(blocks, left, learn_whitener(blocks, left).flat(blocks, left))
        assert all(line.log_odds > SURE and bool(line.cause) is not shaken for line in found)
    exact = [((np.exp(1j * p), 1e-2), (1.0 + 0.0j, 1e-2)) for p in (0.1, 0.1, 0.1)]
    whole = np.log(
        np.mean(np.exp(300.0 * (np.cos(np.linspace(0, 2 * np.pi, 10_000, endpoint=False)) - 1.0)))
    )  # over the true phase
    assert one_phase(exact) == pytest.approx(whole - 3.0 * np.log(i0e(100.0)), abs=1e-3)


def _position(left, motions):
    """What a model leaves of one position in records of several motions, and the strongest line in it."""
    rng, blocks, raw, time = np.random.default_rng(6), [], [], 0.01 * np.arange(2500)
    for record, motion in enumerate(motions):
        place = motion(time)
        raw.append(left(time, place, np.gradient(place, time), rng) + 1e-5 * rng.standard_normal(len(time)))
        ways = (Coordinate("position", "m", place), Coordinate("direction", "", np.sign(np.gradient(place))))
        good = np.ones(len(time), dtype=bool)
        blocks.append(Block(str(record), "position", time, place + raw[-1], good, "m", ways, sensor="encoder"))
    return tones(blocks, raw, learn_whitener(blocks, raw).flat(blocks, raw))[0]


def test_what_a_periodic_motion_repeats_is_no_tone_of_a_sensor():
    """Friction that is a little wrong, in records of one motion; a hum beside the same motion is one."""
    motions = [lambda t, late=late: 0.1 * np.sin(2.0 * np.pi * 1.3 * t + late) for late in (0.0, 1.0, 2.2)]
    rubs = _position(lambda t, y, v, rng: 2e-5 * np.sign(v), motions)
    assert rubs.log_odds > SURE and not rubs.cause
    hums = _position(lambda t, y, v, rng: _hum(rng, t, 0) * 5e-5, motions)
    assert hums.log_odds > SURE and "a steady tone of 7.3" in hums.cause


def test_a_vibration_that_comes_with_one_record_is_no_tone_of_a_sensor():
    motions = [lambda t, w=w: 0.1 * np.sin(w * t) for w in (0.8, 1.1, 1.9)]
    size = iter((2e-6, 4e-5, 2e-6))
    shaken = _position(lambda t, y, v, rng: _hum(rng, t, 0) * 2.5 * next(size), motions)
    assert shaken.log_odds > SURE and not shaken.cause


def _narrow(made, frequency, draws=60):
    """Share of draws of three records in which the line at a frequency is as narrow as these are long."""
    time, found = 0.01 * np.arange(2500), 0
    for seed in range(draws):
        rng = np.random.default_rng(seed)
        raw = [made(time, rng) for _ in range(3)]
        good = np.ones(len(time), dtype=bool)
        blocks = [Block(str(k), "position", time, left, good, "m") for k, left in enumerate(raw)]
        found += lines._steady(blocks, raw, Leftover("position", "frequency", "Hz", 20.0, at=(frequency,)))
    return found / draws


@pytest.mark.parametrize("memory", [0.0, 0.9, 0.99])
@pytest.mark.parametrize("frequency", [2.6, 10.5])
@pytest.mark.parametrize("over", [5.0, 50.0])
def test_a_hum_is_narrow_whatever_the_colour_of_the_noise(memory, frequency, over):
    """Whether it is just to be seen or far above: amplitudes of 5 and 50 times what chance makes at its frequency."""
    gain = np.sqrt(1.0 - memory**2) / abs(1.0 - memory * np.exp(-2j * np.pi * 0.01 * frequency))
    size = over * gain * np.sqrt(4.0 / 2500)  # mean square of a coefficient of noise, as an amplitude

    def made(time, rng):
        hum = size * np.sin(2.0 * np.pi * frequency * time + rng.uniform(0.0, 2.0 * np.pi))
        return hum + _coloured(rng, len(time), 1.0, memory)

    assert _narrow(made, frequency) > 0.95


@pytest.mark.parametrize("ring", [0.5, 1.5, 4.0])
def test_what_rings_and_dies_away_is_broad(ring):
    """A resonance of 2.6 Hz that noise shakes, and that is a third of itself after ``ring`` of 25 seconds."""
    pole = np.exp(-0.01 / ring + 2j * np.pi * 0.01 * 2.6)

    def made(time, rng):
        shaken = lfilter([1.0], [1.0, -2.0 * pole.real, abs(pole) ** 2], rng.normal(0.0, 1.0, len(time)))
        return shaken / np.std(shaken) + _coloured(rng, len(time), 0.1)

    assert _narrow(made, 2.6) < 0.05


@pytest.mark.parametrize("base", [7.3, 26.0333, 60.95])
def test_a_tone_of_a_sensor_brings_its_harmonics(base):
    """Three times 7.3 Hz are 21.9 Hz, as 100 samples a second show three times 26.03 Hz, and twice 60.95 Hz."""
    blocks, left = _two_sensors(21.9, (0.62, 0.70, 0.58))
    white = learn_whitener(blocks, left).flat(blocks, left)
    hum = [Leftover("force_1", "frequency", "Hz", 50.0, at=(base,))]
    assert [bool(line.cause) for line in tones(blocks, left, white, hum)] == [False, True]


def _place_and_speed(moved, hum):
    """Blocks of a place and its speed in a control loop, and what a model leaves of both, in three records."""
    rng, blocks, left = np.random.default_rng(8), [], []
    time, turn = 0.01 * np.arange(3000), 2.0 * np.pi * 7.3
    for record in "abc":
        phase, own = rng.uniform(0.0, 2.0 * np.pi, 2)
        for channel, size in (("position", moved), ("velocity", turn * moved)):
            shift = 0.5 * np.pi if channel == "velocity" else 0.0
            tone = size * np.sin(turn * time + phase + shift)
            tone = tone + hum * np.sin(turn * time + own) * (channel == "position")
            blocks.append(Block(record, channel, time, tone, np.ones(len(time), dtype=bool)))
            left.append(tone + (1.0 if channel == "position" else turn) * 1e-5 * rng.standard_normal(len(time)))
    found = tones(blocks, left, learn_whitener(blocks, left).flat(blocks, left))
    return next(line for line in found if line.channel == "position")


def test_what_moves_has_the_speed_of_its_place_and_a_hum_that_a_controller_passes_on_has_not():
    assert not _place_and_speed(2e-5, 0.0).cause
    assert "a steady tone of 7." in _place_and_speed(5e-6, 3e-5).cause


def test_a_tone_is_taken_out_and_nothing_else():
    model, rng = Sensors(4, sensors=1), np.random.default_rng(2)
    joint = Joint(model, Sensors(504, sensors=1, records=1))
    noise = [0.3 * rng.standard_normal(len(b.time)) for b in joint.blocks]
    joint.blocks = [replace(b, measured=n + _hum(rng, b.time, 0)) for b, n in zip(joint.blocks, noise, strict=True)]
    raw = [b.measured for b in joint.blocks]
    line = next(iter(tones(joint.blocks, raw, learn_whitener(joint.blocks, raw).flat(joint.blocks, raw))))
    cleaned = without_tones(joint, raw, [line])
    for block, own in zip(cleaned.blocks, noise, strict=True):
        assert np.std(block.measured - own) < 0.03  # two numbers of a sine, each sure to 0.3 (2 / T)^(1/2)


def test_what_only_the_held_out_records_show_is_left():
    model = Moving({}, 6, std=0.3)
    quiet, pushed = (Moving({}, 7, records=1, std=0.3, extra=extra) for extra in (None, lambda t, y, v: 2.0 * abs(v)))
    assert _left(model, quiet).log_odds < SURE < _left(model, pushed).log_odds


def test_what_the_parameters_are_unsure_of_is_not_left_in_held_out_records():
    """One slow record tells little of the drag: on fast ones its error is no mismatch."""
    for seed in range(3):
        model, heldout = Moving({}, seed, records=1, count=600), Moving({}, 50 + seed, records=2)
        for block, (_, y, v, a) in zip(model.blocks, model._motion, strict=True):
            for slow in (y, v, a):
                slow *= 0.2
            truth = {"mass": 11.0, "viscous": 20.0, "coulomb": 5.0}
            values = np.array([[truth.get(p.name, p.start)] for p in model.parameters])
            block.measured[:] = model.predict(values)[0][:, 0] + np.random.default_rng(seed).normal(0.0, 0.3, 600)
        assert _left(model, heldout).log_odds < SURE


def test_rounding_at_rest_is_no_coordinate():
    """A speed that is measured less what is left is one number at rest but for rounding, which follows the noise."""
    model, heldout = Toy({}, 8, std=0.3), Toy({}, 508, 1, std=0.3)
    rng = np.random.default_rng(0)
    for one in (model, heldout):
        for k, block in enumerate(one.blocks):
            rest = np.sin(2 * np.pi * 0.3 * block.time) > -0.8
            noise = rng.normal(0.0, 0.3, len(block.time))
            speed = np.where(rest, (0.7 + noise) - noise, 0.7 + np.cos(block.time))
            one.blocks[k] = replace(block, along=(Coordinate("speed", "m/s", speed),))
    assert _left(model, heldout).log_odds < SURE


def test_a_weak_channel_is_not_held_against_its_own_noise():
    """A torque that is all noise, smoothed, is no coordinate for that torque: its prediction is."""
    odds = {}
    for channel in ("", "force"):
        model, heldout = Toy({}, 4, std=20.0), Toy({}, 504, 1, std=20.0)
        for one in (model, heldout):
            for k, block in enumerate(one.blocks):
                own = Coordinate("torque", "N", savgol_filter(block.measured, 11, 3), channel)
                one.blocks[k] = replace(block, along=(own,))
        odds[channel] = _left(model, heldout).log_odds
    assert odds[""] > SURE > odds["force"]


def test_more_than_the_stated_noise_is_left():
    white = {"force": 0.3}
    assert _left(Moving({}, 1), Moving({}, 301, 1), white).log_odds < SURE
    rough = _left(Moving({}, 1, std=0.36), Moving({}, 301, 1, std=0.36), white)
    assert rough.log_odds > SURE and rough.kinds[0].coordinate == "size of the noise"


class WithSpeed(Moving):
    """The toy whose speed is measured, too; it follows from the motion, whatever acts."""

    def __init__(self, seed, records=2, **options):
        super().__init__({"stiffness": 60.0}, seed, records, std=0.05, **options)
        rng, speeds = np.random.default_rng([seed, 7]), []
        for block, (_, _, v, _) in zip(self.blocks, self._motion, strict=True):
            speeds.append(replace(block, channel="velocity", measured=v + rng.normal(0.0, 1e-3, len(v))))
        self.blocks = [*self.blocks, *speeds]

    def predict(self, values):
        """As the protocol says."""
        of_speed = [np.repeat(v[:, None], len(values[0]), axis=1) for _, _, v, _ in self._motion]
        return [*super().predict(values), *of_speed]


@pytest.mark.parametrize("stated", [{}, {"velocity": 1e-3}])
@pytest.mark.parametrize(("off", "low", "high"), [(0.25, 0.001, 0.05), (3.0, 0.25, 1.5)])
def test_a_channel_in_which_nothing_was_to_be_explained_has_no_share_in_what_is_left(stated, off, low, high):
    def extra(t, y, v):
        return off * np.sin(40.0 * y)  # of a spring that no simulator has, more than the noise

    model, heldout = WithSpeed(3, extra=extra), WithSpeed(4, records=1, extra=extra)
    joint, spring = Joint(model, heldout), HYPOTHESES[0]
    starts = [(spring,), ()]
    fits = [
        (e, refit_and_learn(model, [Start("", (*NOMINALS, *(n for h in e for n in h.names)), {})]).fit) for e in starts
    ]
    best, bare = under_one_noise(model, joint, fits, 0, stated, joint.left_by(fits[1][1]))
    assert best.by_size
    found = left_by(joint, best, bare, 0.0, stated)
    force = best.squares / bare.squares
    assert force[best.frame.channels.index("velocity")] == pytest.approx(1.0)
    assert found.share == pytest.approx(force[best.frame.channels.index("force")], rel=0.01)
    assert low < found.share < high
