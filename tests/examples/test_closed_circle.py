"""The closed circle on a MuJoCo model: its parts are right alone; the notebook runs the whole (test_notebooks.py)."""

import sys
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

FOLDER = Path(__file__).parents[2] / "examples" / "closed_circle"
NAMES = ("circle", "pendulum", "reality", "controller")


@pytest.fixture
def circle(monkeypatch):
    """Everything that the four files of the example have."""
    pytest.importorskip("mujoco")
    monkeypatch.syspath_prepend(str(FOLDER))
    found = {}
    for name in NAMES:
        found |= vars(import_module(name))
    yield SimpleNamespace(**found)
    for name in NAMES:
        del sys.modules[name]


def test_the_mujoco_pendulum_and_its_reality_are_one_motion_where_nothing_is_concealed(circle):
    """Two integrators, one of them MuJoCo's: without friction and lag the encoder's noise is all that is left."""
    real = circle.Reality(0, 2, noise_seed=0)
    real.friction, real.lag = 0.0, 1e-9
    sphere = 0.4 * real.mass * 0.03**2  # the bob of the model is no point
    values = {"mass": real.mass, "armature": real.bearing - sphere, "damping": real.viscous}
    rng = np.random.default_rng(0)
    tension = np.stack([circle.commands(rng, 4.0) for _ in range(2)])
    shown = np.stack([real.step(tension[:, k]) for k in range(tension.shape[1])], axis=1)
    angle = circle.Batch(circle.model(values), 2).step(tension)[0]
    # counts of 1.5 mrad and noise of 0.3 mrad, and steps of 0.2 ms of the first order
    assert np.sqrt(np.mean((angle - shown) ** 2)) < 8e-4 and np.ptp(shown) > 0.5


def test_what_a_diagnosis_names_is_written_back_into_the_mujoco_model(circle):
    rig = {
        "parameters": {name: {"value": value} for name, value in circle.BELIEVED.items()},
        "effects": {
            "coulomb_friction": {"pivot.level": {"value": 0.03}}, "actuator_lag": {"tension.time": {"value": 0.04}},
            "viscous_friction": {"pivot.coefficient": {"value": 0.01}}, "sensor_lag": {"angle": {"value": 0.01}},
        },
    }  # fmt: skip
    text, left = circle.written_back(SimpleNamespace(rig=rig))
    made = circle.mujoco.MjModel.from_xml_string(text)
    assert made.dof_frictionloss[0] == 0.03 and made.actuator_dynprm[0, 0] == 0.04
    assert np.isclose(made.dof_damping[0], circle.BELIEVED["damping"] + 0.01) and left == ["sensor_lag.angle"]


def test_a_controller_tuned_on_the_right_model_follows_better_on_the_real_rig(circle):
    """The friction and lag of rig 0 as a diagnosis finds them, against the model as it was believed."""
    real = circle.Reality(0, 1, noise_seed=0)
    right = circle.model(
        {"mass": real.mass, "armature": real.bearing, "damping": real.viscous}, real.friction, real.lag
    )
    texts = (circle.model(circle.BELIEVED), right)
    errors = [circle.tried(text, circle.tuned(text, tries=12, rounds=3, paths=1), rig=0) for text in texts]
    assert circle.factor(*errors)[1] > 1.5  # 4 with all rounds


def test_factors_have_intervals(circle):
    mean, low, high = circle.factor([2.0, 2.2, 1.8], [1.0, 1.0, 1.0])
    assert low < mean < high and mean == pytest.approx((2.0 * 2.2 * 1.8) ** (1 / 3))
