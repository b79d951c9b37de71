"""The docs hold: the commands in them exist with their options, the examples run, the links lead somewhere."""

import doctest
import re
import shlex
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
import typer
import yaml

from cable_envs.core.errors import ConfigurationError
from cablebench.cli.app import app
from cablebench.cli.shared.arguments import parse_options, resolve_env
from cablebench.entrants.named import named_entrant
from cablebench.protocol.metrics import measure
from cablebench.run.evaluation import run_episode

ROOT = Path(__file__).parent.parent
PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")])
TUTORIALS = ("add-your-controller.md", "train-your-agent.md", "read-the-board.md")
COMMANDS = typer.main.get_command(app).commands

FENCE = re.compile(r"^```(\w*)\n(.*?)^```", re.MULTILINE | re.DOTALL)


def blocks(page: str, language: str) -> list[str]:
    """Fenced blocks of a language in docs/``page``."""
    return [text for kind, text in FENCE.findall((ROOT / "docs" / page).read_text()) if kind == language]


def written(path: Path) -> list[tuple[str, bool]]:
    """Every ``cablebench ...`` of a page, and whether it is a whole command (in a block) or a mention in a sentence."""
    text = path.read_text(encoding="utf-8")
    found = []
    for kind, block in FENCE.findall(text):
        if kind == "text":  # a drawing or a log
            continue
        lines = block.replace("\\\n", " ").splitlines()
        found += [(line.strip().removeprefix("$ "), True) for line in lines if re.match(r"\s*(\$ )?cablebench ", line)]
    for line in FENCE.sub("", text).splitlines():
        if line.startswith("    cablebench "):
            found.append((line.strip(), True))
    found += [(c, False) for c in re.findall(r"`(cablebench [^`\n]+)`", FENCE.sub("", text))]
    return found


def offences(command: str, whole: bool) -> list[str]:
    """What in a command the command line does not know; for a whole one also what it lacks."""
    words = shlex.split(command, comments=True)[1:]
    if words[0].startswith("-"):
        return [] if words[0] in ("--help", "--version") else [words[0]]
    if words[0] not in COMMANDS:
        return [words[0]]
    known, rest, wrong = COMMANDS[words[0]], words[1:], []
    options = {name: p for p in known.params for name in (*p.opts, *p.secondary_opts) if name.startswith("-")}
    given, k = set(), 0
    positional = []
    while k < len(rest):
        word = rest[k].split("=")[0] if rest[k].startswith("--") else rest[k]
        k += 1
        if word in ("--help",):
            continue
        if not word.startswith("-"):
            positional.append(word)
        elif word not in options:
            wrong.append(word)
        else:
            given.add(options[word].name)
            flag = getattr(options[word], "is_flag", False)
            k += 0 if flag or "=" in rest[k - 1] else 1
            if k > len(rest) and whole:
                wrong.append(f"{word} without its value")
    if whole and "[" not in command:
        needed = [p for p in known.params if p.required and p.name not in given]
        wrong += [f"lacks {p.opts[0]}" for p in needed if p.param_type_name == "option"]
        if len(positional) < sum(p.param_type_name == "argument" for p in needed):
            wrong.append("lacks an argument")
    return wrong


@pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(ROOT)))
def test_commands_in_the_docs_exist(page):
    wrong = {command: found for command, whole in written(page) if (found := offences(command, whole))}
    assert wrong == {}


def test_the_check_notices_what_does_not_exist():
    assert offences("cablebench trian --env X", True) == ["trian"]
    assert offences("cablebench train --env X --algorithm ppo", True) == ["--algorithm"]
    assert offences("cablebench train --algo ppo", True) == ["lacks --env"]
    assert offences("cablebench run --controller pid", True) == ["lacks an argument"]
    assert offences("cablebench run X --controller", True) == ["--controller without its value"]
    assert offences("cablebench run X -o rig=gu-steel-2mm --seed=3  # quick", True) == []
    assert len([c for p in TUTORIALS for c in written(ROOT / "docs" / p)]) > 20


def settings(command: str) -> tuple[str, list[str]]:
    """(environment that a command names, its settings as they are written)."""
    words = shlex.split(command, comments=True)
    env = words[words.index("--env") + 1] if "--env" in words else words[2]
    return env, [words[k + 1] for k, word in enumerate(words) if word == "-o"]


