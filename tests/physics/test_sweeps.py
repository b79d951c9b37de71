"""Sweeps over contacts in series: every step obeys spans, contacts and ends, from any start, alone as in a tile."""

import numpy as np
import pytest

from cable_envs.core.compiling.templates import specialised
from cable_envs.core.kernels import LANES, inline
from cable_envs.core.lanes import Lanes
from cable_envs.physics import sweeps


@inline
def _straight(x, q, e, s, i, c, r):
    return 0.0


@inline
def _given(x, q, e, s, j, i):
    return


@inline
def _stays(x, q, e, s, i):
    return True


SOLVE = specialised(
    sweeps.solve, drive_end=_straight, load_end=_straight, load_stays=_stays, first_span=_given, inner_span=_given,
    last_span=_given,
)  # fmt: skip


def _steps(contacts: int, seed: int):
    """Steps of a tile: profiles within the limits that then change, ends that move a little or by far."""
    rng = np.random.default_rng(seed)
    q = Lanes("Sweeps", sweeps.sweep_fields(contacts)).zeros(LANES)
    q.compliance[:] = rng.uniform(0.5, 2.0, q.compliance.shape) * 1e-5
    up, down = rng.uniform(0.01, 0.4, (2, LANES))
    profile = np.empty((contacts + 1, LANES))
    profile[0] = rng.normal(3.0, 0.5, LANES)
    waves = np.sin(rng.uniform(0.0, 9.0, LANES) + 0.5 * np.arange(contacts)[:, None]) > 0.0
    share = np.where(rng.random(LANES) < 0.5, rng.random((contacts, LANES)), waves)
    profile[1:] = profile[0] + np.cumsum(share * (up + down) - up, axis=0)
    q.taken[:] = np.exp(profile) * q.compliance
    changed = rng.choice([1.0, 0.99, 0.9, 0.5, 0.0, 1.1], LANES)
    q.up[:], q.down[:] = np.exp(up * changed), np.exp(down * changed)
    q.per_up[:], q.per_down[:] = 1.0 / q.up, 1.0 / q.down
    size = q.taken.sum(axis=0) * rng.choice([0.0, 0.01, 0.1, 0.5, 2.0], LANES)
    q.drive_reach[:], q.load_reach[:] = rng.normal(0.0, size), rng.normal(0.0, size)
    q.drive_give[:], q.load_give[:] = ((rng.random(LANES) < 0.5) * 1e-6 for _ in range(2))
    q.way[:] = rng.integers(-1, 2, q.way.shape)
    return q


@pytest.mark.parametrize("contacts", [1, 2, 3, 20, 50])
def test_spans_contacts_and_ends_agree_after_a_step(contacts):
    for seed in range(40):
        q = _steps(contacts, seed)
        assert SOLVE(q, None, None, None, LANES) < sweeps.MOST
        t, d, most = q.tension, q.slip, q.tension.max(axis=0)
        pulled = (q.taken + d[:-1] - d[1:]) / q.compliance
        taut = t.min(axis=0) > 1e-9
        assert (t >= 0.0).all() and np.array_equal(taut, most > 1e-9)  # a slack span carries nothing, nor then another
        scale = np.maximum(most, q.taken.max(axis=0) / q.compliance.min(axis=0)) + 1.0  # what was there before, too
        assert (np.abs(np.where(taut, pulled - t, 0.0)) <= 1e-10 * scale).all()
        over = np.maximum(t[:-1] - q.up * t[1:], t[1:] - q.down * t[:-1])
        assert (over <= 1e-10 * scale).all()
        at = np.where(q.way > 0.0, t[:-1] - q.up * t[1:], np.where(q.way < 0.0, t[1:] - q.down * t[:-1], 0.0))
        assert (np.abs(at) <= 1e-10 * scale).all()
        assert (np.where(taut, q.way * d[1:-1], 0.0) >= -1e-14).all() and (d[1:-1][q.way == 0.0] == 0.0).all()
        assert d[0] == pytest.approx(q.drive_reach - q.drive_give * t[0], abs=1e-15)
        assert d[-1] == pytest.approx(q.load_reach + q.load_give * t[-1], abs=1e-15)


def test_a_column_is_the_same_to_the_bit_alone_and_in_a_tile():
    together = _steps(20, 7)
    given = together.rows.copy()
    SOLVE(together, None, None, None, LANES)
    for i in range(LANES):
        alone = Lanes("Sweeps", sweeps.sweep_fields(20)).zeros(LANES)
        alone.rows[:, 0] = given[:, i]
        SOLVE(alone, None, None, None, 1)
        for row in ("tension", "slip", "way"):
            assert np.array_equal(getattr(alone, row)[:, 0], getattr(together, row)[:, i])
