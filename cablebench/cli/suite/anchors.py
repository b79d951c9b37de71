"""``cablebench anchors``: the frozen errors of open loop and bound that a suite is scored between."""

from pathlib import Path
from typing import Annotated, Any

import typer

from cable_envs.core.errors import ConfigurationError
from cablebench.cli.shared.output import console, progress_bar
from cablebench.cli.shared.trust import Trusted, Walls, say_sandboxes

NOTE = (
    "Frozen: a number changes only with the version of its task. open_loop and bound are median RMSEs over the test "
    "episodes from first_seed on."
)


def anchors(
    protocol: Annotated[str, typer.Option(help="Protocol of score version 1: a name, or a YAML file.")] = "suite-v1",
    env: Annotated[list[str] | None, typer.Option(help="Only this environment; repeatable.")] = None,
    bound: Annotated[
        list[str] | None,
        typer.Option(help="Candidate for the bound: a controller; repeatable, the best counts. Default: oracle."),
    ] = None,
    episodes: Annotated[int, typer.Option(min=1, help="Test episodes of each task and track.")] = 20,
    replace: Annotated[bool, typer.Option("--replace", help="Make anchors again that are there.")] = False,
    out: Annotated[Path | None, typer.Option(help="File; default: the protocol's own, in configs/anchors.")] = None,
    sandbox: Walls = "auto",
    trust: Trusted = False,
) -> None:
    """Run open loop and bound on the tasks that have no anchors yet, and freeze their median errors in a file."""
    from cable_envs.core.config import config_root
    from cablebench.entrants.named import named_entrant
    from cablebench.protocol.files import load_protocol
    from cablebench.score.anchors import load_anchors, task_hash, write_anchors
    from cablebench.score.freeze import freeze

    chosen = load_protocol(protocol)
    if not chosen.anchors:
        raise ConfigurationError(f"'{chosen.name}' has score version {chosen.score_version}: it needs no anchors")
    path = out or (
        Path(chosen.anchors) if Path(chosen.anchors).suffix else config_root() / "anchors" / f"{chosen.anchors}.yaml"
    )
    known = load_anchors(str(path)) if path.is_file() else {}
    wanted = {chosen.task(name).env for name in env or ()}
    missing = []
    for task in (t for t in chosen.tasks if not wanted or t.env in wanted):
        for track in chosen.tracks:
            there = known.get((task.env, track.name))
            if there is not None and not replace:
                if there.task_hash != task_hash(task, track):
                    raise ConfigurationError(
                        f"{task.env} ({track.name}) has changed since its anchors were frozen: --replace makes them "
                        "again, and every score of the task changes"
                    )
                continue
            missing.append((task, track))
    say = console()
    if not missing:
        say.print(f"{path} has all {len(known)} anchors; --replace makes them again", markup=False)
        return
    bounds = [named_entrant(name, None, sandbox) for name in bound or (chosen.oracle,)]
    say_sandboxes(bounds)
    with progress_bar() as update:

        def report(p: Any) -> None:
            update("anchors", p.done, p.total, p.text)

        made = freeze(chosen, named_entrant(chosen.open_loop), bounds, missing, episodes, report)
    known.update({(a.task, a.track): a for a in made})
    write_anchors(path, known.values(), NOTE)
    for a in made:
        say.print(
            f"{a.task} ({a.track}): open loop {a.open_loop:.3g} {a.unit}, bound {a.bound:.3g} {a.unit} ({a.bound_by})",
            markup=False,
        )
    say.print(f"wrote {path}", markup=False)
