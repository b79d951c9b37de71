"""The solver of contacts in series against trying every set of a step, and what holds for its solutions."""

from itertools import product

import numpy as np
import pytest

from cable_envs.core.compiling.templates import specialised
from cable_envs.core.kernels import LANES, inline
from cable_envs.physics import series

DT = 1e-3


@inline
def _growing(p, q, e, s, h, i, speed, way):
    return p[h, i] + e * speed * speed, 2.0 * e * abs(speed)


@inline
def _stiffly(p, q, e, s, i):
    return 0.0


SOLVE, SWEEP = (specialised(piece, law=_growing, lead=_stiffly) for piece in (series.solve, series.sweep))


def _random(contacts: int, seed: int):
    """Steps of a tile: tensions around 50 N, some spans slack, the drive at a speed or in a loop with limits."""
    rng = np.random.default_rng(seed)
    q = series.series_rows(contacts).zeros(LANES)
    slack = rng.random((contacts, LANES)) < 0.15
    q.base[:-1] = np.where(slack, -rng.uniform(0.0, 40.0, slack.shape), rng.uniform(1.0, 90.0, slack.shape))
    q.pull[:-1] = np.maximum(q.base[:-1], 0.0)
    q.steep[:-1] = rng.uniform(30.0, 400.0, slack.shape)
    q.draws[:] = 0.5 * q.steep[0]
    q.rate[:] = rng.normal(0.0, 0.05, q.rate.shape) * (rng.random(q.rate.shape) < 0.7)
    q.speed[:], q.inertia[:] = q.rate[-1], rng.uniform(1.0, 8.0, LANES)
    q.resist[:], q.damper[:], q.spring[:] = rng.uniform(10.0, 90.0, LANES), rng.uniform(0.0, 20.0, LANES), 2000.0
    q.rub_up[:], q.rub_down[:] = (rng.uniform(0.0, 4.0, LANES) * (rng.random(LANES) < 0.3) for _ in range(2))
    loop = rng.random(LANES) < 0.6
    q.wanted[:], q.by_tension[:] = rng.normal(0.0, 10.0, LANES) + 5.0, 0.1
    q.by_end[:] = q.by_first[:] = 300.0
    q.low[:] = q.rate[0] - 0.01
    q.high[:] = np.where(loop, q.rate[0] + 0.01, q.low)
    return q, rng.uniform(1.02, 2.0, (contacts, LANES))


def _tensions(q, i, w, last):
    """Tensions before clipping, with the load's row for the theta of the solution."""
    mass = q.inertia[i] / (q.theta[i] * DT)
    y = [q.base[0, i] + q.draws[i] * w[0] - q.steep[0, i] * w[1]]
    y += [q.base[j, i] + q.steep[j, i] * (w[j] - w[j + 1]) for j in range(1, last)]
    rise = mass + q.damper[i] + q.theta[i] * DT * q.spring[i]
    return np.array([*y, q.resist[i] - mass * q.speed[i] + rise * w[last]])


def _residual(q, i, n, w, m, taut, last):
    t = _tensions(q, i, w, last)
    t[:-1] *= taut
    t[-1] += q.rub_up[i] if m[-1] > 0 else -q.rub_down[i] if m[-1] < 0 else 0.0
    drive = {
        0: q.wanted[i] - w[0] - q.by_tension[i] * t[0] - q.by_end[i] * w[0] + q.by_first[i] * w[1],
        1: q.high[i] - w[0], -1: q.low[i] - w[0],
    }  # fmt: skip
    slides = {1: lambda h: t[h - 1] - n[h - 1] * t[h], -1: lambda h: n[h - 1] * t[h - 1] - t[h], 0: lambda h: w[h]}
    return np.array([drive[m[0]], *(slides[m[h]](h) for h in range(1, last + 1))])


