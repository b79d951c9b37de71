"""Model reference adaptive tension control of the cable-hole.  Eqs. (28)-(35) and Table 3, Gu 2024.

Law (directional form, docs/physics.md):

    F = [m (k_p e + k_d e' + y_d'' + w) + G] n^s,    e = y_d - y,    w = K_e [e, e']^T + k_r r           G29, G33
    e_m-vector' = A_m e_m-vector + b_m r,            r = 0                                                 G32

**Sign of b.** Sliding up, m y'' = F / n - G (G28). With the law and a right n, y'' = k_p e + k_d e' + y_d'' + w, so

    e'' = y_d'' - y'' = -k_p e - k_d e' - w          i.e. in  E' = A E + [0, b]^T w  of G31:   b = -1

(down: m y'' = n F - G with F = [..] / n, the same). The paper's G30 shows +w; the minus sign was lost with the others.

**Adaptive law.** Let eps = E_m - E and K* the matching gain, A + [0, b] K* = A_m. Then with K = K* + dK

    eps' = A_m eps - [0, b]^T dK E,      V = eps^T P eps + |b| dK Gamma^-1 dK^T
    V' = -eps^T Q eps + 2 |b| dK (Gamma^-1 dK'^T - sgn(b) E (eps^T P_2))

so dK'^T = sgn(b) Gamma E (eps^T P_2) leaves V' = -eps^T Q eps: G34 with sgn(b) = -1. P solves
P A_m + A_m^T P = -Q and P_2 is its second column. Q is not printed: q_position and q_velocity (default 1).

**Not printed, chosen here.** k_p and k_d of G29 (Table 3's k_p, k_d belong to the inner loop G35): 90 and 0, so that
with Table 3's K_e(0) = [10, 10] the nominal loop equals the reference model. K_e printed as diag(10, 10) acts as the
row [10, 10], since w is a scalar. The paper sets r = 0: the term k_r r and its law vanish, so k_r = 2 and gamma_r = 0.5
have no effect and are left out. A jump of the reference is added to e_m too: the model describes how an error decays,
and otherwise the adaptation would read every step of the reference as a fault of the plant.

**Units of the adaptation.** Table 3 says SI. With errors of millimetres its rates then move K_e by less than 1e-3 in an
episode: in effect the gains are fixed, and with the adaptation off the errors are the same within the noise. With
errors in millimetres (``position_scale`` 1e-3) they do adapt. The paper's own figures decide for SI: G9 (without
extrusion, section 5.3) leaves a steady error, and commands 40-62 N.

    sinusoid under G9, k_p 90        printed    SI           mm           off
    tension, N                       40-62      36.5-65.7    34.2-73.2    36.5-65.7
    K_e after 20 s                              10, 10       51, 270      10, 10
    RMS error, mm                               5.19         2.96         5.20

What the figures cannot be is one plant: a load that follows within a millimetre needs 33-73 N whatever law commands
it, so the range of G9 and its error of about a millimetre exclude each other. With k_p 3000 and k_d 50 the error under
G22 is 0.011 mm RMS and 0.05 mm at most, within Table A1's 0-0.1 mm (k_p 90: 0.43 mm), and the adaptation in mm changes
it by 2 %: there is nothing left to adapt to. `Mrac` has these outer gains and mm; `MracG22` and `MracG9`
keep what Table 3 prints.

**Which speed gives the direction s.** A choice with consequences, hence an option:

    direction="wanted" (default)   y_d' + (a_1 / a_2) e: the reference's speed, and towards the reference when off it.
                                   A stuck load is pushed with the full friction limit of the way it has to go
    direction="measured"           y' as G28 is written: a load at rest gets no compensation and stays stuck

Within +/- direction_speed s is interpolated linearly (0 gives the bare discontinuity). |v| in n(|v|) is the
measured speed in both. Adaptation rests while the command is saturated.

**Tension task** (an extension; the paper controls position only): F = (T_ref + w) n^s with w = K_e [int e, e]^T and
e = T_ref - T_2, adapted by the same law with errors in units of the reference's scale (tension_scale). Static:
e = d - w, d the mismatch, so b = -1 again. At rest s keeps its last value: the cable must not be let slide back.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
from scipy.linalg import expm, solve_continuous_lyapunov

from cable_envs.baselines.base import HOLE, Controller, Reference
from cable_envs.baselines.general import view_of
from cable_envs.baselines.hole_model import HoleModel
from cable_envs.core.errors import require_known
from cable_envs.core.params import Parameter, ParameterTable
from cable_envs.plants import family_of
from cable_envs.plants.view import Hauling

SIGN_OF_B = -1.0
"""sgn(b) of G31, derived above"""

_LARGEST_GAIN = 1e5
"""adapted gains stay within this (1/s^2 or 1/s): a tuner's adaptation rate may diverge, but not to NaN"""

