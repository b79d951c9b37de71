"""Figs. 18 and 19: the inputs of the control experiments, which are drawn without numbers, and what can be inferred.

The tensions of section 5.3 fix the peak speed of the sinusoid: raising takes G n and lowering G / n, and n at 60
degrees grows with speed. Here n comes from Eq. (8) with M = mu + K v^omega by integration, not from the closed form.
Amplitude and frequency only enter as their product, but for inertia: from some frequency on it would move the extremes
of the tension away from the printed ones.
"""

import math
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from cable_envs.identification.problem import PAPER_RHO0
from cable_envs.reproduction import style
from cable_envs.reproduction.gu.data import PEAK_SPEED, TABLE_2
from cable_envs.reproduction.gu.fig20_25 import AMPLITUDE, FREQUENCY, RANGES
from cable_envs.reproduction.gu.runs import STEP_TIME, Case, Ramp, Sine, run
from cable_envs.reproduction.registry import Figure, Progress, Result
from cable_envs.reproduction.rows import Row, missing, statement
from cable_envs.reproduction.yardstick import CURVE, STATEMENT

WRAP = math.pi / 3
"""rad; section 5.3"""
GRAVITY = 9.81
RAMP_SPEED = 5e-3
"""m/s; chosen, half of the peak speed"""
HALF = 0.5
"""N; half a unit of the printed tensions"""


def ratio(speed: float) -> float:
    """Tension ratio of Table 2's cable at 60 degrees by integration of the balance of an element.

    Parameters
    ----------
    speed : float
        m/s.

    Returns
    -------
    float
    """
    rho, m = PAPER_RHO0 * (1 + TABLE_2.delta), TABLE_2.mu + TABLE_2.K * speed**TABLE_2.omega

    def slope(_: float, y: np.ndarray) -> tuple[float, float]:
        return y[1], (rho * m * y[0] - (1 + rho) * y[1]) / m

    return float(solve_ivp(slope, (0.0, WRAP), (1.0, 0.0), method="DOP853", rtol=1e-10, atol=1e-12).y[0, -1])


def peak_speed(low: float, high: float) -> float:
    """The speed (m/s) at which raising and lowering one load takes two tensions (N): n^2 = high / low."""
    return float(brentq(lambda v: ratio(v) - math.sqrt(high / low), 1e-5, 0.05, xtol=1e-9))


def extremes(speed: float, frequency: float, mass: float) -> tuple[float, float]:
    """Lowest and highest tension (N) of a load that follows a sinusoid of a peak speed (m/s) and a frequency (Hz)."""
    phase = np.linspace(0.0, 2 * math.pi, 721)
    v = speed * np.cos(phase)
    force = mass * (GRAVITY - 2 * math.pi * frequency * speed * np.sin(phase))
    table = np.linspace(0.0, speed, 40)
    n = np.interp(np.abs(v), table, [ratio(s) for s in table])
    tension = force * np.where(v >= 0, n, 1 / n)
    return float(tension.min()), float(tension.max())


def shared(frequency: float, speed: float) -> float:
    """Largest inertia force (N) of the load at a frequency (Hz) and a peak speed (m/s)."""
    low, high = RANGES["g22"]
    return math.sqrt(low * high) / GRAVITY * 2 * math.pi * frequency * speed


def highest_frequency() -> float:
    """The frequency (Hz) from which on inertia moves the extremes of the tension by more than the printed digits allow.

    Speed and load are those of no inertia; half a unit of a printed tension is what may be lost.
    """
    low, high = RANGES["g22"]
    speed, mass = peak_speed(low, high), math.sqrt(low * high) / GRAVITY

    def excess(frequency: float) -> float:
        found = extremes(speed, frequency, mass)
        return max(abs(found[0] - low), abs(found[1] - high)) - HALF

    return float(brentq(excess, 0.01, 20.0, xtol=1e-3))


def reproduce(progress: Progress) -> Result:
    """What the tensions say of the sinusoid; a motion at constant speed."""
    low, high = RANGES["g22"]
    progress(0.0, "peak speed from the tensions")
    speed = peak_speed(low, high)
    bounds = (peak_speed(low + HALF, high - HALF), peak_speed(low - HALF, high + HALF))
    progress(0.3, "frequency from inertia")
    top = highest_frequency()
    progress(0.7, "constant speed and sinusoid")
    uniform = run([Case("g22", Ramp(RAMP_SPEED), {}, noise=0.0)], 6.0).late(2.0)["drive_tension"][:, 0]
    moved = run([Case("g22", Sine(AMPLITUDE, FREQUENCY), {}, noise=0.0)], 12.0).late(1 / FREQUENCY)["drive_tension"][
        :, 0
    ]
    return Result(
        [*input_rows(speed, bounds, top), *motion_rows(uniform, moved, speed, top)],
        (figure(speed, bounds, top),),
        notes=(
            f"Used in gu-fig20-25: a step of {1e3 * AMPLITUDE:g} mm at {STEP_TIME:g} s, which the text gives, and a "
            f"sinusoid of {1e3 * AMPLITUDE:g} mm at {FREQUENCY:g} Hz, with other amplitudes beside them.",
        ),
        why="The amplitudes and the frequency cannot be read from the text. The tensions fix their product, and "
        "inertia bounds the frequency from above.",
    )


