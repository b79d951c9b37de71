"""Friction contacts in series on one elastic cable without mass, between a drive and a load: one step, all together.

    drive  - span 0 -  contact 1  - span 1 -  contact 2  ...  contact N  -  load

symbol   | meaning                                                                          | unit
-------- | -------------------------------------------------------------------------------- | ----
w_h      | mean speed over the step at which the cable slips through contact h = 1..N, + to the drive | m/s
w_0      | mean speed of the drive over the step                                            | m/s
T_j      | tension of span j = 0..N-1; T_N is what the load takes behind the last contact   | N
n_h(w)   | limit of the tension ratio of contact h >= 1, which may grow with its speed      | 1
theta    | weight of the end of the step in the load's mean speed, in [1/2, 1]              | 1

    spans    T_j = max(0, base_j + steep_j (w_j - w_{j+1})),  steep_0 w_0 replaced by draws w_0
    contact  T_{h-1} = n_h T_h  where w_h > 0,   T_h = n_h T_{h-1}  where w_h < 0,   in between where w_h = 0
    load     T_N = resist + (damper + theta dt spring) w_N + inertia (w_N - v) / (theta dt),  v' = v + (w_N - v) / theta
    drive    w_0 + by_tension T_0 + by_end w_0 - by_first w_1 = wanted,  within [low, high], or what `pace` makes of it

Every residual rises with its own speed and falls with those of its neighbours, so the solution is unique but for
contacts between two slack spans, which stay. It is found by Newton's method on the set of what slides (and which way)
and what is slack: one tridiagonal system a pass, eliminated from the load to the drive, whose row is then one equation
in its own speed, solved with its limits. What has not settled after `PASSES` is finished one contact after the other
(`sweep`), which cannot go in circles.

`cable_envs.physics.sweeps` solves the contacts of a sheath, which are another problem: limits that do not depend on the
speed, so that no Newton's method is needed, and a span behind the last contact, which here is the load itself.

No step makes energy, whatever its length: the caller takes a span's tension in the middle of the step or later
(``steep`` at least half its stiffness times dt), so that its energy grows by no more than T_j times its change of
length; friction takes (T_{h-1} - T_h) w_h >= 0 at every contact; and the load's kinetic energy grows by its net force
times the motion less (theta - 1/2) inertia (v' - v)^2. A load that would turn round within the step is stepped with
theta = 1, v' = w_N: it stops at exactly zero or turns.

A column that has settled is not touched again, whatever the others of its tile do.
"""

from functools import cache
from typing import Any

from cable_envs.core.kernels import apart, clip, inline, maximum, select
from cable_envs.core.lanes import Lanes

PASSES = 12
"""Passes after which columns that have not settled are swept; and how often this is done."""
ROUNDS = 6
EVEN = 1e-9
"""A contact is at its limit when the tensions agree with it to this share."""
GRIP = 1.0 + 1e-9
"""A contact at rest starts to slide when its ratio exceeds the limit by more than this factor."""
LEAST = 1e-10
"""Tensions below this are none, N."""
LOOSE = 1e-13
"""A drag at every contact over the steepness of its spans: a taut span between slack ones has a place of its own."""


@inline
def within(q, i, asked, alone):
    """The drive's speed within its limits."""
    return clip(asked / alone, q.low[i], q.high[i])


pace: Any = within
"""(q, i, asked, alone) -> mean speed w of the drive that goes with what it is asked for, asked + (1 - alone) w."""
law: Any = None
"""(p, q, e, s, h, i, speed, way) -> (n, its growth with the size of the speed) of contact h + 1; way: 1 to the drive,
-1 to the load. p, e and s are handed on from the caller of `solve`."""
lead: Any = None
"""(p, q, e, s, i) -> by how much T_0 at the present w_0 differs from base_0 + draws w_0, which it then corrects."""


@cache
def series_rows(contacts: int) -> Lanes:
    """Scratch of `solve` for so many contacts."""
    return Lanes("Series", series_fields(contacts))


