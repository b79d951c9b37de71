"""The commands that are killed, each on a case of a second: how it starts, how it goes on, and what it comes to."""

import hashlib
import io
import json
import os
import shutil
import sys
import zipfile
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from cable_envs.core.files import jsonable, read_json
from cablebench.run.store import ResultStore
from tests.crashes.killing import command
from tests.support import drive_recording
from tests.support.board_records import a_record

HOLE, CIRCUIT = "CableHole-Position-Sine", "PulleyCircuit-Position-Sine"
Tell = Callable[[str], None]
Body = Callable[[Tell], None]

PROTOCOL = f"""
schema: 1
name: tiny
title: Two short tasks
tasks:
  - {{env: cable_envs/{HOLE}-v0, options: {{duration: 0.5}}}}
  - {{env: cable_envs/{CIRCUIT}-v0, options: {{duration: 0.5}}}}
tracks:
  nominal: {{options: {{sensor_noise: true}}}}
  randomised: {{options: {{sensor_noise: true, randomize: true}}}}
seeds: {{train: {{first: 0, count: 1000}}, tune: {{first: 1000, count: 1000}}, test: {{first: 2000, count: 1000}}}}
episodes: 4
training_seeds: 1
bootstrap: {{resamples: 50}}
score: {{paper: {{CableHole: mrac-g22, PulleyCircuit: feedforward-pid}}}}
"""
PPO = {"n_envs": 4, "n_timesteps": 512, "policy": "MlpPolicy", "n_steps": 16, "batch_size": 32, "n_epochs": 2,
       "env_options": {"sensor_noise": True, "duration": 1.0}}  # fmt: skip
SAC = {"n_envs": 4, "n_timesteps": 256, "policy": "MlpPolicy", "learning_starts": 32, "train_freq": 8, "batch_size": 32,
       "gradient_steps": 2, "buffer_size": 512, "env_options": {"sensor_noise": True, "duration": 1.0}}  # fmt: skip
MAPPING = {
    "schema": "cable-mapping/1", "system": "linear_drive",
    "channels": {"time": {"column": "t", "unit": "s"}, "position": {"column": "x", "unit": "m"},
                 "force": {"column": "f", "unit": "N"}},
    "records": [{"file": f"run_{k}.csv"} for k in (1, 2, 3)],
}  # fmt: skip
TOOL = (
    "import json, time; time.sleep(0.15); "
    "print(json.dumps({'schema': 'cable-diagnosis/1', 'verdict': 'no_detectable_mismatch', 'effects': []}))"
)
"""Stands for the diagnosis where the proof around it is what is killed."""

OTHERWISE = {"created", "machine", "inference", "seconds", "versions", "trajectory", "raw_inference", "command"}
"""Keys whose values depend on when and where something ran."""


@dataclass(frozen=True)
class Case:
    """One command: what it needs, its first call, the call after a kill, and the result, in JSON's types."""

    name: str
    share: int
    """of 200 kills"""
    first: Body
    again: Callable[[Path], Body]
    result: Callable[[Path], Any]
    prepare: Callable[[Path, Path], None] = lambda folder, stock: None
    kept: str = ""
    """A file whose bytes after a kill are a prefix of those at the end."""
    holds: Callable[[Path, str], bool] = lambda folder, line: True
    """Whether a line that was reported as saved is there."""


def same(value: Any) -> Any:
    """A result without what depends on time and machine; the rest as JSON has it."""
    if isinstance(value, dict):
        return {k: same(v) for k, v in value.items() if k not in OTHERWISE and "inference" not in k}
    return [same(v) for v in value] if isinstance(value, list) else value


