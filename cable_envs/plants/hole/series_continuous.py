"""Holes in series in continuous time.

    span     T_0 = k (x - s_1) + c (x' - s_1'),   T_j = k_s (s_j - s_{j+1}),   s_N = y;   at least 0
    hole     ln T_{h-1} - ln T_h = ln n_h + DRAG w slipping up by w, its mirror image slipping down, in between at rest

`cable_envs.plants.hole.series` has the symbols. The cable has no mass, so the tensions of a hole's two spans say how
fast it slips there: n_h(mu_h + K w^omega) grows with the speed w, and w is the one at which the ratio is that of the
tensions. So the slips s_h of the inner holes are states.

Extrusion alone does not make that a law: without it any speed goes with the limit, and with omega > 1 the speed grows
with an infinite slope over the tensions where a slip starts or stops. So a slip takes a share of the tension besides,
`DRAG` times its speed. With it the speed is a function of the tensions for every rig, of finite slope, and the
equations have a linear system on the verge of sliding. They stay stiff near rest.
"""

from itertools import pairwise

from cable_envs.core.kernels import log, maximum, minimum, power, select, sqrt
from cable_envs.physics.contact import tension_ratio_and_slope, wrap_in_contact
from cable_envs.plants.continuous import Rows

DRAG = 2e-5
"""Share of the tension that a slip through an inner hole takes besides, for 1 m/s: 2e-8 at 1 mm/s."""
BEYOND = 1e-11
"""Share by which a contact on the verge of slipping is beyond its limit: it slips by less than BEYOND / DRAG."""
FASTEST = 100.0
"""Speed of a slip beyond which none is looked for, m/s."""
NONE = 1e-9
"""Tension that stands for none in a ratio, N."""
PASSES = 14
"""Steps of Newton's method, within what is known to hold the speed."""
ROUNDING = 1e-9
"""Share by which a step of Newton's method may miss what holds the speed."""
SLOW = 1e-10
"""Speed by which it may, m/s: what the rounding of the tensions is."""
TURN = 1e-6
"""Step of the difference that gives the growth of a ratio with its wrap, rad."""
LEAST = 1e-3
"""Tension below which that of a wrap in contact is taken, N, as in `cable_envs.physics.contact`."""
WRAPS = 8
"""Passes after which the wraps in contact, which hang on the tensions, have settled on the verge of sliding."""


def _limit(p, h, speed, above, behind):
    """Limit of the ratio of hole h at the size of a speed.  G1, G9, G17

    Returns
    -------
    n, by_mu, growth : float
        The limit, its growth with mu, and that of mu with the speed.
    by_above, by_behind : float
        Its growth with the tensions, which press more of the wrap into contact.
    """
    rho, wrap, rigidity = p.radius_ratio[h, 0], p.wrap_angle[h, 0], p.bending_rigidity[0]
    if rigidity > 0.0:
        wrap = wrap_in_contact(wrap, rigidity, p.edge_radius[h, 0], above, behind)
    steep = p.extrusion_gain[0] * power(maximum(speed, 1e-12), p.extrusion_exponent[0] - 1.0)
    mu = p.friction_coefficient[h, 0] + steep * speed
    n, by_mu = tension_ratio_and_slope(rho, mu, wrap)
    by_above, by_behind = 0.0, 0.0
    if rigidity > 0.0:
        more = select(wrap > 0.0, (tension_ratio_and_slope(rho, mu, wrap + TURN)[0] - n) / TURN, 0.0)
        more = more * 0.25 * sqrt(rigidity) / p.edge_radius[h, 0]
        by_above, by_behind = (more / (pull * sqrt(pull)) for pull in (maximum(above, LEAST), maximum(behind, LEAST)))
    return n, by_mu, p.extrusion_exponent[0] * steep, by_above, by_behind


