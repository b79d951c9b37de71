"""What a logger does to its records is found beside the effects of a rig: against signals that were logged so."""

import re
from dataclasses import dataclass

import numpy as np
import pytest
from scipy.signal import lfilter

from cable_envs.diagnosis import diagnose
from cable_envs.diagnosis.data.clocks.lines import NO_LINES, Lines
from cable_envs.diagnosis.intake.logged import CLOCK, DIFFERENCE, FILTER, LINES, with_logger
from cable_envs.diagnosis.model.hypotheses import Hypothesis
from cable_envs.diagnosis.model.model import Block, Free
from cable_envs.diagnosis.search.effects import Search
from cable_envs.diagnosis.systems.question import Question
from tests.support import drive_recording as drive

PERIOD, COUNT, NOISE = 0.01, 3000, 0.005
SHARES = (0.7, 2.3, 6.1, 13.0)
"""Frequencies of the signal, Hz."""


def signal(time):
    return sum(np.sin(2 * np.pi * f * time + f) for f in SHARES)


@dataclass
class Sines:
    """A signal whose size is not known, seen at ``time`` of two records."""

    blocks: list[Block]
    at: list[np.ndarray]

    @property
    def parameters(self):
        return [Free("size", 1.0, 0.1, 10.0, 1.0, 0.3)]

    def predict(self, values):
        return [signal(at)[:, None] * values[:1] for at in self.at]


def question(logged, unit="m", stretch=0.0, **others):
    """Of one channel, or of more of the same signal: name -> what the logger makes of it."""
    rng = np.random.default_rng(3)
    models, channels = [], {"place": logged, **others}
    for use in range(2):
        blocks, at = [], []
        for k in range(2 - use):
            time = PERIOD * np.arange(COUNT) * (1.0 + stretch)
            now = 40.0 * (2 * use + k) + time
            for name, made in channels.items():
                measured = made(40.0 * (2 * use + k) + PERIOD * np.arange(COUNT)) + NOISE * rng.standard_normal(COUNT)
                blocks.append(Block(f"{use}{k}", name, time, measured, np.ones(COUNT, dtype=bool), unit, sensor=name))
                at.append(now)
        models.append(Sines(blocks, at))
    return Question("", models[0], models[1], ("size",), (), (), {"size": ""}, lambda values, names: {})


def found(logged, unit="m", stretched=False, lines=NO_LINES, **others):
    late = question(logged, unit, 1e-4, **others) if stretched else None
    asked = with_logger(question(logged, unit, **others), late, lines)
    search = Search(asked.fit, asked.heldout, asked.nominals, asked.hypotheses, np.random.default_rng(0))
    best = search.run().best
    return {name: best.fit.values[name] for h in best.effects for name in h.names}


def test_a_good_logger_is_not_accused():
    assert found(signal, "m/s", stretched=True) == {}


@pytest.mark.parametrize("earlier", [0.0083, 0.0137, 0.021])
def test_samples_that_were_brought_from_another_clock_are_told_with_its_period(earlier):
    def resampled(time):
        knots = np.arange(time[0] - 3 * earlier, time[-1] + 3 * earlier, earlier)
        return np.interp(time, knots, signal(knots))

    values = found(resampled)
    assert list(values) == [LINES]
    assert values[LINES] == pytest.approx(earlier, rel=0.1)


def test_a_clock_that_runs_fast_is_told_with_its_share():
    values = found(fast, stretched=True)
    assert list(values) == [CLOCK]
    assert values[CLOCK] == pytest.approx(2e-4, rel=0.05)


def fast(time, share=2e-4):
    return signal(40.0 * np.floor(time / 40.0) + (time % 40.0) * (1.0 + share))


def test_a_clock_is_that_of_all_channels():
    """What the surest of three channels shows, and the others could show and do not, is no clock."""

    def late(time):
        return fast(time, 8e-7)

    def unsure(of, seed):
        return lambda t: of(t) + 2.5 * NOISE * np.random.default_rng([seed, int(t[0])]).standard_normal(len(t))

    assert list(found(late, stretched=True, force=unsure(late, 1), angle=unsure(late, 2))) == [CLOCK]
    assert found(late, stretched=True, force=unsure(signal, 1), angle=unsure(signal, 2)) == {}