def test_settings_in_the_docs_make_an_environment():
    """Of whole commands whose files come with the project: an option may exist, and not take what a page gives it."""
    made = 0
    for page in PAGES:
        for command, whole in written(page):
            if whole and " -o " in command and "effect_file=" not in command:
                env, given = settings(command)
                known = {k: v for k, v in parse_options(given).items() if k != "split"}  # of the suite's tasks
                gym.make(resolve_env(env), disable_env_checker=True, **known).close()
                made += 1
    assert made >= 6
    with pytest.raises(ConfigurationError, match="sensor_delay"):
        gym.make(resolve_env("CableHole-Position-Sine"), **parse_options(["sensor_delay={load_position: 0.02}"]))


def test_every_command_is_on_the_page_of_commands():
    mentioned = {shlex.split(c)[1] for c, _ in written(ROOT / "docs" / "commands.md")}
    assert {name for name, command in COMMANDS.items() if not command.hidden} <= mentioned


def test_the_readme_is_short_and_shows_three_things_to_do():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 150
    assert text.count("](docs/pictures/") == 2
    commands = [block for kind, block in FENCE.findall(text) if kind == "" and "cablebench " in block]
    assert [len(block.strip().splitlines()) for block in commands] == [3, 3, 3]
    words = ("tendon", "sheath", "Bowden", "capstan", "cable-driven", "backlash", "sim-to-real")
    assert [word for word in words if word not in text] == []
    assert "`make demo`" in text and "`make test`" in text


@pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(ROOT)))
def test_links_lead_somewhere(page):
    """To a file, or to a page that the site makes when it is built: its menu has these, and tests/docs follows them."""
    targets = [t for t in re.findall(r"\]\(([^)\s]+)\)", page.read_text()) if "://" not in t and not t.startswith("#")]
    menu = re.findall(r"[\w/-]+\.md", (ROOT / "mkdocs.yml").read_text(encoding="utf-8"))
    made = {(ROOT / "docs" / name).resolve() for name in menu}
    places = {t: page.parent / t.split("#")[0] for t in targets}
    assert [t for t, place in places.items() if not place.exists() and place.resolve() not in made] == []


def test_the_menu_has_pages_that_are_there_or_that_the_site_makes():
    menu = re.findall(r"[\w/-]+\.md", (ROOT / "mkdocs.yml").read_text(encoding="utf-8"))
    makers = "".join(file.read_text(encoding="utf-8") for file in (ROOT / "docs" / "site").glob("*.py"))
    folders = ("environments/", "plants/", "api/")  # one page for each environment, plant and module
    absent = [name for name in menu if not (ROOT / "docs" / name).exists() and not name.startswith(folders)]
    assert [name for name in absent if f'"{name}"' not in makers] == []


@pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(ROOT)))
def test_links_into_a_page_lead_to_one_of_its_headings(page):
    toc = pytest.importorskip("markdown.extensions.toc")  # as the site makes addresses of headings
    wrong = []
    for target in re.findall(r"(?<!!)\[[^\]]+\]\(([^)\s]*#[^)\s]+)\)", FENCE.sub("", page.read_text(encoding="utf-8"))):
        name, heading = target.split("#", 1)
        place = page.parent / name if name else page
        if "://" in target or place.suffix != ".md" or not place.is_file():
            continue
        text = place.read_text(encoding="utf-8")
        shown = [re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", line) for line in re.findall(r"^#+ (.*)$", text, re.MULTILINE)]
        known = {toc.slugify(re.sub("[`*]", "", line), "-") for line in shown}
        if heading not in known | set(re.findall(r'(?:id="|\{#)([\w-]+)', text)):
            wrong.append(target)
    assert wrong == []


def test_the_first_example_of_the_readme_runs(capsys):
    (source,) = [text for kind, text in FENCE.findall((ROOT / "README.md").read_text()) if kind == "python"]
    exec(compile(source, "README.md", "exec"), {})
    channels, last = capsys.readouterr().out.splitlines()
    assert "'load_position [m]'" in channels and len(last.split()) == 2


@pytest.fixture
def example(tmp_path):
    """A folder with the two files of "Add your controller"."""
    (source,), (file, *_) = blocks("add-your-controller.md", "python"), blocks("add-your-controller.md", "yaml")
    (tmp_path / "weight_pid.py").write_text(source)
    (tmp_path / "weight_pid.yaml").write_text(file)
    return tmp_path


def test_the_examples_of_joint_and_wrist_give_what_they_say():
    failed, tried = doctest.testfile(str(ROOT / "docs" / "cable-mechanisms.md"), module_relative=False)
    assert failed == 0 and tried > 10


def error_of(controller: str, env_id: str) -> float:
    """RMSE of a whole episode."""
    entrant = named_entrant(controller)
    env = gym.make(env_id, observe="output")
    needs = entrant.needs(env_id, env.unwrapped.setup)
    assert needs is not None and set(needs.values()) <= {"output"}
    try:
        episode = run_episode(env, entrant.make(env.unwrapped.setup), seed=0)
    finally:
        env.close()
    assert episode.complete
    return measure(episode)["rmse"]


def test_the_example_controller_tracks(example):
    env_id = "cable_envs/CableHole-Position-Sine-v0"
    simple = error_of(str(example / "weight_pid.py"), env_id)
    tuned = error_of(str(example / "weight_pid.yaml"), env_id)
    # the load moves by +/- 10 mm; open loop is off by 7 mm
    assert tuned < simple < 0.002


def test_the_example_enters_the_tasks_it_names(example):
    from cable_envs.sim.registered import setup_of

    entrant = named_entrant(str(example / "weight_pid.yaml"))
    assert (entrant.name, entrant.information, entrant.charged) == (
        "weight-pid-tuned",
        "nominal",
        {"tuning_trials": 40},
    )
    ids = [i for i in gym.registry if i.startswith("cable_envs/") and entrant.needs(i, setup_of(i, {})) is not None]
    assert ids == [f"cable_envs/CableHole-Position-{r}-v0" for r in ("Step", "Sine")]


def test_the_example_settings_load(tmp_path):
    pytest.importorskip("torch")
    from cable_envs.agents.settings import load_settings

    (text,) = blocks("train-your-agent.md", "yaml")
    path = tmp_path / "my-agent.yaml"
    path.write_text(text)
    keys = yaml.safe_load(text)["default"]
    settings = load_settings(str(path), "cable_envs/CableHole-Position-Sine-v0")
    assert settings.learner["gamma"] == 0.98  # the environment's own over the default
    assert (settings.algo, settings.n_timesteps) == ("my-agent", keys["n_timesteps"])
    assert settings.residual["controller"] == "pid" and settings.frame_stack == 4
    assert settings.information == named_entrant("pid").information  # a residual agent knows what its controller knows


def test_the_example_in_memory_gives_what_it_says(capsys):
    (source,) = blocks("your-own-recording.md", "python")
    exec(compile(source, "your-own-recording.md", "exec"), {})
    verdict, stiffness = capsys.readouterr().out.splitlines()
    assert verdict == "named ['position_dependent_load']" and verdict in source
    value, low, high = map(float, re.search(r"# ([\d.]+) N/m, within ([\d.]+) and ([\d.]+)", source).groups())
    found = [float(number) for number in re.findall(r"(?:value|low|high)=([\d.]+)", stiffness)]
    assert found == pytest.approx([value, low, high], rel=5e-3)  # three digits, as the page gives them
    assert low < 60.0 < high


def test_the_example_log_becomes_a_recording(tmp_path):
    """The log and the mapping of "Your own recording", made longer, through its own commands."""
    from cable_envs.diagnosis.data.recording import load_recording
    from cablebench.cli import main

    (text,), (mapping,) = blocks("your-own-recording.md", "text"), blocks("your-own-recording.md", "yaml")
    (tmp_path / "logs").mkdir()
    (tmp_path / "jaw.yaml").write_text(mapping)
    commands = [c for c, whole in written(ROOT / "docs" / "your-own-recording.md") if whole and "jaw" in c][:2]
    for name, load in (("jaw_05N.log", 20.0), ("jaw_20N.log", 80.0)):
        lines = text.splitlines()[:4]
        time = np.arange(3000) * 2.0  # ms
        motor = -30 * np.cos(2 * np.pi * 0.5e-3 * time)
        push = -load + 45 * np.sign(np.sin(2 * np.pi * 0.5e-3 * time))  # N mm: the load, and friction
        rows = zip(time, motor, push, np.rint(-0.9 * motor / 0.09), np.full(3000, -load))
        lines += [";".join(f"{v:.2f}".replace(".", ",") for v in row) for row in rows]
        (tmp_path / "logs" / name).write_text("\n".join(lines) + "\n")
    for command in commands:
        words = shlex.split(command)[1:]
        paths = ("logs", "jaw", "jaw.yaml")
        with pytest.raises(SystemExit) as end:
            main([str(tmp_path / w) if w in paths else w for w in words])
        assert not end.value.code, command
    recording = load_recording(tmp_path / "jaw")
    assert {r.name: (r.use, r.conditions["load"]) for r in recording.records} == {
        "jaw_05N.csv": ("fit", 5.0),
        "jaw_20N.csv": ("heldout", 20.0),
    }
    record = recording.records[0]
    assert record.time[-1] == pytest.approx(5.998) and not record.quality
    assert record.data["drive_torque"].max() == pytest.approx(0.025)
    np.testing.assert_allclose(record.data["output_angle"], 0.9 * record.data["drive_angle"], atol=1e-3)
