"""`python -m benchmarks.headroom`: what each task of suite v1 leaves between doing nothing and the bound.

It reads the published board (boards/suite-v1): the reference controllers with the gains of
configs/controllers/<law>-suite.yaml, `feedforward-pid`, and PPO trained for each task with every training seed, on the
test rigs. Scores and failures are the board's, between the frozen anchors. `benchmarks.verdicts` says what follows.
"""

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.verdicts import AGENT, BOUND, CLASSICAL, NOTHING, Row, table
from cable_envs.core.files import write_atomic
from cable_envs.core.text import between_marks
from cablebench.board.scoring import latest, score_episodes
from cablebench.entrants.named import SUITE
from cablebench.protocol.failures import scored_error
from cablebench.protocol.files import load_protocol
from cablebench.protocol.protocol import Protocol
from cablebench.run.folders import published
from cablebench.score.anchors import anchors_of
from cablebench.score.log_score import log_score

ROOT = Path(__file__).parents[1]
NAME, TRACK = "suite-v1", "test"
PARTS = {"open-loop": NOTHING, "feedforward-pid": CLASSICAL, "suite-ppo": AGENT}
"""Parts of entrants beside those with the gains for this suite."""

BEGIN, END = "<!-- begin: python -m benchmarks.headroom -->", "<!-- end -->"


def part_of(entrant: str) -> str | None:
    """What an entrant of the board is here; None for the oracle and for what is made of others."""
    return PARTS.get(entrant, CLASSICAL if entrant.endswith(SUITE) else None)


def rows_of(records: Sequence[Mapping[str, Any]], protocol: Protocol) -> dict[str, list[Row]]:
    """The rows of every task: of the board's entrants, and of the bound."""
    kept = latest(r for r in records if r["track"] == TRACK and part_of(r["entrant"]) is not None)
    found: dict[str, dict[str, dict[Any, dict[int, tuple[float, float]]]]] = {}
    for r, score in zip(kept, score_episodes(kept, protocol), strict=True):
        runs = found.setdefault(r["env_id"], {}).setdefault(r["entrant"], {})
        runs.setdefault(r["training_seed"], {})[r["seed"]] = scored_error(r["metrics"]), score
    anchors = anchors_of(protocol)
    rows = {}
    for task in protocol.tasks:
        seeds = protocol.seeds(protocol.episodes)
        rows[task.env] = []
        for entrant, runs in found[task.env].items():
            both = np.array([[run[seed] for seed in seeds] for _, run in sorted(runs.items(), key=str)])
            rows[task.env].append(Row(entrant, str(part_of(entrant)), both[..., 0], both[..., 1]))
        anchor = anchors[task.env, TRACK]
        bounds = np.array([anchor.bounds[: len(seeds)]])
        between = anchor.open_loop, anchor.bound
        rows[task.env].append(Row("bound", BOUND, bounds, np.vectorize(lambda e, b=between: log_score(e, *b))(bounds)))
    return rows


def ends(protocol: Protocol) -> dict[str, tuple[float, float]]:
    """The frozen anchors of every task: median errors of doing nothing and of the bound."""
    return {env: (one.open_loop, one.bound) for (env, track), one in anchors_of(protocol).items() if track == TRACK}


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.headroom", description=__doc__)
    parser.add_argument("tasks", nargs="*", help="parts of ids, as CableHole-Track or Hard; all by default")
    parser.add_argument("--page", type=Path, help="a page whose marked part is replaced by the table")
    arguments = parser.parse_args()
    protocol, store = load_protocol(NAME), published(NAME)
    assert store is not None
    chosen = {
        env_id: rows
        for env_id, rows in rows_of(store.read().records, protocol).items()
        if not arguments.tasks or any(part in env_id for part in arguments.tasks)
    }
    text = table(chosen, ends(protocol))
    print(text)
    if arguments.page:
        page = arguments.page.read_text(encoding="utf-8")
        write_atomic(arguments.page, between_marks(page, BEGIN, END, text))


if __name__ == "__main__":
    main()
