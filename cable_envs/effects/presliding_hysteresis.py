"""After each reversal dry friction builds up over a distance, because asperities bend before they slide."""

from cable_envs.core.kernels import clip, inline, maximum, minimum, select, sqrt
from cable_envs.effects.base import Effect, EffectParameter
from cable_envs.effects.lanes import ELEMENTS

EFFECT = Effect(
    name="presliding_hysteresis",
    seam="contact",
    equation="s_k' = 4 v / (k displacement), held in [0, 1], k = 1..4; F = F_down + mean(s) (F_up - F_down); hole: "
    "T2 = T1 n^(1 - 2 mean(s))",
    source="generalised Maxwell-slip: Al-Bender, Lampaert, Swevers, IEEE TAC 50 (2005) 1883; a damping while "
    "elastic: Canudas de Wit et al., IEEE TAC 40 (1995) 419, here a tenth of their sqrt(K m)",
    parameters=(
        EffectParameter(
            "displacement",
            "m",
            0.0,
            0.0,
            1.0,
            "travel from full friction in one direction to full friction in the other",
            5e-4,
            0.02,
            probes=(0.05, 0.1, 0.2, 0.4, 0.7, 1.0, 2.0),  # far from in proportion
        ),
    ),
    validity="wherever dry friction acts; it replaces the set-valued friction of the load or output, and on "
    "`cable_hole` that of the hole",
    experiment="Reverse with growing amplitude around one position, with the output free. The loops lie within each "
    "other",
    confusable=("backlash", "cable_elongation", "partial_slip"),
)


DAMPED = 0.1
"""Damping of friction while elastic over sqrt(K m): a twentieth of the critical one, as metals and cables have. The
sqrt(K m) of simulations is a force of its own while a load breaks away: against another simulator's pre-sliding of 0.7
um at a hole it left all but 10 of a mismatch of 1153, a tenth of it 698."""


STEEPEST = 25.0 / 12.0
"""Growth of the share where no element slips, over 1 / displacement."""


@inline
def damping(stiffness, mass):
    """Damping that goes with a friction's stiffness, negative for none."""
    return DAMPED * sqrt(maximum(stiffness, 0.0) * mass)


@inline
def share(elements, i):
    """Share of the friction that opposes upward motion, in [0, 1]: the mean of the elements."""
    return 0.25 * ((elements[0, i] + elements[1, i]) + (elements[2, i] + elements[3, i]))


@inline
def slope(elements, i, v, width):
    """d share / d position of the elements that have not yet slipped in the direction of v."""
    total = 0.0
    for k in range(ELEMENTS):
        s = elements[k, i]
        total += select(((v >= 0.0) & (s < 1.0)) | ((v <= 0.0) & (s > 0.0)), 1.0 / (k + 1.0), 0.0)
    return total / select(width > 0.0, width, 1.0)  # an element's width is (k + 1) / 4 of it, its weight 1 / 4


@inline
def follow(elements, i, moved, width):
    """The elements after a motion."""
    for k in range(ELEMENTS):
        s = clip(elements[k, i] + 4.0 * moved / ((k + 1.0) * select(width > 0.0, width, 1.0)), 0.0, 1.0)
        elements[k, i] = select(width > 0.0, s, elements[k, i])


@inline
def begin(elements, i, started, value):
    """All elements at the share that balances the start, if nothing has started yet."""
    for k in range(ELEMENTS):
        elements[k, i] = select(started > 0.5, elements[k, i], value)


@inline
def draw_to(elements, i, part, value):
    """All elements nearer to a share, by a part of the way."""
    for k in range(ELEMENTS):
        s = elements[k, i]
        elements[k, i] = select(part > 0.0, s + part * (value - s), s)


@inline
def torque_play(held, low, high, way, share):
    """(torque behind a contact that sticks, where its play is): the law of plants whose contacts know no motion.

    held: where the play was; low, high: torque at full friction against positive and against negative motion; way:
    direction of the motion; share: of the friction that sticks, the rest is on its side by ``way`` (play operator:
    Krasnosel'skii and Pokrovskii, Systems with Hysteresis, Springer 1989).
    """
    stuck = minimum(maximum(held, low), high)
    return share * stuck + (1.0 - share) * select(way < 0.0, high, low), stuck
