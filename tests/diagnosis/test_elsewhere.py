"""Effects asked on records of another kind, and models that predict unseen records worse than the claim does."""

import numpy as np
import pytest

from cable_envs.diagnosis.data.record import Record
from cable_envs.diagnosis.model.model import Block
from cable_envs.diagnosis.model.verdict import EffectGain, _read
from cable_envs.diagnosis.report.notes import unseen
from cable_envs.diagnosis.search.elsewhere import MOST, Group, groups_of
from cable_envs.diagnosis.search.select import select
from tests.support.diagnosis_toy import HYPOTHESES, NOMINALS, PARAMETERS, along, force

SHORT, FAR = Group("short travel", frozenset({"short0", "short1"})), Group("far travel", frozenset({"far0", "far1"}))
STD = 0.3


class Travels:
    """The force that motions of different travel take, with something that a simulator may not have."""

    def __init__(self, truth, names, seed, extra=lambda y: 0.0 * y):
        rng = np.random.default_rng(seed)
        self.parameters, self.blocks, self._motion = PARAMETERS, [], []
        values = {p.name: p.start for p in PARAMETERS} | {"mass": 11.0, "viscous": 20.0, "coulomb": 5.0} | truth
        for name in names:
            t = 0.01 * np.arange(1500)
            size, w = (0.3 if name.startswith("far") else 0.02), 2.0 * np.pi * rng.uniform(0.2, 0.5, 2)
            phase = rng.uniform(0.0, 6.0, (2, 1))
            turn = w[:, None] * t + phase
            y, v, a = (np.sum(size * f, axis=0) for f in (
                np.sin(turn), w[:, None] * np.cos(turn), -(w[:, None] ** 2) * np.sin(turn)
            ))  # fmt: skip
            seen = force({n: np.array([x]) for n, x in values.items()}, t, y, v, a)[:, 0] + extra(y)
            seen = seen + rng.normal(0.0, STD, len(t))
            good = np.ones(len(t), dtype=bool)
            self.blocks.append(Block(name, "force", t, seen, good, along=along(y, v)))
            self._motion.append((t, y, v, a))

    def predict(self, values):
        p = dict(zip([q.name for q in PARAMETERS], values, strict=True))
        return [force(p, *motion) for motion in self._motion]


def _found(truth, groups, extra=lambda y: 0.0 * y, hypotheses=HYPOTHESES):
    fit = Travels(truth, ("short0", "far0"), 3, extra)
    heldout = Travels(truth, ("short1", "far1"), 4, extra)
    return select(
        fit, heldout, NOMINALS, hypotheses, np.random.default_rng(0), stated={"force": STD}, groups=groups
    )  # fmt: skip


SPRING = [h for h in HYPOTHESES if h.name == "stiffness_effect"]


def test_a_true_effect_holds_on_records_of_another_kind():
    (spring,) = _found({"stiffness": 40.0}, (SHORT, FAR)).accepted
    assert spring.hypothesis.name == "stiffness_effect"
    assert "far travel" in spring.holds and spring.local == ()


def test_what_only_fits_one_range_is_local():
    """A force that saturates at 15 cm is a stiff spring on short travel; on far travel none is better than that."""
    found = _found({}, (SHORT, FAR), lambda y: 4.0 * np.tanh(y / 0.15), SPRING)
    (spring,) = found.accepted
    assert spring.local == ("far travel",) and spring.elsewhere["far travel"] < -20.0


def test_records_that_do_not_show_an_effect_do_not_speak_against_it():
    """A travel of 4 cm shows next to nothing of a weak spring; what it leaves open is no contradiction."""
    (spring,) = _found({"stiffness": 0.5}, (SHORT, FAR), hypotheses=SPRING).accepted
    assert spring.local == () and "short travel" not in spring.holds


def test_it_is_written_and_read_back():
    gain = EffectGain(HYPOTHESES[0], 12.0, elsewhere={"a = 1": 7.0, "a = 2": -9.0, "a = 3": 1.0})
    entry = gain.as_answer()
    assert (entry["holds"], entry["local"]) == (("a = 1",), ("a = 2",))
    assert _read(entry).elsewhere == gain.elsewhere


def _record(name, use="fit", **conditions):
    time = np.arange(3.0)
    return Record(name, use, {"time": time, "position": time}, conditions)


