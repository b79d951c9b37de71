"""A catheter: a tendon in a bent sheath, by the capstan law along all of it, from one reversal to the next.

Nothing is cut into pieces, and MuJoCo has no part in it. While the tendon does not slide at its end, a reversal of the
drive goes along it: from the drive to the place s of the front the tension is

    T(z) = T(s) e^(+-r (s - z)),     r = mu Theta,   z, s in [0, 1],

and beyond it what it was. The stretch, the integral of T over z by the stiffness k, tells s. Once the front is at the
end, the tip moves: T(1) = preload + k_tip y. No mass, no damping: slow motion.
"""

import numpy as np

from benchmarks.unlike.logs import CONTROL, Dialect, Log, Sensor, sines, text

MM = 1e3
PLACES = 2000
"""Parts of the tendon between which the front's place is interpolated."""


class Tendon:
    """Its tensions while its drive is moved; at first it has not slid: one tension all along.

    Parameters
    ----------
    stiffness, friction, spring, preload : float
        k, N/m; mu Theta; stiffness of the tip, N/m, and its force at y = 0, N.
    place : float
        Of the drive, m.
    """

    def __init__(self, stiffness: float, friction: float, spring: float, preload: float, place: float):
        self.stiffness, self.friction, self.spring, self.preload = stiffness, friction, spring, preload
        self.tip = (place - preload / stiffness) / (1.0 + spring / stiffness)
        self.tension = np.full(PLACES + 1, preload + spring * self.tip)
        self._along, self._drive, self._way = np.linspace(0.0, 1.0, PLACES + 1), place, 0.0
        self._turned()

    def _turned(self) -> None:
        """What a reversal finds: the tensions, and their integral from every place to the end."""
        self._before = self.tension.copy()
        parts = 0.5 * (self._before[1:] + self._before[:-1]) / PLACES
        self._beyond = np.concatenate([np.cumsum(parts[::-1])[::-1], [0.0]])

    def move(self, place: float) -> tuple[float, float, float]:
        """(tension at the drive, at the tip, place of the tip) with the drive at ``place``."""
        if place != self._drive:
            way = 1.0 if place > self._drive else -1.0
            if way != self._way:
                self._way = way
                self._turned()
            self._go(place, way * self.friction)
            self._drive = place
        return self.tension[0], self.tension[-1], self.tip

    def _go(self, place: float, r: float) -> None:
        wanted = self.stiffness * (place - self.tip)
        reached = self._before * np.expm1(r * self._along) / r + self._beyond  # integrals with the front at each place
        if self._way * (wanted - reached[-1]) >= 0.0:
            mean = np.expm1(r) / r
            self.tip = (self.stiffness * place - self.preload * mean) / (self.stiffness + self.spring * mean)
            self.tension = (self.preload + self.spring * self.tip) * np.exp(r * (1.0 - self._along))
            self._turned()
            return
        front = float(np.interp(self._way * wanted, self._way * reached, self._along))
        at = float(np.interp(front, self._along, self._before))
        self.tension = np.where(self._along < front, at * np.exp(r * (front - self._along)), self._before)


def catheter(seed: int, gap: bool = False) -> Log:
    """A tendon that bends the tip of a catheter against its spring; ``gap``: the drive has backlash."""
    rng = np.random.default_rng([5, seed])
    stiffness, bend, mu = rng.uniform(4.5e3, 7e3), rng.uniform(2.5, 4.4), rng.uniform(0.08, 0.16)
    spring, preload, play = rng.uniform(700, 1300), rng.uniform(4.0, 7.0), rng.uniform(4e-4, 9e-4)
    sensors = (
        Sensor("Draht_mm", MM, count=0.002, digits=3), Sensor("Kraft_Antrieb_N", noise=0.03, digits=2),
        Sensor("Kraft_Spitze_N", noise=0.02, digits=2),
    )  # fmt: skip
    dialect = Dialect("Zeit", 1.0, 100.0, jitter=2e-4, drift=3e-5, delimiter=";", decimal=",")
    files = {}
    for name, rates in {"draht1.txt": (0.15, 0.25), "draht2.txt": (0.1, 0.2), "draht3.txt": (0.3, 0.45)}.items():
        parts = ((0.0035, *rates), (0.001, 0.4, 0.6)) if name == "draht2.txt" else ((0.0045, *rates),)
        motion, begins = sines(rng, 0.0, parts), 0.0055
        time = CONTROL * np.arange(round(20.0 / CONTROL) + 1)
        drive = begins + np.array([motion(t) for t in time])
        before = np.concatenate([np.linspace(5e-4, 9e-3, 500), np.linspace(9e-3, drive[0], 500)])  # nobody logs it
        nut, tendon, seen = before[0], Tendon(stiffness, mu * bend, spring, preload, before[0]), []
        for place in np.concatenate([before, drive]):
            nut = float(np.clip(nut, place - 0.5 * play, place + 0.5 * play)) if gap else float(place)
            seen.append(tendon.move(nut))
        tensions = np.array(seen)[len(before) :]
        files[name] = text(np.column_stack([drive, tensions[:, :2]]), sensors, dialect, rng)
    owner = {"bend_angle": (bend, "rad", None)}
    about = "A tendon in the sheath of a catheter. Its travel, and the tension at the drive and at the tip."
    rig = {
        "friction_coefficient": (mu, "1"), "stiffness": (stiffness, "N/m"), "load_stiffness": (spring, "N/m"),
        "load_preload": (preload, "N"),
    }  # fmt: skip
    return Log("catheter", about, files, "draht3.txt", owner, rig | ({"backlash": (play, "m")} if gap else {}))


def worn_catheter(seed: int) -> Log:
    """The same with a gap at its drive."""
    return catheter(seed, gap=True)