def test_straight_lines_are_not_asked_where_the_noise_is_as_large_everywhere():
    def smooth(time, earlier=0.014):
        knots = np.arange(time[0] - 3 * earlier, time[-1] + 3 * earlier, earlier)
        return np.interp(time, knots, signal(knots))

    assert list(found(smooth)) == [LINES]
    assert found(smooth, lines=Lines(-20.0)) == {}


def test_a_filtered_speed_is_told_with_its_time_constant():
    def filtered(time, tau=0.02):
        fine = np.arange(time[0], time[-1] + 0.5 * PERIOD, PERIOD / 10)
        keep = np.exp(-PERIOD / 10 / tau)
        slow, _ = lfilter([1 - keep], [1, -keep], signal(fine), zi=[keep * signal(fine[:1])[0]])
        return slow[::10][: len(time)]

    values = found(filtered, "m/s")
    assert list(values) == [f"{FILTER}.place"]
    assert values[f"{FILTER}.place"] == pytest.approx(0.02, rel=0.05)


@pytest.mark.parametrize(("late", "named"), [(0.003, False), (0.015, True)])
def test_an_effort_that_is_read_less_than_half_a_sample_late_has_no_delay(tmp_path, late, named):
    """Of a controller whose output is held, read by a logger that is not in step with it; samples are 10 ms apart."""

    def read_late(_, table):
        table[:, 4] = np.interp(table[:, 0] - late, table[:, 0], table[:, 4])
        return table

    drive.write(tmp_path, change=read_late)
    found = diagnose(tmp_path, effects=["sensor_delay", "viscous_friction"])
    assert [one.name for one in found.effects] == ["sensor_delay"] * named
    for one in found.effects:
        estimate = one.parameters["force"]
        assert estimate.low < late < estimate.high < 0.03


def _derived(corner):
    """A change of a drive's table: its speed is the difference of its own places, and filtered if there is a corner."""

    def change(_, table):
        keep = np.exp(-2.0 * np.pi * corner * PERIOD) if corner else 0.0
        raw = np.diff(table[:, 2], prepend=2.0 * table[0, 2] - table[1, 2]) / PERIOD
        table[:, 3], _ = lfilter([1.0 - keep], [1.0, -keep], raw, zi=[keep * raw[0]])
        return table

    return change


@pytest.mark.parametrize("corner", [0.0, 30.0])
def test_a_speed_that_is_the_difference_of_two_places_has_no_delay(tmp_path, corner):
    drive.write(tmp_path, change=_derived(corner))
    stated = tmp_path / "recording.yaml"
    stated.write_text(re.sub(r"(column: v\n.*\n)\s+noise_std: .*\n", r"\1", stated.read_text()))
    found = diagnose(tmp_path)
    assert (found.verdict, found.effects) == ("data_fault", ())
    assert [fault.name for fault in found.faults] == [f"{DIFFERENCE}.velocity"]
    assert any("velocity is the difference of two places one sample apart" in note for note in found.notes)
    (slow,) = found.faults[0].parameters.values()
    assert slow.value == pytest.approx(1.0 / (2.0 * np.pi * corner), rel=0.1) if corner else slow.value < 0.2 * PERIOD


def test_a_speed_that_is_late_by_less_than_a_difference_makes_it_is_none(tmp_path):
    def late(_, table):
        table[:, 3] = np.interp(table[:, 0] - 0.3 * PERIOD, table[:, 0], table[:, 3])
        return table

    drive.write(tmp_path, change=late)
    assert not [f.name for f in diagnose(tmp_path).faults if DIFFERENCE in f.name]


