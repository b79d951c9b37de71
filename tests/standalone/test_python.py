"""A rig in Python needs nothing but the standard library, and gives the numbers of the rig in C."""

import ast
import subprocess
import sys

import numpy as np
import pytest

from cable_envs.standalone.law import law_of
from cable_envs.standalone.python_text import python_text
from tests.standalone.cases import RIGS, in_c, inputs_of, needs_gcc, plain, with_effects

STEPS = 100


def run(law, inputs):
    """Signals of the Python file, [steps, signals], and what its sensors show by name."""
    space = {}
    exec(compile(python_text(law), f"{law.name}.py", "exec"), space)
    rig, seen, shown = space["Rig"](), [], []
    for t in range(len(inputs["command"])):
        rig.step(**{name: float(series[t]) for name, series in inputs.items()})
        places = [law.places[s.name] for s in law.plant.signals]
        seen.append([getattr(rig.signals, f) if k < 0 else getattr(rig.signals, f)[k] for f, k in places])
        shown.append(dict(getattr(rig, "shown", {})))
    return np.array(seen), {name: np.array([one[name] for one in shown]) for name in shown[0]}


@needs_gcc
@pytest.mark.parametrize("effects", [False, True])
@pytest.mark.parametrize("name", RIGS)
def test_it_gives_the_numbers_of_the_rig_in_c(name, effects, tmp_path):
    """Its exponentials and sines are those of `math`, which round otherwise in the last place.

    A rig that slips passes such a difference on; none of these makes more than 1e-9 of a signal's range from it.
    """
    law = with_effects(RIGS[name]) if effects else plain(RIGS[name])
    inputs = inputs_of(law, STEPS)
    expected, readings = in_c(law, inputs, tmp_path)
    seen, shown = run(law, inputs)
    tolerance = 1e-9 * (np.abs(expected).max(axis=0) + 1e-6)
    assert (np.abs(seen - expected) <= tolerance).all()
    assert shown.keys() == readings.keys()
    for one, series in shown.items():
        np.testing.assert_allclose(series, readings[one], rtol=1e-9, atol=1e-9)


def test_it_imports_only_math_and_runs_alone(tmp_path):
    text = python_text(law_of("gu-inferred", name="hole"))
    imported = [n for n in ast.walk(ast.parse(text)) if isinstance(n, (ast.Import, ast.ImportFrom))]
    assert [ast.unparse(n) for n in imported] == ["import math"]
    (tmp_path / "hole.py").write_text(text)
    code = "from hole import Rig; r = Rig(); [r.step(70.0) for _ in range(20)]; print(r.signals.load_position > 1e-3)"
    done = subprocess.run([sys.executable, "-I", "-c", f"import sys; sys.path.insert(0, '.'); {code}"], cwd=tmp_path,
                          capture_output=True, text=True, check=True)  # fmt: skip
    assert done.stdout == "True\n"


def test_it_names_parameters_with_units_and_keeps_docstrings():
    law = law_of(
        {"plant": "linear_drive", "parameters": {"coulomb": 7.0}, "effects": {"position_ripple": {"amplitude": 2.0}}}
    )
    text = python_text(law)
    assert "\nCOULOMB = 7.0  # N: Coulomb friction of the carriage" in text and "coulomb=COULOMB," in text
    assert "\nPOSITION_RIPPLE_AMPLITUDE = 2.0  # N: " in text and "amplitude=POSITION_RIPPLE_AMPLITUDE," in text
    functions = [n for n in ast.parse(text).body if isinstance(n, ast.FunctionDef)]
    assert len([f for f in functions if ast.get_docstring(f)]) > 20


def test_quotients_by_zero_are_those_of_the_simulator():
    space = {}
    exec(python_text(law_of("gu-inferred")), space)
    quotient = space["quotient"]
    for a, b in ((1.0, 0.0), (-1.0, 0.0), (1.0, -0.0), (0.0, 0.0), (np.inf, 0.0), (3.0, 2.0)):
        with np.errstate(all="ignore"):
            np.testing.assert_equal(quotient(a, b), float(np.float64(a) / np.float64(b)))
