"""``cablebench datasets``: Minari data sets of every task of a protocol, with cards and checksums."""

from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

from cable_envs.core.errors import ConfigurationError, require_known
from cablebench.cli.shared.output import console, print_json, progress_bar


def datasets(
    out: Annotated[Path, typer.Option(help="Minari's folder of data sets.")],
    protocol: Annotated[str, typer.Option(help="Protocol: a name, or a YAML file.")] = "suite-v1",
    env: Annotated[list[str] | None, typer.Option(help="Only this environment; repeatable.")] = None,
    behaviour: Annotated[
        list[str] | None, typer.Option(help="random, reference or expert; repeatable. Default: all three.")
    ] = None,
    episodes: Annotated[int, typer.Option(min=1, help="Episodes of each data set.")] = 10,
    rounds: Annotated[int, typer.Option(min=0, help="Most rounds of the search for the expert's commands.")] = 6,
    check: Annotated[
        bool, typer.Option("--check", help="Make nothing: compare the files in --out with their checksums.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="What was made, as JSON on standard output.")] = False,
) -> None:
    """Make data sets of random, reference and expert behaviour for offline learning.

    Those that are in --out already are kept: the same command goes on after an interruption.
    """
    if check:
        _check(out, as_json)
        return
    from cablebench.cli.shared.arguments import resolve_env
    from cablebench.export.datasets import BEHAVIOURS, dataset_id, make_dataset
    from cablebench.protocol.files import load_protocol

    chosen = load_protocol(protocol)
    names = tuple(dict.fromkeys(behaviour or BEHAVIOURS))
    require_known("behaviour", names, BEHAVIOURS)
    tasks = [chosen.task(resolve_env(one)) for one in dict.fromkeys(env or ())] or list(chosen.tasks)
    plan = [(task, name) for task in tasks for name in names]
    missing = [(task, name) for task, name in plan if not (out / dataset_id(task, name)).exists()]
    made: list[Any] = []
    say = console()
    if len(missing) < len(plan):
        say.print(f"{len(plan) - len(missing)} of {len(plan)} data sets are in {out} already", markup=False)
    for task, name in missing:
        with progress_bar() as update:
            done = partial(_tell, update, dataset_id(task, name), episodes)
            done(0)
            made.append(make_dataset(chosen, task, name, out, episodes, rounds, done))
        if not as_json:
            _say(made[-1])
    if as_json:
        print_json({"datasets": [{**vars(one), "folder": str(one.folder)} for one in made]})
    else:
        say.print(f"read them with MINARI_DATASETS_PATH={out}; each has a README.md and SHA256SUMS", markup=False)


def _tell(update: Any, name: str, episodes: int, done: int) -> None:
    update(name, done, episodes)


def _say(one: Any) -> None:
    console().print(
        f"{one.dataset_id}: {one.episodes} episodes, {one.steps} steps, {one.failed} cut short, "
        f"mean sum of rewards {one.returns:.4g}, {one.size / 1e6:.1f} MB",
        markup=False,
    )


def _check(out: Path, as_json: bool) -> None:
    """ConfigurationError that names the files of data sets in ``out`` that are not as they were written."""
    from cablebench.export.datasets import SUMS, wrong_files

    folders = sorted(file.parent for file in out.rglob(SUMS))
    if not folders:
        raise ConfigurationError(f"{out} holds no data set of this command: none has {SUMS}")
    wrong = [line for folder in folders for line in wrong_files(folder)]
    if wrong:
        raise ConfigurationError("; ".join(wrong))
    if as_json:
        print_json({"checked": [str(folder) for folder in folders]})
        return
    console().print(f"all files of {len(folders)} data sets in {out} are as they were written", markup=False)
