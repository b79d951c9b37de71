"""A tendon that rubs at many places, as an ordinary differential equation for scipy: friction made smooth by a creep.

Nothing of the plant is used. A contact slips at a rate in proportion to what is beyond its limit, with so little
against it that the ratio hardly exceeds the limit:  eta s_h' = T_{h-1} - n T_h  where that is positive.
"""

import math

import numpy as np
from scipy.integrate import solve_ivp

ETA = 0.1
"""N s/m: at 50 mm/s all of 30 contacts together carry 0.15 N more than their limits."""


class Chain:
    """Drive, contacts and load; ``rig``: parameter values by name."""

    def __init__(self, rig, contacts, start, mode):
        self.rig, self.n, self.mode = rig, contacts, mode
        self.k = 1.0 / (1.0 / rig["tendon_stiffness"] + 1.0 / rig["sheath_stiffness"])
        share = np.full(contacts + 1, 1.0 / contacts)
        share[[0, -1]] *= 0.5
        self.spans = self.k / share
        tension = rig["load_preload"] + rig["load_stiffness"] * start
        below = np.cumsum(share[::-1])[::-1]  # of the stretch, from the top of each span on
        places = start + tension / self.k * below
        # drive, its speed, the slips, the load, its speed
        self.state = np.concatenate([[places[0], 0.0], places[1:], [start, 0.0]])

    def tensions(self, z):
        """Of all spans."""
        ends = np.concatenate([z[:1], z[2:-1]])
        return np.maximum(self.spans * (ends[:-1] - ends[1:]), 0.0)

    def rates(self, z, command, bend):
        """dz/dt."""
        r = self.rig
        t, n = self.tensions(z), math.exp(r["friction_coefficient"] * bend / self.n)
        up, down = t[:-1] - n * t[1:], t[1:] - n * t[:-1]
        slips = (np.maximum(up, 0.0) - np.maximum(down, 0.0)) / ETA
        x, vx, y, v = z[0], z[1], z[-2], z[-1]
        if self.mode == "position":
            w = r["servo_frequency"]
            a = w * w * (command - x) - 2.0 * r["servo_damping_ratio"] * w * vx
            a = min(max(a, -r["drive_acceleration_limit"]), r["drive_acceleration_limit"])
        else:
            a = (command - t[0] - r["drive_damping"] * vx) / r["drive_mass"]
        resist = r["load_preload"] + r["load_stiffness"] * y + r["load_damping"] * v
        return np.concatenate([[vx, a], slips, [v, (t[-1] - resist) / r["load_mass"]]])

    def run(self, commands, bends, period):
        """(T_0, T_N, y) at the end of every period, for commands and bends that are held within it."""
        out = []
        for command, bend in zip(commands, bends, strict=True):
            found = solve_ivp(
                lambda t, z, c=command, b=bend: self.rates(z, c, b), (0.0, period), self.state, method="LSODA",
                rtol=1e-7, atol=1e-10, lband=2, uband=2,
            )  # fmt: skip
            self.state = found.y[:, -1]
            t = self.tensions(self.state)
            out.append((t[0], t[-1], self.state[-2]))
        return np.array(out).T
