"""Anyone's controller as one file: what is accepted, what is refused and how that is said, what it is told."""

import textwrap
from types import SimpleNamespace

import pytest

from cable_envs.core.errors import ConfigurationError
from cable_envs.sim.registered import setup_of
from cablebench.cli.shared.training import say_seeds
from cablebench.entrants.admission import check_name, check_training, read_submission
from cablebench.entrants.apart import submission_entrant
from cablebench.entrants.controller_files import controller_file_entrant
from cablebench.entrants.dry_run import dry_run, within
from cablebench.entrants.entrant import agent_entrant
from cablebench.entrants.named import named_entrant
from cablebench.entrants.submission import kind_of
from cablebench.protocol.protocol import Protocol, SeedRange, Task, Track
from cablebench.run.evaluation import evaluate

HOLE, CIRCUIT = "cable_envs/CableHole-Position-Sine-v0", "cable_envs/PulleyCircuit-Position-Sine-v0"
GOOD = """
name = "mine"
information = "model-free"
observe = {"cable_hole": "full", "pulley_circuit": "drive"}
charged = {"tuning_trials": 3}

def reset():
    pass

def act(t, y, ref):
    return 50.0
"""


def short(**changes):
    return Protocol(**{
        "name": "short", "title": "Short", "tasks": (Task(HOLE, {"duration": 0.5}), Task(CIRCUIT, {"duration": 0.5})),
        "tracks": (Track("nominal"),), "train": SeedRange(0, 10), "tune": SeedRange(10, 10), "test": SeedRange(20, 10),
        "episodes": 2, "resamples": 50, **changes,
    })  # fmt: skip


@pytest.fixture
def written(tmp_path):
    def write(text=GOOD, name="mine.py"):
        path = tmp_path / name
        path.write_text(textwrap.dedent(text))
        return path

    return write


def test_declarations_become_the_entrant(written):
    entrant = submission_entrant(written())
    assert (entrant.name, entrant.information, entrant.charged) == ("mine", "model-free", {"tuning_trials": 3})
    assert entrant.needs(HOLE, setup_of(HOLE, {})) == {"observe": "full"}
    assert entrant.needs(CIRCUIT, setup_of(CIRCUIT, {})) == {"observe": "drive"}
    only = submission_entrant(written(GOOD + 'tasks = ["CableHole-Position-Sine"]'))
    assert only.needs(CIRCUIT, setup_of(CIRCUIT, {})) is None and only.needs(HOLE, setup_of(HOLE, {})) is not None
    assert only.settings != entrant.settings  # another file is another run
    assert named_entrant(str(written())).arguments == f"--controller {written()}"


@pytest.mark.parametrize(("change", "expected"), [
    (("def act(t, y, ref)", "def akt(t, y, ref)"), r"has no act\(t, y, ref\)"),
    (("def reset()", "def restart()"), r"has no reset\(\)"),
    (("act(t, y, ref)", "act(observation)"), r"act\(observation\) does not take the arguments of act\(t, y, ref\)"),
    (("reset()", "reset(a, b)"), r"reset\(a, b\) does not take"),
    (('information = "model-free"', ""), "declare information = 'model-free'"),
    (('"model-free"', '"modelfree"'), "did you mean 'model-free'"),
    (('"full"', '"all"'), "unknown observe level"),
    (("tuning_trials", "trials"), "did you mean 'tuning_trials'"),
    (('"tuning_trials": 3', '"tuning_trials": -3'), "at least 0"),
    (("charged =", 'tasks = ["CableHole-Postion-Sine"]\ncharged ='), "did you mean 'CableHole-Position-Sine'"),
    (("charged =", 'tasks = "CableHole-Position-Sine"\ncharged ='), "must be a list"),
    (("charged =", "1 / 0\ncharged ="), r"ZeroDivisionError: division by zero \(line 5\)"),
    (("charged =", "charged ="[:-1]), "cannot be loaded"),
    (("charged =", "raise SystemExit(3)\ncharged ="), "SystemExit: 3"),
    (("charged =", "import nonsense_module\ncharged ="), "No module named 'nonsense_module'"),
])  # fmt: skip
def test_what_is_wrong_is_said_with_the_file(written, change, expected):
    path = written(GOOD.replace(*change))
    with pytest.raises(ConfigurationError, match=expected) as caught:
        kind_of(path, path.read_bytes())  # what the other process runs
    assert str(path) in str(caught.value) and "\n" not in str(caught.value)