def series_fields(contacts: int) -> list:
    """Fields of the scratch of `solve`, for plants that have fields of their own beside them."""
    return [
        ("rate", contacts + 1), ("state", contacts + 1), ("taut", contacts + 1), ("base", contacts + 1),
        ("steep", contacts + 1), ("pull", contacts + 1), ("ratio", contacts), ("growth", contacts),
        ("rest_up", contacts), ("rest_down", contacts), ("before", contacts + 1),
        ("follows", contacts + 1), ("known", contacts + 1), "stiff", "rest",
        "draws", "wanted", "by_tension", "by_end", "by_first", "low", "high",
        "speed", "inertia", "resist", "damper", "spring", "rub_up", "rub_down", "elastic",
        "theta", "pending", "again", "rough",
    ]  # fmt: skip


@inline
def _behind(q, last, i, dt):
    """Row of the load for its theta."""
    mass = q.inertia[i] / (q.theta[i] * dt)
    q.base[last, i] = q.resist[i] - mass * q.speed[i]
    q.steep[last, i] = mass + q.damper[i] + q.theta[i] * dt * q.spring[i]


@inline
def _rub(q, way, i):
    """Dry friction of the load itself, for the way it moves."""
    return select(way > 0.0, q.rub_up[i], select(way < 0.0, -q.rub_down[i], 0.0))


@inline
def _set_off(q, lanes, dt):
    """First guess of a step: what slid goes on at its speed, and what was taut stays so."""
    last = q.base.shape[0] - 1
    for i in range(lanes):
        stiff = dt * (q.steep[last - 1, i] + dt * q.spring[i] + q.damper[i])
        q.theta[i] = maximum(0.5, 1.0 - q.inertia[i] / stiff)
        q.pending[i], q.rough[i] = 1.0, 0.0
        _behind(q, last, i, dt)
        y = q.base[0, i] + q.draws[i] * q.rate[0, i] - q.steep[0, i] * q.rate[1, i]
        q.taut[0, i] = select((q.pull[0, i] > 0.0) | (q.rate[1, i] > 0.0), 1.0, 0.0)
        q.pull[0, i] = maximum(y, 0.0)
    for j in range(1, last + 1):
        h = apart(j)
        for i in range(lanes):
            w = q.rate[h, i]
            q.state[h, i] = select(w > 0.0, 1.0, select(w < 0.0, -1.0, 0.0))
            if h == last:
                q.state[h, i] = select(q.elastic[i] > 0.5, 1.0, q.state[h, i])
            if h < last:
                y = q.base[h, i] + q.steep[h, i] * (w - q.rate[h + 1, i])
                taut = (q.pull[h, i] > 0.0) | (w < 0.0) | (q.rate[h + 1, i] > 0.0)
                q.taut[h, i] = select(taut, 1.0, 0.0)
                q.pull[h, i] = maximum(y, 0.0)
            else:
                q.taut[h, i] = 1.0
                q.pull[h, i] = maximum(q.base[h, i] + q.steep[h, i] * w, 0.0)


@inline
def _eliminate(q, lanes):
    """The linear system of the present set, from the load to the drive: what each contact does as the one before it.

    A contact slips at known + follows times the speed before it.
    """
    last = q.base.shape[0] - 1
    for i in range(lanes):
        q.rest[i], q.stiff[i] = q.base[last, i] + _rub(q, q.state[last, i], i), q.steep[last, i]
    for k in range(last):
        h = apart(last - k)
        for i in range(lanes):
            m, n = q.state[h, i], q.ratio[h - 1, i]
            f, g = select(m > 0.0, 1.0, n), select(m > 0.0, n, 1.0)
            before, after = q.taut[h - 1, i], q.taut[h, i]
            rub = select(h == last, _rub(q, m, i), 0.0)
            grown = q.growth[h - 1, i] * select(m > 0.0, q.pull[h, i] + rub, q.pull[h - 1, i])
            steep = q.steep[h - 1, i]
            drag = select(h == last, 0.0, LOOSE * (steep + q.steep[h, i]))
            loose = (m != 0.0) & (before + after == 0.0)
            idle = (m == 0.0) | loose
            pivot = f * before * steep + g * after * q.stiff[i] + grown + drag
            over = select(idle, 0.0, 1.0 / select(idle, 1.0, pivot))
            known = (f * before * q.base[h - 1, i] - g * after * q.rest[i] + grown * q.rate[h, i]) * over
            known = select(loose, q.rate[h, i], known)
            follows = f * before * over * select(h == 1, q.draws[i], steep)
            q.known[h, i], q.follows[h, i] = known, follows
            q.rest[i], q.stiff[i] = q.base[h - 1, i] - steep * known, steep * (1.0 - follows)


