"""Published sets from the folder beside the checkout; skipped where they are not there. Nothing is copied from them."""

import json
from pathlib import Path

import numpy as np
import pytest

from cable_envs.core.errors import ConfigurationError
from cable_envs.diagnosis.data.first_look import first_look
from cable_envs.diagnosis.data.recording import load_recording
from cable_envs.diagnosis.readers import reader
from cable_envs.diagnosis.readers.base import Request
from cable_envs.diagnosis.readers.writer import write_data_set

SETS = Path(__file__).parents[3] / "shared" / "recordings"
JAW = SETS / "davinci_tool"
needs = {
    name: pytest.mark.skipif(not (SETS / name).is_dir(), reason=f"the published set {name} is not at {SETS / name}")
    for name in ("davinci_tool", "band_brake", "emps", "coupled_drives")
}


def take(form, path, out, **options):
    strict = options.setdefault("strict", True)
    done = write_data_set(reader(form).open_dataset(path, Request(None, strict)), out, **options)
    return load_recording(done.path), done


@needs["davinci_tool"]
def test_the_jaw_without_simulation(tmp_path):
    """Directional friction that grows with load, a gap that does not, a state at reversals, stiffening: in the data."""
    recording, done = take("da-vinci-jaw", JAW, tmp_path / "out", chosen=["Tool_4_Maryland_L_4_2?"])
    assert done.faults == ()
    assert [r.conditions["load_percent"] for r in recording.records] == [10.0, 30.0, 50.0, 70.0, 90.0]
    assert [r.use for r in recording.records] == ["fit", "heldout", "fit", "heldout", "fit"]
    assert all(r.conditions["frequency"] == pytest.approx(0.3, abs=0.002) for r in recording.records)
    assert len(recording.offset_groups("output_angle")) == 1
    power = [
        np.mean(r.data["drive_torque"] * np.gradient(r.data["drive_angle"], r.time))
        - np.mean(r.data["output_torque"] * np.gradient(r.data["output_angle"], r.time))
        for r in recording.records
    ]
    assert min(power) > 0.0  # the signs: friction takes power
    (found,) = first_look(recording).values()
    (slopes,) = found["slopes"]
    assert slopes["closing"] == pytest.approx(1.43, abs=0.04) and slopes["opening"] == pytest.approx(0.67, abs=0.03)
    assert slopes["ln_n"] == pytest.approx(0.38, abs=0.02)
    assert 2.0 < found["rigid"]["angle_rms_deg"] < 3.5
    near = found["reversals"]
    assert near["by_state_mnm"] < 0.5 * near["by_sign_mnm"]
    soft, *others = (s["n_m_per_rad"] for s in found["stiffness"]["opening"])
    assert soft < 0.7 * min(others)  # low loads are softer where the jaw opens
    assert found["repeats"]["jaw_deg"] < 0.1 and found["repeats"]["torque_mnm"] < 2.0


@needs["davinci_tool"]
def test_damaged_jaw_files_are_named(tmp_path):
    folder = tmp_path / "set"
    folder.mkdir()
    names = [f"Tool_4_Maryland_L_4_2{k}.TXT" for k in (0, 2, 4, 6)]
    kept = {name: (JAW / name).read_text().splitlines()[:12_012] for name in names}
    other = (JAW / "Tool_4_Maryland_L_Pitch_3_001.TXT").read_text().splitlines()[:12_000]
    kept["Tool_4_Maryland_L_4_28.TXT"] = other  # a record of another session under this one's name
    header = kept[names[0]][10]
    kept[names[0]].insert(5000, header)
    cells = [line.split(",") for line in kept[names[1]]]
    for row in cells[4000:4800]:
        row[4] = cells[4000][4]
    kept[names[1]] = [",".join(row) for row in cells]
    kept[names[2]] = _limited(kept[names[2]], column=2, limit=2500)
    for name, lines in kept.items():
        (folder / name).write_text("\n".join(lines) + "\n")
    with pytest.raises(ConfigurationError, match=rf"{names[0]}, line 5001: a header or remark among the rows"):
        take("da-vinci-jaw", folder, tmp_path / "out")
    recording, done = take("da-vinci-jaw", folder, tmp_path / "out", strict=False)
    kinds = {r.name.removesuffix(".csv"): {(d.kind, d.channel) for d in r.quality} for r in recording.records}
    assert ("dropped", None) in kinds["Tool_4_Maryland_L_4_20"]
    assert kinds["Tool_4_Maryland_L_4_22"] == {("stuck", "output_angle")}
    assert kinds["Tool_4_Maryland_L_4_24"] == {("saturated", "drive_torque")}
    assert kinds["Tool_4_Maryland_L_4_26"] == set()
    assert {("outlier", None), ("label", None)} <= kinds["Tool_4_Maryland_L_4_28"]
    assert any("header names tool number 4 Lot N10150901" in fault for fault in done.faults)


def _limited(lines, column, limit):
    cells = [line if line.startswith("%") else line.split(",") for line in lines]
    for row in cells:
        if isinstance(row, list):
            row[column] = str(min(int(row[column]), limit))
    return [row if isinstance(row, str) else ",".join(row) for row in cells]


