"""Package boundaries: imports point down, the core runs without extras, and importing it is quick."""

import ast
import json
import os
import re
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest

from tests.support.tree import FOLDERS, LINKED, ROOT, module, sources

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
FORMATS = "cable_envs.diagnosis.readers.formats"
INSTALLED = tuple(PROJECT["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"])
EXTRAS = (
    "torch", "stable_baselines3", "tensorboard", "typer", "rich", "jinja2", "matplotlib", "pygame", "cma", "pyarrow",
    "minari", "h5py", "rosbags", "asammdf", "mcap", "pandas", "optuna", "sqlalchemy", "ray", "markdown_it",
    "casadi", "control",
)  # fmt: skip


def _imports(path: Path) -> set[str]:
    """Every absolute module name that a file imports, inside functions too; for ``from a import b`` also ``a.b``."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            found |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    return found


def _inside(name: str, *parents: str) -> bool:
    return any(name == parent or name.startswith(parent + ".") for parent in parents)


def _offences(files: list[Path], *forbidden: str) -> list[str]:
    """Imports of ``forbidden`` modules; those of a folder that is linked into `cable_envs` go by the folder's name."""
    names = [f"cable_envs.{name}" if name.split(".")[0] in LINKED else name for name in forbidden]
    return [f"{module(f)} imports {name}" for f in files for name in sorted(_imports(f)) if _inside(name, *names)]


def test_declared_packages():
    assert INSTALLED == ("cable_envs", "cablebench")
    for folder in (*LINKED, "configs"):
        assert (ROOT / "cable_envs" / folder).samefile(ROOT / folder), folder


def test_simulator_imports_nothing_above_it():
    assert _offences(sources("cable_envs"), "baselines", "agents", "cablebench", "torch", "stable_baselines3") == []


def test_controllers_know_no_environment():
    above = ["cable_envs.envs", "cable_envs.spaces", "cable_envs.vector", "cable_envs.render", "cable_envs.drawing"]
    above += [f"cable_envs.sim.{m}" for m in ("simulation", "steppers", "setup", "tasks")]
    assert _offences(sources("baselines"), "gymnasium", "agents", "cablebench", "torch", "numba", *above) == []
    third = {
        name.split(".")[0]
        for f in sources("baselines")
        for name in _imports(f)
        if name.split(".")[0] not in sys.stdlib_module_names
    }
    assert third <= {"cable_envs", "numpy", "scipy"}  # CasADi is imported by name where mpc is made


def test_torch_only_in_agents():
    files = [f for package in FOLDERS if package != "agents" for f in sources(package)]
    assert _offences(files, "torch", "stable_baselines3") == []


JOINS = ("cablebench.concealed",)
"""What ties both halves of the project together: it diagnoses, trains and ranks. Only the command line knows it."""


def test_only_the_command_line_knows_what_joins_both_halves():
    others = [f for f in sources("cablebench") if not _inside(module(f), "cablebench.cli", *JOINS)]
    assert _offences([*others, *(f for p in FOLDERS if p != "cablebench" for f in sources(p))], *JOINS) == []


def test_benchmark_does_not_know_agents_or_its_command_line():
    command_line = ("cablebench.cli",)
    files = [f for f in sources("cablebench") if not _inside(module(f), *command_line)]
    assert _offences(files, "typer", *command_line) == []
    assert _offences([f for f in files if not _inside(module(f), *JOINS)], "agents") == []
    assert _offences(sources("agents"), *command_line) == []


def test_only_export_and_its_command_know_recordings_and_minari():
    # the benchmark knows no diagnosis; the pages about it and the experiment on it do
    about_it = ("cablebench.pages",)
    above = ("cablebench.export", "cablebench.cli", *about_it, *JOINS)
    files = [f for f in sources("cablebench") if not _inside(module(f), *above)]
    assert _offences(files, "diagnosis", "minari", "cablebench.export", *JOINS) == []
    pages = [f for f in sources("cablebench") if _inside(module(f), *about_it)]
    assert _offences(pages, "minari", "cablebench.export", "agents", "baselines") == []
    others = [f for package in FOLDERS for f in sources(package) if module(f) != "cablebench.export.minari"]
    assert _offences(others, "minari") == []
    assert _offences([f for f in others if module(f) != f"{FORMATS}.mat"], "h5py") == []  # MATLAB 7.3 is HDF5
    bags = [f for package in FOLDERS for f in sources(package) if module(f) != f"{FORMATS}.rosbag"]
    assert _offences(bags, "rosbags") == []
    for name, library in (("mdf", "asammdf"), ("mcap", "mcap")):
        files = [f for package in FOLDERS for f in sources(package) if module(f) != f"{FORMATS}.{name}"]
        assert _offences(files, library) == []
    frames = [f for package in FOLDERS for f in sources(package) if module(f) != "cable_envs.diagnosis.data.memory"]
    assert _offences(frames, "pandas") == []


