"""The protocol files and what a protocol refuses."""

import copy

import pytest
import yaml

import cable_envs
from cable_envs.core.config import config_path, config_root
from cable_envs.core.errors import ConfigurationError
from cablebench.protocol.files import load_protocol, parse_protocol
from cablebench.protocol.protocol import Protocol, SeedRange

FILES = sorted(p.stem for p in (config_root() / "protocols").glob("*.yaml"))


@pytest.fixture
def data():
    return yaml.safe_load(config_path("protocols", "quick.yaml").read_text())


@pytest.mark.parametrize("name", FILES)
def test_every_protocol_file_loads_and_names_registered_environments(name):
    protocol = load_protocol(name)
    assert protocol.name == name
    assert {t.env for t in protocol.tasks} <= set(cable_envs.ENV_IDS + cable_envs.V1_IDS + cable_envs.SUITE_IDS)
    assert protocol.cells()


@pytest.mark.parametrize("name", FILES)
def test_train_tune_and_test_seeds_are_disjoint_and_test_seeds_are_enough(name):
    protocol = load_protocol(name)
    ranges = [set(range(r.first, r.first + r.count)) for r in (protocol.train, protocol.tune, protocol.test)]
    assert sum(map(len, ranges)) == len(set().union(*ranges))
    assert set(protocol.seeds(protocol.episodes)) <= ranges[2]


def test_quick_is_three_seeds_by_ten_episodes_on_all_eight_tasks():
    protocol = load_protocol("quick")
    assert (protocol.training_seeds, protocol.episodes, len(protocol.tasks)) == (3, 10, 8)
    assert "3 training seeds x 10 test episodes" in protocol.note  # a quick board says that it is one


def test_every_policy_sees_the_same_episodes_on_every_task_and_track():
    protocol = load_protocol("quick")
    assert len({protocol.seeds(c.episodes) for c in protocol.cells()}) == 1


def test_a_track_with_sweeps_gives_one_cell_for_each_value_where_it_applies():
    protocol = load_protocol("quick")
    cells = protocol.cells(tasks=("CableHole-Position-Step",), tracks=("stress",))
    names = [c.sweep.name for c in cells]
    assert "pretension" not in names  # a hanging load has none
    assert names.count("friction") == 21 and names.count("delay") == 21
    values = [c.value for c in cells if c.sweep.name == "friction"]
    assert values == sorted(values) and 1.0 in values  # the nominal rig is one of the points
    assert len({c.key for c in cells}) == len(cells)


def test_overlapping_seed_ranges_are_refused(data):
    data["seeds"]["tune"]["first"] = data["seeds"]["test"]["first"] + 5
    with pytest.raises(ConfigurationError, match="overlap"):
        parse_protocol(data)


def _broken(data, *path_and_value):
    *path, key, value = path_and_value
    broken = copy.deepcopy(data)
    place = broken
    for step in path:
        place = place[step]
    place[key] = value
    return broken


@pytest.mark.parametrize(
    ("path", "message"),
    [
        (("episods", 3), "did you mean 'episodes'"),
        (("seeds", "tests", {"first": 0, "count": 1}), "did you mean 'test'"),
        (("seeds", "train", "cuont", 3), "did you mean 'count'"),
        (("tracks", "nominal", "option", {}), "did you mean 'options'"),
        (("tracks", "stress", "sweeps", "friction", "form", 1), "did you mean 'from'"),
        (("budgets", "tuning_trails", 1), "did you mean 'tuning_trials'"),
        (("score", "worts", 1), "did you mean 'worst'"),
        (("run", ["nominl"]), "did you mean 'nominal'"),
        (("schema", 99), "schema 99"),
        (("episodes", 0), "at least 1"),
        (("episodes", 2.5), "whole number"),
        (("episodes", True), "whole number"),
        (("episodes", 2_000_000), "holds 1000000 seeds"),
        (("score", "worst", 0.5), "below 0"),
        (("bootstrap", "level", 1.5), "between 0 and 1"),
        (("tasks", ["a", "a"]), "listed twice"),
        (("tasks", []), "'tasks' is missing"),
        (("tracks", "stress", "sweeps", "delay", "scale", {"CableHole": ["x"]}), "needs one of 'scale'"),
        (("seeds", "test", 7), "'first' and 'count'"),
    ],
)
def test_wrong_entries_are_refused_with_what_would_be_right(data, path, message):
    with pytest.raises(ConfigurationError, match=message):
        parse_protocol(_broken(data, *path))


