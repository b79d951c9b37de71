"""Closed cable-pulley circuit as a chain: the mechanism behind Fig. 6 of Zou et al. 2022.

Each side is five elastic spans joined by four friction contacts (`cable_envs.physics.chain`); the slip front after a
reversal travels from idler to idler, so that delay, transition and working phases emerge and are reported.

    spans      EA de_0 = R0 dtheta_in - slip_1, ..., EA de_4 = slip_4 - R5 dtheta_out   (cable t; cable b mirrored)
    contacts   1/lambda_i <= T_{i-1}/T_i <= lambda_i, the ratios of the closed forms (Z12, Z30); massless cable
    arcs       a slip arc stretches like w (T_{i-1} + T_i), w = R Phi / (1 + lambda): exactly Z16 when it slides, in
               both directions; l_j is the free length and the two w beside it
    torques    M_in = R0 (T_0t - T_0b), M_out = R5 (T_4t - T_4b)                                            Z32, Z33

Time step: half a step of motion, equilibrium of both chains there, the velocities by linearly implicit kicks with the
chain's own tangents, the other half step: order 2 where nothing starts or stops. Each end feels within the step,
through the damping of the cables, how the other changes its speed. The signals show the equilibrium at the end of a
control step.

phase: 0 rest: the drive stands and no contact next to the output slid within the control step; 1 delay: the front has
reached the output on neither side; 2 transition: on one; 3 working: on both (a slack side counts as arrived).
"""

from dataclasses import replace

import numpy as np

from cable_envs.core.kernels import inline, maximum, minimum, select
from cable_envs.core.lanes import Lanes
from cable_envs.effects import Layout
from cable_envs.effects.lanes import STEP
from cable_envs.effects.own import advance_memory, own_actuate, own_load
from cable_envs.effects.seams import actuate, any_builds_up, begin, begin_friction, dry_friction, end
from cable_envs.physics.chain import CONTACTS, RELEASE, SPANS
from cable_envs.physics.friction import ringing_way
from cable_envs.plants.base import Plant, Signal
from cable_envs.plants.circuit.chain_sides import bottom_side, equilibrium, top_side, wind, worn
from cable_envs.plants.circuit.effects import (
    ACTING,
    any_apart,
    any_creeps,
    any_hardens,
    output_slides,
    output_step,
    spring,
)
from cable_envs.plants.circuit.ends import (
    ACTION_MODES,
    COEFFICIENTS,
    SIGNALS,
    STILL,
    cosine,
    drive_step,
    largest,
    load_torque,
    moving,
    raised,
    resolved,
    rest_elongation,
    settle_ends,
    shared_coefficients,
)  # fmt: skip
from cable_envs.plants.circuit.parameters import CIRCUIT, SIDES
from cable_envs.plants.circuit.statics import Statics
from cable_envs.plants.peaks import peak_at_start

_CHAIN = tuple(
    signal
    for side in SIDES
    for signal in (
        *(Signal(f"stretch_{side}_{j}", "N m", f"EA times the elongation of span {j}, cable {side[0]}")
          for j in range(SPANS)),
        *(Signal(f"slip_{side}_{k}", "1", f"contact {k}, cable {side[0]}: 1 slides to the drive, -1 to the output")
          for k in range(1, CONTACTS + 1)),
    )
)  # fmt: skip
SIGNAL_ROWS = Lanes("Signals", [
    *(signal.name for signal in SIGNALS),
    *(field for side in SIDES for field in ((f"stretch_{side}", SPANS), (f"slip_{side}", CONTACTS))),
])  # fmt: skip
ROWS = Lanes("Coefficients", [
    *COEFFICIENTS,
    *(field for side in SIDES for field in (
        (f"length_{side}", SPANS), (f"ratio_{side}", CONTACTS), (f"inverse_{side}", CONTACTS),
        (f"small_{side}", CONTACTS),
    )),
])  # fmt: skip
SCRATCH = Lanes("Scratch", [
    *(field for side in SIDES for field in (
        (f"pull_{side}", SPANS), (f"tension_{side}", SPANS), f"tangent_0_{side}", f"tangent_4_{side}",
        f"pending_{side}",
        f"arrived_{side}",  # 1 once the slip front has reached the output within the control step
    )),
    "turned_in", "turned_out",  # motion of the two ends since the last equilibrium, rad
])  # fmt: skip
STEP_ROWS = Lanes("Step", [*STEP, "turn", "turns"])
"""Besides what all plants have: the pulley's turn since the last equilibrium, and how it turns with the drive."""
OF_EFFECTS = tuple(
    field for side in SIDES for field in ((f"worn_ratio_{side}", CONTACTS), (f"plain_length_{side}", SPANS))
)
"""Rows behind those of the effects: the tension ratios with all friction drifted, and the lengths of the spans without
tension."""
STEP_ANGLE, STEP_RATE = 1e-7, 1e-6
"""Steps of the differences that give the slopes of a user's own load, rad and rad/s."""
# In what follows e, s (their states) and g are None without effects.


