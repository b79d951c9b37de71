"""What no rig does: each check finds its fault, and is silent on good logs, at rest, and on what physics may do."""

import re
from dataclasses import replace

import numpy as np
import pytest

from cable_envs.diagnosis.asked import ask, request_of
from cable_envs.diagnosis.data.recording import Recording, load_recording
from cable_envs.diagnosis.intake.claims import off_claims
from cable_envs.diagnosis.intake.energy import against_nature, lags, losses
from cable_envs.diagnosis.intake.factors import wrong_factors
from cable_envs.diagnosis.intake.gate import gate
from cable_envs.diagnosis.intake.jumps import (
    _count,
    exchanged,
    jumps,
    lone_jump,
    lone_samples,
    mixed_units,
    out_of_order,
    spikes,
)
from cable_envs.diagnosis.intake.repeats import block_twice, blocks_twice, held, longest_run, piled
from cable_envs.diagnosis.intake.standing import stuck
from cable_envs.diagnosis.intake.timing import late_channels, shift_of
from cable_envs.diagnosis.intake.tracks import tracks_of
from cable_envs.proof.cases import Case
from cable_envs.proof.logs.cases import make

MASS, COULOMB, VISCOUS = 6.0, 8.0, 20.0
PERIOD, ROWS = 0.01, 2800


def _motion(rng):
    """A multisine's position, speed and acceleration [ROWS], with its exact derivatives, at rest for its first 2 s."""
    t = PERIOD * np.arange(ROWS)
    w = 2.0 * np.pi * np.array([0.1, 0.25, 0.4])
    phase = rng.uniform(0.0, 2.0 * np.pi, 3)
    size = 0.05 / (1.0 + w)
    angle = np.outer(t, w) + phase
    x, v, a = np.sin(angle) @ size, np.cos(angle) @ (size * w), -np.sin(angle) @ (size * w**2)
    return t, x, v, a


def _drive(seed=3, change=lambda table, number: None, friction=1.0):
    """A drive with friction by its equation of motion and white noise; two records; ``change`` damages a table."""
    rng = np.random.default_rng(seed)
    records = {}
    for number, name in enumerate(("one", "two")):
        t, x, v, a = _motion(rng)
        force = MASS * a + friction * (VISCOUS * v + COULOMB * np.tanh(v / 1e-3))
        noise = {"position": 1e-5, "velocity": 2e-3, "force": 0.2}
        table = {"time": t, "position": x, "velocity": v, "force": force}
        table |= {n: table[n] + std * rng.standard_normal(ROWS) for n, std in noise.items()}
        change(table, number)
        records[name] = table
    return Recording.from_arrays(
        "linear_drive", records, nominal={"mass": MASS, "coulomb": COULOMB, "viscous": VISCOUS}
    )  # fmt: skip


def _circuit(seed=4, change=lambda table, number: None):
    """A drive that turns an output behind an elastic transmission: the output follows by torque over stiffness."""
    rng = np.random.default_rng(seed)
    records = {}
    for number, name in enumerate(("one", "two")):
        t, x, v, _ = _motion(rng)
        out = 10.0 * x
        given = 0.05 * out + 2e-3 * np.tanh(v / 1e-3)
        torque = given + 0.02 * np.tanh(v / 1e-3)
        table = {"time": t, "drive_angle": out + torque / 2.0, "drive_torque": torque, "output_angle": out,
                 "output_torque": given}  # fmt: skip
        noise = {"drive_angle": 5e-4, "drive_torque": 1e-3, "output_angle": 1e-3, "output_torque": 1e-3}
        table |= {n: table[n] + std * rng.standard_normal(ROWS) for n, std in noise.items()}
        change(table, number)
        records[name] = table
    return Recording.from_arrays("pulley_circuit", records)


def _found(check, recording):
    return list(check(recording, tracks_of(recording)))


def _fatal(recording):
    return [fault for fault in gate(recording).faults if fault.fatal]


@pytest.mark.parametrize("seed", range(6))
def test_good_logs_pass_without_a_note(seed):
    for made in (_drive, _circuit):
        assert gate(made(seed)).faults == ()


