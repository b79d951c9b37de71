"""A tendon without mass in contact with a sheath at N places, by the capstan law: one step, exactly, by sweeps.

    drive  - span 0 -  contact 1  - span 1 -  contact 2  ...  contact N  -  span N -  load

symbol     | meaning                                                                          | unit
---------- | -------------------------------------------------------------------------------- | ----
d_h        | how far the tendon slips through contact h = 1..N in the step, + to the drive     | m
d_0, d_N+1 | how far the drive moves its end, and the load follows                             | m
T_j, c_j   | tension and compliance of span j = 0..N                                           | N, m/N
r_j        | T_j c_j if neither end of the span moved                                          | m
up, down   | limits of T_{h-1} / T_h where the tendon slips to the drive, of its inverse        | 1

    spans    T_j c_j = max(0, r_j + d_j - d_{j+1})
    contact  T_{h-1} = up T_h  where d_h > 0,   T_h = down T_{h-1}  where d_h < 0,   in between where d_h = 0
    drive    d_0 = reach_0 - give_0 T_0             load   d_{N+1} = reach_N + give_N T_N

Both ends are straight lines for a step: a drive at a place has give 0, an inertia the compliance that goes with it.

Seen from a contact, all that is towards an end is one spring, T C = Q -+ d: behind a contact that slips, Q goes on, and
C over the ratio of tensions; behind one at rest the spring is the span alone. Two sums for each contact are a sweep. A
contact slips to the drive where the tension of the spring before it exceeds ``up`` times that of the spring
behind it, both taken as if it did not: that is known from a sweep from either side. So sweeps there and back decide
contact by contact, each with what is decided on both sides of it, until one of them changes nothing: then spans,
contacts and ends all agree, and the step is solved to rounding. The front of a reversal gets as far in one sweep as it
does in the step. Most steps need none of that: a sweep from the load with what slipped in the step before, and tensions
and slips from the drive on, which contradict nothing. Should sweeps go on for `PATIENCE`, a sweep changes one contact
only, the first that differs, which ends (least-index pivoting).

`cable_envs.physics.series` solves contacts whose limits grow with the speed (extrusion), each with its own, with a load
at the last one and a drive in a loop of its tension. It takes Newton's method with a law for each contact in each pass.
Here all limits of a column are the same two numbers for a step, so that sweeps are exact without iterating on a law,
twenty contacts cost little more than their spans, and a fixed number of sweeps is a function without a loop that ends
early (CasADi). A span of its own is behind the last contact, and both ends have states: neither solver has the rows of
the other.

A slack span carries nothing, and then no other does. A column that has settled is not changed by further sweeps,
whatever the others of its tile do.
"""

from typing import Any

from cable_envs.core.kernels import apart, inline, maximum, select

PATIENCE = 12
"""Pairs of sweeps after which each changes one contact at a time."""
MOST = 400
"""Pairs of sweeps after which a step is left as it is."""
MARGIN = 1e-11
"""Share of a limit by which a ratio must exceed it before a contact at rest slips, or fall below before one rests."""

first_span: Any = None
"""(x, q, e, s, j, i): sets compliance and taken of span j = 0; x, e and s are handed on from the caller of `solve`."""
inner_span: Any = None
"""The same for the spans between two contacts."""
last_span: Any = None
"""The same for span N."""
drive_end: Any = None
"""(x, q, e, s, i, c, r) -> number of the drive's state, having set its reach and give; T_0 c = r + d_0."""
load_end: Any = None
"""The same of the load; T_N c = r - d_{N+1}."""
load_stays: Any = None
"""(x, q, e, s, i) -> whether the load's state is that to which its tension and motion lead."""


def sweep_fields(contacts: int) -> list:
    """Fields of the scratch of `solve`, for plants that have fields of their own beside them."""
    return [
        ("compliance", contacts + 1), ("taken", contacts + 1), ("tension", contacts + 1),  # c_j, r_j, T_j
        ("slip", contacts + 2),  # d
        ("way", contacts),  # -1, 0, 1: how a contact slips
        ("before_c", contacts), ("before_q", contacts),  # C and Q before contact h + 1
        ("behind_c", contacts + 1), ("behind_q", contacts + 1),  # C and Q behind contact h; first: behind the drive
        "up", "down", "per_up", "per_down",  # limits, and one over them
        "drive_reach", "drive_give", "load_reach", "load_give", "drive_state", "load_state",
        "start_up", "start_down",  # ratios from which a contact at rest slips
        "so_far_c", "so_far_q",  # C and Q, or tension and slip, where a sweep has got to
        "pending", "changed", "calm",  # 1: not settled; a sweep changed something; it may change more
    ]  # fmt: skip


