"""A real drive in the place of an ideal one: motor, gear, supply, encoder and the servo on top.

The servo is the paper's (Zou 2022, Fig. 7): a PID on what the encoder shows, and a torque saturator behind it. It runs
at the encoder's rate and holds its torque between two readings. Where the command is a torque or a tension it goes to
the saturator.

    reading   angle of the encoder, in steps, every ``encoder_period``; its rate from differences, filtered
    servo     M* = kp e + ki int e + kd (r' - rate), within the saturator, which holds the integral up to
              where it passes it on
    motor     i = M* / (N k_t) within what current limit, voltage and back-EMF allow (`physics.motor`)
    drive     J a = M(i) - b v - friction - cogging - torque of the cables, J with the rotor behind its gear

A drive that moves along the cable has a spool of radius r, or a screw of the lead 2 pi r, behind the gear. It is the
same with m and N in the place of rad and N m, N / r in the place of N, and J / r^2 + m in the place of J.

``drive: motor`` in a rig file asks for it. Without, the drive is ideal: a servo that no cable can push, or a torque or
tension within its limits and nothing else.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cable_envs.core.compiling.templates import specialised
from cable_envs.core.params import Parameter, ParameterTable
from cable_envs.effects import Layout
from cable_envs.physics.modes import longest_step
from cable_envs.plants.base import Plant, Signal
from cable_envs.plants.servo_stages import SHOWN, Shown, turned

SMALL = "chosen: the size of a 16 mm DC motor of 12 V"
FLAT = "chosen: the size of a maxon EC 45 flat, 70 W, 24 V"


def motor_parameters(
    constant: float, resistance: float, limit: float, voltage: float, ratio: tuple[float, str], size: str
) -> tuple[Parameter, ...]:
    """What every drive with a motor has, however it moves the cable."""
    return (
        Parameter(
            "motor_constant", "N m/A", constant, 1e-6, 1e3, "torque constant k_t, that of the back-EMF too", size
        ),
        Parameter("motor_resistance", "ohm", resistance, 1e-6, 1e6, "resistance of the winding", size),
        Parameter("motor_current_limit", "A", limit, 1e-6, 1e4, "largest current of the amplifier, both ways", size),
        Parameter("motor_inertia", "kg m^2", 0.0, 0.0, 10.0, "inertia of the rotor, besides that of the drive", "null"),
        Parameter("supply_voltage", "V", voltage, 1e-3, 1e4, "voltage of the supply without load", size),
        Parameter("supply_resistance", "ohm", 0.2, 0.0, 1e4, "resistance of the supply and its leads", "chosen"),
        Parameter("gear_ratio", "1", ratio[0], 1e-3, 1e4, "turns of the motor for one of the drive", ratio[1]),
        Parameter("gear_efficiency", "1", 0.8, 0.01, 1.0, "share of the power that gear and screw pass", "chosen"),
        Parameter("cogging_torque", "N m", 0.0, 0.0, 1e3, "amplitude of the motor's cogging, at the motor", "null"),
        Parameter("cogging_periods", "1", 12.0, 1.0, 1e4, "periods of the cogging in a turn of the motor", "chosen"),
        Parameter("encoder_counts", "1", 2048.0, 0.0, 1e8, "steps in a turn of the motor; 0: none", "chosen"),
        Parameter("encoder_period", "s", 1e-3, 1e-6, 1.0, "time between two readings of the encoder", "chosen: 1 kHz"),
        Parameter("servo_filter", "s", 1e-3, 0.0, 1.0, "time constant of the filter of the encoder's rate", "chosen"),
    )


TURNING = (
    *motor_parameters(0.0115, 3.3, 1.5, 12.0, (44.0, "Table 1, Zou 2022"), SMALL),
    Parameter("drive_friction", "N m", 0.01, 0.0, 1e3, "Coulomb friction of motor and gear, at the drive", SMALL),
    Parameter("servo_kp", "N m/rad", 6.0, 0.0, 1e6, "proportional gain of the servo", "chosen: 24 Hz with the drive"),
    Parameter("servo_ki", "N m/(rad s)", 120.0, 0.0, 1e8, "integral gain of the servo", "chosen"),
    Parameter("servo_kd", "N m s/rad", 0.06, 0.0, 1e5, "derivative gain of the servo", "chosen"),
)
"""Parameters of a drive that turns a pulley."""

ALONG = (
    *motor_parameters(0.0404, 0.573, 6.6, 24.0, (1.0, "chosen: a screw needs no gear"), FLAT),
    Parameter("spool_radius", "m", 0.01, 1e-5, 10.0, "radius of the spool; of a screw its lead over 2 pi", "chosen"),
    Parameter("spool_inertia", "kg m^2", 0.0, 0.0, 10.0, "inertia of the spool, or of the screw", "null"),
    Parameter("drive_friction", "N", 1.0, 0.0, 1e5, "Coulomb friction of motor and screw, at the cable", "chosen"),
    Parameter("servo_kp", "N/m", 6e4, 0.0, 1e9, "proportional gain of the servo", "chosen"),
    Parameter("servo_ki", "N/(m s)", 6e5, 0.0, 1e11, "integral gain of the servo", "chosen"),
    Parameter("servo_kd", "N s/m", 800.0, 0.0, 1e8, "derivative gain of the servo", "chosen"),
)
"""Parameters of a drive that moves along the cable."""

MOTOR = tuple(dict.fromkeys(p.name for p in (*TURNING, *ALONG)))
"""Names of the parameters that a drive with a motor has besides."""


def servo_signals(
    angle: str, rad: str, torque: str, newton_metre: str, drives: Mapping[str, str] | None = None
) -> tuple[Signal, ...]:
    """What drives with a motor show besides, where their coordinate and their torque are called so.

    ``drives``: for each a pattern of its signals' names, and what it is called; one drive unless it is given.
    """
    each = drives or {"{}_{}": "drive"}
    rows = (
        ("encoder", angle, rad, "what the encoder of the {} shows"),
        ("encoder", "velocity", f"{rad}/s", "rate of the encoder of the {}, from differences, filtered"),
        ("motor", "current", "A", "current of the motor of the {}"),
        ("motor", torque, newton_metre, f"{torque} of the motor of the {{}}, behind its gear"),
        ("servo", torque, newton_metre, f"{torque} that the servo of the {{}} asks for, behind the saturator"),
        ("servo", "integral", newton_metre, "integral part of the servo of the {}"),
        ("servo", "age", "s", "time since the last reading of the encoder of the {}"),
    )
    return tuple(
        Signal(pattern.format(part, kind), unit, meaning.format(called))
        for part, kind, unit, meaning in rows
        for pattern, called in each.items()
    )


def along(value: Mapping[str, Any], speed: Any, limit: Any) -> tuple[Any, Any, Any, Any]:
    """`Mount.own` of a drive along the cable, with its largest speed and the limit of its saturator."""
    inertia = value["drive_mass"] + value["spool_inertia"] / value["spool_radius"] ** 2
    return inertia, value["drive_damping"], speed, limit


ENCODER = {"drive_position": "encoder_position", "drive_velocity": "encoder_velocity"}
"""What the encoder of one drive along the cable shows (`Mount.measured`)."""


def pulling(x: Any, p: Any) -> tuple[tuple[Any, Any], ...]:
    """Where one drive along the cable is at rest, and what it pulls (`Mount.held`)."""
    return ((x.drive_position, x.drive_tension),)


ROWS = (
    "moved_inertia", "moved_damping", "top_speed", "servo_limit",
    "torque_constant", "gear_ratio", "gear_efficiency", "resistance", "supply_voltage", "current_limit",
    "drive_friction", "cogging_torque", "cogging_turns", "encoder_steps", "encoder_period", "servo_kp", "servo_ki",
    "servo_kd", "servo_filter",
)  # fmt: skip
"""Coefficients, at the drive. cogging_turns: periods in a unit of its way over 2 pi; encoder_steps: in such a unit."""


IDEAL = {"servo_stiffness", "servo_damping"}
"""Coefficients of the ideal drive's servo, whose frequency is no mode of a drive with a motor: they are 0 there."""


