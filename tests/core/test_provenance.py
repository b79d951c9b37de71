"""What a record says about its origin: a hash of what decides numbers, and of nothing that only draws."""

import pytest

from cable_envs.core.errors import ConfigurationError
from cable_envs.core.provenance import machine, source_hash, versions


@pytest.fixture
def package(tmp_path, monkeypatch):
    """A package with a law, a scene and a folder of drawings."""
    root = tmp_path / "some_plant"
    for name in ("__init__.py", "law.py", "scene.py", "drawing/chart.py"):
        file = root / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text("x = 1\n")
    monkeypatch.syspath_prepend(tmp_path)
    return root


@pytest.mark.parametrize(("name", "counts"), [("law.py", True), ("scene.py", False), ("drawing/chart.py", False)])
def test_the_hash_is_of_what_decides_numbers(package, name, counts):
    before = source_hash(["some_plant"], [])
    (package / name).write_text("x = 2\n")
    assert (source_hash(["some_plant"], []) != before) is counts


def test_configuration_counts_and_a_missing_package_is_named(package):
    assert source_hash(["some_plant"], []) != source_hash(["some_plant"], ["rigs"])
    with pytest.raises(ConfigurationError, match="no package 'no_such_plant'"):
        source_hash(["no_such_plant"])


def test_versions_name_the_source_and_the_machine_its_cores():
    assert versions()["source"] == source_hash() and {"numpy", "numba", "gymnasium", "python"} <= set(versions())
    assert " cores, " in machine()
