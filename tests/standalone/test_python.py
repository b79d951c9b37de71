"""A rig in Python needs nothing but `math`, and gives the numbers of the rig in C, to the bit."""

import ast
import subprocess
import sys
from fractions import Fraction

import numpy as np
import pytest
import yaml

from cable_envs.core.errors import ConfigurationError
from cable_envs.standalone.law import law_of
from cable_envs.standalone.python_text import python_text
from tests.standalone.cases import RIGS, in_c, inputs_of, needs_gcc, plain, with_effects
from tests.support.tree import ROOT

STEPS = 60


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
@pytest.mark.parametrize(
    ("name", "effects"), [*((name, True) for name in RIGS), ("hole", False), ("sheath with contacts", False)]
)
def test_it_gives_the_numbers_of_the_rig_in_c(name, effects, tmp_path):
    law = with_effects(RIGS[name]) if effects else plain(RIGS[name])
    inputs = inputs_of(law, STEPS)
    expected, readings = in_c(law, inputs, tmp_path)
    seen, shown = run(law, inputs)
    np.testing.assert_array_equal(seen, expected)
    assert shown.keys() == readings.keys()
    for one, series in shown.items():
        np.testing.assert_array_equal(series, readings[one])


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
        {"plant": "linear_drive", "parameters": {"coulomb": 7.0}, "effects": {"position_ripple": {"force": 2.0}}}
    )
    text = python_text(law)
    assert "\nCOULOMB = 7.0  # N: Coulomb friction of the carriage" in text and "coulomb=COULOMB," in text
    assert "\nPOSITION_RIPPLE_FORCE = 2.0  # N: " in text and "amplitude=POSITION_RIPPLE_FORCE," in text
    functions = [n for n in ast.parse(text).body if isinstance(n, ast.FunctionDef)]
    assert len([f for f in functions if ast.get_docstring(f)]) > 20


def test_quotients_by_zero_are_those_of_the_simulator():
    space = {}
    exec(python_text(law_of("gu-inferred")), space)
    quotient = space["quotient"]
    for a, b in ((1.0, 0.0), (-1.0, 0.0), (1.0, -0.0), (0.0, 0.0), (np.inf, 0.0), (3.0, 2.0)):
        with np.errstate(all="ignore"):
            np.testing.assert_equal(quotient(a, b), float(np.float64(a) / np.float64(b)))


@needs_gcc
def test_the_example_of_the_page(tmp_path):
    """The rig of docs/export-rig.md gives the number that the page says, in Python and in C."""
    page = (ROOT / "docs" / "export-rig.md").read_text(encoding="utf-8")
    rig = yaml.safe_load(page.split("```yaml\n")[1].split("```")[0])
    law = law_of(rig)
    inputs = {"command": np.full(50, 40.0), "disturbance": np.zeros(50)}
    seen, shown = run(law, inputs)
    said = [round(float(seen[-1, 0]), 6), round(float(shown["position"][-1]), 6)]
    assert f"All three print {said[0]} m for the carriage, and {said[1]} m" in page
    np.testing.assert_allclose(in_c(law, inputs, tmp_path)[0][-1, 0], seen[-1, 0], rtol=1e-12)


def test_bits_and_the_fused_product_are_those_of_the_processor():
    space = {}
    exec(python_text(law_of("gu-inferred")), space)
    rng = np.random.default_rng(3)
    numbers = [0.0, -0.0, 1.0, -1.5, 5e-324, 2.2250738585072014e-308, 1.7976931348623157e308, np.inf, -np.inf]
    for x in [*numbers, *rng.normal(size=50) * 10.0 ** rng.integers(-300, 300, 50)]:
        bits = space["to_bits"](float(x))
        assert bits == int(np.float64(x).view(np.int64))
        assert np.float64(space["from_bits"](bits)).view(np.int64) == bits
        assert space["shift_right_52"](bits) == int(np.float64(x).view(np.uint64)) >> 52
    # the product of two numbers of 53 bits has 106: what is left of it after its rounded value is exact
    for a, b in rng.normal(size=(50, 2)).tolist():
        left = space["fma"](a, b, -(a * b))
        exact = Fraction(a) * Fraction(b) - Fraction(a * b)
        assert Fraction(left) == exact
    assert space["fma"](np.inf, 1.0, 1.0) == np.inf and space["fma"](1.0, 1.0, -1.0) == 0.0


def test_a_delay_of_the_command_is_refused_by_name():
    """The simulator's replay makes it of a recorded command; the exported law is told each command as it comes."""
    law = law_of({"plant": "rotary_joint", "effects": {"command_delay": {"time": 0.01}}})
    with pytest.raises(ConfigurationError, match=r"command_delay\.time"):
        law.program()


def test_numbers_that_nothing_reads_are_left_out():
    """Friction that builds up over a distance is left out of a step without any, with all that only it needs."""
    tree = ast.parse(python_text(with_effects(RIGS["hole"])))
    functions = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]
    assert {"slip_speed", "slip_speed_2"} <= {function.name for function in functions}
    for function in functions:
        names = [node for node in ast.walk(function) if isinstance(node, ast.Name)]
        read = {name.id for name in names if isinstance(name.ctx, ast.Load)}
        for one in ast.walk(function):
            if isinstance(one, ast.Assign) and isinstance(one.targets[0], ast.Name):
                target = one.targets[0].id
                assert target in read, f"{function.name}: {ast.unparse(one)}"
                assert not isinstance(one.value, ast.Name) or one.value.id != target, f"{function.name}: {target}"
