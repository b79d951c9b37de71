"""Metrics against signals whose values can be written down by hand."""

import math
from dataclasses import replace

import numpy as np
import pytest

from cable_envs.core.errors import ConfigurationError
from cablebench.protocol.episode import Episode
from cablebench.protocol.metrics import METRICS, measure, metric, reversal_times

DT = 0.01
EXACT = 1e-12  # sums of a few thousand doubles of order one


def make(reference, output, command=None, step_time=None, signals=None, terminated=False, horizon=None, **more):
    n = len(reference)
    return Episode(
        time=DT * np.arange(1, n + 1),
        reference=np.asarray(reference, float),
        output=np.asarray(output, float),
        command=np.zeros(n) if command is None else np.asarray(command, float),
        reward=np.zeros(n),
        inference=np.full(n, 3e-6),
        signals=signals or {},
        terminated=terminated,
        dt=DT,
        horizon=n if horizon is None else horizon,
        step_time=step_time,
        **more,
    )


def first_order_step(lag=0.5, n=2000, step_time=10.0, size=2.0):
    """A step of 2 at 10 s followed by 2 (1 - exp(-t / lag))."""
    t = DT * np.arange(1, n + 1)
    after = t >= step_time - 1e-9
    r = np.where(after, size, 0.0)
    return make(r, np.where(after, size * (1 - np.exp(-(t - step_time) / lag)), 0.0), step_time=step_time)


def test_constant_error_gives_rmse_iae_itae_by_hand():
    m = measure(make(np.full(100, 3.0), np.full(100, 1.0)))
    assert m["rmse"] == pytest.approx(2.0, abs=EXACT)
    assert m["max_error"] == pytest.approx(2.0, abs=EXACT)
    assert m["iae"] == pytest.approx(2.0 * 1.0, abs=EXACT)
    # sum of t dt for t = 0.01 .. 1.00 is 0.505
    assert m["itae"] == pytest.approx(2.0 * 0.505, abs=EXACT)


def test_itae_counts_time_from_the_step_and_nothing_before():
    e = first_order_step()
    t = e.time[e.time > 10] - 10
    expected = np.sum(t * 2 * np.exp(-t / 0.5)) * DT
    assert measure(e)["itae"] == pytest.approx(expected, rel=1e-9)
    # the integral of t exp(-t/T) is T^2; the rectangle rule at 10 ms is off by (dt/T)^2/12 = 3e-5 of it
    assert measure(e)["itae"] == pytest.approx(2 * 0.5**2, rel=1e-3)


def test_settling_time_of_a_first_order_lag_is_minus_lag_times_log_of_the_band():
    m = measure(first_order_step(lag=0.5))
    # one sample of 10 ms is the resolution
    assert m["settling_2"] == pytest.approx(-0.5 * math.log(0.02), abs=DT)
    assert m["settling_5"] == pytest.approx(-0.5 * math.log(0.05), abs=DT)
    assert m["settling_2_censored"] == m["settling_5_censored"] == 0.0


def test_settling_time_is_censored_when_the_band_is_left_or_never_entered():
    never = measure(make(np.r_[np.zeros(1000), np.ones(1000)], np.zeros(2000), step_time=10.01))
    assert never["settling_2_censored"] == 1.0
    assert never["settling_2"] == pytest.approx(9.99, abs=1e-9)  # all that was watched: a lower bound
    r = np.r_[np.zeros(1000), np.ones(1000)]
    y = r.copy()
    y[-1] = 0.9
    leaves = measure(make(r, y, step_time=10.01))
    assert leaves["settling_5_censored"] == 1.0


def test_settling_time_of_a_torn_episode_is_censored_although_it_was_inside_the_band():
    r = np.r_[np.zeros(1000), np.ones(500)]
    m = measure(make(r, r, step_time=10.01, terminated=True, horizon=2000))
    assert m["settling_2_censored"] == 1.0 and m["settling_2"] == pytest.approx(4.99, abs=1e-9)


def test_perfect_step_settles_at_once():
    r = np.r_[np.zeros(1000), np.ones(1000)]
    assert measure(make(r, r, step_time=10.01))["settling_2"] == 0.0


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_overshoot_is_a_share_of_the_step_in_either_direction(sign):
    r = np.r_[np.zeros(1000), np.full(1000, 4.0)]
    y = r.copy()
    y[1200] = 5.0
    y[1300] = 3.5
    assert measure(make(sign * r, sign * y, step_time=10.01))["overshoot"] == pytest.approx(0.25, abs=EXACT)


def test_overshoot_is_zero_without_crossing():
    assert measure(first_order_step())["overshoot"] == 0.0


def test_steady_state_error_averages_the_last_two_seconds_so_ripple_cancels():
    r = np.r_[np.zeros(1000), np.ones(1000)]
    ripple = 0.1 * np.sin(2 * np.pi * np.arange(2000) / 20)  # ten whole periods in 2 s
    m = measure(make(r, 0.97 * r + ripple, step_time=10.01))
    assert m["steady_state_error"] == pytest.approx(0.03, abs=EXACT)