_TABLE3 = "Table 3, Gu 2024"
_POSITION = ParameterTable(
    Parameter("kp", "1/s^2", 90.0, 0.0, 1e6, "k_p of G29", "chosen: nominal loop = reference model"),
    Parameter("kd", "1/s", 0.0, 0.0, 1e4, "k_d of G29", "chosen: nominal loop = reference model"),
    Parameter("model_stiffness", "1/s^2", 100.0, 0.01, 1e7, "-A_m[1, 0]", _TABLE3),
    Parameter("model_damping", "1/s", 10.0, 0.01, 1e5, "-A_m[1, 1]", _TABLE3),
    Parameter("ke_position", "1/s^2", 10.0, -1e6, 1e6, "K_e(0), gain of e", _TABLE3),
    Parameter("ke_velocity", "1/s", 10.0, -1e5, 1e5, "K_e(0), gain of e'", _TABLE3),
    Parameter("gamma_position", "SI", 40.0, 0.0, 1e12, "Gamma_e, adaptation rate of the gain of e", _TABLE3),
    Parameter("gamma_velocity", "SI", 20.0, 0.0, 1e12, "Gamma_e, adaptation rate of the gain of e'", _TABLE3),
    Parameter("position_scale", "m", 1.0, 1e-6, 1e3, "error that counts as 1 in the adaptation", "Table 3 says SI"),
    Parameter("q_position", "SI", 1.0, 1e-6, 1e9, "Q[0, 0] of the Lyapunov equation", "not printed: identity"),
    Parameter("q_velocity", "SI", 1.0, 1e-6, 1e9, "Q[1, 1] of the Lyapunov equation", "not printed: identity"),
    Parameter("direction_speed", "m/s", 5e-4, 0.0, 1.0, "half width of the interpolated direction", "chosen"),
)
_TENSION = ParameterTable(
    Parameter("model_stiffness", "1/s^2", 100.0, 0.01, 1e7, "-A_m[1, 0]", _TABLE3),
    Parameter("model_damping", "1/s", 10.0, 0.01, 1e5, "-A_m[1, 1]", _TABLE3),
    Parameter("ke_integral", "1/s", 10.0, 0.0, 1e3, "K_e(0), gain of the integral", "chosen: settles in 0.3 s"),
    Parameter("ke_proportional", "1", 0.2, 0.0, 10.0, "K_e(0), gain of the error", "chosen: sampled loop is static"),
    Parameter("gamma_integral", "SI", 40.0, 0.0, 1e10, "Gamma_e, adaptation rate of the integral's gain", _TABLE3),
    Parameter("gamma_proportional", "SI", 0.5, 0.0, 1e8, "Gamma_e, adaptation rate of the error's gain", "chosen"),
    Parameter("tension_scale", "N", 50.0, 0.01, 1e6, "error that counts as 1 in the adaptation", "chosen"),
    Parameter("q_position", "SI", 1.0, 1e-6, 1e9, "Q[0, 0] of the Lyapunov equation", "not printed: identity"),
    Parameter("q_velocity", "SI", 1.0, 1e-6, 1e9, "Q[1, 1] of the Lyapunov equation", "not printed: identity"),
    Parameter("direction_speed", "m/s", 3e-4, 0.0, 1.0, "half width of the interpolated direction", "chosen"),
)