@inline
def _decided(q, was, i, before_c, before_q, behind_c, behind_q):
    """How a contact slips that did as it ``was``, given the springs on both sides of it."""
    a, b = maximum(before_q, 0.0) * behind_c, maximum(behind_q, 0.0) * before_c
    more_up, more_down = select(was > 0.0, 1.0 - MARGIN, 1.0 + MARGIN), select(was < 0.0, 1.0 - MARGIN, 1.0 + MARGIN)
    now = select(a > b * (q.up[i] * more_up), 1.0, select(b > a * (q.down[i] * more_down), -1.0, 0.0))
    return select(q.calm[i] > 0.0, now, was)


@inline
def _note(q, i, differs, careful):
    """A change in a column; where one must do, no further ones."""
    q.changed[i] = select(differs, 1.0, q.changed[i])
    q.calm[i] = select(differs & careful, 0.0, q.calm[i])


@inline
def _to_load(q, x, e, s, lanes, careful):
    """From the drive to the load."""
    contacts = q.way.shape[0]
    for i in range(lanes):
        q.changed[i], q.calm[i] = 0.0, q.pending[i]
        q.so_far_c[i] = q.compliance[0, i] + q.drive_give[i]
        q.so_far_q[i] = q.taken[0, i] + q.drive_reach[i]
    for k in range(contacts):
        h = apart(k)
        for i in range(lanes):
            was, c, r = q.way[h, i], q.so_far_c[i], q.so_far_q[i]
            now = _decided(q, was, i, c, r, q.behind_c[h + 1, i], q.behind_q[h + 1, i])
            q.way[h, i], q.before_c[h, i], q.before_q[h, i] = now, c, r
            _note(q, i, now != was, careful)
            rests, on = now == 0.0, c * select(now > 0.0, q.up[i], q.per_down[i])
            q.so_far_c[i] = select(rests, 0.0, on) + q.compliance[h + 1, i]
            q.so_far_q[i] = select(rests, 0.0, r) + q.taken[h + 1, i]
    left = 0
    for i in range(lanes):
        was, reach, give, open_ = q.load_state[i], q.load_reach[i], q.load_give[i], q.pending[i] > 0.0
        now = select(open_, load_end(x, q, e, s, i, q.so_far_c[i], q.so_far_q[i]), was)
        q.load_state[i] = now
        q.load_reach[i] = select(open_, q.load_reach[i], reach)
        q.load_give[i] = select(open_, q.load_give[i], give)
        _note(q, i, now != was, careful)
        left += q.changed[i] > 0.0
    return left


@inline
def _on_behind(q, h, i, now):
    """What is behind contact h, from what is behind contact h + 1 and how that slips."""
    rests, c = now == 0.0, q.so_far_c[i] * select(now > 0.0, q.per_up[i], q.down[i])
    q.so_far_c[i] = select(rests, 0.0, c) + q.compliance[h, i]
    q.so_far_q[i] = select(rests, 0.0, q.so_far_q[i]) + q.taken[h, i]


@inline
def _last_behind(q, i):
    """What is behind the last contact."""
    contacts = q.way.shape[0]
    q.so_far_c[i] = q.compliance[contacts, i] + q.load_give[i]
    q.so_far_q[i] = q.taken[contacts, i] - q.load_reach[i]


@inline
def _at_drive(q, x, e, s, i):
    """The end of a sweep to the drive."""
    was = q.drive_state[i]
    q.behind_c[0, i], q.behind_q[0, i] = q.so_far_c[i], q.so_far_q[i]
    q.drive_state[i] = drive_end(x, q, e, s, i, q.so_far_c[i], q.so_far_q[i])
    _note(q, i, q.drive_state[i] != was, False)


@inline
def _set_off(q, x, e, s, lanes):
    """From the load to the drive, with the spans as they are and the contacts slipping as in the step before."""
    contacts = q.way.shape[0]
    for i in range(lanes):
        q.start_up[i], q.start_down[i] = q.up[i] * (1.0 + MARGIN), q.down[i] * (1.0 + MARGIN)
        last_span(x, q, e, s, contacts, i)
        _last_behind(q, i)
    for k in range(contacts - 1):
        h = apart(contacts - 1 - k)
        for i in range(lanes):
            inner_span(x, q, e, s, h, i)
            q.behind_c[h + 1, i], q.behind_q[h + 1, i] = q.so_far_c[i], q.so_far_q[i]
            _on_behind(q, h, i, q.way[h, i])
    for i in range(lanes):
        first_span(x, q, e, s, 0, i)
        q.behind_c[1, i], q.behind_q[1, i] = q.so_far_c[i], q.so_far_q[i]
        _on_behind(q, 0, i, q.way[0, i])
        _at_drive(q, x, e, s, i)


