"""``cablebench export``: episodes as a Minari dataset or a recording, or the agents' settings for another trainer."""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from cable_envs.core.errors import ConfigurationError, nearest
from cablebench.cli.bench.run import choose_entrant
from cablebench.cli.shared.arguments import options_for, parse_options, resolve_env, short_name
from cablebench.cli.shared.output import console, print_json, progress_bar
from cablebench.cli.shared.trust import Trusted

FORMATS = ("minari", "recording", "zoo")


def export(
    env: Annotated[str, typer.Argument(help="Environment, by full or short id.")],
    out: Annotated[Path, typer.Option(help="Folder: of the recording, Minari's of datasets, or of the zoo's files.")],
    form: Annotated[
        str,
        typer.Option(
            "--format",
            help="minari (HDF5 dataset), recording (YAML and tables), or zoo (the agents' settings for RL Baselines3 "
            "Zoo; no episodes).",
        ),
    ],
    controller: Annotated[
        str | None, typer.Option(help="Controller: a reference, a controller file, a .py file.")
    ] = None,
    policy: Annotated[str | None, typer.Option(help="Trained policy: its file or folder.")] = None,
    random: Annotated[bool, typer.Option("--random", help="Uniform random actions instead of either.")] = False,
    gain: Annotated[list[str] | None, typer.Option(help="Gain of the controller, NAME=NUMBER; repeatable.")] = None,
    option: Annotated[
        list[str] | None,
        typer.Option("--option", "-o", help="Environment option, KEY=YAML (sensor_noise=true); repeatable."),
    ] = None,
    episodes: Annotated[int, typer.Option(min=1, help="Number of episodes.")] = 10,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the first episode; the others follow.")] = 0,
    dataset_id: Annotated[
        str | None, typer.Option(help="minari: id, cable/NAME-v0; default cable/ENV/ENTRANT-v0.")
    ] = None,
    author: Annotated[str | None, typer.Option(help="minari: author to name in the dataset.")] = None,
    author_email: Annotated[str | None, typer.Option(help="minari: the author's address.")] = None,
    code_permalink: Annotated[str | None, typer.Option(help="minari: link to the code that made it.")] = None,
    table: Annotated[str, typer.Option(help="recording: csv or parquet.")] = "csv",
    heldout: Annotated[
        int | None, typer.Option(min=0, help="recording: episodes held out, the last ones; default a quarter.")
    ] = None,
    trust: Trusted = False,
    as_json: Annotated[bool, typer.Option("--json", help="What was written, as JSON on standard output.")] = False,
) -> None:
    """Run episodes and write them as data; with --format zoo, write how the agents are trained."""
    if form not in FORMATS:
        raise ConfigurationError(f"--format: unknown format '{form}'; {nearest(form, FORMATS)}")
    _check_flags(form, dataset_id, author, author_email, code_permalink, table, heldout)
    env_id = resolve_env(env)
    if form == "zoo":
        if controller or policy or random or gain or option:
            raise ConfigurationError("--format zoo writes settings of training: no entrant and no options are needed")
        _zoo(env_id, out, as_json)
        return
    entrant = _entrant(controller, policy, random, gain or ())
    options = options_for(entrant, env_id, parse_options(option or ()))
    seeds = range(seed, seed + episodes)
    if form == "minari":
        name = dataset_id or f"cable/{short_name(env_id)}/{re.sub(r'[^-_0-9A-Za-z]+', '-', entrant.name)}-v0"
        credit = {"author": author, "author_email": author_email, "code_permalink": code_permalink}
        written, traces = _minari(env_id, options, entrant, seeds, out, name, credit)
        how = f"read it with: MINARI_DATASETS_PATH={out} python -c \"import minari; minari.load_dataset('{name}')\""
    else:
        written, traces = _recording(env_id, options, entrant, seeds, out, table, heldout)
        how = f"read it with: diagnosis.data.recording.load_recording('{written}')"
    _report(entrant, env_id, form, written, traces, how, as_json)