def test_a_rig_without_friction_takes_nothing_and_is_not_refused():
    for seed in range(6):
        assert _found(against_nature, _drive(seed, friction=0.0)) == []


def test_the_loss_factor_of_dry_friction_is_one_and_of_a_spring_nought():
    def bare(spring):
        def change(table, number):
            table["force"] = (0.0 if spring else 5.0) * np.sign(table["velocity"]) + spring * table["position"]

        return tracks_of(_drive(change=change))[0]

    dry, _ = losses(bare(0.0), "force", "position")
    elastic, least = losses(bare(300.0), "force", "position")
    # of dry friction every bit of work is lost; the force is taken about its mean, here over unequal speeds
    assert np.all(dry > 0.95)
    assert np.all(np.abs(elastic) < 0.01) and np.mean(elastic) > least


def _times(channel, factor):
    def change(table, number):
        table[channel] = factor * table[channel]

    return change


def _swapped(one, other):
    def change(table, number):
        table[one], table[other] = table[other], table[one]

    return change


def _late(channel, seconds):
    def change(table, number):
        table[channel] = np.interp(table["time"] - seconds, table["time"], table[channel])

    return change


@pytest.mark.parametrize("channel", ["force", "position"])
def test_a_sign_that_is_turned_gives_energy(channel):
    def change(table, number):
        table[channel] *= -1.0
        if channel == "position":
            table["velocity"] *= -1.0  # else it is their rate that tells

    (fault,) = _found(against_nature, _drive(change=change))
    assert fault.channel == "force" and "sign" in fault.text


@pytest.mark.parametrize("frequency", [0.2, 3.0, 8.0, 11.0, 15.0])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_sine_as_fast_as_a_computed_experiment_keeps_its_sign(frequency, sign):
    """Speeds smoothed over longer than an oscillation turned its sign, and a good log was refused."""
    rng, t, w = np.random.default_rng(8), PERIOD * np.arange(ROWS), 2.0 * np.pi * frequency
    x, v = 1e-4 * np.sin(w * t), 1e-4 * w * np.cos(w * t)
    # friction alone, as a spring or a mass make the loss factor too small to tell beside a lag of LAG
    force = sign * (VISCOUS * v + COULOMB * np.tanh(v / 1e-5))
    table = {"time": t, "position": x + 5e-6 * rng.standard_normal(ROWS), "force": force}
    recording = Recording.from_arrays("linear_drive", {"one": table}, nominal={"mass": MASS})
    (track,) = tracks_of(recording)
    loss, _ = losses(track, "force", "position")
    assert np.sign(np.mean(loss)) == sign and abs(np.mean(loss)) > 0.5
    assert sign < 0.0 or not _found(against_nature, recording)


def test_effort_and_position_in_each_others_column_give_energy():
    assert any(
        "exchange" in f.text for f in _found(against_nature, _circuit(change=_swapped("drive_angle", "drive_torque")))
    )


def test_a_driven_end_follows_and_does_not_lead():
    assert np.all(lags(tracks_of(_circuit())[0], "drive_angle", "output_angle") > 0.0)
    (fault,) = _found(against_nature, _circuit(change=_swapped("drive_angle", "output_angle")))
    assert fault.channel == "output_angle" and "ahead of drive_angle" in fault.text


def test_an_output_does_no_more_work_than_its_drive():
    (fault,) = _found(against_nature, _circuit(change=_swapped("drive_torque", "output_torque")))
    assert fault.channel == "output_torque" and "drive_torque puts in" in fault.text


@pytest.mark.parametrize(
    ("channel", "factor", "said"),
    [("force", 9.81, "kilograms"), ("force", 1.0 / 9.81, "kilograms"), ("velocity", -1.0, "sign"),
     ("velocity", 2.0, "clock"), ("position", 180.0 / np.pi, "degrees"), ("force", 1e3, "kilo")],
)  # fmt: skip
def test_a_wrong_unit_is_named_with_what_would_be_right(channel, factor, said):
    (fault,) = _found(wrong_factors, _drive(change=_times(channel, factor)))
    assert said in fault.text


