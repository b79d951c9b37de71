"""The cable-hole rig as an event-driven initial value problem: plain SciPy, no step limit, no shared code.

Modes up, down and stuck are integrated apart; events end each. Speed drive only (the drive follows a given speed).
"""

import math

import numpy as np
from scipy.integrate import solve_ivp


def ratio(rho, mu, phi):
    """lambda of section 1 from the characteristic roots, as printed."""
    root = math.sqrt((1 + rho) ** 2 + 4 * mu * mu * rho)
    a, b = (-(1 + rho) + root) / (2 * mu), (-(1 + rho) - root) / (2 * mu)
    return (a * math.exp(b * phi) - b * math.exp(a * phi)) / (a - b)


class HoleReference:
    """rig: parameter values by name (SI); ``drive``: function t -> (position, speed) of the drive."""

    def __init__(self, rig, drive):
        self.rig, self.drive = rig, drive

    def n(self, v):
        r = self.rig
        c = r["extrusion_gain"] * abs(v) ** r["extrusion_exponent"] if v else 0.0
        return ratio(r["radius_ratio"] * (1 + r["extrusion_delta"]), r["friction_coefficient"] + c, r["wrap_angle"])

    def tension(self, t, y, v):
        x, vx = self.drive(t)
        r = self.rig
        stretch = x - y
        return max(r["cable_stiffness"] * stretch + r["cable_damping"] * (vx - v), 0.0) if stretch > 0 else 0.0

    def resistance(self, y, v):
        r = self.rig
        weight = r["load_mass"] * r["gravity"] * r["load_gravity"]
        return weight + r["load_stiffness"] * y + r["load_damping"] * v

    def force(self, t, y, v, mode):
        return self.tension(t, y, v) * self.n(v) ** -mode - self.resistance(y, v)

    def solve(self, y, v, times):
        """(positions, speeds) at ``times`` from (y, v) at times[0]; rtol 1e-10."""
        t, end, ys, vs = times[0], times[-1], [], []
        mode = np.sign(v)
        while t < end - 1e-12:
            if mode == 0:
                if self.force(t, y, 0.0, 1) > 0:
                    mode = 1
                elif self.force(t, y, 0.0, -1) < 0:
                    mode = -1
            if mode == 0:
                events = [lambda s, z: self.force(s, z[0], 0.0, 1), lambda s, z: -self.force(s, z[0], 0.0, -1)]
                rates = lambda s, z: [0.0, 0.0]  # noqa: E731
            else:
                events = [lambda s, z, m=mode, t=t: m * z[1] + (1.0 if s <= t + 1e-9 else 0.0)]
                rates = lambda s, z, m=mode: [z[1], self.force(s, z[0], z[1], m) / self.rig["load_mass"]]  # noqa: E731
            for k, event in enumerate(events):
                event.terminal, event.direction = True, (1 if mode == 0 else -1) if k < 2 else 0
            inside = times[(times >= t) & (times <= end)]
            run = solve_ivp(
                rates, (t, end), [y, v], events=events, rtol=1e-10, atol=1e-13, max_step=5e-3, dense_output=True
            )
            stop = run.t[-1]
            for s in inside[(inside >= t) & (inside < stop if stop < end else inside <= stop)]:
                ys.append(run.sol(s)[0])
                vs.append(run.sol(s)[1])
            t, y, v = stop, run.y[0, -1], run.y[1, -1]
            if stop < end:
                if mode == 0:
                    mode = 1 if run.t_events[0].size else -1
                else:
                    mode, v = 0, 0.0
        return np.array(ys), np.array(vs)
