"""Sealed exams: nobody knows the test episodes before the secret is published, and everybody can check them after."""

import hashlib
import stat

import pytest
import yaml

from cable_envs.core.errors import ConfigurationError
from cablebench.cli import main
from cablebench.protocol.files import load_protocol, parse_protocol
from cablebench.protocol.seal import commitment, draw_secret, drawn_seeds, opened
from cablebench.run.folders import published
from cablebench.run.store import ResultStore
from tests.cablebench.test_submit import HOLE, MINE, TINY


@pytest.fixture(scope="module")
def exam(tmp_path_factory):
    """A folder with exam.yaml and exam.secret, made by the command, and a controller."""
    folder = tmp_path_factory.mktemp("exam")
    (folder / "tiny.yaml").write_text(TINY)
    (folder / "mine.py").write_text(MINE)
    with pytest.raises(SystemExit) as end:
        main(["seal", "--protocol", str(folder / "tiny.yaml"), "--out", str(folder), "--name", "tiny exam"])
    assert not end.value.code
    return folder


def test_the_protocol_holds_the_commitment_and_only_its_holder_can_read_the_secret(exam):
    protocol = load_protocol(exam / "exam.yaml")
    content = (exam / "exam.secret").read_bytes()
    assert protocol.seal == hashlib.sha256(content).hexdigest() and len(content) == 65  # as sha256sum prints it
    assert stat.S_IMODE((exam / "exam.secret").stat().st_mode) == 0o600
    assert content.strip().decode() not in (exam / "exam.yaml").read_text()
    assert protocol.hash() != load_protocol(exam / "tiny.yaml").hash()
    assert opened(protocol, exam / "exam.secret").hash() == protocol.hash()


def test_protocols_without_a_seal_keep_their_hash():
    # the boards in this repository were made under it
    assert load_protocol("quick").hash() == published("quick").records()[-1]["protocol_hash"]


def test_sealed_seeds_are_known_with_the_secret_only(exam):
    protocol = load_protocol(exam / "exam.yaml")
    with pytest.raises(ConfigurationError, match=r"'tiny exam' is sealed.*--seal FILE"):
        protocol.seeds(2)
    seeds = opened(protocol, exam / "exam.secret").seeds(50)
    assert seeds == opened(protocol, exam / "exam.secret").seeds(50) and len(set(seeds)) == 50
    assert opened(protocol, exam / "exam.secret").seeds(2) == seeds[:2]
    assert all(2**62 <= s < 2**63 for s in seeds)
    assert "secret" not in repr(opened(protocol, exam / "exam.secret"))


def test_a_seed_that_somebody_trains_on_is_passed_over():
    secret = draw_secret()
    first, second, third = drawn_seeds(secret, "p", 3, lambda seed: False)
    assert drawn_seeds(secret, "p", 2, lambda seed: seed == first) == (second, third)
    assert drawn_seeds(secret, "another protocol", 1, lambda seed: False) != (first,)
    assert drawn_seeds(draw_secret(), "p", 1, lambda seed: False) != (first,)


def test_training_ranges_are_passed_over_whole(exam):
    data = yaml.safe_load((exam / "exam.yaml").read_text())
    data["seeds"]["train"] = {"first": 2**62, "count": 2**61}
    data["seal"] = commitment("ab" * 32)
    (exam / "ab").write_text("ab" * 32)
    protocol = opened(parse_protocol(data), exam / "ab")
    assert all(seed not in protocol.train for seed in protocol.seeds(100))


@pytest.mark.parametrize(
    ("content", "message"),
    [("cd" * 32, "is not the secret of 'tiny exam'"), ("short", "64 hexadecimal digits"), ("", "64 hexadecimal")],
)
def test_another_secret_is_refused(exam, tmp_path, content, message, cli):
    (tmp_path / "s").write_text(content)
    for command in (("evaluate",), ("submit", exam / "mine.py", "--results", tmp_path / "r", "--trust")):
        code, _, err = cli(*command, "--protocol", exam / "exam.yaml", "--seal", tmp_path / "s")
        assert code == 2 and message in err and err.count("\n") == 1
    assert not (tmp_path / "r").exists()


def test_a_secret_for_an_unsealed_protocol_is_refused(exam, cli):
    code, _, err = cli("evaluate", "--protocol", exam / "tiny.yaml", "--seal", exam / "exam.secret")
    assert code == 2 and "'tiny' is not sealed" in err
    code, _, err = cli("evaluate", "--protocol", exam / "exam.yaml", "--seal", exam / "nowhere")
    assert code == 2 and "cannot read" in err


def test_an_exam_is_never_written_over(exam, cli):
    before = (exam / "exam.secret").read_bytes()
    code, _, err = cli("seal", "--protocol", exam / "tiny.yaml", "--out", exam)
    assert code == 2 and "already" in err and (exam / "exam.secret").read_bytes() == before
    code, _, err = cli("seal", "--protocol", exam / "exam.yaml", "--out", exam / "other")
    assert code == 2 and "sealed already" in err


@pytest.mark.parametrize("seal", ["abc", 3, "AB" * 32, ["ab" * 32]])
def test_a_malformed_seal_is_named(exam, seal):
    data = {**yaml.safe_load((exam / "exam.yaml").read_text()), "seal": seal}
    with pytest.raises(ConfigurationError, match=r"seal = .*SHA-256"):
        parse_protocol(data)


def test_from_the_entrants_check_to_the_published_row(exam, tmp_path, cli):
    flags = ("--protocol", exam / "exam.yaml", "--results", tmp_path)
    seal = ("--seal", exam / "exam.secret")
    # before the deadline the entrant checks his file, and can run no test episode
    code, _, err = cli("submit", exam / "mine.py", *flags, "--check-only", "--trust")
    assert code == 0 and "can be submitted" in err
    code, _, err = cli("submit", exam / "mine.py", *flags)
    assert code == 2 and "is sealed" in err and not list(tmp_path.iterdir())
    # after it the holder runs what was handed in, and everybody replays it with the published secret
    code, _, err = cli("submit", exam / "mine.py", *flags, *seal)
    assert code == 0 and "place 1 of 1 (model-free)" in err
    records = ResultStore(tmp_path / "records.jsonl").records()
    protocol = opened(load_protocol(exam / "exam.yaml"), exam / "exam.secret")
    assert {r["seed"] for r in records} == set(protocol.seeds(2)) and {r["seal"] for r in records} == {protocol.seal}
    code, _, err = cli("leaderboard", *flags)
    assert code == 2 and "is sealed" in err
    assert cli("leaderboard", *flags, *seal)[0] == 0
    code, out, _ = cli("replay", *flags, *seal, "--env", HOLE, "--entrant", "mine")
    assert code == 0 and "every metric is the same to the last digit" in out