def make_stock(folder: Path) -> None:
    """What the cases need and no command under test makes: protocol, settings, logs, a recording."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "tiny.yaml").write_text(PROTOCOL)
    for name, settings in (("ppo", PPO), ("sac", SAC)):
        (folder / f"{name}-tiny.yaml").write_text(yaml.safe_dump({"algorithm": name, "default": settings}))
    drive_recording.write(folder / "drive", load=lambda y, v, t: 1500.0 * y)
    (folder / "logs").mkdir()
    for k in (1, 2, 3):
        shutil.copy(folder / "drive" / f"run_{k}.csv", folder / "logs")
    (folder / "map.yaml").write_text(yaml.safe_dump(MAPPING))


def _with(*names: str) -> Callable[[Path, Path], None]:
    """Copies of files and folders of the stock."""

    def prepare(folder: Path, stock: Path) -> None:
        for name in names:
            if (stock / name).is_dir():
                shutil.copytree(stock / name, folder / name)
            else:
                shutil.copy(stock / name, folder / name)

    return prepare


# evaluation and boards


def _telling(body: Body) -> Body:
    """Reports every record when the store says that it is saved."""

    def told(tell: Tell) -> None:
        append = ResultStore.append

        def reporting(self: ResultStore, records: Any) -> None:
            records = [records] if isinstance(records, dict) else list(records)
            append(self, records)
            for r in records:
                tell(f"{r['run']} {r['seed']}")

        ResultStore.append = reporting
        body(tell)

    return told


def _holds(folder: Path, line: str) -> bool:
    run, seed = line.split()
    return any(r["run"] == run and r["seed"] == int(seed) for r in ResultStore(folder / "r/records.jsonl").records())


def _board(folder: Path) -> Any:
    """The board of the records that are there, and the names of the trajectories."""
    from cablebench.board.board import build_board
    from cablebench.protocol.files import load_protocol

    store = ResultStore(folder / "r" / "records.jsonl")
    reading = store.read()
    board = jsonable(asdict(build_board(load_protocol(str(folder / "tiny.yaml")), reading.records)))
    runs = {r["run"] for r in reading.records}
    drawn = {run: _sum(store.trajectories.of(run)) for run in sorted(runs)}
    return {"board": same(board), "drawn": drawn}


def _sum(trajectories: Any) -> str:
    total = hashlib.sha256()
    for kind, arrays in sorted(trajectories.items()):
        for name, values in sorted(arrays.items()):
            total.update(f"{kind} {name}".encode() + np.ascontiguousarray(values).tobytes())
    return total.hexdigest()


EVALUATE = ("evaluate", "--protocol", "tiny.yaml", "--results", "r", "--controller", "pid", "--controller",
            "open-loop", "--controller", "oracle")  # fmt: skip
BOARD = ("leaderboard", "--results", "r", "--protocol", "tiny.yaml")


def _pages(folder: Path) -> Any:
    text = (folder / "r" / "board.md").read_text() + (folder / "r" / "board.html").read_text()
    content = read_json(folder / "r" / "board.json")
    return {**_board(folder), "json": same(content), "pages": hashlib.sha256(text.encode()).hexdigest()}


def _beside_a_writer(tell: Tell) -> None:
    """Another process adds records to the store while this one packs it again and again; both may be killed."""
    from cablebench.cli import main

    if os.fork() == 0:
        store = ResultStore("r/records.jsonl")
        for seed in range(2000, 2030):
            store.append({**a_record(seed), "run": "beside"})
            tell(f"beside {seed}")
        os._exit(0)
    for _ in range(3):
        try:
            main([*BOARD, "--pack"])
        except SystemExit as end:
            if end.code:
                raise
    os.wait()


# training


def _often(body: Body) -> Body:
    """Checkpoints at every rollout, where the command writes one a minute."""

    def run(tell: Tell) -> None:
        import cablebench.cli.shared.training as training

        training.training_job.__kwdefaults__["checkpoint_every"] = 0.0
        body(tell)

    return run


def _train(algo: str) -> Body:
    return _often(command("train", "--env", HOLE, "--algo", f"{algo}-tiny.yaml", "--seed", "3", "--out", "p"))


def _train_on(algo: str, folder: Path) -> Body:
    """The same command; with --resume where something was saved, and nothing more to do where it is complete."""
    words = ["train", "--env", HOLE, "--algo", f"{algo}-tiny.yaml", "--seed", "3", "--out", "p"]
    found = [name for name in ("policy.zip", "checkpoint.pt") if (folder / "p" / name).exists()]
    if "policy.zip" in found and _metadata(folder / "p" / "policy.zip")["complete"]:
        return command("run", HOLE, "--policy", "p", "--option", "duration=0.1")
    return _often(command(*words, *(["--resume"] if found else [])))


def _metadata(file: Path) -> Any:
    with zipfile.ZipFile(file) as archive:
        name = next(n for n in archive.namelist() if n.endswith(".json") and "cable" in n)
        return json.loads(archive.read(name))


def _weights(folder: Path) -> Any:
    """Every number of the network, and what is known of the training."""
    import torch

    file = folder / "p" / "policy.zip"
    with zipfile.ZipFile(file) as archive:
        weights = torch.load(io.BytesIO(archive.read("policy.pth")), weights_only=True)
    total = {k: hashlib.sha256(v.numpy().tobytes()).hexdigest() for k, v in weights.items()}
    about = _metadata(file)
    about["curve"] = [[steps, reward] for steps, _, reward in about["curve"]]
    return {"weights": total, "about": same(about)}


# tuning, diagnosis, proof, data

TUNE = ("tune", "--env", HOLE, "--controller", "pid", "--trials", "5", "--batch", "2", "--episodes", "1", "--protocol",
        "tiny.yaml", "--study", "s/study.db", "--out", "tuned.yaml")  # fmt: skip
DIAGNOSE = ("diagnose", "drive", "--out", "d", "--effects", "position_dependent_load,actuator_lag")
PROOF = ("proof", "--quick", "--first", "3", "--system", "linear_drive", "--kind", "nothing", "--no-baselines", "--out",
         "proof")  # fmt: skip
IMPORT = ("import", "table", "logs", "--mapping", "map.yaml", "--out", "o")
EXPORT = ("export", HOLE, "--controller", "pid", "--episodes", "3", "--option", "sensor_noise=true", "--option",
          "duration=0.5", "--out", "e")  # fmt: skip


def _proof(tell: Tell) -> None:
    import cablebench.cli.physics.blind_test as module
    from cablebench.cli import main

    module._tool_command = lambda _: [sys.executable, "-S", "-c", TOOL]  # type: ignore[assignment]
    try:
        main(list(PROOF))
    except SystemExit as end:
        if end.code not in (0, 1, None):  # 1: a rule of the proof is broken, as it must be with such a tool
            raise


def _publish(folder: Path, stock: Path) -> None:
    shutil.copytree(stock / "trained", folder / "trained")


def _files(*places: str) -> Callable[[Path], Any]:
    """Every file below some places, by content."""

    def result(folder: Path) -> Any:
        found = {}
        for place in places:
            root = folder / place
            for path in sorted([root] if root.is_file() else root.rglob("*")):
                if path.is_file() and not path.name.endswith(".lock"):
                    found[str(path.relative_to(folder))] = hashlib.sha256(path.read_bytes()).hexdigest()
        return found

    return result


def _diagnosed(folder: Path) -> Any:
    return {
        "verdict": same(json.loads((folder / "d" / "diagnosis.json").read_text())),
        "page": (folder / "d" / "report.html").is_file(),
        **_files("d/augmented.yaml")(folder),
    }


def _proved(folder: Path) -> Any:
    record = read_json(folder / "proof" / "proof.json.xz")
    recordings = _files("proof/recordings")(folder)
    for case in record["methods"].values():
        for line in case["cases"]:
            line.pop("key", None) if isinstance(line, dict) else None
    return {"record": same(record), **recordings, "page": (folder / "proof" / "proof.html").is_file()}


def _minari(folder: Path) -> Any:
    """What the dataset's episodes hold."""
    import h5py

    found: dict[str, Any] = {}
    for file in sorted((folder / "e").rglob("*.hdf5")):
        with h5py.File(file) as data:
            data.visititems(
                lambda name, item: found.update(
                    {name: hashlib.sha256(np.asarray(item[()]).tobytes()).hexdigest()}
                    if isinstance(item, h5py.Dataset) and item.dtype.kind in "fiub" else {}
                )
            )  # fmt: skip
    return {"numbers": found, "files": sorted(str(p.relative_to(folder)) for p in (folder / "e").rglob("*"))}