@inline
def _watch(x, p, w, e, i):
    """What the control step has seen of the tensions."""
    t0, t4, b0, b4 = w.tension_top[0, i], w.tension_top[4, i], w.tension_bottom[0, i], w.tension_bottom[4, i]
    if e is not None:
        x.drive_torque[i] = p.drive_radius[i] * (t0 - b0)
    x.slack_fraction[i] += select(minimum(t0, b0) <= 0.0, 1.0, 0.0)
    x.peak_tension[i] = maximum(maximum(maximum(t0, t4), maximum(b0, b4)), x.peak_tension[i])


@inline
def passes(slips, i):
    """1 where all contacts of a side slide, so that each end feels the motion of the other; else 0."""
    through = 1.0
    for k in range(CONTACTS):
        through *= abs(slips[k, i])
    return through


@inline
def _kick(x, p, u, w, e, s, g, i, dt, builds):
    """Velocities of drive and output from the tensions in the middle of the step; its second half of motion."""
    v_in, v = x.drive_velocity[i], x.output_velocity[i]
    r5, ea_in, ea_out = (
        p.output_radius[i],
        p.stretch_stiffness[i] * p.gear[i] * p.drive_radius[i],
        p.stretch_stiffness[i] * p.output_radius[i],
    )
    late = p.stretch_damping[i] / p.stretch_stiffness[i]
    torque = p.drive_radius[i] * (w.tension_top[0, i] - w.tension_bottom[0, i])
    tangent = ea_in * (w.tangent_0_top[i] + w.tangent_0_bottom[i])
    if e is not None:
        torque, tangent = g.turns[i] * torque, g.turns[i] * tangent

    half = x.output_angle[i] + 0.5 * dt * v
    wanted, load_k, load_c = load_torque(p, u, i, half, v, cosine(half))
    if e is not None:
        tension = w.tension_top[4, i] + w.tension_bottom[4, i]
        dry_friction(e, g, i, v, p.brake_torque[i], r5 * tension)
        wanted, load_k = spring(e, i, half, wanted, load_k)
        at = own_load(half, v, tension, e, s, i)
        k = (own_load(half + STEP_ANGLE, v, tension, e, s, i) - at) / STEP_ANGLE
        c = (own_load(half, v + STEP_RATE, tension, e, s, i) - at) / STEP_RATE
        wanted, load_k, load_c = wanted + at, load_k + maximum(k, 0.0), load_c + maximum(c, 0.0)
    net = r5 * (w.tension_top[4, i] - w.tension_bottom[4, i]) - wanted
    at_output = ea_out * (w.tangent_4_top[i] + w.tangent_4_bottom[i])
    stiffness, damping = at_output + load_k, late * at_output + load_c

    # what one end feels of the other's change of speed within the step
    top, bottom = passes(x.slip_top, i), passes(x.slip_bottom, i)
    up, down = net - p.brake_torque[i], net + p.brake_torque[i]
    if e is not None:
        up, down = net - g.up[i], net + g.down[i]
    change = dt * moving(v, up, down) / (p.output_inertia[i] + 0.5 * dt * (damping + 0.5 * dt * stiffness))
    felt = p.drive_radius[i] * (top * w.tangent_0_top[i] + bottom * w.tangent_0_bottom[i])
    firm = 0.5 * p.stretch_damping[i] + p.stretch_stiffness[i] * ringing_way(1.0, dt)
    torque -= firm * felt * change
    v_in_new, short_in = drive_step(x, p, u, g, i, torque, tangent, late * tangent, dt)
    felt = r5 * (top * w.tangent_4_top[i] + bottom * w.tangent_4_bottom[i])
    net += firm * p.gear[i] * felt * (v_in_new - v_in)

    net += 0.5 * dt * stiffness * v  # the forces are those of the predicted middle already
    if e is not None:
        v_new, short = output_step(
            e, s, g, i, v, p.output_inertia[i], net, net, 0.0, 0.0, stiffness, damping, damping, dt, builds
        )
    else:
        v_new, short = output_slides(
            v, p.output_inertia[i], net - p.brake_torque[i], net + p.brake_torque[i], stiffness, damping, damping, dt
        )

    x.drive_angle[i] += 0.5 * dt * (v_in + v_in_new) - short_in
    x.output_angle[i] += 0.5 * dt * (v + v_new) - short
    x.drive_velocity[i], x.output_velocity[i] = v_in_new, v_new
    w.turned_in[i], w.turned_out[i] = 0.5 * dt * v_in_new - short_in, 0.5 * dt * v_new - short
    if e is not None:
        x.drive_angle[i] = select(g.follows[i] > 0.5, g.target[i], x.drive_angle[i])
        advance_memory(
            u.command[i], x.drive_angle[i], x.drive_velocity[i], x.output_angle[i], x.output_velocity[i],
            tension, tension, e, s, i,
        )  # fmt: skip


