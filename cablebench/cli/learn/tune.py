"""``cablebench tune``: better gains for a controller, or settings for an agent, by trials on tuning episodes."""

import math
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer
import yaml

from cable_envs.core.errors import ConfigurationError
from cable_envs.core.files import require_writable
from cablebench.cli.learn.train import ADDRESS_HELP, BACKEND_HELP, INTERRUPTED, JOBS_HELP
from cablebench.cli.shared.arguments import resolve_env, short_name
from cablebench.cli.shared.output import console, print_json, progress_bar
from cablebench.jobs import Backend, open_backend

SHOWN = 5
"""Trials in the table."""

CONTROLLER_SCHEMA = "cable-controller/1"


def tune(
    env: Annotated[list[str], typer.Option(help="Environment, by full or short id; repeatable: each on its own.")],
    trials: Annotated[int, typer.Option(min=1, help="Trials for each environment; those already made count.")],
    controller: Annotated[str | None, typer.Option(help="Reference controller whose gains are tuned.")] = None,
    algo: Annotated[str | None, typer.Option(help="Agent whose settings are tuned: configs/agents, or a file.")] = None,
    steps: Annotated[int | None, typer.Option(min=1, help="Environment steps of an agent's trial.")] = None,
    protocol: Annotated[str, typer.Option(help="Protocol whose tuning seeds and tracks are used.")] = "quick",
    track: Annotated[str, typer.Option(help="Track that the trials are scored on.")] = "randomised",
    episodes: Annotated[int, typer.Option(min=1, help="Tuning episodes of a trial.")] = 5,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the optimiser.")] = 0,
    batch: Annotated[int, typer.Option(min=1, help="Trials chosen at a time; decides numbers, --jobs does not.")] = 4,
    study: Annotated[Path | None, typer.Option(help="SQLite file of the trials; default runs/tune-NAME.db.")] = None,
    out: Annotated[Path | None, typer.Option(help="YAML file for the result; default: standard output.")] = None,
    name: Annotated[str | None, typer.Option(help="Name on boards of a tuned controller; default NAME-tuned.")] = None,
    jobs: Annotated[int | None, typer.Option(min=1, help=JOBS_HELP)] = None,
    backend: Annotated[str, typer.Option(help=BACKEND_HELP)] = "local",
    ray_address: Annotated[str | None, typer.Option(help=ADDRESS_HELP)] = None,
    as_json: Annotated[bool, typer.Option("--json", help="All trials as JSON on standard output.")] = False,
) -> None:
    """Tune gains or settings. The same command goes on with what --study holds; Ctrl-C keeps finished trials."""
    if (controller is None) == (algo is None):
        raise ConfigurationError("name either --controller or --algo")
    if controller is not None and steps is not None:
        raise ConfigurationError("--steps belongs to --algo: a controller is not trained")
    if algo is not None and (steps is None or name is not None):
        raise ConfigurationError("--name belongs to --controller" if name else "--algo needs --steps for its trials")
    from cablebench.protocol.files import load_protocol

    plan: dict[str, Any] = {
        "protocol": load_protocol(protocol), "track": track, "episodes": episodes, "seed": seed, "batch": batch
    }  # fmt: skip
    envs = tuple(dict.fromkeys(resolve_env(e) for e in env))
    what = controller or Path(str(algo)).stem
    file = study or Path("runs") / f"tune-{what}.db"
    if controller is not None:
        from cablebench.cli.learn.tune_controllers import controller_search

        searches = {e: controller_search(controller, e, **plan) for e in envs}
    else:
        from cablebench.cli.learn.tune_agents import agent_search

        searches = {e: agent_search(str(algo), e, steps or 0, file.with_suffix(""), **plan) for e in envs}
    if out is not None:
        require_writable(out.parent)
    with open_backend(backend, jobs, ray_address) as workers:
        found, interrupted = _run(file, searches, trials, workers)
    if interrupted:
        _stopped(found, trials, file)
    command = _command(what if controller else str(algo), controller is not None, envs, trials, steps, plan, protocol)
    content = (
        _controller_file(what, name, found, command)
        if controller
        else _settings_file(str(algo), searches, found, command)
    )
    _report(found, content, out, file, as_json)


def _run(file: Path, searches: Mapping[str, Any], trials: int, workers: Backend) -> tuple[dict[str, list[Any]], bool]:
    """(trials of every environment, whether Ctrl-C ended it)."""
    from cablebench.tune.study import read_trials, tune

    found: dict[str, list[Any]] = {}
    say = console(stderr=True)
    with progress_bar() as update:
        for env_id, search in searches.items():

            def report(done: int, total: int, text: str, title: str = short_name(env_id)) -> None:
                update(title, done, total, text)

            try:
                found[env_id] = tune(
                    file, search, trials, workers, report, lambda text: say.print(text.splitlines()[0], markup=False)
                )
            except KeyboardInterrupt:
                found[env_id] = read_trials(file, search)
                return found, True
    return found, False


