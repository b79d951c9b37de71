"""How the process of a stranger's file begins: run as a script, it walls itself in before it imports anything.

Arguments: the plan of `cablebench.entrants.sandbox.kinds` as JSON, and the number of the connection's file descriptor.
"""

import importlib
import importlib.util
import json
import sys
from typing import Any


class _Ours:
    """Finds the project's packages by their folders, so that the folder they lie in need not be readable."""

    def __init__(self, folders: dict[str, str]):
        self._folders = folders

    def find_spec(self, name: str, path: Any = None, target: Any = None) -> Any:
        if name not in self._folders:
            return None
        folder = self._folders[name]
        return importlib.util.spec_from_file_location(
            name, f"{folder}/__init__.py", submodule_search_locations=[folder]
        )


def main() -> None:
    """Set limits and walls, import what serves, close the last wall, and serve."""
    plan = json.loads(sys.argv[1])
    sys.argv[1] = ""
    sys.path[:] = plan["path"]
    sys.meta_path.insert(0, _Ours(plan["packages"]))
    spec = importlib.util.spec_from_file_location(
        "walls", f"{plan['packages']['cablebench']}/entrants/sandbox/walls.py"
    )
    assert spec is not None and spec.loader is not None, "a .py file has a loader"
    walls = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(walls)
    walls.limit(plan["limits"])
    if plan["privileges"]:
        walls.give_up_privileges()
    if plan["files"]:
        walls.only_read(plan["read"])
    serving = importlib.import_module("cablebench.entrants.sandbox.serving")
    serving.end_with_parent()
    walls.limit(plan["last"])
    if plan["calls"]:
        walls.filter_calls()
    serving.serve(int(sys.argv[2]))


if __name__ == "__main__":
    main()
