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

Seen from a contact, all that is towards an end is one spring, T C = Q -+ d: behind a contact that slips, T and Q go on
and C is divided by the ratio of tensions; behind one at rest the spring is the span alone. Two sums for each contact are
a sweep. A contact slips to the drive where the tension of the spring before it exceeds ``up`` times that of the spring
behind it, both taken as if it did not: that is known from a sweep from either side. So sweeps there and back decide
contact by contact, each with what is decided on both sides of it, until one of them changes nothing: then spans,
contacts and ends all agree, and the step is solved to rounding. The front of a reversal gets as far in one sweep as it
does in the step. Should sweeps go on for `PATIENCE`, a sweep changes one contact only, the first that differs, which
ends (least-index pivoting).

A slack span carries nothing, and then no other does. A column that has settled is not changed by further sweeps,
whatever the others of its tile do.
"""

from typing import Any

from cable_envs.core.kernels import inline, maximum, select

PATIENCE = 12
"""Pairs of sweeps after which each changes one contact at a time."""
MOST = 400
"""Pairs of sweeps after which a step is left as it is."""
MARGIN = 1e-11
"""Share of a limit by which a ratio must exceed it before a contact at rest slips, or fall below before one rests."""

drive_end: Any = None
"""(p, q, e, s, i, c, r) -> number of the drive's state, 0 or any other, having set its reach and give: T_0 c = r + d_0."""
load_end: Any = None
"""The same of the load: T_N c = r - d_{N+1}."""


def sweep_fields(contacts: int) -> list:
    """Fields of the scratch of `solve`, for plants that have fields of their own beside them."""
    return [
        ("compliance", contacts + 1), ("taken", contacts + 1), ("tension", contacts + 1),  # c_j, r_j, T_j
        ("slip", contacts + 2),  # d
        ("way", contacts),  # -1, 0, 1: how a contact slips
        ("before_c", contacts + 1), ("before_q", contacts + 1),  # C, Q of what is before contact h + 1; last: before the load
        ("behind_c", contacts + 1), ("behind_q", contacts + 1),  # of what is behind contact h; first: behind the drive
        "up", "down", "per_up", "per_down",  # limits, and one over them
        "drive_reach", "drive_give", "load_reach", "load_give", "drive_state", "load_state",
        "changed", "calm",  # whether a sweep changed something; 1: it may change more
    ]  # fmt: skip


@inline
def _decided(q, h, i):
    """How contact h + 1 slips, given the springs on both sides of it."""
    was = q.way[h, i]
    a = maximum(q.before_q[h, i], 0.0) * q.behind_c[h + 1, i]
    b = maximum(q.behind_q[h + 1, i], 0.0) * q.before_c[h, i]
    more_up, more_down = select(was > 0.0, 1.0 - MARGIN, 1.0 + MARGIN), select(was < 0.0, 1.0 - MARGIN, 1.0 + MARGIN)
    now = select(a > b * (q.up[i] * more_up), 1.0, select(b > a * (q.down[i] * more_down), -1.0, 0.0))
    now = select(q.calm[i] > 0.0, now, was)
    return was, now


@inline
def _note(q, i, differs, careful):
    """A change in a column; where one must do, no further ones."""
    q.changed[i] = select(differs, 1.0, q.changed[i])
    q.calm[i] = select(differs & careful, 0.0, q.calm[i])


@inline
def _to_load(q, p, e, s, lanes, careful):
    """From the drive to the load."""
    contacts = q.way.shape[0]
    for i in range(lanes):
        q.changed[i], q.calm[i] = 0.0, 1.0
        q.before_c[0, i] = q.compliance[0, i] + q.drive_give[i]
        q.before_q[0, i] = q.taken[0, i] + q.drive_reach[i]
    for h in range(contacts):
        for i in range(lanes):
            was, now = _decided(q, h, i)
            q.way[h, i] = now
            _note(q, i, now != was, careful)
            c, r = q.before_c[h, i] * select(now > 0.0, q.up[i], q.per_down[i]), q.before_q[h, i]
            rests = now == 0.0
            q.before_c[h + 1, i] = select(rests, 0.0, c) + q.compliance[h + 1, i]
            q.before_q[h + 1, i] = select(rests, 0.0, r) + q.taken[h + 1, i]
    left = 0
    for i in range(lanes):
        was = q.load_state[i]
        q.load_state[i] = load_end(p, q, e, s, i, q.before_c[contacts, i], q.before_q[contacts, i])
        _note(q, i, q.load_state[i] != was, careful)
        left += q.changed[i] > 0.0
    return left