QUICKLY = 0.2
"""Share of the encoder's period for drives on cables that rub all along: what the motor feels turns round within a few
tenths of a millisecond. With whole periods 6 random rigs of sheaths and circuits differed from 20 times shorter
steps by more than 1 %, the worst by 2.8 %."""


@dataclass(frozen=True)
class Mount:
    """How a plant carries its drive with a motor.

    Attributes
    ----------
    parameters : tuple of Parameter
        Parameters that it has besides.
    signals : tuple of Signal
        Signals that it has besides: those of `servo_signals`, then those of ``more``.
    measured : mapping of str to str
        Signal of the plant -> that of the encoders, which is what its sensor shows.
    held : callable
        (x, p) -> for each drive its position, and the torque (or tension) that holds the plant at rest.
    pieces : mapping of str to callable
        What takes the place of pieces of the plant's kernel.
    own : callable
        Values of the parameters -> (inertia without the motor, damping, speed limit, limit of the saturator).
    total : str
        Coefficient of the plant that is to be the inertia with the motor; empty: it has none.
    plain : mapping of str to float
        Coefficients of the plant that have a fixed value.
    more : tuple of str
        Rows of further signals, which begin at rest with those of ``start``.
    start : mapping of str to str
        Row of ``more`` -> signal whose value at rest it has; others begin at 0.
    gaps : int
        How many drives, from the first on, may stand in the middle of a gap at rest, where the nut holds what the
        cables pull and the servo's integral nothing.
    reading : float
        Share of the encoder's period that a step may last.
    """

    parameters: tuple[Parameter, ...]
    signals: tuple[Signal, ...]
    measured: Mapping[str, str]
    held: Callable[[Any, Any], tuple[tuple[Any, Any], ...]]
    pieces: Mapping[str, Callable]
    own: Callable[[Mapping[str, np.ndarray]], tuple[Any, Any, Any, Any]]
    total: str = ""
    plain: Mapping[str, float] | None = None
    more: tuple[str, ...] = ()
    start: Mapping[str, str] | None = None
    gaps: int = 0
    reading: float = 1.0

    @property
    def rows(self) -> list[str | tuple[str, int]]:
        """Rows of its signals: those of `SHOWN`, each for every drive, then ``more``."""
        drives = (len(self.signals) - len(self.more)) // len(SHOWN)
        return [*(name if drives == 1 else (name, drives) for name in SHOWN), *self.more]

    def derive(self, plain: Callable) -> Callable:
        """The plant's ``derive`` with the coefficients of the motor."""

        def derive(value: Mapping[str, np.ndarray], e: Any) -> dict[str, Any]:
            rows = {**plain(value, e), **(self.plain or {})}
            turns = value["gear_ratio"] / value.get("spool_radius", 1.0)
            inertia, damping, speed, limit = self.own(value)
            inertia = inertia + value["motor_inertia"] * turns**2
            if self.total:
                rows[self.total] = inertia
            rows |= dict.fromkeys(IDEAL & rows.keys(), 0.0)
            return {
                **rows,
                "moved_inertia": inertia, "moved_damping": damping, "top_speed": speed, "servo_limit": limit,
                "torque_constant": value["motor_constant"], "gear_ratio": turns,
                "gear_efficiency": value["gear_efficiency"],
                "resistance": value["motor_resistance"] + value["supply_resistance"],
                "supply_voltage": value["supply_voltage"], "current_limit": value["motor_current_limit"],
                "drive_friction": value["drive_friction"], "cogging_torque": value["cogging_torque"] * turns,
                "cogging_turns": value["cogging_periods"] * turns,
                "encoder_steps": value["encoder_counts"] * turns / (2.0 * np.pi),
                "encoder_period": value["encoder_period"], "servo_kp": value["servo_kp"],
                "servo_ki": value["servo_ki"], "servo_kd": value["servo_kd"], "servo_filter": value["servo_filter"],
            }  # fmt: skip

        return derive

    def settle(self, plain: Callable) -> Callable:
        """The plant's ``settle``, where the servo's integral, or the command, holds what the cables pull."""

        def settle(x: Any, s: Any, p: Any, e: Any, position: np.ndarray) -> None:
            plain(x, s, p, e, position)
            held = self.held(x, p)
            shown = Shown(*(getattr(x, name).reshape(len(held), -1) for name in SHOWN))
            for k, (at, pull) in enumerate(held):
                shown.encoder_angle[k], shown.servo_age[k] = at, p.encoder_period
                shown.servo_integral[k] = shown.servo_torque[k] = shown.motor_torque[k] = pull
                shown.motor_current[k] = pull / (p.torque_constant * p.gear_ratio)
            for k in range(self.gaps):
                shown.servo_integral[k] = np.where(e.backlash_gap > 0.0, 0.0, shown.servo_integral[k])
            for row, signal in (self.start or {}).items():
                getattr(x, row)[:] = getattr(x, signal)

        return settle