def _stopped(found: Mapping[str, Sequence[Any]], trials: int, file: Path) -> None:
    say = console(stderr=True)
    for env_id, made in found.items():
        ended = sum(t.state != "unfinished" for t in made)
        say.print(f"{short_name(env_id)}: {ended} of {trials} trials are kept in {file}", markup=False)
    say.print("The same command goes on from there.")
    raise typer.Exit(INTERRUPTED)


def _command(
    what: str, is_controller: bool, envs: Sequence[str], trials: int, steps: int | None, plan: Mapping[str, Any],
    protocol: str,
) -> str:  # fmt: skip
    """The command that finds the same again (on any backend, with any number of jobs)."""
    words = ["cablebench", "tune", "--controller" if is_controller else "--algo", what]
    for env_id in envs:
        words += ["--env", short_name(env_id)]
    words += ["--trials", str(trials)] + (["--steps", str(steps)] if steps else [])
    words += ["--protocol", protocol]
    for key in ("track", "episodes", "seed", "batch"):
        words += [f"--{key}", str(plan[key])]
    return shlex.join(words)


def _controller_file(
    controller: str, name: str | None, found: Mapping[str, Sequence[Any]], command: str
) -> dict[str, Any]:
    """The controller file (`cablebench.entrants.controller_files`) with the best gains of every environment."""
    from cable_envs.baselines import controller_class
    from cablebench.tune.study import best

    # the first trial is the default, which was itself found by trials
    before = controller_class(controller).charged.get("tuning_trials", 0)
    return {
        "schema": CONTROLLER_SCHEMA,
        "name": name or f"{controller}-tuned",
        "controller": controller,
        "charged": {"tuning_trials": before + max(len(made) for made in found.values())},
        "gains": {env_id: dict(best(made).values) for env_id, made in found.items()},
        "made_by": command,
    }


def _settings_file(
    algo: str, searches: Mapping[str, Any], found: Mapping[str, Sequence[Any]], command: str
) -> dict[str, Any]:
    """The agent's settings file with the best settings of every environment, and what finding them cost."""
    from cablebench.cli.learn.tune_agents import tuned_file
    from cablebench.tune.space import nested
    from cablebench.tune.study import best

    blocks = {
        env_id: {**nested(best(made).values), "tuning_trials": searches[env_id].about["charged_before"] + len(made)}
        for env_id, made in found.items()
    }
    return {**tuned_file(algo, blocks), "made_by": command}


def _report(
    found: Mapping[str, Sequence[Any]], content: dict[str, Any], out: Path | None, file: Path, as_json: bool
) -> None:
    from cable_envs.core.files import write_atomic
    from cablebench.tune.study import best

    command = content["made_by"] if "schema" in content else content.pop("made_by")
    inline = False if "schema" in content else None  # an agent's lists and innermost mappings on one line
    text = yaml.safe_dump(content, sort_keys=False, width=110, default_flow_style=inline)
    if "schema" not in content:
        text = f"# {command}\n{text}"
    say = console(stderr=out is None)
    for env_id, made in found.items():
        if not as_json:
            _table(env_id, made, say)
    if out is not None:
        try:
            write_atomic(out, text)
        except OSError as error:
            raise ConfigurationError(f"cannot write {out}: {error.strerror or error}") from error
    if as_json:
        environments = {
            env_id: {
                "best": best(made).number,
                "loss": best(made).loss,
                "start": made[0].loss,
                "trials": [asdict(t) for t in made],
            }
            for env_id, made in found.items()
        }
        print_json({"environments": environments, "result": content, "study": str(file), "command": command})
    elif out is None:
        typer.echo(text, nl=False)
    else:
        say.print(f"wrote {out}; the trials are in {file}", markup=False)


def _table(env_id: str, made: Sequence[Any], out: Any) -> None:
    """The best trials beside the first one, which is what was there before."""
    from rich.table import Table

    ended = sorted((t for t in made if t.loss is not None), key=lambda t: (t.loss, t.number))
    shown = ended[:SHOWN] + [t for t in ended[SHOWN:] if t.number == 0]
    failed = sum(t.state == "failed" for t in made)
    out.print(f"{short_name(env_id)}: {len(made)} trials" + (f", {failed} failed" if failed else ""), markup=False)
    table = Table(box=None, pad_edge=False)
    for title in ("trial", "mean log RMSE", "RMSE ratio", *(made[0].values if made else ())):
        table.add_column(title, justify="right")
    start = next((t.loss for t in ended if t.number == 0), None)
    for t in shown:
        ratio = "–" if start is None else f"{math.exp(t.loss - start):.3f}"
        values = (f"{v:.4g}" if isinstance(v, float) else str(v) for v in t.values.values())
        table.add_row(f"{t.number}{' (start)' if t.number == 0 else ''}", f"{t.loss:.4f}", ratio, *values)
    out.print(table)