@needs["davinci_tool"]
def test_the_jaws_set_as_it_is_published(tmp_path):
    """Folders of a series with numbered files, the log of a serial port beside them; zeros are those of the series."""
    data = tmp_path / "data"
    for series, numbers in (("Tool_4_Maryland_L_4", ("20", "22", "24")), ("Tool_4_Maryland_L_Pitch_1", ("001", "003"))):
        (data / series).mkdir(parents=True)
        (data / series / "SerialLog.txt").write_text("12:00:01,ready,0\n")
        for number in numbers:
            lines = (JAW / f"{series}_{number}.TXT").read_text().splitlines()[:6000]
            (data / series / f"{number}.TXT").write_text("\n".join(lines) + "\n")
    whole, one = (reader("da-vinci-jaw").open_dataset(at, Request()) for at in (data, data / "Tool_4_Maryland_L_4"))
    assert [r.name for r in whole.records] == [
        "Tool_4_Maryland_L_4_20", "Tool_4_Maryland_L_4_22", "Tool_4_Maryland_L_4_24",
        "Tool_4_Maryland_L_Pitch_1_001", "Tool_4_Maryland_L_Pitch_1_003",
    ]  # fmt: skip
    alone = reader("da-vinci-jaw").open_dataset(data / "Tool_4_Maryland_L_4" / "22.TXT", Request())
    assert [r.offsets for r in one.records] == [r.offsets for r in whole.records[:3]]
    assert [r.offsets for r in alone.records] == [whole.records[1].offsets]
    assert any("SerialLog.txt is left out: records of this set are called by a number" in r for r in one.remarks)
    for file in data.rglob("*.TXT"):
        file.unlink()
    with pytest.raises(ConfigurationError, match="holds no record of this set: they are called <number>"):
        reader("da-vinci-jaw").open_dataset(data, Request())


@needs["davinci_tool"]
def test_swapped_labels_are_named(tmp_path):
    folder = tmp_path / "set"
    folder.mkdir()
    for name, source in (("20", "28"), ("28", "20"), ("22", "22"), ("24", "24"), ("26", "26")):
        lines = (JAW / f"Tool_4_Maryland_L_4_{source}.TXT").read_text().splitlines()[:8000]
        (folder / f"Tool_4_Maryland_L_4_{name}.TXT").write_text("\n".join(lines) + "\n")
    (folder / "index.csv").write_text((JAW / "index.csv").read_text())
    data = reader("da-vinci-jaw").open_dataset(folder, Request())
    doubted = {r.name: str(r.doubts[0]) for r in data.records if r.doubts}
    assert list(doubted) == ["Tool_4_Maryland_L_4_20", "Tool_4_Maryland_L_4_28"]
    assert (
        "index.csv says load_percent 10, the load by the command column, %, is 90" in doubted["Tool_4_Maryland_L_4_20"]
    )


@needs["band_brake"]
def test_the_band_brake(tmp_path):
    recording, done = take("band-brake", SETS / "band_brake", tmp_path / "out")
    assert done.faults == () and [r.use for r in recording.records] == ["fit", "heldout"]
    data = recording.records[0].data
    forwards = data["velocity"] > 0.5 * data["velocity"].max()
    assert data["force"][forwards].mean() > 5000.0  # N, along the motion: the actuator's
    assert data["band_tension_2"][forwards].mean() > 10 * data["band_tension_1"][forwards].mean()
    assert np.ptp(data["position"]) == pytest.approx(0.0511, abs=1e-4)
    broken = tmp_path / "dataset2_1Hz30lbtension1amplitude.json"
    text = (SETS / "band_brake" / broken.name).read_text()
    broken.write_text(text[:100_000])
    with pytest.raises(ConfigurationError, match=r"amplitude.json is not whole, or no JSON: .* line 1 column 1"):
        take("band-brake", broken, tmp_path / "o")
    content = json.loads(text)
    content["data"] = content["data"][::2]  # half the rows, the same times: 1 Hz stays 1 Hz
    for row in content["data"]:
        row[0] *= 2
    broken.write_text(json.dumps(content))
    _, done = take("band-brake", broken, tmp_path / "o")
    assert "the name says 1 Hz, the displacement has 0.497 Hz" in done.faults[0]


@needs["emps"]
def test_emps(tmp_path):
    recording, done = take("emps", SETS / "emps", tmp_path / "out")
    fit, heldout = recording.records
    assert done.faults == () and (len(fit.time), len(heldout.time)) == (18_000, 6_841)
    assert recording.known["force_per_volt"].value == 35.1507
    assert heldout.time[0] == pytest.approx(18.0) and fit.data["position"].max() == pytest.approx(0.246, abs=1e-3)


@needs["coupled_drives"]
def test_coupled_drives_csv_and_matlab(tmp_path):
    from scipy.io import savemat

    recording, done = take("coupled-drives", SETS / "coupled_drives", tmp_path / "out")
    assert done.faults == () and [len(r.time) for r in recording.records] == [400, 100] * 5
    record = next(r for r in recording.records if r.name == "uniform_1_after.csv")
    assert record.time[0] == pytest.approx(8.0) and record.use == "heldout"
    rows = np.genfromtxt(SETS / "coupled_drives" / "DATAUNIF.csv", delimiter=",", skip_header=1)
    savemat(tmp_path / "DATAUNIF.mat", {n: rows[:, [k]] for k, n in enumerate(("u11", "u12", "z11", "z12"))})
    again, _ = take("coupled-drives", tmp_path / "DATAUNIF.mat", tmp_path / "again")
    for a in again.records:
        b = next(r for r in recording.records if r.name == a.name)
        np.testing.assert_array_equal(a.data["speed_reading"], b.data["speed_reading"])
        np.testing.assert_array_equal(a.data["voltage"], b.data["voltage"])
