"""What the docs name exists: paths, modules, functions, classes, tests, and the tree of the architecture page."""

import ast
import importlib
import re
from functools import cache
from pathlib import Path

import pytest

from cable_envs.effects import EFFECTS
from docs.site import effects as catalogue
from tests.support.tree import FOLDERS as PACKAGES
from tests.support.tree import LINKED, ROOT, module
from tests.test_house import LAYERS

FOLDERS = (*PACKAGES, "benchmarks", "boards", "configs", "docs", "examples", "tests")
PAGES = sorted([ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "docs").rglob("*.md")])
MADE_UP = {"weight_pid.py", "my_format.py", "my_controller.py", "mine.py", "spring.py"}
"""Files that a reader makes himself."""
MADE_BY_COMMANDS = {"boards/quick/board.html", "index.html"}
EXAMPLES = {"core.symlinks", "data.motor.q", "minari.load_dataset"}
TUTORIALS = ("slider", "Slider")
"""What CONTRIBUTING makes, step by step (`tests/test_contributing.py`)."""
STRICT = {"physics.md"}
"""Pages on which a dotted name of whatever kind is one of this project."""
FENCE = re.compile(r"^```(\w*)\n(.*?)^```", re.MULTILINE | re.DOTALL)


@cache
def files() -> frozenset[str]:
    found = (p for folder in FOLDERS for p in (ROOT / folder).rglob("*") if "__pycache__" not in p.parts)
    return frozenset(str(p.relative_to(ROOT)) for p in [*found, *ROOT.glob("*.*")])


@cache
def modules() -> dict[str, list[str]]:
    """Modules of the packages by the last part of their names."""
    found: dict[str, list[str]] = {}
    for path in files():
        if path.endswith(".py") and path.split("/")[0] in PACKAGES:
            name = module(ROOT / path)
            found.setdefault(name.rpartition(".")[2], []).append(name)
    return found


@cache
def classes() -> dict[str, set[str]]:
    """Names in the bodies of all classes of the packages, inherited ones left out."""
    found: dict[str, set[str]] = {}
    for path in files():
        if path.endswith(".py") and path.split("/")[0] in PACKAGES:
            for node in ast.walk(ast.parse((ROOT / path).read_text(encoding="utf-8"))):
                if isinstance(node, ast.ClassDef):
                    own = found.setdefault(node.name, set())
                    own |= {n.name for n in node.body if isinstance(n, ast.FunctionDef)}
                    own |= {n.target.id for n in node.body if isinstance(n, ast.AnnAssign)}
    return found


@cache
def sources_of_tests() -> str:
    return "\n".join((ROOT / path).read_text(encoding="utf-8") for path in files() if re.match(r"tests/.*\.py$", path))


def resolves(name: str) -> bool:
    """Whether a dotted name is a module, or an attribute of one."""
    words = name.split(".")
    for k in range(len(words), 0, -1):
        try:
            found = importlib.import_module(".".join(words[:k]))
        except ImportError:
            continue
        for word in words[k:]:
            if not hasattr(found, word) and word not in getattr(found, "__annotations__", ()):
                return False
            found = getattr(found, word, None)
        return True
    return False


def exists(path: str, page: Path) -> bool:
    """Whether a path is there from the root or the page's folder, or ends that of a file; ``*`` stands for names."""
    path = path.rstrip("/")
    if (
        path in MADE_UP | MADE_BY_COMMANDS
        or re.search("NAME|FILE", path)
        or any(list(base.glob(path)) for base in (ROOT, page.parent))
    ):
        return True
    return any(found.endswith(f"/{path}") for found in files()) and path.split("/")[0] not in FOLDERS


def lacking(text: str, page: Path) -> list[str]:
    """Names in ``text`` that look like ones of this project and are none."""
    tokens = " ".join(re.findall(r"`([^`\n]+)`", FENCE.sub("", text)))
    words = [w for w in re.findall(r"[\w.*:/-]+", tokens) if not any(made in w for made in TUTORIALS)]
    wrong = [word for word in words if not _known(word.rstrip(".:"), page)]
    for kind, block in FENCE.findall(text):
        imports = re.findall(r"^\s*from ([\w.]+) import (.+)$", block, re.MULTILINE) if kind == "python" else ()
        names = [f"{m}.{n.split(' as ')[0].strip()}" for m, all_ in imports for n in all_.split(",")]
        names = [n for n in names if not any(made in n for made in TUTORIALS)]
        wrong += [n for n in names if n.split(".")[0] in PACKAGES and not resolves(n)]
    started = [m for m in re.findall(r"python -m ([\w.]+)", text) if m.split(".")[0] in (*PACKAGES, "benchmarks")]
    return wrong + [module for module in started if not resolves(module)]


