"""What is measured in an episode, in SI. Every metric is declared once, in `METRICS`; the docstring is its definition.

A metric that does not apply (settling time of a sinusoid, phases of the cable-hole) is NaN, never zero.
Unit placeholders: ``{y}`` is the unit of the controlled output, ``{u}`` that of the command.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cable_envs.core.errors import ConfigurationError, nearest
from cablebench.protocol.episode import Episode

REVERSAL_WINDOW = 0.5
"""s after each reversal of the reference in which the reversal error is taken: longer than the actuator's lag
(tens of milliseconds), shorter than half the fastest reference period (2.9 s), so two reversals share no sample."""

CHATTER_CUTOFF = 10.0
"""Hz above which the command's power counts as chatter: an order above the references (below 1 Hz) and the reference
models of the papers' controllers (10 rad/s), a fifth of the sampling frequency of 100 Hz."""

JUMP_SHARE = 0.05
"""Of the range of the reference: what it changes by more within a control step is a jump. A sinusoid at the control
rate of 100 Hz stays below up to 1.6 Hz."""

JUMP_WINDOW = 0.25
"""s after a jump of the reference in which the command may jump too: some twenty times the delays of the tasks."""

LEAST_PERIODS = 5.0
"""Periods of the cutoff that a stretch between two jumps must have, so that its slow part does not leak above it."""

DROP = 0.05
"""m that a load may end below where it started and should be: more than twice the travel of any reference."""

STEADY_WINDOW = 2.0
"""s at the end of a step episode over which the steady-state error is averaged."""

SUCCESS_SHARE = 0.2
"""Last part of the episode in which a success must stay within the task's success error."""

PHASES = {"delay": 1, "transition": 2, "working": 3}
"""Phases of the pulley circuit as the plants report them (0 is rest)."""


@dataclass(frozen=True)
class Metric:
    """One declared metric. `better` is "lower", "higher", or "" where neither is better in itself."""

    name: str
    unit: str
    better: str
    label: str
    function: Callable[[Episode], float]

    @property
    def meaning(self) -> str:
        """The definition: the first paragraph of the function's docstring."""
        return " ".join((self.function.__doc__ or "").split("\n\n")[0].split())

    def unit_of(self, output_unit: str, command_unit: str) -> str:
        """The unit with the placeholders filled in."""
        return self.unit.format(y=_factor(output_unit, self.unit), u=_factor(command_unit, self.unit))


def _factor(unit: str, pattern: str) -> str:
    """A unit as a factor in ``pattern``: composed units get brackets before a power."""
    return f"({unit})" if "^" in pattern and (" " in unit or "/" in unit) else unit


def rmse(e: Episode) -> float:
    """Root of the mean squared tracking error over the episode."""
    return float(np.sqrt(np.mean(e.error**2)))


def priced_rmse(e: Episode) -> float:
    """Root mean square of the priced error after the homing: tracking error and the price of a restless command.

    It is what tasks of suite v1 are scored by, the same number that their reward is made of. NaN for other tasks.
    """
    scored = e.signals.get("priced_error")
    if scored is None or not np.any(e.time >= e.homing):
        return math.nan
    return float(np.sqrt(np.mean(scored[e.time >= e.homing] ** 2)))


def iae(e: Episode) -> float:
    """Integral of the absolute tracking error over time."""
    return float(np.sum(np.abs(e.error)) * e.dt)


def itae(e: Episode) -> float:
    """Integral of time times absolute tracking error.

    Time counts from the step where the reference steps (nothing counts before it), else from the start.
    """
    t = np.maximum(e.time - (e.step_time or 0.0), 0.0)
    return float(np.sum(t * np.abs(e.error)) * e.dt)


def max_error(e: Episode) -> float:
    """Largest absolute tracking error."""
    return float(np.max(np.abs(e.error)))


def _step(e: Episode) -> tuple[np.ndarray, float] | None:
    """Samples from the step on, and its size with sign; None where the reference does not step inside the episode."""
    if e.step_time is None:
        return None
    after = e.time >= e.step_time - 1e-9
    if not after.any() or after.all():
        return None
    size = float(e.reference[-1] - e.reference[~after][-1])
    return (after, size) if size != 0.0 else None


