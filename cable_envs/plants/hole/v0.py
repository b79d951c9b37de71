"""The single hole as the ids ``-v0`` have it, kept so that their boards can be replayed to the last digit.

It differs from `cable_envs.plants.hole.plant` in what that one mends:

- the drive's inner loop predicts the load's speed from the forces at the start of the step, so that light loads need
  far shorter steps than heavy ones;
- the tension behind the hole comes from n extrapolated over the step in a straight line, which leaves the contact's law
  where n grows steeply with the speed;
- in the middle of a step the drive has moved on and the load has not, so that a cable that goes out under a small
  tension counts as slack there;
- a gap of the drive, however small, opens the inner loop for a whole step at each reversal.
"""

from dataclasses import replace

from cable_envs.core.compiling.templates import specialised
from cable_envs.core.errors import ConfigurationError
from cable_envs.core.kernels import inline, maximum, select
from cable_envs.effects.own import advance_memory, own_actuate
from cable_envs.effects.seams import actuate, begin, begin_friction, dry_friction, end, held_back
from cable_envs.physics.friction import no_way, stick_slip_whole
from cable_envs.plants.base import Plant
from cable_envs.plants.hole.drive import carried, closed_loop, limited, open_loop, stiffness_now
from cable_envs.plants.hole.parameters import SIGNALS
from cable_envs.plants.hole.plant import behind, load_behind, load_resistance, pulled_midway, rubbed, slipped
from cable_envs.plants.hole.spool import engaged
from cable_envs.plants.hole.stages import any_stiff, ratio, take_hole, wrapped


@inline
def _ahead(x, p, u, e, s, g, i, dt):
    """Speed of the load at the end of the step, from the balance of forces at its start (zero where it sticks)."""
    y, v, tension = x.load_position[i], x.load_velocity[i], x.load_tension[i]
    net = tension - load_resistance(p, u, e, s, i, y, v, tension)
    if e is not None:
        net = held_back(g, i, net, v)
    return v + dt * (1.0 / p.load_mass[i]) * net


@inline
def _hauled(x, p, u, w, e, s, g, i, dt):
    """The drive, whose inner loop takes the load's speed as `_ahead` predicts it."""
    old, wanted = x.drive_velocity[i], open_loop(x, p, u, i)
    late, gain = w.loop_late[i], w.loop_gain[i]
    loop = (wanted + late * (x.load_velocity[i] - old) + gain * _ahead(x, p, u, e, s, g, i, dt)) * w.loop_closed[i]
    loop = select(x.drive_tension[i] > 0.0, loop, wanted)
    if e is not None:
        loop = select(engaged(e, s, i, x.drive_position[i], wanted), loop, wanted)
    asked = select(u.mode[i] > 0.5, u.command[i], loop)
    carried(x, w, e, s, g, i, limited(p, i, old, asked, dt), dt)


@inline
def _straight(w, e, i, v, v_new):
    """n at the new speed in a straight line from the old one."""
    n = w.ratio[i] + w.ratio_slope[i] * w.friction_growth[i] * (abs(v_new) - abs(v))
    if e is not None:
        n = select(w.friction_growth[i] < 0.0, maximum(n, 1.0), n)
    return n


@inline
def _moves_all_along(before, middle):
    """In the place of `broken_away`: a mass moves from the start of the step, or not at all."""
    return middle, 1.0


@inline
def _in_the_middle(x, w, i):
    """In the place of `at_start`: the tension in the middle of the first step."""
    return w.tension_middle[i]


@inline
def _no_later(w, i, v, mass, damping, stiffness, share, k, c, early, dt):
    """In the place of `later`: forces act in the middle of the step."""
    return 0.0


@inline
def _solve(x, p, u, w, e, s, g, lanes, substeps, dt):
    """A block of columns, stage by stage."""
    bends = any_stiff(p, lanes)
    for i in range(lanes):
        take_hole(p, w, i)
    for i in range(lanes):
        closed_loop(p, w, i, p.cable_stiffness[i], dt)
        x.slack_fraction[i] = 0.0
        x.peak_tension[i] = 0.0
        x.out_of_range[i] = 0.0
        if e is not None:
            begin(
                e, s, g, u, i, x.drive_position[i], x.drive_velocity[i], x.load_position[i], x.load_velocity[i],
                substeps * dt, dt,
            )  # fmt: skip
            begin_friction(e, g, i)
            dry_friction(e, g, i, x.load_velocity[i], e.coulomb_friction_level[i], x.drive_tension[i])
    for n in range(substeps):
        if e is not None:
            for i in range(lanes):
                actuate(e, s, g, u, i, n, substeps, dt)
                u.command[i] = own_actuate(u.command[i], x.drive_position[i], x.drive_velocity[i], e, s, i)
                closed_loop(p, w, i, stiffness_now(x, p, e, i), dt)
        for i in range(lanes):
            _hauled(x, p, u, w, e, s, g, i, dt)
        for i in range(lanes):
            load_behind(x, p, u, w, e, s, i)
        for i in range(lanes):
            pulled_midway(x, p, u, w, e, s, g, i, 0.0)
            rubbed(x, p, w, e, s, g, i, x.load_velocity[i], w.tension_middle[i])
        wrapped(x, p, w, lanes, bends)
        for i in range(lanes):
            ratio(w, i)
        for i in range(lanes):
            slipped(x, p, u, w, e, s, g, i, 0.0, dt)
            behind(x, p, u, w, e, s, g, i)
            if e is not None:
                advance_memory(
                    u.command[i], x.drive_position[i], x.drive_velocity[i], x.load_position[i], x.load_velocity[i],
                    x.drive_tension[i], x.load_tension[i], e, s, i,
                )  # fmt: skip
    for i in range(lanes):
        x.slack_fraction[i] /= substeps
        if e is not None:
            end(e, s, g, i, x.load_position[i], substeps * dt)


_SOLVE = specialised(
    _solve, extrapolated=_straight, load_slides=stick_slip_whole, ringing_lag=no_way, later=_no_later,
    broken_away=_moves_all_along, at_start=_in_the_middle,
)  # fmt: skip


def as_v0(plant: Plant) -> Plant:
    """The plant with the kernel of the ids ``-v0``; ConfigurationError for several holes, which these never had."""
    if len(plant.signals) > len(SIGNALS):
        raise ConfigurationError("several holes in series belong to the ids -v1: those of -v0 have one hole")
    return replace(plant, version="v0", solve=_SOLVE, resolves=None, ranges=())
