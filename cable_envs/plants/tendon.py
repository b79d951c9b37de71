"""Pieces of plants with several tendons: one that rubs at one place, its stiffness, and the drive that pulls it.

The tendon has two elastic spans with a friction contact between them, and no mass.

    drive  -  span 1  -  contact  -  span 2  -  load

symbol | meaning                                                                        | unit
------ | ------------------------------------------------------------------------------ | ----
e      | stretch of the whole tendon: what the drive has pulled in less what the load has | m
y1, y2 | stretch of the spans, y1 + y2 = e; a contact that holds leaves y2 to the load's motion | m
k1, k2 | stiffness of the spans without tension                                         | N/m
T1, T2 | tensions at the drive and at the load, of the law `stiffness_hardening`          | N
n      | limit of the tension ratio of the contact (`contact.tension_ratio`)             | 1

The contact holds while T1 <= n T2 and T2 <= n T1. Beyond, the tendon slips until the ratio is n again: with a = 1,
b = n where it slips to the drive, and a = n, b = 1 where it slips to the load, a T1(e - y2) = b T2(y2). This is a
quadratic equation for y2 with one root in [0, e]. The law is that of an elastic element with a friction element: it
does not depend on the rate, and slip only ever takes energy. A tendon with e <= 0 is slack: it carries nothing, and its
spans share what is missing.
"""

from cable_envs.core.kernels import clip, inline, maximum, select, sqrt
from cable_envs.effects.stiffness_hardening import hardened
from cable_envs.physics.friction import ringing_inertia


@inline
def spanned(stiffness, stretch, hard):
    """Tension of a span; nothing when slack."""
    return hardened(maximum(stiffness * stretch, 0.0), hard)[0]


@inline
def slipped(e, k1, k2, hard, a, b):
    """y2 at which a T1 = b T2, for e > 0.

    Examples
    --------
    Two equal spans, twice the tension at the drive: two thirds of the stretch are there.

    >>> round(slipped(3e-3, 1e4, 1e4, 0.0, 1.0, 2.0), 9)
    0.001
    """
    half = 0.5 * hard
    square = half * (a * k1 * k1 - b * k2 * k2)
    linear = a * k1 * (1.0 + hard * k1 * e) + b * k2
    rest = a * k1 * e * (1.0 + half * k1 * e)
    return 2.0 * rest / (linear + sqrt(maximum(linear * linear - 4.0 * square * rest, 0.0)))


@inline
def balanced(e, held, k1, k2, hard, ratio):
    """(T1, T2, y2) of a tendon whose load's span would have the stretch ``held`` if the contact did not slip.

    Examples
    --------
    >>> [round(v, 6) for v in balanced(2e-3, 1e-3, 1e4, 1e4, 0.0, 1.5)]  # in balance: nothing slips
    [10.0, 10.0, 0.001]
    >>> [round(v, 6) for v in balanced(2e-3, 0.0, 1e4, 1e4, 0.0, 1.5)]  # slips to the drive
    [12.0, 8.0, 0.0008]
    >>> balanced(-2e-3, 0.0, 1e4, 1e4, 0.0, 1.5)
    (0.0, 0.0, -0.001)
    """
    t1, t2 = spanned(k1, e - held, hard), spanned(k2, held, hard)
    taut = e > 0.0
    some = select(taut, e, 1.0)
    y2 = select(t1 > ratio * t2, slipped(some, k1, k2, hard, 1.0, ratio), held)
    y2 = select(t2 > ratio * t1, slipped(some, k1, k2, hard, ratio, 1.0), y2)
    y2 = select(taut, y2, e * k1 / (k1 + k2))
    t1, t2 = spanned(k1, e - y2, hard), spanned(k2, y2, hard)
    return select(taut, t1, 0.0), select(taut, t2, 0.0), y2


@inline
def span_slope(stiffness, tension, hard):
    """Slope of a span's law at its tension, N/m; 0 where it is slack."""
    return select(tension > 0.0, taut_slope(stiffness, tension, hard), 0.0)


@inline
def taut_slope(stiffness, tension, hard):
    """Slope of a taut span's law at its tension, N/m."""
    return stiffness * sqrt(1.0 + 2.0 * hard * tension)


@inline
def series(k1, k2, t1, t2, hard):
    """Stiffness of the whole tendon at its tensions, N/m: of both spans in series; 0 where it is slack."""
    first, second = span_slope(k1, t1, hard), span_slope(k2, t2, hard)
    both = first + second
    return select(both > 0.0, first * second / select(both > 0.0, both, 1.0), 0.0)


@inline
def pulled(speed, force, tension, mass, damping, stiffness, limit, dt):
    """Speed after dt of a drive that is told its force, against the tension in the middle of the step and its slope."""
    new = speed + dt * (force - tension - damping * speed) / ringing_inertia(mass, damping, stiffness, dt)
    return clip(new, -limit, limit)
