"""Rig files: every shipped one loads, names its sources and holds the papers' numbers; bad ones say what is wrong."""

import numpy as np
import pytest
import yaml

from cable_envs.core.config import config_root
from cable_envs.core.errors import ConfigurationError
from cable_envs.effects.lanes import STATES
from cable_envs.sim.rigs import load_rig, rig_from_mapping

PRESETS = sorted(path.stem for path in (config_root() / "rigs").glob("*.yaml"))

TABLE_A1 = {  # delta, mu, K, omega of Table A1, Gu 2024
    "gu-steel-1mm": (0.019, 0.283, 1192, 3.53), "gu-steel-2mm": (0.015, 0.274, 2643, 3.48),
    "gu-steel-3mm": (0.009, 0.297, 3347, 3.44), "gu-braided-1mm": (0.028, 0.425, 3027, 2.02),
    "gu-braided-2mm": (0.020, 0.430, 6574, 2.03), "gu-braided-3mm": (0.015, 0.427, 9982, 1.99),
    "gu-rubber-1mm": (0.042, 0.328, 1918, 1.67), "gu-rubber-2mm": (0.033, 0.334, 4622, 1.66),
    "gu-rubber-3mm": (0.027, 0.320, 6913, 1.71),
}  # fmt: skip


@pytest.mark.parametrize("name", PRESETS)
def test_preset_loads_and_every_number_has_a_source(name):
    rig = load_rig(name)
    given, more = set(), name
    while more:  # and of the preset that it extends
        content = yaml.safe_load((config_root() / "rigs" / f"{more}.yaml").read_text())
        given, more = given | set(content["parameters"]), content.get("extends")
    assert rig.name == name and rig.description
    assert set(rig.sources) == given | set(rig.valid) and all(rig.sources.values())
    plant = rig.simulated_by()
    p = plant.prepare(np.array([[rig.values[n]] for n in plant.parameters.names]))
    effects, states = (0, 0) if plant.plain else (plant.effects.count, STATES.count)  # a plant may have them always
    assert p.shape == (len(plant.coefficients) + effects, 1) and np.isfinite(p).all()
    x = plant.rest(p, np.zeros(1))
    assert x.shape == (len(plant.signals) + states, 1) and np.isfinite(x).all()


@pytest.mark.parametrize("name", TABLE_A1)
def test_gu_table_a1(name):
    values = load_rig(name).values
    keys = ("extrusion_delta", "friction_coefficient", "extrusion_gain", "extrusion_exponent")
    assert tuple(values[k] for k in keys) == TABLE_A1[name]
    assert values["cable_radius"] == pytest.approx(float(name[-3]) * 0.5e-3, rel=1e-12)


def test_zou_table_2():
    values = load_rig("zou-table2").values
    assert (values["tensile_stiffness"], values["drive_radius"], values["cable_friction"]) == (1.684e4, 7e-3, 0.54)


def test_rig_by_path_and_from_mapping(tmp_path):
    content = {"schema": "cable-rig/1", "name": "mine", "plant": "cable_hole", "parameters": {"load_mass": 7}}
    path = tmp_path / "mine.yaml"
    path.write_text(yaml.safe_dump(content))
    assert load_rig(path).values == load_rig(content).values and load_rig(path).values["load_mass"] == 7.0
    assert load_rig(load_rig(path)) is not None


def test_replace_leaves_the_original():
    rig = load_rig("gu-inferred")
    heavier = rig.replace({"load_mass": {"value": 7000, "unit": "g"}})
    assert heavier.values["load_mass"] == 7.0 and rig.values["load_mass"] == 5.0


GOOD = {"schema": "cable-rig/1", "name": "mine", "plant": "cable_hole", "parameters": {}}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"schema": "cable-rig/2"}, "schema 'cable-rig/2' is not 'cable-rig/1'"),
        ({"plant": "cable_whole"}, "did you mean 'cable_hole'"),
        ({"plants": "cable_hole"}, "did you mean 'plant'"),
        ({"holes": 51}, r"holes = 51 is outside \[1, 50\]"),
        ({"holes": 1.5}, "holes must be a whole number"),
        ({"plant": "pulley_circuit", "holes": 2}, "'holes' belongs to cable_hole"),
        ({"parameters": [1, 2]}, "'parameters' must be a mapping"),
        ({"parameters": {"friction_coeficient": 0.3}}, "did you mean 'friction_coefficient'"),
        ({"parameters": {"load_mass": {"value": 5, "unit": "N"}}}, "unit 'N' does not fit; expected kg or g"),
        ({"parameters": {"load_mass": {"unit": "kg"}}}, "needs 'value'"),
        ({"parameters": {"load_mass": {"value": 5, "units": "kg"}}}, "did you mean 'unit'"),
        ({"parameters": {"cable_stiffness": -60e3}}, r"cable_stiffness = -60000 N/m is outside its physical range"),
        ({"parameters": {"wrap_angle_2": 0.3}}, "did you mean 'wrap_angle'"),
    ],
)
def test_bad_rigs_name_the_key_and_what_would_be_right(changes, message):
    with pytest.raises(ConfigurationError, match=message):
        rig_from_mapping({**GOOD, **changes})


def test_unknown_and_broken_files(tmp_path):
    with pytest.raises(ConfigurationError, match=r"did you mean 'gu-steel-1mm'"):
        load_rig("gu-steel-1m")
    with pytest.raises(ConfigurationError, match="cannot read"):
        load_rig(tmp_path / "none.yaml")
    broken = tmp_path / "broken.yaml"
    broken.write_text("parameters: {load_mass: [")
    with pytest.raises(ConfigurationError, match="not valid YAML"):
        load_rig(broken)
    broken.write_text("- 1\n- 2\n")
    with pytest.raises(ConfigurationError, match="expected a mapping"):
        load_rig(broken)


def test_a_rig_says_which_simulator_its_numbers_are_of(tmp_path):
    told = load_rig({"plant": "pulley_circuit", "variant": "chain"})
    assert told.simulated_by().name == "pulley_chain" and told.simulated_by("analytic").name == "pulley_circuit"
    assert load_rig(told.content()) == told and told.replace({"pretension_top": 30.0}).variant == "chain"
    assert load_rig("zou-table2").simulated_by().name == "pulley_circuit"
    with pytest.raises(ConfigurationError, match="variant of pulley_circuit in rig 'chian'; did you mean 'chain'"):
        load_rig({"plant": "pulley_circuit", "variant": "chian"})
    with pytest.raises(ConfigurationError, match="variant of cable_hole in rig 'chain'"):
        load_rig({"plant": "cable_hole", "variant": "chain"})
