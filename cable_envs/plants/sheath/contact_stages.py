"""Pieces of the kernel of a sheath with contacts: what a step hands to the sweeps, the ends, what is reported.

`cable_envs.plants.sheath.contacts` has the equations and the symbols, `cable_envs.physics.sweeps` the solver. In what
follows w is the scratch of both; e, s and g are None without effects.
"""

from cable_envs.core.kernels import clip, exp, inline, log, maximum, select, sign
from cable_envs.core.lanes import Lanes
from cable_envs.effects.backlash import pulled_end
from cable_envs.effects.own import own_cable, own_contact, own_load
from cable_envs.effects.seams import dry_friction
from cable_envs.effects.slow_creep import creeps_on
from cable_envs.effects.stiffness_hardening import hardened
from cable_envs.effects.stribeck_friction import excess_at
from cable_envs.physics.friction import in_time
from cable_envs.physics.servo import placed
from cable_envs.physics.sweeps import sweep_fields

STEP_Y, STEP_V = 1e-7, 1e-6
"""Steps of the differences that give the slopes of a user's own load, m and m/s."""


def scratch(contacts: int) -> Lanes:
    """Scratch of the plant with so many contacts."""
    return Lanes("SheathWithContacts", [
        *sweep_fields(contacts),
        "stiffness", "damped",  # of an inner span, N/m; its damping over the step's length as a share of that
        "instant",  # share of the step after which the tensions are those that are solved for
        "lost",  # slack and creep of the whole tendon, m
        "reach", "give", "low", "high", "placed",  # the drive's line and limits, m; its speed where it is at a place
        "ahead", "back",  # how far it moves within its gap before the tendon does, m
        "base", "held", "rub_up", "rub_down", "halfway",  # of the load: line, friction over its slope, dt v / 2, m
    ])  # fmt: skip


@inline
def limits(x, p, u, w, e, s, g, i):
    """Limits of the tension ratios at every contact, for the present bend."""
    contacts = x.slip_position.shape[0]
    bend = maximum(p.bend_angle[i] + u.posture[i], 0.0)
    up = down = p.friction_coefficient[i]
    if e is not None:
        v = x.load_velocity[i]
        extra, _ = excess_at(e.stribeck_friction_contact[i], e.stribeck_friction_velocity[i], v)
        mu, skew = (up + extra) * g.factor[i], e.asymmetric_friction_contact[i]
        own = own_contact(x.load_position[i], v, x.drive_pull[i], x.load_pull[i], e, s, i)
        up, down = mu * (1.0 + skew) + own, mu * (1.0 - skew) + own
    each = bend / contacts
    w.up[i], w.down[i] = exp(maximum(up, 0.0) * each), exp(maximum(down, 0.0) * each)
    w.per_up[i], w.per_down[i] = 1.0 / w.up[i], 1.0 / w.down[i]
    x.bend[i] = bend


@inline
def end_share(mass, stiffness, dt):
    """Weight of the end of the step in the force on an end: a half, and more where its span shakes it too quickly."""
    return clip(1.0 - mass / (stiffness * dt * dt), 0.5, 1.0)


@inline
def rings(mass, p, w, contact, i, dt):
    """The inertia of an end with which its step is in time on its own span, where the contact next to it rests."""
    contacts = w.way.shape[0]
    stiffness = select(w.way[contact, i] == 0.0, 2.0 * contacts * p.stiffness[i], p.stiffness[i])
    return in_time(mass, stiffness, dt)


@inline
def weight(w, i):
    """Weight in the mean of a step of tensions that are ``instant`` in it: a straight line has the mean amid the step.

    The line begins where the step before had its tensions.
    """
    return 1.5 - w.instant[i]


@inline
def room(by_force, nut, position, gap):
    """How far a drive goes either way before it takes the nut along, m; what the tendon pulls it takes at once."""
    ahead, back = nut + 0.5 * gap - position, position - nut + 0.5 * gap
    return select(by_force, 0.0, ahead), select(by_force, 0.0, back)