def slip(p, h, above, drop, behind):
    """Speed with which the cable slips up through inner hole h, m/s.

    Parameters
    ----------
    p : namedtuple
        Coefficients.
    h : int
        The hole, from 0.
    above, behind : float
        Tensions of its spans if nothing slips, N; the one above negative where its damper makes it slack.
    drop : float
        By how much the one above falls with the speed, N s/m.

    Returns
    -------
    float
        The speed; 0 where the friction holds.
    """
    pulled, above, behind = above, maximum(above, NONE), maximum(behind, NONE)
    held, by_mu, *_ = _limit(p, h, 0.0, above, behind)
    up, down = above >= held * behind, behind > held * above
    large, falls, rises = select(up, above, behind), select(up, drop, 0.0), select(up, 0.0, drop)
    over = maximum(log(large / (held * select(up, behind, above))), 1e-30)
    # its damper may make the span above slack, and a slip down make it taut again
    small, per = select(up, behind, pulled), maximum(drop, NONE)
    least = 1.0 if p.bending_rigidity[0] > 0.0 else held  # less of a stiff cable is in contact as the tension falls
    room = select(up, large - least * small, large / least - small)
    low = select(drop > 0.0, minimum(maximum(-small / per, 0.0), FASTEST), 0.0)
    high = maximum(select(drop > 0.0, minimum(room / per, FASTEST), FASTEST), low + 1e-12)
    extruded = power(over * held / maximum(by_mu * p.extrusion_gain[0], 1e-30), 1.0 / p.extrusion_exponent[0])
    speed = minimum(minimum(low + extruded, low + over / (DRAG + falls / large)), high)
    for _ in range(PASSES):
        above_now, behind_now = maximum(large - falls * speed, NONE), maximum(small + rises * speed, NONE)
        n, by_mu, growth, by_large, by_small = _limit(p, h, speed, above_now, behind_now)
        apart = log(n * behind_now / above_now) + DRAG * speed
        slope = (by_mu * growth + by_small * rises - by_large * falls) / n
        slope += falls / above_now + rises / behind_now + DRAG
        low, high = select(apart < 0.0, speed, low), select(apart < 0.0, high, speed)
        new = speed - apart / slope
        inside = (new >= low * (1.0 - ROUNDING) - SLOW) & (new <= high * (1.0 + ROUNDING) + SLOW)
        speed = select(inside, new, 0.5 * (low + high))
    return select(up, speed, select(down, -speed, 0.0))


def taut(stiffness, stretch):
    """Tension of a span without damping."""
    return maximum(stiffness * stretch, 0.0)


def slips(rows: Rows, places, y, first, drop):
    """(tensions behind the inner holes, speeds of their slips).

    ``places``: where the inner holes' slips are; ``first``: tension of the span above the first hole if nothing slips
    there, which falls by ``drop`` for one m/s.
    """
    p = rows.p
    ends = (*places[1:], y)
    tensions = [taut(p.span_stiffness[0], at - end) for at, end in zip(places, ends)]
    speeds, above, damped = [], first, drop
    for h, behind in enumerate(tensions):
        speeds.append(slip(p, h, above, damped, behind))
        above, damped = behind, 0.0
    return tensions, speeds


def slid(p, x, places, y, way):
    """Where the inner holes' slips are once all have slid to their limits that way, with both ends in their places.

    Parameters
    ----------
    p : namedtuple
        Coefficients.
    x, y : float
        Places of drive and load, m.
    places : sequence of float
        Those of the slips, which stay where the way is 0, or the cable slack.
    way : float
        1: slipping up, -1: down.

    Returns
    -------
    list of float
        The places, m.
    """
    if way == 0.0:
        return list(places)
    whole, stiffness = x - y, [p.cable_stiffness[0], *(p.span_stiffness[0] for _ in places)]
    tensions = [maximum(whole, 0.0) / sum(1.0 / k for k in stiffness) for _ in stiffness]
    for _ in range(WRAPS if p.bending_rigidity[0] > 0.0 else 1):
        shares = [1.0]
        for h, (above, behind) in enumerate(pairwise(tensions)):
            n = _limit(p, h, 0.0, above, behind)[0] * (1.0 + BEYOND)
            shares.append(shares[-1] * select(way > 0.0, 1.0 / n, n))
        first = maximum(whole, 0.0) / sum(share / k for share, k in zip(shares, stiffness))
        tensions = [share * first for share in shares]
    ends, at = [], x
    for tension, k, place in zip(tensions, stiffness, places):
        at = at - tension / k
        ends.append(select(whole > 0.0, at, place))
    return ends
