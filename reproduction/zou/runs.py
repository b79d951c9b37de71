"""Runs of the circuit as in sections 3.1-3.3 of Zou 2022: drive angle given, output free up to a contact.

"Error" needs an expected value, and the paper does not say which. The expected angle is that of a rigid cable,
theta_in R0 / R5. For the torque there are two readings, `EXPECTED`:

drive    M_in R5 / R0: what a circuit without friction would pass on
contact  k (theta_in R0 / R5 - contact angle) where positive: what the touched sensor would answer at the expected angle

Under "contact" the largest errors of torque and position are in the ratio k. Table 4 has 0.573, 0.563 and 0.568 N m/rad
at 12.5, 50 and 150 N; Figs. 11 and 12 have 0.88 and 0.96. No pretension, friction or elongation enters. That is why
"contact" is the reading used here; "drive" is computed beside it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from cable_envs.core.errors import ConfigurationError
from cable_envs.core.inputs import INPUTS
from cable_envs.plants import plant_for
from cable_envs.plants.circuit.parameters import CIRCUIT
from cable_envs.reproduction.zou.data import AMPLITUDE, PERIOD

EXPECTED = ("contact", "drive")
DT, SUBSTEPS = 0.01, 10
CONTACT_DAMPING = 1e-3
"""N m s; chosen, of no influence at 0.08 Hz (1e-3 N m)"""


@dataclass(frozen=True)
class Run:
    """Signals of mechanisms side by side: ``run["output_angle"]`` is [samples, mechanisms]."""

    time: np.ndarray
    signals: Mapping[str, np.ndarray]
    rigs: Sequence[Mapping[str, float]]

    def __getitem__(self, name: str) -> np.ndarray:
        return self.signals[name]

    def rig(self, name: str) -> np.ndarray:
        """One parameter of all mechanisms  [mechanisms]."""
        return np.array([rig.get(name, CIRCUIT[name].default) for rig in self.rigs])

    def part(self, start: float, end: float = np.inf) -> "Run":
        """The samples with start < time <= end."""
        inside = (self.time > start + 1e-9) & (self.time <= end + 1e-9)
        return Run(self.time[inside], {name: v[inside] for name, v in self.signals.items()}, self.rigs)

    @property
    def expected_angle(self) -> np.ndarray:
        """Output angle behind a rigid cable, rad  [samples, mechanisms]."""
        return self["drive_angle"] * self.rig("drive_radius") / self.rig("output_radius")

    @property
    def position_error(self) -> np.ndarray:
        """Expected less actual angle, rad  [samples, mechanisms]."""
        return self.expected_angle - self["output_angle"]

    def contact_torque(self, angle: np.ndarray) -> np.ndarray:
        """What the touched object answers at an output angle at rest, N m."""
        return self.rig("contact_stiffness") * np.maximum(angle - self.rig("contact_angle"), 0.0)

    def torque_error(self, expected: str = "contact", bearing_arm: float | np.ndarray = 0.0) -> np.ndarray:
        """Expected less actual torque, N m; ``expected`` is one of `EXPECTED`.

        ``bearing_arm`` (m, friction coefficient times radius of the bearing) is the friction of the driving pulley's
        bearing per tension on it. It reaches only what a motor current measures: the drive's angle is given.
        """
        if expected == "contact":
            return self.contact_torque(self.expected_angle) - self.contact_torque(self["output_angle"])
        if expected != "drive":
            raise ConfigurationError(
                f"unknown reading '{expected}' of the expected torque; one of {', '.join(EXPECTED)}"
            )
        load = self["tension_drive_top"] + self["tension_drive_bottom"]
        motor = self["drive_torque"] + bearing_arm * load * np.sign(self["drive_velocity"])
        return motor * self.rig("output_radius") / self.rig("drive_radius") - self["output_torque"]


def sinusoid(cycles: float = 1.25, dt: float = DT, amplitude: float = AMPLITUDE, period: float = PERIOD) -> np.ndarray:
    """A sinusoidal drive angle: amplitude sin(2 pi t / period) at t = 0, dt, ...

    Parameters
    ----------
    cycles : float
        Length in periods.
    dt : float
        Sampling period, s.
    amplitude : float
        rad.
    period : float
        s.

    Returns
    -------
    ndarray [samples + 1]
    """
    return amplitude * np.sin(2 * np.pi / period * dt * np.arange(round(cycles * period / dt) + 1))


def follow(
    variant: str,
    rigs: Sequence[Mapping[str, float]],
    angle: np.ndarray,
    dt: float = DT,
    substeps: int = SUBSTEPS,
    action_mode: str = "position",
) -> Run:
    """Drive mechanisms along an angle through their position servos, or by a torque.

    Parameters
    ----------
    variant : str
        Plant, "analytic" or "chain".
    rigs : sequence of mapping
        Parameters of the mechanisms, SI.
    angle : ndarray [samples + 1]
        Of every drive, rad; the first is the start. With the action mode "torque": its torque, N m.
    dt : float
        Sampling period, s.
    substeps : int
        Integration steps in a sample.
    action_mode : str
        "position" or "torque".

    Returns
    -------
    Run
        From rest at output angle 0, unless the contact is below that.
    """
    plant = plant_for("pulley_circuit", variant)
    p = plant.prepare(np.stack([CIRCUIT.pack(rig) for rig in rigs], axis=1))
    x = plant.rest(p, np.zeros(len(rigs)))
    u = INPUTS.zeros(len(rigs))
    u.mode[:] = [mode.name for mode in plant.action_modes].index(action_mode)
    names = [s.name for s in plant.signals if not s.name.startswith(("stretch_", "slip_"))]
    kept = np.empty((len(angle) - 1, len(names), len(rigs)))
    for k in range(len(angle) - 1):
        u.command[:], u.command_rate[:] = angle[k + 1], (angle[k + 1] - angle[k]) / dt
        plant.advance(x, p, u.rows, 0, len(rigs), substeps, dt / substeps)
        kept[k] = x[: len(names)]
    return Run(dt * np.arange(1, len(angle)), {name: kept[:, i] for i, name in enumerate(names)}, rigs)


def last_cycle(run: Run, period: float = PERIOD) -> Run:
    """The last whole period."""
    return run.part(run.time[-1] - period)


def four_errors(
    run: Run, expected: str = "contact", half: bool = False, bearing_arm: float | np.ndarray = 0.0
) -> np.ndarray:
    """The columns of Table 4: maximum and mean of the position error (rad) and of the torque error (N m).

    Parameters
    ----------
    run : Run
    expected : str
        Where the expected torque comes from, one of `EXPECTED`.
    half : bool
        Only over the half cycle in which the drive is on the contact's side (theta_in > 0).
    bearing_arm : float or ndarray
        As of `Run.torque_error`, m.

    Returns
    -------
    ndarray [mechanisms, 4]
    """
    found = (np.abs(run.position_error), np.abs(run.torque_error(expected, bearing_arm)))
    used = (run.expected_angle > 0.0) if half else np.ones_like(found[0], dtype=bool)
    count = np.maximum(used.sum(axis=0), 1)
    columns = [v for e in found for v in ((e * used).max(axis=0), (e * used).sum(axis=0) / count)]
    return np.stack(columns, axis=1)
