"""One effect with several valleys: where its model leaves something, it is refitted from about there."""

import numpy as np
import pytest

from cable_envs.diagnosis.model.hypotheses import Hypothesis
from cable_envs.diagnosis.model.model import Free
from cable_envs.diagnosis.search.select import select
from tests.support.diagnosis_toy import NOMINALS, Moving

HEIGHT, PERIOD = Free("height", 0.0, 0.0, 50.0, 1.0), Free("period", 0.09, 1e-3, 1.0, 0.01)
HIGH, LOW = (1.0, 0.055), (0.4, 0.02)
"""Heights and periods of two waves of a rail's pull; the search begins at the lower one."""


class Rippled(Moving):
    """The toy on a rail whose pull comes again with the position."""

    def __init__(self, seed, records):
        def pull(t, y, v):
            return sum(height * np.sin(2.0 * np.pi * y / period) for height, period in (HIGH, LOW))

        super().__init__({}, seed, records, extra=pull)
        self.parameters = (*self.parameters, HEIGHT, PERIOD)

    def predict(self, values):
        """As `cable_envs.diagnosis.model.model.Model`."""
        height, period = values[-2:]
        return [
            left + height * np.sin(2.0 * np.pi * y[:, None] / period)
            for left, (_, y, _, _) in zip(super().predict(values), self._motion, strict=True)
        ]


def test_a_valley_that_leaves_something_is_not_the_last():
    ripple = Hypothesis("ripple", (HEIGHT, PERIOD), (({"height": 0.4, "period": LOW[1]},),), nulls={"height": 0.0})
    found = select(
        Rippled(1, 2), Rippled(51, 1), NOMINALS, [ripple], np.random.default_rng(0), stated={"force": 0.3}
    )  # fmt: skip
    assert found.verdict == "partly_named" and [a.hypothesis.name for a in found.accepted] == ["ripple"]
    values = [found.final.fit.values[name] for name in ("height", "period")]
    assert values == pytest.approx(HIGH, rel=0.02)
    assert found.after.share == pytest.approx(LOW[0] ** 2 / (LOW[0] ** 2 + HIGH[0] ** 2), rel=0.2)