@inline
def _to_drive(q, x, e, s, lanes, decides):
    """From the load to the drive; ``decides``: what the contacts do, or with what they do."""
    contacts = q.way.shape[0]
    for i in range(lanes):
        q.changed[i], q.calm[i] = 0.0, select(decides, q.pending[i], 0.0)
        _last_behind(q, i)
    for k in range(contacts):
        h = apart(contacts - 1 - k)
        for i in range(lanes):
            was, c, r = q.way[h, i], q.so_far_c[i], q.so_far_q[i]
            now = _decided(q, was, i, q.before_c[h, i], q.before_q[h, i], c, r)
            q.way[h, i], q.behind_c[h + 1, i], q.behind_q[h + 1, i] = now, c, r
            _note(q, i, now != was, False)
            _on_behind(q, h, i, now)
    left = 0
    for i in range(lanes):
        _at_drive(q, x, e, s, i)
        left += q.changed[i] > 0.0
    return left


@inline
def _follow(q, x, e, s, lanes):
    """Tensions and slips, from the drive on, of how contacts and ends are; whether these are what they lead to.

    Only what is ``pending`` afterwards is not.
    """
    contacts, left, slack = q.way.shape[0], 0, 0
    for i in range(lanes):
        q.tension[0, i] = maximum(q.behind_q[0, i] + q.drive_reach[i], 0.0) / (q.behind_c[0, i] + q.drive_give[i])
        q.slip[0, i] = q.drive_reach[i] - q.drive_give[i] * q.tension[0, i]
        q.pending[i], q.so_far_c[i], q.so_far_q[i] = 0.0, q.tension[0, i], q.slip[0, i]
        slack += q.tension[0, i] <= 0.0
    for k in range(contacts):
        h = apart(k)
        for i in range(lanes):
            way, before = q.way[h, i], q.so_far_c[i]
            rests, held = way == 0.0, maximum(q.behind_q[h + 1, i], 0.0) / q.behind_c[h + 1, i]
            stretch = q.compliance[h, i] * before
            d = select(rests, 0.0, q.so_far_q[i] + q.taken[h, i] - stretch)
            after = select(rests, held, before * select(way > 0.0, q.per_up[i], q.down[i]))
            q.tension[h + 1, i], q.slip[h + 1, i], q.so_far_c[i], q.so_far_q[i] = after, d, after, d
            over = (before > q.start_up[i] * held) | (held > q.start_down[i] * before)
            wrong = select(rests, select(over, 1.0, 0.0), select(way * d < -MARGIN * stretch, 1.0, 0.0))
            q.pending[i] = maximum(q.pending[i], wrong)
    for i in range(lanes):
        q.slip[contacts + 1, i] = q.load_reach[i] + q.load_give[i] * q.tension[contacts, i]
        q.pending[i] = select(load_stays(x, q, e, s, i), q.pending[i], 1.0)
        left += q.pending[i] > 0.0
    if slack:  # what slips to the load is then what went out there: so a slack stays towards the drive
        for k in range(contacts):
            h = apart(contacts - 1 - k)
            for i in range(lanes):
                d = q.slip[h + 2, i] - q.taken[h + 1, i] + q.compliance[h + 1, i] * q.tension[h + 1, i]
                loose = (q.tension[0, i] <= 0.0) & (q.way[h, i] < 0.0)
                q.slip[h + 1, i] = select(loose, d, q.slip[h + 1, i])
    return left


@inline
def solve(q, x, e, s, lanes):
    """Solve a step of a tile of columns: ways, tensions and slips of `sweep_fields`.

    The caller has set the limits, ways as they were in the step before, and reach, give and state of the ends. x, e and
    s are handed on to spans and ends. Returns how many pairs of sweeps it took beside the first two.
    """
    _set_off(q, x, e, s, lanes)
    left, turns = _follow(q, x, e, s, lanes), 0
    if left:
        while left and turns < MOST:
            careful = turns >= PATIENCE
            turns += 1
            left = _to_load(q, x, e, s, lanes, careful)
            if left:
                left = _to_drive(q, x, e, s, lanes, not careful)
                left = left or careful
        _follow(q, x, e, s, lanes)
    return turns
