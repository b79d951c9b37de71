"""A row is its maker's: nobody joins it, and contents are never mixed in it."""

import pytest

from cablebench.board.board import build_board
from cablebench.board.replay import rows_of
from cablebench.run.makers import maker_key
from tests.support.board_records import ENTRANTS, made_protocol, made_records

PROTOCOL = made_protocol(episodes=4, tracks=made_protocol().tracks[:1], tasks=made_protocol().tasks[:2])
NAMES = {name: ENTRANTS[name] for name in ("open-loop", "pid", "ppo", "oracle")}
RECORDS = made_records(PROTOCOL, entrants=NAMES)


def of(name, **changes):
    """The records of an entrant as somebody else would have them: bad ones, and with the changes."""
    own = [r for r in RECORDS if r["entrant"] == name]
    return [{**r, "metrics": {**r["metrics"], "rmse": 1.0}, **changes} for r in own]


def rows(records):
    return {r.entrant: r for r in build_board(PROTOCOL, records).tables[0].rows}


BEFORE = rows(RECORDS)


@pytest.mark.parametrize(("name", "changes", "apart"), [
    ("ppo", {"maker": "abcdef012345", "training_seed": 5}, "ppo (maker abcdef)"),  # another seed
    ("ppo", {"maker": "abcdef012345", "training_seed": 0}, "ppo (maker abcdef)"),  # in place of a seed
    ("pid", {"maker": "abcdef012345"}, "pid (maker abcdef)"),
    ("ppo", {"settings": {"configuration": "mine", "policy": "p"}, "training_seed": 5}, "ppo (training "),
    ("ppo", {"information": "nominal", "training_seed": 5}, "ppo (training "),
    ("oracle", {"maker": "abcdef012345"}, "oracle (maker abcdef)"),  # a reference that is nobody's but the keeper's
])  # fmt: skip
@pytest.mark.parametrize("first", [False, True], ids=["after", "before"])
def test_nobody_joins_or_moves_another_row(name, changes, apart, first):
    if first and "maker" not in changes:
        pytest.skip("of two trainings of one maker the first has the name")
    theirs = of(name, **changes)
    if changes.get("training_seed") is not None:
        theirs = list({r["env_id"] + str(r["seed"]): r for r in theirs}.values())
    found = rows([*theirs, *RECORDS] if first else [*RECORDS, *theirs])
    assert set(found) - set(BEFORE) == {n for n in found if n.startswith(apart)} != set()
    for row, before in BEFORE.items():
        assert found[row].runs == before.runs and found[row].score.value == before.score.value


def test_the_makers_further_seeds_join_the_row():
    key = maker_key("correct horse", "mine")
    mine = [{**r, "entrant": "mine", "maker": key} for r in RECORDS if r["entrant"] == "ppo"]
    assert rows([*RECORDS, *mine])["mine"].runs == 3


def test_a_name_without_a_keepers_row_is_whose_came_first():
    mine = [{**r, "entrant": "new", "maker": "aaaaaa"} for r in RECORDS if r["entrant"] == "pid"]
    theirs = [{**r, "maker": "bbbbbb"} for r in mine]
    assert {n for n in rows([*RECORDS, *mine, *theirs]) if "new" in n} == {"new", "new (maker bbbbbb)"}
    row = rows_of([*RECORDS, *mine, *theirs], PROTOCOL, "new (maker bbbbbb)", mine[0]["env_id"], "nominal")
    assert {r["maker"] for r in row} == {"bbbbbb"}


def test_a_half_done_run_with_other_gains_does_not_mix_with_the_whole_one():
    newer = of("pid", settings={"gains": {"kp": 1.0}})
    assert rows([*RECORDS, *newer[:2]])["pid"].score.value == BEFORE["pid"].score.value
    whole = rows([*RECORDS, *newer])["pid"]  # whole: it replaces what its maker had before
    assert whole.score.value < BEFORE["pid"].score.value and whole.episodes == BEFORE["pid"].episodes
