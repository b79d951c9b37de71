"""Holes in series in continuous time.

    span     T_0 = k (x - s_1) + c (x' - s_1'),   T_j = k_s (s_j - s_{j+1}),   s_N = y;   at least 0
    hole     T_{h-1} = n_h T_h slipping up, T_h = n_h T_{h-1} slipping down, in between at rest

`cable_envs.plants.hole.series` has the symbols. The cable has no mass, so the tensions of a hole's two spans say how
fast it slips there: n_h(mu_h + K w^omega) grows with the speed w, and w is the one at which the ratio is that of the
tensions. So the slips s_h of the inner holes are states. At w = 0 the speed grows with an infinite slope over the
tensions where omega > 1: there is no linear system on the verge of sliding, and the equations are stiff near rest.
"""

from cable_envs.core.kernels import log, maximum, minimum, power, select
from cable_envs.physics.contact import tension_ratio_and_slope
from cable_envs.plants.continuous import Rows

FASTEST = 1.0
"""Speed of a slip beyond which none is looked for, m/s."""
NONE = 1e-9
"""Tension that stands for none in a ratio, N."""
PASSES = 14
"""Steps of Newton's method, within what is known to hold the speed."""
ROUNDING = 1e-9
"""Share by which a step of Newton's method may miss what holds the speed."""


def slip(p, h, above, drop, behind):
    """Speed with which the cable slips up through inner hole h, m/s.

    Parameters
    ----------
    p : namedtuple
        Coefficients.
    h : int
        The hole, from 0.
    above, behind : float
        Tensions of its spans if nothing slips, N.
    drop : float
        By how much the one above falls with the speed, N s/m.

    Returns
    -------
    float
        The speed; 0 where the friction holds.
    """
    rho, mu, wrap = p.radius_ratio[h, 0], p.friction_coefficient[h, 0], p.wrap_angle[h, 0]
    gain, exponent = p.extrusion_gain[0], p.extrusion_exponent[0]
    above, behind = maximum(above, NONE), maximum(behind, NONE)
    held, growth = tension_ratio_and_slope(rho, mu, wrap)
    up, down = above > held * behind, behind > held * above
    large, small = select(up, above, behind), select(up, behind, above)
    falls, rises = select(up, drop, 0.0), select(up, 0.0, drop)
    over = maximum(log(large / (held * small)), 1e-30)
    low, high = 0.0, select(drop > 0.0, minimum((large - held * small) / maximum(drop, NONE), FASTEST), FASTEST)
    high = maximum(high, 1e-12)
    speed = minimum(power(over * held / (growth * gain), 1.0 / exponent), high)
    for _ in range(PASSES):
        steep = gain * power(maximum(speed, 1e-12), exponent - 1.0)
        n, growth = tension_ratio_and_slope(rho, mu + steep * speed, wrap)
        above_now, behind_now = maximum(large - falls * speed, NONE), maximum(small + rises * speed, NONE)
        apart = log(n * behind_now / above_now)
        slope = growth / n * exponent * steep + falls / above_now + rises / behind_now
        low, high = select(apart < 0.0, speed, low), select(apart < 0.0, high, speed)
        new = speed - apart / slope
        inside = (new >= low * (1.0 - ROUNDING)) & (new <= high * (1.0 + ROUNDING))
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
