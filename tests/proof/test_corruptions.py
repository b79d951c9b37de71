"""Corruptions do to a log what their names say, and nothing else."""

import numpy as np
import pytest

from cable_envs.proof.logs.corruptions import CORRUPTIONS, HELD, LATE, LOST, Roles, corrupted

ROLES = Roles(("x", "y"), ("force",), ("command",), ("other",))


def _table(rows=2000):
    t = np.arange(rows) * 0.01
    return {
        "time": t, "x": np.sin(t), "y": 2.0 * np.sin(t), "force": np.cos(1.3 * t) + 1e-3 * np.sin(70.0 * t),
        "command": np.sin(t + 0.1), "other": t.copy(),
    }  # fmt: skip


@pytest.mark.parametrize("kind", CORRUPTIONS)
def test_a_corruption_changes_its_records_and_leaves_its_input(kind):
    tables = [_table(), _table()]
    found = corrupted(kind, tables, ROLES, np.random.default_rng(1))
    assert all(np.array_equal(tables[0][n], _table()[n]) for n in tables[0])
    changed = [any(not np.array_equal(f[n], t[n]) for n in t) for f, t in zip(found, tables, strict=True)]
    assert changed == [True, CORRUPTIONS[kind].everywhere]


def test_what_a_recording_lacks_cannot_be_corrupted():
    assert corrupted("sign of a command", [_table()], Roles(("x",), ("force",)), np.random.default_rng(0)) is None
    assert corrupted("two positions swapped", [_table()], Roles(("x",), ("force",)), np.random.default_rng(0)) is None


def test_the_sizes_are_as_said():
    def one(kind):
        return corrupted(kind, [_table()], ROLES, np.random.default_rng(2))[0]

    table = _table()
    lost = one("counts lost")["x"] - table["x"]
    assert set(np.round(lost, 12)) == {0.0, round(-LOST * float(np.ptp(table["x"])), 12)}
    held = np.flatnonzero(np.diff(one("effort held 10 rows")["force"]) == 0.0)
    assert len(held) == HELD - 1 and np.ptp(held) == HELD - 2
    late = one("position late")
    delay = LATE * np.ptp(table["time"])
    np.testing.assert_allclose(late["x"], np.sin(late["time"] - delay), atol=1e-4)  # straight lines between rows
    early = one("effort early")
    assert np.corrcoef(early["force"], np.cos(1.3 * (early["time"] + delay)))[0, 1] > 0.999
    assert np.diff(early["force"])[0] != 0.0 and np.diff(late["x"])[0] != 0.0  # no value is held at the ends
    assert np.max(np.abs(one("effort clipped")["force"])) == pytest.approx(0.6 * np.max(np.abs(table["force"])))