def _done_or(words: tuple[str, ...], done: str, folder: Path) -> Body:
    """The same command; where its last file is there, it removes what else was left, and refuses to overwrite."""
    again = command(*words)
    if not (folder / done).exists():
        return again

    def body(tell: Tell) -> None:
        try:
            again(tell)
        except SystemExit as end:
            if end.code != 2:
                raise

    return body


def _same(words: tuple[str, ...], folder: Path) -> Body:
    return command(*words)


CASES = (
    Case("train ppo", 30, _train("ppo"), partial(_train_on, "ppo"), _weights, _with("ppo-tiny.yaml")),
    Case("train sac", 14, _train("sac"), partial(_train_on, "sac"), _weights, _with("sac-tiny.yaml")),
    Case("evaluate", 30, _telling(command(*EVALUATE)), lambda _: _telling(command(*EVALUATE, "--resume")), _board,
         _with("tiny.yaml"), "r/records.jsonl", _holds),
    Case("evaluate --jobs 2", 14, _telling(command(*EVALUATE, "--jobs", "2")),
         lambda _: _telling(command(*EVALUATE, "--resume", "--jobs", "2")), _board, _with("tiny.yaml"),
         "r/records.jsonl", _holds),
    Case("leaderboard", 14, command(*BOARD), lambda _: command(*BOARD), _pages, _with("tiny.yaml", "r")),
    Case("leaderboard --pack", 14, command(*BOARD, "--pack"), lambda _: command(*BOARD, "--pack"), _pages,
         _with("tiny.yaml", "r")),
    Case("--pack beside a writer", 12, _beside_a_writer, lambda _: command(*BOARD, "--pack"),
         lambda folder: _board(folder)["board"]["tables"], _with("tiny.yaml", "r"), holds=_holds),
    Case("tune", 18, command(*TUNE), partial(_same, TUNE), _files("tuned.yaml"), _with("tiny.yaml")),
    Case("diagnose", 12, command(*DIAGNOSE), partial(_same, DIAGNOSE), _diagnosed, _with("drive")),
    Case("proof", 14, _proof, lambda _: _proof, _proved),
    Case("import", 10, command(*IMPORT), partial(_done_or, IMPORT, "o/recording.yaml"), _files("o"),
         _with("logs", "map.yaml")),
    Case("export recording", 8, command(*EXPORT, "--format", "recording"),
         partial(_done_or, (*EXPORT, "--format", "recording"), "e/recording.yaml"), _files("e")),
    Case("export minari", 4, command(*EXPORT, "--format", "minari"),
         partial(_done_or, (*EXPORT, "--format", "minari"), f"e/cable/{HOLE}/pid-v0"), _minari),
    Case("publish", 6, command("publish", "trained", "--out", "z"),
         lambda _: command("publish", "trained", "--out", "z", "--overwrite"), _files("z"), _publish),
)  # fmt: skip
