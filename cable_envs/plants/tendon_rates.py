"""A tendon that rubs at one place in continuous time: its tensions, and the rate of what has slipped there.

The law is that of `cable_envs.plants.tendon`, with its symbols. The contact has no mass, so the stretch y2 of the
load's span is a state. While the contact holds it goes with the load alone; at a limit of the ratio, T1 = n T2 or
T2 = n T1, it goes as the limit does wherever the load would take it beyond:

    y2' = max(held, (k1 e' - n' T2) / (k1 + n k2))      T1 = n T2: slips to the drive
    y2' = min(held, (n k1 e' + n' T1) / (n k1 + k2))    T2 = n T1: slips to the load

with the present stiffness k1, k2 of the spans. A slack tendon shares what is missing, as there.
"""

from cable_envs.core.kernels import select
from cable_envs.plants.continuous import contained, engaged
from cable_envs.plants.tendon import slipped, spanned, taut_slope


def rubbing(e, e_rate, y, held, k1, k2, hard, n, n_rate, unit):
    """(T1, T2, y2') of a tendon.

    Parameters
    ----------
    e, e_rate : float
        Stretch of the whole tendon and its rate, m and m/s.
    y : float
        Stretch of the load's span, m.
    held : float
        Its rate if the contact holds, m/s.
    k1, k2 : float
        Stiffness of the spans without tension, N/m.
    hard : float
        Hardening, 1/N.
    n, n_rate : float
        Limit of the tension ratio and its rate.
    unit : float
        Metres for one unit of the plant's coordinate, of `contained`.

    Returns
    -------
    tuple of three float
        Tensions at the drive and at the load, N, and the rate of y.
    """
    t1, t2 = spanned(k1, e - y, hard), spanned(k2, y, hard)
    s1, s2 = taut_slope(k1, t1, hard), taut_slope(k2, t2, hard)
    some = select(e > 0.0, e, 1.0)
    low, high = slipped(some, k1, k2, hard, 1.0, n), slipped(some, k1, k2, hard, n, 1.0)
    to_drive = (s1 * e_rate - n_rate * t2) / (s1 + n * s2)
    to_load = (n * s1 * e_rate + n_rate * t1) / (n * s1 + s2)
    taut = contained(held, y, low, high, to_drive, to_load, unit)
    return t1, t2, engaged(k1 * e, taut, e_rate * k1 / (k1 + k2))


def slid(e, y, k1, k2, hard, n, way):
    """y2 of a contact at its limit: slid to the drive (way 1) or to the load (-1); ``y`` as it is where 0."""
    some = select(e > 0.0, e, 1.0)
    end = select(way > 0.0, slipped(some, k1, k2, hard, 1.0, n), slipped(some, k1, k2, hard, n, 1.0))
    return select(way == 0.0, y, select(e > 0.0, end, e * k1 / (k1 + k2)))
