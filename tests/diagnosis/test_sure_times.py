"""Times of samples by what these say themselves."""

import numpy as np

from cable_envs.diagnosis import Recording
from cable_envs.diagnosis.data.clocks.sure_times import with_sure_times
from cable_envs.diagnosis.engine import ask, request_of

PERIOD, ROWS, NOISE = 0.01, 1500, 2e-6
SCATTER = 2e-4
"""s of stamps or of samples."""


def table(seed, *, stamps=0.0, samples=0.0):
    """A drive's channels, whose times and stamps scatter by so much each; both by the same where both are given."""
    rng = np.random.default_rng(seed)
    even, off = PERIOD * np.arange(ROWS), rng.standard_normal(ROWS)
    at = even + samples * off
    place = 0.05 * np.sin(2.0 * at + seed) + 0.01 * np.sin(3.0 * at)
    speed = 0.1 * np.cos(2.0 * at + seed) + 0.03 * np.cos(3.0 * at)
    force = 5.0 * (-0.2 * np.sin(2.0 * at + seed) - 0.09 * np.sin(3.0 * at)) + 2.0 * np.tanh(speed / 0.01)
    channels = {"position": (place, NOISE), "velocity": (speed, 1e-3), "force": (force, 0.02)}
    seen = {n: np.round((v + rng.normal(0.0, s, ROWS)) / (0.5 * s)) * 0.5 * s for n, (v, s) in channels.items()}
    return {"time": even + stamps * off, **seen}


def recording(*tables):
    return Recording.from_arrays(
        "linear_drive", {f"r{k}": t for k, t in enumerate(tables)}, heldout="r1", nominal={"mass": 5.0}
    )


def test_stamps_that_scatter_where_the_samples_do_not_are_taken_as_even():
    found, said = with_sure_times(recording(table(1, stamps=SCATTER), table(2, stamps=SCATTER)))
    assert said == ("stamps scatter by 0.2 ms where the samples do not: these are taken as even",)
    for record in found.records:
        np.testing.assert_allclose(np.diff(record.time), PERIOD, atol=2e-6)
    blocks = ask(found, request_of(found)).fit.blocks
    exact = table(1)["position"]
    own = next(b for b in blocks if b.channel == "position")
    assert np.max(np.abs(np.interp(PERIOD * np.arange(20, 1480), own.time, own.measured) - exact[20:1480])) < 4 * NOISE


def test_stamps_of_samples_that_do_scatter_are_believed_and_so_are_even_ones():
    for more in ({"stamps": SCATTER, "samples": SCATTER}, {}, {"samples": SCATTER}):
        given = recording(table(1, **more), table(2, **more))
        found, said = with_sure_times(given)
        assert found is given and said == ()
