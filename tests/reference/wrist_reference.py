"""The coupled wrist, written apart from the plant: tiny explicit steps in plain Python."""

import math

from tests.reference.joint_reference import Tendon, ratio_of


class Wrist:
    """Two joints and two drives; `advance` goes on by explicit steps."""

    def __init__(self, rig, state, step):
        self.rig, self.step = rig, step
        self.y, self.p, self.v, self.vp = state["yaw_angle"], state["pitch_angle"], 0.0, 0.0
        self.d, self.dp, self.w, self.wp = state["drive_angle"], state["pitch_drive_angle"], 0.0, 0.0
        stiffness = rig["yaw_cable_stiffness"], rig["pitch_cable_stiffness"]
        self.cables = [
            [Tendon(k, rig["drive_share"], 0.0, 1.0) for _ in range(2)] for k in stiffness
        ]  # fmt: skip
        self.y2 = [[state["stretch_end_a"], state["stretch_end_b"]],
                   [state["pitch_stretch_end_a"], state["pitch_stretch_end_b"]]]  # fmt: skip
        self.tensions = [
            [(state[f"{which}tension_drive_{s}"], state[f"{which}tension_end_{s}"]) for s in "ab"]
            for which in ("", "pitch_")
        ]
        self.ratios = {}

    def ratio(self, wrap):
        """Ratio of a contact at a wrap, from its equation; between wraps 20 mrad apart in straight lines (1e-6)."""
        low = math.floor(max(wrap, 0.0) * 50.0)
        for k in (low, low + 1):
            if k not in self.ratios:
                self.ratios[k] = ratio_of({**self.rig, "wrap_angle": k / 50.0}) if k else 1.0
        share = max(wrap, 0.0) * 50.0 - low
        return self.ratios[low] + share * (self.ratios[low + 1] - self.ratios[low])

    def advance(self, command, pitch, rate, pitch_rate, period, push=0.0):
        """One control period."""
        rig, h = self.rig, self.step
        ry, rc, rp = rig["yaw_radius"], rig["coupling_radius"], rig["pitch_radius"]
        take_up = (rig["yaw_pretension"] / rig["yaw_cable_stiffness"],
                   rig["pitch_pretension"] / rig["pitch_cable_stiffness"])  # fmt: skip
        for _ in range(round(period / h)):
            self.d, self.w = self.driven(0, self.d, self.w, command, rate)
            self.dp, self.wp = self.driven(1, self.dp, self.wp, pitch, pitch_rate)
            (_, ta), (_, tb) = self.tensions[0]
            (_, pa), (_, pb) = self.tensions[1]
            net = ry * (ta - tb) - rig["yaw_stiffness"] * self.y - rig["yaw_damping"] * self.v + push
            self.v = self._rubbed(self.v + h * net / rig["yaw_inertia"], h * rig["yaw_friction"] / rig["yaw_inertia"])
            net = rp * (pa - pb) + rc * (ta - tb) - rig["pitch_damping"] * self.vp
            dry = rig["pitch_friction"] + rig["bearing_arm"] * (ta + tb + pa + pb)
            self.vp = self._rubbed(self.vp + h * net / rig["pitch_inertia"], h * dry / rig["pitch_inertia"])
            was = ry * self.y + rc * self.p, rp * self.p
            self.y, self.p = self.y + h * self.v, self.p + h * self.vp
            now, wound = (ry * self.y + rc * self.p, rp * self.p), (ry * self.d, rp * self.dp)
            more = rig["wrap_growth"] * self.p
            wraps = (rig["yaw_wrap"] + more, rig["yaw_wrap"] - more), (rig["pitch_wrap"], rig["pitch_wrap"])
            for k in (0, 1):
                for j, way in enumerate((1.0, -1.0)):
                    cable = self.cables[k][j]
                    cable.n = self.ratio(wraps[k][j])
                    e = take_up[k] + way * (wound[k] - now[k])
                    t1, t2, self.y2[k][j] = cable.at(e, self.y2[k][j] - way * (now[k] - was[k]))
                    self.tensions[k][j] = t1, t2

    def driven(self, k, x, v, target, rate):
        """(angle, speed) of the yaw drive (k = 0) or the pitch drive after a step."""
        rig, h, w = self.rig, self.step, self.rig["servo_frequency"]
        a = w * w * (target - x) + 2.0 * rig["servo_damping_ratio"] * w * (rate - v)
        a = min(max(a, -rig["drive_acceleration_limit"]), rig["drive_acceleration_limit"])
        v = min(max(v + h * a, -rig["drive_speed_limit"]), rig["drive_speed_limit"])
        return x + h * v, v

    def _rubbed(self, free, held):
        return free - min(max(free, -held), held)