@pytest.mark.parametrize("factor", [0.75, 1.3])
def test_a_scale_that_a_sensor_may_have_is_no_unit(factor):
    assert _found(wrong_factors, _drive(change=_times("force", factor))) == []
    assert _found(wrong_factors, _drive(change=_times("velocity", factor))) == []


def test_friction_that_is_twice_what_is_stated_is_no_unit():
    assert _found(wrong_factors, _drive(friction=2.0)) == []


def test_a_cable_only_pulls():
    t = PERIOD * np.arange(ROWS)
    place = 0.02 * np.sin(2.0 * np.pi * 0.2 * t)
    weight = 5.0 * 9.81
    pull = weight * np.exp(0.6 * np.tanh(np.gradient(place) / 1e-5))

    def said(factor):
        table = {"time": t, "drive_position": place, "drive_tension": factor * pull}
        recording = Recording.from_arrays("cable_hole", table, known={"load_mass": 5.0})
        return [fault.text for fault in _found(wrong_factors, recording)]

    assert said(1.0) == []
    assert "only pulls" in said(-1.0)[0]
    # the median alone would be off by e^0.6, their geometric mean is the weight
    assert "9.81 times the load's weight" in said(9.81)[0]


@pytest.mark.parametrize(("channel", "seconds"), [("force", 0.15), ("force", -0.15)])
def test_a_late_channel_is_found_with_its_time(channel, seconds):
    recording = _drive(change=_late(channel, seconds))
    (fault,) = _found(late_channels, recording)
    assert fault.channel == channel and ("late" if seconds > 0.0 else "early") in fault.text
    # shifts are tried in steps of 10 ms
    assert shift_of(tracks_of(recording), channel)[0] == pytest.approx(seconds, abs=0.02)


def test_a_late_position_is_found_by_its_speed():
    (fault,) = _found(wrong_factors, _drive(change=_late("position", 0.15)))
    assert fault.channel == "position" and fault.text.endswith("early: bring them to one clock")
    said = float(re.search(r"is (\d+) ms", fault.text)[1])
    assert said == pytest.approx(150.0, abs=10.0)  # the period


def test_a_lag_that_a_rig_may_have_is_none_of_the_loggers():
    for channel in ("force", "velocity"):
        recording = _drive(change=_late(channel, 0.02))
        assert _found(late_channels, recording) == [] and _found(wrong_factors, recording) == []


def test_a_gap_in_the_drive_is_no_late_channel(tmp_path):
    """While it is crossed the drive feels no tendon: over a sine that is as if its tension came 120 ms late."""
    from cablebench.cli import main

    options = ["--controller", "pid", "--format", "recording", "-o", "sensor_noise=true", "--episodes", "2"]
    gap = ["-o", "effects={backlash.gap: 5.0e-4}", "--out", str(tmp_path)]
    with pytest.raises(SystemExit) as end:
        main(["export", "TendonSheath-Position-Sine", *options, *gap])
    assert end.value.code == 0
    tracks = tracks_of(load_recording(tmp_path))
    assert shift_of(tracks, "drive_tension", ())[0] == pytest.approx(0.12, abs=0.02)
    assert [fault.text for fault in late_channels(load_recording(tmp_path), tracks)] == []


def _once(channel, act, at=1500):
    def change(table, number):
        if number == 0:
            act(table[channel], at)

    return change


def test_counts_that_are_lost_are_found_at_their_row():
    def lose(values, at):
        values[at:] -= 0.04 * np.ptp(values)

    (fault,) = _found(jumps, _drive(change=_once("position", lose)))
    assert (fault.record, fault.channel, fault.row, fault.fatal) == ("one", "position", 1501, True)


def test_a_jump_that_the_whole_rig_feels_is_no_lost_count():
    def bump(table, number):
        if number == 0:  # against a stop: the position goes on from elsewhere, and the force knows it
            table["position"][1500:] -= 0.04 * np.ptp(table["position"])
            table["force"][1500:1503] += 400.0

    assert _found(jumps, _drive(change=bump)) == []


