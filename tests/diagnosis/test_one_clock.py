"""Records of different rates: means on the slowest clock, which the models predict, with a statement."""

import numpy as np
import pytest
import yaml

from cable_envs.core.errors import ConfigurationError
from cable_envs.diagnosis import Recording
from cable_envs.diagnosis.asked import ask, request_of
from cable_envs.diagnosis.data.clocks.one_clock import means, on_one_clock
from cable_envs.diagnosis.data.recording import load_recording
from cable_envs.diagnosis.intake.gate import gate
from cable_envs.diagnosis.readers import reader
from cable_envs.diagnosis.readers.base import Request
from cable_envs.diagnosis.readers.writer import write_data_set
from tests.support.drive_recording import MASS, NOISE, VISCOUS, _run


def test_means_are_integrals_over_the_period_and_gaps_have_none():
    at = np.arange(0.0, 4.0, 0.001)
    time, period, w = np.arange(0.5, 3.5, 0.07), 0.05, 9.0
    found = means(at, np.sin(w * at), time, period)
    exact = np.sinc(w * period / 2.0 / np.pi) * np.sin(w * time)
    np.testing.assert_allclose(found, exact, atol=7e-6)  # straight lines take (w h)^2 / 12 of a wave
    kept = (at < 1.9) | (at > 2.1)
    missing = np.isnan(means(at[kept], np.sin(w * at[kept]), time, period))
    np.testing.assert_array_equal(missing, np.abs(time - 2.0) < 0.1)


def runs(periods, **more):
    """A drive under its controller, a record for each period; ``more``: of `Recording.from_arrays`."""
    tables = {}
    for k, period in enumerate(periods):
        table = _run(10 + k, lambda y, v, t: 0.0, 8.0, period, max(round(period / 1e-3), 1))
        names = ("time", "position_reference", "position", "velocity", "force")
        tables[f"r{k}"] = dict(zip(names, table.T.copy(), strict=True))
    return Recording.from_arrays(
        "linear_drive", tables, noise=NOISE, known={"coulomb": 0.0}, nominal={"mass": MASS, "viscous": VISCOUS}, **more
    )


def test_a_faster_record_is_averaged_and_the_model_predicts_its_means():
    recording = runs((0.01, 0.002), heldout="r0")
    gate(recording).require_usable()
    brought, said = on_one_clock(recording)
    assert "brought to one clock, 10 ms, that of the slowest record, by means: r1 (every 2 ms)" in said
    slow, fast = brought.records
    assert slow is recording.records[0] and fast.over == pytest.approx(0.01)
    np.testing.assert_allclose(np.diff(fast.time), 0.01, rtol=1e-9)
    question = ask(brought, request_of(brought))
    values = np.array([[p.start] for p in question.fit.parameters])
    left = {
        b.channel: np.std((b.measured - p[:, 0])[b.good])
        for b, p in zip(question.fit.blocks, question.fit.predict(values), strict=True)
    }
    # five samples in a mean: the noise falls by 2.2; the loop passes some of it on
    assert left["position"] < 0.7 * NOISE["position"] and left["velocity"] < 0.7 * NOISE["velocity"]


def test_records_of_one_rate_stay_as_they_are():
    recording = runs((0.01, 0.01))
    assert on_one_clock(recording) == (recording, "")


def test_a_clock_may_be_stated_and_none_that_is_faster_than_a_record():
    recording = runs((0.01, 0.002), channels={"time": {"every": 0.02}})
    brought, said = on_one_clock(recording)
    assert "20 ms, the stated one" in said and {r.over for r in brought.records} == {0.02}
    assert brought.noise["force"] == pytest.approx(NOISE["force"] * np.sqrt(0.5), rel=1e-3)  # that of the slower record
    with pytest.raises(ConfigurationError, match=r"every: 0.005 s is stated, and r0 is sampled every 0.01 s"):
        on_one_clock(runs((0.01, 0.002), channels={"time": {"every": 0.005}}))


def test_commands_stay_what_acted_and_gaps_stay_gaps():
    at = np.arange(0.0, 6.0, 0.002)
    told = np.floor(at / 0.02 + 1e-6)  # a new command every 20 ms
    table = {"time": at, "drive_velocity_command": told, "drive_position": at, "drive_tension": 1.0 + at}
    slow = {name: values[::10] for name, values in table.items()}
    gone = {name: np.delete(values, np.arange(1000, 1100)) for name, values in table.items()}
    recording = Recording.from_arrays(
        "cable_hole", {"slow": slow, "fast": gone}, channels={"drive_velocity_command": {"hold": "step"}}
    )
    _, fast = on_one_clock(recording)[0].records
    assert np.all((fast.time < 2.01) | (fast.time > 2.19))
    whole = (fast.time < 1.9) | (fast.time > 2.3)
    expected = [np.mean(np.floor((t + np.arange(0.0005, 0.02, 0.001)) / 0.02 + 1e-6)) for t in fast.time[whole]]
    np.testing.assert_allclose(fast.data["drive_velocity_command"][whole], expected, atol=0.06)
    np.testing.assert_allclose(fast.data["drive_tension"][whole], 1.0 + fast.time[whole], atol=1e-9)


def test_a_column_with_times_of_its_own_is_brought_to_the_rows_of_the_time(tmp_path):
    slow, fast = np.arange(0.0, 8.0, 0.01), np.arange(0.0, 8.0, 0.002)
    rows = [f"{t:.3f},{1e3 * np.sin(t):.6f},{own:.3f},{np.cos(3.0 * own):.6f}" if k < len(slow) else
            f",,{own:.3f},{np.cos(3.0 * own):.6f}"
            for k, (t, own) in enumerate(zip(np.pad(slow, (0, len(fast) - len(slow))), fast, strict=True))]  # fmt: skip
    (tmp_path / "run.csv").write_text("\n".join(["t,x,tF,F", *rows]) + "\n")
    channels = {"time": {"column": "t", "unit": "s"}, "position": {"column": "x", "unit": "mm"},
                "force": {"column": "F", "unit": "N", "clock": "tF"}}  # fmt: skip
    content = {"schema": "cable-mapping/1", "system": "linear_drive", "channels": channels}
    (tmp_path / "map.yaml").write_text(yaml.safe_dump(content))
    data = reader("table").open_dataset(tmp_path / "run.csv", Request(tmp_path / "map.yaml", True))
    done = write_data_set(data, tmp_path / "out")
    (record,) = load_recording(done.path).records
    assert len(record.time) == len(slow)
    inner = slice(5, -5)
    np.testing.assert_allclose(record.data["force"][inner], np.cos(3.0 * record.time[inner]), atol=2e-4)
    np.testing.assert_allclose(record.data["position"], np.sin(record.time), atol=1e-8)
    assert any("brought from the clock tF" in remark for remark in done.remarks)
    content["channels"]["time"]["clock"] = "tF"
    (tmp_path / "map.yaml").write_text(yaml.safe_dump(content))
    with pytest.raises(ConfigurationError, match="'clock' is for a column with times of its own"):
        reader("table").open_dataset(tmp_path / "run.csv", Request(tmp_path / "map.yaml", True))


def test_the_stated_clock_is_written_and_read_again(tmp_path):
    recording = runs((0.01,), channels={"time": {"every": 0.02}})
    again = load_recording(recording.write(tmp_path / "out"))
    assert again.channels["time"].every == 0.02
    wrong = {"force": {"every": 0.02}}
    with pytest.raises(ConfigurationError, match="'every' is for time"):
        runs((0.01,), channels=wrong)
