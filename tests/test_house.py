"""The house: which package may import which, no circles, and no folder or file that nobody can take in at once."""

import ast
from pathlib import Path

import pytest

from tests.support.tree import FOLDERS, ROOT, module, sources

LAYERS = (
    ("cablebench.cli",),
    ("cablebench",),
    ("cable_envs.reproduction",),
    ("cable_envs.agents",),
    ("cable_envs.diagnosis", "cable_envs.proof", "cable_envs.identification"),
    ("cable_envs.baselines",),
    ("cable_envs.shipped",),
    ("cable_envs.device",),
    ("cable_envs.vector",),
    ("cable_envs.envs",),
    ("cable_envs.spaces",),
    ("cable_envs.render",),
    ("cable_envs.standalone",),
    ("cable_envs.continuous",),
    ("cable_envs.sim",),
    ("cable_envs.plants",),
    ("cable_envs.drawing",),
    ("cable_envs.effects",),
    ("cable_envs.physics",),
    ("cable_envs.core",),
)
"""From top to bottom: a module imports its own row or what is below it. In one row nobody imports the other."""

INSIDE = {
    "cablebench": (
        "cli",
        "concealed",
        "export",
        "pages",
        "tune",
        "board",
        "score",
        "bound",
        "run",
        "entrants",
        "jobs",
        "protocol",
        "skeletons",
        "",
    ),
    "cablebench.cli": ("", "suite", "bench", "learn", "physics", "shared"),
    "cable_envs.diagnosis": (
        "experiment",
        "",
        "report",
        "search",
        "evidence",
        "simulators",
        "intake",
        "systems",
        "fit",
        "model",
        "readers.sets",
        "readers",
        "data",
    ),
}
"""The same within a package; "" is what lies in its own folder."""

MOST = 13
"""Modules that a folder may hold, without its ``__init__``: what one can overlook, and one to spare."""


def _modules() -> dict[str, Path]:
    return {module(path): path for folder in FOLDERS for path in sources(folder)}


def _imports(path: Path, known: dict[str, Path]) -> set[str]:
    """Modules of this project that a file imports, inside functions too."""
    names = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            for alias in node.names:
                whole = f"{node.module}.{alias.name}"
                names.add(whole if whole in known else node.module)
    return names & set(known)


MODULES = _modules()
GRAPH = {name: _imports(path, MODULES) for name, path in MODULES.items()}


def _inside(name: str, parent: str) -> bool:
    return name == parent or name.startswith(parent + ".")


def _row(name: str) -> tuple[int, str] | None:
    for depth, row in enumerate(LAYERS):
        for parent in row:
            if _inside(name, parent):
                return depth, parent
    return None  # the package cable_envs itself, which only registers ids


def _circles(graph: dict[str, set[str]]) -> list[list[str]]:
    """Strongly connected parts of more than one node (Tarjan 1972)."""
    index: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    found: list[list[str]] = []

    def visit(node: str) -> None:
        index[node] = low[node] = len(index)
        stack.append(node)
        for other in graph.get(node, ()):
            if other not in index:
                visit(other)
                low[node] = min(low[node], low[other])
            elif other in stack:
                low[node] = min(low[node], index[other])
        if low[node] == index[node]:
            part = stack[stack.index(node) :]
            del stack[stack.index(node) :]
            if len(part) > 1:
                found.append(sorted(part))

    for node in graph:
        if node not in index:
            visit(node)
    return found


def test_packages_import_downwards_only():
    wrong = []
    for name, imported in GRAPH.items():
        here = _row(name)
        for other in sorted(imported):
            there = _row(other)
            if here and there and (there[0] < here[0] or (there[0] == here[0] and there[1] != here[1])):
                wrong.append(f"{name} imports {other}")
    assert wrong == []


@pytest.mark.parametrize("package", INSIDE)
def test_folders_of_a_package_import_downwards_only(package):
    order = INSIDE[package]

    def place(name: str) -> int:
        short = name.removeprefix(package).lstrip(".")
        for depth, folder in enumerate(order):
            if folder and _inside(short, folder):
                return depth
        return order.index("")

    wrong = [
        f"{name} imports {other}"
        for name, imported in GRAPH.items()
        for other in sorted(imported)
        if _inside(name, package) and _inside(other, package) and place(other) < place(name)
    ]
    assert wrong == []


def test_no_circle_of_files():
    assert _circles(GRAPH) == []


def test_no_folder_is_a_hall():
    folders: dict[Path, int] = {}
    for path in MODULES.values():
        folders[path.parent] = folders.get(path.parent, 0) + (path.name != "__init__.py")
    many = {str(f.relative_to(ROOT)): n for f, n in folders.items() if n > MOST}
    # effects are one file each, and as many as there are effects
    many.pop("cable_envs/effects", None)
    assert many == {}


PROOF, TOOL = "cable_envs.proof", "cable_envs.diagnosis"


def test_the_proof_shares_nothing_with_what_it_judges():
    assert [f"{n} imports {o}" for n in GRAPH if _inside(n, PROOF) for o in GRAPH[n] if _inside(o, TOOL)] == []
    assert [f"{n} imports {o}" for n in GRAPH if _inside(n, TOOL) for o in GRAPH[n] if _inside(o, PROOF)] == []


def test_plants_never_import_siblings():
    plants = ROOT / "cable_envs" / "plants"
    names = [f.name for f in plants.iterdir() if f.is_dir() and (f / "__init__.py").exists()]
    assert len(names) >= 3
    for name in names:
        own = f"cable_envs.plants.{name}"
        others = [f"cable_envs.plants.{other}" for other in names if other != name]
        wrong = [
            f"{n} imports {o}" for n in GRAPH if _inside(n, own) for o in GRAPH[n] for p in others if _inside(o, p)
        ]
        assert wrong == []
