"""An effect that should be alike in all channels and is not hides nothing that is really there."""

import numpy as np

from cable_envs.diagnosis.model.hypotheses import LOGGER, Hypothesis
from cable_envs.diagnosis.model.model import Block, Free
from cable_envs.diagnosis.search.effects import UNLIKE, Search

NOISE = {"a": 0.005, "b": 0.05, "c": 0.05}
COUNT, TONE, BIAS = 1000, 0.02, 0.02
HUM, OFFSET = Free("hum", 0.0, -1.0, 1.0, 0.1), Free("offset", 0.0, -1.0, 1.0, 0.1)
HYPOTHESES = [
    Hypothesis(f"{LOGGER}hum", (HUM,), (({"hum": 0.05},),), nulls={"hum": 0.0}, alike=True),
    Hypothesis("offset", (OFFSET,), (({"offset": 0.05},),), nulls={"offset": 0.0}),
]


class Three:
    """One slow signal of unknown size in three channels, with a tone in some and a bias in the last."""

    def __init__(self, tones, seed, records):
        rng, time = np.random.default_rng(seed), 0.01 * np.arange(COUNT)
        self.slow, self.fast = np.sin(2 * np.pi * 0.3 * time), np.sin(2 * np.pi * 13.0 * time)
        self.parameters = [Free("size", 1.0, 0.1, 10.0, 1.0, 0.3), HUM, OFFSET]
        self.blocks = []
        for record in range(records):
            for channel, tone in zip(NOISE, tones, strict=True):
                noise = NOISE[channel] * rng.standard_normal(COUNT)
                measured = self.slow + tone * self.fast + BIAS * (channel == "c") + noise
                good = np.ones(COUNT, dtype=bool)
                self.blocks.append(Block(f"{seed}-{record}", channel, time, measured, good, "m", sensor=channel))

    def predict(self, values):
        size, hum, offset = values[:3]
        same = size * self.slow[:, None] + hum * self.fast[:, None]
        return [same + offset * (block.channel == "c") for block in self.blocks]


def found(tones):
    rng = np.random.default_rng(0)
    return Search(Three(tones, 1, 2), Three(tones, 9, 1), ("size",), HYPOTHESES, rng, stated=NOISE).run()


def test_what_was_given_up_behind_an_effect_that_channels_disagree_on_is_asked_again():
    """A tone in one channel gains six times as much as the bias of another does, although it is in no third one."""
    of_one = found((TONE, 0.0, 0.0))
    assert [h.name for h in of_one.best.effects] == ["offset"]
    assert of_one.rounds[0].bounded == {f"{LOGGER}hum": UNLIKE}
    assert abs(of_one.best.fit.values["offset"] - BIAS) < 4.0 * NOISE["c"] / np.sqrt(3.0 * COUNT)


def test_an_effect_that_all_channels_agree_on_leads():
    of_all = found((TONE, TONE, TONE))
    assert [h.name for h in of_all.best.effects] == [f"{LOGGER}hum", "offset"]
    assert f"{LOGGER}hum" not in of_all.rounds[0].bounded