@inline
def _report(x, p, w, i):
    t0, t4, b0, b4 = w.tension_top[0, i], w.tension_top[4, i], w.tension_bottom[0, i], w.tension_bottom[4, i]
    x.tension_drive_top[i], x.tension_output_top[i], x.tension_drive_bottom[i], x.tension_output_bottom[i] = (
        t0,
        t4,
        b0,
        b4,
    )
    x.drive_torque[i] = p.drive_radius[i] * (t0 - b0)
    x.output_torque[i] = p.output_radius[i] * (t4 - b4)
    x.out_of_range[i] = select(minimum(t0, b0) <= 0.0, 1.0, 0.0)
    arrived = w.arrived_top[i] + w.arrived_bottom[i]
    x.phase[i] = select(abs(x.drive_velocity[i]) > STILL, 1.0 + arrived, select(arrived > 1.5, 3.0, 0.0))


def _stiffnesses(p):
    """(stiffness of M_in over the drive's angle, of M_out over the output's), N m.

    That of the whole cables and a quarter of that of the end spans alone: these are that stiff only until their contact
    slides.
    """
    per_in = per_out = 0.0
    for length in (p.length_top, p.length_bottom):
        whole = 1.0 / length.sum(axis=0)
        per_in, per_out = per_in + (whole + 0.25 / length[0]), per_out + (whole + 0.25 / length[-1])
    turn = p.stretch_stiffness * p.gear * p.drive_radius * per_in
    return turn, p.stretch_stiffness * p.output_radius * per_out + p.contact_stiffness


def _resolves(p, e) -> np.ndarray:
    turn, swing = _stiffnesses(p)
    return resolved(p, e, turn, swing, p.length_top.sum(axis=0), p.length_bottom.sum(axis=0))


def _raised(p, dt: float) -> None:
    turn, swing = _stiffnesses(p)
    raised(p, turn, swing, dt)