@inline
def drive_row(x, p, u, w, e, s, g, i, dt):
    """How far the drive goes: its servo's way, or that of an inertia which the tension holds back."""
    contacts = x.slip_position.shape[0]
    position, speed, half = x.drive_position[i], x.drive_velocity[i], 0.5 * dt
    fastest = p.drive_speed_limit[i]
    new = placed(
        position, speed, u.command[i], u.command_rate[i], p.servo_stiffness[i], p.servo_damping[i],
        p.drive_acceleration_limit[i], fastest, dt,
    )  # fmt: skip
    late, mass = (
        end_share(p.drive_mass[i], 2.0 * contacts * p.stiffness[i], dt),
        rings(p.drive_mass[i], p, w, 0, i, dt) / dt,
    )
    late = maximum(late, weight(w, i))
    per = half / (mass + 0.5 * p.drive_damping[i])
    by_force = u.mode[i] > 0.5
    pulled = (u.command[i] + 2.0 * mass * speed - (1.0 - late) * x.drive_pull[i]) * per
    way = half * (speed + new)
    if e is not None:
        follows, gap = g.follows[i] > 0.5, e.backlash_gap[i]
        by_force = by_force & (g.follows[i] < 0.5)
        new, way = select(follows, g.target_rate[i], new), select(follows, g.target[i] - position, way)
        nut = select(gap > 0.0, s.gap_position[i], position)
        w.ahead[i], w.back[i] = room(by_force, nut, position, gap)
    w.placed[i] = new
    w.reach[i], w.give[i] = select(by_force, pulled, way), select(by_force, late * per, 0.0)
    w.low[i] = select(by_force, half * (speed - fastest), way)
    w.high[i] = select(by_force, half * (speed + fastest), way)
    w.drive_reach[i], w.drive_give[i], w.drive_state[i] = w.reach[i], w.give[i], 0.0


@inline
def drive_end(x, w, e, s, i, c, r):
    """The drive's end against T_0 c = r + d_0: within its gap, moving the tendon, or at its largest speed."""
    reach, give = w.reach[i], w.give[i]
    off, moves, side = 0.0, 1.0, 0.0
    if e is not None:
        still = reach - give * maximum(r, 0.0) / c
        side = select(still > w.ahead[i], 1.0, select(still < -w.back[i], -1.0, 0.0))
        side = select(w.ahead[i] + w.back[i] > 0.0, side, 2.0)
        moves = select(side == 0.0, 0.0, 1.0)
        off = select(side == 1.0, w.ahead[i], select(side == -1.0, -w.back[i], 0.0))
    free = reach - off
    d = free - give * maximum(r + free, 0.0) / (c + give)
    end = clip(d, w.low[i] - off, w.high[i] - off)
    at = select(d > end, 1.0, select(d < end, -1.0, 0.0))
    w.drive_reach[i] = moves * select(at == 0.0, free, end)
    w.drive_give[i] = moves * select(at == 0.0, give, 0.0)
    return 4.0 * side + at


@inline
def drive_way(x, w, g, i, tension, dt):
    """(way of the drive against the tension at its end, its speed behind the step)."""
    d = clip(w.reach[i] - w.give[i] * tension, w.low[i], w.high[i])
    return d, select(w.low[i] < w.high[i], 2.0 * d / dt - x.drive_velocity[i], w.placed[i])


@inline
def drive_shows(x, p, w, i):
    """What a drive with a motor has to tell behind the step; an ideal one has nothing."""