def _known(word: str, page: Path) -> bool:
    if re.fullmatch(r"(?:[\w*.-]+/)*[\w*-]+\.py", word) or (word.split("/")[0] in FOLDERS and "/" in word):
        return exists(word, page)
    if match := re.fullmatch(r"(?:([\w/]+\.py)::)?(test_\w+)", word):
        return (match[1] is None or exists(match[1], page)) and f"def {match[2]}" in sources_of_tests()
    return not re.fullmatch(r"[A-Za-z_]\w*(?:\.[A-Za-z_]\w*)+", word) or _known_dotted(word, page)


def _known_dotted(word: str, page: Path) -> bool:
    first, _, rest = word.partition(".")
    if word in EXAMPLES or _suffix(rest):
        return True
    if first in PACKAGES:
        return resolves(word)
    if first in classes():
        return rest in classes()[first]
    declared = {p.name for p in EFFECTS[first].parameters} if first in EFFECTS else ()
    unknown = first not in modules() and page.name not in STRICT
    return unknown or rest in declared or _in_module(first, rest)


def _suffix(rest: str) -> bool:
    """A file of data, as ``rig.yaml`` or ``proof.json.xz``, not a name."""
    return re.fullmatch(r"(?:yaml|json|jsonl|md|html|csv|npz|svg|zip|pt|webp|xz|\.)+", rest) is not None


def _in_module(stem: str, rest: str) -> bool:
    return any(resolves(f"{module}.{rest}") for module in modules().get(stem, ()))


@pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(ROOT)))
def test_paths_and_names_in_the_docs_exist(page):
    assert lacking(page.read_text(encoding="utf-8"), page) == []


def test_the_check_notices_what_is_not_there():
    page = ROOT / "README.md"
    text = (
        "`cable_envs/contact.py` `cable_envs/physics/contact.py` `cable_envs.physics.contact.tension_ratio` "
        "`cable_envs.contact` `contact.tension_ration` `backlash.gap` `backlash.gab` `tests/nowhere/` `nowhere.py` "
        "`test_that_nobody_wrote` `Statics.working` `Statics.walking` `R/r` `N/rad` `my-rig/` `board.json` `e.g.`"
    )
    assert lacking(text, page) == [
        "cable_envs/contact.py", "cable_envs.contact", "contact.tension_ration", "backlash.gab", "tests/nowhere/",
        "nowhere.py", "test_that_nobody_wrote", "Statics.walking",
    ]  # fmt: skip
    code = "```python\nfrom cable_envs.diagnosis.engine import diagnose, nothing\nimport numpy\n```\n"
    assert lacking(code, page) == ["cable_envs.diagnosis.engine.nothing"]


def test_the_architecture_page_draws_the_tree_as_it_is():
    page = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    block = next(text for _, text in FENCE.findall(page) if text.startswith("cable_envs/"))
    drawn = []
    for line in block.splitlines():
        names = re.match(r"( *)((?:[\w.]+/?)(?: [\w.]+\.py)*)  ", line)
        if names and len(names[1]) <= 2:
            inside = "cable_envs/" if names[1] else ""
            drawn += [inside + name for name in names[2].split()]
    assert [name for name in drawn if not (ROOT / name).exists()] == []
    assert {f"{folder}/" for folder in FOLDERS} <= set(drawn)
    inside = (ROOT / "cable_envs").iterdir()
    parts = {f"cable_envs/{p.name}/" for p in inside if (p / "__init__.py").exists() and p.name not in LINKED}
    assert parts <= {*drawn, "cable_envs/drawing/"}


def test_the_architecture_page_shows_the_layers_that_are_tested():
    page = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    block = next(text for _, text in FENCE.findall(page) if text.startswith("cablebench.cli"))
    shown = tuple(tuple(re.match(r"(?:[\w.]+ {1,2})+", line)[0].split()) for line in block.splitlines())
    assert shown == LAYERS


def test_the_page_of_the_diagnosis_lists_every_effect():
    page = (ROOT / "docs" / "diagnosis.md").read_text(encoding="utf-8")
    table = page[page.index("| group | effects |") : page.index("## The six answers")]
    assert sorted(re.findall(r"`(\w+)`", table)) == sorted(EFFECTS)


def test_the_catalogue_of_effects_is_what_they_declare():
    written = catalogue.FILE.read_text(encoding="utf-8")
    assert written == catalogue.page(), "run `python -m docs.site.effects`"
    assert written.count("\n## ") == len(EFFECTS) + len(catalogue.of_one_plant())
