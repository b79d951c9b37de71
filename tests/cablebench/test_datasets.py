"""Data sets of a protocol's tasks: what is in them, that they load, and that the expert does what was found for it."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("minari")

from cable_envs.core.errors import ConfigurationError
from cablebench.cli import main
from cablebench.export import datasets
from cablebench.export.minari import load
from cablebench.protocol.files import load_protocol

HOLE, CIRCUIT = "cable_envs/CableHole-Track-Easy-v1", "cable_envs/PulleyCircuit-Track-Medium-v1"


@pytest.fixture(scope="module")
def suite():
    """The suite's protocol with two short tasks."""
    whole = load_protocol("suite-v1")
    return replace(whole, tasks=tuple(replace(whole.task(env), options={"duration": 6.0}) for env in (HOLE, CIRCUIT)))


@pytest.fixture(scope="module")
def made(suite, tmp_path_factory):
    """Data sets of the hole, by behaviour, and their folder."""
    root = tmp_path_factory.mktemp("datasets")
    return root, {name: datasets.make_dataset(suite, suite.tasks[0], name, root, 2, 1) for name in datasets.BEHAVIOURS}


def test_a_better_behaviour_has_the_higher_return_and_the_smaller_error(made):
    _, sets = made
    assert sets["random"].returns < sets["reference"].returns < sets["expert"].returns
    assert sets["expert"].error < sets["reference"].error < sets["random"].error


def test_episodes_hold_training_seeds_observations_and_true_errors(suite, made):
    root, _ = made
    data = load(root, "cable/CableHole-Track-Easy/reference-v0")
    episodes = list(data.iterate_episodes())
    assert data.total_episodes == 2 and data.total_steps == 1200
    assert all(
        m["seed"] in suite.train and m["seed"] not in suite.test for m in data.storage.get_episode_metadata([0, 1])
    )
    assert set(episodes[0].infos) == set(datasets.INFOS)
    assert np.allclose(episodes[0].infos["error"], episodes[0].infos["reference"] - episodes[0].infos["output"])
    assert episodes[0].observations.shape == (601, data.observation_space.shape[0])


def test_episodes_repeat_to_the_bit_in_the_recovered_environment(made):
    root, _ = made
    data = load(root, "cable/CableHole-Track-Easy/expert-v0")
    env, episode = data.recover_environment(), next(iter(data.iterate_episodes()))
    seed = next(iter(data.storage.get_episode_metadata([0])))["seed"]
    seen = [env.reset(seed=int(seed))[0], *(env.step(action)[0] for action in episode.actions)]
    assert np.array_equal(np.array(seen), episode.observations)


@pytest.mark.slow
def test_the_experts_commands_count_from_the_encoders_unknown_zero(suite, tmp_path):
    """A circuit's drive is commanded a position from a zero that differs in each episode."""
    task = suite.tasks[1]
    bounds = datasets.upper_bound(task.env, [suite.train.seed(0)], datasets.options_of(task), rounds=1)
    written = datasets.make_dataset(suite, task, "expert", tmp_path, 1, 1)
    assert written.error == pytest.approx(bounds[0].rmse, rel=2e-2)  # actions of 24 bits


def test_the_card_says_what_is_in_it(made):
    _, sets = made
    text = (sets["expert"].folder / datasets.CARD).read_text(encoding="utf-8")
    for word in (HOLE, "1200 steps", "no seed of the test", "`drive_tension` | N", "suite-v1 version"):
        assert word in text


def test_checksums_find_what_was_changed_is_missing_or_too_many(suite, tmp_path):
    folder = datasets.make_dataset(suite, suite.tasks[0], "random", tmp_path, 1).folder
    assert datasets.wrong_files(folder) == []
    (folder / datasets.CARD).write_text("another")
    (folder / "data" / "metadata.json").rename(folder / "more.json")
    wrong = " ".join(datasets.wrong_files(folder))
    assert (
        "README.md has changed" in wrong and "metadata.json is missing" in wrong and "more.json is not listed" in wrong
    )


def test_what_is_there_is_kept_and_the_command_checks_it(tmp_path, capsys):
    words = [
        "datasets",
        "--env",
        "CableHole-Sine-Medium",
        "--behaviour",
        "random",
        "--episodes",
        "1",
        "--out",
        str(tmp_path),
    ]
    for _ in range(2):
        with pytest.raises(SystemExit) as end:
            main(words)
        assert not end.value.code
    assert "1 of 1 data sets are in" in capsys.readouterr().out
    with pytest.raises(SystemExit) as end:
        main(["datasets", "--out", str(tmp_path), "--check"])
    assert not end.value.code and "all files of 1 data sets" in capsys.readouterr().out
    with pytest.raises(SystemExit) as end:
        main(["datasets", "--out", str(tmp_path / "none"), "--check"])
    assert end.value.code and "SHA256SUMS" in capsys.readouterr().err


def test_an_unknown_behaviour_is_named(suite, tmp_path):
    with pytest.raises(ConfigurationError, match="expert"):
        datasets.make_dataset(suite, suite.tasks[0], "expret", tmp_path)
    assert list(tmp_path.iterdir()) == []