def test_the_hash_follows_what_changes_numbers_and_nothing_else(data):
    original = parse_protocol(data).hash()
    assert parse_protocol(copy.deepcopy(data)).hash() == original
    assert parse_protocol(_broken(data, "title", "another")).hash() == original
    for change in (("episodes", 11), ("score", "worst", -2.0), ("tracks", "nominal", "options", {})):
        assert parse_protocol(_broken(data, *change)).hash() != original, change


def test_a_version_with_the_episodes_of_an_earlier_one_keeps_its_records(data):
    later = parse_protocol({**data, "version": 4})
    same = parse_protocol({**data, "version": 4, "episodes_since": data["version"]})
    assert same.version == 4 and same.hash() == parse_protocol(data).hash() != later.hash()
    with pytest.raises(ConfigurationError, match="episodes_since = 5 is later than version 4"):
        parse_protocol({**data, "version": 4, "episodes_since": 5})


def test_unknown_protocols_tracks_and_tasks_name_the_nearest():
    with pytest.raises(ConfigurationError, match=r"did you mean 'quick'"):
        load_protocol("quik")
    protocol = load_protocol("quick")
    with pytest.raises(ConfigurationError, match="did you mean 'randomised'"):
        protocol.cells(tracks=("randomized",))
    with pytest.raises(ConfigurationError, match="CableHole-Position-Step"):
        protocol.cells(tasks=("CableHole-Position-Stepp",))


def test_a_protocol_can_be_a_file_of_the_users_own(tmp_path, data):
    path = tmp_path / "mine.yaml"
    path.write_text(yaml.safe_dump({**data, "name": "mine"}))
    assert load_protocol(path).name == "mine"


def test_seed_range_ends_where_it_says():
    seeds = SeedRange(100, 3)
    assert [seeds.seed(i) for i in range(3)] == [100, 101, 102] and 102 in seeds and 103 not in seeds
    with pytest.raises(ConfigurationError, match="seed number 3"):
        seeds.seed(3)


def test_a_protocol_is_frozen():
    with pytest.raises(AttributeError):
        load_protocol("quick").episodes = 3
    assert isinstance(load_protocol("quick"), Protocol)


def test_a_sweep_adds_to_rig_parameters():
    from cable_envs.sim.registered import setup_of

    mass = {"from": 0, "to": 2, "points": 3, "add": {"CableHole": {"load_mass": 0.5}}}
    data = {
        "schema": 1, "name": "x", "episodes": 1, "tracks": {"stress": {"sweeps": {"mass": mass}}},
        "tasks": [f"cable_envs/{name}-Sine-v0" for name in ("CableHole-Position", "PulleyCircuit-Torque")],
        "seeds": {k: {"first": 10 * i, "count": 10} for i, k in enumerate(("train", "tune", "test"))},
    }  # fmt: skip
    cells = parse_protocol(data).cells()
    assert [c.task.family for c in cells] == ["CableHole"] * 3
    setup = setup_of(cells[0].task.env, {})
    assert [c.reset_options(setup)["rig"]["load_mass"] for c in cells] == [5.0, 5.5, 6.0]
    mass["scale"] = {"CableHole": ["load_mass"]}
    with pytest.raises(ConfigurationError, match="needs one of 'scale', 'add'"):
        parse_protocol(data)
