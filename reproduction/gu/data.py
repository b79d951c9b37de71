"""What Gu 2024 prints about its nine cables, and 75 test points as section 5.2 describes them.

Not printed, and chosen here: the speeds, which way the load moves, the hole. Choices: five wraps from 30 to 90 degrees
times fifteen speeds; the load is lowered, because n = m g / T (Eq. 36) exceeds 1 only then; rho0 = 1.5 and 5 kg as
inferred in docs/physics.md.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from cable_envs.identification.problem import PAPER_RHO0, RatioProblem, ratio_at
from cable_envs.physics.extrusion import ExtrudedContact, nonlinear_tension_profile, nonlinear_tension_ratio

WEIGHT = 49.05
"""N; 5 kg, inferred from the tensions of section 5.3 (docs/physics.md)"""
SENSOR_STD = 0.1
"""N; "the measurement accuracy of the tension can reach 0.1 N", section 5.1, read as a standard deviation"""
PEAK_SPEED = 0.0108
"""m/s; inferred from the tensions of section 5.3"""
WRAPS = np.radians([30.0, 45.0, 60.0, 75.0, 90.0])
SPEEDS = 15


@dataclass(frozen=True)
class Cable:
    """A row of Table A1, SI."""

    name: str
    diameter: float
    compression: tuple[float, float, float]
    """m, at 30, 60 and 90 degrees"""
    delta: float
    mu: float
    K: float
    omega: float

    @property
    def parameters(self) -> dict[str, float]:
        """Identified values with the inferred rho0."""
        return {"delta": self.delta, "mu": self.mu, "K": self.K, "omega": self.omega, "rho0": PAPER_RHO0}

    @property
    def full_speed(self) -> float:
        """m/s at which C = K v^omega reaches 1: the extrusion is then well above mu and n not yet saturated."""
        return self.K ** (-1.0 / self.omega)


_TABLE_A1 = (
    ("steel wire 1 mm", 1, (.172, .191, .232), .019, .283, 1192, 3.53),
    ("steel wire 2 mm", 2, (.364, .396, .416), .015, .274, 2643, 3.48),
    ("steel wire 3 mm", 3, (.371, .402, .433), .009, .297, 3347, 3.44),
    ("braided fibre 1 mm", 1, (.211, .312, .340), .028, .425, 3027, 2.02),
    ("braided fibre 2 mm", 2, (.365, .485, .561), .020, .430, 6574, 2.03),
    ("braided fibre 3 mm", 3, (.397, .66, .967), .015, .427, 9982, 1.99),
    ("rubber 1 mm", 1, (.307, .391, .488), .042, .328, 1918, 1.67),
    ("rubber 2 mm", 2, (.364, .536, .646), .033, .334, 4622, 1.66),
    ("rubber 3 mm", 3, (.468, .924, 1.382), .027, .320, 6913, 1.71),
)  # fmt: skip

CABLES: Mapping[str, Cable] = {
    name: Cable(name, d * 1e-3, (1e-3 * eps[0], 1e-3 * eps[1], 1e-3 * eps[2]), *map(float, rest))
    for name, d, eps, *rest in _TABLE_A1
}
TABLE_2 = CABLES["braided fibre 2 mm"]
"""Table 2 (0.02, 0.43, 6574, 2.03) is the row of this cable in Table A1."""


def grid_points(top_speed: float) -> tuple[np.ndarray, np.ndarray]:
    """(wrap rad [75], speed m/s [75])."""
    wrap, speed = np.meshgrid(WRAPS, top_speed * np.arange(1, SPEEDS + 1) / SPEEDS, indexing="ij")
    return wrap.ravel(), speed.ravel()


def simulated_ratios(cable: Cable, top_speed: float) -> np.ndarray:
    """Tension ratios of a cable by the numerical solution of Eq. (13).

    The area is proportional to the line force, as C = K v^omega assumes. The modulus drops out then, and one solution
    up to 90 degrees serves all wraps.

    Parameters
    ----------
    cable : Cable
        Row of Table A1.
    top_speed : float
        Highest speed of the experiment, m/s.

    Returns
    -------
    ndarray [75]
        Ratio of the high to the low tension at `grid_points`.
    """
    found = []
    for v in np.unique(grid_points(top_speed)[1]):
        _, tension, _ = nonlinear_tension_profile(
            lateral_contact(cable, 1e9), cable.mu, cable.K, cable.omega, v, WRAPS[-1], 1.0,
            delta=cable.delta, law="linear", points=7,
        )  # fmt: skip
        found.append(tension[2:])  # 30, 45, ... degrees
    return np.array(found).T.ravel()


def simulated_ratios_exact_area(
    cable: Cable, contact: ExtrudedContact, wrap: np.ndarray, speed: np.ndarray, accuracy: float = 1e-5
) -> np.ndarray:
    """Tension ratios of Eq. (13) with the area of Eq. (6): they depend on the tension, whose high end is the load.

    Parameters
    ----------
    cable : Cable
    contact : ExtrudedContact
        The cable in its hole, `lateral_contact`.
    wrap : ndarray [points]
        rad.
    speed : ndarray [points]
        m/s.
    accuracy : float
        Change of the ratio below which the iteration ends.

    Returns
    -------
    ndarray [points]
    """
    found, n = np.empty(len(wrap)), 1.3
    for i, (phi, v) in enumerate(zip(wrap, speed, strict=True)):
        for _ in range(12):
            before = n
            n = nonlinear_tension_ratio(
                contact, cable.mu, cable.K, cable.omega, v, phi, WEIGHT / n, delta=cable.delta, law="exact"
            )
            if abs(n - before) < accuracy:
                break
        found[i] = n
    return found


def measured(
    ratio: np.ndarray, rng: np.random.Generator | None, std: float = SENSOR_STD
) -> tuple[np.ndarray, np.ndarray]:
    """Ratios as the experiment measures them: n = m g / T, Eq. (36), with the noise of the tension sensor.

    Parameters
    ----------
    ratio : ndarray [points]
        True ratios.
    rng : numpy.random.Generator or None
        Draws the noise; None: no noise.
    std : float
        Of the sensor, N.

    Returns
    -------
    ratio, std : ndarray [points]
        Measured, and its standard deviation to first order.
    """
    noise = 0.0 if rng is None else std * rng.standard_normal(len(ratio))
    return WEIGHT / (WEIGHT / ratio + noise), ratio**2 * std / WEIGHT


def problem(cable: Cable, top_speed: float, rng: np.random.Generator | None) -> RatioProblem:
    """Identification of one cable from its 75 points, made by the numerical solution of Eq. (13).

    Parameters
    ----------
    cable : Cable
    top_speed : float
        Highest speed of the experiment, m/s.
    rng : numpy.random.Generator or None
        Draws the sensor's noise; None: no noise.

    Returns
    -------
    RatioProblem
    """
    wrap, speed = grid_points(top_speed)
    return RatioProblem(wrap, speed, *measured(simulated_ratios(cable, top_speed), rng))


def design(cable: Cable, top_speed: float) -> RatioProblem:
    """The same points with closed-form ratios: for questions about the experiment that need no data."""
    wrap, speed = grid_points(top_speed)
    return RatioProblem(wrap, speed, *measured(ratio_at(cable.parameters, wrap, speed), None))


def lateral_contact(cable: Cable, modulus: float) -> ExtrudedContact:
    """The cable in its hole of rho0 = 1.5; modulus in Pa."""
    return ExtrudedContact(PAPER_RHO0 * cable.diameter / 2, cable.diameter / 2, modulus)


def degrees(angle: float) -> str:
    """An angle in rad as text."""
    return f"{math.degrees(angle):g}°"
