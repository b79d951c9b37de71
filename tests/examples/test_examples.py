"""The examples do what their docstrings say, in sizes that take seconds; those that train for long are marked slow."""

import ast
import importlib.util
import re
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

ROOT = Path(__file__).parents[2]
EXAMPLES = sorted((ROOT / "examples").glob("*.py"))


def example(name: str) -> ModuleType:
    """The module of examples/``name``.py."""
    spec = importlib.util.spec_from_file_location(f"example_{name}", ROOT / "examples" / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda p: p.stem)
def test_an_example_is_short_and_says_what_it_shows(path):
    """Under 100 lines of code: neither blank lines nor docstrings count."""
    source = path.read_text(encoding="utf-8")
    tree = ast.parse(source)
    holders = (ast.Module, ast.ClassDef, ast.FunctionDef)
    texts = [n.body[0] for n in ast.walk(tree) if isinstance(n, holders) and ast.get_docstring(n)]
    blank = {k for text in texts for k in range(text.lineno, text.end_lineno + 1)}
    lines = [k for k, line in enumerate(source.splitlines(), 1) if line.strip() and k not in blank]
    assert len(lines) < 100
    said = ast.get_docstring(tree)
    assert re.search(rf"^    (python|cablebench \w+) examples/{path.name}", said, re.MULTILINE)


def test_the_gym_loop_tracks_better_with_feedback():
    loop = example("gym_loop")
    held, fed = (loop.run(policy, seconds=4.0) for policy in (loop.held_weight, loop.proportional))
    assert fed[0] < 0.6 * held[0] and fed[1] > held[1]
    assert held[2] == fed[2] == "at its time limit"


def test_the_friction_of_the_hole_as_feedforward_pays():
    hand = example("controller_by_hand")
    without, with_it = (hand.run(hand.CapstanFeedforward(friction=share), seconds=6.0) for share in (0.0, 1.0))
    assert with_it < 0.2 * without < 2e-4


def test_the_controller_by_hand_is_a_submission():
    from cablebench.entrants.apart import submission_entrant

    assert submission_entrant(ROOT / "examples" / "controller_by_hand.py").name == "capstan-by-hand"


def test_linear_mpc_beats_open_loop_and_pid_as_shipped():
    mpc = example("linear_mpc")
    ours = mpc.run(mpc.LinearMpc, seconds=6.0)
    assert ours < 0.1 * mpc.run("pid", seconds=6.0) < 0.1 * mpc.run("open-loop", seconds=6.0)


CASADI = "pip install 'cable-envs[casadi]'"


def test_nonlinear_mpc_beats_pid_as_shipped():
    pytest.importorskip("casadi", reason=f"the MPC needs CasADi: {CASADI}")
    mpc = example("mpc_casadi")
    ours, theirs = (mpc.run(controller, seconds=3.0)[0] for controller in (mpc.NonlinearMpc, "pid"))
    assert ours < 0.1 * theirs


def test_the_bode_plot_differs_by_the_direction_of_friction(tmp_path, monkeypatch):
    """At low frequency the load moves by e^(-r) F over its spring, r = mu Theta pulled in and -mu Theta paid out."""
    pytest.importorskip("control", reason=f"Bode plots need python-control: {CASADI}")
    monkeypatch.setenv("MPLBACKEND", "agg")
    bode = example("bode")
    gains = {name: one.dcgain() for name, one in bode.systems().items()}
    assert gains["pulled in"] * gains["paid out"] == pytest.approx(gains["without friction"] ** 2, rel=1e-6)
    assert gains["without friction"] == pytest.approx(1.0 / 1500.0, rel=1e-6)
    bode.main(["--out", str(tmp_path / "bode.png")])
    assert (tmp_path / "bode.png").stat().st_size > 10_000


def test_randomised_rigs_differ_most_by_their_wrap_angle():
    from scipy.stats import spearmanr

    rmse, drawn = example("randomised_rigs").run(rigs=64, seconds=6.0)
    found = {name: abs(spearmanr(values, rmse).statistic) for name, values in drawn.items()}
    assert max(found, key=found.get) == "wrap_angle" and found["wrap_angle"] > 0.7
    assert rmse.max() > 2.0 * rmse.min()


@pytest.mark.slow  # compiles a kernel with the effect in it
def test_an_own_effect_acts():
    own = example("own_effect")
    without, with_it = (own.run("pid-tuned", force, seconds=4.0) for force in (0.0, 5.0))
    assert with_it > 1.1 * without


