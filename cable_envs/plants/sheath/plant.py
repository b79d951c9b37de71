"""A drive pulls a load by a tendon in a bent sheath (Bowden cable); a return spring pulls the load back.

The tendon slides in a sheath of the total bend Theta; the capstan law holds along it however the bend is spread
(Kaneko et al., A new consideration on tendon-tension control system of robot hands, IEEE ICRA 1991; Palli and
Melchiorri, Model and control of tendon-sheath transmission systems, IEEE ICRA 2006). With the share s in [0, 1] of the
bend between the drive and a place, the tendon sliding there with the speed v,

    dT/ds = -mu Theta T sign(v)          T(s) = T1 e^(-r s),   r = +mu Theta pulled in, -mu Theta paid out
    load       T2 = T1 e^(-r);           at rest r = ln(T1 / T2) is anything in between
    stretch    x - y = slack + creep + Tm / k,    1/k = L/EA + 1/k_sheath
               Tm = integral of T ds = T1 (1 - e^(-r)) / r = (T1 - T2) / ln(T1 / T2)
    so         T2 = Tm r / (e^r - 1),    T1 = T2 + r Tm,        k (x - y) + c (x' - y') = Tm >= 0

The sheath carries the tendon's tension as compression at every place, so it gives way under the same mean Tm, in
series with the tendon (Agrawal, Peine and Yao, Modeling of transmission characteristics across a cable-conduit system,
IEEE Transactions on Robotics 26 (2010), without its lumped elements). Load and drive:

    load       m y'' = T2 - preload - k_l y - c_l y' - F_c sign(y') + disturbance
    position   x'' = w^2 (command - x) + 2 z w (command_rate - x'),     within acceleration and speed limits
    tension    m_d x'' = command - T1 - c_d x',                         within the speed limit

symbol   | meaning                                                              | unit
-------- | -------------------------------------------------------------------- | ----
x, y     | drive, positive pulls in; load, positive towards the sheath          | m
T1, T2   | tension at the drive and at the load; Tm its mean along the sheath   | N
Theta    | total bend of the sheath: the sum of all its turns                   | rad
mu, r    | friction coefficient; mobilised friction, within mu Theta either way | 1

Reversals: T1 must fall from T2 e^(mu Theta) to T2 e^(-mu Theta) before the load goes back, and the drive runs through
the stretch that goes with it: the backlash-like hysteresis of the literature, whose width grows with the load (Do et
al., Mech. Mach. Theory 85 (2015) 14). Both ends of that passage are those of a distributed tendon. Within it friction
is mobilised evenly here, while along a distributed tendon the reversed part grows from the drive: the load is at rest
either way, but T1 takes another path between the same ends (with mu Theta = 0.31 up to 12 % off). The direction of
friction is that of the load's end.

Valid for a bend that does not change, slow motion (no waves, no mass of the tendon), a tendon without bending
stiffness that touches the sheath all along where it bends; curvature and pressure do not change mu. Backlash proper
(of the drive, in front of the tendon) is the effect ``backlash``. By position it is a play operator: the nut stays
where its friction keeps it. By tension the drive's force and the tendon's pull keep it taken up
(`cable_envs.effects.backlash.pulled_end`).

Linearly implicit trapezoidal steps, the drive first: order 2, through reversals too. One kernel: it
has the effects always.
"""

from cable_envs.core.kernels import clip, inline, maximum, select, sign
from cable_envs.core.lanes import Lanes
from cable_envs.effects import Layout
from cable_envs.effects.backlash import apart, pulled_end
from cable_envs.effects.own import advance_memory, own_actuate, own_cable, own_contact, own_load
from cable_envs.effects.presliding_hysteresis import share
from cable_envs.effects.seams import (
    actuate,
    begin,
    begin_friction,
    dry_friction,
    end,
    held_back,
    presliding_step,
    reported,
)
from cable_envs.effects.slow_creep import creeps_on
from cable_envs.effects.stiffness_hardening import hardened
from cable_envs.effects.stribeck_friction import excess_at
from cable_envs.physics.friction import ringing_inertia, ringing_lag, ringing_step
from cable_envs.physics.servo import placed
from cable_envs.plants.base import ActionMode, Plant, rows_of
from cable_envs.plants.peaks import peak_at_start
from cable_envs.plants.sheath.capstan import leaving, leaving_slope, mobilised, stuck_growth
from cable_envs.plants.sheath.parameters import (
    ACTING,
    COEFFICIENTS,
    PARAMETERS,
    SIGNALS,
    derive,
    resolves,
    settle,
)

