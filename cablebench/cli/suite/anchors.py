"""``cablebench anchors``: the frozen errors of open loop and bound that a suite is scored between."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from cable_envs.core.errors import ConfigurationError
from cablebench.cli.shared.output import console, progress_bar
from cablebench.cli.shared.trust import Trusted, Walls, say_sandboxes

NOTE = (
    "Frozen: a number changes only with the version of its task. open_loop and bound are median errors over the test "
    "episodes from first_seed on, on tasks of suite v1 priced ones. off and spread: how far upper-bound may be off."
)


def anchors(
    protocol: Annotated[str, typer.Option(help="Protocol of score version 1: a name, or a YAML file.")] = "suite-v1",
    env: Annotated[list[str] | None, typer.Option(help="Only this environment; repeatable.")] = None,
    track: Annotated[list[str] | None, typer.Option(help="Only this track; repeatable.")] = None,
    bound: Annotated[
        list[str] | None,
        typer.Option(help="Another candidate for the bound besides the oracle: a controller; repeatable."),
    ] = None,
    rounds: Annotated[int, typer.Option(min=0, help="Rounds of the search for the bound; 0: oracles only.")] = 8,
    episodes: Annotated[int, typer.Option(min=1, help="Test episodes of each task and track.")] = 20,
    replace: Annotated[bool, typer.Option("--replace", help="Make anchors again that are there.")] = False,
    out: Annotated[Path | None, typer.Option(help="File; default: the protocol's own, in configs/anchors.")] = None,
    check: Annotated[
        Path | None, typer.Option(help="Make none: count in this results folder how often a bound was beaten.")
    ] = None,
    sandbox: Walls = "auto",
    trust: Trusted = False,
) -> None:
    """Run open loop and bound on the tasks that have no anchors yet, and freeze their median errors in a file."""
    from cable_envs.core.config import config_root
    from cablebench.entrants.named import named_entrant
    from cablebench.protocol.files import load_protocol
    from cablebench.score.anchors import load_anchors, write_anchors
    from cablebench.score.freeze import freeze

    chosen = load_protocol(protocol)
    if not chosen.anchors:
        raise ConfigurationError(f"'{chosen.name}' has score version {chosen.score_version}: it needs no anchors")
    if check is not None:
        _check(chosen, check)
        return
    path = out or (
        Path(chosen.anchors) if Path(chosen.anchors).suffix else config_root() / "anchors" / f"{chosen.anchors}.yaml"
    )
    known = load_anchors(str(path)) if path.is_file() else {}
    missing = _missing(chosen, known, env or (), track or (), replace)
    say = console()
    if not missing:
        say.print(f"{path} has all {len(known)} anchors; --replace makes them again", markup=False)
        return
    bounds = [named_entrant(name, None, sandbox) for name in bound or ()]
    say_sandboxes(bounds)
    with progress_bar() as update:

        def report(p: Any) -> None:
            update("anchors", p.done, p.total, p.text)

        def keep(anchor: Any) -> None:  # at once: what has been made stays where the command is stopped
            known[anchor.task, anchor.track] = anchor
            write_anchors(path, known.values(), NOTE)

        made = freeze(chosen, named_entrant(chosen.open_loop), bounds, missing, episodes, rounds, report, keep)
    for a in made:
        say.print(
            f"{a.task} ({a.track}): open loop {a.open_loop:.3g} {a.unit}, bound {a.bound:.3g} {a.unit} ({a.bound_by})",
            markup=False,
        )
    say.print(f"wrote {path}", markup=False)


def _missing(protocol: Any, known: Any, envs: Sequence[str], tracks: Sequence[str], replace: bool) -> list[Any]:
    """The conditions to make anchors for, of some tasks and tracks or of all; those that have changed are refused."""
    from cablebench.score.anchors import task_hash

    tasks = [task for task in protocol.tasks if not envs or task.env in {protocol.task(name).env for name in envs}]
    found = []
    for task in tasks:
        for track in [protocol.track(name) for name in tracks] or protocol.tracks:
            there = known.get((task.env, track.name))
            if there is not None and not replace and there.task_hash != task_hash(task, track):
                raise ConfigurationError(
                    f"{task.env} ({track.name}) has changed since its anchors were frozen: --replace makes them "
                    "again, and every score of the task changes"
                )
            if there is None or replace:
                found.append((task, track))
    return found


def _check(protocol: Any, folder: Path) -> None:
    """Print how many of the recorded episodes are below the bound of the same episode."""
    from cablebench.board.scoring import latest
    from cablebench.run.folders import open_store
    from cablebench.score.anchors import anchors_of
    from cablebench.score.held import held

    records = latest(r for r in open_store(folder).read().records if r["protocol_hash"] == protocol.hash())
    found = held(records, anchors_of(protocol))
    if not found:
        raise ConfigurationError(f"{folder} has no records of '{protocol.name}' that a bound of an episode belongs to")
    say = console()
    for one in found:
        say.print(
            f"{one.task} ({one.track}): {one.below} of {one.episodes} episodes below the bound; nearest {one.nearest}, "
            f"{one.share:.3g} of it",
            markup=False,
        )
    below, episodes = sum(one.below for one in found), sum(one.episodes for one in found)
    share = 100.0 * (1.0 - below / episodes)
    say.print(f"the bound is a bound in {share:.2f} % of {episodes} episodes ({below} below it)", markup=False)