def _settling(e: Episode, band: float) -> tuple[float, bool]:
    """(settling time s, censored).

    It is censored when the error is still outside the band at the episode's end (or the episode was cut short); the
    value is then the time that was watched, a lower bound.
    """
    step = _step(e)
    if step is None:
        return math.nan, False
    after, size = step
    # the sample at the step's own time belongs to it: it is the first that the new reference holds for
    time, outside = e.time[after], np.abs(e.error[after]) > band * abs(size)
    watched = float(time[-1] - e.step_time)
    if outside[-1] or not e.complete:
        return watched, True
    if not outside.any():
        return 0.0, False
    return float(time[np.flatnonzero(outside)[-1] + 1] - e.step_time), False


def settling_2(e: Episode) -> float:
    """Time after the step until the error stays within 2 % of the step; a lower bound where censored."""
    return _settling(e, 0.02)[0]


def settling_5(e: Episode) -> float:
    """Time after the step until the error stays within 5 % of the step; a lower bound where censored."""
    return _settling(e, 0.05)[0]


def settling_2_censored(e: Episode) -> float:
    """1 where the 2 % settling time is only a lower bound because the output had not settled when the episode ended."""
    return math.nan if _step(e) is None else float(_settling(e, 0.02)[1])


def settling_5_censored(e: Episode) -> float:
    """1 where the 5 % settling time is only a lower bound because the output had not settled when the episode ended."""
    return math.nan if _step(e) is None else float(_settling(e, 0.05)[1])


def overshoot(e: Episode) -> float:
    """Largest excursion beyond the new reference after the step, as a share of the step; 0 where it never passes."""
    step = _step(e)
    if step is None:
        return math.nan
    after, size = step
    return float(max(0.0, np.max(-e.error[after] / size)))


def steady_state_error(e: Episode) -> float:
    """Magnitude of the mean error over the last 2 s of a step episode; undefined where the reference moves on."""
    if _step(e) is None or not e.complete:
        return math.nan
    return float(abs(np.mean(e.error[e.time > e.time[-1] - STEADY_WINDOW])))


def reversal_times(e: Episode) -> np.ndarray:
    """Times [k] at which the reference's velocity changes sign; standing still in between does not hide a reversal."""
    velocity = np.diff(e.reference)
    # a sample's rounding is no reversal: motion is what exceeds a billionth of the range within a step
    moving = np.flatnonzero(np.abs(velocity) > 1e-9 * max(float(np.ptp(e.reference)), 1e-300))
    sign = np.sign(velocity[moving])
    return e.time[moving[1:][sign[1:] != sign[:-1]]]


def reversal_error(e: Episode) -> float:
    """RMS error within 0.5 s after each reversal of the reference's velocity."""
    times = reversal_times(e)
    if len(times) == 0:
        return math.nan
    inside = np.zeros(len(e.time), bool)
    for t in times:
        inside |= (e.time > t + 1e-9) & (e.time <= t + REVERSAL_WINDOW + 1e-9)
    return float(np.sqrt(np.mean(e.error[inside] ** 2))) if inside.any() else math.nan


def effort(e: Episode) -> float:
    """Integral of the squared command over time."""
    return float(np.sum(e.command**2) * e.dt)


def total_variation(e: Episode) -> float:
    """Sum of the absolute changes of the command from step to step."""
    return float(np.sum(np.abs(np.diff(e.command))))


def chatter(e: Episode) -> float:
    """Power of the command above 10 Hz: Hann periodogram of the command less its mean, summed from the cutoff up.

    A sinusoid of amplitude A above the cutoff gives A^2/2. NaN for episodes shorter than 16 samples.
    """
    return _power_above(e.command, e.dt) if len(e.command) >= 16 else math.nan