@inline
def _to_drive(q, p, e, s, lanes, decides):
    """From the load to the drive; ``decides``: what the contacts do, or with what they do."""
    contacts = q.way.shape[0]
    for i in range(lanes):
        q.changed[i], q.calm[i] = 0.0, select(decides, 1.0, 0.0)
        q.behind_c[contacts, i] = q.compliance[contacts, i] + q.load_give[i]
        q.behind_q[contacts, i] = q.taken[contacts, i] - q.load_reach[i]
    for k in range(contacts):
        h = contacts - 1 - k
        for i in range(lanes):
            was, now = _decided(q, h, i)
            q.way[h, i] = now
            _note(q, i, now != was, False)
            c, r = q.behind_c[h + 1, i] * select(now > 0.0, q.per_up[i], q.down[i]), q.behind_q[h + 1, i]
            rests = now == 0.0
            q.behind_c[h, i] = select(rests, 0.0, c) + q.compliance[h, i]
            q.behind_q[h, i] = select(rests, 0.0, r) + q.taken[h, i]
    left = 0
    for i in range(lanes):
        was = q.drive_state[i]
        q.drive_state[i] = drive_end(p, q, e, s, i, q.behind_c[0, i], q.behind_q[0, i])
        _note(q, i, q.drive_state[i] != was, False)
        left += q.changed[i] > 0.0
    return left


@inline
def _follow(q, lanes):
    """Tensions and slips of what has been decided."""
    contacts = q.way.shape[0]
    for i in range(lanes):
        c = q.before_c[contacts, i] + q.load_give[i]
        q.tension[contacts, i] = maximum(q.before_q[contacts, i] - q.load_reach[i], 0.0) / c
        q.slip[contacts + 1, i] = q.load_reach[i] + q.load_give[i] * q.tension[contacts, i]
    for k in range(contacts):
        h = contacts - 1 - k
        for i in range(lanes):
            way, behind = q.way[h, i], q.tension[h + 1, i]
            held = maximum(q.before_q[h, i], 0.0) / q.before_c[h, i]
            q.tension[h, i] = select(way > 0.0, behind * q.up[i], select(way < 0.0, behind * q.per_down[i], held))
    for i in range(lanes):
        q.slip[0, i] = q.drive_reach[i] - q.drive_give[i] * q.tension[0, i]
    for h in range(contacts):
        for i in range(lanes):
            d = q.slip[h, i] + q.taken[h, i] - q.compliance[h, i] * q.tension[h, i]
            q.slip[h + 1, i] = select(q.way[h, i] == 0.0, 0.0, d)
    for k in range(contacts):  # what slips to the load is what went out there: so a slack stays towards the drive
        h = contacts - 1 - k
        for i in range(lanes):
            d = q.slip[h + 2, i] - q.taken[h + 1, i] + q.compliance[h + 1, i] * q.tension[h + 1, i]
            q.slip[h + 1, i] = select(q.way[h, i] < 0.0, d, q.slip[h + 1, i])


@inline
def solve(q, p, e, s, lanes):
    """Solve a step of a tile of columns: ways, tensions and slips of `sweep_fields`.

    The caller has set compliance and taken of the spans, the limits, ways as they were in the step before, and reach,
    give and state of the ends. p, e and s are handed on to the ends. Returns how many pairs of sweeps it took.
    """
    _to_drive(q, p, e, s, lanes, False)
    left, turns = 1, 0
    while left and turns < MOST:
        careful = turns >= PATIENCE
        turns += 1
        left = _to_load(q, p, e, s, lanes, careful)
        if left:
            left = _to_drive(q, p, e, s, lanes, not careful)
            left = left or careful
    _follow(q, lanes)
    return turns
