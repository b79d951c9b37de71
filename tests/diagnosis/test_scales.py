"""Units held against each other: what physics may do to two channels is no wrong unit."""

import numpy as np
import pytest
import yaml

from cable_envs.diagnosis.data.recording import Recording, load_recording
from cable_envs.diagnosis.intake.scales import wrong_units


def _recording(folder, factor):
    """A weight that friction holds: the drive's tension swings by 30 N, the load's by 1 N; it is written ``factor``."""
    t = 0.01 * np.arange(2000)
    turn = np.sin(2.0 * np.pi * 0.2 * t)
    place, pull, weight = 20.0 + 8.0 * np.cos(2.0 * np.pi * 0.2 * t), 75.0 + 30.0 * turn, 73.5 + turn
    table = np.column_stack([t, place, place - 1.0, pull, factor * weight])
    header = "time,drive_position,load_position,drive_tension,load_tension"
    np.savetxt(folder / "run.csv", table, delimiter=",", header=header, comments="")
    units = {"time": "s", "drive_position": "mm", "load_position": "mm", "drive_tension": "N", "load_tension": "N"}
    content = {
        "schema": "cable-recording/1", "system": "cable_hole", "nominal": {"load_mass": {"value": 7.5, "unit": "kg"}},
        "records": [{"data": "run.csv", "use": "fit"}],
        "channels": {name: {"column": name, "unit": unit} for name, unit in units.items()},
    }  # fmt: skip
    (folder / "recording.yaml").write_text(yaml.safe_dump(content))
    return load_recording(folder)


def test_a_load_that_hardly_moves_its_tension_has_the_right_unit(tmp_path):
    assert wrong_units(_recording(tmp_path, 1.0)) == []


@pytest.mark.parametrize("factor", [1e-3, 1e3])
def test_a_tension_in_another_unit_is_named_beside_the_drives(tmp_path, factor):
    (found,) = wrong_units(_recording(tmp_path, factor))
    assert found.channel == "load_tension" and "times drive_tension" in found.text


def _voltage_drive(place=1.0, voltage=1.0):
    t = 0.01 * np.arange(2000)
    table = {"time": t, "position": place * 0.1 * np.sin(4.0 * t), "voltage": voltage * 8.0 * np.cos(3.0 * t)}
    return Recording.from_arrays("linear_drive", {"run": table})


def test_no_drive_of_one_axis_has_kilovolts_or_the_speed_of_a_train():
    assert wrong_units(_voltage_drive()) == []
    (found,) = wrong_units(_voltage_drive(voltage=1000.0))
    assert found.channel == "voltage" and "8e+03 V" in found.text and "'mV' would fit better" in found.text
    (found,) = wrong_units(_voltage_drive(place=180.0 / np.pi))
    assert found.channel == "position" and "m/s" in found.text
