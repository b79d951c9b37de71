"""An FMU of a rig is valid for an independent player, FMPy, and moves there as the simulator does."""

import subprocess
import zipfile
from xml.etree import ElementTree

import numpy as np
import pytest

from cable_envs import ConfigurationError
from cable_envs.standalone.export import export_law
from cable_envs.standalone.fmu import fmu, model_description
from cable_envs.standalone.law import law_of
from cable_envs.standalone.units import base_units
from tests.standalone.cases import RIGS, inputs_of, needs_gcc, plain, replayed, with_effects

fmpy = pytest.importorskip("fmpy", reason="FMUs are played by FMPy: pip install 'cable-envs[fmi]'")
pytestmark = [needs_gcc, pytest.mark.filterwarnings("ignore::DeprecationWarning")]


@pytest.fixture
def written(tmp_path):
    """Writes a law as an FMU."""
    return lambda law: export_law(law, "fmu", tmp_path / "rig.fmu")[0]


def played(file, law, inputs, **options):
    """Outputs that FMPy finds, [steps, signals], and what sensors show by name."""
    steps = len(inputs["command"])
    table = np.zeros(steps, dtype=[("time", float), *((name, float) for name in inputs)])
    table["time"] = np.arange(steps) * law.period
    for name, series in inputs.items():
        table[name] = series
    shown = [f"shown_{s.signal}" for s in law.sensors]
    result = fmpy.simulate_fmu(
        str(file), input=table, stop_time=steps * law.period, step_size=law.period, output_interval=law.period,
        output=[*(s.name for s in law.plant.signals), *shown], **options,
    )  # fmt: skip
    assert len(result) == steps + 1
    signals = np.array([result[s.name] for s in law.plant.signals]).T
    return signals[1:], {s.signal: result[f"shown_{s.signal}"][1:] for s in law.sensors}


@pytest.mark.parametrize("effects", [False, True])
@pytest.mark.parametrize("name", ["hole", "circuit", "drive", "transmission"])
def test_it_is_valid_and_moves_as_the_simulator(name, effects, written):
    from fmpy.validation import validate_fmu

    law = with_effects(RIGS[name]) if effects else plain(RIGS[name])
    file, inputs = written(law), inputs_of(law)
    assert validate_fmu(str(file)) == []
    seen, shown = played(file, law, inputs)
    expected, readings = replayed(law, inputs), replayed(law, inputs, sensors=True)
    np.testing.assert_allclose(seen, expected, rtol=0.0, atol=1e-6)
    names = [s.name for s in law.plant.signals]
    for one, series in shown.items():
        np.testing.assert_allclose(series, readings[:, names.index(one)], rtol=0.0, atol=1e-6)


def test_it_says_units_and_parameters(written):
    law = plain(RIGS["hole"])
    read = fmpy.read_model_description(str(written(law)))
    known = {v.name: v for v in read.modelVariables}
    assert known["command"].unit == "N" and known["command"].causality == "input"
    assert known["rig_load_mass"].variability == "constant" and float(known["rig_load_mass"].start) == 5.0
    assert {v.unit for v in read.modelVariables} <= {u.name for u in read.unitDefinitions}
    assert float(read.coSimulation.fixedInternalStepSize) == law.period


def test_a_longer_communication_step_is_several_control_steps(written):
    law = plain(RIGS["drive"])
    file, steps = written(law), 20
    held = {one.name: np.repeat(10.0 if one.name == "command" else 0.0, steps) for one in law.inputs}
    seen, _ = played(file, law, held)
    coarse = fmpy.simulate_fmu(
        str(file), start_values={"command": 10.0}, stop_time=steps * law.period, step_size=5 * law.period,
        output_interval=5 * law.period, output=["position"],
    )["position"]  # fmt: skip
    np.testing.assert_allclose(coarse[1:], seen[4::5, 0], rtol=0.0, atol=1e-12)


def test_a_step_that_is_no_whole_number_of_control_steps_is_refused(written):
    law = plain(RIGS["drive"])
    with pytest.raises(Exception, match="fmi3DoStep"):
        fmpy.simulate_fmu(
            str(written(law)), stop_time=0.1, step_size=0.7 * law.period, output_interval=0.7 * law.period
        )


def test_its_sources_make_a_library_too(written, tmp_path):
    """What is in the archive compiles by itself, with the options that its build description says."""
    law = plain(RIGS["drive"])
    with zipfile.ZipFile(written(law)) as archive:
        archive.extractall(tmp_path)
        assert archive.read("modelDescription.xml").decode() == model_description(law)
    build = ElementTree.parse(tmp_path / "sources" / "buildDescription.xml")
    options = build.find(".//SourceFileSet").get("compilerOptions").split()
    files = [one.get("name") for one in build.iter("SourceFile")]
    command = ["gcc", *options, "-Wall", "-Werror", "-fPIC", "-shared", "-o", "again.so", *files, "-lm"]
    subprocess.run(command, cwd=tmp_path / "sources", check=True)


def test_the_same_rig_gives_the_same_archive():
    law = plain(RIGS["drive"])
    assert fmu(law) == fmu(law)


def test_without_a_compiler_it_says_so(monkeypatch):
    monkeypatch.setenv("PATH", "")
    monkeypatch.delenv("CC", raising=False)
    with pytest.raises(ConfigurationError, match="needs a C compiler"):
        fmu(law_of("gu-inferred"))


def test_what_the_compiler_says_is_passed_on(monkeypatch):
    monkeypatch.setenv("CC", "false")
    with pytest.raises(ConfigurationError, match="the C compiler"):
        fmu(law_of("gu-inferred"))


@pytest.mark.parametrize(
    ("unit", "expected"),
    [
        ("N m s/rad", {"kg": 1, "m": 2, "s": -1, "rad": -1}),
        ("1", {}),
        ("N m^2", {"kg": 1, "m": 3, "s": -2}),
        ("SI", {}),
    ],
)
def test_units_in_base_units(unit, expected):
    assert base_units(unit) == expected
