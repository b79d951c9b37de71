"""The tension along a tendon that rubs in a bent sheath, by its mobilised friction: scalar pieces.

symbol | meaning                                                                                     | unit
------ | ------------------------------------------------------------------------------------------- | ----
r      | mobilised friction ln(T1 / T2): mu Theta where the tendon is pulled in, -mu Theta paid out    | 1
T1, T2 | tension at the drive and at the load                                                        | N
Tm     | mean of T1 exp(-r s) over the sheath, s in [0, 1]: (T1 - T2) / ln(T1 / T2), what stretches it | N
"""

from cable_envs.core.kernels import clip, expm1, inline, log, maximum, select, sqrt

NEWTON = 3
"""Steps of Newton's method in `mobilised`: from its start, within 1e-12 for all frictions up to r = 4."""


@inline
def leaving(r):
    """T2 / Tm = r / (e^r - 1); T1 / Tm is this at -r, or this plus r."""
    some = select(r == 0.0, 1.0, r)
    return select(r == 0.0, 1.0, some / expm1(some))


@inline
def leaving_slope(r):
    """d(T2 / Tm) / dr, negative: -1/2 where nothing is mobilised."""
    small = abs(r) < 1e-4
    some, share = select(small, 1.0, r), leaving(r)
    return select(small, r / 6.0 - 0.5, share * (1.0 - share - some) / some)


@inline
def mobilised(share, most):
    """The r in [-most, most] at which T2 / Tm is ``share``: the inverse of `leaving`.

    Newton's method from ln(T2 / Tm) = -r / 2 - r^2 / 24, which leaves out r^4 / 2880.
    """
    start = -6.0 + sqrt(maximum(36.0 - 24.0 * log(maximum(share, 1e-300)), 0.0))
    r = clip(start, -most, most)
    for _ in range(NEWTON):
        r = clip(r - (leaving(r) - share) / leaving_slope(r), -most, most)
    return r


@inline
def stuck_growth(r):
    """dT1 / dTm while T2 is held: 2 where nothing is mobilised."""
    small = abs(r) < 1e-4
    some = select(small, 1.0, r)
    entering = leaving(r) + r
    return select(small, 2.0 + r / 3.0, some * entering / select(small, 1.0, entering - 1.0))