def test_a_speed_that_its_position_keeps_is_not_stuck():
    def steady(held):
        def change(table, number):
            if number == 0:
                table["velocity"][1500:1560] = table["velocity"][1500] if held else 0.25
                if not held:
                    table["position"][1500:1560] = table["position"][1500] + 0.25 * 0.01 * np.arange(60)

        return [f for f in _fatal(_drive(change=change)) if "stuck" in f.text]

    assert steady(held=True) and not steady(held=False)


def test_opposite_ends_of_an_effort_that_hold_many_samples_are_noted():
    def clip(table, number):
        most = 0.3 * np.max(np.abs(table["force"]))
        table["force"] = np.clip(table["force"], -most, most)

    (limit,) = _found(piled, _drive(change=clip))
    assert not limit.fatal and limit.channel == "force" and "a limit" in limit.text
    assert _found(piled, _drive()) == []


def test_lost_rows_are_no_jump():
    def change(table, number):
        kept = np.ones(ROWS, bool)
        kept[1500:1504] = False
        for name in table:
            table[name] = table[name][kept]

    assert _found(jumps, _drive(change=change)) == []


def test_an_effort_in_two_units_is_refused_and_its_jump_noted():
    def mix(values, at):
        values[at:] *= 9.81

    def jump(values, at):
        values[at:] += 60.0

    (mixed,) = _found(mixed_units, _drive(change=_once("force", mix)))
    (jumped,) = _found(jumps, _drive(change=_once("force", jump)))
    assert mixed.fatal and "one unit" in mixed.text and abs(mixed.row - 1501) < 60  # a place of 50
    assert not jumped.fatal and jumped.row == 1501


def test_friction_that_turns_at_every_reversal_is_no_jump():
    values = np.sign(np.sin(0.01 * np.arange(3000))) + 0.01 * np.random.default_rng(0).standard_normal(3000)
    assert lone_jump(values) is None


def test_spikes_are_noted_and_noise_is_not():
    def spike(values, at):
        values[[at, at + 200, at + 411]] += 0.5 * np.ptp(values)

    (fault,) = _found(spikes, _drive(change=_once("force", spike)))
    assert not fault.fatal and fault.row == 1501 and fault.text.startswith("3 samples")
    for seed in range(20):
        rng = np.random.default_rng(seed)
        assert len(lone_samples(rng.standard_normal(3000))[0]) == 0
        assert len(lone_samples(np.round(rng.standard_normal(3000)))[0]) == 0


def test_the_counts_of_a_sensor_are_what_all_its_steps_are_multiples_of():
    rng = np.random.default_rng(0)
    wave = 0.009 * np.sin(np.arange(2000) / 30.0)
    assert _count(2e-6 * np.round(wave / 2e-6)) == pytest.approx(2e-6)
    assert _count(wave + rng.normal(0.0, 1e-6, 2000)) == 0.0 == _count(np.zeros(9))


def test_a_sensor_that_is_held_while_the_rig_moves_is_refused():
    def hold(values, at):
        values[at : at + 10] = values[at]

    (fault,) = _found(held, _drive(change=_once("force", hold)))
    assert fault.channel == "force" and fault.row == 1501 and "held" in fault.text


def test_a_sensor_that_is_held_while_the_rig_moves_slowly_is_held():
    x = _motion(np.random.default_rng(3))[1]
    way = np.abs(x[10:] - x[:-10])
    usual = np.median(way)
    at = int(np.flatnonzero((way > 0.6 * usual) & (way < 0.8 * usual) & (np.arange(len(way)) > 300))[0])

    def hold(values, at):
        values[at : at + 10] = values[at]

    (fault,) = _found(held, _drive(change=_once("force", hold, at)))
    assert fault.row == at + 1


def _given(damage):
    """A change that makes the force a voltage of a tenth of it, and damages that in the first record."""

    def change(table, number):
        table["voltage"] = 0.1 * table.pop("force")
        if number == 0:
            damage(table["voltage"])

    return change


def _hold(values):
    values[1500:1510] = values[1500]


def _clip(values):
    most = 0.85 * np.max(np.abs(values))
    np.clip(values, -most, most, out=values)


def _mix(values):
    values[1500:] *= 9.81


def _spike(values):
    values[[1500, 1700, 1911]] += 0.5 * np.ptp(values)


