"""``cablebench train``: train a learning agent on the native batch and save it."""

from pathlib import Path
from typing import Annotated, Any

import typer

from cablebench.commands.common import (
    console,
    parse_options,
    print_json,
    progress_bar,
    require_ours,
    resolve_env,
    short_name,
)

INTERRUPTED = 130
"""Exit code after Ctrl-C, as shells have it."""


def train(
    env: Annotated[str, typer.Option(help="Environment, by full or short id.")],
    algo: Annotated[str, typer.Option(help="Algorithm; settings are in configs/agents/ALGO.yaml.")] = "ppo",
    seed: Annotated[int, typer.Option(min=0, help="Training seed.")] = 0,
    steps: Annotated[int | None, typer.Option(min=1, help="Environment steps; default: the settings' own.")] = None,
    out: Annotated[Path | None, typer.Option(help="Folder for policy.zip; default runs/ALGO-ENV-SEED.")] = None,
    option: Annotated[
        list[str] | None,
        typer.Option("--option", "-o", help="Environment option, KEY=YAML (randomize=true); repeatable."),
    ] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Go on from the policy in --out.")] = False,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace the policy in --out.")] = False,
    tensorboard: Annotated[Path | None, typer.Option(help="Folder for TensorBoard's logs.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="The result as JSON on standard output.")] = False,
) -> None:
    """Train an agent. Ctrl-C saves what it has learned; --resume goes on from there."""
    env_id = resolve_env(env)
    options = parse_options(option or ())
    require_ours("agents")
    from agents.settings import load_settings
    from agents.train import Interrupted
    from agents.train import train as run_training

    settings = load_settings(algo, env_id, steps, options)
    folder = out or Path("runs") / f"{algo}-{short_name(env_id)}-{seed}"
    stopped = None
    with progress_bar() as update:
        try:
            policy = run_training(
                settings, seed, folder, resume=resume, overwrite=overwrite, tensorboard=tensorboard,
                progress=lambda done, total, text: update(f"{algo} on {short_name(env_id)}", done, total, text),
            )  # fmt: skip
        except Interrupted as error:
            stopped, policy = error, error.policy
    _report(policy, as_json)
    if stopped is not None:
        console(stderr=True).print(f"{stopped}; saved. The same command with --resume goes on.", markup=False)
        raise typer.Exit(INTERRUPTED)


def _report(policy: Any, as_json: bool) -> None:
    m = policy.metadata
    last = m.curve[-1] if m.curve else None
    if as_json:
        print_json({
            "policy": policy.path, "digest": policy.digest, "env_id": m.env_id, "algo": m.name, "seed": m.seed,
            "steps": m.steps, "complete": m.complete, "configuration": m.settings_hash, "curve": m.curve,
        })  # fmt: skip
        return
    reward = f", reward per step {last[2]:.3f} after {last[1]:.0f} s" if last else ""
    out = console()
    out.print(f"{m.name} on {m.env_id}, seed {m.seed}: {m.steps} steps{reward}", markup=False)
    out.print(
        f"saved in {policy.path}; run it with: cablebench run {short_name(m.env_id)} --policy {policy.path}",
        markup=False,
    )
