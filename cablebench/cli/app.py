"""The typer application: one entry for each command."""

from typing import Annotated

import typer

from cablebench.cli.bench import demo, envs, evaluate, export, leaderboard, replay, run, seal, submit
from cablebench.cli.learn import publish, train, tune
from cablebench.cli.physics import diagnose, first_look, identify, import_, pays, proof, recordings, reproduce

app = typer.Typer(
    name="cablebench",
    help="Benchmark controllers and learning agents on cable mechanisms (environments of cable_envs).",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)


def _version(asked: bool) -> None:
    if asked:
        import cable_envs

        typer.echo(f"cablebench {cable_envs.__version__}")
        raise typer.Exit


@app.callback()
def common(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version and exit.")
    ] = False,
) -> None:
    pass


for _command in (
    envs.envs, run.run, train.train, publish.publish, tune.tune, evaluate.evaluate, leaderboard.leaderboard, demo.demo,
    identify.identify, reproduce.reproduce, export.export, import_.import_, first_look.first_look, proof.proof,
    submit.submit, seal.seal, replay.replay, recordings.recordings, diagnose.diagnose, pays.pays,
):  # fmt: skip
    app.command(_command.__name__.rstrip("_").replace("_", "-"))(_command)