def _step(values):
    values[1500:] += 6.0


@pytest.mark.parametrize(
    ("check", "damage"), [(held, _hold), (piled, _clip), (mixed_units, _mix), (spikes, _spike), (jumps, _step)]
)
def test_what_is_unusual_in_a_voltage_is_noted_as_it_may_have_been_asked_for(check, damage):
    assert _found(check, _drive(change=_given(lambda values: None))) == []
    (fault,) = _found(check, _drive(change=_given(damage)))
    assert fault.channel == "voltage" and not fault.fatal


def test_a_voltage_of_steps_is_none_of_a_loggers():
    def steps(values):
        values[:] = np.where(np.arange(ROWS) < 1500, 2.0, -2.0)

    recording = _drive(change=_given(steps))
    assert [f for check in (held, piled, jumps, spikes) for f in _found(check, recording)] == []


def test_a_rig_at_rest_is_no_held_sensor():
    def rest(table, number):
        for name in ("position", "velocity", "force"):
            table[name][-300:] = table[name][-300]  # finer than its noise, and nothing moves

    assert _found(held, _drive(change=rest)) == []


@pytest.mark.parametrize("lost", [5, 6])
def test_five_samples_in_a_row_may_be_missing_and_not_six(lost):
    whole = _drive()
    first, *others = whole.records
    data = {name: np.delete(values, slice(300, 300 + lost)) for name, values in first.data.items()}
    found = gate(replace(whole, records=(replace(first, data=data), *others))).faults
    assert [f.fatal for f in found if "gap" in f.text] == [lost == 6]


def test_a_rig_that_stops_for_a_while_is_not_refused_and_one_whose_sensor_stops_is():
    rng = np.random.default_rng(5)
    t = PERIOD * np.arange(ROWS)
    way = np.where(np.mod(t, 7.0) < 5.0, np.sin(2.0 * np.pi * np.mod(t, 7.0) / 5.0) ** 3, 0.0)  # 2 s of rest in 7
    speed = np.gradient(way, PERIOD)
    force = MASS * np.gradient(speed, PERIOD) + VISCOUS * speed + COULOMB * np.tanh(speed / 1e-2)

    def recording(place):
        table = {"time": t, "position": place, "velocity": speed + 1e-2 * rng.standard_normal(ROWS)}
        table["force"] = force + 0.2 * rng.standard_normal(ROWS)
        return Recording.from_arrays("linear_drive", table)

    fine = 0.1 + way + np.where(speed == 0.0, 0.0, 2e-3 * rng.standard_normal(ROWS))  # its noise is seen in motion only
    assert any("equal samples" in fault.text for fault in stuck("", "position", fine, np.ones(ROWS, bool)))
    assert _fatal(recording(fine)) == []
    fine[120:160] = fine[120]
    assert any("stuck" in str(fault) for fault in _fatal(recording(fine)))


def test_a_rig_that_rests_in_one_record_is_noted_and_a_sensor_that_is_dead_there_is_refused():
    def rest(table, number):
        if number == 1:
            table["position"][:] = 0.02  # an encoder shows no noise
            table["velocity"][:] = 2e-3 * np.random.default_rng(1).standard_normal(ROWS)
            table["force"][:] = 0.7 + 0.2 * np.random.default_rng(2).standard_normal(ROWS)

    quality = gate(_drive(change=rest))
    assert [f for f in quality.faults if f.fatal] == []
    assert any("constant at 0.02: the rig rests in this record" in note for note in quality.notes)

    def dead(table, number):
        if number == 1:
            table["position"][:] = 0.02

    assert any("a dead sensor" in fault.text for fault in _fatal(_drive(change=dead)))


