"""Beyond a place the load meets something that pushes back or grips: a stop, tissue, a workpiece."""

import numpy as np

from cable_envs.core.kernels import inline, maximum, select
from cable_envs.effects.base import Effect, EffectParameter

EFFECT = Effect(
    name="unilateral_contact",
    seam="load",
    equation="F = -d (stiffness + damping v + friction sign(v)), d = max(y - place, 0); what has a negative size acts "
    "below the place: its size, and d = max(place - y, 0), against the way there",
    source="Hunt and Crossley, J. Appl. Mech. 42 (1975) 440; friction along a needle: Okamura, Simone, O'Leary, IEEE "
    "Trans. Biomed. Eng. 51 (2004) 1707",
    parameters=(
        EffectParameter(
            "stiffness", "N/m", 0.0, -1e7, 1e7, "spring that is met at the place: above it, negative: below it", 500.0,
            0.05, signed=True, probes=(0.3,),
        ),
        EffectParameter(
            "damping", "N s/m^2", 0.0, -1e7, 1e7, "viscous friction for each unit beyond the place: above it, "
            "negative: below it", 1000.0, 0.01, signed=True, probes=(0.3,),
        ),
        EffectParameter(
            "friction", "N/m", 0.0, -1e6, 1e6, "dry friction for each unit beyond the place: above it, negative: below "
            "it", 50.0, 0.01, signed=True, probes=(0.3,),
        ),
        EffectParameter("place", "m", 0.0, -100.0, 100.0, "where it is met", 0.0, 0.0, shape=True),
    ),
    place="place",
    validity="springs in proportion to the depth, left more slowly than stiffness / damping, or they would pull. An "
    "impact is resolved where the spring's vibration turns by less than half a radian in a step of integration, "
    "sqrt(stiffness / mass) dt, and keeps its energy to 1 %",
    experiment="Approach and leave it slowly, and go on as far beyond it. What is met has no force before, and the "
    "same on the way in and out but for friction",
    confusable=("position_dependent_load", "position_ripple", "stiffness_hardening"),
)  # fmt: skip


@inline
def beyond(y, reach, place, size):
    """(mean depth beyond the place from y - reach to y + reach, what twice of it grows by the depth at y + reach).

    Something is met above the place where its size is positive, else below it. The mean over the way of a step, and not
    the depth in its middle, gives a spring that is met within a step the work that it takes.

    Examples
    --------
    >>> beyond(0.5, 0.0, 0.25, 10.0), beyond(0.5, 0.125, 0.25, 10.0), beyond(0.5, 0.0, 0.25, -10.0)
    ((0.25, 1.0), (0.25, 1.0), (0.0, 0.0))
    >>> beyond(0.25, 0.125, 0.25, 10.0)  # half of the way is at a mean depth of 1/16
    (0.03125, 0.75)
    """
    middle = select(size < 0.0, place - y, y - place)
    inward = select(size < 0.0, -reach, reach)
    way = 2.0 * abs(reach)
    deepest = maximum(middle + 0.5 * way, 0.0)
    part = select(deepest < way, deepest / maximum(way, 1e-300), 1.0)  # of the way, that is beyond
    grows = select(inward > 0.0, part * (2.0 - part), part * part)
    inside = deepest >= way
    return select(inside, maximum(middle, 0.0), 0.5 * part * deepest), select(deepest > 0.0, grows, 0.0)


@inline
def met_push(e, i, y, v, reach):
    """(force against positive motion, its stiffness, its damping) of what is met, mean from y - reach to y + reach."""
    k, c, place = e.unilateral_contact_stiffness[i], e.unilateral_contact_damping[i], e.unilateral_contact_place[i]
    depth, grows = beyond(y, reach, place, k)
    wet, _ = beyond(y, reach, place, c)
    return k * depth + abs(c) * wet * v, abs(k) * grows, abs(c) * wet


@inline
def met_friction(e, i, y, reach):
    """Dry friction of what is met, at least 0, mean from y - reach to y + reach."""
    per = e.unilateral_contact_friction[i]
    depth, _ = beyond(y, reach, e.unilateral_contact_place[i], per)
    return abs(per) * depth


def push_at_rest(e, position: np.ndarray) -> np.ndarray:
    """Forces [n] against positive motion of the springs that are met at positions [n]."""
    size = e.unilateral_contact_stiffness
    over = position - e.unilateral_contact_place
    return size * np.maximum(np.where(size < 0.0, -over, over), 0.0)
