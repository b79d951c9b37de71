"""A band around a drum that is driven to and fro: displacement to band tensions, tensions to the force on the drum.

    D = T2 - T1, the band's pull on the drum        |D| <= grip: beyond it the drum slips under the band
    grip = band_grip + (e^capstan_exponent - 1) band_pretension
    F = coulomb sign(v) + what the effects add      sign: a straight line over +/- still_speed

symbol | meaning | unit
------ | ------- | ----
x, v   | position and speed of the drum's surface: what is followed | m, m/s
z      | what has slipped | m
D, F   | pull of the band on the drum; force on the drum | N
T1, T2 | tension of the band's ends; T_s the slack one, T_t the tight one | N

Without effects it is a brake with nothing but dry friction: D = grip sign(v) once taut, F = coulomb sign(v).

How the pretension enters. A piece of band of angle da under tension T is pressed on the drum by T da and rubs with
mu T da, so dT = mu T da where the drum slips, and over the whole wrap (Eytelwein)

    T_t = n T_s,   n = e^(mu wrap),   D = T_t - T_s = (n - 1) T_s

The tight end pulls on its anchor. The slack end is held by what sets the pretension P, and by the band itself, which
is bent round the drum and presses on it without any P, as if its slack end had a tension T_0:

    T_s = T_0 + P - k y,   y = gap / 2 + c D

k is the stiffness of what holds the slack end, y the way by which that end comes nearer: half of the play, and the
stretch of the rest of the band, whose compliance is c. Put together,

    D = (n - 1) (T_0 - k gap / 2 + P) / (1 + (n - 1) k c)

which is a straight line in P whatever k is. ``band_grip`` is where it begins, the pull at which the drum slips without
pretension, and ``e^capstan_exponent - 1`` its slope; with a soft holder (k near 0) the exponent is mu times the wrap,
else smaller. Wrap and mu are known as that product only. An exponent multiplies errors: a coefficient of friction that
is 3 % higher makes a pull 11 % higher where the exponent is 3.5. The play is a length of the mechanism and the
stiffness c that of the band: neither has the pretension in it. What the drum's force is for a pull (the arms of both,
``load_dependent_friction``) has not either.

In Coble's records (2022) the mean pull while the drum slips forwards at 0.5 Hz, and the force over it, are

pretension, lb | 0 | 30 | 36 | | 20 | 25 | 35 | 70 | 80
-------------- | - | -- | -- | - | -- | -- | -- | -- | --
pull, lb       | 250 | 993 | 1537 | | 488 | 904 | 1067 | 1205 | 1398
force / pull   | 2.5 | 2.1 | 2.1 | | 2.1 | 2.0 | 2.0 | 2.0 | 2.0

(the first three of April 2023, the others of July 2022 on another assembly). Straight lines leave 16 % and 15 % of
the mean pull (RMS); one pull for all pretensions leaves 57 % and 30 %, a pull in proportion to them 21 % and 27 %.
The force is 2.0 times the pull and 0.1 kip at every pretension. What is left is the coefficient of friction, which is
not the same from day to day, and how well a pretension is set: while the band is in its play both tensions together
are 20 to 37 lb where 30 lb are recorded, and 28 to 39 where 36 are. The slack end's sensor reads 0 to 27 lb while the
drum slips, in no order: with n near 40 its zero would have to be known to half a pound.

The self-energising band has one spring, one play and one slip for both directions. The motion is followed and slow
against the band's own vibration (some 100 Hz), so all is quasi-static: with the friction set-valued, z is a play
operator of the displacement, which needs no integrator and no step. With pre-sliding, friction builds up over the slip
by four elements (generalised Maxwell-slip, `cable_envs.effects.presliding_hysteresis`), and z is found by bisection.

`replay` with drive "follow": the force is that of the plant's own band. "observed": the band's pull is ``disturbance``,
as its sensors read it, in the force; the pull itself is predicted from the displacement still.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from cable_envs.core.inputs import OBSERVED
from cable_envs.core.kernels import clip, inline, maximum, minimum, select
from cable_envs.core.lanes import Lanes
from cable_envs.core.params import Parameter, ParameterTable
from cable_envs.effects import Layout
from cable_envs.effects.asymmetric_friction import levels
from cable_envs.effects.backlash import dead_zone
from cable_envs.effects.lanes import ELEMENTS
from cable_envs.effects.presliding_hysteresis import begin as begin_elements
from cable_envs.effects.presliding_hysteresis import follow, share
from cable_envs.effects.seams import actuate, begin, end
from cable_envs.effects.stiffness_hardening import hardened, linear
from cable_envs.effects.stribeck_friction import excess_at
from cable_envs.plants.band_brake.effects import ACTING
from cable_envs.plants.base import OUT_OF_RANGE, Plant, Signal, rows_of

PARAMETERS = ParameterTable(
    Parameter("band_grip", "N", 3e3, 0.0, 1e6, "pull of the band at which the drum slips without a pretension"),
    Parameter("band_pretension", "N", 0.0, 0.0, 1e5, "tension to which the band's slack end is set"),
    Parameter("capstan_exponent", "1", 0.0, 0.0, 10.0, "log of the tension ratio of the wrap: mu times its angle"),
    Parameter("coulomb", "N", 6e3, 0.0, 1e6, "dry friction of the drum that the band's pull does not change"),
    Parameter("force_offset", "N", 0.0, -1e5, 1e5, "what the force's sensor reads without a force"),
    Parameter("tension_offset", "N", 0.0, -1e5, 1e5, "what the band's sensors read without a pull"),
    Parameter("still_speed", "m/s", 1e-3, 1e-9, 1.0, "speed over which the sign of the drum's dry friction turns"),
)

SIGNALS = (
    Signal("force", "N", "force on the drum"),
    Signal("band_tension_difference", "N", "pull of the band on the drum: tension of one end less that of the other"),
    Signal("position", "m", "position of the drum's surface"),
    Signal("velocity", "m/s", "its speed"),
    Signal("slip", "m", "how far the drum has slipped under the band"),
    OUT_OF_RANGE,
)

COEFFICIENTS = Lanes("Coefficients", ("grip", "coulomb", "force_offset", "tension_offset", "still_speed"))
HALVINGS = 40
"""Of the interval that holds the slip: below a millionth of a millionth of it."""


def grip(value: Mapping[str, Any]) -> Any:
    """Pull of the band at which the drum slips.

    Parameters
    ----------
    value : mapping of str to float or ndarray
        Parameters of the plant, SI.

    Returns
    -------
    float or ndarray
        N, as those of ``value``.

    Examples
    --------
    >>> round(float(grip({"band_grip": 1000.0, "band_pretension": 100.0, "capstan_exponent": np.log(41.0)})), 6)
    5000.0
    """
    return value["band_grip"] + np.expm1(value["capstan_exponent"]) * value["band_pretension"]


@inline
def _spring(e, i, stretch):
    """Pull of the band stretched so far."""
    taken = dead_zone(stretch, e.backlash_gap[i])
    pull, _ = hardened(abs(taken) / e.cable_elongation_compliance[i], e.stiffness_hardening_coefficient[i])
    return select(taken < 0.0, -pull, pull)


@inline
def _reach(e, i, pull):
    """Stretch at which the band pulls so much."""
    soft = e.cable_elongation_compliance[i]
    return 0.5 * e.backlash_gap[i] + soft * linear(pull, e.stiffness_hardening_coefficient[i])


@inline
def _held(s, i, moved, width, up, down):
    """Friction of the elements, were the slip moved on."""
    mean = 0.0
    for k in range(ELEMENTS):
        mean += 0.25 * clip(s.presliding[k, i] + 4.0 * moved / ((k + 1.0) * width), 0.0, 1.0)
    return mean * (up + down) - down


@inline
def _slipped(e, s, i, x, z, width, up, down):
    """The slip at which the band's spring balances the friction that builds up with it."""
    beyond = width + 0.5 * e.backlash_gap[i]
    low, high = minimum(z, x) - beyond, maximum(z, x) + beyond
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        if _spring(e, i, x - middle) > _held(s, i, middle - z, width, up, down):
            low = middle
        else:
            high = middle
    return low


