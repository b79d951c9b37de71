"""Compositions: the first file with gains for a task plays it, as if it had entered alone."""

import pytest

from cable_envs import SUITE_IDS
from cable_envs.core.errors import ConfigurationError
from cable_envs.sim.registered import setup_of
from cablebench.entrants.named import named_entrant

TEXT = "schema: cable-composition/1\nname: both\nof: [camera-jaw-suite, grasp-jaw-suite]\n"
GRASP = "cable_envs/PulleyCircuit-Grasp-Medium-v1"


@pytest.fixture
def written(tmp_path):
    def write(text=TEXT):
        path = tmp_path / "both.yaml"
        path.write_text(text)
        return str(path)

    return write


def test_the_shipped_one_enters_every_task_of_the_suite():
    entrant = named_entrant("suite-references")
    parts = [named_entrant(name) for name in entrant.settings["of"]]
    assert entrant.information == "nominal"
    assert entrant.charged["tuning_trials"] == max(part.charged["tuning_trials"] for part in parts)
    assert [env for env in SUITE_IDS if entrant.enters(env, {"split": "test"}) is None] == []


def test_a_task_is_played_by_the_first_file_that_has_gains_for_it(written):
    setup = setup_of(GRASP, {})
    both, alone = named_entrant(written()), named_entrant("grasp-jaw-suite")
    assert both.needs(GRASP, setup) == alone.needs(GRASP, setup)
    found, expected = both.make(setup).controller, alone.make(setup).controller
    assert type(found) is type(expected) and found.gains == expected.gains
    assert both.enters("cable_envs/CableHole-Track-Easy-v1", {}) is None
    # among two laws for the same tasks the order decides
    laws = "of: [lqg-suite, adaptive-inverse-suite, drive-side-suite]"
    hole = setup_of("cable_envs/CableHole-Hold-Easy-v1", {})
    with pytest.raises(ConfigurationError, match="adaptive-inverse-suite plays no task"):
        named_entrant(written(TEXT.replace("of: [camera-jaw-suite, grasp-jaw-suite]", laws)))
    first = named_entrant(written(TEXT.replace("of: [camera-jaw-suite, grasp-jaw-suite]", "of: [lqg-suite]")))
    assert first.make(hole).controller.name == "lqg"


def test_its_settings_hold_those_of_its_files(written):
    first = named_entrant(written()).settings
    other = named_entrant(written(TEXT.replace("camera-jaw-suite, ", ""))).settings
    assert first["of"]["grasp-jaw-suite"] == other["of"]["grasp-jaw-suite"] and first != other
    assert sorted(first["of"]) == ["camera-jaw-suite", "grasp-jaw-suite"]


@pytest.mark.parametrize(("old", "new", "expected"), [
    ("name: both", "nam: both", "did you mean 'name'"),
    ("name: both", "name: ''", "a 'name'"),
    ("[camera-jaw-suite, grasp-jaw-suite]", "[]", "must list controller files"),
    ("grasp-jaw-suite", "grasp-jaw-suit", "grasp-jaw-suit"),
    ("grasp-jaw-suite", "none.yaml", "no controller file"),
])  # fmt: skip
def test_what_is_wrong_is_named(written, old, new, expected):
    with pytest.raises(ConfigurationError, match=expected):
        named_entrant(written(TEXT.replace(old, new, 1)))