@inline
def _solve(x, p, u, w, e, s, g, lanes, substeps, dt):
    """A block of columns, in short loops: so the processor works on several columns at once."""
    hardens, creeps, apart, builds = False, False, False, False
    if e is not None:  # what no column of a block has is left out for all of them
        hardens, creeps, apart = any_hardens(e, lanes), any_creeps(e, s, lanes), any_apart(e, lanes)
        builds = any_builds_up(e, lanes)
    for i in range(lanes):
        if e is not None:
            drift = select(e.friction_drift_change[i] != 0.0, s.drift[i], 0.0)
            worn(top_side(x, p, w), e.worn_ratio_top, drift, i)
            worn(bottom_side(x, p, w), e.worn_ratio_bottom, drift, i)
        x.slack_fraction[i], x.peak_tension[i] = 0.0, peak_at_start(largest(x, i))
        w.arrived_top[i], w.arrived_bottom[i] = 0.0, 0.0
        w.turned_in[i], w.turned_out[i] = 0.0, 0.0
        if e is not None:
            begin(
                e, s, g, u, i, x.drive_angle[i], x.drive_velocity[i], x.output_angle[i], x.output_velocity[i],
                substeps * dt, dt,
            )  # fmt: skip
            begin_friction(e, g, i)
    for n in range(substeps + 1):
        step = 0.5 * dt if (n == 0) | (n == substeps) else dt
        more = 0.5 * dt if n < substeps else 0.0
        for i in range(lanes):
            wind(x, p, e, s, g, i, step, more, apart)
        equilibrium(x, p, w, e, s, g, lanes, step, more, hardens, creeps)
        for i in range(lanes):
            _watch(x, p, w, e, i)
        if n < substeps:
            for i in range(lanes):
                if e is not None:
                    actuate(e, s, g, u, i, n, substeps, dt)
                    u.command[i] = own_actuate(u.command[i], x.drive_angle[i], x.drive_velocity[i], e, s, i)
            if builds:
                for i in range(lanes):
                    _kick(x, p, u, w, e, s, g, i, dt, True)
            else:
                for i in range(lanes):
                    _kick(x, p, u, w, e, s, g, i, dt, False)
    for i in range(lanes):
        x.slack_fraction[i] /= substeps + 1.0
        _report(x, p, w, i)
        if e is not None:
            end(e, s, g, i, x.output_angle[i], substeps * dt)


def _derive(value, e) -> dict[str, np.ndarray]:
    """Rows of `ROWS` from the circuit's parameters; rows `OF_EFFECTS` of the effects too."""
    statics = Statics.from_values(np.array([value[name] for name in CIRCUIT.names]))
    arc = statics.radius * statics.integral / (1.0 + statics.ratio)
    length = statics.span.copy()
    length[:, :-1] += arc
    length[:, 1:] += arc
    before, after = length[:, :-1], length[:, 1:]
    small = RELEASE * before * after / (before + after)
    rows = shared_coefficients(value, statics, e)
    for k, side in enumerate(SIDES):
        rows |= {f"length_{side}": length[k], f"ratio_{side}": statics.ratio[k]}
        rows |= {f"inverse_{side}": 1.0 / statics.ratio[k], f"small_{side}": small[k]}
    if e is not None:
        _derive_worn(value, e)
        e.plain_length_top[:], e.plain_length_bottom[:] = length
    return rows


def _derive_worn(value, e) -> None:
    drifting = np.flatnonzero(e.friction_drift_change)
    if drifting.size:
        final = {name: row[drifting] for name, row in value.items()}
        for name in ("cable_friction", "shaft_friction"):
            final[name] = final[name] * (1.0 + e.friction_drift_change[drifting])
        ratio = Statics.from_values(np.array([final[name] for name in CIRCUIT.names])).ratio
        e.worn_ratio_top[:, drifting], e.worn_ratio_bottom[:, drifting] = ratio


def _settle(x, s, p, e, position: np.ndarray) -> None:
    """At rest with the output at ``position`` (rad, [n]), its load balanced."""
    lengths = p.length_top.sum(axis=0), p.length_bottom.sum(axis=0)
    elongation, top, bottom = rest_elongation(p, *lengths, position, e)
    settle_ends(x, s, p, e, position, elongation, top, bottom)
    stretch, hard = p.stretch_stiffness * elongation, e.stiffness_hardening_coefficient
    for q, length, tension, total in (
        (x.stretch_top, p.length_top, top, p.preload_top + stretch),
        (x.stretch_bottom, p.length_bottom, bottom, p.preload_bottom - stretch),
    ):
        q[:] = 2.0 * tension / (1.0 + np.sqrt(1.0 + 2.0 * hard * tension)) * length
        q[0] += np.minimum(total, 0.0)  # a slack side: the missing stretch


PLANT = Plant(
    name="pulley_chain",
    parameters=CIRCUIT,
    signals=SIGNALS + _CHAIN,
    signal_rows=SIGNAL_ROWS,
    coefficient_rows=ROWS,
    scratch=SCRATCH,
    action_modes=ACTION_MODES,
    derive=_derive,
    settle=_settle,
    solve=_solve,
    effects=Layout("pulley_chain", CIRCUIT, replace(ACTING, seams=("actuate", "load")), worn=OF_EFFECTS),
    step_rows=STEP_ROWS,
    resolves=_resolves,
    raised=_raised,
)
