"""Learning curves of a board: read from policies, and kept without them."""

import hashlib
import json
import zipfile

import pytest

from cablebench.board.learning import KEPT_POINTS, METADATA, PACKED_CURVES, learning_curves, pack_curves


def policy(path, curve):
    """A file like a saved policy, and the hash that records name it by."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr(METADATA, json.dumps({"curve": curve}))
    return hashlib.sha256(path.read_bytes()).hexdigest()[:12]


def record(digest, seed=0):
    return {"entrant": "mine", "task": "Some-Task", "training_seed": seed, "settings": {"policy": digest}}


@pytest.fixture
def trained(tmp_path):
    """A folder with two policies of many points, and their records."""
    curves = [[[1000 * k, 0.1 * k, 0.001 * k + seed] for k in range(1, 301)] for seed in (0, 1)]
    digests = [policy(tmp_path / f"runs/{seed}/policy.zip", curve) for seed, curve in enumerate(curves)]
    return tmp_path / "runs", [record(digest, seed) for seed, digest in enumerate(digests)]


def test_packed_curves_stand_for_the_policies_that_are_gone(trained, tmp_path):
    folder, records = trained
    whole = learning_curves([folder], records)
    board = tmp_path / "board"
    board.mkdir()
    assert pack_curves(board, [folder], records) == 2
    kept = learning_curves([board], records)
    assert [(c.entrant, c.task, c.seed) for c in kept] == [(c.entrant, c.task, c.seed) for c in whole]
    for thin, full in zip(kept, whole, strict=True):
        points = dict(zip(full.steps, full.rewards, strict=True))
        assert len(thin.steps) == KEPT_POINTS and thin.steps[::39] == full.steps[::299]
        assert all(y == pytest.approx(points[x], abs=1e-4) for x, y in zip(thin.steps, thin.rewards, strict=True))
    assert pack_curves(board, (), records) == 2  # what is packed stays without the policies
    assert learning_curves([board], records) == kept


def test_curves_of_nobody_on_the_board_are_not_kept(trained, tmp_path):
    folder, records = trained
    assert pack_curves(tmp_path, [folder], records[:1]) == 1
    assert len(learning_curves([tmp_path / "nowhere", tmp_path], records)) == 2  # the policies themselves are below it
    assert pack_curves(tmp_path / "none", [], records) == 0 and not (tmp_path / "none").exists()


@pytest.mark.parametrize("content", [b"", b"[1, 2]", b'{"a": 3}', b'{"%s": [[1, null], "x"]}'])
def test_a_damaged_file_of_curves_is_a_picture_less(content, tmp_path):
    digest = "0123456789ab"
    (tmp_path / PACKED_CURVES).write_bytes(content.replace(b"%s", digest.encode()))
    assert learning_curves([tmp_path], [record(digest)]) == ()
