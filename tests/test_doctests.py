"""Every example in a docstring of the packages, and in this folder's helpers, gives what it says."""

import doctest
import importlib

import pytest

from tests.support.tree import FOLDERS, module, sources

FLAGS = doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS


def _with_examples() -> list[str]:
    """Modules that hold an example: only these are imported, so that the test does not load every library."""
    return [
        module(path)
        for package in (*FOLDERS, "tests/support")
        for path in sources(package)
        if ">>> " in path.read_text(encoding="utf-8")
    ]


@pytest.mark.parametrize("name", _with_examples())
def test_examples(name):
    failed, tried = doctest.testmod(importlib.import_module(name), optionflags=FLAGS)
    assert tried > 0, "an example that is in no docstring is never run"
    assert failed == 0