class _Mrac(Controller):
    """Model reference adaptive controller; `ratio` names the tension ratio it compensates: "g22" or "g9"."""

    information = "nominal"
    charged: ClassVar = {"tuning_trials": 8}
    """settings of direction and direction_speed tried; everything else is printed or reasoned above"""
    plants = (HOLE,)
    general = True
    tasks = ("position", "tension")
    ratio: ClassVar[str]
    gain_tables: ClassVar = {
        ("hole", mode, task): table
        for mode in ("tension", "speed")
        for task, table in (("position", _POSITION), ("tension", _TENSION))
    }

    def __init__(
        self, plant: str, action_mode: str, task: str, rig: Mapping[str, Any], dt: float,
        direction: str = "wanted", **gains: Any,
    ):  # fmt: skip
        require_known("direction", [direction], ("wanted", "measured"))
        self.direction = direction
        super().__init__(plant, action_mode, task, rig, dt, **gains)

    @classmethod
    def sees(cls, plant: str, action_mode: str) -> bool:
        """Where the command is the tension that hauls a load; a ratio without extrusion is the only one there."""
        told = family_of(plant)
        return cls.ratio == "g22" and bool(told.view) and action_mode in told.sees().hauls

    @classmethod
    def parameters_for(cls, plant: str, action_mode: str, task: str) -> ParameterTable:
        """The tunable gains: the same for every load that is hauled."""
        if plant in cls.plants:
            return super().parameters_for(plant, action_mode, task)
        cls.check_case(plant, action_mode, task)
        return _POSITION if task == "position" else _TENSION

    def use_rig(self, rig: Mapping[str, Any]) -> None:
        super().use_rig(rig)
        g = self.gains
        self._hole: Hauling
        if self.plant in self.plants:
            self._hole = HoleModel(self.rig, self.ratio)
            inner = self.rig["inner_kp"], self.rig["inner_kd"]
        else:  # the drive is told its tension: there is no inner loop to invert
            self._hole, inner = view_of(self.plant, self.rig, self.action_mode, self.task).hauling(), (0.0, 0.0)
        self._hole.require_spring(self.task)
        a_m = np.array([[0.0, 1.0], [-g["model_stiffness"], -g["model_damping"]]])
        p = solve_continuous_lyapunov(a_m.T, -np.diag([g["q_position"], g["q_velocity"]]))
        self._p2 = float(p[0, 1]), float(p[1, 1])
        self._step = tuple(map(float, expm(a_m * self.dt).ravel()))
        self._settle = g["model_stiffness"] / g["model_damping"]  # 1/s, speed wanted for an error
        if self.task == "position":
            self._start, self._rates = (g["ke_position"], g["ke_velocity"]), (g["gamma_position"], g["gamma_velocity"])
        else:
            self._start = g["ke_integral"], g["ke_proportional"]
            self._rates = g["gamma_integral"], g["gamma_proportional"]
        self._law = self._position if self.task == "position" else self._tension
        kp, kd, k = *inner, self._hole.cable_stiffness
        self._inner = kp / (1.0 + kd * k), kd / (1.0 + kd * k), kd * k / (1.0 + kd * k)
        force = min(self.rig["tension_command_limit"], self.rig["tension_limit"])
        self._force_range = (0.0, force)

    def reset(self) -> None:
        self.gain_e = list(self._start)
        """K_e as adapted so far"""
        self.model_error: tuple[float, float] | None = None
        """(e_m, e_m') of the reference model; None before the first step"""
        self._last_ref: Reference | None = None
        self._last_force: float | None = None
        self._side = 0.0
        self._integral = 0.0
        self._adapting = True

    def act(self, t: float, y: Mapping[str, float], ref: Reference) -> float:
        free, slip = self._law(y, ref)
        low, high = self._force_range
        force = low if free < low else high if free > high else free
        self._adapting = force == free
        self._last_ref = ref
        if self.action_mode == "tension":
            return force
        return self.limit(self._drive_speed(force, y["drive_tension"], slip))

    def _position(self, y: Mapping[str, float], ref: Reference) -> tuple[float, float]:
        """(F of G29, sliding speed)."""
        hole, g = self._hole, self.gains
        position, velocity = y["load_position"], y["load_velocity"]
        e, rate = ref[0] - position, ref[1] - velocity
        w = self._adapt(e, rate, self._jump(ref), g["position_scale"])
        resistance = hole.resistance(position, velocity)
        force = hole.mass * (g["kp"] * e + g["kd"] * rate + ref[2] + w) + resistance
        n = hole.ratio(velocity, y["drive_tension"], resistance)
        wanted = ref[1] + self._settle * e if self.direction == "wanted" else velocity
        return force * n ** self._interpolated(wanted), velocity

    def _tension(self, y: Mapping[str, float], ref: Reference) -> tuple[float, float]:
        """(F of the extension to tension tasks, sliding speed)."""
        hole = self._hole
        e = ref[0] - y["load_tension"]
        jump = self._jump(ref)[0]
        w = self._adapt(self._integral, e, (0.0, jump), self.gains["tension_scale"])
        if self._adapting:
            self._integral += e * self.dt
        slip = ref[1] / hole.stiffness
        n = hole.ratio(slip, y["drive_tension"], y["load_tension"])
        wanted = slip + self._settle * e / hole.stiffness if self.direction == "wanted" else y["drive_velocity"]
        if abs(wanted) > self.gains["direction_speed"]:
            self._side = 1.0 if wanted > 0.0 else -1.0
        return (ref[0] + w) * n**self._side, slip

    def _adapt(self, e: float, rate: float, jump: tuple[float, float], scale: float) -> float:
        """w of G33 after one step of the reference model (G32) and of the adaptive law (G34)."""
        k0, k1 = self.gain_e
        if self.model_error is None:
            self.model_error = e, rate
        m0, m1 = self.model_error[0] + jump[0], self.model_error[1] + jump[1]
        if self._adapting:
            mismatch = ((m0 - e) * self._p2[0] + (m1 - rate) * self._p2[1]) * SIGN_OF_B * self.dt / (scale * scale)
            k0 += self._rates[0] * e * mismatch
            k1 += self._rates[1] * rate * mismatch
            self.gain_e = [min(max(k, -_LARGEST_GAIN), _LARGEST_GAIN) for k in (k0, k1)]
        a, b, c, d = self._step
        self.model_error = a * m0 + b * m1, c * m0 + d * m1
        return self.gain_e[0] * e + self.gain_e[1] * rate

    def _jump(self, ref: Reference) -> tuple[float, float]:
        """What the reference and its rate did beyond their own derivatives since the last step: steps and kinks."""
        if self._last_ref is None:
            return 0.0, 0.0
        r0, v0, a0 = self._last_ref
        return (
            ref[0] - r0 - 0.5 * self.dt * (v0 + ref[1]),
            ref[1] - v0 - 0.5 * self.dt * (a0 + ref[2]),
        )

    def _interpolated(self, speed: float) -> float:
        """Direction s in [-1, 1]."""
        width = self.gains["direction_speed"]
        if abs(speed) >= width:
            return 1.0 if speed > 0.0 else -1.0 if speed < 0.0 else 0.0
        return speed / width

    def _drive_speed(self, force: float, tension: float, slip: float) -> float:
        """Drive speed of G35, solved for the cable's own T' = k (v - slip): sampled as printed it would be unstable."""
        last = force if self._last_force is None else self._last_force
        self._last_force = force
        kp, kd, through = self._inner
        return kp * (force - tension) + kd * (force - last) / self.dt + through * slip


class MracG22(_Mrac):
    """MRAC that compensates the tension ratio with lateral extrusion (G22)."""

    name = "mrac-g22"
    ratio = "g22"


_CHOSEN = {"kp": 3000.0, "kd": 50.0, "position_scale": 1e-3}
"""What the paper leaves open, chosen well: outer gains of about 8 Hz, and errors in mm, as its figures have them."""


class Mrac(MracG22):
    """The law of `MracG22` with outer gains that hold the load, and an adaptation that does something."""

    name = "mrac"
    general = False
    gain_tables: ClassVar = {
        case: ParameterTable(*(replace(p, default=_CHOSEN.get(p.name, p.default)) for p in table))
        for case, table in MracG22.gain_tables.items()
    }


class MracG9(_Mrac):
    """MRAC that compensates the tension ratio without extrusion (G9): the paper's comparison."""

    name = "mrac-g9"
    ratio = "g9"