STEP_Y, STEP_V = 1e-7, 1e-6
"""Steps of the differences that give the slopes of a user's own load, m and m/s."""

TENDON = Lanes("Tendon", [
    "end_before", "end_after", "end_speed", "end_speed_after",  # where the drive holds the tendon: m, m/s
    "end_lag",  # how far that counts as behind its mean in the middle of the step, m
    "short",  # how far the load falls short of its mean speed where it stops, m
    "mean", "rise", "elongation",  # Tm in the middle of the step (N); slope over Hooke's; elastic stretch, m
    "friction", "friction_growth",  # mu Theta, and its growth with |y'| (s/m)
    "resistance", "resistance_stiffness", "resistance_damping",  # of the load: N, N/m, N s/m
])  # fmt: skip
"""Scratch of a step."""


@inline
def _tension(p, e, s, w, i, stretch, rate):
    """Tm of a stretch (x - y) and its rate; keeps the elastic part and the slope."""
    elastic = stretch - e.slack_length[i] - s.creep_top[i]
    pull, rise = hardened(p.stiffness[i] * elastic, e.stiffness_hardening_coefficient[i])
    w.rise[i], w.elongation[i] = rise, maximum(elastic, 0.0)
    return select(elastic > 0.0, maximum(own_cable(pull, e, s, i) + p.tendon_damping[i] * rate, 0.0), 0.0)


@inline
def _resist(p, u, e, s, i, y, v, tension):
    """Force on the load against positive motion, besides dry friction."""
    own = own_load(y, v, tension, e, s, i)
    return p.load_preload[i] + p.load_stiffness[i] * y + p.load_damping[i] * v - u.disturbance[i] + own


@inline
def felt(x, p, u, e, s, i):
    """How the tension at the drive grows with its motion: stiffness and damping, none in a gap or where it is slack."""
    r = x.mobilised[i]
    grows = select(x.sliding[i] == 0.0, stuck_growth(r), leaving(-r))
    between = apart(u.mode[i] > 0.5, s.gap_position[i], x.drive_position[i], e.backlash_gap[i])
    held = select((x.drive_tension[i] > 0.0) & (not between), grows, 0.0)
    return held * p.stiffness[i], held * p.tendon_damping[i]


@inline
def load_onward(speed, ahead):
    """Speed with which the load counts as moving on to the middle of a step, in what the drive feels of its place.

    ``speed``: at the start; ``ahead``: in the middle.
    """
    return speed + (ahead - speed) / 3.0


@inline
def _pulled_speed(x, p, u, e, s, i, ahead, dt):
    """Speed after dt of a drive that is told its force; ``ahead`` is the load's speed in the middle of the step.

    How the tension grows with the drive's motion is solved with it: that is far quicker than a step.
    """
    speed, half = x.drive_velocity[i], 0.5 * dt
    k, c = felt(x, p, u, e, s, i)
    net = u.command[i] - p.drive_damping[i] * speed - x.drive_tension[i]
    net += c * (ahead - x.load_velocity[i]) - k * half * (speed - load_onward(x.load_velocity[i], ahead))
    return speed + dt * net / ringing_inertia(p.drive_mass[i], p.drive_damping[i] + c, k, dt)


@inline
def drive_speed(x, p, u, e, s, i, ahead, dt):
    """Speed of the drive after dt, and what it falls short where it stops; ``ahead``: as of `_pulled_speed`."""
    fastest = p.drive_speed_limit[i]
    by_place = placed(
        x.drive_position[i], x.drive_velocity[i], u.command[i], u.command_rate[i], p.servo_stiffness[i],
        p.servo_damping[i], p.drive_acceleration_limit[i], fastest, dt,
    )  # fmt: skip
    by_force = clip(_pulled_speed(x, p, u, e, s, i, ahead, dt), -fastest, fastest)
    return select(u.mode[i] > 0.5, by_force, by_place), 0.0


