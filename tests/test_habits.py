"""What keeps the project in order is itself in order: hosted CI, hooks before a commit, versions, declared types."""

import re
import tomllib
from pathlib import Path

import yaml

from tests.support.tree import FOLDERS

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
PACKAGES = PROJECT["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"]
VERSIONS = ["3.11", "3.12", "3.13", "3.14"]


def _targets() -> set[str]:
    return set(re.findall(r"^([a-z][\w-]*):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))


def _workflow() -> dict:
    return yaml.safe_load((ROOT / ".github" / "workflows" / "ci.yml").read_text(encoding="utf-8"))


def test_hosted_ci_runs_on_every_declared_version_and_two_systems():
    matrix = _workflow()["jobs"]["tests"]["strategy"]["matrix"]
    assert matrix == {"os": ["ubuntu-latest", "macos-latest"], "python": VERSIONS}


def test_hosted_ci_calls_make_targets_that_exist():
    steps = [step.get("run", "") for job in _workflow()["jobs"].values() for step in job["steps"]]
    called = {target for step in steps for target in re.findall(r"\bmake ([\w-]+)", step)}
    assert {"lint", "test", "wheel"} <= called <= _targets()


def test_ci_of_the_project_itself_calls_make_targets_that_exist():
    script = "\n".join(
        line for line in (ROOT / ".ci" / "run").read_text(encoding="utf-8").splitlines() if line.strip()[:1] != "#"
    )
    assert set(re.findall(r"\bmake ([\w-]+)", script)) <= _targets()


def test_versions_of_python_agree():
    project, tool = PROJECT["project"], PROJECT["tool"]
    found = [m[1] for c in project["classifiers"] if (m := re.fullmatch(r"Programming .* :: (3\.\d+)", c))]
    assert found == VERSIONS
    assert project["requires-python"] == f">={VERSIONS[0]}"
    assert tool["ruff"]["target-version"] == "py" + VERSIONS[0].replace(".", "")
    assert tool["mypy"]["python_version"] == VERSIONS[0]


def test_every_package_says_that_it_has_types():
    assert [p for p in FOLDERS if not (ROOT / p / "py.typed").is_file()] == []
    assert PROJECT["tool"]["mypy"]["packages"] == [*PACKAGES, "docs.site"]  # the site is checked, and not installed
    assert PROJECT["tool"]["coverage"]["run"]["source"] == [*FOLDERS]


def test_hooks_need_no_network():
    config = yaml.safe_load((ROOT / ".pre-commit-config.yaml").read_text(encoding="utf-8"))
    hooks = [hook for repo in config["repos"] for hook in repo["hooks"]]
    assert {repo["repo"] for repo in config["repos"]} == {"local"}
    assert {hook["language"] for hook in hooks} == {"system"}
    assert {"ruff", "ruff-format", "mypy", "check-yaml", "check-toml"} <= {hook["id"] for hook in hooks}


def test_what_checks_the_code_is_pinned():
    pinned = (ROOT / "constraints.txt").read_text(encoding="utf-8")
    for name in ("mypy", "ruff", "pre-commit", "pre-commit-hooks", "pytest-cov", "types-PyYAML"):
        assert re.search(rf"^{name}==", pinned, re.MULTILINE), name