@inline
def _substitute(q, lanes):
    """Speeds of the columns that have not settled, from the drive to the load.

    Where the tangent of a law would turn a contact round, the pass is repeated from the same speeds with the chord
    between rest and there, which meets the law where the contact stops (``rough``).
    """
    last = q.base.shape[0] - 1
    for i in range(lanes):
        q.again[i] = 0.0
        taut, old = q.taut[0, i] * q.by_tension[i], q.rate[0, i]
        over = q.by_first[i] + taut * q.steep[0, i]
        per = 1.0 / (1.0 + q.by_end[i] + taut * q.draws[i])
        asked, alone = (q.wanted[i] - taut * q.base[0, i] + over * q.known[1, i]) * per, over * q.follows[1, i] * per
        q.before[0, i], q.rate[0, i] = old, select(q.pending[i] > 0.5, pace(q, i, asked, 1.0 - alone), old)
    for j in range(1, last + 1):
        h = apart(j)
        for i in range(lanes):
            old, m = q.rate[h, i], q.state[h, i]
            w = select(q.pending[i] > 0.5, q.known[h, i] + q.follows[h, i] * q.rate[h - 1, i], old)
            q.before[h, i], q.rate[h, i] = old, w
            q.again[i] = select((m * w < 0.0) & (m * old > 0.0), 1.0, q.again[i])
    return _turned(q, lanes)


@inline
def _turned(q, lanes):
    """Whether columns must repeat the pass, with the speeds that they had before it."""
    last = q.base.shape[0] - 1
    turned = 0
    for i in range(lanes):
        repeat = (q.again[i] > 0.5) & (q.rough[i] < 0.5) & (q.pending[i] > 0.5) & (q.elastic[i] < 0.5)
        q.rough[i] = select(repeat, 1.0, 0.0)
        turned += repeat
    if turned:
        for j in range(last + 1):
            h = apart(j)
            for i in range(lanes):
                q.rate[h, i] = select(q.rough[i] > 0.5, q.before[h, i], q.rate[h, i])
    return turned


@inline
def _stretch(q, lanes):
    """Tensions at the present speeds, and which spans are slack."""
    last = q.base.shape[0] - 1
    for i in range(lanes):
        q.again[i] = q.rough[i]
        q.pull[last, i] = q.base[last, i] + q.steep[last, i] * q.rate[last, i]
    for j in range(last):
        h = apart(j)
        for i in range(lanes):
            w = q.rate[h, i]
            own = select(h == 0, q.draws[i] * q.rate[0, i], q.steep[h, i] * w)
            y, taut = q.base[h, i] + own - q.steep[h, i] * q.rate[h + 1, i], q.taut[h, i]
            now = select(y > select(taut > 0.0, -LEAST, LEAST), 1.0, 0.0)
            now = select(q.rough[i] > 0.5, taut, now)
            q.taut[h, i] = now
            q.pull[h, i] = now * maximum(y, 0.0)
            q.again[i] = select(now != taut, 1.0, q.again[i])


@inline
def _laws(q, p, e, s, lanes):
    """Limits of the ratios at the present speeds."""
    for j in range(q.ratio.shape[0]):
        h = apart(j)
        for i in range(lanes):
            way = select(q.state[h + 1, i] < 0.0, -1.0, 1.0)
            q.ratio[h, i], q.growth[h, i] = law(p, q, e, s, h, i, q.rate[h + 1, i], way)


