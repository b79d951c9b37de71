"""One cable as a chain: five elastic spans joined by four friction contacts, in quasi-static equilibrium.

symbol | meaning | unit
------ | ------- | ----
q_j    | EA times the elongation of span j = 0..4 (0 at the drive, 4 at the output) | N m
l_j    | length of span j with its share of the neighbouring arcs | m
y_j    | q_j + eta (q_j - q_j one step before); eta is the cable's damping time over the step | N m
T_j    | y_j / l_j, tension of span j | N
lambda_i | limit of the tension ratio at contact i = 1..4, between spans i - 1 and i | 1
sigma_i  | slip over contact i in this step times EA (1 + eta), positive towards the drive | N m
m_i    | 1 slides towards the drive (T_{i-1} = lambda T_i), -1 to the output (T_i = lambda T_{i-1}), 0 sticks | 1

When the ends move, the slips must satisfy: 1/lambda_i <= T_{i-1}/T_i <= lambda_i, and a contact slides only at the
limit that opposes it. This linear complementarity problem (tridiagonal, diagonally dominant) is solved by changing the
active set until nothing changes, starting from the set of the step before. For given m it is explicit: between two
stuck contacts the stretch is conserved and the tensions are in known ratios. A column that has converged repeats itself
bit by bit, so a tile iterates until its last column is done. What has not converged after `PASSES` (cables that are
nearly slack, with every tension near zero) is finished by Gauss-Seidel sweeps over the contacts.

A side whose total stretch is not positive is slack: all tensions are zero, friction is gone, the missing stretch is
kept in q_0.
"""

from collections import namedtuple

from cable_envs.core.kernels import inline, jit, maximum, minimum, select

SPANS, CONTACTS = 5, 4
PASSES = 12
RELEASE = 1e-13
"""A contact sticks again when its slip changes the tensions by less than this share."""
GRIP = 1.0 + 1e-11
"""A stuck contact starts to slide when its ratio exceeds lambda by more than this factor."""
SETTLED = 1e-14
"""Sweeps end when no slip changes by more than this share of the largest stretch."""

Side = namedtuple("Side", [
    "stretch", "state",  # q [5] and m [4]: what goes on from step to step
    "length", "limit", "inverse", "small",  # l [5], lambda [4], 1 / lambda [4], the least slip that counts [4]
    "pull", "tension", "tangent_0", "tangent_4", "pending",  # scratch: y [5], T [5], dT/dq at both ends, 1: undone
])  # fmt: skip
"""One side of a block of columns: [rows, columns], or [columns] (tangent_0, tangent_4, pending)."""


@inline
def stretch_ends(side, i, at_drive, at_output, eta):
    """Move both ends: q becomes the trial stretch without slip, y the stretch that makes the trial tensions."""
    for j in range(SPANS):
        side.pull[j, i] = side.stretch[j, i]
    side.pull[0, i] += (1.0 + eta) * at_drive
    side.pull[4, i] += (1.0 + eta) * at_output
    side.stretch[0, i] += at_drive
    side.stretch[4, i] += at_output


@inline
def _next(m, slip, small, before, after, ratio):
    """The contact's next state: release it when it slides the wrong way, let it go when it is over its limit."""
    keep = m * slip > small * (abs(before) + abs(after))
    limit = ratio * GRIP
    sliding = select(before > limit * after, 1.0, select(after > limit * before, -1.0, 0.0))
    return select(m != 0.0, select(keep, m, 0.0), sliding)


@inline
def _falls(m, ratio, inverse):
    """T_i / T_{i-1} of a sliding contact."""
    return select(m > 0.0, inverse, ratio)