def test_step_metrics_do_not_apply_to_a_sinusoid():
    t = DT * np.arange(1, 1001)
    m = measure(make(np.sin(t), np.zeros(1000)))
    for name in ("settling_2", "settling_2_censored", "overshoot", "steady_state_error"):
        assert math.isnan(m[name]), name


def test_reversals_of_a_sinusoid_are_its_extrema():
    t = DT * np.arange(1, 2001)
    found = reversal_times(make(np.sin(2 * np.pi * 0.1 * t), np.zeros(2000)))
    # quarter periods 2.5, 7.5, 12.5, 17.5 s; the sign change is seen one or two samples later
    np.testing.assert_allclose(found, [2.5, 7.5, 12.5, 17.5], atol=2 * DT)


def test_a_plateau_hides_no_reversal_and_one_step_is_none():
    r = np.r_[np.linspace(0, 1, 200), np.ones(200), np.linspace(1, 0, 200)]
    assert len(reversal_times(make(r, r))) == 1
    assert len(reversal_times(first_order_step())) == 0


def test_reversal_error_sees_only_the_half_second_after_a_reversal():
    t = DT * np.arange(1, 1001)
    r = np.where(t <= 5, t, 10 - t)  # one reversal at 5 s
    inside = (t > 5.105) & (t < 5.405)  # 30 of the 50 samples of the window, and nothing outside it
    m = measure(make(r, r - np.where(inside, 0.2, 0.0)))
    assert m["reversal_error"] == pytest.approx(0.2 * math.sqrt(30 / 50), rel=1e-9)
    outside = measure(make(r, r - np.where((t < 4.995) | (t > 5.505), 0.2, 0.0)))
    assert outside["reversal_error"] == 0.0


def test_effort_and_total_variation_of_a_square_wave():
    u = np.tile(np.r_[np.full(10, 2.0), np.full(10, -1.0)], 5)
    m = measure(make(np.zeros(100), np.zeros(100), command=u))
    assert m["effort"] == pytest.approx((50 * 4 + 50 * 1) * DT, abs=EXACT)
    assert m["total_variation"] == pytest.approx(9 * 3.0, abs=EXACT)


def test_chatter_is_half_the_squared_amplitude_above_ten_hertz_and_nothing_below():
    t = DT * np.arange(2000)
    fast = measure(make(np.zeros(2000), np.zeros(2000), command=3 * np.sin(2 * np.pi * 20 * t) + 7))
    # the Hann window spreads a line over three bins; its sidelobes fall as 1/f^3
    assert fast["chatter"] == pytest.approx(4.5, rel=1e-6)
    slow = measure(make(np.zeros(2000), np.zeros(2000), command=3 * np.sin(2 * np.pi * 1 * t) + 7))
    assert slow["chatter"] < 1e-9


def test_chatter_of_white_noise_is_the_share_of_the_band_above_the_cutoff():
    u = np.random.default_rng(0).standard_normal(20_000)
    m = measure(make(np.zeros(20_000), np.zeros(20_000), command=u))
    # 40 of 50 Hz lie above the cutoff; the estimate's standard deviation is about 1 %
    assert m["chatter"] == pytest.approx(0.8, abs=0.04)


def test_slack_overload_and_peak_are_read_from_the_signals():
    signals = {"slack_fraction": np.r_[np.zeros(50), np.full(50, 0.5)], "overload": np.r_[np.ones(10), np.zeros(90)],
               "peak_tension": np.linspace(0, 80, 100)}  # fmt: skip
    m = measure(make(np.zeros(100), np.zeros(100), signals=signals))
    assert (m["slack"], m["overload"], m["peak_tension"]) == (0.25, 0.1, 80.0)


def test_success_looks_at_the_last_fifth_only_and_needs_the_whole_episode():
    y = np.r_[np.full(80, 9.0), np.full(20, 0.009)]
    assert measure(make(np.zeros(100), y, success_error=0.01))["success"] == 1.0
    y[-1] = 0.011
    assert measure(make(np.zeros(100), y, success_error=0.01))["success"] == 0.0
    cut = measure(make(np.zeros(100), np.zeros(100), success_error=0.01, terminated=True, horizon=200))
    assert (cut["success"], cut["failed"]) == (0.0, 1.0)
    assert math.isnan(measure(make(np.zeros(100), np.zeros(100)))["success"])


def test_an_output_that_is_not_finite_is_a_failure():
    assert measure(make(np.zeros(3), [0.0, 1.0, np.nan]))["failed"] == 1.0


def test_phase_errors_are_separate_and_rest_belongs_to_none():
    phase = np.repeat([0.0, 1.0, 2.0, 3.0], 25)
    m = measure(make(np.zeros(100), np.repeat([9.0, 1.0, 2.0, 3.0], 25), signals={"phase": phase}))
    assert (m["rmse_delay"], m["rmse_transition"], m["rmse_working"]) == (1.0, 2.0, 3.0)
    assert math.isnan(measure(make(np.zeros(10), np.zeros(10)))["rmse_delay"])