def test_a_rig_that_rests_most_of_the_time_is_not_stuck_and_turning_points_are_not_saturated():
    rng = np.random.default_rng(6)
    t = PERIOD * np.arange(ROWS)
    phase = np.clip(np.mod(t, 7.0) - 4.5, 0.0, None) / 2.5  # 4.5 s of rest in 7, then to and fro
    way = np.round(np.clip(np.sin(2.0 * np.pi * phase) * 1.02, -1.0, 1.0), 4)  # and a moment at either end
    speed = np.gradient(way, PERIOD)
    noise = np.where(speed == 0.0, 0.0, 2e-3) * rng.standard_normal(ROWS)
    force = MASS * np.gradient(speed, PERIOD) + VISCOUS * speed + COULOMB * np.tanh(speed / 1e-2)

    def recording(place):
        table = {"time": t, "position": place, "force": force + 0.2 * rng.standard_normal(ROWS)}
        return Recording.from_arrays("linear_drive", table)

    assert [f for f in _fatal(recording(way + noise)) if f.channel == "position"] == []
    held_ = (way + noise).copy()
    held_[470:530] = held_[470]  # in the midst of a motion
    assert any(f.channel == "position" for f in _fatal(recording(held_)))


def test_a_slow_turn_that_an_encoder_counts_is_no_saturated_sensor():
    """In motion a clock that jitters shows in the counts; where the motion turns, count by count, it does not."""
    rng, period, half, count = np.random.default_rng(9), 0.002, 1.6, 5e-6
    t = period * np.arange(8000)
    seen = t + 0.03 * period * rng.standard_normal(len(t))  # when the samples were taken
    turn = np.floor(seen / (2.0 * half) + 0.5)  # of which a sample is the nearest
    away = np.abs(seen - 2.0 * half * turn) / half
    way = (0.4 + 0.56 * count) * (1.0 - away**3) * (-1.0) ** turn  # just beyond the last count that it reaches
    place = count * np.round(way / count)
    speed = np.gradient(0.4 * (1.0 - away**3) * (-1.0) ** turn, period)
    since = t - 2.0 * half * np.round(t / (2.0 * half))
    force = 20.0 * speed - 150.0 * (-1.0) ** turn * np.clip(since / 0.06, -1.0, 1.0)  # it goes on while friction holds
    table = {"time": t, "position": place, "force": force + 3.0 * rng.standard_normal(len(t))}
    good = np.ones(len(t), dtype=bool)
    assert any("saturated" in fault.text for fault in stuck("", "position", place, good))
    assert [f for f in _fatal(Recording.from_arrays("linear_drive", table)) if f.channel == "position"] == []


def test_friction_holds_a_position_where_it_turns_while_the_force_goes_on():
    rng = np.random.default_rng(8)
    t = PERIOD * np.arange(ROWS)
    whole = 1.02 * np.sin(2.0 * np.pi * t / 3.0)
    way = np.clip(whole, -1.0, 1.0)  # it sticks for 0.19 s at either end
    speed = np.where(np.abs(whole) < 1.0, np.gradient(way, PERIOD), 0.0)
    through = 0.5 * np.pi / np.arccos(1.0 / 1.02) * np.cos(2.0 * np.pi * t / 3.0)  # from one level to the other
    force = VISCOUS * speed + COULOMB * np.where(speed == 0.0, np.clip(through, -1.0, 1.0), np.sign(speed))

    def recording(place):
        table = {"time": t, "position": place, "velocity": speed + 1e-2 * rng.standard_normal(ROWS)}
        table["force"] = force + 0.2 * rng.standard_normal(ROWS)
        return Recording.from_arrays("linear_drive", table)

    place = way + np.where(speed == 0.0, 0.0, 2e-3 * rng.standard_normal(ROWS))  # a clock that jitters shows in motion
    place = np.clip(place, -1.0, 1.0)
    assert any("saturated" in fault.text for fault in stuck("", "position", place, np.ones(ROWS, bool)))
    assert _fatal(recording(place)) == []
    cut = np.clip(way + 2e-3 * rng.standard_normal(ROWS), -0.8, 0.8)
    assert any("saturated" in str(fault) for fault in _fatal(recording(cut)))  # the speed goes on


