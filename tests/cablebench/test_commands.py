"""What the command line offers: groups, examples, former names; what `cablebench new` writes works."""

import json
import logging
import os
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import typer

from cable_envs.core.errors import ConfigurationError
from cablebench.cli import main
from cablebench.cli.app import app
from cablebench.cli.catalogue import COMMANDS
from cablebench.cli.shared.output import remarks_shown
from cablebench.skeletons import KINDS, skeleton
from tests.test_docs import offences

ROOT = Path(__file__).parents[2]
HOLE = "CableHole-Position-Sine"
SHORT = ("-o", "duration=0.5")
TYPER = typer.main.get_command(app).commands


@pytest.fixture
def cli(capsys, tmp_path, monkeypatch):
    """Run a command in an empty folder: (exit code, standard output, standard error)."""
    monkeypatch.chdir(tmp_path)

    def run(*arguments):
        with pytest.raises(SystemExit) as end:
            main([str(a) for a in arguments])
        out = capsys.readouterr()
        return end.value.code or 0, out.out, out.err

    return run


def test_the_help_shows_every_command_in_its_group_and_no_former_name(cli):
    out = cli("--help")[1]
    panels = ["Simulate", "Learn", "Benchmark", "Diagnose", "Reproduce"]
    places = [out.index(f" {panel} ─") for panel in panels]
    assert places == sorted(places) and len({c.name for c in COMMANDS}) == len(COMMANDS)
    ends = [*places[1:], len(out)]
    for command in COMMANDS:
        k = panels.index(command.panel)
        assert f"│ {command.name} " in out[places[k] : ends[k]]
        assert not any(f"│ {name} " in out for name in command.former)


@pytest.mark.parametrize("command", COMMANDS, ids=lambda c: c.name)
def test_every_help_ends_with_an_example_that_the_command_line_knows(cli, command):
    assert command.example.split()[:2] == ["cablebench", command.name]
    assert offences(command.example, True) == []
    shown = " ".join(cli(command.name, "--help")[1].split())
    assert shown.endswith(f"Example: {command.example}")


@pytest.mark.parametrize("command", [c for c in COMMANDS if c.former], ids=lambda c: c.name)
def test_a_former_name_does_the_same_and_says_the_new_one(cli, command):
    for name in command.former:
        assert TYPER[name].hidden and TYPER[name].callback.__name__ == TYPER[command.name].callback.__name__
        assert f"The name is now: cablebench {command.name}" in " ".join(cli(name, "--help")[1].split())


def test_help_imports_neither_torch_nor_numba():
    code = (
        "import sys\nfrom cablebench.cli import main\ntry: main(['--help'])\nexcept SystemExit: pass\n"
        "print(sorted({'torch', 'numba', 'scipy', 'matplotlib'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=100, cwd=ROOT)
    assert done.stdout.splitlines()[-1] == "[]", done.stderr


def test_a_new_controller_runs_and_can_be_submitted(cli):
    assert cli("new", "controller", "my-pid")[:2] == (0, (
        "wrote my_pid.py\nnext:\n  cablebench run CableHole-Position-Sine --controller my_pid.py --trust\n"
        "  cablebench submit my_pid.py --check-only\n"
    ))  # fmt: skip
    code, out, err = cli("run", HOLE, "--controller", "my_pid.py", "--trust", "--sandbox", "none", "--json", *SHORT)
    assert code == 0, err
    assert json.loads(out)["entrant"] == "my-pid" and json.loads(out)["score"]["value"] > 0.0
    code, _, err = cli("submit", "my_pid.py", "--check-only", "--trust", "--env", HOLE)
    assert code == 0 and "my_pid.py can be submitted: my-pid, nominal" in err


def test_a_new_effect_acts(cli):
    code, out, _ = cli("new", "effect", "hard-stop", "--out", "mine")
    said = next(line for line in out.splitlines() if "cablebench run" in line)
    arguments = [*shlex.split(said)[1:], "--json", "--no-score", *SHORT]
    k = arguments.index("-o")
    plain = json.loads(cli(*arguments[:k], *arguments[k + 4 :])[1])["metrics"]["rmse"]
    code, out, err = cli(*arguments)
    assert code == 0, err
    assert json.loads(out)["metrics"]["rmse"] != plain


@pytest.mark.nojit
def test_a_new_plant_is_an_environment_of_the_checkout(cli, tmp_path):
    for package in ("cable_envs", "baselines", "configs"):
        shutil.copytree(ROOT / package, tmp_path / package, symlinks=True, ignore=shutil.ignore_patterns("__pycache__"))
    assert cli("new", "plant", "soft-cart", "--out", tmp_path)[0] == 0
    code = (
        "import gymnasium as gym, cable_envs\nenv = gym.make('cable_envs/SoftCart-Position-Sine-v0')\n"
        "env.reset(seed=1)\nfor _ in range(5): *_, info = env.step(env.action_space.high)\nprint(info['position'] > 0)"
    )
    environment = {**os.environ, "PYTHONPATH": str(tmp_path), "NUMBA_DISABLE_JIT": "1"}
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=100, cwd=tmp_path, env=environment
    )
    assert done.stdout == "True\n", done.stderr


