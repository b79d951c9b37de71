"""The tendon that rubs in its sheath at N contacts, in continuous time.

    span     T_j = k_j stretch_j + c_j stretch_j' where it is taut, at least 0,   c_j / k_j = tau = c / k
    contact  T_{h-1} = up T_h slipping to the drive,  T_h = down T_{h-1} slipping to the load,  in between at rest

`cable_envs.plants.sheath.contacts` has the symbols. Where a contact is, s_h, is a state. The damping of the tendon
makes the rates s_h' follow from the state and the speeds of both ends: they are the slips of a step, over its length,
in which nothing moves yet, and the kernel's own sweeps find them. A contact that is at its limit but for the share
`NEAR` slips unless that would be backwards.
"""

from cable_envs.core.compiling.templates import specialised
from cable_envs.core.kernels import select
from cable_envs.effects.seams import dry_friction
from cable_envs.effects.stiffness_hardening import hardened, linear
from cable_envs.physics import sweeps
from cable_envs.plants.continuous import NEAR, Rows, along, nudged, rubbed
from cable_envs.plants.sheath.contact_stages import (
    drive_end,
    first_span,
    inner_span,
    last_span,
    limits,
    load_end,
    load_stays,
    spans_of,
)
from cable_envs.plants.sheath.plant import _resist

SHORT = 1e-12
"""Length of the step in which nothing moves yet, over the damping time of the tendon."""
PAIRS = 10
"""Pairs of sweeps of a CasADi function, which cannot look whether they have settled."""
NEWTON = 20
"""Steps of Newton's method for the tension of a tendon that stiffens."""

_PIECES = {
    "first_span": first_span, "inner_span": inner_span, "last_span": last_span, "drive_end": drive_end,
    "load_end": load_end, "load_stays": load_stays, "MARGIN": NEAR,
}  # fmt: skip
settled = specialised(sweeps.solve, **_PIECES)
_set_off, _to_load, _to_drive, _follow = (
    specialised(piece, **_PIECES) for piece in (sweeps._set_off, sweeps._to_load, sweeps._to_drive, sweeps._follow)
)


def unrolled(q, x, e, s, lanes):
    """`settled` with a number of sweeps that is known beforehand."""
    _set_off(q, x, e, s, lanes)
    _follow(q, x, e, s, lanes)
    for i in range(lanes):
        q.pending[i] = 1.0
    for _ in range(PAIRS):
        _to_load(q, x, e, s, lanes, False)
        _to_drive(q, x, e, s, lanes, True)
    _follow(q, x, e, s, lanes)


def _placed(rows: Rows, x_d, slips, y, v, way):
    """Writes places, limits of the contacts and the stiffness of the spans; the length of the step."""
    p, u, e, s, g, w, x = rows
    x.drive_position[0], x.load_position[0], x.load_velocity[0] = x_d, y, along(v, way)
    for h, slip in enumerate(slips):
        x.slip_position[h, 0] = slip
    limits(x, p, u, w, e, s, g, 0)
    tau = p.tendon_damping[0] / p.stiffness[0]
    spans_of(x, p, w, e, s, 0, SHORT * tau)
    return SHORT * tau


def _at_limits(rows: Rows):
    """Which way the contacts slip that are at their limits."""
    _, _, e, s, _, w, x = rows
    contacts = len(x.slip_position)
    first_span(x, w, e, s, 0, 0)
    for j in range(1, contacts):
        inner_span(x, w, e, s, j, 0)
    last_span(x, w, e, s, contacts, 0)
    for h in range(contacts):
        before, behind = w.taken[h, 0] / w.compliance[h, 0], w.taken[h + 1, 0] / w.compliance[h + 1, 0]
        up, down = w.up[0] * (1.0 - NEAR), w.down[0] * (1.0 - NEAR)
        taut = (before > 0.0) & (behind > 0.0)
        w.way[h, 0] = select(taut & (before > up * behind), 1.0, select(taut & (behind > down * before), -1.0, 0.0))


def carried(rows: Rows, x_d, v_d, slips, y, v, way, drive_way=0.0):
    """(tension at the drive, at the load, acceleration of the load, rates of the slips)."""
    p, u, e, s, g, w, x = rows
    dt = _placed(rows, x_d, slips, y, v, way)
    _at_limits(rows)
    moves, follows = nudged(v_d, drive_way) * dt, nudged(v, way) * dt
    w.reach[0] = w.low[0] = w.high[0] = w.drive_reach[0] = moves
    w.base[0] = w.load_reach[0] = follows
    w.load_state[0] = 1.0
    settled(w, x, e, s, 1)
    contacts = len(slips)
    ahead, behind = w.tension[0, 0], w.tension[contacts, 0]
    dry_friction(e, g, 0, along(v, way), p.load_friction[0], ahead)
    net = rubbed(behind - _resist(p, u, e, s, 0, y, v, behind), g.up[0], g.down[0], way)
    return ahead, behind, net / p.load_mass[0], tuple(w.slip[h + 1, 0] / dt for h in range(contacts))


def slid(rows: Rows, x_d, slips, y, v, way):
    """Where the contacts are once all have slid to their limits that way, with both ends in their places."""
    if way == 0.0:
        return slips
    e, w, contacts = rows.e, rows.w, len(slips)
    _placed(rows, x_d, slips, y, v, way)
    falls, hard = (w.per_up[0] if way > 0.0 else w.down[0]), e.stiffness_hardening_coefficient[0]
    stiffness = [(2.0 if j in (0, contacts) else 1.0) * w.stiffness[0] for j in range(contacts + 1)]
    shares, share = [], 1.0
    for _ in stiffness:
        shares.append(share)
        share = share * falls
    whole = x_d - y - w.lost[0]
    tension = whole / sum(part / k for part, k in zip(shares, stiffness))
    for _ in range(NEWTON):
        long, slope = 0.0, 0.0
        for part, k in zip(shares, stiffness):
            pull = linear(part * tension, hard)
            long, slope = long + pull / k, slope + part / (k * hardened(pull, hard)[1])
        tension = tension + (whole - long) / slope
    tension = select(whole > 0.0, tension, 0.0)
    ends, at = [], x_d
    for part, k in zip(shares[:-1], stiffness):
        at = at - linear(part * tension, hard) / k - w.lost[0] * w.stiffness[0] / (k * contacts)
        ends.append(select(whole > 0.0, at, at - whole * w.stiffness[0] / (k * contacts)))
    return ends