def test_inference_is_in_microseconds_with_three_digits():
    assert measure(make(np.zeros(10), np.zeros(10)))["inference_us"] == 3.0
    timed = replace(make(np.zeros(10), np.zeros(10)), inference=np.full(10, 12.3456e-6))
    assert measure(timed)["inference_us"] == 12.3


def test_every_metric_is_declared_with_unit_direction_and_meaning():
    names = [m.name for m in METRICS]
    assert len(set(names)) == len(names)
    for m in METRICS:
        assert m.unit and m.label and len(m.meaning) > 15 and m.better in ("lower", "higher", ""), m.name
        assert m.function.__name__ == m.name
    assert metric("itae").unit_of("rad", "N m") == "rad s^2"
    assert metric("effort").unit_of("rad", "N m") == "(N m)^2 s"
    with pytest.raises(ConfigurationError, match="did you mean 'rmse'"):
        metric("rmsee")


def test_episode_refuses_arrays_of_different_length():
    with pytest.raises(ValueError, match="'output' has shape"):
        make(np.zeros(10), np.zeros(9))


def test_thinning_keeps_first_and_last_sample():
    e = make(np.arange(1000.0), np.zeros(1000))
    thin = e.thinned(100)
    assert len(thin["time"]) == 100 and thin["reference"][0] == 0 and thin["reference"][-1] == 999


def _commanded(command, reference, dt=0.01):
    n = len(command)
    zero = np.zeros(n)
    return Episode(dt * np.arange(1, n + 1), reference, reference, command, zero, zero, {}, False, dt, n)


def test_a_clean_jump_of_the_command_at_a_jump_of_the_reference_is_no_ripple():
    step = np.where(np.arange(2000) >= 1000, 0.01, 0.0)
    jump = _commanded(100.0 * np.where(np.arange(2000) >= 1001, 1.0, 0.2), step)
    m = measure(jump)
    assert m["command_ripple"] == pytest.approx(0.0, abs=1e-9) and m["chatter"] > 1.0  # version 0 counted it
    late = _commanded(np.where(np.arange(2000) >= 1500, 80.0, 20.0), step)
    assert measure(late)["command_ripple"] > 1.0  # five seconds later nobody asked for it


def test_ripple_of_a_sinusoid_is_its_rms_with_and_without_a_jump():
    t = 0.01 * np.arange(2000)
    fast = 3.0 * np.sin(2 * np.pi * 20 * t)
    for reference in (np.sin(2 * np.pi * 0.2 * t), np.where(t >= 10, 1.0, 0.0)):
        # stretches of 10 and 9.75 s hold whole periods of 20 Hz
        assert measure(_commanded(fast, reference))["command_ripple"] == pytest.approx(3 / np.sqrt(2), rel=1e-6)
    half = np.where(t >= 10.25, fast, 0.0)  # only after the step: weighted by length
    found = measure(_commanded(half, np.where(t >= 10, 1.0, 0.0)))["command_ripple"]
    assert found == pytest.approx(3 / np.sqrt(2) * np.sqrt(9.75 / 19.75), rel=1e-6)


def test_ripple_ignores_slow_motion_and_short_stretches():
    t = 0.01 * np.arange(2000)
    assert measure(_commanded(50 * np.sin(2 * np.pi * 0.5 * t), np.sin(2 * np.pi * 0.5 * t)))["command_ripple"] < 1e-3
    jumping = np.where((np.arange(2000) // 40) % 2, 1.0, 0.0)  # every 0.4 s: no stretch has five periods of 10 Hz
    assert np.isnan(measure(_commanded(t, jumping))["command_ripple"])


def test_a_load_is_dropped_where_it_ends_below_start_and_reference():
    n = 400
    zero = np.zeros(n)

    def ended(at, reference=zero, output=None):
        load = np.linspace(0.0, at, n)
        return Episode(0.01 * np.arange(1, n + 1), reference, load if output is None else output, zero, zero, zero,
                       {"load_position": load, "peak_tension": np.full(n, 30.0)}, False, 0.01, n)  # fmt: skip

    assert [measure(ended(at))["dropped"] for at in (0.0, -0.049, -0.051, np.nan)] == [0.0, 0.0, 1.0, 1.0]
    lowered = np.linspace(0.0, -0.1, n)
    assert measure(ended(-0.12, lowered))["dropped"] == 0.0  # it was asked to go down
    assert measure(ended(-0.12, 40 + zero, 40 + zero))["dropped"] == 1.0  # a tension task: nobody asked
    assert np.isnan(measure(_commanded(zero, zero))["dropped"])
    assert measure(ended(0.0))["rms_tension"] == pytest.approx(30.0)