def test_friction_holds_a_load_while_its_drive_starts_and_a_sensor_that_is_held_there_jumps():
    """The cable stretches by 0.3 mm before the load breaks loose; the load's sensor has noise in motion only."""
    rng = np.random.default_rng(9)
    t = PERIOD * np.arange(ROWS)
    since = np.mod(t, 5.0) - 0.5
    drive = 0.02 + 0.01 * np.where(since > 0.0, 1.0 - np.cos(2.0 * np.pi * np.clip(since, 0.0, None) / 4.5), 0.0)
    load = np.full(ROWS, 0.02)
    for k in range(1, ROWS):
        stretch = drive[k] - load[k - 1]
        load[k] = load[k - 1] + (stretch - np.sign(stretch) * 3e-4 if abs(stretch) > 3e-4 else 0.0)
    noise = 2e-5 * rng.standard_normal(ROWS) * (np.gradient(load) != 0.0)

    def recording(place):
        table = {"time": t, "drive_position": drive + 1e-6 * rng.standard_normal(ROWS), "load_position": place}
        table["drive_tension"] = 50.0 + 6e4 * (drive - place) + 0.1 * rng.standard_normal(ROWS)
        return Recording.from_arrays("cable_hole", table)

    assert [f for f in _fatal(recording(load + noise)) if f.channel == "load_position"] == []
    held = load + noise
    held[520:580] = held[520]  # at rest, and for 0.3 s on
    assert any("samples in a row" in f.text for f in _fatal(recording(held)) if f.channel == "load_position")


def test_a_torque_in_another_unit_is_told_by_the_simulator_as_stated(tmp_path):
    make(Case("one", 12, "pulley_circuit", "nothing", noise="white, unstated"), tmp_path)
    good = load_recording(tmp_path)

    def said(recording):
        return off_claims(recording, ask(recording, request_of(recording)))

    assert said(good) == []
    data = [{**r.data, "drive_torque": 9.81 * r.data["drive_torque"]} for r in good.records]
    wrong = replace(good, records=tuple(replace(r, data=d) for r, d in zip(good.records, data, strict=True)))
    (fault,) = said(wrong)
    assert fault.channel == "drive_torque" and "kilograms" in fault.text


def test_runs_of_a_coarse_sensor_are_its_own():
    rng = np.random.default_rng(1)
    for std in (0.2, 0.5, 1.0, 3.0):
        assert longest_run(100.0 + np.round(std * rng.standard_normal(3000))) is None


def test_a_block_that_is_written_twice_is_found_and_a_period_is_not():
    rng = np.random.default_rng(2)
    table = rng.standard_normal((1000, 3))
    twice = np.concatenate([table[:430], table[400:]])
    assert block_twice(twice) == (430, 30)
    assert block_twice(table) is None
    assert block_twice(np.tile(table[:50], (20, 1))) is None


def test_a_buffer_that_is_written_twice_is_refused():
    def change(table, number):
        order = np.r_[np.arange(1000), np.arange(970, ROWS - 30)]
        for name in ("position", "velocity", "force"):
            table[name] = table[name][order]

    (fault,) = _found(blocks_twice, _drive(change=change))
    assert fault.row == 1001 and "30 rows" in fault.text
    assert any("written twice" in f.text for f in _fatal(_drive(change=change)))


@pytest.mark.parametrize(("recording", "place"), [(_drive, "position"), (_circuit, "output_angle")])
def test_two_blocks_in_each_others_place_are_found(recording, place):
    at = []

    def change(table, number):
        if number == 1:
            way = np.abs(table[place][55:] - table[place][:-55])
            a = int(np.argmax(way))
            at.append(a)
            order = np.r_[np.arange(a), np.arange(a + 25, a + 55), np.arange(a, a + 25), np.arange(a + 55, ROWS)]
            for name in table.keys() - {"time"}:
                table[name] = table[name][order]

    damaged = recording(change=change)
    (fault,) = _found(out_of_order, damaged)
    assert fault.fatal and fault.record == "two"
    assert f"rows {at[0] + 1} to {at[0] + 30} and rows {at[0] + 31} to {at[0] + 55}" in fault.text
    assert _fatal(damaged)


def test_a_load_that_slips_there_and_back_is_in_order():
    t = 0.01 * np.arange(ROWS)
    place = 0.02 * np.sin(t) + 1e-5 * np.random.default_rng(1).standard_normal(ROWS)
    for far in (0.004, -0.006, 0.002):
        place[1000 + int(1e4 * abs(far)) :] += far
    assert exchanged([place]) is None
