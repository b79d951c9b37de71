"""Building blocks shared by the controllers: PID with anti-windup, a filtered derivative, a speed profile."""

import math


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