def test_a_new_recording_is_inspected_and_diagnosed(cli):
    from cable_envs.diagnosis import diagnose

    assert cli("new", "recording", "cart")[0] == 0
    code, out, _ = cli("inspect", "cart", "--json")
    seen = json.loads(out)["recording"]
    assert code == 0 and [(r["name"], r["use"]) for r in seen["records"]] == [
        ("slow.csv", "fit"), ("fast.csv", "heldout"),
    ]  # fmt: skip
    assert [c["unit"] for c in seen["channels"]] == ["m", "N"] and "circuit" not in json.loads(out)
    assert "slow.csv  fit" in cli("inspect", "cart")[1]
    found = diagnose("cart", effects=["position_dependent_load"])
    (effect,) = found.effects
    spring = effect.parameters["stiffness"]
    error = (spring.high - spring.low) / 3.92
    # the noise of this one sample puts refits of it 1.6 to 2.0 standard errors below the truth
    assert found.verdict == "named" and abs(spring.value - 60.0) < 3.0 * error < 0.6


def test_the_examples_are_written_as_they_are(cli):
    code, out, _ = cli("new", "examples")
    assert code == 0 and "wrote examples/gym_loop.py\n" in out and "  python examples/gym_loop.py\n" in out
    listed = {p.relative_to(ROOT) for s in ("py", "ipynb") for p in (ROOT / "examples").rglob(f"*.{s}")}
    assert len(listed) > 10 and {p for p in Path("examples").rglob("*") if p.is_file()} == listed
    assert all(path.read_bytes() == (ROOT / path).read_bytes() for path in listed)
    code, _, err = cli("new", "controller")
    assert code == 2 and "give it a name: cablebench new controller NAME" in err


@pytest.mark.parametrize("kind", KINDS)
def test_nothing_is_replaced(cli, kind):
    assert cli("new", kind, "thing")[0] == 0
    before = {path: path.read_bytes() for path in Path().rglob("*") if path.is_file()}
    code, out, err = cli("new", kind, "thing")
    assert (code, out) == (2, "") and "is there already: choose another name" in err and err.count("\n") == 1
    assert {path: path.read_bytes() for path in Path().rglob("*") if path.is_file()} == before


def test_a_skeleton_is_written_whole_or_not_at_all(cli, tmp_path):
    (tmp_path / "configs").write_text("a file where a folder is needed")
    code, out, err = cli("new", "plant", "thing")
    assert (code, out) == (2, "") and err.startswith("cablebench: error: ") and err.count("\n") == 1
    assert [path.name for path in tmp_path.rglob("*") if path.is_file()] == ["configs"]


@pytest.mark.parametrize(
    ("words", "expected"), [(("contoller", "a"), "did you mean 'controller'?"), (("effect", "a/b"), "is no name")]
)
def test_what_cannot_be_begun_is_said(words, expected):
    with pytest.raises(ConfigurationError, match=expected.replace("?", r"\?")):
        skeleton(*words)


def test_run_prints_the_boards_units_and_the_boards_score(cli):
    code, out, _ = cli("run", HOLE, "--controller", "pid", "--seed", "3", *SHORT)
    rows = {line.rsplit(None, 2)[0].strip(): line.split()[-1] for line in out.splitlines()[1:] if line[:1] != "s"}
    assert code == 0 and rows["RMSE"] == "mm" and rows["peak tension"] == "N" and "score " in out
    for controller, value in (("open-loop", 0.0), ("oracle", 1.0)):
        done = json.loads(cli("run", HOLE, "--controller", controller, "--json", *SHORT)[1])
        assert done["score"]["value"] == value and done["units"]["rmse"] == "m"
    assert json.loads(cli("run", HOLE, "--controller", "pid", "--json", "--no-score", *SHORT)[1])["score"] is None


def test_compiling_is_said_once_and_where_it_is_kept(monkeypatch, caplog):
    from cable_envs.core.compiling import cache
    from cable_envs.core.kernels import jit

    monkeypatch.setattr(cache, "_said", [-1e9])
    step, other = (jit(lambda x, by=by: x + by) for by in (0.1234567, 0.7654321))
    monkeypatch.setattr(cache.KernelCache, "_file", lambda self, sig, codegen: Path("nowhere") / "none.bin")
    with caplog.at_level(logging.DEBUG, logger="cable_envs"):
        step(1.0), other(1.0)
    levels = [r.levelno for r in caplog.records if r.name == "cable_envs"]
    assert levels == [logging.INFO, logging.DEBUG]
    assert "compiling the equations of motion" in caplog.text and "only once on this machine" in caplog.text


def test_the_command_line_shows_remarks_unless_a_program_has_set_the_level(capsys):
    log = logging.getLogger("cable_envs")
    before = log.level
    try:
        for level, shown in ((logging.NOTSET, "it takes long\n"), (logging.ERROR, "")):
            log.setLevel(level)
            with remarks_shown():
                log.info("it takes long")
            assert capsys.readouterr().err == shown and log.level == level and not log.handlers
    finally:
        log.setLevel(before)
