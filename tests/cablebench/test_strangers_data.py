"""Data from strangers decide nothing that a protocol decides, and never lead to code being run."""

import zipfile

import pytest
import yaml

from cable_envs.agents.settings import load_settings
from cable_envs.core.errors import ConfigurationError
from cablebench.cli import main
from cablebench.entrants.entrant import Entrant
from cablebench.entrants.policy_files import load_policy_file
from cablebench.protocol.files import load_protocol
from cablebench.protocol.protocol import Protocol, SeedRange, Task, Track
from cablebench.run.evaluation import make_plan

HOLE = "cable_envs/CableHole-Position-Sine-v0"
TRAP = "open({mark!r}, 'w').close()\nEFFECT = None\n"
POLICY = {
    "schema": "cable-policy-file/1", "name": "theirs", "policy": "theirs.zip", "env": "CableHole-Position-Sine",
    "algo": "ppo", "charged": {"environment_steps": 1}, "policy_kwargs": {"net_arch": [8]},
}  # fmt: skip
PROTOCOL = {
    "schema": 1, "name": "theirs", "tasks": [{"env": HOLE, "options": {"duration": 0.5}}],
    "tracks": {"nominal": {"options": {"sensor_noise": True}}}, "episodes": 1,
    "seeds": {kind: {"first": 100 * k, "count": 100} for k, kind in enumerate(("train", "tune", "test"))},
}  # fmt: skip
PROTOCOLS_OWN = {
    "duration": 0.02, "rig": "gu-steel-1mm", "randomize": False, "sensor_noise": False, "sensor_delay": 0,
    "action_delay": 0, "control_period": 0.02, "substeps": 1, "effects": {}, "effect_file": "trap.py",
    "reference": {"kind": "constant"}, "disturbance": {"kind": "constant"}, "posture": {"kind": "constant"},
    "plant": "analytic",
}  # fmt: skip


@pytest.fixture
def trap(tmp_path):
    """(a Python file, the file that it makes when it is run)."""
    mark = tmp_path / "sprung"
    (tmp_path / "trap.py").write_text(TRAP.format(mark=str(mark)))
    return tmp_path / "trap.py", mark


def written(path, data):
    path.write_text(yaml.safe_dump(data))
    return path


def policy_yaml(folder, options):
    with zipfile.ZipFile(folder / "theirs.zip", "w") as archive:
        archive.writestr("policy.pth", b"")
    return written(folder / "theirs.yaml", {**POLICY, "options": options})


@pytest.mark.parametrize("option", PROTOCOLS_OWN)
def test_a_policy_cannot_set_what_the_protocol_sets(tmp_path, option):
    path = policy_yaml(tmp_path, {option: PROTOCOLS_OWN[option]})
    with pytest.raises(ConfigurationError, match=rf"theirs\.yaml.*'{option}' is the protocol's.*action_mode, observe"):
        load_policy_file(path)


def test_a_policy_may_say_what_it_observes_and_commands(tmp_path):
    options = {"observe": "output", "action_mode": "tension"}
    assert load_policy_file(policy_yaml(tmp_path, options)).options == options
    with pytest.raises(ConfigurationError, match="did you mean 'observe'"):
        load_policy_file(policy_yaml(tmp_path, {"obsreve": "output"}))


def planned(needs, task_options=None):
    protocol = Protocol(
        "p", "p", (Task(HOLE, task_options or {}),), (Track("nominal"),),
        *(SeedRange(10 * k, 10) for k in range(3)), episodes=1,
    )  # fmt: skip
    entrant = Entrant("theirs", "model-free", lambda setup: None, lambda env, setup: needs, "--policy theirs.zip")
    return make_plan(protocol, [entrant], (), ())


@pytest.mark.parametrize("option", PROTOCOLS_OWN)
def test_no_entrant_gets_past_the_protocol_by_another_way(option):
    with pytest.raises(ConfigurationError, match=rf"theirs.*'{option}' is the protocol's"):
        planned({option: PROTOCOLS_OWN[option]})


def test_what_the_protocol_pins_an_entrant_cannot_unpin():
    assert planned({"observe": "output"}, {"observe": "output"})[0][2] == {"observe": "output"}
    with pytest.raises(ConfigurationError, match=r"theirs.*observe=full.*protocol sets observe=drive"):
        planned({"observe": "full"}, {"observe": "drive"})


@pytest.mark.parametrize("place", ["task", "track", "sweep"])
def test_a_protocol_file_runs_no_code(tmp_path, trap, place):
    data = yaml.safe_load(yaml.safe_dump(PROTOCOL))
    if place == "task":
        data["tasks"][0]["options"]["effect_file"] = str(trap[0])
    elif place == "track":
        data["tracks"]["nominal"]["options"]["effect_file"] = str(trap[0])
    else:
        data["tracks"]["nominal"]["sweeps"] = {"s": {"from": 0, "to": 1, "option": "effect_file"}}
    path = written(tmp_path / "theirs-protocol.yaml", data)
    with pytest.raises(ConfigurationError, match=r"theirs-protocol\.yaml.*'effect_file' runs a Python file"):
        load_protocol(path)
    data["tasks"] = [{"env": HOLE, "options": {"durations": 1.0}}]
    with pytest.raises(ConfigurationError, match="did you mean 'duration'"):
        load_protocol(written(path, data))
    assert not trap[1].exists()


def test_a_settings_file_runs_no_code(tmp_path, trap):
    data = {"algorithm": "ppo", "default": {"n_timesteps": 1, "env_options": {"effect_file": str(trap[0])}}}
    path = written(tmp_path / "theirs.yaml", data)
    with pytest.raises(ConfigurationError, match=r"theirs\.yaml.*'effect_file' runs a Python file"):
        load_settings(str(path), HOLE)
    data = {"algorithm": "ppo", "default": {"n_timesteps": 1}, HOLE: {"residual": {"controller": "pid", "share": 0.1},
            "env_options": {"effect_file": str(trap[0])}}}  # fmt: skip
    with pytest.raises(ConfigurationError, match="runs a Python file"):
        load_settings(str(written(path, data)), HOLE)
    assert not trap[1].exists()


@pytest.mark.parametrize("command", ["submit", "replay", "protocol"])
def test_no_command_is_led_to_code(tmp_path, trap, command, capsys):
    """The three ways by which a cloned repository ran code: a policy, a board's record, a protocol."""
    folder = tmp_path / "clone"
    folder.mkdir()
    path = policy_yaml(folder, {"effect_file": str(trap[0])})
    if command == "submit":
        arguments = ["submit", path, "--check-only", "--results", folder]
    elif command == "replay":
        from cablebench.run.store import ResultStore
        from tests.support.board_records import made_records

        protocol = load_protocol(written(folder / "p.yaml", PROTOCOL))
        record = made_records(protocol, entrants={"oracle": ("oracle", 0.05, 1.1, 0, 0, 0)})[0]
        ResultStore(folder / "records.jsonl").append({**record, "replay": f"cablebench evaluate --policy {path}"})
        arguments = ["replay", "--results", folder, "--protocol", folder / "p.yaml", "--entrant", "oracle"]
        arguments += ["--env", HOLE]
    else:
        data = {**PROTOCOL, "tasks": [{"env": HOLE, "options": {"effect_file": str(trap[0])}}]}
        arguments = ["evaluate", "--controller", "pid", "--protocol", written(folder / "p.yaml", data)]
    with pytest.raises(SystemExit) as end:
        main([str(a) for a in arguments])
    err = capsys.readouterr().err
    assert end.value.code == 2 and err.count("\n") == 1 and "effect_file" in err and not trap[1].exists()
