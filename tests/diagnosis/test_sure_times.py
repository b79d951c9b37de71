"""Times of samples by what these say themselves."""

import numpy as np
import pytest

from cable_envs.diagnosis import Recording
from cable_envs.diagnosis.asked import ask, request_of
from cable_envs.diagnosis.data.clocks.sure_times import with_sure_times

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


def told(seed, *, read=SCATTER, stamps=0.0, command=True):
    """The same with the reference that the place follows 20 ms later, read with the rest, or when it was meant to be.

    In the second half the drive rests.
    """
    rng = np.random.default_rng(seed)
    even, late = PERIOD * np.arange(ROWS), read * rng.standard_normal(ROWS)

    def place(at):
        at = np.minimum(at, 0.6 * PERIOD * ROWS)
        return 0.05 * np.sin(2.0 * at + seed) + 0.01 * np.sin(3.0 * at)

    at = even + late
    return late, {
        "time": at + stamps * rng.standard_normal(ROWS), "position": place(at - 0.02) + rng.normal(0, NOISE, ROWS),
        "force": 0.1 * rng.standard_normal(ROWS), "position_reference": place(at if command else even),
    }  # fmt: skip


@pytest.mark.parametrize("stamps", [SCATTER, 0.5 * SCATTER])
def test_a_smooth_command_tells_when_its_rows_were_read(stamps):
    late, tables = zip(*(told(seed, stamps=stamps) for seed in (1, 2)), strict=True)
    found, said = with_sure_times(recording(*tables))
    assert "beside an even clock, as position reference tells and the other samples confirm" in said[0]
    for record, own, table in zip(found.records, late, tables, strict=True):
        moves = slice(50, 850)
        true = PERIOD * np.arange(ROWS) + own
        assert np.std((record.time - true)[moves]) < 0.5 * np.std((table["time"] - true)[moves])
        rests = slice(1000, ROWS)  # there the command tells nothing, and stamps are as good as they were elsewhere
        assert np.std((record.time - true)[rests]) < 1.01 * np.std((table["time"] - true)[rests])


def test_rows_whose_command_is_not_read_with_them_stay_where_they_are():
    given = recording(*(told(seed, command=False)[1] for seed in (1, 2)))
    found, said = with_sure_times(given)
    assert found is given and said == ()


def test_a_speed_that_follows_the_corners_of_its_command_says_nothing_of_times():
    """Both turn within a sample at the same moments, however evenly they were read."""
    tables = []
    for seed in (1, 2):
        rng, at = np.random.default_rng(seed), PERIOD * np.arange(ROWS)
        speed = np.clip(0.03 * np.sin(2.0 * at + seed), -0.02, 0.015)
        place = np.cumsum(speed) * PERIOD
        tables.append({
            "time": at, "drive_velocity_command": speed, "drive_velocity": speed + rng.normal(0, 1e-5, ROWS),
            "drive_position": place + rng.normal(0, NOISE, ROWS), "load_position": place + rng.normal(0, NOISE, ROWS),
        })  # fmt: skip
    given = Recording.from_arrays("cable_hole", {f"r{k}": t for k, t in enumerate(tables)}, heldout="r1")
    assert with_sure_times(given) == (given, ())
