"""The command line: what it prints where, exit codes, files, and errors of one line."""

import csv
import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import cable_envs
from cable_envs.baselines import CONTROLLERS
from cable_envs.plants import families
from cablebench.entrants.entrant import controller_entrant
from cablebench.protocol.metrics import METRICS

HOLE, CIRCUIT = "CableHole-Position-Sine", "PulleyCircuit-Position-Sine"
QUICK = ("--option", "duration=0.5")


@pytest.fixture
def protocol(tmp_path):
    """Two short tasks, two episodes each."""
    path = tmp_path / "tiny.yaml"
    path.write_text(
        "schema: 1\nname: tiny\ntitle: Two short tasks\ntasks:\n"
        f"  - {{env: cable_envs/{HOLE}-v0, options: {{duration: 0.5}}}}\n"
        f"  - {{env: cable_envs/{CIRCUIT}-v0, options: {{duration: 0.5}}}}\n"
        "tracks:\n  nominal: {options: {sensor_noise: true}}\n"
        "seeds: {train: {first: 0, count: 1000}, tune: {first: 1000, count: 1000}, test: {first: 2000, count: 1000}}\n"
        "episodes: 2\ntraining_seeds: 1\nbootstrap: {resamples: 50}\n"
        "score: {paper: {CableHole: mrac-g22, PulleyCircuit: feedforward-pid}}\n"
    )
    return path


def test_version_and_help(cli):
    assert cli("--version") == (0, f"cablebench {cable_envs.__version__}\n", "")
    code, out, _ = cli("--help")
    assert code == 0
    for command in ("envs", "run", "train", "tune", "evaluate", "leaderboard", "demo"):
        assert cli(command, "--help")[0] == 0 and command in out


def test_envs_lists_everything_with_units(cli):
    code, out, err = cli("envs")
    assert (code, err) == (0, "")
    for env_id in cable_envs.FIRST_IDS + cable_envs.SUITE_IDS:
        assert env_id.split("/")[1].rpartition("-")[0] in out
    assert "zou-table2" in out
    code, out, _ = cli("envs", CIRCUIT)
    assert code == 0
    assert "output     output_angle [rad]" in out and "-3..3 rad (position) default" in out
    assert "drive_torque" in out and "gu-inferred" not in out


def test_ids_are_whole_on_a_narrow_terminal(cli, monkeypatch):
    monkeypatch.setenv("COLUMNS", "60")
    _, out, _ = cli("envs")
    assert all(env_id.split("/")[1].rpartition("-")[0] in out for env_id in cable_envs.FIRST_IDS)


def test_envs_json_agrees_with_the_environment(cli):
    import gymnasium as gym

    code, out, err = cli("envs", "--json")
    assert (code, err) == (0, "")
    data = json.loads(out)
    assert [e["id"] for e in data["environments"]] == [*cable_envs.FIRST_IDS, *cable_envs.SUITE_IDS]
    for e in data["environments"]:
        env = gym.make(e["id"]).unwrapped
        declared = [{"name": c.name, "unit": c.unit, "scale": c.scale} for c in env.channels]
        assert e["channels"][e["observe"]] == declared
        mode = next(m for m in e["action_modes"] if m["name"] == e["action_mode"])
        assert (mode["low"], mode["high"]) == (env.setup.low, env.setup.high)
    assert {r["plant"] for r in data["rigs"]} == {one.name for one in families().values() if one.tasks}