def test_tools_above_the_simulator_stay_below_the_command_line():
    assert _offences(sources("identification"), "cablebench", "agents", "baselines", "reproduction", "gymnasium") == []
    assert _offences(sources("diagnosis"), "cablebench", "agents", "baselines", "reproduction") == []
    assert _offences(sources("reproduction"), "agents", "typer", "cablebench.cli", "cablebench.cli") == []
    below = [f for p in ("cable_envs", "baselines", "agents") for f in sources(p)]
    assert _offences(below, "identification", "diagnosis", "reproduction") == []


WITHOUT_EXTRAS = """
import sys

class Blocked:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in BLOCKED:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

BLOCKED = set(sys.argv[1].split(","))
sys.meta_path.insert(0, Blocked())
import gymnasium, cable_envs
from cable_envs import baselines
for env_id in cable_envs.ENV_IDS:
    env = gymnasium.make(env_id, duration=0.1, observe="full")
    setup = env.unwrapped.setup
    observation, _ = env.reset(seed=0)
    for name, kind in baselines.CONTROLLERS.items():
        case = setup.plant.name, setup.action_mode.name, setup.task.kind
        if kind.applies(*case):
            controller = kind(*case, setup.rig.values, setup.control_period)
            measured = {c.name: float(v) * c.scale for c, v in zip(setup.channels, observation)}
            assert setup.low <= controller.act(0.0, measured, (measured["reference"], 0.0, 0.0)) <= setup.high
    env.step(env.action_space.sample())
loaded = sorted(BLOCKED & set(sys.modules))
assert not loaded, loaded
print("environments", len(cable_envs.ENV_IDS), "controllers", len(baselines.CONTROLLERS), cable_envs.__file__)
"""


def _python(*arguments: str, **options) -> subprocess.CompletedProcess:
    return subprocess.run([sys.executable, *arguments], capture_output=True, text=True, timeout=300, **options)


def test_core_runs_without_extras():
    """Environments and reference controllers work where torch, typer, rich, matplotlib, ... cannot be imported."""
    done = _python("-c", WITHOUT_EXTRAS, ",".join(EXTRAS), cwd=ROOT)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("environments 12 controllers 18")


def test_command_line_without_extras_says_what_to_install():
    code = WITHOUT_EXTRAS.split("import gymnasium")[0] + "from cablebench.cli import main; main(['envs'])"
    done = _python("-c", code, "typer", cwd=ROOT)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == "cablebench: error: this command needs typer: pip install 'cable-envs[bench]'\n"
    code = code.replace("['envs']", "['train', '--env', 'CableHole-Position-Sine']")
    done = _python("-c", code, "torch,stable_baselines3", cwd=ROOT)
    assert (done.returncode, done.stdout) == (2, "")
    assert "pip install --extra-index-url https://download.pytorch.org/whl/cpu 'cable-envs[agents]' (" in done.stderr
    assert done.stderr.count("\n") == 1


@pytest.mark.parametrize("folder", LINKED)
def test_a_folder_of_the_checkout_is_imported_by_its_installed_name_only(folder):
    """Under two names it would be there twice, with classes that are not each other's."""
    done = _python("-c", f"import {folder}", cwd=ROOT)
    assert done.returncode == 1
    assert done.stderr.endswith(
        f"ImportError: the folder {folder}/ of this checkout is imported as cable_envs.{folder}\n"
    )


def test_import_takes_less_than_a_second():
    """Processor time of ``import cable_envs`` in a fresh interpreter (wall time depends on what else runs)."""
    code = (
        "import json, sys, time; t = time.process_time(); import cable_envs;"
        "print(json.dumps([time.process_time() - t, 'numba' in sys.modules, 'torch' in sys.modules]))"
    )
    runs = [json.loads(_python("-c", code, cwd=ROOT).stdout) for _ in range(3)]
    assert min(seconds for seconds, _, _ in runs) < 1.0
    assert not any(numba or torch for _, numba, torch in runs)