@inline
def _chords(q, lanes):
    """In columns whose pass is repeated, the growth of the ratios from rest to the present speeds."""
    for j in range(q.ratio.shape[0]):
        h = apart(j)
        for i in range(lanes):
            size, m = abs(q.rate[h + 1, i]), q.state[h + 1, i]
            rest = select(m > 0.0, q.rest_up[h, i], q.rest_down[h, i])
            chord = (q.ratio[h, i] - rest) / select(size > 0.0, size, 1.0)
            q.growth[h, i] = select((q.rough[i] > 0.5) & (size > 0.0), chord, q.growth[h, i])


@inline
def _check(q, p, e, s, lanes, dt):
    """The next set of each column, and whether it must be solved again."""
    last = q.base.shape[0] - 1
    for i in range(lanes):
        off = abs(lead(p, q, e, s, i)) > EVEN * q.pull[0, i] + LEAST
        q.again[i] = select(off, 1.0, q.again[i])
    for j in range(1, last + 1):
        h = apart(j)
        for i in range(lanes):
            w, m, n = q.rate[h, i], q.state[h, i], q.ratio[h - 1, i]
            a, b = q.pull[h - 1, i], q.pull[h, i]
            up = b + select(h == last, q.rub_up[i], 0.0)
            down = b - select(h == last, q.rub_down[i], 0.0)
            goes = a > GRIP * q.rest_up[h - 1, i] * up + LEAST
            starts = select(goes, 1.0, select(down > GRIP * q.rest_down[h - 1, i] * a + LEAST, -1.0, 0.0))
            now = select(m == 0.0, starts, select(m * w >= 0.0, m, 0.0))
            f, g = select(m > 0.0, a, n * a), select(m > 0.0, n * up, down)
            off = (m != 0.0) & (abs(f - g) > EVEN * (f + g) + LEAST)
            now = select((h == last) & (q.elastic[i] > 0.5), 1.0, select(q.rough[i] > 0.5, m, now))
            q.state[h, i] = now
            q.again[i] = select((now != m) | off, 1.0, q.again[i])
    left = 0
    for i in range(lanes):
        v, w = q.speed[i], q.rate[last, i]
        arrives = v + (w - v) / q.theta[i]
        turns = (q.elastic[i] < 0.5) & ((w * arrives < 0.0) | ((w == 0.0) & (v != 0.0)))
        late = (q.again[i] == 0.0) & turns & (q.theta[i] < 1.0)
        q.theta[i] = select(late, 1.0, q.theta[i])
        _behind(q, last, i, dt)
        q.again[i] = select(late, 1.0, q.again[i])
        q.pending[i] = q.pending[i] * q.again[i]
        left += q.pending[i] > 0.5
    return left


@inline
def _rests(q, p, e, s, lanes):
    """Limits of the ratios at rest."""
    for j in range(q.ratio.shape[0]):
        h = apart(j)
        for i in range(lanes):
            q.rest_up[h, i], _ = law(p, q, e, s, h, i, 0.0, 1.0)
            q.rest_down[h, i], _ = law(p, q, e, s, h, i, 0.0, -1.0)


@inline
def _before_and_behind(q, h, i, w):
    """Tensions before and behind contact h if it slides at the speed w and its neighbours as they do."""
    last = q.base.shape[0] - 1
    beyond = q.rate[h + 1, i] if h < last else 0.0
    lead_in = q.draws[i] * q.rate[0, i] if h == 1 else q.steep[h - 1, i] * q.rate[h - 1, i]
    before = q.base[h - 1, i] + lead_in - q.steep[h - 1, i] * w
    behind = q.base[h, i] + q.steep[h, i] * (w - beyond)
    return max(before, 0.0), max(behind, 0.0) if h < last else behind


