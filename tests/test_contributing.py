"""CONTRIBUTING.md as a contributor follows it: its files, put into a copy of the tree, work; no other changes."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from cablebench.skeletons import skeleton

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
BLOCK = re.compile(
    r"^```(?:python|yaml)\n# (?P<path>[\w./-]+\.(?:py|yaml))\n(?P<text>.*?)^```", re.MULTILINE | re.DOTALL
)
FILES = {match["path"]: match["text"] for match in BLOCK.finditer(PAGE)}

TRY = """
import gymnasium as gym, numpy as np
import cable_envs
from cable_envs import baselines
from cable_envs.core.inputs import INPUTS
from cable_envs.effects import EFFECTS
from cable_envs.plants import families, plant_for
from cable_envs.core.errors import ConfigurationError
from cable_envs.core.inputs import INPUTS

# the plant: environments, one and many, its own and the new effect, what it does not offer
assert "cable_envs/Slider-Position-Sine-v0" in cable_envs.ENV_IDS and "slider" in families()
env = gym.make("cable_envs/Slider-Position-Sine-v0", sensor_noise=True, observe="output")
env.reset(seed=3)
for _ in range(20):
    *_, info = env.step(np.array([0.25], np.float32))
batch = gym.make_vec("cable_envs/Slider-Position-Sine-v0", num_envs=2, vectorization_mode="vector_entry_point")
batch.reset(seed=3)
for _ in range(20):
    *_, infos = batch.step(np.full((2, 1), 0.25, np.float32))
assert infos["position"][0] == info["position"] > 0.0
springy = gym.make("cable_envs/Slider-Position-Sine-v0", effects={"cubic_spring": {"stiffness": 1e6}})
springy.reset(seed=3)
for _ in range(20):
    *_, held = springy.step(np.array([0.25], np.float32))
assert 0.0 < held["position"] < info["position"]
refused = gym.make("cable_envs/Slider-Position-Sine-v0", render_mode="rgb_array")
try:
    refused.reset(seed=0)
except ConfigurationError as error:
    assert str(error) == "slider has no scene: rgb_array and human are not available", error
else:
    raise AssertionError("a plant without a scene was drawn")

# the physics: at rest under a held force the spring carries it
slider = plant_for("slider")
values = slider.table.pack({})[:, None]
p, u = slider.prepare(values), np.zeros((INPUTS.count, 1))
x = slider.rest(p, np.array([0.0]))
u[0] = 5.0
for _ in range(1500):
    slider.advance(x, p, u, 0, 1, 5, 2e-3)
assert abs(x[slider.row("position"), 0] - 5.0 / 100.0) < 1e-9

# the effect is there for every plant that asks at its seam; the controller for the plant that it names
for plant in map(plant_for, families()):
    assert bool(plant.effects.effects["cubic_spring"].parameters) == ("load" in plant.effects.acting.seams)
lifting = baselines.make_controller("lifting", "cable_hole", "tension", "position", {"load_mass": 5.0}, 0.01)
assert lifting.act(0.0, {"load_position": 0.0}, (0.01, 0.0, 0.0)) == 5.0 * 9.81 + 3000.0 * 0.01
print("all of it works")
"""


TRY_LEARNING_AND_DATA = """
import pathlib
import numpy as np
from cable_envs.agents.settings import load_settings
from cable_envs.diagnosis.data.recording import load_recording
from cable_envs.diagnosis.readers import reader
from cable_envs.diagnosis.readers.base import Request
from cable_envs.diagnosis.readers.writer import write_data_set

# the agent: its settings, for any environment and for the one that it names
assert load_settings("short-ppo", "cable_envs/CableHole-Position-Sine-v0").learner["gamma"] == 0.98
other = load_settings("short-ppo", "cable_envs/PulleyCircuit-Torque-Step-v0")
assert other.n_timesteps == 100_000 and "gamma" not in other.learner

# the reader: a log becomes a recording in SI, its end held out
rows = [f"{10 * k};{0.05 + 1e-4 * k:.4f};0.0491;{0.2 * k:.2f}" for k in range(900)]
pathlib.Path("monday.csv").write_text("\\n".join(["t;F_motor;F_load;x", *rows]) + "\\n")
done = write_data_set(reader("hoist-log").open_dataset(pathlib.Path("monday.csv"), Request()), pathlib.Path("out"))
recording = load_recording(done.path)
fit, heldout = recording.used_for("fit")[0], recording.used_for("heldout")[0]
assert recording.system == "cable_hole" and heldout.time[0] > 6.0 - 1e-9 > fit.time[-1] - 0.02
assert np.allclose(fit.data["drive_tension"][:2], [50.0, 50.1]) and np.isclose(fit.data["drive_position"][1], 2e-4)
assert np.isclose(recording.noise["load_tension"], 2.0)
print("all of it works")
"""


def test_the_page_has_the_files_of_everything_that_is_found_in_a_folder():
    folders = sorted({str(Path(path).parent) for path in FILES})
    assert folders == [
        "baselines", "cable_envs/effects", "cable_envs/plants/slider", "configs/agents", "configs/rigs",
        "configs/tasks", "diagnosis/readers/sets",
    ]  # fmt: skip
    assert not [path for path in FILES if (ROOT / path).exists()], "the examples must add files, not change any"


def test_the_page_shows_what_cablebench_new_writes():
    """One source: the templates of `cablebench.skeletons`."""
    shown = {
        "baselines/lifting.py": skeleton("controller", "lifting")[0]["lifting.py"],
        "cable_envs/effects/cubic_spring.py": skeleton("effect", "cubic_spring")[0]["cubic_spring.py"],
        **skeleton("plant", "slider")[0],
    }
    assert {path: FILES[path] for path in shown} == shown


def followed(folder, packages, script, **more):
    """Run ``script`` on a copy of ``packages`` with the page's files in it."""
    for package in packages:
        shutil.copytree(ROOT / package, folder / package, symlinks=True, ignore=shutil.ignore_patterns("__pycache__"))
    for path, text in FILES.items():
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / path).write_text(text, encoding="utf-8")
    environment = {**os.environ, "PYTHONPATH": str(folder), **more}
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, timeout=300, cwd=folder, env=environment
    )
    assert (done.returncode, done.stdout) == (0, "all of it works\n"), done.stderr


@pytest.mark.nojit
def test_a_plant_an_effect_and_a_controller_need_no_file_but_their_own(tmp_path):
    followed(tmp_path, ("cable_envs", "baselines", "configs"), TRY, NUMBA_DISABLE_JIT="1")


def test_an_agent_and_a_reader_of_data_need_no_file_but_their_own(tmp_path):
    followed(tmp_path, ("cable_envs", "baselines", "configs", "agents", "diagnosis"), TRY_LEARNING_AND_DATA)
