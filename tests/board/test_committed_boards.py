"""The boards in the repository: they come from their records, and their policies score as recorded."""

from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

from cablebench.board.board import build_board
from cablebench.board.notes import REMARKS
from cablebench.board.replay import TIMED
from cablebench.board.report import render_markdown
from cablebench.protocol.files import load_protocol
from cablebench.run.store import ResultStore

BOARDS = Path(__file__).parents[2] / "boards"
NAMES = ("suite-v1", "quick")


def _records(name):
    return ResultStore(BOARDS / name / "records.jsonl").records()


@pytest.mark.parametrize("name", NAMES)
def test_a_board_is_what_its_records_say(name):
    """To the letter, as intervals come of draws that the entrants' names begin. board.json is made by the command."""
    protocol, records = load_protocol(name), _records(name)
    assert {r["protocol_hash"] for r in records} == {protocol.hash()}
    remarks = (BOARDS / name / REMARKS).read_text(encoding="utf-8")
    board = build_board(protocol, records, remarks, f"--board {name}")
    assert render_markdown(board) == (BOARDS / name / "board.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("name", NAMES)
def test_every_policy_of_a_board_is_there_or_made_by_its_commands_and_was_charged(name):
    """Kept: seed 0 of all on the position sine of the hole. commands.sh makes the others; records name their hashes."""
    for r in _records(name):
        if r["training_seed"] is not None:
            path = BOARDS / name / "policies" / f"{r['entrant']}-{r['task']}-{r['training_seed']}.zip"
            kept = r["training_seed"] == 0 and r["task"] == "CableHole-Position-Sine"
            assert path.is_file() or (not kept and r["settings"]["policy"]), path
            trained_here = "configuration" in r["settings"]  # else learnt from a data set, without a trial
            assert r["charged"]["environment_steps"] > 0
            assert trained_here == ("tuning_trials" in r["charged"]) and r["charged"].get("tuning_trials", 1) > 0


class _Rounded:
    """A controller whose every command is off by a millionth, as sums in another order are."""

    def __init__(self, controller, draw: int):
        self._controller, self._rng = controller, np.random.default_rng(draw)

    def __getattr__(self, name):
        return getattr(self._controller, name)

    def act(self, *seen):
        return self._controller.act(*seen) * (1.0 + 1e-6 * self._rng.standard_normal())


@pytest.mark.parametrize("entrant", ["ppo", "sac", "residual-ppo", "mrac-g22-tuned"])
def test_a_row_scores_as_recorded(entrant):
    """Equal to the last digit on the processor that made the record. Others round matrix products otherwise, and a
    command that chatters turns this into much: how much is measured on episodes whose commands are rounded further."""
    from cablebench.cli.shared.policies import policy_entrant
    from cablebench.entrants.named import named_entrant
    from cablebench.protocol.metrics import measure
    from cablebench.run.evaluation import run_episode

    protocol = load_protocol("quick")
    cell = next(c for c in protocol.cells(("CableHole-Position-Sine",), ("randomised",)))
    seed = protocol.seeds(1)[0]
    recorded = next(
        r for r in _records("quick")
        if (r["entrant"], r["env_id"], r["track"], r["seed"]) == (entrant, cell.task.env, "randomised", seed)
        and r["training_seed"] in (None, 0)
    )  # fmt: skip
    policy = recorded["training_seed"] is not None
    if policy:
        made = policy_entrant(str(BOARDS / "quick" / "policies" / f"{entrant}-{cell.task.short}-0.zip"))
        options = {**cell.environment_options(), **made.needs(cell.task.env, None)}
    else:
        made = named_entrant(entrant)
        options = {**cell.environment_options(), "observe": recorded["options"]["observe"]}

    def metrics(draw: int | None = None):
        env = gym.make(cell.task.env, disable_env_checker=True, **options)
        controller = made.make(env.unwrapped.setup)
        return measure(run_episode(env, controller if draw is None else _Rounded(controller, draw), seed))

    again, rounded = metrics(), [metrics(draw) for draw in range(4 if policy else 0)]
    for key, value in recorded["metrics"].items():
        if key not in TIMED and value is not None:
            rounding = max((abs(r[key] - again[key]) for r in rounded), default=0.0)
            assert rounding <= 0.02 * abs(value) + 1e-9, key  # else the comparison would say nothing
            assert again[key] == pytest.approx(value, rel=1e-6, abs=1e-9 + 10.0 * rounding), key