@inline
def load_row(x, p, u, w, e, s, g, i, dt):
    """The load's line: inertia, spring and damper, and its own dry friction."""
    contacts = x.slip_position.shape[0]
    y, v = x.load_position[i], x.load_velocity[i]
    resist = p.load_preload[i] + p.load_stiffness[i] * y - u.disturbance[i]
    k, c, up, down = p.load_stiffness[i], p.load_damping[i], p.load_friction[i], p.load_friction[i]
    if e is not None:
        behind = x.load_pull[i]
        dry_friction(e, g, i, v, p.load_friction[i], x.drive_pull[i])
        at = own_load(y, v, behind, e, s, i)
        stiff = maximum((own_load(y + STEP_Y, v, behind, e, s, i) - at) / STEP_Y, 0.0)
        thick = maximum((own_load(y, v + STEP_V, behind, e, s, i) - at) / STEP_V, 0.0)
        slowed = maximum(c + thick + g.steep[i], -p.load_mass[i] / dt)
        resist, k, c = resist + at - (slowed - c) * v, k + stiff, slowed
        up, down = g.up[i], g.down[i]
    late = end_share(p.load_mass[i], 2.0 * contacts * p.stiffness[i], dt)
    mass = 2.0 * rings(p.load_mass[i], p, w, contacts - 1, i, dt) / dt
    late = maximum(late, weight(w, i))
    per = 1.0 / ((mass + c) / dt + 0.5 * k)
    w.base[i], w.held[i] = (mass * v + (1.0 - late) * x.load_pull[i] - resist) * per, late * per
    w.rub_up[i], w.rub_down[i], w.halfway[i] = up * per, down * per, 0.5 * dt * v
    w.load_state[i] = select((up > 0.0) | (down > 0.0), sign(v), 1.0)
    w.load_reach[i] = w.base[i] - select(v > 0.0, w.rub_up[i], select(v < 0.0, -w.rub_down[i], 0.0))
    w.load_give[i] = w.held[i]


@inline
def load_end(x, w, e, s, i, c, r):
    """The load's end against T_N c = r - d: its friction lets it move up, down, or stops it."""
    give, half = w.held[i], w.halfway[i]
    up, down = w.base[i] - w.rub_up[i], w.base[i] + w.rub_down[i]
    rises = up + give * maximum(r - up, 0.0) / (c + give) > half
    falls = down + give * maximum(r - down, 0.0) / (c + give) < half
    state = select(rises & (half >= 0.0), 1.0, select(falls & (half <= 0.0), -1.0, 0.0))
    state = select((w.rub_up[i] > 0.0) | (w.rub_down[i] > 0.0), state, 1.0)
    w.load_reach[i] = select(state > 0.0, up, select(state < 0.0, down, half))
    w.load_give[i] = select(state == 0.0, 0.0, give)
    return state


@inline
def load_stays(x, w, e, s, i):
    """Whether the load's friction is as its motion and tension have it."""
    state, d, half = w.load_state[i], w.slip[x.slip_position.shape[0] + 1, i], w.halfway[i]
    push = w.held[i] * w.tension[x.slip_position.shape[0], i]
    rises, falls = (w.base[i] - w.rub_up[i] + push > half), (w.base[i] + w.rub_down[i] + push < half)
    stopped = (half > 0.0) & (not rises) | (half < 0.0) & (not falls) | (half == 0.0) & (not rises) & (not falls)
    moves = (state > 0.0) & (d > half) & (half >= 0.0) | (state < 0.0) & (d < half) & (half <= 0.0)
    free = (w.rub_up[i] <= 0.0) & (w.rub_down[i] <= 0.0)
    return free | moves | (state == 0.0) & stopped


@inline
def spans_of(x, p, w, e, s, i, dt):
    """What all spans of a tendon have in common.

    A span of stiffness k and damping c takes c / k to follow its tension. The tensions that are solved for are those
    that much before the end of the step, but not before its middle: then what grows evenly is followed exactly, and the
    step is of order 2 however short that time is.
    """
    contacts = x.slip_position.shape[0]
    w.stiffness[i], w.damped[i] = contacts * p.stiffness[i], p.tendon_damping[i] / (p.stiffness[i] * dt)
    w.instant[i], w.lost[i] = maximum(1.0 - w.damped[i], 0.5), 0.0
    if e is None:
        c = 1.0 / (w.stiffness[i] * (w.instant[i] + w.damped[i]))
        ends = 1.0 / (2.0 * w.stiffness[i] * (w.instant[i] + w.damped[i]))
        for j in range(contacts + 1):
            w.compliance[j, i] = ends if (j == 0) | (j == contacts) else c
    else:
        w.lost[i] = e.slack_length[i] + s.creep_top[i]


