"""``cablebench demo``: all references on a few tasks, a freshly trained PPO agent on one of them, one ranked board.

References are evaluated in this process while a second one trains the agent: one core each.
"""

import multiprocessing
import time
import traceback
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

from cable_envs.core.errors import ConfigurationError
from cable_envs.core.files import require_writable
from cablebench.cli.bench.leaderboard import make_board
from cablebench.cli.shared.arguments import short_name
from cablebench.cli.shared.output import console, progress_bar

TRAINED = (
    "cable_envs/CableHole-Track-Easy-v1", "cable_envs/CableHole-Position-Sine-v0",
    "cable_envs/PulleyCircuit-Position-Sine-v0",
)  # fmt: skip
"""Tasks to train an agent for, where the protocol has them."""


def demo(
    out: Annotated[Path, typer.Option(help="Folder for board, records and policies.")] = Path("results"),
    protocol: Annotated[str, typer.Option(help="Protocol: a name in configs/protocols, or a YAML file.")] = "demo",
    seed: Annotated[int, typer.Option(min=0, help="Training seed of the agents.")] = 0,
    steps: Annotated[
        int | None, typer.Option(min=1, help="Environment steps of each agent; default: its settings'.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="The board as JSON on standard output.")] = False,
) -> None:
    """Rank every reference controller and a freshly trained PPO agent on a few tasks (within ten minutes)."""
    started = time.monotonic()
    from cable_envs.agents.settings import load_settings
    from cablebench.cli.shared.policies import policy_entrant
    from cablebench.entrants.named import prepared_entrants
    from cablebench.protocol.files import load_protocol
    from cablebench.run.evaluation import evaluate
    from cablebench.run.folders import open_store

    chosen = load_protocol(protocol)
    require_writable(out)
    listed = {task.env: task.options for task in chosen.tasks}
    jobs = {
        env: (load_settings("ppo", env, steps, listed[env]), out / "agents" / f"ppo-{short_name(env)}-{seed}")
        for env in TRAINED if env in listed
    }  # fmt: skip
    store = open_store(out)
    say = console(stderr=True)
    say.print(
        f"{len(listed)} tasks, {chosen.episodes} episodes each; training PPO for {', '.join(map(short_name, jobs))}"
    )
    with progress_bar() as update, _Training(jobs, chosen.train.seed(seed), update) as training:
        names = "references"

        def report(p: Any) -> None:
            update(names, p.done, p.total, p.text)
            training.listen()

        evaluate(chosen, prepared_entrants(chosen), store=store, progress=report)
        training.finish()
        names = "agents"
        agents = [policy_entrant(str(folder)) for _, folder in jobs.values()]
        if agents:
            evaluate(chosen, agents, store=store, progress=report)
    make_board(chosen, store, store.read(), out, as_json)
    say.print(f"done in {time.monotonic() - started:.0f} s; open {out / 'board.html'} in a browser", markup=False)


class _Training:
    """A second process that trains one agent after the other and reports through a pipe."""

    def __init__(self, jobs: dict[str, tuple[Any, Path]], seed: int, update: Any):
        context = multiprocessing.get_context("spawn")
        self._pipe, other = context.Pipe(duplex=False)
        self._process = context.Process(target=_train_all, args=(list(jobs.values()), seed, other), daemon=True)
        self._other, self._update, self._running = other, update, bool(jobs)

    def __enter__(self) -> "_Training":
        if self._running:
            self._process.start()
            self._other.close()
        return self

    def __exit__(self, *_: object) -> None:
        if self._process.pid is not None:
            self._process.join(timeout=10.0)  # after Ctrl-C it is saving
            self._process.terminate()

    def listen(self, wait: float = 0.0) -> None:
        """Show what has arrived; raises ConfigurationError when the training failed."""
        while self._running and self._pipe.poll(wait):
            try:
                kind, *content = self._pipe.recv()
            except EOFError:
                raise ConfigurationError(
                    f"the training process ended with exit code {self._process.exitcode}"
                ) from None
            if kind == "progress":
                self._update(*content)
            elif kind == "refused":
                raise ConfigurationError(content[0])
            elif kind == "failed":
                raise RuntimeError(f"training failed in its process:\n{content[0]}")
            self._running = kind != "done"

    def finish(self) -> None:
        """Wait until all agents are trained."""
        while self._running:
            self.listen(wait=0.2)


def _send(pipe: Any, name: str, done: int, total: int, text: str) -> None:
    pipe.send(("progress", name, done, total, text))


def _train_all(jobs: list[tuple[Any, Path]], seed: int, pipe: Any) -> None:
    """Body of the second process."""
    from cable_envs.agents.train import Interrupted, train

    try:
        for settings, folder in jobs:
            name = f"{settings.algo} on {short_name(settings.env_id)}"
            train(
                settings, seed, folder, overwrite=True,
                progress=partial(_send, pipe, name),
            )  # fmt: skip
        pipe.send(("done",))
    except (KeyboardInterrupt, Interrupted, BrokenPipeError):
        pass
    except ConfigurationError as error:
        pipe.send(("refused", str(error)))
    except Exception:
        pipe.send(("failed", traceback.format_exc()))
