"""Controller files: what they may say, where they enter, and that their gains reach the controller."""

import pytest

from cable_envs.core.errors import ConfigurationError
from cable_envs.sim.registered import setup_of
from cablebench.entrants.controller_files import controller_file_entrant
from cablebench.entrants.entrant import controller_entrant
from cablebench.entrants.named import named_entrant

STEP, SINE = "cable_envs/CableHole-Position-Step-v0", "cable_envs/CableHole-Position-Sine-v0"
CIRCUIT = "cable_envs/PulleyCircuit-Position-Sine-v0"
TEXT = """
schema: cable-controller/1
name: pid-tuned
controller: pid
charged: {tuning_trials: 40}
gains:
  CableHole-Position-Step: {kp: 2000.0}
  cable_envs/CableHole-Position-Sine-v0: {kp: 2500.0}
made_by: by hand
"""


@pytest.fixture
def written(tmp_path):
    def write(text=TEXT):
        path = tmp_path / "tuned.yaml"
        path.write_text(text)
        return path

    return write


def test_it_enters_only_where_it_has_gains_and_uses_those_of_the_task(written):
    path = written()
    entrant = controller_file_entrant(path)
    assert (entrant.name, entrant.information) == ("pid-tuned", controller_entrant("pid").information)
    assert entrant.charged == {"tuning_trials": 40} and entrant.arguments == f"--controller {path}"
    found = {env: setup_of(env, {}) for env in (STEP, SINE, CIRCUIT)}
    assert [bool(entrant.needs(env, setup)) for env, setup in found.items()] == [True, True, False]
    used = {env: entrant.make(found[env]).controller.gains["kp"] for env in (STEP, SINE)}
    assert used == {STEP: 2000.0, SINE: 2500.0}


def test_the_command_line_finds_it_by_path_or_by_name(written, monkeypatch):
    path = written()
    assert named_entrant(str(path)).name == "pid-tuned"
    import cablebench.entrants.controller_files as files

    folder = path.parent / "configs" / "controllers"
    folder.mkdir(parents=True)
    (folder / "pid-tuned.yaml").write_text(TEXT)
    monkeypatch.setattr(files, "config_root", lambda: folder.parent)
    monkeypatch.setattr(files, "config_path", lambda kind, name: folder.parent / kind / name)
    assert named_entrant("pid-tuned").arguments == "--controller pid-tuned"
    with pytest.raises(ConfigurationError, match="did you mean 'pid-tuned'"):
        named_entrant("pid-tned")
    with pytest.raises(ConfigurationError, match="belong into its file"):
        named_entrant("pid-tuned", {"kp": 1.0})


def test_its_settings_hold_the_gains_so_that_other_gains_are_another_run(written):
    first = controller_file_entrant(written()).settings
    assert controller_file_entrant(written(TEXT.replace("2500", "2600"))).settings != first


@pytest.mark.parametrize(("old", "new", "expected"), [
    ("cable-controller/1", "cable-controller/9", "expected 'cable-controller/1'"),
    ("name: pid-tuned", "nam: pid-tuned", "did you mean 'name'"),
    ("controller: pid", "controller: pidd", "did you mean 'pid'"),
    ("kp: 2000.0", "kpp: 2000.0", "did you mean 'kp'"),
    ("kp: 2000.0", "kp: -5", "kp"),
    ("kp: 2000.0", "kp: .nan", "expected a number"),
    ("CableHole-Position-Step:", "CableHole-Postion-Step:", "did you mean 'cable_envs/CableHole-Position-Step-v0'"),
    ("tuning_trials", "trials", "did you mean 'tuning_trials'"),
    ("tuning_trials: 40", "tuning_trials: -1", "at least 0"),
    ("made_by", "information: model-free\nmade_by", "is told more"),
    ("made_by", "information: clever\nmade_by", "unknown information class"),
    ("controller: pid", "controller: feedforward-pid", "not for 'cable_hole'"),
])  # fmt: skip
def test_what_is_wrong_is_named_with_the_file(written, old, new, expected):
    path = written(TEXT.replace(old, new, 1))
    with pytest.raises(ConfigurationError, match=expected) as caught:
        controller_file_entrant(path)
    assert str(path) in str(caught.value)