def test_help_loads_nothing_heavy():
    code = (
        "import sys; from cablebench.cli import main\n"
        "try: main(['--help'])\nexcept SystemExit as e: assert not e.code\n"
        "heavy = {'numba', 'scipy', 'torch', 'matplotlib', 'jinja2', 'optuna', 'ray'} & set(sys.modules)\n"
        "sys.exit(str(heavy) if heavy else 0)"
    )
    done = _python("-c", code, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    for command in ("envs", "run", "train", "evaluate", "leaderboard", "demo", "export", "tune"):
        assert f" {command} " in done.stdout


def test_declared_dependencies():
    project = PROJECT["project"]
    core = {requirement.split(">")[0].split("[")[0] for requirement in project["dependencies"]}
    assert core == {"gymnasium", "numpy", "numba", "scipy", "pyyaml"}
    pinned = dict(
        line.lower().replace("_", "-").split("==")
        for line in (ROOT / "constraints.txt").read_text().splitlines()
        if line and not line.startswith("#")
    )
    assert pinned["torch"] == "2.13.0"  # a local version (+cpu) would not be found elsewhere
    wanted = {r.split(">")[0].split("[")[0] for extra in project["optional-dependencies"].values() for r in extra}
    assert {name.lower() for name in wanted | core} - {"cable-envs"} <= set(pinned)


def test_the_extra_all_holds_every_extra_of_users():
    extras = PROJECT["project"]["optional-dependencies"]
    (named,) = extras["all"]
    held = set(named.removeprefix("cable-envs[").removesuffix("]").split(","))
    assert held | {"bench", "all", "docs", "dev", "gpu"} == set(extras) and extras["dev"][0] == "cable-envs[all,docs]"


def test_what_is_cited_is_this_version():
    import yaml

    import cable_envs

    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert cited["version"] == PROJECT["project"]["version"] == cable_envs.__version__
    assert cited["license"] == PROJECT["project"]["license"]
    text = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert f"## {cited['version']}" in text
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    papers = re.findall(r"https://doi\.org/([\w./]+\w)", cited["abstract"])
    assert len(papers) == 2 and all(doi in readme for doi in papers)


@pytest.mark.slow
def test_wheel_holds_packages_and_configuration_only(tmp_path):
    """The built wheel runs from an empty folder, finds its YAML files, and brings no top-level tests or configs."""
    wheels = tmp_path / "wheels"
    done = _python("-m", "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir", str(wheels), str(ROOT))
    assert done.returncode == 0, done.stderr
    (wheel,) = wheels.glob("cable_envs-*.whl")
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
        archive.extractall(tmp_path / "site")
    assert {name.split("/")[0] for name in names if ".dist-info" not in name} == set(INSTALLED)
    assert "cable_envs/configs/tasks/CableHole-Position.yaml" in names
    assert not [name for name in names if "__pycache__" in name]
    written = "from cablebench.skeletons import examples; print(len(examples()))"
    alone = {**os.environ, "PYTHONPATH": str(tmp_path / "site")}
    assert int(_python("-P", "-c", written, cwd=tmp_path, env=alone).stdout) > 10
    assert {"cablebench/board/pages/templates/board.html.j2", "cable_envs/drawing/templates/page.css"} <= set(names)
    assert {"cablebench/skeletons/templates/controller.py.j2", "cable_envs/boards/quick/records.jsonl.xz"} <= set(names)
    assert {"cable_envs/py.typed", "cablebench/py.typed", *(f"cable_envs/{name}/py.typed" for name in LINKED)} <= set(
        names
    )
    environment = {**os.environ, "PYTHONPATH": str(tmp_path / "site")}
    done = _python("-P", "-c", WITHOUT_EXTRAS, ",".join(EXTRAS), cwd=tmp_path, env=environment)
    assert done.returncode == 0, done.stderr
    assert str(tmp_path / "site") in done.stdout


def test_a_checkout_is_small_and_holds_no_large_file():
    """Without its history less than 10 MB, no file above 1.5 MB: what is generated is packed, or made by a command.

    A link counts as the link that git keeps, and not as what it leads to, which is counted itself.
    """
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=False)
    if listed.returncode:
        pytest.skip("no checkout of git")
    sizes = {name: (ROOT / name).lstat().st_size for name in listed.stdout.split("\0") if (ROOT / name).is_file()}
    assert sum(sizes.values()) < 10e6
    assert {name: size for name, size in sizes.items() if size > 1.5e6} == {}
