"""Nothing of a stranger's is executed unasked; what was agreed to is known by its content."""

import hashlib
import io
import multiprocessing
from contextlib import suppress
from functools import partial

import pytest
import yaml

from cable_envs.core.errors import ConfigurationError
from cable_envs.core.files import guarded, permit, run_python
from cablebench.cli import main
from cablebench.entrants.trust import Trust, memory, remember, remembered
from tests.cablebench.test_submit import MINE, TINY

EFFECT = """
open({mark!r}, "a").close()
from cable_envs.effects.base import Effect, EffectParameter

def _spring(position, velocity, tension, stiffness):
    return stiffness * position

EFFECT = Effect(
    name="spring_of_mine", seam="load", equation="F = -stiffness y", source="a test",
    parameters=(EffectParameter("stiffness", "N/m", 0.0, 0.0, 1e9, "spring", typical=5e3),),
    validity="any", experiment="hold", confusable=("position_dependent_load",), hooks={{"load": _spring}},
)
"""


@pytest.fixture(autouse=True)
def place(tmp_path, monkeypatch):
    """A fresh memory, nobody at the terminal, and files that leave a mark when they run."""
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    monkeypatch.setattr("sys.stdin", io.StringIO())
    monkeypatch.chdir(tmp_path)
    mark = tmp_path / "sprung"
    (tmp_path / "mine.py").write_text(MINE)  # runs in its sandbox, where it could leave no mark
    (tmp_path / "mine.yaml").write_text(
        "schema: cable-controller/1\nname: told\ncontroller: mine.py\ngains: {CableHole-Position-Sine: {}}\n"
    )
    (tmp_path / "effect.py").write_text(EFFECT.format(mark=str(mark)))
    form = f"open({str(mark)!r}, 'a').close()\ndef open_dataset(path, asked): 1 / 0\n"
    (tmp_path / "form.py").write_text(form)
    (tmp_path / "tiny.yaml").write_text(TINY)
    return tmp_path


def cli(capfd, *arguments):
    with pytest.raises(SystemExit) as end:
        main([str(a) for a in arguments])
    return end.value.code or 0, capfd.readouterr().err


LOADERS = {
    "run": ("mine.py", "run", "CableHole-Position-Sine", "--controller", "mine.py", "-o", "duration=0.1"),
    "run a YAML file": ("mine.py", "run", "CableHole-Position-Sine", "--controller", "mine.yaml", "-o", "duration=0.1"),
    "evaluate": ("mine.py", "evaluate", "--protocol", "tiny.yaml", "--controller", "mine.py"),
    "submit": ("mine.py", "submit", "mine.py", "--protocol", "tiny.yaml", "--results", "r", "--check-only"),
    "submit renamed": (
        "mine.py", "submit", "mine.py", "--name", "n", "--protocol", "tiny.yaml", "--results", "r", "--check-only"
    ),
    "export": (
        "mine.py", "export", "CableHole-Position-Sine", "--controller", "mine.py", "--format", "recording",
        "--out", "d", "--episodes", "1", "-o", "duration=0.1"
    ),
    "effect of run": (
        "effect.py", "run", "CableHole-Position-Sine", "--controller", "pid", "-o", "effect_file=effect.py",
        "-o", "duration=0.1",
    ),
    "effect of train": (
        "effect.py", "train", "--env", "CableHole-Position-Sine", "--steps", "0", "-o", "effect_file=effect.py"
    ),
    "format": ("form.py", "import", "form.py", "tiny.yaml", "--out", "d"),
}  # fmt: skip


ASKING = [k for k in LOADERS if k not in ("effect of train", "submit")]


@pytest.mark.parametrize("loader", [*ASKING, pytest.param("submit", marks=pytest.mark.slow)])  # as "submit renamed"
def test_every_loader_refuses_unasked_and_remembers_what_was_agreed_to(place, capfd, loader):
    file, *command = LOADERS[loader]
    digest = hashlib.sha256((place / file).read_bytes()).hexdigest()
    code, err = cli(capfd, *command)
    assert code == 2 and err.count("\n") == 1, err
    assert f"{file} will be executed (SHA-256 {digest[:12]})" in err and "--trust" in err
    assert not (place / "sprung").exists() and not memory().exists()
    asked = "will be executed"
    for more in (("--trust",), ()):  # then the hash is known
        with suppress(ZeroDivisionError):  # the format's own
            assert asked not in cli(capfd, *command, *more)[1]
        assert digest in remembered()
    (place / file).write_text((place / file).read_text() + "\n# changed\n")
    code, err = cli(capfd, *command)
    assert code == 2 and asked in err


def test_training_with_an_own_effect_asks_before_any_process_starts(place, capfd):
    code, err = cli(capfd, *[w if w != "0" else "1" for w in LOADERS["effect of train"][1:]])
    assert code == 2 and "effect.py will be executed" in err and not (place / "sprung").exists()


def test_the_loader_of_diagnose_asks(place):
    from cable_envs.diagnosis.asked import load_effect

    with guarded(Trust()), pytest.raises(ConfigurationError, match=r"effect\.py will be executed"):
        load_effect(place / "effect.py")
    assert not (place / "sprung").exists()
    assert load_effect(place / "effect.py").name == "spring_of_mine"  # a program of the user's own is not asked


def test_the_answer_on_the_terminal_is_remembered(place):
    asked, answers = [], iter((False, True))
    gate = Trust(lambda text: (asked.append(text), next(answers))[1])
    with guarded(gate):
        with pytest.raises(ConfigurationError, match=r"form\.py.*was not run"):
            run_python(place / "form.py", "f")
        run_python(place / "form.py", "f")
        run_python(place / "form.py", "f")
    assert len(asked) == 2 and "SHA-256" in asked[0]
    with guarded(Trust()):
        run_python(place / "form.py", "f")  # another program, the same user


def test_what_is_executed_is_what_was_asked_about(place):
    def swap(path, content):
        path.write_text("raise SystemExit('another file')")

    with guarded(swap):
        run_python(place / "form.py", "f")
    assert (place / "sprung").exists()


def test_shipped_files_never_ask():
    from cable_envs.plants import own_effects

    with guarded(Trust()):
        permit(__import__("pathlib").Path(own_effects.__file__), b"pass")


@pytest.mark.parametrize(
    "content", ["nonsense", "schema: other", "schema: cable-trusted/1\nfiles: [1]", "files: {a: {}}"]
)
def test_a_damaged_memory_is_named(place, content):
    memory().parent.mkdir(parents=True)
    memory().write_text(content)
    with pytest.raises(ConfigurationError, match=r"trusted\.yaml"):
        remembered()


def _remember_many(number):
    for k in range(5):
        remember(hashlib.sha256(f"{number} {k}".encode()).hexdigest(), memory())


def test_two_programs_remember_at_once(place):
    context = multiprocessing.get_context("fork")
    work = [context.Process(target=partial(_remember_many, n)) for n in range(3)]
    for process in work:
        process.start()
    for process in work:
        process.join()
    assert len(remembered()) == 15 and yaml.safe_load(memory().read_text())["schema"] == "cable-trusted/1"


def test_where_nothing_can_be_kept_it_is_asked_again(place, monkeypatch):
    (place / "file").write_text("")
    monkeypatch.setenv("XDG_CONFIG_HOME", str(place / "file"))
    gate = Trust()
    gate.agreed = True
    gate(place / "form.py", b"pass")
    assert remembered() == {}
