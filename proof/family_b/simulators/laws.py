"""Laws that the three simulators of generator B share, each in more than one form, and friction on the velocity level.

An effect has the form of the tool's documentation (form 0) or another one from the literature (1, 2). Dry friction is
set-valued and solved exactly in every step (Moreau, "Numerical aspects of the sweeping process", 1999): what rests,
rests, without a bristle. Where pre-sliding is the effect that is concealed, friction is the elasto-plastic bristle of
Dupont, Hayward, Armstrong and Altpeter (2002), advanced explicitly.
"""

import numpy as np

from cable_envs.proof.simulators.numerics import jit

BREAKAWAY = 0.7
"""Share of the steady deflection up to which the bristle of `bristle` is elastic."""


@jit
def falling(form, v, speed):
    """What a Stribeck excess is at v of what it is at rest: Gauss (0), Tustin (1), or Hess and Soom (2)."""
    r = abs(v) / speed
    if form < 0.5:
        return np.exp(-r * r)
    if form < 1.5:
        return np.exp(-r)
    return 1.0 / (1.0 + r * r)


@jit
def drifted(form, t, time):
    """Share of a drift that has happened after t: exponential (0), or hyperbolic with the same half (1)."""
    if form < 0.5:
        return 1.0 - np.exp(-t / time)
    return t / (t + 0.6931471805599453 * time)


@jit
def wavy(second, angle):
    """A ripple of amplitude 1 with a second harmonic of amplitude ``second``."""
    return np.sin(angle) + second * np.sin(2.0 * angle + 0.9)


@jit
def rested(free, grip_up, grip_down):
    """Speed behind an impulse ``free`` that friction opposes by at most grip_up (> 0 moving) or grip_down: exact."""
    if free > grip_up:
        return free - grip_up
    if free < -grip_down:
        return free + grip_down
    return 0.0


@jit
def bristle(z, ds):
    """Deflection of an elasto-plastic bristle over its steady one, after a displacement ds in the same unit."""
    side = 1.0 if ds > 0.0 else -1.0
    plastic = 0.0
    if z * side > BREAKAWAY:
        part = min((z * side - BREAKAWAY) / (1.0 - BREAKAWAY), 1.0)
        plastic = 0.5 - 0.5 * np.cos(np.pi * part)
    new = z + ds * (1.0 - plastic * z * side)
    return 1.0 if new > 1.0 else (-1.0 if new < -1.0 else new)


@jit
def over(stretch, half):
    """Stretch beyond a play of +-half."""
    return stretch - half if stretch > half else (stretch + half if stretch < -half else 0.0)