def _block(name, size, rate):
    t = 0.01 * np.arange(1000)
    y, v = size * np.sin(rate * t), size * rate * np.cos(rate * t)
    return Block(name, "force", t, y, np.ones(len(t), dtype=bool), along=along(y, v))


class _Records:
    def __init__(self, *records):
        self.records = records


def _labels(records, blocks=()):
    return [g.label for g in groups_of(_Records(*records), blocks)]


def test_records_are_grouped_by_what_they_state():
    records = [_record(f"{tool}{load}", tool=tool, load=float(load)) for tool in "AB" for load in (10, 30, 90)]
    labels = _labels([*records, _record("still", "rest", load=55.0)])
    assert len(labels) == 5 and labels[0] == "load = 90" and "tool = A" in labels
    many = [_record(str(k), load=float(k)) for k in range(10)]
    assert _labels(many)[:2] == ["load = 0", "load = 9"] and len(_labels(many)) == MOST
    measured = [_record(str(f), frequency=f) for f in (0.0996, 0.0997, 0.2996, 0.3, 0.5)]
    assert set(_labels(measured)) == {"frequency = 0.0996 to 0.0997", "frequency = 0.2996 to 0.3", "frequency = 0.5"}
    warm = [_record(str(k), temperature=20.0 + 0.1 * k + (0.05 if k > 14 else 0.0)) for k in range(30)]
    assert [len(g.records) for g in groups_of(_Records(*warm), [])] in ([15, 15], [14, 16], [16, 14])


def test_records_that_state_nothing_are_grouped_by_their_motion():
    records = [_record("one"), _record("two"), _record("three")]
    alike = [_block("one", 1.0, 3.0), _block("two", 1.1, 3.0), _block("three", 0.9, 3.1)]
    assert _labels(records, alike) == ["one", "two", "three"]
    far = groups_of(_Records(*records), [*alike[:2], _block("three", 4.0, 0.7)])
    assert far[0] == Group("the records of shorter travel", frozenset({"one", "two"}))
    assert far[1] == Group("the records of longer travel", frozenset({"three"}))
    assert _labels([_record("alone")], [_block("alone", 1.0, 3.0)]) == []


def test_parts_of_one_record_are_asked_together():
    parts = [_record("one"), _record("one_after", "heldout", continues="one"), _record("two")]
    groups = groups_of(_Records(*parts), [])
    assert groups[0].records == {"one", "one_after"}


class Deceived(Travels):
    """Short records in which another mass and friction would do better than the true ones, by a fault of the sensor."""

    def __init__(self, names, seed, wrong):
        super().__init__({"mass": 10.0, "viscous": 18.0, "coulomb": 5.5}, names, seed)
        for block, (_, _, _, a) in zip(self.blocks, self._motion, strict=True):
            block.measured[:] += wrong * a


def test_a_refit_that_predicts_unseen_records_worse_goes_back_to_the_claim():
    """Of the fitted records the force is wrong by 4 kg of inertia; on the held-out ones the claim is right."""
    fit, heldout = Deceived(("far0", "far1"), 3, 4.0), Deceived(("far2", "far3"), 4, 0.0)
    found = select(fit, heldout, NOMINALS, SPRING, np.random.default_rng(0), stated={"force": STD})
    assert found.as_claimed and found.null.fit.values["mass"] == 10.0
    assert any("as they were claimed" in note for note in unseen(found))
    right = select(
        Deceived(("far0", "far1"), 3, 4.0), Deceived(("far2", "far3"), 4, 4.0), NOMINALS, SPRING,
        np.random.default_rng(0), stated={"force": STD},
    )  # fmt: skip
    assert not right.as_claimed and right.null.fit.values["mass"] == pytest.approx(14.0, abs=0.2)
    assert unseen(right) == []


class Sprung(Travels):
    """Records with a spring, or without."""

    def __init__(self, names, seed, stiffness):
        super().__init__({"mass": 10.0, "viscous": 18.0, "coulomb": 5.5, "stiffness": stiffness}, names, seed)


def test_an_effect_that_unseen_records_contradict_is_not_named():
    fit, heldout = Sprung(("far0", "far1", "far2"), 3, 60.0), Sprung(("far3",), 4, 0.0)
    found = select(fit, heldout, NOMINALS, SPRING, np.random.default_rng(0), stated={"force": STD})
    assert found.accepted and found.worse and found.verdict == "unknown"
    assert any("nothing is named" in note for note in unseen(found))