@inline
def _drive(x, p, u, w, e, s, g, i, dt):
    """Moves the drive, and with it the end of the tendon."""
    position, speed, half = x.drive_position[i], x.drive_velocity[i], 0.5 * dt
    net = x.load_tension[i] - _resist(p, u, e, s, i, x.load_position[i], x.load_velocity[i], x.load_tension[i])
    ahead = x.load_velocity[i] + half * held_back(g, i, net, x.load_velocity[i]) / p.load_mass[i]
    new, short = drive_speed(x, p, u, e, s, i, ahead, dt)
    follows = g.follows[i] > 0.5
    after = select(follows, g.target[i], position + half * (speed + new) - short)
    new = select(follows, g.target_rate[i], new)
    gap, before = e.backlash_gap[i], select(e.backlash_gap[i] > 0.0, s.gap_position[i], position)
    by_force = (u.mode[i] > 0.5) & (g.follows[i] < 0.5)
    w.end_lag[i] = select(follows | (select(by_force, 0.0, gap) > 0.0), 0.0, ringing_lag(new - speed, dt))
    w.end_before[i] = before
    w.end_after[i] = select(gap > 0.0, pulled_end(by_force, before, after, gap), after)
    w.end_speed[i] = (w.end_after[i] - before) / dt
    w.end_speed_after[i] = select((gap > 0.0) & (w.end_after[i] == before), 0.0, new)
    s.gap_position[i] = w.end_after[i]
    x.drive_position[i], x.drive_velocity[i] = after, new


@inline
def _rub(x, p, w, e, s, g, i, v, resist):
    """Friction of tendon and sheath at the load's speed: mu Theta, and its growth with the size of the speed."""
    extra, steep = excess_at(e.stribeck_friction_contact[i], e.stribeck_friction_velocity[i], v)
    towards = select(v == 0.0, w.mean[i] - resist, v)  # at rest: where it would break away to
    factor = g.factor[i] * (1.0 + e.asymmetric_friction_contact[i] * sign(towards))
    own = own_contact(x.load_position[i], v, x.drive_tension[i], x.load_tension[i], e, s, i)
    mu = (p.friction_coefficient[i] + extra) * factor + own
    w.friction[i], w.friction_growth[i] = mu * p.bend_angle[i], steep * factor * p.bend_angle[i]
    g.contact_excess[i] = extra * factor / maximum(mu, 1e-12)


@inline
def load_ahead(x, i, dt):
    """How far the load moves in half a step with the speed that it has."""
    return 0.5 * dt * x.load_velocity[i]


@inline
def load_slides(v, mass, up, down, stiffness, damping_up, damping_down, dt):
    """Speed of the load after a step, which may turn round within it, and what it falls short where it stops."""
    return ringing_step(v, mass, up, down, stiffness, damping_up, damping_down, dt)


@inline
def _middle(x, p, u, w, e, s, g, i, dt):
    """Forces on the load once the drive has gone half its way, and the load with the speed that it has."""
    y, v = x.load_position[i], x.load_velocity[i]
    ahead = y + load_ahead(x, i, dt)
    end = 0.5 * (w.end_before[i] + w.end_after[i]) - w.end_lag[i]
    w.mean[i] = _tension(p, e, s, w, i, end - ahead, w.end_speed[i] - v)
    at = _resist(p, u, e, s, i, y, v, x.load_tension[i])
    k = (_resist(p, u, e, s, i, y + STEP_Y, v, x.load_tension[i]) - at) / STEP_Y
    c = (_resist(p, u, e, s, i, y, v + STEP_V, x.load_tension[i]) - at) / STEP_V
    w.resistance[i], w.resistance_stiffness[i], w.resistance_damping[i] = at, maximum(k, 0.0), maximum(c, 0.0)
    _rub(x, p, w, e, s, g, i, v, at)


@inline
def _slide(x, p, w, e, s, g, i, dt):
    """Speed of the load after dt."""
    v, tm, a = x.load_velocity[i], w.mean[i], w.friction[i]
    taut, low = tm > 0.0, leaving(a)
    high, least = low + a, -p.load_mass[i] / dt  # falling friction drives; what is left must still resist
    dry_friction(e, g, i, v, p.load_friction[i], x.drive_tension[i])
    k = select(taut, p.stiffness[i] * w.rise[i], 0.0)
    whole = tm + k * load_ahead(x, i, dt)  # the step counts this motion in the tendon's stiffness
    up, down = whole * low - w.resistance[i] - g.up[i], whole * high - w.resistance[i] + g.down[i]
    c = select(taut, p.tendon_damping[i], 0.0)
    grows_up, grows_down = tm * leaving_slope(a), tm * leaving_slope(-a)
    damping = w.resistance_damping[i] + g.steep[i]
    damping_up = maximum(damping + c * low - grows_up * w.friction_growth[i], least)
    damping_down = maximum(damping + c * high - grows_down * w.friction_growth[i], least)
    stiffness = w.resistance_stiffness[i] + k * select(select(v == 0.0, up, v) > 0.0, low, high)
    sliding, w.short[i] = load_slides(v, p.load_mass[i], up, down, stiffness, damping_up, damping_down, dt)
    part = share(s.presliding, i)
    r = (2.0 * part - 1.0) * a
    beside, steeper = tm * (leaving(r) - high + part * a), tm * (2.0 * a * leaving_slope(r) + a)
    return presliding_step(
        e, s, g, i, v, p.load_mass[i], up, down, sliding, w.resistance_stiffness[i] + k * high, -k * a, damping_up,
        damping_down, dt, 0.5, beside, steeper, -1.0, 2.0 * g.excess[i] + tm * a * g.contact_excess[i],
    )  # fmt: skip


