"""Building blocks shared by the controllers: PID with anti-windup, a filtered derivative, a speed profile, a hold."""

import math

HOLD = 0.3
"""Standard deviation of the compliance in a hold before anything was measured, as a share of the nominal one."""


class FilteredRate:
    """Derivative of a sampled signal behind a first-order low-pass; zero at the first sample."""

    __slots__ = ("_alpha", "_dt", "_last", "value")

    def __init__(self, dt: float, filter_time: float):
        self._dt = dt
        self._alpha = dt / (dt + filter_time)
        self.reset()

    def reset(self) -> None:
        self._last: float | None = None
        self.value = 0.0

    def update(self, sample: float) -> float:
        """Filtered rate (unit of the signal per s) after one more sample."""
        if self._last is not None:
            self.value += self._alpha * ((sample - self._last) / self._dt - self.value)
        self._last = sample
        return self.value


class Pid:
    """u = feedforward + kp e + ki int(e) + kd (r_dot - filtered d(measurement)/dt), saturated.

    The derivative acts on the measurement, so that a step of the reference causes no kick. Anti-windup by conditional
    integration: the integral stands still while the output is saturated and the error would drive it further in.
    """

    __slots__ = ("_dt", "_rate", "integral", "kd", "ki", "kp")

    def __init__(self, kp: float, ki: float, kd: float, filter_time: float, dt: float):
        self.kp, self.ki, self.kd, self._dt = kp, ki, kd, dt
        self._rate = FilteredRate(dt, filter_time)
        self.integral = 0.0

    def reset(self) -> None:
        self._rate.reset()
        self.integral = 0.0

    def update(self, error: float, measured: float, rate: float, feedforward: float, low: float, high: float) -> float:
        """One period; ``rate`` is the reference's rate, [low, high] the range of the output."""
        free = feedforward + self.kp * error + self.integral + self.kd * (rate - self._rate.update(measured))
        u = low if free < low else high if free > high else free
        if u == free or (free - u) * error < 0.0:
            self.integral += self.ki * error * self._dt
        return u


def approach_speed(error: float, gain: float, acceleration: float, limit: float) -> float:
    """Speed at which to close ``error``: proportional near zero, then as constant deceleration allows, limited.

    gain 1/s; acceleration and limit in the error's unit per s^2 and per s, > 0. Slope-continuous where the two meet.
    """
    distance = abs(error)
    knee = acceleration / (gain * gain)
    speed = gain * distance if distance <= knee else math.sqrt(acceleration * (2.0 * distance - knee))
    return math.copysign(min(speed, limit), error)


def follow_direction(direction: float, last: float | None, ref: tuple[float, float, float]) -> float:
    """Direction (-1, 0, 1) in which a reference moves: the sign of its rate, else of its jump, else as before."""
    if ref[1] != 0.0:
        return 1.0 if ref[1] > 0.0 else -1.0
    if last is not None and ref[0] != last:
        return 1.0 if ref[0] > last else -1.0
    return direction


class Smoother:
    """Follows a value with its rate as feedforward: smooth signals pass unchanged, jumps decay in ``time`` seconds."""

    __slots__ = ("_dt", "_keep", "value")

    def __init__(self, dt: float, time: float):
        self._dt = dt
        self._keep = math.exp(-dt / time) if time > 0.0 else 0.0
        self.reset()

    def reset(self) -> None:
        self.value: float | None = None

    def update(self, sample: float, rate: float = 0.0) -> float:
        """The smoothed value after one more sample; the first sample is taken as it is."""
        if self.value is None:
            self.value = sample
        else:
            self.value = sample + (self.value + rate * self._dt - sample) * self._keep
        return self.value


def has_jumped(ref: tuple[float, float, float], last: float | None, dt: float, least: float) -> bool:
    """Whether a reference (value, rate, acceleration) differs from its last value by more than its rate makes.

    ``dt`` is the control period; ``least`` the smallest jump, in the unit of the reference.
    """
    return last is not None and abs(ref[0] - last - ref[1] * dt) > least


class Hold:
    """The output at rest behind an elastic cable: position = b + c load, fitted; what goes beyond is its motion.

    Position and load are those of the drive: rad and N m, or m and N. ``misfit`` is the standard deviation of the load
    about the line, ``beyond`` the distance from it at which the output counts as moving.
    """

    def __init__(self, compliance: float, misfit: float, beyond: float):
        self.compliance = compliance
        """c, rad/(N m) or m/N"""
        self.gone = 0.0
        """position beyond the line, rad or m, smoothed"""
        self._b, self._bb, self._bc, self._cc = 0.0, misfit**2 * compliance**2, 0.0, (HOLD * compliance) ** 2
        self._noise, self._beyond = (misfit * compliance) ** 2, beyond

    def leaves(self, position: float, load: float) -> bool:
        """Whether the output has broken away, after one more change of position and load since the start."""
        missed = position - self._b - self.compliance * load
        along_b, along_c = self._bb + self._bc * load, self._bc + self._cc * load
        total = along_b + along_c * load + self._noise
        self.gone += 0.3 * (missed - self.gone)
        if missed * missed < 9.0 * total:
            self._b += along_b / total * missed
            self.compliance += along_c / total * missed
            self._bb -= along_b * along_b / total
            self._bc -= along_b * along_c / total
            self._cc -= along_c * along_c / total
        return (self.gone if load > 0.0 else -self.gone) > self._beyond