def resolves(plain: Callable, reading: float) -> Callable:
    """The plant's ``resolves``, with a drive that its servo and its cable, at most as stiff as the servo, hold.

    ``reading``: as of `Mount`.
    """

    def resolved(p: Any, e: Any) -> np.ndarray:
        braked = (p.torque_constant * p.gear_ratio) ** 2 / p.resistance + p.moved_damping
        servo = longest_step(p.moved_inertia, braked, p.servo_kp)
        return np.minimum(np.minimum(plain(p, e), servo), reading * p.encoder_period)

    return resolved


def mounted(plant: Plant, mount: Mount) -> Plant:
    """A plant with a real drive in the place of its ideal one.

    Parameters
    ----------
    plant : Plant
        With an ideal drive.
    mount : Mount
        How it carries the real one.

    Returns
    -------
    Plant
        Under the same name, with the parameters and the signals of the mount too. The frequency and the damping of an
        ideal servo mean nothing to it.
    """
    parameters = ParameterTable(*plant.parameters, *mount.parameters)
    effects = Layout(plant.name, parameters, plant.effects.acting, plant.own, plant.effects.worn)
    return replace(
        plant,
        parameters=parameters,
        signals=plant.signals + mount.signals,
        signal_rows=plant.signal_rows.extended(mount.rows),
        coefficient_rows=plant.coefficient_rows.extended(ROWS),
        derive=mount.derive(plant.derive),
        settle=mount.settle(plant.settle),
        solve=specialised(plant.solve, **mount.pieces),
        effects=effects,
        resolves=None if plant.resolves is None else resolves(plant.resolves, mount.reading),
        ticks="encoder_period",
        measured=mount.measured,
        drive="motor",
    )


def with_motor(plant: Plant) -> Plant:
    """A circuit with a real drive: its kernel moves the drive by the piece ``drive_step``."""
    return mounted(
        plant,
        Mount(
            parameters=TURNING,
            signals=servo_signals("angle", "rad", "torque", "N m"),
            measured={"drive_angle": "encoder_angle", "drive_velocity": "encoder_velocity"},
            held=lambda x, p: ((x.drive_angle, x.drive_torque),),
            reading=QUICKLY,
            pieces={"drive_step": turned},
            own=lambda value: (
                value["drive_inertia"], value["drive_damping"], value["drive_speed_limit"], value["drive_torque_limit"],
            ),
            total="drive_inertia",
        ),
    )  # fmt: skip