@inline
def _report(x, p, u, w, e, s, g, i):
    """Tensions of the new state, and the friction that is mobilised between them."""
    y, v, a = x.load_position[i], x.load_velocity[i], w.friction[i]
    tm = _tension(p, e, s, w, i, w.end_after[i] - y, w.end_speed_after[i] - v)
    low = leaving(a)
    held = clip(_resist(p, u, e, s, i, y, v, x.load_tension[i]), tm * low, tm * (low + a))
    r = select(tm > 0.0, mobilised(held / select(tm > 0.0, tm, 1.0), a), 0.0)
    r = select(v > 0.0, a, select(v < 0.0, -a, r))
    r = reported(e, g, i, r, (2.0 * share(s.presliding, i) - 1.0) * a)
    out = tm * leaving(r)
    x.load_tension[i] = out
    x.drive_tension[i] = out + r * tm
    x.mobilised[i], x.sliding[i] = r, sign(v)
    x.slack_fraction[i] += select(tm <= 0.0, 1.0, 0.0)
    x.peak_tension[i] = maximum(x.peak_tension[i], x.drive_tension[i])


@inline
def _step(x, p, u, w, e, s, g, i, dt):
    _drive(x, p, u, w, e, s, g, i, dt)
    _middle(x, p, u, w, e, s, g, i, dt)
    v, elastic = x.load_velocity[i], w.elongation[i]
    new = _slide(x, p, w, e, s, g, i, dt)
    short = select(new == 0.0, w.short[i], 0.0)
    x.load_position[i], x.load_velocity[i] = x.load_position[i] + 0.5 * dt * (v + new) - short, new
    w.friction[i] = maximum(w.friction[i] + w.friction_growth[i] * (abs(new) - abs(v)), 0.0)
    creeps_on(s.creep_top, s.slow_creep_top, e, i, elastic, g.creep_left[i], g.slow_left[i])
    _report(x, p, u, w, e, s, g, i)


@inline
def _solve(x, p, u, w, e, s, g, lanes, substeps, dt):
    for i in range(lanes):
        begin(
            e, s, g, u, i, x.drive_position[i], x.drive_velocity[i], x.load_position[i], x.load_velocity[i],
            substeps * dt, dt,
        )  # fmt: skip
        begin_friction(e, g, i)
        dry_friction(e, g, i, x.load_velocity[i], p.load_friction[i], x.drive_tension[i])
        x.slack_fraction[i], x.out_of_range[i] = 0.0, 0.0
        x.peak_tension[i] = peak_at_start(x.drive_tension[i])
    for n in range(substeps):
        for i in range(lanes):
            actuate(e, s, g, u, i, n, substeps, dt)
            u.command[i] = own_actuate(u.command[i], x.drive_position[i], x.drive_velocity[i], e, s, i)
        for i in range(lanes):
            _step(x, p, u, w, e, s, g, i, dt)
            advance_memory(
                u.command[i], x.drive_position[i], x.drive_velocity[i], x.load_position[i], x.load_velocity[i],
                x.drive_tension[i], x.load_tension[i], e, s, i,
            )  # fmt: skip
            s.started[i] = 1.0
    for i in range(lanes):
        x.slack_fraction[i] /= substeps
        end(e, s, g, i, x.load_position[i], substeps * dt)


PLANT = Plant(
    name="tendon_sheath",
    parameters=PARAMETERS,
    signals=SIGNALS,
    signal_rows=rows_of(SIGNALS),
    coefficient_rows=COEFFICIENTS,
    scratch=TENDON,
    action_modes=(
        ActionMode("position", "m", "drive_position_limit", rest_signal="drive_position"),
        ActionMode("tension", "N", "tension_command_limit", one_sided=True, rest_signal="drive_tension"),
    ),
    derive=derive,
    settle=settle,
    solve=_solve,
    effects=Layout("tendon_sheath", PARAMETERS, ACTING),
    resolves=resolves,
    plain=False,
    replays=("follow",),
)
