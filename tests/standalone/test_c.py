"""A rig in C gives the numbers of the simulator's own replay, to the bit."""

import numpy as np
import pytest

from tests.standalone.cases import MOTORS, RIGS, in_c, inputs_of, needs_gcc, plain, replayed, with_effects

pytestmark = needs_gcc


def require_same(law, folder):
    """The C file and the replay, the sensors' readings too; the rig must move."""
    inputs = inputs_of(law)
    expected = replayed(law, inputs)
    seen, shown = in_c(law, inputs, folder)
    assert np.isfinite(expected).all() and np.ptp(expected, axis=0).max() > 1e-3
    np.testing.assert_array_equal(seen, expected)
    names = [s.name for s in law.plant.signals]
    readings = replayed(law, inputs, sensors=True)
    for name, series in shown.items():
        np.testing.assert_array_equal(series, readings[:, names.index(name)])
    return shown


@pytest.mark.parametrize("name", RIGS)
def test_a_rig_without_effects(name, tmp_path):
    law = plain(RIGS[name])
    assert law.kernel == int(law.follows or not law.plant.plain)
    require_same(law, tmp_path)


@pytest.mark.parametrize("name", RIGS)
def test_a_rig_with_effects(name, tmp_path):
    law = with_effects(RIGS[name])
    assert law.kernel == 1 and len([e for e in law.plant.effects.present(_all(law)) if e != "sensor_delay"]) > 3
    assert require_same(law, tmp_path).keys() == set(law.plant.effects.measured) & {s.name for s in law.plant.signals}


@pytest.mark.slow  # nothing else of the tests compiles these kernels
@pytest.mark.parametrize("name", ["hole", "drive"])
def test_a_rig_with_bristles(name, tmp_path):
    law = with_effects(RIGS[name], bristles=True)
    assert law.kernel == 2
    require_same(law, tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("effects", [False, True])
@pytest.mark.parametrize("name", MOTORS)
def test_a_rig_with_a_motor(name, effects, tmp_path):
    require_same(with_effects(MOTORS[name]) if effects else plain(MOTORS[name]), tmp_path)


def _all(law):
    return law.plant.table.unpack(law.rig.column(law.plant)[:, 0])