@inline
def _step(x, p, u, e, s, g, i):
    fresh = s.started[i] < 0.5
    at, v = g.target[i], g.target_rate[i]
    extra, _ = excess_at(e.stribeck_friction_excess[i], e.stribeck_friction_velocity[i], v)
    more, less = levels(e.asymmetric_friction_difference[i])
    up, down = p.grip[i] + extra + more, p.grip[i] + extra + less
    width = e.presliding_hysteresis_displacement[i]
    z = select(fresh, at, x.slip[i])
    begin_elements(s.presliding, i, s.started[i], 0.5)
    if width > 0.0:
        found = _slipped(e, s, i, at, z, width, up, down)
        follow(s.presliding, i, found - z, width)
        pull = share(s.presliding, i) * (up + down) - down
    else:
        found = minimum(maximum(z, at - _reach(e, i, up)), at + _reach(e, i, down))
        pull = _spring(e, i, at - found)
    pull += e.viscous_friction_band[i] * v
    felt = select(abs(u.mode[i] - OBSERVED) < 0.5, u.disturbance[i], pull)
    way = clip(v / p.still_speed[i], -1.0, 1.0)
    force = (
        e.load_dependent_friction_coefficient[i] * felt
        + p.coulomb[i] * way
        + e.viscous_friction_coefficient[i] * v
        + e.position_dependent_load_stiffness[i] * (at - e.position_dependent_load_neutral[i])
    )
    x.force[i], x.band_tension_difference[i] = force + p.force_offset[i], pull + p.tension_offset[i]
    x.position[i], x.velocity[i], x.slip[i], x.out_of_range[i] = at, v, found, 0.0
    s.started[i] = 1.0


@inline
def _solve(x, p, u, w, e, s, g, lanes, substeps, dt):
    for i in range(lanes):
        begin(e, s, g, u, i, x.position[i], x.velocity[i], x.position[i], x.velocity[i], substeps * dt, dt)
    for n in range(substeps):
        for i in range(lanes):
            actuate(e, s, g, u, i, n, substeps, dt)
        for i in range(lanes):
            _step(x, p, u, e, s, g, i)
    for i in range(lanes):
        end(e, s, g, i, x.position[i], substeps * dt)


def _derive(value, e) -> dict[str, np.ndarray]:
    """Rows of `COEFFICIENTS`: the grip, and the other parameters themselves."""
    return {"grip": grip(value)} | {name: value[name] for name in COEFFICIENTS.names if name != "grip"}


def _settle(x, s, p, e, position: np.ndarray) -> None:
    """The drum at ``position`` (m, [n]), the band without a pull."""
    x.position[:], x.slip[:] = position, position
    x.force[:], x.band_tension_difference[:] = p.force_offset, p.tension_offset


PLANT = Plant(
    name="band_brake",
    parameters=PARAMETERS,
    signals=SIGNALS,
    signal_rows=rows_of(SIGNALS),
    coefficient_rows=COEFFICIENTS,
    scratch=Lanes("Scratch", []),
    action_modes=(),
    derive=_derive,
    settle=_settle,
    solve=_solve,
    effects=Layout("band_brake", PARAMETERS, ACTING),
    plain=False,
)
