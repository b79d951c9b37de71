"""Wrong names, files, formats, ranges and missing arguments: exit code 2, nothing done, and an error that helps."""

import re
import subprocess
import sys

import pytest

HOLE = "CableHole-Position-Sine"
FILES = {
    "notes.txt": b"hello\n",
    "empty.csv": b"",
    "numbers.csv": b"t,a\n0,1\n1,2\n",
    "broken.yaml": b"a: [1,\n",
    "odd.yaml": b"colour: red\n",
    "mine.py": b"x = 1\n",
    "net.onnx": b"no network",
    "policy.zip": b"no zip",
}

RUN, TRAIN, TUNE = ("run", HOLE), ("train", "--env", HOLE), ("tune", "--env", HOLE)
PID = (*RUN, "--controller", "pid")
REPLAY = ("replay", "--board", "quick", "--env", HOLE)

CASES = [
    # what is typed, what the error says (a regular expression)
    (("runn",), "Did you mean 'run'"),
    (("run",), "Missing argument 'env'"),
    (("run", "CableHole-Position-Sin"), f"did you mean '{HOLE}'"),
    ((*RUN, "--controller", "pidd"), "did you mean 'pid'"),
    ((*RUN, "--controller", "nosuch.py"), "cannot read nosuch.py"),
    ((*RUN, "--controller", "notes.txt"), "unknown controller 'notes.txt'.*Valid: "),
    ((*RUN, "--policy", "nosuch.zip"), "no policy at nosuch.zip; `cablebench train` writes"),
    ((*RUN, "--policy", "policy.zip"), "no whole zip file"),
    (RUN, "name either --controller or --policy"),
    ((*PID, "--gain", "kpp=1"), "did you mean 'kp'|unknown gain.*Valid: "),
    ((*PID, "--option", "duraton=1"), "did you mean 'duration'"),
    ((*PID, "--option", "duration"), "expects KEY=VALUE"),
    ((*PID, "--option", "duration=-1"), "duration.*-1"),
    ((*PID, "--option", "duration=abc"), "duration.*abc"),
    ((*PID, "--option", "control_period=0"), "control_period"),
    ((*PID, "--option", "rig=zou-tabel2"), "did you mean 'zou-table2'"),
    ((*PID, "--option", "rig.load_mass=4"), "-o 'rig={load_mass: 4}'"),
    ((*PID, "--seed", "-1"), "greater than or equal to 0"),
    ((*PID, "--seed", "x"), "valid integer"),
    ((*PID, "--render", "film.avi"), "Valid: .gif, .mp4, .png"),
    (("envs", "CableHole-Position-Sin"), f"did you mean '{HOLE}'"),
    (("export", HOLE), "Missing option '--out'"),
    (("export", HOLE, "--out", "x", "--episodes", "0"), "greater than or equal to 1"),
    (("export", HOLE, "--out", "x", "--format", "minary"), "minari"),
    (("new", "controler", "mine"), "controller"),
    (("new", "controller"), "give it a name: cablebench new controller NAME"),
    ((*TUNE, "--controller", "pidd", "--trials", "2"), "did you mean 'pid'"),
    ((*TUNE, "--controller", "pid", "--trials", "0"), "greater than or equal to 1"),
    ((*TRAIN, "--algo", "dqn"), "unknown algorithm 'dqn'.*Valid: "),
    ((*TRAIN, "--algo", "nosuch.yaml"), "no settings file nosuch.yaml"),
    ((*TRAIN, "--steps", "-5"), "greater than or equal to 1"),
    (("publish", "nosuch.zip", "--out", "x"), "no policy at nosuch.zip"),
    (("evaluate", "--protocol", "qick"), "did you mean 'quick'"),
    (("evaluate", "--protocol", "odd.yaml"), "unknown key in odd.yaml 'colour'"),
    (("evaluate", "--protocol", "broken.yaml"), "broken.yaml is not valid YAML: .*line 2"),
    (("evaluate", "--protocol", "quick", "--track", "stres"), "did you mean 'stress'"),
    (("evaluate", "--jobs", "0"), "greater than or equal to 1"),
    (("evaluate", "--backend", "slurm"), "Valid: local, ray"),
    (("submit", "nosuch.py"), "no file at nosuch.py"),
    (("submit", "mine.py"), "will be executed .*--trust"),
    (("submit", "net.onnx"), "net.onnx is no ONNX file"),
    (("submit", "mine.py", "--board", "qick"), "did you mean 'quick'"),
    (("submit", "mine.py", "--trust", "--sandbox", "docker"), "docker.*(Valid|one of)"),
    (("leaderboard", "--board", "qick"), "did you mean 'quick'"),
    (("leaderboard", "--results", "nowhere"), "no records in nowhere.*run `cablebench evaluate"),
    ((*REPLAY, "--track", "nominal", "--entrant", "pppo"), "did you mean 'ppo'"),
    ((*REPLAY, "--track", "nominl", "--entrant", "ppo"), "did you mean 'nominal'"),
    (("import", "davinchi", "notes.txt", "--out", "x"), "did you mean 'da-vinci-jaw'"),
    (("import", "davinci"), "Missing argument 'path'"),
    (("inspect", "nowhere.yaml"), "cannot read 'nowhere.yaml'"),
    (("inspect", "numbers.csv"), "numbers.csv: expected a mapping"),
    (("inspect", "empty.csv"), "empty.csv: expected a mapping"),
    (("inspect", "broken.yaml"), "not valid YAML"),
    (("diagnose", "odd.yaml"), "unknown key in odd.yaml 'colour'.*Valid: channels"),
    (("diagnose",), "Missing argument 'recording'"),
    (("identify", "nowhere.yaml"), "cannot read 'nowhere.yaml'"),
    (("identify", "odd.yaml", "--method", "anealing"), "'pso', 'lsq', 'cma'"),
    (("reproduce", "zou-tabel3", "--out", "x"), "did you mean|Valid: "),
    (("reproduce", "--jobs", "-1", "--out", "x"), "greater than or equal to 0"),
    (("blind-test", "--jobs", "0"), "greater than or equal to 1"),
    (("seal", "--protocol", "nowhere.yaml", "--out", "x"), "unknown protocol 'nowhere'"),
]


@pytest.mark.parametrize(("typed", "said"), CASES, ids=lambda v: " ".join(v) if isinstance(v, tuple) else "")
def test_it_is_refused_by_name_and_nothing_is_written(cli, tmp_path, monkeypatch, typed, said):
    for name, content in FILES.items():
        (tmp_path / name).write_bytes(content)
    monkeypatch.chdir(tmp_path)
    code, out, err = cli(*typed)
    flat = " ".join(re.sub("[│╭╮╰╯─]", " ", err).split())  # typer's errors stand in a frame
    assert code == 2 and out == "" and "Traceback" not in err
    assert re.search(said, flat), flat
    assert len(flat) < 900 and flat.count("rror") <= 2
    assert {p.name for p in tmp_path.iterdir()} == set(FILES)


@pytest.mark.parametrize(
    "typed", [(*RUN, "--policy", "nosuch.zip"), (*TRAIN, "--algo", "dqn")], ids=lambda v: " ".join(v)
)
def test_a_wrong_name_is_said_before_torch_is_imported(tmp_path, typed):
    code = (
        "import sys\nfrom cablebench.cli import main\n"
        "try:\n    main(sys.argv[1:])\nfinally:\n    print('torch' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code, *typed], cwd=tmp_path, capture_output=True, text=True)
    assert done.stdout == "False\n", done.stderr