def test_ppo_in_one_file_learns_its_first_steps():
    pytest.importorskip("torch")
    said = []
    rmse = example("ppo_native_batch").run(steps=3 * 64 * 128, seconds=2.0, tell=said.append)
    assert np.isfinite(rmse) and len(said) == 2
    assert said[-1].startswith("   24576 steps")


@pytest.mark.slow
def test_ppo_in_one_file_tracks():
    pytest.importorskip("torch")
    assert example("ppo_native_batch").run(tell=lambda text: None) < 2e-4  # five seeds: 0.04 to 0.1 mm


def test_residual_learning_trains_and_compares(tmp_path):
    pytest.importorskip("torch")
    found = example("residual_learning").run(8192, tmp_path, rigs=2, seconds=2.0)
    assert (tmp_path / "policy.zip").exists() and all(0.0 < rmse < 1.0 for rmse in found.values())


def test_own_logs_become_a_recording(tmp_path):
    example("own_recording").main(["--out", str(tmp_path), "--seconds", "4", "--only-logs"])
    lines = (tmp_path / "logs" / "slow.csv").read_text().splitlines()
    assert lines[0] == "t,x,F" and len(lines) == 801


@pytest.mark.slow
def test_the_spring_of_the_own_recording_is_found(tmp_path):
    command = [sys.executable, "examples/own_recording.py", "--out", str(tmp_path)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=900)
    assert "lacks position-dependent load" in done.stdout, done.stderr
    assert (tmp_path / "answer" / "report.html").exists()


def test_offline_learning_from_a_small_dataset(tmp_path):
    pytest.importorskip("torch")
    pytest.importorskip("minari")
    found = example("offline_minari").run(tmp_path, episodes=2, steps=20, seconds=2.0)
    assert list(found) == ["PID", "copied", "advantage-weighted"] and all(np.isfinite(r) for r in found.values())


@pytest.mark.slow
def test_offline_learning_is_better_than_what_was_recorded(tmp_path):
    pytest.importorskip("torch")
    pytest.importorskip("minari")
    found = example("offline_minari").run(tmp_path)
    assert found["advantage-weighted"] < 0.7 * found["PID"]


@pytest.mark.slow
def test_diagnose_and_retrain(tmp_path):
    pytest.importorskip("torch")
    arguments = ["--out", str(tmp_path), "--steps", "8192", "--record-seconds", "12", "--seconds", "3"]
    found = example("diagnose_and_retrain").main([*arguments, "--effects", "actuator_lag", "backlash"])
    assert set(found) == {"nominal", "corrected"} and (tmp_path / "answer" / "augmented.yaml").exists()


def test_a_simulator_of_ones_own_is_given_the_friction_that_it_lacks(capsys, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["own_simulator.py", "--effects", "coulomb_friction"])
    example("own_simulator").main()
    said = capsys.readouterr().out
    level = re.search(r"coulomb_friction, pivot.level: ([\d.]+) N m \(([\d.]+) to ([\d.]+)\); 0.02 was put in", said)
    assert level and abs(float(level[1]) - 0.02) < 2e-4
    assert "the corrected pendulum comes to rest at" in said


@pytest.mark.parametrize(
    ("book", "reference", "task", "most"),
    [
        ("textbook_hole", "adaptive-inverse", "CableHole-Position-Sine", 4e-5),
        ("textbook_circuit", "virtual-jaw", "PulleyCircuit-Position-Sine", 6e-3),
    ],
)
def test_references_are_ahead_of_the_textbook(book, reference, task, most):
    """Median RMSE of three randomised rigs of the tuning seeds, 10 s of the sinusoid each."""
    import gymnasium as gym

    from cablebench.entrants.named import named_entrant
    from cablebench.run.evaluation import core_of, run_episode

    def median(name):
        entrant = named_entrant(name, sandbox="none")
        env_id = f"cable_envs/{task}-v0"
        options = entrant.enters(env_id, {"sensor_noise": True, "randomize": True})
        env = gym.make(env_id, disable_env_checker=True, duration=10.0, **options)
        actor = entrant.make(core_of(env).setup)
        return np.median([np.sqrt(np.mean(run_episode(env, actor, 1000000 + k).error ** 2)) for k in range(3)])

    assert median(reference) < median(str(ROOT / "examples" / f"{book}.py")) < most
