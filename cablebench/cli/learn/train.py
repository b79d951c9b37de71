"""``cablebench train``: train learning agents on the native batch and save them."""

import time
from collections.abc import Mapping
from contextlib import closing
from pathlib import Path
from typing import Annotated, Any

import typer

from cable_envs.agents.files import CHECKPOINT, POLICY, settings_file
from cablebench.cli.shared.arguments import parse_options, resolve_env, short_name
from cablebench.cli.shared.output import console, print_json, progress_bar
from cablebench.cli.shared.training import chosen_seeds, say_seeds, training_job
from cablebench.cli.shared.trust import Trusted
from cablebench.jobs import Backend, Done, Job, open_backend

INTERRUPTED = 130
"""Exit code after Ctrl-C, as shells have it."""

JOBS_HELP = "Jobs at a time; default: one with local, the cluster's cores with ray."
BACKEND_HELP = "Where jobs run: local (processes of this machine) or ray."
ADDRESS_HELP = "Ray cluster; default: RAY_ADDRESS or the one that runs here, else one is started."


def train(
    env: Annotated[str, typer.Option(help="Environment, by full or short id.")],
    algo: Annotated[str, typer.Option(help="Agent: a name in configs/agents, or a YAML file like those.")] = "ppo",
    seed: Annotated[list[int] | None, typer.Option(min=0, help="Training seed (default 0); repeatable.")] = None,
    seeds: Annotated[
        list[str] | None, typer.Option(metavar="FIRST:COUNT", help="Several training seeds: 0:3 are 0, 1, 2.")
    ] = None,
    steps: Annotated[int | None, typer.Option(min=1, help="Environment steps; default: the settings' own.")] = None,
    out: Annotated[
        Path | None,
        typer.Option(help="Folder for policy.zip (default runs/ALGO-ENV-SEED); of several seeds, for their folders."),
    ] = None,
    option: Annotated[
        list[str] | None,
        typer.Option("--option", "-o", help="Environment option, KEY=YAML (randomize=true); repeatable."),
    ] = None,
    resume: Annotated[
        bool,
        typer.Option("--resume", help="Go on from the checkpoint in --out; of several seeds, finish what is missing."),
    ] = False,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace the policy in --out.")] = False,
    tensorboard: Annotated[Path | None, typer.Option(help="Folder for TensorBoard's logs.")] = None,
    jobs: Annotated[int | None, typer.Option(min=1, help=JOBS_HELP)] = None,
    backend: Annotated[str, typer.Option(help=BACKEND_HELP)] = "local",
    ray_address: Annotated[str | None, typer.Option(help=ADDRESS_HELP)] = None,
    trust: Trusted = False,
    as_json: Annotated[bool, typer.Option("--json", help="The result as JSON on standard output.")] = False,
) -> None:
    """Train an agent, or one for each of several seeds. Ctrl-C saves what is learned; --resume goes on from there."""
    env_id = resolve_env(env)
    options = parse_options(option or ())
    chosen = chosen_seeds(seed or (), seeds or ())
    settings_file(algo)  # a wrong name is said before torch is imported
    from cable_envs.agents.settings import load_settings

    started = time.time()
    settings = load_settings(algo, env_id, steps, options)
    say_seeds(settings, chosen)
    folders = run_folders(settings.algo, env_id, chosen, out)
    work = [
        training_job(
            settings, number, folder, resume=how_to_resume(resume, folders), overwrite=overwrite,
            tensorboard=tensorboard if tensorboard is None or len(chosen) == 1 else tensorboard / folder.name,
        )
        for number, folder in folders.items()
    ]  # fmt: skip
    with open_backend(backend, jobs, ray_address) as workers:
        ended, interrupted = _run(workers, work)
    results = _report(ended, dict(zip((job.key for job in work), folders.values())), as_json, single=len(work) == 1)
    if interrupted:
        _say_what_is_kept(results, folders, 0.0 if resume else started, resume)
        raise typer.Exit(INTERRUPTED)


def run_folders(algo: str, env_id: str, seeds: tuple[int, ...], out: Path | None) -> dict[int, Path]:
    """The folder of each seed."""
    if out is not None and len(seeds) == 1:
        return {seeds[0]: out}
    return {seed: (out or Path("runs")) / f"{algo}-{short_name(env_id)}-{seed}" for seed in seeds}


def how_to_resume(asked: bool, folders: Mapping[int, Path]) -> bool | str:
    """`cable_envs.agents.train.train`'s ``resume``: of several seeds some may be complete, others not begun."""
    begun = any((folder / name).exists() for folder in folders.values() for name in (POLICY, CHECKPOINT))
    return "auto" if asked and len(folders) > 1 and begun else asked


def _say_what_is_kept(results: list[dict[str, Any]], folders: Mapping[int, Path], since: float, resumed: bool) -> None:
    """After Ctrl-C: what each seed has, and how to go on. Checkpoints older than ``since`` are another training's."""
    say, ended, kept = console(stderr=True), {r["seed"]: r for r in results}, False
    if len(ended) == len(folders) and all(r["complete"] for r in results):
        return
    for seed, folder in folders.items():
        result, checkpoint = ended.get(seed), folder / CHECKPOINT
        goes_on = checkpoint.is_file() and checkpoint.stat().st_mtime >= since
        if result is not None and result["complete"]:
            text, goes_on = "complete", True
        elif result is not None:
            text = f"stopped after {result['steps']} steps; saved" + ("" if goes_on else ", but nothing to go on from")
        else:
            text = "stopped; its last checkpoint is kept" if goes_on else "nothing was saved"
        say.print(f"seed {seed}: {text}", markup=False)
        kept = kept or goes_on
    again = "The same command" if resumed else "The same command with --resume"
    say.print(f"{again} goes on." if kept else "The same command begins anew.", markup=False)


def _run(workers: Backend, work: list[Job]) -> tuple[list[Done], bool]:
    """(what has ended, whether Ctrl-C ended it). An error of one run does not stop the others."""
    ended: list[Done] = []
    with progress_bar() as update, closing(workers.run(work, lambda p: update(p.key, p.done, p.total, p.text))) as runs:
        try:
            for done in runs:
                ended.append(done)
                if len(work) > 1 and done.error is not None and not done.stopped:
                    console(stderr=True).print(f"{done.job.key}: {done.error}", markup=False)
        except KeyboardInterrupt:
            return ended, True
    return ended, False


def _report(ended: list[Done], folders: dict[str, Path], as_json: bool, single: bool) -> list[dict[str, Any]]:
    """Print what the runs came to; raises the error of the first that failed."""
    order = list(folders)
    found = sorted((done for done in ended if done.result), key=lambda done: order.index(done.job.key))
    results = [{"policy": str(folders[done.job.key]), **done.result} for done in found]
    failed = next((done.error for done in ended if done.error is not None and not done.stopped), None)
    if failed is not None and single:
        raise failed
    if as_json:
        print_json(results[0] if single and results else results)
    else:
        for result in results:
            _print(result)
    if failed is not None:
        raise failed
    return results


def _print(result: dict[str, Any]) -> None:
    last = result["curve"][-1] if result["curve"] else None
    reward = f", reward per step {last[2]:.3f} after {last[1]:.0f} s" if last else ""
    out, path = console(), result["policy"]
    name = f"{result['algo']} on {result['env_id']}, seed {result['seed']}"
    out.print(f"{name}: {result['steps']} steps{reward}", markup=False)
    out.print(
        f"saved in {path}; run it with: cablebench run {short_name(result['env_id'])} --policy {path}", markup=False
    )