def _smoothed(_, table):
    """A speed as few know it: central differences of counted places through a filter of the second order."""
    counts = 2e-5 * np.round(table[:, 2] / 2e-5)
    keep = np.exp(-PERIOD / 0.012)
    slow = np.gradient(counts, PERIOD)
    for _ in range(2):
        slow, _ = lfilter([1.0 - keep], [1.0, -keep], slow, zi=[keep * slow[0]])
    table[:, 2], table[:, 3] = counts, slow
    return table


def test_a_speed_that_the_logger_has_made_is_left_out_and_the_rest_is_asked_again(tmp_path):
    """Its filter is none that is known here; what is missing of the rig is named by the place and the force."""
    drive.write(tmp_path, load=_stiff, change=_smoothed)
    stated = tmp_path / "recording.yaml"
    stated.write_text(re.sub(r"\s+noise_std: .*\n", "\n", stated.read_text()))
    told = []
    found = diagnose(tmp_path, tell=told.append)
    assert found.verdict == "named" and [e.name for e in found.effects] == ["position_dependent_load"]
    assert [fault.name for fault in found.faults] == [f"{FILTER}.velocity"]
    assert "leaving out velocity, which the logger has made" in told
    assert any(note.endswith("it is left out, for the recorded place holds what it does") for note in found.notes)
    assert set(found.fit) == {"position", "force"}
    (effect,) = found.effects
    assert effect.parameters["stiffness"].value == pytest.approx(20.0, rel=0.3)


def _stiff(y, v, t):
    return 20.0 * y


class Late(Sines):
    """The signal later by ``late``, s, and behind a filter of the time constant ``slow``, s."""

    @property
    def parameters(self):
        times = [Free(name, 0.0, 0.0, 0.02, 0.002) for name in ("late", "slow")]
        return [*super().parameters, *times]

    def predict(self, values):
        """As the protocol says."""
        made = [np.zeros((len(at), values.shape[1])) for at in self.at]
        for f in SHARES:
            way = values[0] * np.exp(-2j * np.pi * f * values[1]) / (1.0 + 2j * np.pi * f * values[2])
            for out, at in zip(made, self.at, strict=True):
                out += np.imag(np.exp(1j * (2.0 * np.pi * f * at + f))[:, None] * way)
        return made


@pytest.mark.parametrize("first", ["late", "slow"])
@pytest.mark.parametrize(("true", "seconds", "answered"), [
    ("late", 1e-4, "slow"),  # the filter makes the fastest sine smaller by 3e-5 of itself, which nothing tells
    ("slow", 1e-4, "slow"),
    ("late", 3e-4, "slow"),  # smaller by 3e-4: the records tell, by less than loggers' filters differ
    ("late", 6e-3, "late"),  # a filter would make the fastest sine smaller by a tenth
    ("slow", 6e-3, "slow"),
])  # fmt: skip
def test_what_cannot_be_told_from_what_a_logger_has_made_of_a_channel_gives_way(first, true, seconds, answered):
    rng, models = np.random.default_rng(5), []
    truth = np.array([[1.0], [seconds * (true == "late")], [seconds * (true == "slow")]])
    for use in range(2):
        at = [40.0 * (2 * use + k) + PERIOD * np.arange(COUNT) for k in range(2 - use)]
        model = Late([], at)
        for k, made in enumerate(model.predict(truth)):
            seen = made[:, 0] + NOISE * rng.standard_normal(COUNT)
            good = np.ones(COUNT, dtype=bool)
            model.blocks.append(Block(f"{use}{k}", "place", at[k], seen, good, "m", sensor="place"))
        models.append(model)
    free = {p.name: p for p in models[0].parameters}
    asked = [
        Hypothesis(name, (free[name],), (({name: 1e-3},),), nulls={name: 0.0}, redundant="place" * (name == "slow"))
        for name in sorted(free.keys() - {"size"}, key=lambda name: name != first)
    ]  # fmt: skip
    search = Search(*models, ("size",), asked, np.random.default_rng(0), stated={"place": NOISE})
    assert [h.name for h in search.run().best.effects] == [answered]