def test_run_prints_metrics_and_saves_the_episode(cli, tmp_path):
    files = [tmp_path / "a.csv", tmp_path / "sub" / "a.npz"]
    code, out, err = cli("run", HOLE, "--controller", "pid", "--save", files[0], *QUICK)
    assert (code, err) == (0, "")
    assert "50 steps, ran to its end" in out and "RMSE" in out and f"wrote {files[0]}" in out
    arguments = ("run", HOLE, "--controller", "pid", "--seed", 3, "--save", files[1], "--json", *QUICK)
    code, out, err = cli(*arguments, "--option", "sensor_noise=true", "--gain", "kp=2000")
    assert (code, err) == (0, "")
    result = json.loads(out)
    assert result["env_id"] == f"cable_envs/{HOLE}-v0" and result["files"] == [str(files[1])]
    assert set(result["metrics"]) == set(result["units"]) == {m.name for m in METRICS}
    with np.load(files[1]) as data:
        about = json.loads(str(data["about"]))
        error = data["reference"] - data["output"]
        assert result["metrics"]["rmse"] == float(np.sqrt(np.mean(error**2)))
        assert about["seed"] == 3 and about["units"]["load_tension"] == "N"
        assert about["options"]["sensor_noise"] is True
    with open(files[0], newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 50
    assert float(rows[-1]["time [s]"]) == 0.5 and "drive_tension [N]" in rows[0]


def test_same_seed_same_episode(cli):
    arguments = ("run", CIRCUIT, "--controller", "pid", "--json", *QUICK, "-o", "sensor_noise=true", "--seed")
    runs = [json.loads(cli(*arguments, seed)[1])["metrics"]["rmse"] for seed in (1, 1, 2)]
    assert runs[0] == runs[1] != runs[2]


@pytest.mark.parametrize(("suffix", "magic"), [(".png", b"\x89PNG"), (".gif", b"GIF89a")])
def test_run_renders(cli, tmp_path, suffix, magic):
    picture = tmp_path / f"picture{suffix}"
    code, out, _ = cli("run", HOLE, "--controller", "open-loop", "--render", picture, *QUICK)
    assert code == 0 and f"wrote {picture}" in out
    assert picture.read_bytes().startswith(magic)


def test_a_film_as_mp4_lasts_as_long_as_the_episode(cli, tmp_path):
    ffmpeg = pytest.importorskip("imageio_ffmpeg")
    film = tmp_path / "film.mp4"
    code, out, _ = cli("run", HOLE, "--controller", "pid", "--render", film, "--no-score", "-o", "duration=2")
    assert code == 0 and f"wrote {film}" in out
    frames, seconds = ffmpeg.count_frames_and_secs(str(film))
    assert frames == 51 and abs(seconds - 2.0) < 0.1  # 25 a second, and the last picture


def test_a_picture_may_be_dark(cli, tmp_path):
    image = pytest.importorskip("PIL.Image")
    shown = {}
    for theme in ("light", "dark"):
        code, _, _ = cli(
            "run", HOLE, "--controller", "pid", "--render", tmp_path / f"{theme}.png", "--theme", theme, *QUICK
        )
        assert code == 0
        shown[theme] = image.open(tmp_path / f"{theme}.png").convert("RGB").getpixel((0, 0))
    assert shown == {"light": (255, 255, 255), "dark": (20, 20, 20)}


BAD = {
    "theme": (("run", HOLE, "--controller", "pid", "--render", "a.png", "--theme", "drak"), "did you mean 'dark'?"),
    "environment": (
        ("run", "CableHole-Postion-Sine", "--controller", "pid"),
        "did you mean 'CableHole-Position-Sine'?",
    ),
    "controller": (("run", HOLE, "--controller", "mrac-g23"), "did you mean 'mrac-g22'?"),
    "not for this plant": (
        ("run", HOLE, "--controller", "feedforward-pid"),
        "does not apply to CableHole-Position-Sine: it enters AntagonistJoint-",
    ),
    "gain": (("run", HOLE, "--controller", "pid", "--gain", "kpp=1"), "did you mean 'kp'?"),
    "gain's value": (("run", HOLE, "--controller", "pid", "--gain", "kp=much"), "--gain kp: expected a number"),
    "gain out of bounds": (("run", HOLE, "--controller", "pid", "--gain", "kp=-1"), "kp"),
    "option": (("run", HOLE, "--controller", "pid", "-o", "obsrve=full"), "did you mean 'observe'?"),
    "option's form": (
        ("run", HOLE, "--controller", "pid", "-o", "observe"),
        "--option expects KEY=VALUE, got 'observe'",
    ),
    "rig": (("run", HOLE, "--controller", "pid", "-o", "rig=gu-infered"), "did you mean 'gu-inferred"),
    "rig's value": (("run", HOLE, "--controller", "pid", "-o", "rig={load_mass: -1}"), "load_mass"),
    "needs": (("run", HOLE, "--controller", "pid", "-o", "observe=drive"), "needs observe=output, not drive"),
    "nobody": (("run", HOLE), "name either --controller or --policy"),
    "both": (("run", HOLE, "--controller", "pid", "--policy", "x"), "name either --controller or --policy"),
    "policy": (("run", HOLE, "--policy", "nowhere"), "no policy at nowhere"),
    "format": (("run", HOLE, "--controller", "pid", "--save", "a.xls"), "--save a.xls: unknown format '.xls'"),
    "algorithm": (("train", "--env", HOLE, "--algo", "pppo"), "did you mean 'ppo'?"),
    "protocol": (("evaluate", "--protocol", "quik"), "did you mean 'quick'?"),
    "track": (("evaluate", "--protocol", "quick", "--track", "nominl"), "did you mean 'nominal'?"),
    "gain for many": (("evaluate", "--gain", "kp=1"), "--gain needs exactly one --controller"),
    "resume": (("evaluate", "--resume"), "--resume needs --results"),
    "results": (("leaderboard", "--results", "nowhere"), "no records in nowhere"),
    "demo's protocol": (("demo", "--protocol", "nothing"), "unknown protocol 'nothing'"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_input_is_one_line_and_exit_code_2(cli, name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    arguments, expected = BAD[name]
    code, out, err = cli(*arguments)
    assert (code, out) == (2, "")
    assert err.startswith("cablebench: error: ") and err.count("\n") == 1
    assert expected in err
    assert list(tmp_path.iterdir()) == []


def test_unknown_command_is_named(cli):
    code, out, err = cli("envz")
    assert (code, out) == (2, "") and "Did you mean 'envs'" in err


def test_file_that_cannot_be_written_is_an_error(cli, tmp_path):
    (tmp_path / "file").write_text("not a folder")
    code, _, err = cli("run", HOLE, "--controller", "pid", "--save", tmp_path / "file" / "a.csv", *QUICK)
    assert code == 2 and err.startswith("cablebench: error: cannot write") and err.count("\n") == 1


def test_without_names_the_references_of_the_chosen_task_are_evaluated(cli, protocol):
    """A circuit's controller is no error where a hole was asked for."""
    code, out, _ = cli("evaluate", "--protocol", protocol, "--env", HOLE, "--json")
    assert code == 0
    run = [r["entrant"] for r in json.loads(out)]
    assert {"open-loop", "pid", "mrac-g22", "lqg", "oracle"} < set(run) and "feedforward-pid" not in run
    assert all(run.count(name) == 2 for name in run)  # two episodes each


def test_train_run_evaluate_leaderboard(cli, tmp_path, protocol):
    """The whole way of an agent: trained, run, evaluated beside the references, ranked."""
    folder, results = tmp_path / "agent", tmp_path / "results"
    train = ("train", "--env", HOLE, "--steps", 8192, "--seed", 1, "--out", folder)
    code, out, _ = cli(*train, *QUICK, "--json")
    trained = json.loads(out)
    assert code == 0 and (trained["steps"], trained["seed"], trained["complete"]) == (8192, 1, True)
    code, _, err = cli(*train, *QUICK)
    assert code == 2 and "exists: choose another folder" in err
    code, out, _ = cli("run", HOLE, "--policy", folder, *QUICK, "--json")
    assert code == 0 and json.loads(out)["entrant"] == "ppo"
    # references on both tasks, the agent on its own
    code, out, _ = cli("evaluate", "--protocol", protocol, "--results", results)
    assert code == 0 and int(re.search(r"(\d+) records added", out)[1]) > 20
    code, out, _ = cli("evaluate", "--protocol", protocol, "--results", results, "--policy", folder, "--json")
    records = json.loads(out)
    assert code == 0 and [r["entrant"] for r in records] == ["ppo", "ppo"]
    assert records[0]["charged"]["environment_steps"] == 8192 and records[0]["training_seed"] == 1
    # a row's own command gives the same episodes again
    words = records[0]["replay"].split()
    assert words[:2] == ["cablebench", "evaluate"]
    words[words.index("--protocol") + 1] = str(protocol)
    again = json.loads(cli(*words[1:], "--json")[1])
    assert [r["metrics"]["rmse"] for r in again] == [r["metrics"]["rmse"] for r in records]
    code, out, err = cli("leaderboard", "--results", results, "--protocol", protocol)
    assert code == 0 and "mrac-g22" in out and "ppo" in out
    assert sorted(p.name for p in results.iterdir() if p.name.startswith("board")) == [
        "board.html", "board.json", "board.md",
    ]  # fmt: skip
    code, out, _ = cli("leaderboard", "--results", results, "--protocol", protocol, "--json", "--out", tmp_path / "b")
    assert code == 0 and json.loads(out) == json.loads((tmp_path / "b" / "board.json").read_text())


def test_demo_writes_the_board(tmp_path, protocol):
    """The main job on a tiny protocol, as a process of its own: references and two trained agents, ranked."""
    out = tmp_path / "out"
    command = [sys.executable, "-m", "cablebench.cli", "demo", "--protocol", protocol, "--out", out, "--steps", "8192"]
    done = subprocess.run([*map(str, command), "--json"], capture_output=True, text=True, timeout=400)
    assert done.returncode == 0, done.stderr
    board = json.loads(done.stdout)
    assert "done in" in done.stderr
    tables = {t["task"]: {row["entrant"]: row for row in t["rows"]} for t in board["tables"]}
    assert set(tables) == {HOLE, CIRCUIT}
    enters = [n for n in CONTROLLERS if any(controller_entrant(n).enters(f"cable_envs/{i}-v0", {}) for i in tables)]
    assert set(tables[HOLE]) | set(tables[CIRCUIT]) == {*enters, "ppo"} and "sheath-drive-side" not in enters
    for rows in tables.values():
        assert rows["ppo"]["charged"]["environment_steps"] == 8192
        assert rows["open-loop"]["score"]["value"] == 0.0 and rows["oracle"]["score"]["value"] == 1.0
    assert f"tasks/{HOLE}.html" in (out / "board.html").read_text()
    page = (out / "tasks" / f"{HOLE}.html").read_text()
    assert "<svg" in page and "adaptive-inverse" in page
    assert (out / "board.md").read_text().startswith("# Two short tasks")
    assert {p.parent.name for p in (out / "agents").rglob("policy.zip")} == {f"ppo-{HOLE}-0", f"ppo-{CIRCUIT}-0"}


def test_help_loads_what_it_shows_and_nothing_more():
    """Beyond what every command needs it loads what draws a help page: no torch, SciPy, Numba, learner or plant."""
    code = (
        "import sys\nfrom cablebench.cli import main\ntry: main(['--help'])\nexcept SystemExit: pass\n"
        "import json; print('\\n' + json.dumps(sorted(sys.modules)))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=100, cwd=Path(__file__).parents[2]
    )
    loaded = json.loads(done.stdout.splitlines()[-1])
    drawing = {"attr", "colorsys", "markdown_it", "mdurl", "pygments", "rich"}
    known = {*sys.stdlib_module_names, *drawing, "__main__", "cable_envs", "cablebench", "cloudpickle"}
    needed = subprocess.run(
        [sys.executable, "-c", "import gymnasium.envs.registration, typer, yaml, sys; print(*sys.modules)"],
        capture_output=True, text=True, timeout=100,
    ).stdout.split()  # fmt: skip
    known |= {m.split(".")[0] for m in needed}
    assert {m.split(".")[0] for m in loaded} <= known
    assert not [m for m in loaded if m.startswith(("cable_envs.plants", "cable_envs.sim", "cable_envs.physics"))]


def test_run_says_what_is_beyond_the_range_of_the_rig_and_takes_the_newer_ids(cli):
    code, out, _ = cli(
        "run", "CableHole-Position-Sine-v1", "--controller", "pid", "--no-score", "-o", "duration=1.0",
        "-o", "reference={kind: sine, amplitude: 0.03, frequency: 1.0}",
    )  # fmt: skip
    assert code == 0 and "CableHole-Position-Sine-v1" in out
    assert re.search(r"^\d+ % of it is outside the range that the rig's parameters", out, re.MULTILINE)
    at_rest = cli("run", "CableHole-Position-Step", "--controller", "open-loop", "--no-score")
    assert "outside the range" not in at_rest[1]
    code, _, err = cli("train", "--env", "CableHole-Position-Sine-v1", "--algo", "ppo")
    assert code == 2 and "write CableHole-Position-Sine" in err