def _by_trying(q, i, n):
    """Every set of states, each with its linear system; those that contradict nothing."""
    last, found = len(n), []
    for m in product((0, 1, -1), repeat=last + 1):
        if q.low[i] == q.high[i] and m[0] != 1:
            continue
        for taut in product((1.0, 0.0), repeat=last):
            if any(m[h] and not taut[h - 1] and (h < last and not taut[h]) for h in range(1, last + 1)):
                continue
            zero = np.zeros(last + 1)
            at = _residual(q, i, n, zero, m, taut, last)
            slope = np.array([_residual(q, i, n, row, m, taut, last) - at for row in np.eye(last + 1)]).T
            if np.linalg.cond(slope) > 1e12:
                continue
            w = np.linalg.solve(slope, -at)
            y = _tensions(q, i, w, last)
            t = np.append(np.maximum(y[:-1], 0.0), y[-1])
            fits = all((y[j] > -1e-7) if taut[j] else (y[j] < 1e-7) for j in range(last))
            fits &= all(m[h] * w[h] > -1e-9 for h in range(1, last + 1))
            for h in range(1, last + 1):
                up, down = (q.rub_up[i], q.rub_down[i]) if h == last else (0.0, 0.0)
                if m[h] == 0:
                    fits &= t[h - 1] <= n[h - 1] * (t[h] + up) + 1e-6 and t[h] - down <= n[h - 1] * t[h - 1] + 1e-6
            free = q.wanted[i] - w[0] - q.by_tension[i] * t[0] - q.by_end[i] * w[0] + q.by_first[i] * w[1]
            fits &= q.low[i] == q.high[i] or (m[0] * free > -1e-9 if m[0] else q.low[i] <= w[0] <= q.high[i])
            if fits:
                found.append((w, t))
    return found


@pytest.mark.parametrize("contacts", [2, 3])
def test_the_step_is_the_one_that_trying_every_set_finds(contacts):
    compared, columns = 0, LANES if contacts == 2 else 8
    for seed in range(2):
        q, n = _random(contacts, seed)
        given = q.rows.copy()
        SOLVE(q, n, 0.0, None, LANES, DT, True)
        assert not q.pending.any()
        for i in range(columns):
            fresh = series.series_rows(contacts).over(given)
            fresh.theta[i] = q.theta[i]
            found = _by_trying(fresh, i, n[:, i])
            compared += bool(found)
            for _, tensions in found:  # spans between slack ones may lie anywhere; tensions are what is unique
                assert np.append(q.pull[:-1, i], 0.0) == pytest.approx(np.append(tensions[:-1], 0.0), abs=1e-5)
    assert compared > 1.8 * columns


@pytest.mark.parametrize("contacts", [3, pytest.param(20, marks=pytest.mark.slow)])  # minutes to compile
def test_every_contact_is_at_its_limit_or_at_rest_within_it(contacts):
    q, n = _random(contacts, 7)
    SOLVE(q, n, 40.0, None, LANES, DT, True)
    assert not q.pending.any()
    above, behind, w = q.pull[:-1], q.pull[1:].copy(), q.rate[1:]
    behind[-1] += np.where(w[-1] > 0.0, q.rub_up, np.where(w[-1] < 0.0, -q.rub_down, 0.0))
    limit = n + 40.0 * w**2
    assert (q.pull[:-1] >= 0.0).all()
    for way, more, less in ((w > 0.0, above, behind), (w < 0.0, behind, above)):
        assert more[way] == pytest.approx((limit * less)[way], rel=1e-7, abs=1e-8)
    inner = (w == 0.0)[:-1]
    assert (above[:-1] <= n[:-1] * behind[:-1] * (1.0 + 1e-8) + 1e-8)[inner].all()
    assert (behind[:-1] <= n[:-1] * above[:-1] * (1.0 + 1e-8) + 1e-8)[inner].all()


@pytest.mark.slow
def test_a_column_is_the_same_to_the_bit_alone_and_in_a_tile():
    together, n = _random(3, 3)
    given = together.rows.copy()
    SOLVE(together, n, 40.0, None, LANES, DT, True)
    for i in range(LANES):
        alone = series.series_rows(3).zeros(LANES)
        alone.rows[:, 0] = given[:, i]
        SOLVE(alone, np.ascontiguousarray(np.roll(n, -i, axis=1)), 40.0, None, 1, DT, True)
        for row in ("rate", "pull", "state", "theta"):
            assert np.array_equal(np.atleast_2d(getattr(alone, row))[:, 0], np.atleast_2d(getattr(together, row))[:, i])


@pytest.mark.slow
def test_sweeps_alone_lead_to_the_same_step():
    q, n = _random(3, 11)
    given = q.rows.copy()
    SOLVE(q, n, 40.0, None, LANES, DT, True)
    swept = series.series_rows(3).over(given)
    SOLVE(swept, n, 40.0, None, LANES, DT, True)  # rows of load and theta
    swept.rate[:] = 0.0
    for i in range(LANES):
        SWEEP(swept, n, 40.0, None, i, 400)
    assert swept.pull[:-1] == pytest.approx(q.pull[:-1], abs=1e-6)
