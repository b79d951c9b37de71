"""Friction whose history is one deflection: LuGre and elasto-plastic contact, with the deflection over its largest.

What is kept is the share of the friction that opposes upward motion, s = (1 + z / g) / 2, as of the elements of
`presliding_hysteresis`, in each of their rows. r is z / g in the direction of motion, h the way over the displacement:

    dr/dh = 1 - alpha(r) r,     alpha = 1 (LuGre);   0 up to ``breakaway``, then a cubic up to 1 (elasto-plastic)

``breakaway`` is below 0 for LuGre.
"""

from cable_envs.core.kernels import clip, inline, maximum, minimum, select, sign
from cable_envs.effects.lanes import ELEMENTS


@inline
def bristle_length(e, i):
    """Deflection at full friction; 0 without bristles. Kernels for rigs that have them take `deflection` for it."""
    return 0.0


@inline
def deflection(e, i):
    """What `bristle_length` says, where there may be bristles."""
    return maximum(e.lugre_friction_displacement[i], e.elastoplastic_friction_displacement[i])


@inline
def breakaway(e, i):
    """Share of the friction up to which nothing slips."""
    elastic = e.elastoplastic_friction_displacement[i] > 0.0
    return select(elastic, e.elastoplastic_friction_breakaway[i], -1.0)


@inline
def damping_ratio(e, i):
    """Damping of the bristles over sqrt(stiffness x inertia)."""
    elastic = e.elastoplastic_friction_displacement[i] > 0.0
    return select(elastic, e.elastoplastic_friction_damping[i], e.lugre_friction_damping[i])


@inline
def _slips(r, breakaway):
    """alpha."""
    t = clip((r - breakaway) / (1.0 - breakaway), 0.0, 1.0)
    return select(breakaway < 0.0, 1.0, t * t * (3.0 - 2.0 * t))


@inline
def keeping(share, v, breakaway):
    """dr/dh: share of the motion that bends the bristles; all of it at rest, negative where they straighten."""
    r = select(v < 0.0, 1.0 - 2.0 * share, 2.0 * share - 1.0)
    return select(v == 0.0, 1.0, 1.0 - _slips(r, breakaway) * r)


@inline
def bent(share, way, breakaway):
    """The share after a way over the displacement, of either sign: order 2, and at full friction after a long one.

    First all that is elastic, then with alpha in the middle of the rest; 1 / (1 + x + x^2 / 2) stands for e^-x.
    """
    to, h = sign(way), abs(way)
    r = to * (2.0 * share - 1.0)
    free = select(breakaway < 0.0, 0.0, clip(breakaway - r, 0.0, h))
    r, h = r + free, h - free
    most = maximum(r, 1.0)
    middle = minimum(r + 0.5 * h * (1.0 - _slips(r, breakaway) * r), most)
    alpha = _slips(middle, breakaway)
    x = alpha * h
    r = minimum(r + (1.0 - alpha * r) * h * (1.0 + 0.5 * x) / (1.0 + x + 0.5 * x * x), most)
    return select(way == 0.0, share, 0.5 + 0.5 * to * r)


@inline
def set_all(elements, i, bristles, share):
    """The share in every row, where there are bristles."""
    for k in range(ELEMENTS):
        elements[k, i] = select(bristles, share, elements[k, i])