@inline
def _span(w, e, s, j, i, stretch, halves, contacts):
    """A span of a stretch; at an end it is half as long as the others. Its damper acts where it is taut."""
    k, rise = halves * w.stiffness[i], 1.0
    if e is not None:
        stretch = stretch - w.lost[i] / (halves * contacts)
        pull, rise = hardened(k * maximum(stretch, 0.0), e.stiffness_hardening_coefficient[i])
        pull, c = own_cable(pull, e, s, i), 1.0 / (k * (w.instant[i] * rise + w.damped[i]))
        w.compliance[j, i] = c
    else:
        pull, c = k * stretch, w.compliance[j, i]
    w.taken[j, i] = select(stretch > 0.0, pull * c, stretch)


@inline
def first_span(x, w, e, s, j, i):
    """The span behind the drive, or behind its gap."""
    end = x.drive_position[i]
    if e is not None:
        end = select(e.backlash_gap[i] > 0.0, s.gap_position[i], end)
    _span(w, e, s, j, i, end - x.slip_position[0, i], 2.0, x.slip_position.shape[0])


@inline
def inner_span(x, w, e, s, j, i):
    """The span between contacts j and j + 1."""
    stretch = x.slip_position[j - 1, i] - x.slip_position[j, i]
    _span(w, e, s, j, i, stretch, 1.0, x.slip_position.shape[0])


@inline
def last_span(x, w, e, s, j, i):
    """The span before the load."""
    stretch = x.slip_position[j - 1, i] - x.load_position[i]
    _span(w, e, s, j, i, stretch, 2.0, x.slip_position.shape[0])


@inline
def moved(x, p, u, w, e, s, g, i, dt):
    """Both ends after the step."""
    contacts = x.slip_position.shape[0]
    before, behind = w.tension[0, i], w.tension[contacts, i]
    d, speed = drive_way(x, w, g, i, before, dt)
    if e is not None:
        whole = select(e.backlash_gap[i] > 0.0, s.gap_position[i], x.drive_position[i])
        elongation = maximum(whole - x.load_position[i] - w.lost[i], 0.0)
        creeps_on(s.creep_top, s.slow_creep_top, e, i, elongation, g.creep_left[i], g.slow_left[i])
    x.drive_velocity[i] = speed
    x.drive_position[i] += d
    if e is not None:
        gap = e.backlash_gap[i]
        by_force = (u.mode[i] > 0.5) & (g.follows[i] < 0.5)
        nut = pulled_end(by_force, s.gap_position[i], x.drive_position[i], gap)
        s.gap_position[i] = select(gap > 0.0, nut, x.drive_position[i])
    x.load_position[i] += w.slip[contacts + 1, i]
    x.load_velocity[i] = select(w.load_state[i] == 0.0, 0.0, 2.0 * w.slip[contacts + 1, i] / dt - x.load_velocity[i])
    x.drive_tension[i] = x.drive_pull[i] = before
    x.load_tension[i] = x.load_pull[i] = behind
    drive_shows(x, p, w, i)
    x.slack_fraction[i] += select(before <= 0.0, 1.0, 0.0)
    x.peak_tension[i] = maximum(x.peak_tension[i], before)


@inline
def at_speeds(x, w, i, dt):
    """Both ends go on at their speeds for dt, whatever pulls."""
    drive, load = dt * x.drive_velocity[i], dt * x.load_velocity[i]
    w.reach[i] = w.low[i] = w.high[i] = w.drive_reach[i] = drive
    w.give[i] = w.drive_give[i] = 0.0
    w.base[i] = w.load_reach[i] = load
    w.held[i] = w.rub_up[i] = w.rub_down[i] = w.load_give[i] = w.halfway[i] = 0.0
    w.drive_state[i], w.load_state[i] = 0.0, 1.0


@inline
def shown_tensions(x, w, i):
    """The tensions at the ends are those that have been solved for."""
    x.drive_tension[i], x.load_tension[i] = w.tension[0, i], w.tension[x.slip_position.shape[0], i]


@inline
def report(x, w, i, substeps):
    """What is only told at the end of a control step."""
    contacts = x.slip_position.shape[0]
    taut = (x.drive_tension[i] > 0.0) & (x.load_tension[i] > 0.0)
    ratio = select(taut, x.drive_tension[i] / select(taut, x.load_tension[i], 1.0), 1.0)
    x.mobilised[i] = log(ratio)
    x.sliding[i] = sign(x.slip_velocity[contacts - 1, i])
    x.slack_fraction[i] /= substeps
