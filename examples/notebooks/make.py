"""Makes the notebooks from the examples: ``python examples/notebooks/make.py``.

Each notebook is an example's docstring as text, its code as cells (one for each function or class), and a last cell
that runs it in a size that takes seconds to a minute. Notebooks are kept without outputs; a test compares them with
what this file makes, and runs them.
"""

import ast
import json
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
SETUP = """# Needed in a hosted notebook only, where the package is not installed yet.
import importlib.util
if importlib.util.find_spec("cable_envs") is None:
    %pip install --quiet "cable-envs[EXTRAS]"
"""
EXTRAS = {"closed_circle": "mujoco"}
"""What a notebook needs, where that is not what the others do."""
NOTEBOOKS = {
    "gym_loop": """for policy in (random_action, held_weight, proportional):
    print(policy.__name__, run(policy, seconds=10.0))""",
    "linear_mpc": """for controller in ("open-loop", "pid", LinearMpc):
    print(controller, 1e3 * run(controller, seconds=10.0), "mm")""",
    "ppo_native_batch": """import os

steps = int(os.environ.get("EXAMPLE_STEPS", 500_000))
print(1e3 * run(steps), "mm")""",
    "own_recording": 'main(["--out", "sample"])',
    "from_logs_to_rig": """folder = Path("sample")
logs(folder)
found = ask(folder)
draw(found)
again(folder, found)""",
    "closed_circle": """corrected, errors = circle(rig=0)
print(corrected)
told([errors])""",
}
"""Example -> its last cell."""
PARTS = {"closed_circle": ("circle", "pendulum", "reality", "controller")}
"""Of an example that is a folder: its files, the one with its docstring first, whose code comes last."""


def cells_of(source: str) -> list[dict[str, Any]]:
    """Cells of a notebook from the source of an example; what its ``__main__`` does is left out."""
    tree = ast.parse(source)
    lines, begin, parts = source.splitlines(), tree.body[0].end_lineno or 0, []
    for before, node in zip(tree.body, tree.body[1:]):
        main = isinstance(node, ast.If) and "__main__" in ast.unparse(node.test)
        whole = isinstance(node, ast.FunctionDef | ast.ClassDef)
        after = isinstance(before, ast.FunctionDef | ast.ClassDef)
        if whole or after or main:
            parts.append("\n".join(lines[begin : before.end_lineno]).strip("\n"))
            begin = before.end_lineno or 0
        if main:
            break
    else:
        parts.append("\n".join(lines[begin:]).strip("\n"))
    return [_cell("markdown", ast.get_docstring(tree) or "")] + [_cell("code", part) for part in parts if part]


def _cell(kind: str, text: str) -> dict[str, Any]:
    cell = {"cell_type": kind, "metadata": {}, "source": text.splitlines(keepends=True)}
    return cell if kind == "markdown" else cell | {"execution_count": None, "outputs": []}


def _alone(path: Path, parts: list[Path]) -> str:
    """The source of a file without what it imports from other parts, which are cells above."""
    names = {part.stem for part in parts}
    lines = path.read_text(encoding="utf-8").splitlines()
    return "\n".join(line for line in lines if not (line.startswith("from ") and line.split()[1] in names))


def notebook(name: str) -> str:
    """The content of examples/notebooks/``name``.ipynb."""
    parts = (
        [HERE.parent / name / f"{part}.py" for part in PARTS[name]] if name in PARTS else [HERE.parent / f"{name}.py"]
    )
    (text, *code), *others = (cells_of(_alone(path, parts)) for path in parts)
    code = [cell for other in others for cell in other] + code
    cells = [
        text,
        _cell("code", SETUP.replace("EXTRAS", EXTRAS.get(name, "agents,offline"))),
        *code,
        _cell("code", NOTEBOOKS[name]),
    ]
    cells = [{**cell, "id": f"cell-{k}"} for k, cell in enumerate(cells)]
    kernel = {"display_name": "Python 3", "language": "python", "name": "python3"}
    content = {"cells": cells, "metadata": {"kernelspec": kernel}, "nbformat": 4, "nbformat_minor": 5}
    return json.dumps(content, indent=1, ensure_ascii=False) + "\n"


if __name__ == "__main__":
    for made in NOTEBOOKS:
        (HERE / f"{made}.ipynb").write_text(notebook(made), encoding="utf-8")
        print(f"wrote {made}.ipynb")
