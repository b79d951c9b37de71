"""The tree of a checkout: which folder is imported by which name."""

from pathlib import Path

ROOT = Path(__file__).parents[2]

LINKED = ("baselines", "agents", "identification", "diagnosis", "proof", "reproduction")
"""Folders at the top that are imported, and installed, as ``cable_envs.<folder>``: `cable_envs` has links to them."""

FOLDERS = ("cable_envs", *LINKED, "cablebench")
"""Folders of Python that are installed, each file once."""


def sources(package: str) -> list[Path]:
    """The Python files of a package: a folder of `FOLDERS`, or its import name."""
    folder = package.removeprefix("cable_envs.") if package != "cable_envs" else package
    return sorted(
        path for path in (ROOT / folder).rglob("*.py")
        # Python 3.13 follows links; a link is at home where it points
        if folder != "cable_envs" or path.relative_to(ROOT / folder).parts[0] not in LINKED
    )  # fmt: skip


def module(path: Path) -> str:
    """The import name of a file.

    >>> module(ROOT / "agents" / "__init__.py"), module(ROOT / "cablebench" / "run" / "store.py")
    ('cable_envs.agents', 'cablebench.run.store')
    """
    name = ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
    return f"cable_envs.{name}" if name.split(".")[0] in LINKED else name
