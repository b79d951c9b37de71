"""Declared parameters and the errors that name what would be right."""

import math

import numpy as np
import pytest

from cable_envs.core.errors import ConfigurationError, nearest, require_known
from cable_envs.core.params import Parameter, ParameterTable, to_si

TABLE = ParameterTable(
    Parameter("mass", "kg", 5.0, 0.0, 1e3, "load"),
    Parameter("wrap_angle", "rad", 1.0, 0.0, 2 * math.pi, "wrap"),
    Parameter("radius", "m", 0.01, 1e-6, 1.0, "hole"),
)


@pytest.mark.parametrize(
    ("value", "unit", "si", "expected"),
    [
        (60, "deg", "rad", math.pi / 3),
        (10.8, "mm/s", "m/s", 0.0108),
        (0.56, "mm", "m", 0.56e-3),
        (16.84, "kN", "N", 16840.0),
        (40, "g cm^2", "kg m^2", 4e-6),
        (60, "rpm", "rad/s", 2 * math.pi),
        (3, "%", "1", 0.03),
        (2.5, "m", "m", 2.5),
    ],
)
def test_units_convert_to_si(value, unit, si, expected):
    assert to_si(value, unit, si) == pytest.approx(expected, rel=1e-15)  # one multiplication


def test_wrong_unit_names_the_fitting_ones():
    with pytest.raises(ConfigurationError, match=r"radius: unit 'kg' does not fit; expected m or mm or cm"):
        TABLE.pack({"radius": {"value": 1.0, "unit": "kg"}})


def test_pack_keeps_order_and_fills_defaults():
    vector = TABLE.pack({"radius": {"value": 4, "unit": "mm"}, "mass": 2})
    assert vector.dtype == np.float64
    assert vector.tolist() == [2.0, 1.0, 0.004]
    assert TABLE.unpack(vector) == {"mass": 2.0, "wrap_angle": 1.0, "radius": 0.004}
    assert [TABLE.index(n) for n in TABLE.names] == [0, 1, 2]
    assert "mass" in TABLE and "masses" not in TABLE and len(TABLE) == 3


def test_unknown_parameter_names_the_nearest():
    with pytest.raises(ConfigurationError, match="unknown parameter 'wrap_angel'; did you mean 'wrap_angle'"):
        TABLE.pack({"wrap_angel": 1.0})
    with pytest.raises(ConfigurationError, match="did you mean 'mass'"):
        TABLE["mas"]


def test_unknown_key_in_a_value_names_the_nearest():
    with pytest.raises(ConfigurationError, match="did you mean 'unit'"):
        TABLE.pack({"mass": {"value": 1.0, "units": "kg"}})
    with pytest.raises(ConfigurationError, match="needs 'value'"):
        TABLE.pack({"mass": {"unit": "kg"}})


@pytest.mark.parametrize("bad", [-1.0, 2e3, math.nan, math.inf])
def test_values_outside_the_physical_range_are_refused(bad):
    with pytest.raises(ConfigurationError, match=r"mass = .* kg is outside its physical range \[0, 1000\]"):
        TABLE.pack({"mass": bad})


@pytest.mark.parametrize("bad", ["5", None, True, [1.0]])
def test_what_is_no_number_is_refused(bad):
    with pytest.raises(ConfigurationError, match="mass: expected a number in kg"):
        TABLE.pack({"mass": bad})


def test_numpy_numbers_are_numbers():
    assert TABLE.pack({"mass": np.float32(2.0)})[0] == 2.0
    assert TABLE.pack({"mass": np.int64(3)})[0] == 3.0


def test_a_parameter_declared_twice_is_a_mistake():
    with pytest.raises(ValueError, match="declared twice"):
        ParameterTable(TABLE["mass"], TABLE["mass"])


def test_nearest_lists_all_when_nothing_is_close():
    assert nearest("zzz", ["mass", "friction"]) == "Valid: friction, mass"
    assert nearest("fricton", ["mass", "friction"]).startswith("did you mean 'friction'?")


def test_require_known_passes_known_names():
    require_known("option", ["a"], ["a", "b"])
    with pytest.raises(ConfigurationError, match="unknown option 'c'"):
        require_known("option", ["a", "c"], ["a", "b"])


def test_configuration_error_is_a_value_error():
    assert issubclass(ConfigurationError, ValueError)