@inline
def _excess(q, p, e, s, h, i, way, z):
    """By how much the tensions drive contact h on at the speed z in a way: it falls with z."""
    a, b = _before_and_behind(q, h, i, way * z)
    if h == q.base.shape[0] - 1:
        b += q.rub_up[i] if way > 0.0 else -q.rub_down[i]
    n, _ = law(p, q, e, s, h - 1, i, way * z, way)
    if q.elastic[i] > 0.5 and h == q.base.shape[0] - 1:
        return way * (a - n * b)
    return a - n * b if way > 0.0 else b - n * a


@inline
def _alone(q, p, e, s, h, i):
    """Speed of contact h that goes with its neighbours': the false position, halving the value that stays."""
    way, z, slow, high, fast, low = 1.0, 0.0, 0.0, 0.0, -1.0, 0.0
    for _ in range(200):
        now = _excess(q, p, e, s, h, i, way, z)
        if z == 0.0:  # at rest: does it go this way, the other way, or not?
            if now > 0.0:
                high, z = now, 1e-6
            elif way > 0.0:
                way = -1.0
            else:
                return 0.0
            continue
        if now > 0.0:
            slow, high, low = z, now, 0.5 * low
        else:
            fast, low, high = z, now, 0.5 * high if fast > 0.0 else high
        if now == 0.0 or (fast > 0.0 and fast - slow <= 1e-15 * fast):
            break
        z = 8.0 * z if fast < 0.0 else slow + (fast - slow) * high / (high - low)
    return way * z


@inline
def sweep(q, p, e, s, i, turns):
    """One contact after the other in one column, there and back, so often; what that gives is where passes go on."""
    last = q.base.shape[0] - 1
    for turn in range(2 * turns):
        for k in range(last + 1):
            h = k if turn % 2 == 0 else last - k
            if h > 0:
                q.rate[h, i] = _alone(q, p, e, s, h, i)
            else:
                first = q.rate[1, i]
                rest, slope = q.wanted[i] + q.by_first[i] * first, 1.0 + q.by_end[i]
                w, base = rest / slope, q.base[0, i] - q.steep[0, i] * first
                if base + q.draws[i] * w > 0.0:
                    w = (rest - q.by_tension[i] * base) / (slope + q.by_tension[i] * q.draws[i])
                q.rate[0, i] = pace(q, i, w, 1.0)
                lead(p, q, e, s, i)
    for h in range(1, last + 1):
        w = q.rate[h, i]
        q.pull[h - 1, i], q.pull[h, i] = _before_and_behind(q, h, i, w)
        q.taut[h - 1, i] = 1.0 if q.pull[h - 1, i] > 0.0 or w > 0.0 or (h > 1 and q.rate[h - 1, i] < 0.0) else 0.0
        q.state[h, i] = 1.0 if w > 0.0 or (h == last and q.elastic[i] > 0.5) else -1.0 if w < 0.0 else 0.0
    q.rough[i] = 0.0


@inline
def solve(q, p, e, s, lanes, dt, anew):
    """Solve a step of a tile of columns: rates, tensions and states of `series_fields`.

    The caller has set base, steep and draws of the spans, the row of the drive, and what is known of the load; rate and
    pull as they were after the step before. ``anew``: the laws at those rates must be evaluated too; else those of the
    step before hold on. p, e and s are handed on to the laws.
    """
    _set_off(q, lanes, dt)
    if anew:
        _rests(q, p, e, s, lanes)
    left, passes, turned, solves = 1, 0, 0, not anew
    while left and passes < ROUNDS * PASSES:
        if solves:
            passes += 1
            _eliminate(q, lanes)
            turned = _substitute(q, lanes)
            _stretch(q, lanes)
        _laws(q, p, e, s, lanes)
        if turned:
            _chords(q, lanes)
        if solves:
            left = _check(q, p, e, s, lanes, dt)
        stuck = (
            solves and left > 0 and passes % PASSES == 0
        )  # the laws at what a sweep found lead to a pass, not a sweep
        solves = True
        if stuck:
            solves, turned = False, 0
            for i in range(lanes):
                if q.pending[i] > 0.5:
                    sweep(q, p, e, s, i, passes)