def test_what_the_other_process_finds_wrong_is_said_here(written):
    path = written(GOOD.replace("def act(t, y, ref)", "def akt(t, y, ref)"))
    with pytest.raises(ConfigurationError, match=r"mine\.py has no act\(t, y, ref\)") as caught:
        submission_entrant(path)
    assert str(path) in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize(("answer", "expected"), [
    ("float('nan')", r"t = 0 s: the answer is not finite"),
    ("'fast'", r"act\(\) answered 'fast' \(str\) at t = 0 s"),
    ("None", "expected one number"),
    ("y['load_positon']", r"act\(\) raised KeyError: 'load_positon' \(line 11\) at t = 0 s; y has .* drive_position, "),
    ("y['nothing']", r"^on cable_envs/CableHole-Position-Sine-v0 \(observe: full\): .*mine\.py: act\(\) raised"),
    ("{}[1]", r"act\(\) raised KeyError: 1 \(line 11\) at t = 0 s$"),
    ("__import__('time').sleep(0.03) or 1.0", "the control period is 10 ms"),
])  # fmt: skip
def test_the_dry_run_finds_what_only_running_shows(written, answer, expected):
    entrant = submission_entrant(written(GOOD.replace("50.0", answer)))
    with pytest.raises(ConfigurationError, match=expected):
        dry_run(entrant, short(), [HOLE])


def test_a_good_one_passes_the_dry_run_wherever_it_enters(written):
    tried = dry_run(submission_entrant(written()), short())
    assert [t.env_id for t in tried] == [HOLE, CIRCUIT]
    assert tried[0].clipped == 0.0 and tried[1].clipped == 1.0  # 50 N is a command, 50 rad is beyond the range
    with pytest.raises(ConfigurationError, match="enters none"):
        dry_run(submission_entrant(written(GOOD + 'tasks = ["CableHole-Tension-Sine"]')), short())


def test_an_answer_that_never_comes_is_interrupted():
    with pytest.raises(ConfigurationError, match="too long"), within(0.05, "too long"):  # noqa: PT012
        while True:
            try:
                sum(range(1000))
            except Exception:  # somebody's blanket except does not hold it up
                continue


TOLD = """
name = "told"
information = "{information}"
seen = []

def reset(about):
    seen.append(dict(about))

def act(t, y, ref):
    return 0.5 * (seen[-1]["low"] + seen[-1]["high"])
"""


@pytest.mark.parametrize("information", ["model-free", "nominal", "oracle"])
def test_it_is_told_what_its_class_allows(written, information):
    entrant = submission_entrant(written(TOLD.format(information=information)))
    setup = setup_of(HOLE, {})
    path = written(TOLD.format(information=information))
    kind = kind_of(path, path.read_bytes())  # what the other process runs
    assert kind.information == entrant.information
    case = (setup.plant.name, setup.action_mode.name, setup.task.kind)
    controller = kind.within(*case, setup.rig.values, 0.01, setup.low, setup.high)
    true = {**setup.rig.values, "load_mass": 7.5}
    controller.set_rig(true)
    controller.reset()
    told = controller._offered.seen[-1]
    assert (told["plant"], told["action_mode"], told["task"], told["dt"]) == ("cable_hole", "tension", "position", 0.01)
    expected = {"model-free": None, "nominal": dict(setup.rig.values), "oracle": true}[information]
    assert told.get("rig") == expected
    assert controller.act(0.0, {}, (0.0, 0.0, 0.0)) == 60.0
    assert entrant.make(setup).controller.act is not None
    assert kind.within(*case, setup.rig.values, 0.01, 0.0, 1.0)._offered.seen == []


def test_a_name_that_about_does_not_have_is_said_with_those_it_has(written):
    asks = TOLD.replace("seen.append(dict(about))", "about['{asked}']")
    for information, asked, expected in (
        ("model-free", "rig", "KeyError: 'rig' .*; a model-free controller is told no rig$"),
        ("nominal", "mass", "KeyError: 'mass' .*; about has plant, action_mode, task, dt, low, high, rig$"),
    ):
        entrant = submission_entrant(written(asks.format(information=information, asked=asked)))
        with pytest.raises(ConfigurationError, match=expected):
            dry_run(entrant, short(), [HOLE])


CLASS = """
information = "nominal"

class Proportional:
    name = "proportional"
    observe = "output"

    def __init__(self, kp=1000.0):
        self.kp = kp

    def reset(self):
        self.calls = 0

    def act(self, t, y, ref):
        self.calls += 1
        return 50.0 + self.kp * (ref[0] - y["load_position"])
"""


