"""Refits of effects also begin at the claims of the recording, if the refit without them has gone far from these."""

from types import SimpleNamespace

import numpy as np

from cable_envs.diagnosis.fit.refit import Fit, Start, nearest
from cable_envs.diagnosis.model.model import Block, Free, Whitener
from cable_envs.diagnosis.model.noise import Noise
from cable_envs.diagnosis.search import comparison

PRETENSION = Free("pretension", 50.0, 1.0, 500.0, 50.0, std=5.0)
GROWTH = Free("growth", 0.0, 0.0, 1.0, 0.01)
MASS = Free("mass", 2.0, 0.1, 9.0, 1.0)


class Cable:
    """Pull and stiffness of a cable whose stiffness grows with its pretension; what a record asks of it is linear."""

    parameters = (PRETENSION, GROWTH, MASS)

    def __init__(self):
        time = 0.01 * np.arange(200)
        self.along = np.sin(3.0 * time)
        self.blocks = [Block("one", "pull", time, self._pull(60.0, 0.02, 2.1), np.ones(200, dtype=bool))]

    def _pull(self, pretension, growth, mass):
        return (100.0 + pretension * (1.0 + growth * pretension)) * self.along + mass * self.along**2

    def predict(self, values):
        """As `cable_envs.diagnosis.model.model.Model`."""
        return [np.stack([self._pull(*column) for column in values.T], axis=1)]


def _without(pretension):
    names = ("pretension", "mass")
    return Fit("", names, {"pretension": pretension, "mass": 2.1}, 0.0, np.empty(0), np.empty((0, 2)), np.eye(2), (), 0)


def test_starts_at_the_claims_are_added_where_the_refit_has_gone_far():
    start = Start("growth", ("pretension", "mass", "growth"), {"pretension": 132.0, "mass": 2.1, "growth": 0.001})
    (found,) = comparison._at_claims(Cable(), _without(132.0), [start], ["pretension"])
    assert (found.label, found.free) == (start.label, start.free)
    assert found.values == {"pretension": 50.0, "mass": 2.1, "growth": 0.001}
    assert comparison._at_claims(Cable(), _without(54.0), [start], ["pretension"]) == []
    assert comparison._at_claims(Cable(), _without(132.0), [start], ["mass"]) == []


def test_the_probes_are_tried_at_the_claims_as_they_are():
    """A score at the refit suggests a growth that is none for the pretension that the recording claims."""
    model, whitener = Cable(), Whitener({"pull": Noise(np.empty(0), 0.1)})
    free = ("pretension", "mass", "growth")
    starts = [Start("growth", free, {"pretension": 60.0, "mass": 2.1, "growth": g}) for g in (0.0, 0.1, 0.018, 0.05)]
    broken = Start("growth", free, {"pretension": np.nan, "mass": 2.1, "growth": 0.02})
    other = Start("mass", ("mass",), {"pretension": 60.0, "mass": 1.0, "growth": 0.02})
    assert nearest(model, whitener, [broken, *starts, other]) == [starts[2], other]

    scored = SimpleNamespace(scores=[
        SimpleNamespace(directions=({"growth": g},), gain=gain) for g, gain in ((0.1, 1.0), (0.02, 3.0))
    ])  # fmt: skip
    hypothesis = SimpleNamespace(name="growth", names=("growth",))
    for score in scored.scores:
        score.hypothesis = hypothesis
    probes = comparison._probes(_without(132.0), hypothesis, scored)
    assert [start.values["growth"] for start in probes] == [0.02, 0.1] and probes[0].free == free
    claimed = comparison._at_claims(model, _without(132.0), probes, ["pretension"])
    assert [start.values for start in claimed] == [
        {"pretension": 50.0, "mass": 2.1, "growth": growth} for growth in (0.02, 0.1)
    ]


def test_each_hypothesis_goes_on_from_its_best_start():
    model, whitener = Cable(), Whitener({"pull": Noise(np.empty(0), 0.1)})
    free = ("pretension", "mass", "growth")
    starts = [Start("growth", free, {"pretension": p, "mass": 2.0, "growth": 0.01}) for p in (300.0, 50.0)]
    starts.append(Start("mass", ("mass",), {"pretension": 60.0, "growth": 0.02, "mass": 0.5}))
    found = comparison._looked(model, whitener, starts, 6)
    assert [one.label for one in found] == ["growth", "mass"]
    assert all(one.cost < 6.0 for one in found)  # the prior of the true pretension is 4; from 300 it is 220