@inline
def relax(side, i):
    """One pass over a side: tensions of the present active set, then the next active set. True when that differs."""
    m1, m2, m3, m4 = side.state[0, i], side.state[1, i], side.state[2, i], side.state[3, i]
    l0, l1, l2, l3, l4 = side.length[0, i], side.length[1, i], side.length[2, i], side.length[3, i], side.length[4, i]
    y0, y1, y2, y3, y4 = side.pull[0, i], side.pull[1, i], side.pull[2, i], side.pull[3, i], side.pull[4, i]
    a1, a2, a3, a4 = m1 != 0.0, m2 != 0.0, m3 != 0.0, m4 != 0.0
    limp = y0 + y1 + y2 + y3 + y4 <= 0.0  # so asked, a NaN passes on

    w1 = select(a1, _falls(m1, side.limit[0, i], side.inverse[0, i]), 1.0)
    w2 = select(a2, w1 * _falls(m2, side.limit[1, i], side.inverse[1, i]), 1.0)
    w3 = select(a3, w2 * _falls(m3, side.limit[2, i], side.inverse[2, i]), 1.0)
    w4 = select(a4, w3 * _falls(m4, side.limit[3, i], side.inverse[3, i]), 1.0)
    # stretch and weighted length of the group of spans up to here
    g1, h1 = y1 + select(a1, y0, 0.0), l1 * w1 + select(a1, l0, 0.0)
    g2, h2 = y2 + select(a2, g1, 0.0), l2 * w2 + select(a2, h1, 0.0)
    g3, h3 = y3 + select(a3, g2, 0.0), l3 * w3 + select(a3, h2, 0.0)
    g4, h4 = y4 + select(a4, g3, 0.0), l4 * w4 + select(a4, h3, 0.0)
    # the whole group's values, handed back from its last span
    g3, v3 = select(a4, g4, g3), select(a4, h4, h3)
    g2, v2 = select(a3, g3, g2), select(a3, v3, h2)
    g1, v1 = select(a2, g2, g1), select(a2, v2, h1)
    g0, v0 = select(a1, g1, y0), select(a1, v1, l0)
    t0 = select(limp, 0.0, g0 / v0)
    t1 = select(limp, 0.0, g1 / v1 * w1)
    t2 = select(limp, 0.0, g2 / v2 * w2)
    t3 = select(limp, 0.0, g3 / v3 * w3)
    t4 = select(limp, 0.0, g4 / h4 * w4)

    s1 = y0 - l0 * t0
    s2 = select(a1, s1, 0.0) + y1 - l1 * t1
    s3 = select(a2, s2, 0.0) + y2 - l2 * t2
    s4 = select(a3, s3, 0.0) + y3 - l3 * t3
    n1 = select(limp, 0.0, _next(m1, s1, side.small[0, i], t0, t1, side.limit[0, i]))
    n2 = select(limp, 0.0, _next(m2, s2, side.small[1, i], t1, t2, side.limit[1, i]))
    n3 = select(limp, 0.0, _next(m3, s3, side.small[2, i], t2, t3, side.limit[2, i]))
    n4 = select(limp, 0.0, _next(m4, s4, side.small[3, i], t3, t4, side.limit[3, i]))

    side.tension[0, i], side.tension[1, i], side.tension[2, i], side.tension[3, i], side.tension[4, i] = (
        t0,
        t1,
        t2,
        t3,
        t4,
    )
    side.tangent_0[i] = select(limp, 0.0, 1.0 / v0)
    side.tangent_4[i] = select(limp, 0.0, w4 / h4)
    side.state[0, i], side.state[1, i], side.state[2, i], side.state[3, i] = n1, n2, n3, n4
    changed = (n1 != m1) | (n2 != m2) | (n3 != m3) | (n4 != m4)
    side.pending[i] = select(changed, 1.0, 0.0)
    return changed


@inline
def settle(side, i, eta):
    """Take the solution over: slips change the stretch of the spans they touch; a slack side's stretch is spread."""
    m1, m2, m3, m4 = side.state[0, i] != 0.0, side.state[1, i] != 0.0, side.state[2, i] != 0.0, side.state[3, i] != 0.0
    limp = side.pull[0, i] + side.pull[1, i] + side.pull[2, i] + side.pull[3, i] + side.pull[4, i] <= 0.0
    share = 1.0 / (1.0 + eta)
    q0 = side.stretch[0, i] + select(m1, share * (side.length[0, i] * side.tension[0, i] - side.pull[0, i]), 0.0)
    q1 = side.stretch[1, i] + select(m1 | m2, share * (side.length[1, i] * side.tension[1, i] - side.pull[1, i]), 0.0)
    q2 = side.stretch[2, i] + select(m2 | m3, share * (side.length[2, i] * side.tension[2, i] - side.pull[2, i]), 0.0)
    q3 = side.stretch[3, i] + select(m3 | m4, share * (side.length[3, i] * side.tension[3, i] - side.pull[3, i]), 0.0)
    q4 = side.stretch[4, i] + select(m4, share * (side.length[4, i] * side.tension[4, i] - side.pull[4, i]), 0.0)
    total = q0 + q1 + q2 + q3 + q4
    length = side.length[0, i] + side.length[1, i] + side.length[2, i] + side.length[3, i] + side.length[4, i]
    even = maximum(total, 0.0) / length
    side.stretch[0, i] = select(limp, side.length[0, i] * even + minimum(total, 0.0), q0)
    side.stretch[1, i] = select(limp, side.length[1, i] * even, q1)
    side.stretch[2, i] = select(limp, side.length[2, i] * even, q2)
    side.stretch[3, i] = select(limp, side.length[3, i] * even, q3)
    side.stretch[4, i] = select(limp, side.length[4, i] * even, q4)


@jit
def sweep(side, i):
    """Gauss-Seidel over the contacts of one column, from no slip until the slips stand still to 1e-14: sets T and m.

    Until the end the rows of T hold the stretches, and those of m the slips: a kernel on a GPU has no other memory.
    """
    y, slip = side.tension, side.state
    scale = 0.0
    for j in range(SPANS):
        y[j, i] = side.pull[j, i]
        scale = max(scale, abs(y[j, i]))
    for k in range(CONTACTS):
        slip[k, i] = 0.0
    for _ in range(20000):
        change = 0.0
        for k in range(CONTACTS):
            l_a, l_b, lam = side.length[k, i], side.length[k + 1, i], side.limit[k, i]
            a, b = y[k, i] + slip[k, i], y[k + 1, i] - slip[k, i]  # stretches if this contact did not slide
            new = max((a * l_b - lam * b * l_a) / (l_b + lam * l_a), 0.0)
            if new == 0.0:
                new = min((lam * a * l_b - b * l_a) / (lam * l_b + l_a), 0.0)
            y[k, i], y[k + 1, i] = a - new, b + new
            change = max(change, abs(new - slip[k, i]))
            slip[k, i] = new
        if change <= SETTLED * scale:
            break
    for j in range(SPANS):
        side.tension[j, i] = y[j, i] / side.length[j, i]
    for k in range(CONTACTS):
        side.state[k, i] = select(slip[k, i] > 0.0, 1.0, select(slip[k, i] < 0.0, -1.0, slip[k, i]))