def test_a_class_takes_gains_from_a_controller_file(written):
    written(CLASS, "p.py")
    text = "schema: cable-controller/1\nname: p-tuned\ncontroller: p.py\ngains: {CableHole-Position-Sine: {kp: 5.0}}\n"
    entrant = controller_file_entrant(written(text, "p.yaml"))
    controller = entrant.make(setup_of(HOLE, {})).controller
    controller.reset()
    assert controller.act(0.0, {"load_position": 0.0}, (1.0, 0.0, 0.0)) == 55.0
    assert entrant.needs(HOLE, setup_of(HOLE, {})) == {"observe": "output"} and entrant.information == "nominal"
    with pytest.raises(ConfigurationError, match="kd"):
        controller_file_entrant(written(text.replace("kp", "kd"), "p.yaml"))


WRAPPED = """
from cable_envs.baselines import make_controller

name = "wrapped"
information = "nominal"
observe = "output"

def reset(about):
    global controller
    case = (about["plant"], about["action_mode"], about["task"], about["rig"], about["dt"])
    controller = make_controller("mrac-g22", *case)

def act(t, y, ref):
    return controller.act(t, y, ref)
"""


def test_a_file_with_a_references_law_gets_the_references_numbers(written):
    from cablebench.entrants.entrant import controller_entrant

    records = evaluate(short(), [submission_entrant(written(WRAPPED)), controller_entrant("mrac-g22")], [HOLE])
    found = {"wrapped": [], "mrac-g22": []}
    for r in records:
        found[r["entrant"]].append({k: v for k, v in r["metrics"].items() if k != "inference_us"})
    assert len(found["wrapped"]) == 2 and found["wrapped"] == found["mrac-g22"]


def test_files_are_kept_by_content_and_load_from_there(written, tmp_path):
    submission = read_submission(written())
    kept = submission.keep(tmp_path / "results")
    assert kept == tmp_path / "results" / "submissions" / submission.hash() / "mine.py"
    assert kept.read_text() == written().read_text() and submission.executes == "mine.py"
    assert read_submission(kept).keep(tmp_path / "results") == kept  # handing in the copy changes nothing
    renamed = read_submission(written(), "other")
    assert renamed.hash() != submission.hash()
    assert named_entrant(str(renamed.keep(tmp_path / "results"))).name == "other"


def test_only_what_can_be_entered_is_taken(written):
    with pytest.raises(ConfigurationError, match=r"hand in a \.py file"):
        read_submission(written("x", "policy.h5"))
    with pytest.raises(ConfigurationError, match="no file at"):
        read_submission("nowhere.py")
    with pytest.raises(ConfigurationError, match="expected 'cable-controller/1' or 'cable-policy-file/1'"):
        read_submission(written("schema: 1", "x.yaml"))
    with pytest.raises(ConfigurationError, match="no file at"):
        read_submission(written("schema: cable-controller/1\nname: a\ncontroller: b.py", "x.yaml"))


def test_a_policy_trained_on_seeds_for_tuning_or_testing_is_refused():
    def trained(*seeds):
        return agent_entrant("ppo", None, HOLE, training_seed=0, environment_steps=1, trained_on=range(*seeds))

    check_training(trained(6, 10), short())
    check_training(trained(0), short())  # of nothing is known
    for seeds, use in (((8, 12), "keeps 10 to 19 for tuning"), ((20, 24), "keeps 20 to 29 for testing")):
        with pytest.raises(ConfigurationError, match=f"the seeds {seeds[0]} to {seeds[1] - 1}; short {use}"):
            check_training(trained(*seeds), short())


def test_a_training_beyond_the_seeds_for_training_is_told_so(capsys):
    settings = SimpleNamespace(n_envs=64, env_seeds=lambda seed: range(64 * seed, 64 * seed + 64))
    say_seeds(settings, (0, 9, 15624))
    assert capsys.readouterr() == ("", "")
    say_seeds(settings, (0, 15625))
    said = capsys.readouterr().err
    assert "warning: --seed 15625 starts the 64 environments from the seeds 1000000 to 1000063; " in said
    assert "boards quick and full is 0 to 999999" in said and said.count("\n") == 1


def test_names_are_not_taken_twice(written):
    entrant = submission_entrant(written())
    with pytest.raises(ConfigurationError, match="name of a reference"):
        check_name(entrant, [], ("mine",))
    record = {"entrant": "mine", "training_seed": None, "env_id": HOLE, "settings": {"source": "another"}}
    with pytest.raises(ConfigurationError, match="on the board already"):
        check_name(entrant, [record], ())
    check_name(entrant, [{**record, "settings": dict(entrant.settings)}], ())
    others = {**record, "settings": dict(entrant.settings), "maker": "abc", "training_seed": 5}
    with pytest.raises(ConfigurationError, match="by another maker"):
        check_name(entrant, [others], ())