def input_rows(speed: float, bounds: tuple[float, float], top: float) -> list[Row]:
    """What is not printed of the two inputs."""
    drawn = "It is only drawn, without a number in the text."
    least = 1e3 * speed / (2 * math.pi * top)
    return [
        missing("amplitude of the step (Fig. 18)", None, 1e3 * AMPLITUDE, "mm", drawn, how="10 mm are assumed."),
        missing(
            "peak speed of the sinusoid (Fig. 19)",
            None,
            1e3 * speed,
            "mm/s",
            drawn,
            how=f"The tensions of 33 and 73 N need it, with Table 2 and rho = {PAPER_RHO0:g}; those that round to "
            f"them give {1e3 * bounds[0]:.2f} to {1e3 * bounds[1]:.2f} mm/s. Eq. (8) is integrated.",
        ),
        missing(
            "amplitude of the sinusoid (Fig. 19)",
            None,
            1e3 * AMPLITUDE,
            "mm",
            drawn,
            how=f"10 mm are assumed. It is at least {least:.2g} mm, or inertia would move the tensions by more than "
            "half a newton.",
        ),
        missing(
            "frequency of the sinusoid (Fig. 19)",
            None,
            FREQUENCY,
            "Hz",
            drawn,
            how=f"It follows from the assumed amplitude and the peak speed. It is at most {top:.2g} Hz, or inertia "
            "would move the tensions by more than half a newton.",
        ),
    ]


def motion_rows(uniform: np.ndarray, moved: np.ndarray, speed: float, top: float) -> list[Row]:
    """What section 5.3 says of uniform and of varying motion."""
    low, high = RANGES["g22"]
    swing = float(np.ptp(uniform))
    return [
        statement(
            "resistance at the hole in uniform motion (section 5.3)",
            "remains basically constant",
            f"{float(uniform.mean()):.2f} N, within {swing:.2g} N",
            CURVE.within(1.0, 1.0 + swing / float(uniform.mean())),
            how=f"Tension of the drive at {1e3 * RAMP_SPEED:g} mm/s, without sensor noise, after 2 s.",
        ),
        statement(
            "resistance while the desired signal varies (section 5.3)",
            "changes",
            f"{float(moved.min()):.1f} to {float(moved.max()):.1f} N",
            float(np.ptp(moved)) > 10 * swing,
            how="The sinusoid of gu-fig20-25, without sensor noise.",
        ),
        missing(
            "inertia forces as a cause of the changes (section 5.3)",
            "named beside the cable tension",
            f"{2 * shared(FREQUENCY, speed):.2g} N of {high - low:g} N",
            "",
            "The frequency decides it and is not printed.",
            how=f"From end to end, at the assumed {FREQUENCY:.2g} Hz. At the highest frequency that the tensions "
            f"allow it would be {2 * shared(top, speed):.2g} N.",
            kind=STATEMENT,
        ),
    ]


def figure(speed: float, bounds: tuple[float, float], top: float) -> Figure:
    """Both inputs as chosen, and the amplitudes and frequencies that the tensions allow."""

    def draw(fig: Any) -> None:
        left, right = fig.subplots(1, 2, width_ratios=(1.3, 1))
        time = np.linspace(0.0, 20.0, 801)
        left.plot(time, 1e3 * AMPLITUDE * (time >= STEP_TIME), color=style.COLOURS[0], label="step, Fig. 18")
        sine = 1e3 * AMPLITUDE * np.sin(2 * math.pi * FREQUENCY * time)
        left.plot(time, sine, color=style.COLOURS[1], linestyle=style.DASHES[1], label="sinusoid, Fig. 19")
        left.set(xlabel="time [s]", ylabel="desired position [mm]", xlim=(0, 20), ylim=(-12, 17))
        left.legend(loc="upper left", ncols=2)
        frequency = np.geomspace(0.02, 30.0, 80)
        band = [1e3 * v / (2 * math.pi * frequency) for v in (*bounds, speed)]
        allowed = frequency <= top
        right.fill_between(frequency[allowed], band[0][allowed], band[1][allowed], color=style.COLOURS[0], alpha=0.3)
        right.plot(frequency[allowed], band[2][allowed], color=style.COLOURS[0], label="33 to 73 N")
        right.plot(frequency[~allowed], band[2][~allowed], color=style.COLOURS[0], linestyle=style.DASHES[2])
        right.axvline(top, color=style.INK, linewidth=0.7)
        right.text(top * 0.85, 25, "beyond:\ninertia\ntoo large", fontsize=7.5, ha="right")
        right.plot([FREQUENCY], [1e3 * AMPLITUDE], "s", color=style.COLOURS[1], markersize=4, label="chosen")
        right.set(xscale="log", yscale="log", xlabel="frequency [Hz]", ylabel="amplitude [mm]")
        right.legend(loc="lower left")
        style.letters((left, right))

    caption = (
        f"(a) The inputs of Figs. 18 and 19 as chosen here; the step comes at {STEP_TIME:g} s as the text says. (b) "
        f"Amplitudes and frequencies with a peak speed of {1e3 * PEAK_SPEED:g} mm/s, which the printed tensions need."
    )
    return Figure("inputs", caption, style.svg(draw, style.PAGE, 2.7))