def _power_above(command: np.ndarray, dt: float) -> float:
    """Power above `CHATTER_CUTOFF` of the command less its mean, Hann periodogram."""
    n = len(command)
    window = 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(n) / n)
    spectrum = np.abs(np.fft.rfft((command - np.mean(command)) * window)) ** 2
    spectrum[1 : (n + 1) // 2] *= 2.0  # the negative frequencies; Nyquist (n even) has no twin
    power = spectrum / (n * np.sum(window**2))
    return float(np.sum(power[np.fft.rfftfreq(n, dt) >= CHATTER_CUTOFF]))


def command_ripple(e: Episode) -> float:
    """RMS of the command above 10 Hz, without its jumps where the reference jumps.

    The 0.25 s after each jump of the reference are left out; the stretches between are measured as `chatter` is, and
    weighted by their length. A sinusoid of amplitude A above the cutoff gives A/sqrt(2), a clean jump 0. NaN where no
    stretch has five periods of the cutoff.
    """
    ranged = float(np.ptp(e.reference))
    jumps = np.flatnonzero(np.abs(np.diff(e.reference)) > JUMP_SHARE * ranged) + 1  # none where it stands still
    left_out, least = round(JUMP_WINDOW / e.dt), LEAST_PERIODS / (CHATTER_CUTOFF * e.dt)
    ends = [*jumps, len(e.command)]
    starts = [0, *(k + left_out for k in jumps)]
    stretches = [e.command[a:b] for a, b in zip(starts, ends, strict=True) if b - a >= least]
    if not stretches:
        return math.nan
    total = sum(len(s) for s in stretches)
    return math.sqrt(sum(len(s) * _power_above(s, e.dt) for s in stretches) / total)


def _mean_signal(e: Episode, name: str) -> float:
    return float(np.mean(e.signals[name])) if name in e.signals else math.nan


def slack(e: Episode) -> float:
    """Share of the time in which a cable was slack."""
    return _mean_signal(e, "slack_fraction")


def overload(e: Episode) -> float:
    """Share of the control steps in which a tension exceeded the rig's safety limit."""
    return _mean_signal(e, "overload")


def peak_tension(e: Episode) -> float:
    """Largest cable tension of the episode."""
    return float(np.max(e.signals["peak_tension"])) if "peak_tension" in e.signals else math.nan


def rms_tension(e: Episode) -> float:
    """RMS over the control steps of the largest cable tension in each of them."""
    return float(np.sqrt(np.mean(e.signals["peak_tension"] ** 2))) if "peak_tension" in e.signals else math.nan


def dropped(e: Episode) -> float:
    """1 where the load ended more than 50 mm below its start and, where it is the output, below its reference."""
    if "load_position" not in e.signals:
        return math.nan
    load = e.signals["load_position"]
    lowest = float(load[0])
    if np.array_equal(load, e.output, equal_nan=True):
        lowest = min(lowest, float(np.min(e.reference)))
    return float(not load[-1] >= lowest - DROP)


def success(e: Episode) -> float:
    """1 where the episode ran to its end and the error stayed within the task's success error over its last fifth."""
    if e.success_error is None:
        return math.nan
    last = e.error[-max(round(len(e.error) * SUCCESS_SHARE), 1) :]
    return float(e.complete and float(np.max(np.abs(last))) <= e.success_error)


def failed(e: Episode) -> float:
    """1 where the episode did not run to its end (torn cable, state not finite)."""
    return float(not e.complete)


def ended_by_rule(e: Episode) -> float:
    """1 where a rule of the task ended the episode. NaN for tasks without rules of their own."""
    return float(e.signals["failure"][-1] > 0.0) if "failure" in e.signals else math.nan


def inference_us(e: Episode) -> float:
    """Median time the policy took for one action, on the machine that ran it (the first one may compile).

    Three digits are kept: the others differ from run to run, and cannot be packed.
    """
    return float(f"{np.median(e.inference) * 1e6:.3g}")


def _phase_rmse(e: Episode, phase: str) -> float:
    if "phase" not in e.signals:
        return math.nan
    inside = e.signals["phase"] == PHASES[phase]
    return float(np.sqrt(np.mean(e.error[inside] ** 2))) if inside.any() else math.nan


def rmse_delay(e: Episode) -> float:
    """RMSE within the delay phase of the pulley circuit (the slip front has not reached the output)."""
    return _phase_rmse(e, "delay")


def rmse_transition(e: Episode) -> float:
    """RMSE within the transition phase of the pulley circuit (one side has arrived, the other has not)."""
    return _phase_rmse(e, "transition")


def rmse_working(e: Episode) -> float:
    """RMSE within the working phase of the pulley circuit (both cables move along their whole length)."""
    return _phase_rmse(e, "working")


METRICS: tuple[Metric, ...] = (
    Metric("rmse", "{y}", "lower", "RMSE", rmse),
    Metric("priced_rmse", "{y}", "lower", "priced error", priced_rmse),
    Metric("iae", "{y} s", "lower", "IAE", iae),
    Metric("itae", "{y} s^2", "lower", "ITAE", itae),
    Metric("max_error", "{y}", "lower", "max error", max_error),
    Metric("settling_2", "s", "lower", "settling 2 %", settling_2),
    Metric("settling_2_censored", "1", "lower", "2 % censored", settling_2_censored),
    Metric("settling_5", "s", "lower", "settling 5 %", settling_5),
    Metric("settling_5_censored", "1", "lower", "5 % censored", settling_5_censored),
    Metric("overshoot", "1", "lower", "overshoot", overshoot),
    Metric("steady_state_error", "{y}", "lower", "steady error", steady_state_error),
    Metric("reversal_error", "{y}", "lower", "reversal error", reversal_error),
    Metric("effort", "{u}^2 s", "lower", "effort", effort),
    Metric("total_variation", "{u}", "lower", "total variation", total_variation),
    Metric("chatter", "{u}^2", "lower", "chatter", chatter),
    Metric("command_ripple", "{u}", "lower", "command ripple", command_ripple),
    Metric("slack", "1", "lower", "slack", slack),
    Metric("overload", "1", "lower", "overload", overload),
    Metric("peak_tension", "N", "", "peak tension", peak_tension),
    Metric("rms_tension", "N", "lower", "RMS tension", rms_tension),
    Metric("dropped", "1", "lower", "load dropped", dropped),
    Metric("success", "1", "higher", "success", success),
    Metric("failed", "1", "lower", "failed", failed),
    Metric("ended_by_rule", "1", "lower", "ended by a rule", ended_by_rule),
    Metric("inference_us", "us", "lower", "inference", inference_us),
    Metric("rmse_delay", "{y}", "lower", "RMSE delay", rmse_delay),
    Metric("rmse_transition", "{y}", "lower", "RMSE transition", rmse_transition),
    Metric("rmse_working", "{y}", "lower", "RMSE working", rmse_working),
)


def metric(name: str) -> Metric:
    """The declared metric of a name.

    Parameters
    ----------
    name : str
        As in `METRICS`, for example "rmse".

    Returns
    -------
    Metric

    Raises
    ------
    ConfigurationError
        With the nearest name where there is none.

    Examples
    --------
    >>> metric("rmse").unit_of("m", "N"), metric("effort").unit_of("m", "N m")
    ('m', '(N m)^2 s')
    """
    for m in METRICS:
        if m.name == name:
            return m
    raise ConfigurationError(f"unknown metric '{name}'; {nearest(name, [m.name for m in METRICS])}")


def measure(episode: Episode) -> dict[str, float]:
    """Every metric of one episode.

    Parameters
    ----------
    episode : Episode
        Arrays of the episode, SI.

    Returns
    -------
    dict of float
        By name, SI; NaN where a metric does not apply (settling time of a sinusoid).

    Examples
    --------
    >>> import numpy as np
    >>> t, zero = 0.01 * np.arange(1, 101), np.zeros(100)
    >>> found = measure(Episode(t, zero + 1.0, zero + 0.9, zero, zero, zero, {}, False, 0.01, 100))
    >>> round(found["rmse"], 6), round(found["iae"], 6), found["failed"]
    (0.1, 0.1, 0.0)
    """
    return {m.name: m.function(episode) for m in METRICS}