def _zoo(env_id: str, out: Path, as_json: bool) -> None:
    """The agents' settings for an environment as files of RL Baselines3 Zoo."""
    from cable_envs.agents.zoo import write_zoo

    files = _writing(out, lambda: write_zoo(out, (env_id,)))
    if as_json:
        print_json({"format": "zoo", "env_id": env_id, "files": {f.algo: str(f.path) for f in files}})
        return
    for file in files:
        console().print(f"wrote {file.path}", markup=False)
    first = files[0]
    train = f"python -m rl_zoo3.train --algo {first.algo} --env {env_id} --gym-packages cable_envs -conf {first.path}"
    console().print(f"train with it: {train}", markup=False)


def _check_flags(form: str, *flags: Any) -> None:
    """ConfigurationError for a flag that belongs to the other format."""
    names = ("--dataset-id", "--author", "--author-email", "--code-permalink", "--table", "--heldout")
    given = dict(zip(names, flags, strict=True))
    for name, value in given.items():
        owner = "recording" if name in ("--table", "--heldout") else "minari"
        if value not in (None, "csv") and owner != form:
            raise ConfigurationError(f"{name} belongs to --format {owner}")


def _entrant(controller: str | None, policy: str | None, random: bool, gains: Sequence[str]) -> Any:
    if not random:
        if controller is None and policy is None:
            raise ConfigurationError("name --controller, --policy or --random")
        return choose_entrant(controller, policy, list(gains))
    if controller is not None or policy is not None or gains:
        raise ConfigurationError("--random takes the place of --controller, --policy and --gain")
    from cablebench.export.trace import random_entrant

    return random_entrant()


def _record(env: Any, entrant: Any, seeds: range) -> list[Any]:
    from cablebench.export.trace import record

    with progress_bar() as update:
        return record(env, entrant, seeds, lambda done: update("episodes", done, len(seeds)))


def _minari(
    env_id: str, options: dict[str, Any], entrant: Any, seeds: range, out: Path, name: str, credit: dict[str, Any]
) -> tuple[Path, list[Any]]:
    import gymnasium as gym

    from cablebench.export.minari import check_dataset_id, write_dataset

    check_dataset_id(name, out)
    made = gym.make(env_id, disable_env_checker=True, **options)
    try:
        traces = _record(made, entrant, seeds)
        return _writing(out, lambda: write_dataset(traces, made, entrant, out, name, **credit)), traces
    finally:
        made.close()


def _recording(
    env_id: str, options: dict[str, Any], entrant: Any, seeds: range, out: Path, table: str, heldout: int | None
) -> tuple[Path, list[Any]]:
    import gymnasium as gym

    from cable_envs.diagnosis.data.writing import TABLES
    from cablebench.export.recording import check_environment, check_folder, check_split, write_recording
    from cablebench.run.evaluation import core_of

    if table not in TABLES:
        raise ConfigurationError(f"--table: unknown format '{table}'; {nearest(table, TABLES)}")
    count = check_split(len(seeds), heldout)
    check_folder(out)
    made = gym.make(env_id, disable_env_checker=True, **options)
    full = gym.make(env_id, disable_env_checker=True, **{**options, "observe": "full"})
    try:
        check_environment(core_of(full).setup)
        traces = _record(made, entrant, seeds)
        return _writing(out, lambda: write_recording(traces, full, entrant, out, table=table, heldout=count)), traces
    finally:
        made.close()
        full.close()


def _writing(out: Path, write: Any) -> Any:
    try:
        return write()
    except OSError as error:
        raise ConfigurationError(f"cannot write to {out}: {error.strerror or error}") from error


def _report(
    entrant: Any, env_id: str, form: str, written: Path, traces: Sequence[Any], how: str, as_json: bool
) -> None:
    import numpy as np

    steps = sum(len(t.actions) for t in traces)
    torn = sum(not t.episode.complete for t in traces)
    first = traces[0]
    if all(np.array_equal(first.observations, t.observations) for t in traces[1:]) and len(traces) > 1:
        console(stderr=True).print(
            "All episodes are the same: nothing random is in them. --option sensor_noise=true makes them differ.",
            markup=False,
        )
    if as_json:
        print_json({"format": form, "path": str(written), "env_id": env_id, "entrant": entrant.name,
                    "seeds": [t.seed for t in traces], "steps": steps, "cut_short": torn})  # fmt: skip
        return
    out = console()
    cut = f", {torn} cut short" if torn else ""
    out.print(f"{entrant.title} on {env_id}: {len(traces)} episodes, {steps} steps{cut}", markup=False)
    out.print(f"wrote {written}", markup=False)
    out.print(how, markup=False)
