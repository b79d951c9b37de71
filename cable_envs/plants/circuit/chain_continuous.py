"""The chain of spans and contacts in continuous time.

The cables have a damping time tau = cable_damping / EA, so that the tension of a span is T l = q + tau q'. With the
speeds of both ends this is the problem of `cable_envs.physics.chain` again, with the slips' rates times tau in the
place of the slips: its solution gives all tensions, and from them

    q_j' = (T_j l_j - q_j) / tau       beside a contact that slides;  else what the ends wind up

A contact that is at its limit but for the share `NEAR` slides unless the slip would be backwards. A slack cable carries
nothing, and its spans share what there is within tau. The stretch of span 0 is what the ends leave: no state.
"""

from cable_envs.core.kernels import maximum, select
from cable_envs.physics.chain import CONTACTS, RELEASE, SPANS, relax, settle
from cable_envs.plants.circuit.chain_sides import bottom_side, top_side
from cable_envs.plants.circuit.drive_rates import turned
from cable_envs.plants.circuit.ends import cosine, load_torque
from cable_envs.plants.circuit.parameters import SIDES
from cable_envs.plants.continuous import NEAR, Rows, again, rubbed

PASSES = 40
"""Of the active sets, at most."""
STATES = (
    "drive_angle", "drive_velocity", "output_angle", "output_velocity",
    *(f"stretch_{side}_{j}" for side in SIDES for j in range(1, SPANS)),
)  # fmt: skip


def _sides(rows: Rows):
    """Both sides, whose contacts are slow to rest."""
    late = -NEAR / RELEASE
    return tuple(
        side._replace(small=side.small * late)
        for side in (top_side(rows.x, rows.p, rows.w), bottom_side(rows.x, rows.p, rows.w))
    )


def _wound(p, drive, output):
    """EA times what drive and output have wound up of cable t and of cable b, N m, each at the drive and the output."""
    at_drive, at_output = p.stretch_stiffness[0] * p.gear[0] * drive, p.stretch_stiffness[0] * output
    return (at_drive, -at_output), (-at_drive, at_output)


def _strained(side, tau, preload, wound, rate, inner):
    """(tensions, rates of the stretches of spans 1 to 4) of a side; ``inner`` are those stretches."""
    whole = preload + wound[0] + wound[1]
    stretch = (whole - inner[0] - inner[1] - inner[2] - inner[3], *inner)
    winds = (rate[0], 0.0, 0.0, 0.0, rate[1])
    for j in range(SPANS):
        side.pull[j, 0], side.stretch[j, 0] = stretch[j] + tau * winds[j], 0.0
    for k in range(CONTACTS):
        before, after = stretch[k] / side.length[k, 0], stretch[k + 1] / side.length[k + 1, 0]
        limit = side.limit[k, 0] * (1.0 - NEAR)
        side.state[k, 0] = select(before > limit * after, 1.0, select(after > limit * before, -1.0, 0.0))
    for _ in range(PASSES):
        if not again(relax(side, 0)):
            break
    total, length = side.pull[:, 0].sum(), side.length[:, 0].sum()
    settle(side, 0, 0.0)  # what slides through the contacts, times tau
    even = maximum(whole, 0.0) / length
    rates = []
    for j in range(1, SPANS):
        spread = (side.length[j, 0] * even - stretch[j]) / tau
        rates.append(select(total <= 0.0, spread, winds[j] + side.stretch[j, 0] / tau))
    return [side.tension[j, 0] for j in range(SPANS)], rates


def law(state, rows: Rows, way, *drive_way):
    """Rates of `STATES`, and those of a servo, and the outputs of the circuit."""
    a, v_in, b, v = state[:4]
    p, u = rows.p, rows.u
    tau, (top, bottom) = p.stretch_damping[0] / p.stretch_stiffness[0], _sides(rows)
    (wound_t, wound_b), (rate_t, rate_b) = _wound(p, a, b), _wound(p, v_in, v)
    t, t_rates = _strained(top, tau, p.preload_top[0], wound_t, rate_t, state[4:8])
    s, s_rates = _strained(bottom, tau, p.preload_bottom[0], wound_b, rate_b, state[8:12])
    m_in, m_out = p.drive_radius[0] * (t[0] - s[0]), p.output_radius[0] * (t[-1] - s[-1])
    wanted, _, _ = load_torque(p, u, 0, b, v, cosine(b))
    brake = p.brake_torque[0]
    net = rubbed(m_out - wanted, brake, brake, way)
    faster, servo, motor = turned(rows, a, v_in, m_in, state[12:], drive_way)
    rates = (v_in, faster, v, net / p.output_inertia[0], *t_rates, *s_rates, *servo)
    return rates, (a, v_in, b, v, m_in, m_out, t[0], s[0], t[-1], s[-1], *motor)


def verge(state, rows: Rows, way, *drive_way):
    """The same state with all contacts at the limits to which motion that way takes them."""
    if way == 0.0:
        return state
    slid, (a, b) = list(state[:4]), (state[0], state[2])
    preloads = rows.p.preload_top[0], rows.p.preload_bottom[0]
    for side, preload, wound, slides in zip(_sides(rows), preloads, _wound(rows.p, a, b), (way, -way)):
        for j in range(SPANS):
            side.pull[j, 0] = 0.0
        side.pull[0, 0] = preload + wound[0] + wound[1]
        side.state[:, 0] = slides
        relax(side, 0)
        slid += [side.length[j, 0] * side.tension[j, 0] for j in range(1, SPANS)]
    return (*slid, *state[12:])
